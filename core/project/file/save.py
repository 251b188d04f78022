"""Writing a project file, with the masks, cameras and regions that stand in no file yet."""

from __future__ import annotations

import dataclasses
import json
import os
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...arrays import BoolArray, FloatArray, IntArray
from ...cameras import Camera
from ...cameras.files import camera_to_dict, write_camera_json
from ...files import replacing
from ...geometry.outlines import pieces_of
from ...jobs import Job, Progress
from ...photos.marks import RegionMark, Shape, polygons_to_geojson
from ...photos.photo import Photo
from ...pose.points.survey import Survey
from ...regions.files import write_mask
from ...regions.image_region import ImageRegion
from ...regions.photo.outline import mask_polygons
from ...regions.surface.files import FaceRegion, write_face_regions
from ...scans.ply import write_ply
from ...settings import ScanSettings
from ..entries import OutputEntry, PhotoEntry, Project, RegionEntries, ScanEntry
from ..stages.delivery import DeliverySettings
from ..stages.simplified import SimplifySettings
from .load import VERSION
from .marks import HIDDEN

_BARE = re.compile(r"[A-Za-z0-9_-]+")
_NOT_IN_NAMES = re.compile(r'[/\\:*?"<>|]')
_Table = Mapping[str, Any]


@dataclass(frozen=True, eq=False)
class Unsaved:
    """What belongs to a project and is in no file yet; places in the scan's true coordinates, metres.

    Regions by the faces that they are `kept` by, or by the `points` (V,) of a cloud; surveyed points; meshes
    that hide the scan, by name.
    """

    kept: Sequence[FaceRegion] = ()
    points: Mapping[str, BoolArray] = field(default_factory=dict)
    survey: Survey | None = None
    occluders: Mapping[str, tuple[FloatArray, IntArray]] = field(default_factory=dict)


def save_project_job(project: Project, unsaved: Unsaved | None = None) -> Job[None]:
    """Write a project to `project.path`, so that `load_project` reads the same again.

    What is in no file goes into the folder NAME_files beside it: cameras, masks that were painted, and what
    is `unsaved`. Raises OutputError.
    """
    unsaved = unsaved or Unsaved()
    folder = project.path.with_name(f"{project.path.stem}_files")
    cameras = _Cameras(folder)
    photos = []
    for number, entry in enumerate(project.photos):
        yield Progress(number / len(project.photos), f"Writing the masks of {entry.photo.name}")
        photos.append(_photo(entry, cameras, folder))
    scan = _scan(project.scan, unsaved.occluders, folder)
    tables = [("", {"fresco": VERSION}), ("[scan]", scan), *_regions(project.regions, unsaved, folder)]
    tables += [("[[camera]]", table) for table in cameras.tables]
    tables += [("[[photo]]", table) for table in photos]
    tables += [
        *_points(project, unsaved.survey, folder),
        *_stages(project),
        ("[output]", _output(project.output)),
    ]
    text = "\n".join(_table_text(head, table, project.path.parent) for head, table in tables)
    with replacing(project.path) as file:
        file.write(text.encode())


class _Cameras:
    """Cameras of photos, each written once."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.tables: list[_Table] = []
        self._names: dict[str, str] = {}

    def name(self, camera: Camera) -> str:
        """Name of the [[camera]] that a photo was taken with."""
        key = json.dumps(camera_to_dict(camera))
        if key not in self._names:
            name = f"camera {len(self._names) + 1}"
            path = self.folder / "cameras" / f"{name}.json"
            write_camera_json(path, camera)
            self._names[key] = name
            self.tables.append({"name": name, "file": path})
        return self._names[key]


def _scan(scan: ScanEntry, unsaved: Mapping[str, tuple[FloatArray, IntArray]], folder: Path) -> _Table:
    table = {"path": scan.path, **_settings(scan.settings)}
    occluders = list(scan.occluders)
    for name, (vertices, faces) in unsaved.items():
        path = folder / "occluders" / f"{_file_name(name)}.ply"
        write_ply(path, _in_unit(vertices, scan.settings), faces)
        occluders.append(path)
    return table | {"occluders": occluders} if occluders else table


def _in_unit(vertices: FloatArray, settings: ScanSettings) -> FloatArray:
    """Metres with z up as the files of the scan have them: occluders are read with its settings."""
    x, y, z = vertices.T
    turned = np.stack([x, z, -y], axis=1) if settings.up == "y" else vertices
    return turned / settings.unit


def _photo(entry: PhotoEntry, cameras: _Cameras, folder: Path) -> _Table:
    photo = entry.photo
    table: dict[str, Any] = {"path": photo.path, "use": entry.use}
    if entry.use == "none":
        return table
    table["camera"] = cameras.name(photo.camera)
    if photo.regions:
        table["regions"] = _marks(photo, folder)
    if photo.mask is not None:
        table["mask"] = photo.mask
    if entry.pose is not None:
        table["pose"] = {"rotation": entry.pose[0].tolist(), "translation": entry.pose[1].tolist()}
    if entry.refine != (entry.pose is None):
        table["refine"] = entry.refine
    if entry.picks:
        table["points"] = {name: list(pixel) for name, pixel in entry.picks.items()}
    optional = {"layer": entry.layer, "priority": entry.priority, "telephoto": entry.telephoto}
    return table | {key: value for key, value in optional.items() if value}


def _marks(photo: Photo, folder: Path) -> Path | dict[str, Path]:
    """File of a photo's polygons, or its masks by name where some marks are masks or hidden in part.

    Marks that are in no file yet are written as polygons in any case, for other programs; masks are exact.
    """
    size = photo.camera.width, photo.camera.height
    shapes = {mark.name: _shape(mark, size) for mark in photo.regions if mark.path is None}
    path = folder / "polygons" / f"{_file_name(photo.name)}.geojson"
    if shapes:
        with replacing(path) as file:
            file.write(json.dumps(polygons_to_geojson(shapes, size), ensure_ascii=False, indent=1).encode())
    if all(mark.outline is not None and mark.hidden is None for mark in photo.regions):
        return path
    return _masks(photo, folder / "masks" / _file_name(photo.name))


def _shape(mark: RegionMark, size: tuple[int, int]) -> Shape:
    """A mark as polygons; those of a mask run along its pixels, to 0.7 of one."""
    hidden = mark.read_hidden(*size)
    before = [] if hidden is None else mask_polygons(hidden)
    if mark.outline is not None:
        return [[mark.outline, *mark.holes]], before
    return pieces_of(mask_polygons(_pixels(mark, size))), before


def _masks(photo: Photo, folder: Path) -> dict[str, Path]:
    """Masks of a photo by name; those that are in no file are written."""
    masks: dict[str, Path] = {}
    size = photo.camera.width, photo.camera.height
    for mark in photo.regions:
        masks[mark.name] = mark.path or folder / f"{_file_name(mark.name)}.png"
        if mark.path is None:
            write_mask(masks[mark.name], _pixels(mark, size))
        hidden = mark.read_hidden(*size)
        if hidden is not None:
            path = mark.hidden_path or folder / f"{_file_name(mark.name)}{HIDDEN}.png"
            masks[mark.name + HIDDEN] = path
            if mark.hidden_path is None:
                write_mask(path, hidden)
    return masks


def _pixels(mark: RegionMark, size: tuple[int, int]) -> Any:
    mask = mark.read_mask(*size)
    if mask is None and mark.outline is not None:
        mask = ImageRegion.from_polygon(mark.outline, mark.holes, mark.name).to_mask(*size)
    return mask


def _file_name(name: str) -> str:
    """Name that can be a file's on every system."""
    return _NOT_IN_NAMES.sub("_", name)


def _regions(regions: RegionEntries, unsaved: Unsaved, folder: Path) -> Iterable[tuple[str, _Table]]:
    many: dict[str, Any] = {"face_sets": regions.all_face_sets}
    path = folder / "regions.npz" if unsaved.kept else regions.kept
    if unsaved.kept and path is not None:
        write_face_regions(path, unsaved.kept)
    if path is not None:
        many["kept"] = path
    if regions.unplaced:
        many["unplaced"] = regions.unplaced
    yield "[regions]", many
    for source in regions.labels:
        key = {"key": source.key} if source.key else {}
        for number, name in source.names.items():
            yield "[[region]]", {"name": name, "labels": source.path, "id": number, **key}
        if not source.names:
            yield "[[region]]", {"name": source.name, "faces": source.path, **key}
    yield from _point_regions(unsaved.points, folder / "points.npz")
    for name, face_set in regions.face_sets.items():
        yield "[[region]]", {"name": name, "face_set": face_set}
    for name, corners in regions.outlines.items():
        yield "[[region]]", {"name": name, "outline": corners.tolist()}


def _point_regions(points: Mapping[str, BoolArray], path: Path) -> Iterable[tuple[str, _Table]]:
    """Write which points of a cloud (V,) belong to each region; -> a table for each."""
    keys = [f"region_{number}" for number in range(len(points))]
    if points:
        with replacing(path) as file:
            inside = [chosen.astype(np.uint8) for chosen in points.values()]
            np.savez_compressed(file, **dict(zip(keys, inside, strict=True)))
    for key, name in zip(keys, points, strict=True):
        yield "[[region]]", {"name": name, "labels": path, "id": 1, "key": key}


def _points(project: Project, survey: Survey | None, folder: Path) -> Iterable[tuple[str, _Table]]:
    points = project.points
    if points is None:
        return
    path = points.path
    if survey is not None:
        path = folder / "points.csv"
        rows = zip(survey.names, survey.points, strict=True)
        lines = [";".join([name, *(repr(float(value)) for value in place)]) for name, place in rows]
        with replacing(path) as file:
            file.write("\n".join(["name;x;y;z", *lines, ""]).encode())
    markers = {"markers": points.markers} if points.markers else {}
    yield "[points]", {"path": path, "reach": points.reach, **markers, **_settings(points.settings)}


def _stages(project: Project) -> Iterable[tuple[str, _Table]]:
    """Tables of the stages' settings: only what differs from the default."""
    up = {} if project.up is None else {"up": project.up.tolist()}
    yield "[pose]", {**up, **_settings(project.pose)}
    steps = {"edges": project.refine.edges, "joint": project.refine.joint}
    lenses = {"lenses": True} if project.refine.lenses else {}
    chosen = {name: _settings(step) or True for name, step in steps.items() if step is not None}
    yield "[refine]", chosen | lenses
    yield "[texture]", _settings(project.texture)
    if project.atlas is not None:
        yield "[atlas]", _atlas(project.atlas)
    if project.simplify is not None:
        yield "[simplify]", _simplify(project.simplify)
    for chart in project.charts:
        yield "[[colour_chart]]", _settings(chart) | {"photo": chart.photo}


def _atlas(delivery: DeliverySettings) -> _Table:
    return {"level": delivery.level, "untouched": delivery.untouched, **_settings(delivery.atlas)}


def _simplify(simplify: SimplifySettings) -> _Table:
    if simplify.tolerance is not None:
        return {"tolerance_mm": simplify.tolerance * 1000}
    return {"faces": simplify.faces}


def _output(output: OutputEntry) -> _Table:
    table = {field.name: getattr(output, field.name) for field in dataclasses.fields(output)}
    return {key: value for key, value in table.items() if value != ()}


def _settings(settings: Any) -> dict[str, Any]:
    """Fields of a settings dataclass that differ from their default."""
    values = {field.name: getattr(settings, field.name) for field in dataclasses.fields(settings)}
    defaults = {field.name: field.default for field in dataclasses.fields(settings)}
    return {key: value for key, value in values.items() if value is not None and value != defaults[key]}


def _table_text(head: str, table: _Table, folder: Path) -> str:
    lines = [head] if head else []
    lines += [f"{_key(key)} = {_value(value, folder)}" for key, value in table.items()]
    return "\n".join([*lines, ""])


def _key(key: str) -> str:
    return key if _BARE.fullmatch(key) else json.dumps(key, ensure_ascii=False)


def _value(value: Any, folder: Path) -> str:
    """TOML of a value; paths are relative to the project's folder where they can be."""
    if isinstance(value, Path):
        return json.dumps(_relative(value, folder), ensure_ascii=False)
    if isinstance(value, Mapping):
        inside = ", ".join(f"{_key(key)} = {_value(each, folder)}" for key, each in value.items())
        return f"{{ {inside} }}"
    if isinstance(value, str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, Sequence):
        return f"[{', '.join(_value(each, folder) for each in value)}]"
    if isinstance(value, (bool, np.bool_)):
        return "true" if value else "false"
    return repr(int(value)) if isinstance(value, (int, np.integer)) else repr(float(value))


def _relative(path: Path, folder: Path) -> str:
    try:
        return Path(os.path.relpath(path, folder)).as_posix()
    except ValueError:  # another drive
        return path.absolute().as_posix()
