"""The rules of the house: what may import what, and that lists kept by hand are complete."""

import ast
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
ROOMS = ["scans", "photos", "regions", "pose", "homography", "texture", "project", "report"]
SHARED = {"geometry", "cameras", "jobs", "errors", "files", "settings", "arrays"}
CORE_FILES = sorted((ROOT / "core").rglob("*.py"))


def imported_modules(path):
    """Absolute dotted names, from `core` on, that a module of core imports relatively; others as they are."""
    package = ("core", *path.relative_to(ROOT / "core").parts[:-1])
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level == 0:
                yield node.module
                continue
            base = package[: len(package) - node.level + 1]
            module = ".".join((*base, *(node.module.split(".") if node.module else ())))
            yield from (f"{module}.{alias.name}" for alias in node.names) if not node.module else (module,)


@pytest.mark.parametrize("path", CORE_FILES, ids=lambda p: str(p.relative_to(ROOT)))
def test_core_never_imports_blender_or_rooms_to_the_right(path):
    parts = path.relative_to(ROOT / "core").parts
    room = parts[0] if len(parts) > 1 else None
    for module in imported_modules(path):
        top = module.split(".")[0]
        assert top not in {"bpy", "mathutils", "bmesh", "gpu", "addon", "fresco"}, module
        if top != "core" or room is None:
            continue
        target = module.split(".")[1] if "." in module else ""
        if target in SHARED or target == room:
            continue
        assert room not in SHARED, f"{room} builds on {target}: a shared room may not"
        assert ROOMS.index(target) < ROOMS.index(room), f"{room} may not import {target}"


def test_core_imports_without_blender():
    """A fresh interpreter in which bpy cannot be imported loads every module of core."""
    modules = [
        "fresco." + ".".join(p.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")
        for p in CORE_FILES
    ]
    code = f"import sys; sys.modules['bpy'] = None\nfor m in {modules!r}: __import__(m)"
    environment = {"PATH": "", "PYTHONDONTWRITEBYTECODE": "1"}  # no DISPLAY
    result = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, env=environment, check=False
    )
    assert result.returncode == 0, result.stderr


def test_every_package_is_listed():
    listed = set(tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["setuptools"]["packages"])
    found = {"fresco"} | {
        "fresco." + ".".join(p.parent.relative_to(ROOT).parts)
        for room in ("core", "addon")
        for p in (ROOT / room).rglob("__init__.py")
    }
    assert listed == found


def test_extension_ships_a_wheel_for_every_dependency_platform_and_python():
    dependencies = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    wheels = tomllib.loads((ROOT / "blender_manifest.toml").read_text())["wheels"]
    names = [re.split(r"[<>=~;\[ ]", d)[0].lower().replace("-", "_") for d in dependencies]
    for name in set(names) - {"numpy"}:
        tags = [
            w.removesuffix(".whl").split("-", 2)[2]
            for w in wheels
            if Path(w).name.lower().startswith(name + "-")
        ]
        for platform in ("manylinux", "macosx", "win_amd64"):
            for python in ("cp311", "cp313"):
                assert any(
                    "none-any" in tag or (platform in tag and ("abi3" in tag or python in tag))
                    for tag in tags
                ), f"no wheel of {name} for {platform} {python}"


def test_versions_agree():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text())
    assert project["version"] == manifest["version"]


def test_modules_that_the_pages_name_exist():
    """The table of rooms in docs/developing.md: a row without a room goes on with the one above."""
    room = None
    for line in (ROOT / "docs" / "developing.md").read_text().splitlines():
        cells = [cell.strip() for cell in line.split("|")]
        if len(cells) != 5 or not re.fullmatch(r"`(core|addon)(/\w+)*`|", cells[1]):
            continue
        room = cells[1].strip("`") or room
        for name in re.findall(r"`(\w+)`", cells[3]):
            assert (ROOT / room / f"{name}.py").is_file(), f"{room} has no module {name}"
    assert room == "addon", "the table was read to its end"
