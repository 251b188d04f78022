"""The built extension in the window of a real Blender, driven by mouse and keyboard.

Environment variables say which Blender: FRESCO_GUI_RUN is a program that is called as

    FRESCO_GUI_RUN --zip EXTENSION.zip --out FOLDER --timeout S --size WxH --bind FOLDER SCRIPT.py -- WORDS

It installs the extension into a fresh profile, runs the script's `steps(ui)` inside Blender's window, and
ends with 0 when all went well and no callback printed a traceback. FRESCO_EXTENSION_ZIP is the built
extension; without it, the extension is built from the tree, once for all tests.
"""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

HERE = Path(__file__).parent
ROOT = HERE.parents[1]
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
def drive(blender):
    """Return a function that runs drive_NAME.py in Blender's window; it gives the names of its pictures."""
    runner, archive = blender

    def run(name, bound, *arguments):
        pictures = ROOT / "artefacts" / name
        command = [runner, "--zip", archive, "--out", pictures, "--timeout", 1500, "--size", "1600x1300"]
        for path in bound:
            command += ["--bind", path]
        command += [HERE / f"drive_{name}.py", "--", *arguments]
        done = subprocess.run(list(map(str, command)), capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout[-3000:] + done.stderr[-2000:]
        return {path.name for path in pictures.glob("*.png")}

    return run


@pytest.fixture
def folder(tmp_path, room):
    """Return a folder with the small scene."""
    from fresco.core.cameras import PerspectiveCamera

    path = tmp_path / "Kápolna 1"
    room.write_all(path, PerspectiveCamera(*room.SIZE, room.K, room.DISTORTION))
    return path
