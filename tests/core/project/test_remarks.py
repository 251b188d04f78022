from dataclasses import replace

import numpy as np
from fresco.core.pose.regions.region_pose import RegionPose
from fresco.core.project import PhotoPose, load_project, remarks, run_project
from fresco.core.project.remarks import weakness
from fresco.core.regions.surface_region import SurfaceRegion


def square(name, x):
    """A square of 1 m around (x, 0, 10)."""
    corners = np.array([[x - 0.5, -0.5, 10], [x + 0.5, -0.5, 10], [x + 0.5, 0.5, 10], [x - 0.5, 0.5, 10]])
    return SurfaceRegion(corners, np.array([[0, 1, 2], [0, 2, 3]]), name)


SURFACES = {"door": square("door", -2.0), "niche": square("niche", 2.0)}


def posed(sigma, regions=("door", "niche"), **more):
    """Return a photo at the origin whose centre is known to `sigma` (m) along each axis."""
    covariance = np.diag([1e-6] * 3 + [sigma**2] * 3)
    return PhotoPose("A", RegionPose(np.eye(3), np.zeros(3), covariance), regions=regions, **more)


def test_a_loose_centre_is_weak():
    assert weakness(posed(0.1), SURFACES) == (
        "Its 2 regions leave the pose weakly determined: the camera is known to ± 173 mm, 1.7 % of its "
        "distance. Add a region, best on another wall."
    )
    assert weakness(posed(0.1, ("door",)), SURFACES).startswith("Its one region leaves the pose weakly")


def test_sure_given_and_failed_poses_are_not_called_weak():
    assert weakness(posed(0.05), SURFACES) == ""  # ± 87 mm at 10 m
    assert weakness(posed(0.1, given=True), SURFACES) == ""
    assert weakness(posed(0.1, failure="The regions do not decide."), SURFACES) == ""


def test_remarks_of_a_run(corner):
    path, _ = corner((5_012_300.0, 423_400.0, 0.0))
    result = run_project(load_project(path))
    first, second, third = result.poses
    loose = replace(second.pose, covariance=np.diag([1e-6] * 3 + [1.0] * 3))
    told = remarks(
        replace(
            result,
            poses=[
                replace(first, notes=("Cut.",)),
                replace(second, pose=loose),
                replace(third, notes=("Cut.",)),
            ],
        )
    )
    assert told[0] == "scan: Large coordinates: moved by an offset of 5012300, 423400, 0 m."
    assert "A, C: Cut." in told
    assert not [line for line in told if "Camera from the numbers" in line]  # nothing to look at
    (weak,) = [line for line in told if "weakly determined" in line]
    assert weak.startswith("B: Its 3 regions leave")


def test_the_texture_tells_which_photos_it_left_out(corner):
    path, _ = corner()
    result = run_project(load_project(path))
    selection = replace(result.textured.selection, left_out=np.array([False, True, False]))
    told = remarks(replace(result, textured=replace(result.textured, selection=selection)))
    assert told[-1].startswith("B: ") and "it was left out." in told[-1]
