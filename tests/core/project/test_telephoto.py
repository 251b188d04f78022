"""Telephoto shots in a project: placed by the wide ones."""

import numpy as np
from fresco.core.geometry.rigid import rotation_angle
from fresco.core.project import load_project, run_project


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
