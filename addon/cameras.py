"""The command line's `fresco cameras`: from and to other programs, without Blender."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Any, get_args

from ..core.errors import ProjectError
from ..core.files import replacing
from ..core.project import Project, load_project
from ..core.project.imported import Placing
from ..core.project.stages.exported import FORMATS, recorded_cameras, write_cameras


def add_parser(commands: Any) -> None:
    """Add the command to those of `fresco`."""
    parser = commands.add_parser("cameras", help="take cameras from, or write them for, other programs")
    ways = parser.add_subparsers(required=True, metavar="WAY")
    take = ways.add_parser("import", help="let a project take its cameras from another program's files")
    take.add_argument("project", help="project file (.toml); a table [cameras] is added at its end")
    take.add_argument("source", help="folder or file of COLMAP, Metashape, RealityScan, Bundler, OpenMVG")
    take.add_argument(
        "--similarity",
        choices=[way for way in get_args(Placing) if way != "points"],
        default="same",
        help="how its world comes onto the scan: it is the same; by photos that regions place; by its points",
    )
    take.set_defaults(act=_act(_import))
    give = ways.add_parser("export", help="write the cameras that a run has solved")
    give.add_argument("project", help="project file (.toml) that was run")
    give.add_argument("target", help="folder (colmap, realityscan-xmp) or file to write")
    give.add_argument("--format", choices=FORMATS, default="colmap", help="the program to write for")
    give.set_defaults(act=_act(_export))


def _act(work: Callable[[argparse.Namespace], None]) -> Callable[..., int]:
    def act(options: argparse.Namespace, _start_blender: Callable[[], None]) -> int:
        from .cli import told

        return told(lambda: work(options))

    return act


def _import(options: argparse.Namespace) -> None:
    """Add [cameras] to a project file, when the project is right with it; tell which photos it serves."""
    path = Path(options.project)
    if load_project(path).cameras is not None:
        raise ProjectError(path, "cameras", "is there already; change it in the file")
    source = Path(options.source).resolve()
    folder = path.resolve().parent
    shown = source.relative_to(folder) if source.is_relative_to(folder) else source
    table = f"\n[cameras]\nimport = '{shown.as_posix()}'\nsimilarity = \"{options.similarity}\"\n"
    text = path.read_text(encoding="utf-8-sig").rstrip() + "\n" + table
    trial = path.with_name(f".{path.name}.part")
    try:
        with replacing(trial) as file:
            file.write(text.encode())
        project = load_project(trial)
    except ProjectError as error:
        raise ProjectError(path, error.key, error.reason) from error
    finally:
        trial.unlink(missing_ok=True)
    with replacing(path) as file:
        file.write(text.encode())
    _tell(project)


def _tell(project: Project) -> None:
    served = [entry.photo.name for entry in project.photos if entry.imported is not None]
    for entry in project.photos:
        state = "camera imported" if entry.imported is not None else "not among them"
        print(f"  {entry.photo.name}: {state}")
    print(f"{len(served)} of {len(project.photos)} photos take their cameras from {project.cameras.path}")


def _export(options: argparse.Namespace) -> None:
    """Write the cameras of the last run."""
    project = load_project(Path(options.project))
    record = project.output.folder / f"{project.output.name}_provenance.json"
    cameras = recorded_cameras(record)
    write_cameras(Path(options.target), cameras, options.format)
    print(f"{len(cameras.cameras)} cameras written to {options.target} ({options.format})")
