"""Reading a project file (TOML): everything is checked before anything is computed or written."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any, cast, get_args

import numpy as np

from ...arrays import FloatArray
from ...errors import ProjectError
from ...scans.read import READERS
from ...settings import (
    AtlasSettings,
    EdgeSettings,
    JointSettings,
    PointSettings,
    PoseSettings,
    ScanSettings,
    TextureSettings,
)
from ...texture.colour.correction import Method
from ..entries import OutputEntry, Project, ScanEntry
from ..stages.colour_chart import ColourChartEntry
from ..stages.delivery import DeliverySettings
from ..stages.exported import FORMATS
from ..stages.point_poses import MARKERS, PointsEntry
from ..stages.refinement import RefineSettings
from ..stages.simplified import SimplifySettings
from .photos import read_photos
from .regions import read_regions
from .settings import read_settings
from .table import Table, described, hint

VERSION = 1
"""Version of the file format that this code reads (`fresco = 1`)."""

_UNITS = {"m": 1.0, "dm": 0.1, "cm": 0.01, "mm": 0.001, "ft": 0.3048, "in": 0.0254}


def load_project(path: Path | str) -> Project:
    """Read and check a project file.

    All paths in it are relative to its folder. Files have to exist and sizes to agree; pixels and vertices
    are not read. Raises ProjectError with file, key and reason for the first thing that is wrong.
    """
    path = Path(path)
    root = Table(path, _parse(path))
    version = root.get("fresco")
    if version != VERSION:
        other = isinstance(version, int) and version > VERSION
        advice = (
            "; a newer Fresco wrote this one" if other else f": write fresco = {VERSION} on the first line"
        )
        root.fail("fresco", f"has to be {VERSION}, the version of the file format{advice}")
    pose = root.table("pose")
    photos, cameras = read_photos(root)
    project = Project(
        path=path,
        scan=_scan(root.table("scan", required=True)),
        regions=read_regions(root),
        photos=photos,
        up=_up(pose),
        pose=_settings(pose, PoseSettings),
        refine=_refine(root.table("refine")),
        texture=_settings(root.table("texture"), TextureSettings),
        output=_output(root.table("output"), path),
        cameras=cameras,
        atlas=_atlas(root),
        points=_points(root, any(entry.picks for entry in photos)),
        simplify=_simplify(root),
        charts=_charts(root),
    )
    _check_charts(root, project)
    _check_anchor(root, project)
    root.finish()
    return project


def _parse(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8-sig"))  # editors on Windows add a byte order mark
    except FileNotFoundError:
        raise ProjectError(path, "", "there is no such project file") from None
    except OSError as error:
        raise ProjectError(path, "", f"cannot be read ({error.strerror or error})") from error
    except UnicodeDecodeError as error:
        raise ProjectError(path, "", f"is not UTF-8 text ({error.reason})") from error
    except tomllib.TOMLDecodeError as error:
        windows = "'\\'" in str(error) or "hex value" in str(error)  # C:\data, or C:\users
        advice = "; write paths with / instead of \\" if windows else ""
        raise ProjectError(path, "", f"is not TOML: {error}{advice}") from error


def _up(table: Table) -> FloatArray | None:
    """Direction (3,) that points up in upright photos, None when it is not told."""
    if "up" not in table:
        return None
    up = np.array(table.numbers("up", [3]))
    if not up.any():
        table.fail("up", "has no direction; give where up is in the scan's axes, such as [0, 0, 1]")
    return up


def _refine(table: Table) -> RefineSettings:
    """Which refinements run: `edges`, `joint` are true, false, or a table of settings."""
    edges, joint = _optional(table, "edges", EdgeSettings), _optional(table, "joint", JointSettings)
    chosen = RefineSettings(edges, joint, table.flag("lenses", False))
    if chosen.lenses and joint is None:
        table.fail("lenses", "are adjusted by what the photos show in common; write joint = true as well")
    table.finish()
    return chosen


def _points(root: Table, picked: bool) -> PointsEntry | None:
    """Surveyed points, None without them; picked ones need their table."""
    if "points" not in root:
        if picked:
            root.fail("points", "is missing; name the table of surveyed points: [points] path = …")
        return None
    table = root.table("points")
    path, reach = table.path("path"), table.number("reach", 1, 10_000, 40)
    markers = table.choice("markers", MARKERS, MARKERS[0]) if "markers" in table else ""
    return PointsEntry(path, markers, reach, _settings(table, PointSettings))


def _atlas(root: Table) -> DeliverySettings | None:
    """What to bake, None when no atlas is asked for."""
    if "atlas" not in root:
        return None
    table = root.table("atlas")
    level, untouched = table.flag("level", True), table.flag("untouched", False)
    return DeliverySettings(_settings(table, AtlasSettings), level, untouched)


def _simplify(root: Table) -> SimplifySettings | None:
    """How far to simplify, None when no simplified model is asked for."""
    if "simplify" not in root:
        return None
    table = root.table("simplify")
    if ("faces" in table) == ("tolerance_mm" in table):
        table.fail("faces", "give either faces, how many are left, or tolerance_mm, how far they may deviate")
    faces = int(table.number("faces", 4)) if "faces" in table else None
    tolerance = table.number("tolerance_mm", 0.001) / 1000 if "tolerance_mm" in table else None
    table.finish()
    return SimplifySettings(faces, tolerance)


def _charts(root: Table) -> tuple[ColourChartEntry, ...]:
    """Colour charts: [colour_chart], or a [[colour_chart]] for each layer."""
    key = "colour_chart"
    tables = root.tables(key) if isinstance(root.get(key), list) else [root.table(key)] if key in root else []
    return tuple(_chart(table) for table in tables)


def _chart(table: Table) -> ColourChartEntry:
    corners = None
    if "corners" in table:
        rows = table.matrix("corners", 4, 2)
        corners = tuple((u, v) for u, v in rows)
    layer, method = table.text("layer", ""), table.choice("method", get_args(Method), "matrix")
    entry = ColourChartEntry(table.path("photo"), layer, corners, cast("Method", method))
    table.finish()
    return entry


def _check_charts(root: Table, project: Project) -> None:
    """Refuse charts that nothing would use."""
    layers = [chart.layer for chart in project.charts]
    for layer in layers:
        known = {entry.layer for entry in project.photos}
        if layer not in known or layers.count(layer) > 1:
            reason = (
                "has two charts" if layer in known else f"is of no photo{hint(layer, filter(None, known))}"
            )
            root.fail("colour_chart.layer", f"“{layer}” {reason}")
    baked = project.atlas is not None or project.simplify is not None or project.output.colours
    if layers and not baked:
        root.fail(
            "colour_chart",
            "changes no original photo, only what is baked from them: ask for [atlas], [simplify], or "
            "colours in [output]",
        )
    if layers and project.atlas is not None and project.atlas.untouched:
        root.fail("colour_chart", "contradicts untouched = true in [atlas]; leave one of them out")


def _check_anchor(root: Table, project: Project) -> None:
    """Refuse an anchor of the gains that is no photo."""
    anchor, last = project.texture.gain_anchor, len(project.photos) - 1
    if anchor is not None and anchor > last:
        reason = f"is {anchor}, but the photos are numbered from 0 to {last}, in the order of the project"
        root.fail("texture.gain_anchor", reason)


def _optional(table: Table, key: str, kind: type[Any]) -> Any:
    """Settings of a stage that is off unless its key is true or a table."""
    value = table.get(key, False)
    if isinstance(value, dict):
        return _settings(table.table(key), kind)
    if not isinstance(value, bool):
        table.fail(key, f"has to be true, false, or a table of settings, not {described(value)}")
    return kind() if value else None


def _scan(table: Table) -> ScanEntry:
    path = table.path("path")
    if path.suffix.lower() not in READERS:
        known = ", ".join(sorted(READERS))
        table.fail("path", f"unknown scan format “{path.suffix}”; known are {known}")
    if isinstance(unit := table.get("unit"), str):
        if unit not in _UNITS:
            table.fail("unit", f"has to be one of {', '.join(_UNITS)}, or metres as a number, not “{unit}”")
        table = Table(table.file, {**table.values, "unit": _UNITS[unit]}, table.key)
    table.offer(("path",))
    occluders = table.paths("occluders")
    return ScanEntry(path, _settings(table, ScanSettings), occluders)


def _settings(table: Table, kind: type[Any]) -> Any:
    settings = read_settings(table, kind)
    table.finish()
    return settings


def _output(table: Table, path: Path) -> OutputEntry:
    folder = table.resolve(table.text("folder", "output"))
    if folder.exists() and not folder.is_dir():
        table.fail("folder", f"{folder} is a file, not a folder")
    name = table.text("name", path.stem)
    if any(sign in name for sign in '/\\:*?"<>|'):
        table.fail("name", f"“{name}” cannot be part of a file name on every system")
    wanted = {key: table.flag(key, True) for key in ("blend", "glb", "obj", "report")}
    formats = table.words("cameras", FORMATS)
    wanted["colours"] = table.flag("colours", False)
    table.finish()
    return OutputEntry(folder, name, **wanted, cameras=formats)
