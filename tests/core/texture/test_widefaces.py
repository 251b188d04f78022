from __future__ import annotations

import numpy as np
import pytest
from fresco.core.cameras import CatadioptricCamera, EquirectangularCamera, FisheyeCamera, PerspectiveCamera
from fresco.core.geometry.rigid import exp_so3
from fresco.core.photos import View
from fresco.core.texture import split_large_faces
from fresco.core.texture.models.widefaces import LensCurvature, WideFaces

CAMERAS = {
    "perspective": PerspectiveCamera(6000, 4000, [[3000, 0, 2999.5], [0, 3000, 1999.5], [0, 0, 1]]),
    "distorted": PerspectiveCamera(
        6000, 4000, [[3300, 0, 3010], [0, 3300, 1980], [0, 0, 1]], (-0.2, 0.06, 1e-3, -5e-4)
    ),
    "tele": PerspectiveCamera(6000, 4000, [[30000, 0, 2999.5], [0, 30000, 1999.5], [0, 0, 1]]),
    "fisheye": FisheyeCamera(4000, 4000, [[1250, 0, 2000], [0, 1250, 2000], [0, 0, 1]], (0.02, -0.01, 0, 0)),
    "catadioptric": CatadioptricCamera(3000, 3000, [[1300, 0, 1500], [0, 1300, 1500], [0, 0, 1]], 0.9),
    "panorama": EquirectangularCamera(8000, 4000),
}


def scattered_faces(count, seed=0):
    """Triangles of 1 mm to 1 m all around the origin, 0.2 to 20 m away."""
    random = np.random.default_rng(seed)
    direction = random.normal(size=(count, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    place = direction * np.exp(random.uniform(np.log(0.2), np.log(20), (count, 1)))
    size = np.exp(random.uniform(np.log(1e-3), np.log(1.0), (count, 1, 1)))
    corners = place[:, None] + size * random.normal(size=(count, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3).astype(np.int32)


def edge_error(camera, corners, steps=33):
    """Largest distance (pixels) of straight edges from the true ones, in the frame: (n,3,3) -> (n,)."""
    share = np.linspace(0, 1, steps)[:, None]
    along = corners[:, :, None] + share * (np.roll(corners, -1, axis=1) - corners)[:, :, None]
    pixels = camera.project(along.reshape(-1, 3)).reshape(*along.shape[:3], 2)
    inside = camera.in_frame(pixels).any(axis=2)
    pixels = camera.unwrapped(pixels, pixels[:, :1, :1])
    straight = pixels[:, :, :1] + share * (pixels[:, :, -1:] - pixels[:, :, :1])
    error = np.nan_to_num(np.linalg.norm(pixels - straight, axis=3).max(axis=2))
    return np.where(inside, error, 0).max(axis=1)


@pytest.mark.parametrize("name", list(CAMERAS))
def test_no_face_that_bends_is_passed_over_and_most_others_are(name):
    camera = CAMERAS[name]
    points, faces = scattered_faces(20_000)
    if name == "tele":
        points = points * (0.1, 0.1, 1.0)
    view = View(camera, np.eye(3), np.zeros(3), np.zeros((1, 1, 3), np.uint8))
    wide = WideFaces(points, faces, np.arange(len(faces)), double_sided=True)
    asked = wide.seen_bent(view, LensCurvature.of_camera(camera), np.zeros(3), 0.5)
    error = edge_error(camera, points[faces])
    bent = np.flatnonzero(error > 0.5)
    assert len(bent) > 20
    assert np.isin(bent, asked).all()
    in_frame = camera.in_frame(camera.project(points[faces].mean(axis=1)))
    assert np.count_nonzero(in_frame[asked]) < 0.75 * np.count_nonzero(in_frame)


@pytest.mark.parametrize("name", ["distorted", "fisheye", "panorama"])
def test_after_splitting_no_edge_in_any_photo_is_off_by_more_than_the_tolerance(name):
    camera = CAMERAS[name]
    points, faces = scattered_faces(400, seed=3)
    blank = np.zeros((camera.height, camera.width, 3), np.uint8)
    views = [View(camera, exp_so3([0, 1.1 * k, 0]), np.array([0, 0.05 * k, 0]), blank) for k in range(2)]
    centre = points[faces].mean(axis=1)
    # Not through the camera, nor above and below it: a panorama shows its poles as lines.
    far = (np.linalg.norm(centre, axis=1) > 1.5) & (np.hypot(centre[:, 0], centre[:, 2]) > 1.0)
    far &= np.linalg.norm(np.ptp(points[faces], axis=1), axis=1) < 0.6
    mesh = split_large_faces(points, faces[far], views, 0.5, double_sided=True)
    assert len(mesh.faces) > np.count_nonzero(far)
    for view in views:
        corners = (mesh.vertices @ view.rotation.T + view.translation)[mesh.faces]
        pixels = camera.project(corners.reshape(-1, 3)).reshape(-1, 3, 2)
        whole = camera.in_frame(pixels).all(axis=1)
        assert whole.any()
        # Five places along an edge are compared while splitting; in between it may be a little more.
        assert edge_error(camera, corners[whole]).max() < 0.6
