"""Cameras that another program has solved, matched with the photos of a project."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path, PurePosixPath
from typing import Literal

from ..arrays import FloatArray
from ..cameras.exchange import PosedCamera, Reconstruction, read_reconstruction
from ..errors import CameraError, FrescoError
from ..photos.image import SUFFIXES, image_size

Placing = Literal["same", "poses", "points", "surface"]
"""How another program's world comes onto the scan: it is the same; by photos that regions place; by points
known in both; by its sparse points on the surface of the scan."""


@dataclass(frozen=True, eq=False)
class ImportedCameras:
    """Cameras of another program: the file or folder, what it holds, and how it comes onto the scan.

    `given` is a similarity (scale, rotation (3,3), translation (3,)) into the world of the scan's file;
    without one `placing` says how it is found. `points` are two tables of surveyed points by name: in the
    other program's world, and in the scan's.
    """

    path: Path
    reconstruction: Reconstruction
    placing: Placing = "same"
    given: tuple[float, FloatArray, FloatArray] | None = None
    points: tuple[Path, Path] | None = None


def read_cameras(path: Path, photos: Sequence[Path]) -> Reconstruction:
    """Read another program's cameras; sizes that its files do not tell are those of `photos`.

    Raises CameraError.
    """

    def size_of(name: str) -> tuple[int, int]:
        found = match_names([name], photos)
        if name not in found:
            raise CameraError(f"{path} does not tell the size of {name}, and there is no photo of that name.")
        return image_size(photos[found[name]])

    try:
        return read_reconstruction(path, size_of)
    except CameraError:
        raise
    except FrescoError as error:
        raise CameraError(f"{path}: {error}") from error


def match_photos(reconstruction: Reconstruction, photos: Sequence[Path]) -> dict[int, PosedCamera]:
    """Cameras by the number of the photo that they belong to."""
    cameras = {camera.name: camera for camera in reconstruction.cameras}
    return {number: cameras[name] for name, number in match_names(list(cameras), photos).items()}


def match_names(names: Sequence[str], photos: Sequence[Path]) -> dict[str, int]:
    """Number of the photo that each name means; names may have a folder, and lack the ending.

    A name that fits several photos means the one that shares more of its folders; where that does not
    decide either, it means none.
    """
    stems: dict[str, list[int]] = {}
    for number, photo in enumerate(photos):
        stems.setdefault(photo.stem.lower(), []).append(number)
    found: dict[str, int] = {}
    for name in names:
        parts = PurePosixPath(name.replace("\\", "/")).parts
        best = _best(parts, photos, stems)
        if best is not None and best not in found.values():
            found[name] = best
    return found


def _best(parts: tuple[str, ...], photos: Sequence[Path], stems: Mapping[str, list[int]]) -> int | None:
    last = PurePosixPath(parts[-1]) if parts else PurePosixPath("")
    known = last.suffix.lower() in SUFFIXES
    candidates = stems.get((last.stem if known else last.name).lower(), [])
    shared = [_shared(parts, photos[number], known) for number in candidates]
    if not shared or shared.count(max(shared)) > 1:
        return None
    return candidates[shared.index(max(shared))]


def _shared(parts: tuple[str, ...], photo: Path, with_suffix: bool) -> int:
    """How many parts of a name, counted from its end, are those of a photo's path."""
    own = photo.parts if with_suffix else (*photo.parent.parts, photo.stem)
    count = 0
    for one, other in zip(reversed(parts), reversed(own), strict=False):
        if one.lower() != other.lower():
            break
        count += 1
    return count
