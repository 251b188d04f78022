"""Regions of the scan that last: by face numbers while the scan is the same, by geometry when it is not.

A scan that was cleaned, decimated, cropped or imported anew has other face numbers. Every region therefore
keeps the places and normals of its faces, and of a strip of faces around it that do not belong to it.
"""

from __future__ import annotations

import hashlib
import json
import zipfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import AnyArray, ArrayLike, BoolArray, FloatArray, IndexArray, IntArray
from ...errors import RegionError
from ...files import replacing
from ...geometry.meshes import edge_pairs, face_normals
from .face_sets import grown_faces

_STRIP = 3  # rings of faces around a region that are kept
_TURNED = 60.0  # degrees beyond which a face is on another surface
_LEAST = 0.6  # share of a region's area that has to be found again
_VERSION = 1


@dataclass(frozen=True, eq=False)
class FaceRegion:
    """A region of the scan as it is kept.

    `faces` (n,) numbers of the scan whose `fingerprint` it carries; `middle` (m,3) metres and `normal` (m,3)
    of its faces and of the strip around them, `inside` (m,) true for its own; `area` m².
    """

    name: str
    faces: IndexArray
    fingerprint: str
    middle: FloatArray
    normal: FloatArray
    inside: BoolArray
    area: float


def scan_fingerprint(vertices: ArrayLike, faces: ArrayLike) -> str:
    """Fingerprint of a scan: the same triangles in the same order have the same, (V,3) m and (F,3)."""
    digest = hashlib.blake2b(digest_size=16)
    digest.update(np.ascontiguousarray(faces, dtype=np.int32).tobytes())
    digest.update(np.ascontiguousarray(vertices, dtype=np.float64).tobytes())
    return digest.hexdigest()


def kept_regions(
    vertices: ArrayLike, faces: ArrayLike, regions: Sequence[tuple[str, ArrayLike]]
) -> list[FaceRegion]:
    """Regions (name, face numbers (n,)) of a scan (V,3) m, (F,3), with what finds them again.

    Raises
    ------
    RegionError
        A region is empty, or has faces that the scan has not.
    """
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    mark, pair = scan_fingerprint(points, triangles), edge_pairs(triangles, len(points)).face
    return [_kept(points, triangles, name, np.asarray(chosen), mark, pair) for name, chosen in regions]


def _kept(
    points: FloatArray, triangles: IndexArray, name: str, chosen: AnyArray, mark: str, pair: IntArray
) -> FaceRegion:
    numbers: IndexArray = np.unique(chosen).astype(np.int64)
    if len(numbers) == 0 or numbers[0] < 0 or numbers[-1] >= len(triangles):
        raise RegionError(f"Region '{name}' is empty, or has faces that the scan has not: mark it again.")
    inside = np.zeros(len(triangles), dtype=np.bool_)
    inside[numbers] = True
    near = np.flatnonzero(grown_faces(inside, pair, _STRIP))
    normal, area = face_normals(points, triangles[near])
    own = inside[near]
    return FaceRegion(
        name, numbers, mark, points[triangles[near]].mean(axis=1), normal, own, float(area[own].sum())
    )


def found_again(region: FaceRegion, vertices: ArrayLike, faces: ArrayLike) -> IndexArray:
    """Faces (n,) of a region in a scan that may have changed since: (V,3) m, (F,3).

    In the same scan the faces are taken by number. Otherwise a face belongs to the region when the nearest
    of the kept faces of its orientation does, and is no farther away than faces are large.

    Raises
    ------
    RegionError
        Less than 60 % of the region's area is there.
    """
    points, triangles = np.asarray(vertices, dtype=np.float64), np.asarray(faces, dtype=np.int64)
    if scan_fingerprint(points, triangles) == region.fingerprint:
        return region.faces
    low, high = region.middle.min(axis=0), region.middle.max(axis=0)
    margin = 0.1 * float((high - low).max())
    middle = points[triangles].mean(axis=1)
    near = np.flatnonzero(np.all((middle >= low - margin) & (middle <= high + margin), axis=1))
    normal, area = face_normals(points, triangles[near])
    inside = _matching(region, middle[near], normal, np.sqrt(area))
    share = float(area[inside].sum()) / max(region.area, 1e-300)
    if share < _LEAST:
        raise RegionError(
            f"Region '{region.name}' is not in this scan: {100 * share:.0f} % of its area was found again. "
            "Mark it anew, or move the scan to where it was."
        )
    return near[inside]


def _matching(region: FaceRegion, middle: FloatArray, normal: FloatArray, size: FloatArray) -> BoolArray:
    """Which faces lie on a region: middles (n,3) and sizes (n,) in metres, unit normals (n,3)."""
    if len(middle) == 0:
        return np.zeros(0, dtype=np.bool_)
    centre = region.middle.mean(axis=0)
    tree = cKDTree(region.middle - centre)
    away, nearest = (np.asarray(some) for some in tree.query(middle - centre))
    alike = np.einsum("nk,nk->n", normal, region.normal[nearest]) > np.cos(np.radians(_TURNED))
    # Nearest middles of two triangulations of one surface are apart by less than a face's size.
    matching: BoolArray = alike & (away <= size + _grain(tree, region)) & region.inside[nearest]
    return matching


def _grain(tree: cKDTree, region: FaceRegion) -> float:
    """Usual distance (m) of the kept faces' middles."""
    if len(region.middle) < 2:
        return float(np.sqrt(region.area))
    points = np.asarray(tree.data)[:: max(1, len(region.middle) // 500)]
    return float(np.median(np.asarray(tree.query(points, 2)[0])[:, 1]))


def write_face_regions(path: Path | str, regions: Sequence[FaceRegion]) -> None:
    """Write regions of the scan as a numpy archive; the file is replaced only when complete."""
    head = {
        "version": _VERSION,
        "regions": [{"name": r.name, "fingerprint": r.fingerprint, "area": r.area} for r in regions],
    }
    content: dict[str, AnyArray] = {"regions": np.array(json.dumps(head))}
    for number, region in enumerate(regions):
        for field in ("faces", "middle", "normal", "inside"):
            content[f"{field}_{number}"] = getattr(region, field)
    with replacing(path) as file:
        np.savez_compressed(file, **content)


def read_face_regions(path: Path | str) -> list[FaceRegion]:
    """Regions of the scan that `write_face_regions` wrote.

    Raises
    ------
    RegionError
        The file is missing, damaged, or no file of regions.
    """
    try:
        with np.load(path, allow_pickle=False) as content:
            head = json.loads(str(content["regions"]))
            return [_read(content, number, entry) for number, entry in enumerate(head["regions"])]
    except (OSError, ValueError, KeyError, EOFError, TypeError, zipfile.BadZipFile) as error:
        raise RegionError(f"{path}: no regions of a scan can be read from this file ({error})") from error


def _read(content: Mapping[str, AnyArray], number: int, entry: Mapping[str, str]) -> FaceRegion:
    arrays = [content[f"{field}_{number}"] for field in ("faces", "middle", "normal", "inside")]
    faces, middle, normal, inside = arrays
    return FaceRegion(
        entry["name"], faces, entry["fingerprint"], middle, normal, inside, float(entry["area"])
    )
