"""Build the Blender extension: `build_extension.py build [PLATFORM ...]` makes dist/fresco-*.zip.

`build_extension.py lock` asks the package index which wheels serve the dependencies in pyproject.toml on
every platform and Python that Blender has, and writes their names into blender_manifest.toml; that list is
then the lock: `build` fetches exactly those files into wheels/.
"""

from __future__ import annotations

import argparse
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
WHEELS = ROOT / "wheels"
MANIFEST = ROOT / "blender_manifest.toml"
PACKAGE = ["__init__.py", "addon", "core", "presets", "LICENSE", "README.md"]
PYTHONS = ["3.11", "3.13"]  # Blender 4.2 to 5.0, and 5.1 on
PLATFORM_TAGS = {
    "linux-x64": [
        "manylinux_2_28_x86_64",
        "manylinux_2_27_x86_64",
        "manylinux_2_17_x86_64",
        "manylinux2014_x86_64",
    ],
    "macos-arm64": [f"macosx_{v}" for v in ("11_0_arm64", "12_0_arm64", "13_0_arm64", "14_0_arm64")],
    "windows-x64": ["win_amd64"],
}
SHIPPED_WITH_BLENDER = {"numpy"}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("command", choices=["lock", "build"])
    parser.add_argument("platforms", nargs="*", help="default: all of " + ", ".join(PLATFORM_TAGS))
    arguments = parser.parse_args()
    if arguments.command == "lock":
        lock()
        return
    for platform in arguments.platforms or list(PLATFORM_TAGS):
        print(build(platform))


def lock() -> None:
    """Write the wheels that the dependencies need today into the manifest."""
    WHEELS.mkdir(exist_ok=True)
    names: set[str] = set()
    for requirement in shipped_requirements():
        for platform, python in ((p, v) for p in PLATFORM_TAGS for v in PYTHONS):
            names.add(download(requirement, platform, python))
    lines = "".join(f'  "./wheels/{name}",\n' for name in sorted(names, key=str.lower))
    text = re.sub(r"(?ms)^wheels = \[.*?^\]\n", f"wheels = [\n{lines}]\n", MANIFEST.read_text())
    MANIFEST.write_text(text)


def shipped_requirements() -> list[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    return [
        r
        for r in project["dependencies"]
        if re.split(r"[<>=~;\[ ]", r)[0].lower() not in SHIPPED_WITH_BLENDER
    ]


def download(requirement: str, platform: str, python: str) -> str:
    """Fetch one wheel into wheels/ and return its file name."""
    tags = [word for tag in PLATFORM_TAGS[platform] for word in ("--platform", tag)]
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pip", "download", "-q", "--no-deps", "--only-binary=:all:"]
        subprocess.run([*command, "--python-version", python, *tags, "-d", folder, requirement], check=True)
        (wheel,) = Path(folder).iterdir()
        shutil.move(wheel, WHEELS / wheel.name)
    return wheel.name


def build(platform: str) -> Path:
    """Stage the package with the platform's wheels, validate and build it; return the zip."""
    with tempfile.TemporaryDirectory() as folder:
        stage = Path(folder)
        copy_tracked_files(stage)
        wheels = [name for name in locked_wheels() if fits(name, platform)]
        (stage / "wheels").mkdir()
        for name in wheels:
            shutil.copy(fetched(name, platform), stage / "wheels")
        (stage / MANIFEST.name).write_text(platform_manifest(platform, wheels))
        blender_ext("validate", str(stage))
        version = tomllib.loads(MANIFEST.read_text())["version"]
        target = ROOT / "dist" / f"fresco-{version}-{platform}.zip"
        target.parent.mkdir(exist_ok=True)
        blender_ext("build", "--source-dir", str(stage), "--output-filepath", str(target))
    return target


def copy_tracked_files(stage: Path) -> None:
    listing = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard", *PACKAGE],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    for name in filter(None, listing.stdout.split("\0")):
        target = stage / name
        target.parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, target)


def locked_wheels() -> list[str]:
    return [Path(path).name for path in tomllib.loads(MANIFEST.read_text())["wheels"]]


def fits(wheel: str, platform: str) -> bool:
    tag = wheel.removesuffix(".whl").rsplit("-", 1)[1]
    marks = {"linux-x64": "linux", "macos-arm64": "macosx", "windows-x64": "win_amd64"}
    return tag == "any" or marks[platform] in tag


def fetched(wheel: str, platform: str) -> Path:
    """Path of a locked wheel in wheels/, downloaded if it is not there."""
    path = WHEELS / wheel
    if not path.exists():
        WHEELS.mkdir(exist_ok=True)
        name, version, python = wheel.split("-")[:3]
        exact = {"cp311": "3.11"}.get(python, "3.13")
        if download(f"{name}=={version}", platform, exact) != wheel:
            sys.exit(f"the package index no longer has {wheel}; run: build_extension.py lock")
    return path


def platform_manifest(platform: str, wheels: list[str]) -> str:
    lines = "".join(f'  "./wheels/{name}",\n' for name in wheels)
    text = re.sub(r"(?ms)^wheels = \[.*?^\]\n", lambda _: f"wheels = [\n{lines}]\n", MANIFEST.read_text())
    return re.sub(r"(?m)^platforms = .*$", f'platforms = ["{platform}"]', text)


def blender_ext(*words: str) -> None:
    """Run Blender's own extension builder, as the `bpy` wheel brings it."""
    import importlib.util

    spec = importlib.util.find_spec("bpy")
    if spec is None or not spec.submodule_search_locations:
        sys.exit("Blender's module bpy is not installed here; run: make setup")
    (script,) = Path(spec.submodule_search_locations[0]).glob(
        "*/scripts/addons_core/bl_pkg/cli/blender_ext.py"
    )
    result = subprocess.run(
        [sys.executable, "-I", str(script), *words], capture_output=True, text=True, check=False
    )
    if result.returncode:
        sys.exit(f"blender_ext {words[0]}: {result.stdout}{result.stderr}")


if __name__ == "__main__":
    main()
