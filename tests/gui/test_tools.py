"""The marking tools in the window of a real Blender; see test_window.py for the environment variables."""

import importlib.util
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


def test_regions_by_mouse(blender, folder):
    """Wand, lasso, brush, polygon in the photo; wand, brush, lasso on the scan; undo; a click beside."""
    done = window.drive(blender, "drive_tools.py", window.ARTEFACTS / "tools", [folder], folder)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    pictures = {path.name for path in (window.ARTEFACTS / "tools").glob("*.png")}
    assert {"1 photo wand.png", "6 surface wand.png", "8 surface lasso.png"} <= pictures
