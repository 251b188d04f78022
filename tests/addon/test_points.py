"""Surveyed points in the scene: imported, picked, found, and poses from them."""

import bpy
import numpy as np
import pytest

PLACES = {
    "P1": (0, 0.5, 0.5), "P2": (0, 1.7, 1.5), "P3": (0.6, 0, 0.7), "P4": (1.6, 0, 1.9), "P5": (0.9, 0.8, 0),
    "P6": (1.7, 1.5, 0), "P7": (0, 1.7, 0.5),
}  # fmt: skip


@pytest.fixture
def surveyed(imported, tmp_path):
    rows = [f"{name},{x},{y},{z}" for name, (x, y, z) in PLACES.items()]
    (tmp_path / "control.csv").write_text("\n".join(rows))
    assert bpy.ops.fresco.import_points(filepath=str(tmp_path / "control.csv")) == {"FINISHED"}
    return imported


def seen(room, module, number):
    """True pixels of the points in a photo."""
    rotation, translation = room.POSES[number]
    camera = module("core.cameras").PerspectiveCamera(*room.SIZE, room.K, room.DISTORTION)
    return camera.project(np.array(list(PLACES.values())) @ rotation.T + translation)


def test_points_are_read_and_removed_with_their_picks(surveyed, module):
    assert [point.name for point in surveyed.fresco.points] == list(PLACES)
    bridge = module("addon.bridge.points")
    np.testing.assert_allclose(bridge.read_points(surveyed).points, list(PLACES.values()), atol=1e-6)
    bridge.write_pick(surveyed.fresco.photos[0], "P2", (10, 20))
    surveyed.fresco.point_index = 1
    assert bpy.ops.fresco.remove_point() == {"FINISHED"}
    assert "P2" not in surveyed.fresco.points and len(surveyed.fresco.photos[0].picks) == 0
    assert bridge.next_name(surveyed) == "P2"


def test_a_renamed_point_keeps_its_picks_and_names_stay_different(surveyed, module):
    points, photo = surveyed.fresco.points, surveyed.fresco.photos[0]
    module("addon.bridge.points").write_pick(photo, "P2", (10, 20))
    points["P2"].name = "gate post"
    assert tuple(photo.picks["gate post"].pixel) == (10, 20) and "P2" not in photo.picks
    points["gate post"].name = "P1"
    points["gate post"].name = ""
    assert [point.name for point in points][:3] == ["P1", "gate post", "P3"]
    assert "gate post" in photo.picks


def test_a_pose_from_points_tells_residuals_and_wrong_points(surveyed, room, module):
    bridge, photo = module("addon.bridge.points"), surveyed.fresco.photos[1]
    surveyed.fresco.photo_index = 1
    assert not bpy.ops.fresco.pose_from_points.poll()
    for name, pixel in zip(PLACES, seen(room, module, 1), strict=True):
        bridge.write_pick(photo, name, pixel + (60 if name == "P3" else 0))
    assert bpy.ops.fresco.pose_from_points() == {"FINISHED"}
    rotation, translation = room.POSES[1]
    view = module("addon.bridge.photos").read_view(surveyed, photo)
    assert np.linalg.norm(view.centre + rotation.T @ translation) < 0.005
    assert photo.state == "SOLVED" and 0 < photo.centre_sigma < 0.1 and "P3" in photo.message
    assert [pick.used for pick in photo.picks] == [name != "P3" for name in PLACES]
    assert photo.picks["P3"].residual > 50 and photo.picks["P1"].residual < 0.1
    photo.picks["P3"].active = False
    bpy.ops.fresco.pose_from_points()
    assert "P3" not in photo.message
    assert photo.picks["P3"].residual == pytest.approx(60 * 2**0.5, abs=0.5)  # a check now
    assert not photo.picks["P3"].used and photo.picks["P1"].used
    for pick in list(photo.picks)[3:]:
        pick.active = False
    assert not bpy.ops.fresco.pose_from_points.poll()


def test_contradicting_points_are_refused_and_nothing_moves(surveyed, room, module):
    bridge, photo = module("addon.bridge.points"), surveyed.fresco.photos[0]
    surveyed.fresco.photo_index = 0
    rng = np.random.default_rng(0)
    for name in PLACES:
        bridge.write_pick(photo, name, rng.uniform(20, 300, 2))
    before = photo.camera.matrix_world.copy()
    with pytest.raises(RuntimeError, match="wall 1: "):
        bpy.ops.fresco.pose_from_points()
    assert photo.camera.matrix_world == before and photo.state == "UNSOLVED"


def test_a_picked_pixel_snaps_to_the_corner(surveyed, room, module):
    surveyed.fresco.point_index = 6  # a corner of the red panel
    photo = surveyed.fresco.photos[0]
    true = seen(room, module, 0)[6]
    pixels = module("core.photos").read_image(photo.path)
    module("addon.operators.points").pick_pixel(surveyed, photo, pixels, np.add(true, (2.0, -1.5)))
    np.testing.assert_allclose(photo.picks["P7"].pixel, true, atol=0.8)
    module("addon.operators.points").pick_pixel(surveyed, photo, pixels, np.array([1.0, 1.0]))
    np.testing.assert_allclose(photo.picks["P7"].pixel, (1, 1), err_msg="nothing to snap to at the border")


def test_places_on_the_scan_are_where_the_ray_meets_it(surveyed, module):
    from mathutils import Vector

    bridge = module("addon.bridge.points")
    bpy.context.view_layer.update()
    hit = bridge.point_on_scan(bpy.context, Vector((3, 1, 1)), Vector((-1, 0, 0)))
    np.testing.assert_allclose(hit, (0, 1, 1), atol=1e-5)
    assert bridge.point_on_scan(bpy.context, Vector((3, 1, 1)), Vector((1, 0, 0))) is None


def test_markers_that_are_no_points_are_told(surveyed):
    assert bpy.ops.fresco.find_markers(kind="apriltag-36h11") == {"FINISHED"}
    assert "None of the 0 markers" in bpy.context.window_manager.fresco_job.error
