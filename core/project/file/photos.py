"""Photos of a project file: entries may name one file or a pattern, later ones add to earlier ones."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from ...arrays import FloatArray
from ...cameras import Camera
from ...cameras.exchange import PosedCamera
from ...errors import CameraError, FrescoError, ScanError
from ...photos.exif import read_exif
from ...photos.image import SUFFIXES, image_size
from ...photos.intrinsics import camera_from_exif
from ...photos.photo import Photo
from ..entries import PhotoEntry, Use
from ..imported import ImportedCameras, match_photos
from ..stages.point_poses import read_picks
from .cameras import CameraEntry, check_one_size
from .importing import read_imported
from .marks import check_mask_size, read_marks
from .table import Table, hint

T = TypeVar("T")

_USES: tuple[Use, ...] = ("texture", "pose", "none")
_KEYS = (
    "path", "camera", "regions", "mask", "use", "pose", "refine", "layer", "priority", "points", "telephoto",
)  # fmt: skip
_LARGEST_PRIORITY = 20.0
"""Octaves of texel size beyond which a photo wins or loses everywhere anyway."""
_NOT_IN_NAMES = '/\\:*?"<>|'


@dataclass
class _Draft:
    """A photo while the entries that name it are put together: for every key the table that gave it last."""

    path: Path
    name: str
    sources: dict[str, Table]


def read_photos(project: Table) -> tuple[tuple[PhotoEntry, ...], ImportedCameras | None]:
    """Read all [[photo]] and [[camera]] tables, and the cameras that [cameras] imports.

    Files and sizes are checked, pixels are not read. Raises ProjectError.
    """
    cameras = _cameras(project)
    drafts = _drafts(project)
    if not drafts:
        project.fail("photo", "is missing; name the photos with [[photo]] path = …")
    sizes = {draft.path: _told(draft, image_size, draft.path) for draft in drafts}
    imported = read_imported(project.table("cameras"), [draft.path for draft in drafts])
    posed = match_photos(imported.reconstruction, [d.path for d in drafts]) if imported else {}
    by_path = {drafts[number].path: camera for number, camera in posed.items()}
    _check_sizes([draft for draft in drafts if draft.path not in by_path], cameras, sizes)
    found = [(d, _entry(d, cameras, sizes[d.path], by_path.get(d.path))) for d in drafts]
    entries = [(draft, entry) for draft, entry in found if entry is not None]
    if not entries:
        project.fail("photo", 'all photos have use = "none"; leave at least one in, with use = "texture"')
    _check_marks_found(entries)
    return tuple(entry for _, entry in entries), imported


def _check_marks_found(entries: Sequence[tuple[_Draft, PhotoEntry]]) -> None:
    """Refuse a pattern of marks that fits no photo at all: it is misspelt."""
    marked: dict[int, tuple[Table, bool]] = {}
    for draft, entry in entries:
        table = draft.sources.get("regions")
        if table is not None:
            _, before = marked.get(id(table), (table, False))
            marked[id(table)] = table, before or bool(entry.photo.regions)
    for table, found in marked.values():
        if not found and isinstance(pattern := table.get("regions"), str):
            what = "mask" if "{region}" in pattern else "file of polygons"
            table.fail("regions", f"no photo has a {what} there: {pattern}")


def _cameras(project: Table) -> dict[str, CameraEntry]:
    cameras: dict[str, CameraEntry] = {}
    for table in project.tables("camera"):
        entry = CameraEntry.from_table(table)
        if entry.name in cameras:
            table.fail("name", f"“{entry.name}” is there twice" if entry.name else "is missing")
        cameras[entry.name] = entry
    return cameras


def _drafts(project: Table) -> list[_Draft]:
    drafts: dict[Path, _Draft] = {}
    for table in project.tables("photo"):
        table.offer(_KEYS)
        table.finish()
        for path in _files(table):
            draft = drafts.setdefault(path, _Draft(path, path.stem, {}))
            draft.sources.update({key: table for key in _KEYS if key in table})
    _make_names_unique(list(drafts.values()), project.file.parent)
    return list(drafts.values())


def _files(table: Table) -> list[Path]:
    """Files of an entry; a pattern (*, ?, **) takes photos only."""
    name = table.text("path")
    if not any(sign in name for sign in "*?["):
        return [table.path("path")]
    folder, pattern = table.file.parent, name
    if Path(name).is_absolute():
        folder = Path(Path(name).anchor)
        pattern = str(Path(name).relative_to(folder))
    # Path.glob does not go up through “..”: the fixed beginning of the pattern is resolved first.
    parts = Path(pattern).parts
    fixed = next(number for number, part in enumerate(parts) if any(sign in part for sign in "*?["))
    found = (folder.joinpath(*parts[:fixed])).glob(str(Path(*parts[fixed:])))
    photos = sorted(path for path in found if path.suffix.lower() in SUFFIXES)
    if not photos:
        table.fail("path", f"no photo matches {name}")
    return photos


def _make_names_unique(drafts: list[_Draft], folder: Path) -> None:
    """Photos of the same name in several folders keep their folder in the name."""
    names = [draft.name for draft in drafts]
    for draft in drafts:
        if names.count(draft.path.stem) > 1:
            inside = draft.path.is_relative_to(folder)
            draft.name = (draft.path.relative_to(folder) if inside else draft.path).as_posix().strip("/")
            draft.name = draft.name.replace("/", "_")


def _camera_of(draft: _Draft, cameras: Mapping[str, CameraEntry]) -> CameraEntry | None:
    """Return the camera a photo names, else the one without name, else the only one; None is EXIF."""
    table = draft.sources.get("camera")
    if table is not None:
        name = table.text("camera")
        if name not in cameras:
            table.fail("camera", f"there is no [[camera]] named “{name}”{hint(name, filter(None, cameras))}")
        return cameras[name]
    return cameras.get("") or (next(iter(cameras.values())) if len(cameras) == 1 else None)


def _check_sizes(
    drafts: list[_Draft], cameras: Mapping[str, CameraEntry], sizes: Mapping[Path, tuple[int, int]]
) -> None:
    by_camera: dict[str, dict[tuple[int, int], Path]] = {}
    for draft in drafts:
        entry = _camera_of(draft, cameras)
        if entry is not None:
            by_camera.setdefault(entry.name, {}).setdefault(sizes[draft.path], draft.path)
    for name, found in by_camera.items():
        check_one_size(cameras[name], found)


def _entry(
    draft: _Draft,
    cameras: Mapping[str, CameraEntry],
    size: tuple[int, int],
    posed: PosedCamera | None,
) -> PhotoEntry | None:
    sources = draft.sources
    use: Any = sources["use"].choice("use", _USES, "texture") if "use" in sources else "texture"
    if use == "none":
        return None
    pose = _pose(sources["pose"].table("pose")) if "pose" in sources else None
    # a pose that was given is right unless its photo says that it may be moved
    refine = sources["refine"].flag("refine", True) if "refine" in sources else pose is None
    elsewhere = (posed.rotation, posed.translation) if posed is not None and pose is None else None
    photo, layer, priority = _photo(draft, cameras, size, posed), _layer(draft), 0.0
    if "priority" in sources:
        priority = sources["priority"].number("priority", -_LARGEST_PRIORITY, _LARGEST_PRIORITY)
    telephoto = sources["telephoto"].flag("telephoto", False) if "telephoto" in sources else False
    return PhotoEntry(photo, use, pose, refine, elsewhere, layer, priority, _picks(draft), telephoto)


def _picks(draft: _Draft) -> dict[str, tuple[float, float]]:
    """Picked points of a photo: a table { name = [u, v] }, or a file of name, u, v; a photo may have none."""
    table = draft.sources.get("points")
    if table is None:
        return {}
    value = table.get("points")
    if isinstance(value, dict):
        of_photo = table.table("points")
        pairs = {name: of_photo.numbers(name, [2]) for name in of_photo.values}
        return {name: (pair[0], pair[1]) for name, pair in pairs.items()}
    pattern = table.text("points")
    path = table.resolve(pattern.replace("{photo}", draft.path.stem))
    if not path.is_file():
        return {} if "{photo}" in pattern else read_picks(table.existing("points", pattern))
    try:
        return read_picks(path)
    except (ScanError, UnicodeDecodeError) as error:
        table.fail("points", str(error))


def _layer(draft: _Draft) -> str:
    """Name of the set that a photo belongs to; it becomes part of file names."""
    table = draft.sources.get("layer")
    if table is None:
        return ""
    name = table.text("layer")
    if any(sign in name for sign in _NOT_IN_NAMES):
        table.fail("layer", f"“{name}” cannot be part of a file name on every system")
    return name


def _photo(
    draft: _Draft, cameras: Mapping[str, CameraEntry], size: tuple[int, int], posed: PosedCamera | None
) -> Photo:
    exif = read_exif(draft.path)
    # a camera that the photo names wins over the imported one
    entry = _camera_of(draft, cameras) if posed is None or "camera" in draft.sources else None
    camera: Camera
    nominal = entry is None or entry.is_nominal
    if entry is None and posed is not None:
        camera, source, nominal = posed.camera, "Camera imported from another program.", False
    elif entry is None:
        camera, source = _told(draft, camera_from_exif, exif, *size)
    else:
        camera, source = entry.make(*size, exif)
    if (camera.width, camera.height) != size:
        draft.sources["path"].fail(
            "path",
            f"{draft.path} is {size[0]} x {size[1]} pixels, but its camera is calibrated for "
            f"{camera.width} x {camera.height}; use the original photo or the right calibration",
        )
    notes = tuple(text for text in (exif.orientation_note(*size), source if nominal else "") if text)
    marks = tuple(read_marks(draft.sources.get("regions"), draft.path.stem, size))
    return Photo(draft.path, draft.name, camera, marks, _mask(draft, size), exif, notes, source)


def _told(draft: _Draft, read: Callable[..., T], *arguments: Any) -> T:
    """Return what `read` returns; what it complains about is told with the photo's entry."""
    try:
        return read(*arguments)
    except CameraError as error:
        draft.sources["path"].fail("camera", f"{draft.path.name}: {error}")
    except FrescoError as error:
        draft.sources["path"].fail("path", str(error))


def _mask(draft: _Draft, size: tuple[int, int]) -> Path | None:
    """Mask of the usable part of a photo; a pattern with {photo} need not have a file for every photo."""
    table = draft.sources.get("mask")
    if table is None:
        return None
    pattern = table.text("mask")
    path = table.resolve(pattern.replace("{photo}", draft.path.stem))
    if not path.is_file():
        return None if "{photo}" in pattern else table.existing("mask", pattern)
    check_mask_size(path, table, "mask", size)
    return path


def _pose(table: Table) -> tuple[FloatArray, FloatArray]:
    """Return a given pose: rotation (3,3) world to camera, and translation or centre (3,), metres."""
    rotation = np.array(table.matrix("rotation", 3, 3))
    if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4) or np.linalg.det(rotation) < 0:
        table.fail("rotation", "is no rotation matrix: its rows have to be perpendicular unit vectors")
    if ("translation" in table) == ("centre" in table):
        table.fail("translation", "give either translation or centre")
    if "centre" in table:
        translation: FloatArray = -rotation @ np.array(table.numbers("centre", [3]))
    else:
        translation = np.array(table.numbers("translation", [3]))
    table.finish()
    return rotation, translation
