"""The marking tools in the window of a real Blender; see test_window.py for the environment variables."""

import importlib.util
import json
from pathlib import Path

import pytest

_SPEC = importlib.util.spec_from_file_location(
    "fresco_test_window", Path(__file__).with_name("test_window.py")
)
window = importlib.util.module_from_spec(_SPEC)
_SPEC.loader.exec_module(window)
blender, room = window.blender, window.room  # fixtures


@pytest.fixture
def folder(tmp_path, room):
    """Return a folder with the small scene."""
    from fresco.core.cameras import PerspectiveCamera

    room.write_all(tmp_path / "room", PerspectiveCamera(*room.SIZE, room.K, room.DISTORTION))
    return tmp_path / "room"


def drive(blender, folder, name, *arguments):
    """Run drive_NAME.py on the small scene; -> names of its pictures."""
    pictures = window.ARTEFACTS / name
    done = window.drive(blender, f"drive_{name}.py", pictures, [folder], folder, *arguments)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    return {path.name for path in pictures.glob("*.png")}


def test_regions_by_mouse(blender, folder):
    """Wand, lasso, brush, polygon in the photo; wand, brush, lasso on the scan; undo; a click beside."""
    pictures = drive(blender, folder, "tools")
    assert {"1 photo wand.png", "6 surface wand.png", "8 surface lasso.png"} <= pictures


def test_keys_adding_and_mending(blender, folder):
    """Dragging and keys change a click; shift, ctrl, GrabCut, snapping, hidden parts, mending, bad clicks."""
    pictures = drive(blender, folder, "marking")
    assert {"1 wand dragged.png", "4 hidden part.png", "5 shift adds a wall.png"} <= pictures


def test_proposals_partners_and_advice(blender, folder, room):
    """Regions and partners are proposed, accepted and refused; advice follows; marks go to the next photo."""
    rotation, translation = room.POSES[1]
    pose = json.dumps({"rotation": rotation.tolist(), "translation": translation.tolist()})
    pictures = drive(blender, folder, "proposals", pose)
    assert {
        "1 facets proposed.png",
        "3 partners proposed.png",
        "5 carried into the next photo.png",
    } <= pictures
