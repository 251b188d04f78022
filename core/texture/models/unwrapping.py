"""Charts that follow the surface instead of the photos: for models that other programs will repaint.

xatlas unwraps some thousand faces at a time, neighbours together, so that a large scan can be cancelled and
needs little memory; charts end where such a piece ends. Every face gets its room, seen or not.
Source: the segmentation is that of xatlas (after Zhou et al. 2004 and Levy et al. 2002, least squares
conformal maps); the packing is `charts.pack_charts`.
"""

from __future__ import annotations

import numpy as np
import xatlas
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ...arrays import FloatArray, IndexArray, IntArray
from ...geometry.meshes import morton_order
from ...geometry.rays import local_centre
from ...jobs import Job, Progress, part
from .charts import ChartLayout, pack_charts

_PIECE = 2000
"""Faces unwrapped in one step, about a tenth of a second."""


def surface_charts_job(
    vertices: FloatArray, faces: IntArray, view: IntArray, texel_size: float, size: int, padding: int
) -> Job[ChartLayout]:
    """Unwrap a mesh (V,3) m, (F,3) onto pages of `size` pixels, a pixel covering `texel_size` m.

    `view` (F,) are the faces' photos: charts of the same photo are packed together. Raises TextureError.
    """
    chart, uv = yield from part(_unwrap_job(vertices - local_centre(vertices), faces, texel_size), 0.0, 0.9)
    yield Progress(0.9, "Packing charts")
    return pack_charts(chart, uv, view, size, padding, unseen_lie=True)


def _unwrap_job(points: FloatArray, faces: IntArray, texel_size: float) -> Job[tuple[IndexArray, FloatArray]]:
    """Chart (F,) and pixels (F,3,2) of every face, piece by piece along a space-filling curve."""
    order = morton_order(points[faces].mean(axis=1))
    chart = np.zeros(len(faces), dtype=np.int64)
    uv = np.zeros((len(faces), 3, 2))
    count = 0
    for start in range(0, len(faces), _PIECE):
        yield Progress(start / len(faces), "Unwrapping the surface")
        chosen = order[start : start + _PIECE]
        own, uv[chosen] = _unwrap(points, faces[chosen], texel_size)
        chart[chosen] = count + own
        count += int(own.max()) + 1
    return chart, uv


def _unwrap(points: FloatArray, faces: IntArray, texel_size: float) -> tuple[IndexArray, FloatArray]:
    """Chart (n,) and pixels (n,3,2) of a piece of the mesh."""
    used, index = np.unique(faces, return_inverse=True)
    corners = points[used].astype(np.float32)
    atlas = xatlas.Atlas()
    atlas.add_mesh(corners - corners.mean(axis=0), index.reshape(-1, 3).astype(np.uint32))
    options = xatlas.PackOptions()
    options.texels_per_unit = 1.0 / texel_size
    options.padding = 1
    atlas.generate(pack_options=options)
    _, triangles, unit = atlas.get_mesh(0)
    flat = unit.astype(np.float64) * (atlas.width, atlas.height)
    start, end = triangles.ravel(), np.roll(triangles, -1, axis=1).ravel()
    links = coo_matrix((np.ones(len(start)), (start, end)), shape=(len(flat), len(flat)))
    piece = connected_components(links, directed=False)[1]
    own = np.unique(piece[triangles[:, 0]], return_inverse=True)[1].astype(np.int64)
    return own, flat[triangles]
