"""The built extension in the window of a real Blender, driven by mouse and keyboard.

Environment variables say which Blender: FRESCO_GUI_RUN is a program that is called as

    FRESCO_GUI_RUN --zip EXTENSION.zip --out FOLDER --timeout S --size WxH --bind FOLDER SCRIPT.py -- WORDS

It installs the extension into a fresh profile, runs the script's `steps(ui)` inside Blender's window, and
ends with 0 when all went well and no callback printed a traceback. FRESCO_EXTENSION_ZIP is the built
extension; without it, the extension is built from the tree.
"""

import importlib.util
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
ARTEFACTS = ROOT / "artefacts"
RUNNER = os.environ.get("FRESCO_GUI_RUN", "")


def extension_zip():
    given = os.environ.get("FRESCO_EXTENSION_ZIP", "")
    if given:
        return Path(given)
    command = [sys.executable, ROOT / "tools" / "build_extension.py", "build", "linux-x64"]
    done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    return Path(done.stdout.split()[-1])


@pytest.fixture(scope="session")
def blender():
    """Return the program that drives Blender and the extension's zip."""
    if not RUNNER:
        pytest.skip("FRESCO_GUI_RUN does not name a program that drives Blender's window")
    if not Path(RUNNER).exists():
        pytest.fail(f"FRESCO_GUI_RUN: there is no {RUNNER}")
    archive = extension_zip()
    if not archive.exists():
        pytest.fail(f"FRESCO_EXTENSION_ZIP: there is no {archive}")
    return RUNNER, archive


@pytest.fixture(scope="session")
def room():
    """Return the module that makes the small scene of the add-on's tests."""
    path = HERE.parent / "addon" / "small_scene.py"
    spec = importlib.util.spec_from_file_location("small_scene", path)
    loaded = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(loaded)
    return loaded


@pytest.fixture
def folder(tmp_path, room):
    """Return a folder with the small scene."""
    from fresco.core.cameras import PerspectiveCamera

    path = tmp_path / "Kápolna 1"
    room.write_all(path, PerspectiveCamera(*room.SIZE, room.K, room.DISTORTION))
    return path


def drive(blender, script, out, bound, *arguments):
    runner, archive = blender
    command = [runner, "--zip", archive, "--out", out, "--timeout", 1500, "--size", "1600x1300"]
    for path in bound:
        command += ["--bind", path]
    command += [HERE / script, "--", *arguments]
    return subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)


def test_refining_is_stopped_compared_and_undone(blender, tmp_path):
    """Refine the sample by its buttons, stop by ESC, look at before and after, at maps; pictures are kept."""
    sample = tmp_path / "sample"
    shutil.copytree(ROOT / "sample", sample)
    done = drive(blender, "drive_refine.py", ARTEFACTS / "refine", [sample], sample / "project.toml", HERE)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    pictures = {path.name for path in (ARTEFACTS / "refine").glob("*.png")}
    assert {"22 edges at 0.png", "22 edges at 1.png", "24 next photos.png"} <= pictures


def test_five_steps_by_their_buttons(blender, folder, tmp_path):
    """Open the tab, press each button in turn, stop each long step by ESC; pictures go to artefacts/."""
    output = tmp_path / "kész"
    output.mkdir()
    done = drive(blender, "drive_steps.py", ARTEFACTS / "steps", [folder, output], folder, output)
    assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
    pictures = {path.name for path in (ARTEFACTS / "steps").glob("*.png")}
    assert {"1 empty.png", "8 poses.png", "10 texture.png", "11 export.png"} <= pictures
    assert (output / "scan.glb").stat().st_size > 10_000
