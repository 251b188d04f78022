"""The neutral renderer on planes and boxes whose picture is known in closed form."""

from types import SimpleNamespace

import numpy as np
import pytest
from fresco.core.cameras import EquirectangularCamera, PerspectiveCamera
from fresco.core.errors import TextureError
from fresco.core.geometry.rigid import exp_so3
from fresco.core.jobs import drain
from fresco.core.photos.view import View
from fresco.core.texture.models.render import (
    apply_gain,
    render_view,
    render_view_job,
    sample_bilinear,
    shade_faces,
    trace_pixels_job,
)
from fresco.core.texture.quality import image_offset, psnr


def camera(focal=300.0, distortion=(-0.12, 0.05, 0.001, -0.002)):
    matrix = np.array([[focal, 0, 161.3], [0, focal, 118.2], [0, 0, 1.0]])
    return PerspectiveCamera(320, 240, matrix, distortion)


def plane(steps=60, half=2.0, depth=0.0):
    """A square in the plane z = depth (m): vertices, faces."""
    axis = np.linspace(-half, half, steps + 1)
    x, y = np.meshgrid(axis, axis)
    vertices = np.stack([x.ravel(), y.ravel(), np.full(x.size, depth)], axis=1)
    corner = np.arange(steps * (steps + 1)).reshape(steps, steps + 1)[:, :-1].ravel()
    one, two, three = corner + 1, corner + steps + 1, corner + steps + 2
    faces = np.concatenate([np.stack([corner, one, three], 1), np.stack([corner, three, two], 1)])
    return vertices, faces


def paint(points):
    """Colour of a point of the plane: smooth, without symmetry, (N,3) -> (N,3) 0 to 255."""
    x, y = points[:, 0:1], points[:, 1:2]
    phase = np.array([[0.0, 1.0, 2.0]])
    return 128 + 60 * np.sin(9 * x + 3 * y + phase) + 50 * np.cos(7 * y - 2 * x * x + phase)


def picture(cam, rotation, translation):
    """The painted plane z = 0 through a camera, in closed form."""
    v, u = np.mgrid[: cam.height, : cam.width]
    rays = cam.unproject(np.stack([u.ravel(), v.ravel()], axis=1)) @ rotation
    centre = -rotation.T @ translation
    points = centre - rays * (centre[2] / rays[:, 2:])
    return np.clip(np.rint(paint(points)), 0, 255).astype(np.uint8).reshape(cam.height, cam.width, 3)


def texture_from(view, vertices, faces, index=0, gain=((1.0, 1.0, 1.0),)):
    """All faces from one photo."""
    local = (vertices - view.centre) @ view.rotation.T
    uv = view.camera.project(local)[faces]
    return SimpleNamespace(view=np.full(len(faces), index, np.int32), uv=uv, gain=np.array(gain))


@pytest.fixture
def photo():
    cam, rotation, translation = camera(520.0), exp_so3([0.1, -0.2, 0.05]), np.array([0.1, -0.05, 3.0])
    return View(cam, rotation, translation, picture(cam, rotation, translation), "front")


def test_rendering_from_another_place_matches_the_closed_form(photo):
    vertices, faces = plane(200)  # small faces: straight UV edges are exact to thousandths of a pixel
    cam, rotation, translation = camera(450.0, ()), exp_so3([-0.15, 0.1, -0.1]), np.array([-0.05, 0.1, 2.6])
    result = render_view(
        cam, rotation, translation, vertices, faces, texture_from(photo, vertices, faces), [photo]
    )
    inside = photo.camera.in_frame(
        photo.camera.project(plane_points(cam, rotation, translation) @ photo.rotation.T + photo.translation),
        1.0,
    ).reshape(result.covered.shape)
    expected = picture(cam, rotation, translation)
    assert inside.mean() > 0.5
    assert psnr(result.image, expected, inside) > 42
    assert np.abs(image_offset(result.image, expected, inside)).max() < 0.01


def plane_points(cam, rotation, translation):
    v, u = np.mgrid[: cam.height, : cam.width]
    rays = cam.unproject(np.stack([u.ravel(), v.ravel()], axis=1)) @ rotation
    centre = -rotation.T @ translation
    return centre - rays * (centre[2] / rays[:, 2:])


def test_the_photo_itself_comes_back_from_its_own_camera(photo):
    vertices, faces = plane()
    textured = texture_from(photo, vertices, faces)
    result = render_view(photo.camera, photo.rotation, photo.translation, vertices, faces, textured, [photo])
    difference = np.abs(result.image.astype(int) - photo.image)[result.covered]
    assert result.covered.mean() > 0.9
    assert difference.max() <= 2
    assert difference.mean() < 0.2


def test_grid_coordinates_change_nothing(photo):
    vertices, faces = plane()
    shift = np.array([5_000_000.25, 1_200_000.5, 300.0])
    far = View(photo.camera, photo.rotation, photo.translation - photo.rotation @ shift, photo.image)
    near_result, far_result = (
        render_view(v.camera, v.rotation, v.translation, points, faces, texture_from(v, points, faces), [v])
        for v, points in ((photo, vertices), (far, vertices + shift))
    )
    assert np.array_equal(near_result.covered, far_result.covered)
    assert np.abs(near_result.image.astype(int) - far_result.image).max() <= 1


def test_the_nearer_surface_hides_the_farther_one():
    back, back_faces = plane(4, 2.0, 0.0)
    front, front_faces = plane(2, 0.3, -1.0)
    vertices = np.concatenate([back, front])
    faces = np.concatenate([back_faces, front_faces + len(back)])
    hits = drain(trace_pixels_job(camera(300.0, ()), np.eye(3), [0, 0, 3.0], vertices, faces))
    assert hits.face[118, 161] >= len(back_faces)
    assert 0 <= hits.face[118, 300] < len(back_faces)
    # The small square spans 300 * 0.3 / 2 = 45 px about the principal point.
    rows, columns = np.nonzero(hits.face >= len(back_faces))
    assert (columns.min(), columns.max()) == (117, 206)
    assert (rows.min(), rows.max()) == (74, 163)


def test_weights_give_the_point_on_the_ray():
    vertices, faces = plane(7, 2.0)
    rotation, translation = exp_so3([0.3, 0.2, 0.1]), np.array([0.0, 0.1, 2.5])
    hits = drain(trace_pixels_job(camera(), rotation, translation, vertices, faces))
    seen = hits.face >= 0
    points = np.einsum("nk,nkc->nc", hits.weights[seen], vertices[faces[hits.face[seen]]])
    offset = points + rotation.T @ translation
    along = np.sum(offset * hits.rays[seen], axis=1, keepdims=True)
    assert np.abs(offset - along * hits.rays[seen]).max() < 1e-5


def test_a_panorama_inside_a_box_sees_a_face_everywhere():
    vertices, faces = plane(3, 1.0, 1.0)
    turns = [np.eye(3), exp_so3([np.pi, 0, 0])]
    turns += [exp_so3(np.pi / 2 * np.array(axis)) for axis in ((1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0))]
    box = np.concatenate([vertices @ turn.T for turn in turns])
    box_faces = np.concatenate([faces + i * len(vertices) for i in range(6)])
    cam = EquirectangularCamera(256, 128)
    hits = drain(trace_pixels_job(cam, exp_so3([0.1, 0.2, 0.3]), [0.1, 0.2, -0.3], box, box_faces))
    assert (hits.face >= 0).mean() > 0.999
    assert len(np.unique(hits.face // len(faces))) == 6


def test_faces_without_photo_are_clay_and_not_covered(photo):
    vertices, faces = plane()
    textured = texture_from(photo, vertices, faces)
    textured.view[vertices[faces].mean(axis=1)[:, 0] > 0] = -1
    result = render_view(photo.camera, photo.rotation, photo.translation, vertices, faces, textured, [photo])
    bare = result.image[~result.covered].astype(int)
    assert 0.3 < result.covered.mean() < 0.7
    assert np.ptp(bare - bare.mean(axis=0), axis=0).max() < 120
    assert (bare[:, 0] >= bare[:, 2]).all()  # the warm grey of clay, not the paint


def test_gain_acts_in_linear_light(photo):
    vertices, faces = plane()
    textured = texture_from(photo, vertices, faces, gain=((0.5, 1.0, 2.0),))
    plain = render_view(
        photo.camera, photo.rotation, photo.translation, vertices, faces, textured, [photo], gains=False
    )
    gained = render_view(photo.camera, photo.rotation, photo.translation, vertices, faces, textured, [photo])
    assert np.array_equal(plain.image[..., 1][plain.covered], gained.image[..., 1][plain.covered])
    assert (gained.image[..., 0] <= plain.image[..., 0])[plain.covered].all()
    # sRGB 188 is 0.5 of linear 1: half the light of 255.
    assert apply_gain(np.array([[255.0, 255.0, 188.0]]), [0.5, 1.0, 2.0]).tolist() == [[188, 255, 255]]
    ramp = np.repeat(np.arange(256.0)[:, None], 3, axis=1)
    assert np.array_equal(apply_gain(ramp, [1, 1, 1]), ramp.astype(np.uint8))


def test_bilinear_values_at_centres_between_and_outside():
    image = np.arange(12, dtype=np.uint8).reshape(2, 2, 3) * 10
    values = sample_bilinear(image, [[0, 0], [0.5, 0.5], [-3, 9], [1, 1]])
    assert values[:, 0].tolist() == [0, 45, 60, 90]
    assert sample_bilinear(image[:1, :1], [[4, 4]])[0].tolist() == [0, 10, 20]


def test_face_colours_keep_their_hue():
    vertices, faces = plane(4)
    hits = drain(trace_pixels_job(camera(), np.eye(3), [0, 0, 3.0], vertices, faces))
    red = shade_faces(hits, vertices, faces, np.tile(np.array([[200, 0, 0]], np.uint8), (len(faces), 1)))
    assert (red[hits.face >= 0][:, 1] == 0).all()
    assert (red[hits.face >= 0][:, 0] > 100).all()


def test_a_texture_of_another_mesh_is_refused(photo):
    vertices, faces = plane()
    textured = texture_from(photo, vertices, faces)
    pose = photo.camera, photo.rotation, photo.translation
    with pytest.raises(TextureError, match="another mesh"):
        render_view(*pose, vertices, faces[:-1], textured, [photo])
    textured.view[0] = 3
    with pytest.raises(TextureError, match="only 1 photos"):
        render_view(*pose, vertices, faces, textured, [photo])


def test_the_job_reports_rising_progress(photo):
    vertices, faces = plane(10)
    textured = texture_from(photo, vertices, faces)
    steps = []
    job = render_view_job(photo.camera, photo.rotation, photo.translation, vertices, faces, textured, [photo])
    result = drain(job, lambda progress: steps.append(progress.fraction))
    assert steps == sorted(steps)
    assert steps[0] >= 0 and steps[-1] <= 1
    assert result.image.shape == (240, 320, 3)
