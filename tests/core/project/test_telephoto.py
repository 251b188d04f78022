"""Telephoto shots in a project: placed by the wide ones."""

import numpy as np
from fresco.core.geometry.rigid import exp_so3, log_so3, rotation_angle
from fresco.core.pose.pose import Pose
from fresco.core.project import load_project, run_project
from fresco.core.project.stages.telephoto import inherited_covariance


def edit(path, old, new):
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new, 1), encoding="utf-8")


def test_a_shot_without_regions_is_placed_by_the_others(corner):
    path, truth = corner(speckled=True)
    for mask in (path.parent / "masks" / "B").iterdir():
        mask.unlink()
    assert not run_project(load_project(path)).poses[1].solved
    edit(path, "[output]", '[[photo]]\npath = "photos/B.png"\ntelephoto = true\n[output]')
    result = run_project(load_project(path))
    found = result.poses[1]
    assert found.solved and "features that it shares with 2 other photos" in found.notes[0]
    rotation, translation = truth["B"]
    assert np.degrees(rotation_angle(found.pose.rotation @ rotation.T)) < 0.5
    assert np.linalg.norm(found.pose.centre + rotation.T @ translation) < 0.05
    assert found.sure_pose is not None
    least = min(result.poses[n].pose.centre_sigma for n in (0, 2))
    assert found.pose.centre_sigma > least / 2, "no surer than the photos that it was found by"


def test_it_inherits_the_uncertainty_of_the_photos_it_stands_on():
    rng = np.random.default_rng(3)
    spread = rng.normal(0, 1e-5, (6, 6))
    other = Pose(exp_so3(rng.normal(size=3)), rng.normal(0, 3, 3), spread @ spread.T)
    pose = Pose(exp_so3(rng.normal(size=3)), rng.normal(0, 3, 3), np.zeros((6, 6)))
    between = pose.rotation @ other.rotation.T, pose.rotation @ (other.centre - pose.centre)
    moved = []
    for change in spread.T:  # the other photo a little elsewhere, and this one with it
        rotation, centre = exp_so3(change[:3]) @ other.rotation, other.centre + change[3:]
        turned = between[0] @ rotation
        at = centre - turned.T @ between[1]
        moved.append(np.concatenate([log_so3(turned @ pose.rotation.T), at - pose.centre]))
    expected = np.array(moved).T @ np.array(moved)
    np.testing.assert_allclose(inherited_covariance(pose, [other]), expected, atol=1e-3 * expected.max())
    given = Pose(other.rotation, other.translation, np.full((6, 6), np.nan))
    np.testing.assert_allclose(
        inherited_covariance(pose, [other, given]) * 2, expected, atol=1e-3 * expected.max()
    )


def test_one_that_shares_nothing_says_why(corner):
    import cv2

    path, _ = corner(speckled=True)
    rng = np.random.default_rng(0)
    noise = rng.integers(0, 255, (360, 480, 3), dtype=np.uint8)
    (path.parent / "photos" / "B.png").write_bytes(cv2.imencode(".png", noise)[1].tobytes())
    for mask in (path.parent / "masks" / "B").iterdir():
        mask.unlink()
    edit(path, "[output]", '[[photo]]\npath = "photos/B.png"\ntelephoto = true\n[output]')
    failed = run_project(load_project(path)).poses[1]
    assert not failed.solved and failed.failure
    assert "Mark a region" not in failed.failure
