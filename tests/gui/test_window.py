"""The steps of the sidebar in the window of a real Blender; conftest.py tells the environment variables."""

import shutil
from pathlib import Path

SAMPLE = Path(__file__).parents[2] / "sample"


def test_refining_is_stopped_compared_and_undone(drive, tmp_path):
    """Refine the sample by its buttons, stop by ESC, look at before and after, at maps; pictures are kept."""
    sample = tmp_path / "sample"
    shutil.copytree(SAMPLE, sample)
    pictures = drive("refine", [sample], sample / "project.toml", Path(__file__).parent)
    assert {"22 edges at 0.png", "22 edges at 1.png", "24 next photos.png"} <= pictures


def test_five_steps_by_their_buttons(drive, folder, tmp_path):
    """Open the tab, press each button in turn, stop each long step by ESC; pictures go to artefacts/."""
    output = tmp_path / "kész"
    output.mkdir()
    pictures = drive("steps", [folder, output], folder, output)
    assert {"1 empty.png", "8 poses.png", "10 texture.png", "11 export.png"} <= pictures
    assert (output / "scan.glb").stat().st_size > 10_000
