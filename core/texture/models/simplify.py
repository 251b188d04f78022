"""A model with fewer faces for delivery; its texture keeps the detail, for it is baked from the photos anew.

Edges are collapsed where the surface is flattest. The photos are then chosen for the simplified mesh
(`select_views`) and baked through the detailed one (`bake_atlas(..., detail=...)`): nothing is resampled
twice, and relief that is gone from the mesh still decides which pixel a texel shows.
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor, wait
from dataclasses import dataclass

import fast_simplification
import numpy as np

from ...arrays import ArrayLike, FloatArray, IntArray
from ...errors import TextureError
from ...geometry.meshes import face_normals
from ...geometry.rays import local_centre
from ...jobs import Job, Progress, drain
from ..surface import checked_mesh
from .deviation import Deviation, surface_deviation

_FEWEST = 4
_ROUNDS = 10
_AGGRESSIVENESS = (3.0, 5.0, 7.0)
"""How the library collapses (0 to 10): the gentlest is truest, but may stop before the count is reached."""
_REACHED = 1.05


@dataclass(frozen=True, eq=False)
class SimplifiedMesh:
    """A mesh of fewer faces, (V,3) m and (F,3), and how far it lies from the one it was made from."""

    vertices: FloatArray
    faces: IntArray
    deviation: Deviation


def simplify_mesh(
    vertices: ArrayLike, faces: ArrayLike, face_count: int | None = None, tolerance: float | None = None
) -> SimplifiedMesh:
    """Run `simplify_mesh_job` to its end."""
    return drain(simplify_mesh_job(vertices, faces, face_count, tolerance))


def simplify_mesh_job(
    vertices: ArrayLike, faces: ArrayLike, face_count: int | None = None, tolerance: float | None = None
) -> Job[SimplifiedMesh]:
    """Simplify a mesh (V,3) m, (F,3) to `face_count` faces, or to the fewest that stay within `tolerance` m.

    The tolerance is held by 95 % of the surface (two-sided); the largest distance is in the result. Open
    borders stay as they are: a scan's holes neither grow nor close. Raises TextureError for a mesh or a wish
    that cannot be met.
    Source: Garland and Heckbert 1997 (quadric error metric).
    """
    points, triangles = checked_mesh(vertices, faces)
    if (face_count is None) == (tolerance is None):
        raise TextureError("Say either how many faces the simplified model has, or how far it may deviate.")
    origin = local_centre(points)
    points = points - origin
    if face_count is not None:
        wanted = _checked_count(face_count, len(triangles))
        yield Progress(0.0, f"Simplifying to {wanted} faces")
        found = yield from _collapse_job(points, triangles, wanted)
        yield Progress(0.7, "Measuring the simplified mesh")
        deviation = surface_deviation((points, triangles), found)
    else:
        found, deviation = yield from _within_job(points, triangles, float(tolerance or 0.0))
    return SimplifiedMesh(found[0] + origin, found[1], deviation)


def _within_job(
    points: FloatArray, faces: IntArray, tolerance: float
) -> Job[tuple[tuple[FloatArray, IntArray], Deviation]]:
    """Fewest faces, to a few per cent, whose deviation holds the tolerance: bisection of the count."""
    if not 0 < tolerance < np.inf:
        raise TextureError("The simplified model's tolerance must be a length in metres greater than 0.")
    low, high = np.log(_FEWEST), np.log(len(faces))
    best = (points, faces), Deviation(0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    for number in range(_ROUNDS):
        if high - low < 0.05:
            break
        middle = 0.5 * (low + high)
        wanted = round(float(np.exp(middle)))
        yield Progress(number / _ROUNDS, f"Trying {wanted} faces")
        found = yield from _collapse_job(points, faces, wanted)
        deviation = surface_deviation((points, faces), found, 20_000) if len(found[1]) else None
        if deviation is not None and deviation.percentile_95 <= tolerance:
            best, high = (found, deviation), middle
        else:
            low = middle
    yield Progress(0.9, "Measuring the simplified mesh")
    return best[0], surface_deviation((points, faces), best[0])


def _collapse_job(points: FloatArray, faces: IntArray, count: int) -> Job[tuple[FloatArray, IntArray]]:
    """Collapse edges until about `count` faces are left; those without area are dropped."""
    with ThreadPoolExecutor(1) as pool:  # one call of the library, some seconds for millions of faces
        for aggressiveness in _AGGRESSIVENESS:
            call = pool.submit(_collapse, points, faces, count, aggressiveness)
            while not call.done():
                yield Progress(0.1, f"Simplifying to {count} faces")
                wait([call], timeout=0.05)
            vertices, triangles = call.result()
            if len(triangles) <= _REACHED * count:
                break
    if len(triangles) == 0:
        return np.zeros((0, 3)), np.zeros((0, 3), dtype=np.int32)
    solid = triangles[face_normals(vertices, triangles)[1] > 0]
    used, index = np.unique(solid, return_inverse=True)
    return vertices[used], index.reshape(-1, 3).astype(np.int32)


def _collapse(
    points: FloatArray, faces: IntArray, count: int, aggressiveness: float
) -> tuple[FloatArray, IntArray]:
    vertices, triangles = fast_simplification.simplify(
        points, faces, target_count=count, agg=aggressiveness, preserve_border=True
    )
    return np.asarray(vertices, dtype=np.float64), np.asarray(triangles, dtype=np.int32)


def _checked_count(wanted: int, count: int) -> int:
    if not _FEWEST <= wanted < count:
        raise TextureError(
            f"The mesh has {count} faces: ask for fewer than that and at least {_FEWEST}, not {wanted}."
        )
    return int(wanted)
