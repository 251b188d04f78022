"""The command line in a process of its own: exit codes, one clear line, complete files."""

import os
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest

PROJECT = """
fresco = 1
[scan]
path = "scan.ply"
[[camera]]
K = [[520.0, 0.0, 236.5], [0.0, 520.0, 163.0], [0.0, 0.0, 1.0]]
distortion = [-0.12, 0.03, 0.001, -0.0005]
[[region]]
name = "red panel"
face_set = "region 1"
[[region]]
name = "green panel"
face_set = "region 2"
[[region]]
name = "blue tile"
face_set = "region 3"
[[photo]]
path = "photos/*.png"
regions = "masks/{photo}/{region}.png"
[output]
folder = "OUTPUT"
"""


@pytest.fixture
def project(folder, tmp_path):
    """Return a function that writes the project file, changed as wanted, and returns it."""

    def write(*changes):
        text = PROJECT.replace("OUTPUT", str(tmp_path / "out put").replace("\\", "/"))
        for old, new in changes:
            assert old in text
            text = text.replace(old, new)
        path = folder / f"project {tmp_path.name}.toml"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def fresco(*words, block_bpy=False, before=None, patch=""):
    """Run the command `fresco`, `before` and the code `patch` in its process first; return how it ended."""
    code = "import sys; sys.argv[0] = 'fresco'\n"
    if block_bpy:
        code += "sys.modules['bpy'] = None\n"
    code += f"from fresco.addon import cli\n{patch}\ncli.main()"
    environment = {**os.environ, "OMP_NUM_THREADS": "1"}
    environment.pop("BLENDER_USER_RESOURCES", None)
    return subprocess.run(
        [sys.executable, "-c", code, *map(str, words)],
        capture_output=True,
        text=True,
        env=environment,
        timeout=240,
        preexec_fn=before,
        check=False,
    )


def test_run_writes_everything(extension, project, tmp_path, room):
    path = project()
    done = fresco("run", path)
    assert done.returncode == 0, done.stderr
    out = tmp_path / "out put"
    for ending in (".blend", ".glb", ".obj", ".mtl", "_report.html", "_provenance.json"):
        assert (out / (path.stem + ending)).stat().st_size > 100, ending
    assert not [p for p in out.iterdir() if ".part" in p.name]
    lines = done.stdout.splitlines()
    assert lines[0].lstrip().startswith("0 %") and lines[-1].startswith("100 %")
    assert sum("overlap error" in line for line in lines) == 3
    assert not [line for line in lines if "Camera from the numbers" in line], "nothing to look at"
    check_blend(out / f"{path.stem}.blend", room)
    assert fresco("run", path).returncode == 0
    assert not list(out.glob("*.blend1")), "the second run leaves no copy of the first"


def check_blend(path, room):
    """Open the .blend that the run left: cameras stand where the photos were taken, the scan is textured."""
    import bpy

    bpy.ops.wm.open_mainfile(filepath=str(path))
    fresco_data = bpy.context.scene.fresco
    assert "Fresco" in fresco_data.scan.data.uv_layers
    for photo, (rotation, translation) in zip(fresco_data.photos, room.POSES, strict=True):
        assert photo.state == "SOLVED"
        np.testing.assert_allclose(
            photo.camera.matrix_world.translation, -rotation.T @ translation, atol=0.02
        )
        assert photo.path.endswith(f"{photo.name}.png")


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (('path = "scan.ply"', 'path = "gone.ply"'), "scan.path"),
        (('path = "photos/*.png"', 'path = "photos/*.jpg"'), "photo"),
        (('face_set = "region 3"', 'face_set = "region 9"'), "region"),
        (("fresco = 1", "fresco = 7"), "fresco"),
        (("[output]", "[outputs]"), "outputs"),
        (('name = "blue tile"', 'name = "blue tyle"'), "photo.regions"),
    ],
)
def test_a_wrong_entry_is_one_line_and_exit_code_2(extension, project, tmp_path, change, key):
    path = project(change)
    done = fresco("run", path)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert str(path) in done.stderr and key in done.stderr
    out = tmp_path / "out put"
    assert not out.exists() or not list(out.iterdir()), "nothing half-written"


@pytest.mark.parametrize("words", [(), ("dance",), ("run",), ("run", "/nowhere/x.toml")])
def test_wrong_arguments_end_with_2(words):
    done = fresco(*words)
    assert done.returncode == 2
    assert "Traceback" not in done.stderr and done.stderr


def test_version_is_that_of_the_manifest():
    done = fresco("--version")
    manifest = tomllib.loads(
        (Path(__file__).parents[2] / "blender_manifest.toml").read_text(encoding="utf-8")
    )
    assert (done.returncode, done.stdout.strip()) == (0, f"fresco {manifest['version']}")


def test_help_ends_well():
    done = fresco("run", "--help")
    assert done.returncode == 0
    assert "project" in done.stdout


def test_without_blender_the_sentence_says_what_to_install(project):
    done = fresco("run", project(), block_bpy=True)
    assert done.returncode == 1
    assert "pip install bpy" in done.stderr and "Traceback" not in done.stderr


def test_photos_that_find_no_place_end_with_1(project, tmp_path):
    swapped = [
        ('face_set = "region 1"', 'face_set = "region X"'),
        ('face_set = "region 2"', 'face_set = "region 1"'),
    ]
    done = fresco("run", project(*swapped, ("region X", "region 2"), ("photos/*.png", "photos/wall 1.png")))
    assert done.returncode in (0, 1)
    if done.returncode == 1:
        assert "wall 1" in done.stderr and "Traceback" not in done.stderr
        assert not list((tmp_path / "out put").glob("*.obj"))


def test_an_output_folder_that_cannot_be_made_ends_with_1(project, tmp_path):
    (tmp_path / "out put").parent.mkdir(exist_ok=True)
    path = project((str(tmp_path / "out put"), "/proc/nowhere"))
    done = fresco("run", path)
    assert done.returncode == 1
    assert len(done.stderr.strip().splitlines()) == 1, done.stderr
    assert "/proc/nowhere" in done.stderr


def test_a_defect_is_told_as_one_and_ends_with_1(extension, project):
    done = fresco("run", project(), patch="cli.run_project_job = lambda *given: 1 / 0")
    assert done.returncode == 1, done.stderr  # a negative one is a signal
    *_, error, sentence = done.stderr.strip().splitlines()
    assert error == "ZeroDivisionError: division by zero"
    assert sentence.startswith("fresco: This is a defect of Fresco, not of your project: please report it")


@pytest.mark.skipif(sys.platform == "win32", reason="limits the size of files as only POSIX can")
def test_a_disk_that_takes_no_more_leaves_nothing_half_written(project, tmp_path):
    import resource

    limit = 50_000  # bytes per file
    done = fresco("run", project(), before=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    assert done.returncode == 1
    assert "cannot be written" in done.stderr.splitlines()[0]
    assert len(done.stderr.splitlines()) == 1, done.stderr
    written = [path for path in (tmp_path / "out put").rglob("*") if path.is_file()]
    assert not [path.name for path in written if ".part" in path.name or path.stat().st_size >= limit]


def test_blenders_own_command_takes_the_same_arguments(extension, module, project, capsys):
    assert module("addon.cli").blender_command(["run", "/nowhere/x.toml"]) == 2
    assert "no such project file" in capsys.readouterr().err


def test_cameras_go_into_a_project_and_out_of_it(extension, project, tmp_path, folder):
    path = project()
    done = fresco("cameras", "export", path, tmp_path / "sparse", block_bpy=True)
    assert done.returncode == 1 and "run the project first" in done.stderr
    assert fresco("run", path).returncode == 0
    done = fresco("cameras", "export", path, tmp_path / "sparse", block_bpy=True)
    assert done.returncode == 0, done.stderr
    assert "3 cameras written" in done.stdout and (tmp_path / "sparse" / "images.txt").exists()
    before = path.read_text(encoding="utf-8")
    done = fresco("cameras", "import", path, tmp_path / "nothing", block_bpy=True)
    assert done.returncode == 2 and f"{path}: cameras.import: there is no file or folder" in done.stderr
    assert path.read_text(encoding="utf-8") == before
    done = fresco("cameras", "import", path, tmp_path / "sparse", block_bpy=True)
    assert done.returncode == 0, done.stderr
    assert "3 of 3 photos take their cameras from" in done.stdout
    assert path.read_text(encoding="utf-8").startswith(before.rstrip())
    done = fresco("cameras", "import", path, tmp_path / "sparse", block_bpy=True)
    assert done.returncode == 2 and "is there already" in done.stderr
    done = fresco("run", path)
    assert done.returncode == 0 and done.stdout.count("pose given") == 3


def test_a_repeated_run_leaves_its_files_alone(extension, project, tmp_path):
    import json

    path = project(("[output]", "[output]\nreport = false"))
    assert fresco("run", path).returncode == 0
    out = tmp_path / "out put"
    record = json.loads((out / f"{path.stem}_provenance.json").read_text(encoding="utf-8"))
    assert record["versions"]["blender"].startswith(("4.", "5."))
    files = [out / (path.stem + ending) for ending in (".blend", ".glb", ".obj")]
    before = [file.stat().st_mtime_ns for file in files]
    done = fresco("run", path)
    assert done.returncode == 0, done.stderr
    assert [file.stat().st_mtime_ns for file in files] == before
    files[1].unlink()
    assert fresco("run", path).returncode == 0
    assert files[1].exists() and files[0].stat().st_mtime_ns > before[0]
