"""The marking tools in the window of a real Blender; conftest.py tells the environment variables."""

import json

import numpy as np

CORNERS = {
    "P1": (0, 0.5, 0.5), "P2": (0, 1.7, 1.5), "P3": (0.6, 0, 0.7), "P4": (1.6, 0, 1.9), "P6": (1.7, 1.5, 0),
    "P7": (0, 1.7, 0.5),
}  # fmt: skip
"""Corners of the panels, m."""


def test_regions_by_mouse(drive, folder):
    """Wand, lasso, brush, polygon in the photo; wand, brush, lasso on the scan; undo; a click beside."""
    pictures = drive("tools", [folder], folder)
    assert {"1 photo wand.png", "6 surface wand.png", "8 surface lasso.png"} <= pictures


def test_keys_adding_and_mending(drive, folder):
    """Dragging and keys change a click; shift, ctrl, GrabCut, snapping, hidden parts, mending, bad clicks."""
    pictures = drive("marking", [folder], folder)
    assert {"1 wand dragged.png", "4 hidden part.png", "5 shift adds a wall.png"} <= pictures


def test_proposals_partners_and_advice(drive, folder, room):
    """Regions and partners are proposed, accepted and refused; advice follows; marks go to the next photo."""
    rotation, translation = room.POSES[1]
    pose = json.dumps({"rotation": rotation.tolist(), "translation": translation.tolist()})
    pictures = drive("proposals", [folder], folder, pose)
    assert {
        "1 facets proposed.png",
        "3 partners proposed.png",
        "5 carried into the next photo.png",
    } <= pictures


def test_a_cloud_of_points(drive, folder, room):
    """Wand, lasso and brush on points; a click beside; a pose and colours; pictures go to artefacts/."""
    room.write_cloud(folder / "cloud.ply", spacing=0.01)
    pictures = drive("cloud", [folder], folder)
    assert {"1 cloud.png", "2 regions of points.png", "4 coloured points.png"} <= pictures


def test_points_by_mouse_and_a_resized_window(drive, folder, room):
    """Picks snap to corners, residuals name the wrong one, its tick leaves it out; the window is resized."""
    from fresco.core.cameras import PerspectiveCamera

    rows = [f"{name},{x},{y},{z}" for name, (x, y, z) in CORNERS.items()]
    (folder / "control.csv").write_text("\n".join(rows))
    rotation, translation = room.POSES[0]
    camera = PerspectiveCamera(*room.SIZE, room.K, room.DISTORTION)
    pixels = camera.project(np.array(list(CORNERS.values())) @ rotation.T + translation)
    pictures = drive("points", [folder], folder, json.dumps(dict(zip(CORNERS, pixels.tolist(), strict=True))))
    assert {"1 picked.png", "3 residuals.png", "5 window of 1240.png"} <= pictures
