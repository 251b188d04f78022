import numpy as np
import pytest
from fresco.core.cameras import PerspectiveCamera
from fresco.core.errors import CameraError
from scipy.spatial.transform import Rotation

CAMERA = PerspectiveCamera(800, 600, [[700, 0, 400], [0, 700, 300], [0, 0, 1]])


def test_a_similarity_keeps_the_pixels(posed):
    model = posed([CAMERA] * 3)
    rotation, translation = Rotation.random(random_state=5).as_matrix(), np.array([500.0, -20, 3])
    moved = model.transformed(2.5, rotation, translation)
    for before, after in zip(model.cameras, moved.cameras, strict=True):
        world = before.centre + np.random.default_rng(1).normal(size=(50, 3))
        new = 2.5 * world @ rotation.T + translation
        np.testing.assert_allclose(
            after.camera.project(new @ after.rotation.T + after.translation),
            before.camera.project(world @ before.rotation.T + before.translation),
            atol=1e-7,
        )
    np.testing.assert_allclose(moved.points, 2.5 * model.points @ rotation.T + translation)
    np.testing.assert_array_equal(moved.colours, model.colours)


@pytest.mark.parametrize("scale", [0, -1, np.nan])
def test_scale_must_be_positive(scale, posed):
    with pytest.raises(CameraError, match="positive factor"):
        posed([CAMERA]).transformed(scale, np.eye(3), np.zeros(3))
