import numpy as np
import pytest
from fresco.core.cameras.exchange import PosedCamera, Reconstruction
from scipy.spatial.transform import Rotation


@pytest.fixture
def posed():
    """Make photos of given cameras around a point, optionally far from the origin."""

    def make(cameras, offset=(0.0, 0.0, 0.0), seed=1):
        rng = np.random.default_rng(seed)
        photos = []
        for i, camera in enumerate(cameras):
            rotation = Rotation.random(random_state=seed + i).as_matrix()
            centre = np.asarray(offset) + rng.normal(size=3) * 5
            photos.append(PosedCamera(f"IMG_{i:04d}.jpg", camera, rotation, -rotation @ centre))
        points = np.asarray(offset) + rng.normal(size=(7, 3))
        colours = rng.integers(0, 256, (7, 3)).astype(np.uint8)
        return Reconstruction(tuple(photos), points, colours)

    return make


@pytest.fixture
def same_projection():
    """Check that two lists of photos see the same world points at the same pixels."""

    def check(first, second, tolerance=1e-6, points=True):
        assert len(first.cameras) == len(second.cameras)
        for a, b in zip(first.cameras, second.cameras, strict=True):
            world = a.centre + np.random.default_rng(3).normal(size=(200, 3)) * 8
            pixels = [photo.camera.project((world - photo.centre) @ photo.rotation.T) for photo in (a, b)]
            seen = np.isfinite(pixels[0]).all(axis=1) & (np.abs(pixels[0]) < 5000).all(axis=1)
            assert seen.sum() > 20
            np.testing.assert_allclose(pixels[1][seen], pixels[0][seen], atol=tolerance)
            np.testing.assert_allclose(a.centre, b.centre, atol=1e-8, rtol=1e-12)
        if points:
            np.testing.assert_allclose(first.points, second.points, rtol=1e-15)
            np.testing.assert_array_equal(first.colours, second.colours)

    return check
