"""Charts of an atlas, packed onto square pages: connected faces of one photo as that photo shows them.

The photo is already a flat picture of its faces without folds, so a chart needs no unwrapping and its pixels
are resampled as little as possible. Charts that do not depend on photos are made in `unwrapping`.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from ...arrays import Float32Array, FloatArray, IndexArray, IntArray
from ...errors import TextureError
from ...geometry.meshes import edge_pairs
from ..selection import Selection

_BATCH = 0.9
"""Share of a page's area that charts packed together take."""


@dataclass(frozen=True, eq=False)
class ChartLayout:
    """Where every face lies in the atlas.

    `page` (F,) and `uv` (F,3,2) pixels of that page, the centre of its top-left pixel at (0, 0); `pages`
    counts them, each `size` pixels square. Faces that no photo sees share a spot of page 0.
    """

    page: IntArray
    uv: FloatArray
    pages: int
    size: int


def photo_charts(
    faces: IntArray, vertex_count: int, selection: Selection, texel_size: float, size: int, padding: int
) -> ChartLayout:
    """Lay out connected faces of each photo, scaled so that a pixel covers `texel_size` m in the median.

    With 0 they keep the photo's own pixels, whose centres then lie on those of texels. Large charts are cut
    along a grid, which fills the pages better than their ragged outlines; the colours on both sides of such a
    cut come from the same pixels. Raises TextureError.
    """
    chart = _connected(faces, vertex_count, selection.view)
    uv = selection.uv
    if texel_size > 0:
        uv = uv * _chart_scale(chart, selection.texel_size, texel_size)[chart][:, None, None]
    return pack_charts(chart, uv, selection.view, size, padding)


def pack_charts(
    chart: IndexArray, uv: FloatArray, view: IntArray, size: int, padding: int, unseen_lie: bool = False
) -> ChartLayout:
    """Place charts (F,), laid out in pixels `uv` (F,3,2), on pages; larger ones are cut along a grid.

    Charts of the same photo `view` (F,) come together. Faces without a photo share one spot, unless
    `unseen_lie` gives them the room of their chart. Raises TextureError.
    """
    chart = _cut_large(chart, uv, max(size // 8, 32))
    low = np.full((chart.max() + 1, 2), np.inf)
    high = np.full((chart.max() + 1, 2), -np.inf)
    for axis in range(2):
        np.minimum.at(low[:, axis], chart, uv[..., axis].min(axis=1))
        np.maximum.at(high[:, axis], chart, uv[..., axis].max(axis=1))
    spot = (view < 0) & (not unseen_lie)
    alone = np.bincount(chart, spot, len(low)) > 0
    low[alone], high[alone] = 0, 0
    low = np.floor(low)  # whole pixels of the photo: where charts are not scaled, texels are its pixels
    box = np.ceil(high - low).astype(np.int64) + 2 + 2 * padding
    if box.max() > size:
        raise TextureError(
            f"One face needs {int(box.max())} pixels of the atlas, a page has {size}: "
            "ask for larger pages or a coarser texel size."
        )
    view_of_chart = np.full(len(low), -1)
    view_of_chart[chart] = view
    page, corner, pages = pack_shelves(box, view_of_chart, size)
    placed = uv - low[chart][:, None] + (corner[chart] + padding + 1.0)[:, None]
    placed[spot] = corner[chart[spot], None] + padding + 0.5
    return ChartLayout(page[chart].astype(np.int32), placed, pages, size)


def pack_shelves(box: IndexArray, group: IndexArray, size: int) -> tuple[IndexArray, IndexArray, int]:
    """Pack boxes (C,2) of width and height onto pages: -> page (C,), corner (C,2), number of pages.

    Boxes stand on shelves in order of height. Groups that fill about a page are packed together, so that a
    page needs few of them.
    """
    page = np.zeros(len(box), dtype=np.int64)
    corner = np.zeros((len(box), 2), dtype=np.int64)
    x = y = shelf = current = 0
    by_group = np.argsort(group, kind="stable")
    batch = np.empty(len(box), dtype=np.int64)
    batch[by_group] = np.cumsum(box[by_group].prod(axis=1)) // int(_BATCH * size * size)
    for chart in np.lexsort((-box[:, 0], -box[:, 1], batch)):
        width, height = box[chart]
        if x + width > size:
            x, y, shelf = 0, y + shelf, 0
        shelf = max(shelf, int(height))
        if y + shelf > size:
            x, y, shelf, current = 0, 0, int(height), current + 1
        page[chart], corner[chart] = current, (x, y)
        x += int(width)
    return page, corner, current + 1


def _connected(faces: IntArray, vertex_count: int, view: IntArray) -> IndexArray:
    """Number of the connected piece of each face among the faces with its photo; unseen faces are one."""
    pairs = edge_pairs(faces, vertex_count).face
    same = (view[pairs[:, 0]] == view[pairs[:, 1]]) & (view[pairs[:, 0]] >= 0)
    ones = np.ones(np.count_nonzero(same), dtype=np.bool_)
    graph = coo_matrix((ones, (pairs[same, 0], pairs[same, 1])), shape=(len(faces), len(faces)))
    piece = connected_components(graph, directed=False)[1].astype(np.int64)
    unseen = np.flatnonzero(view < 0)
    if len(unseen):
        piece[unseen] = piece[unseen[0]]
    number: IndexArray = np.unique(piece, return_inverse=True)[1].astype(np.int64)
    return number


def _chart_scale(chart: IndexArray, texel: Float32Array, wanted: float) -> FloatArray:
    """Atlas pixels per photo pixel of each chart: its median texel size over the wanted one."""
    value = np.nan_to_num(texel.astype(np.float64), nan=wanted)
    order = np.lexsort((value, chart))
    count = np.bincount(chart)
    start = np.cumsum(count) - count
    scale: FloatArray = value[order][start + count // 2] / wanted
    return scale


def _cut_large(chart: IndexArray, uv: FloatArray, piece: int) -> IndexArray:
    """Cut charts along a grid of `piece` pixels; a face belongs to the cell of its centre."""
    cell = np.floor(uv.mean(axis=1) / piece).astype(np.int64)
    cell -= cell.min(axis=0)
    columns = int(cell[:, 0].max()) + 1
    rows = int(cell[:, 1].max()) + 1
    low = np.full((chart.max() + 1, 2), np.inf)
    high = np.full((chart.max() + 1, 2), -np.inf)
    for axis in range(2):
        np.minimum.at(low[:, axis], chart, uv[..., axis].min(axis=1))
        np.maximum.at(high[:, axis], chart, uv[..., axis].max(axis=1))
    large = ((high - low).max(axis=1) > piece)[chart]
    key = chart * (rows * columns) + np.where(large, cell[:, 1] * columns + cell[:, 0], 0)
    number: IndexArray = np.unique(key, return_inverse=True)[1].astype(np.int64)
    return number
