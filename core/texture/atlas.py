"""Baked atlases for delivery: photos resampled once into charts, levelled and blended at the seams."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ..arrays import AnyArray, ArrayLike, BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from ..files import replacing
from ..jobs import Job, Progress, drain, part
from ..photos.view import View
from ..settings import AtlasSettings
from .blending import blend_shares
from .charts import ChartLayout, photo_charts
from .colour_correction import ColourCorrection
from .detail import DetailSurface
from .images import read_deep_photo, sample_image, to_bytes, to_linear, to_srgb, view_name
from .levelling import SeamLevels
from .raster import Texels, rasterise
from .selection import Selection
from .surface import Mesh, checked_mesh
from .unwrapping import surface_charts_job
from .visibility import project

NEUTRAL = 0.2140
"""Linear value of the grey that unseen faces get: 128 of 255 in sRGB."""
_LOW_TEXELS = 16.0
"""Length on the surface, in median texels, over which low frequencies are averaged in every photo."""
_TEXELS = 1 << 20
_REDUCED = 0.7
"""A photo whose pixels are this much smaller than the texels is reduced to these before it is sampled."""


@dataclass(frozen=True, eq=False)
class Atlas:
    """A baked atlas: `layout` says where faces lie, `paths` are the pages in UDIM order, 1001 first."""

    layout: ChartLayout
    paths: tuple[Path, ...]
    texel_size: float

    @property
    def udim(self) -> FloatArray:
        """UV coordinates (F,3,2), v up, one unit square per page, ten pages in a row."""
        unit = (self.layout.uv + 0.5) / self.layout.size
        unit[..., 1] = 1 - unit[..., 1]
        unit[..., 0] += (self.layout.page % 10)[:, None]
        unit[..., 1] += (self.layout.page // 10)[:, None]
        return unit


def bake_atlas(
    folder: Path | str,
    stem: str,
    vertices: ArrayLike,
    faces: ArrayLike,
    selection: Selection,
    views: Sequence[View],
    settings: AtlasSettings | None = None,
    levels: SeamLevels | None = None,
    detail: Mesh | None = None,
    correction: ColourCorrection | None = None,
) -> Atlas:
    """Run `bake_atlas_job` to its end."""
    job = bake_atlas_job(
        folder, stem, vertices, faces, selection, views, settings, levels, detail, correction
    )
    return drain(job)


def bake_atlas_job(
    folder: Path | str,
    stem: str,
    vertices: ArrayLike,
    faces: ArrayLike,
    selection: Selection,
    views: Sequence[View],
    settings: AtlasSettings | None = None,
    levels: SeamLevels | None = None,
    detail: Mesh | None = None,
    correction: ColourCorrection | None = None,
) -> Job[Atlas]:
    """Bake a textured mesh (V,3) m, (F,3) into pages `folder/stem.1001.png`, `.1002.png`, ...

    Where the mesh is a simplified one, `detail` is the mesh it was made from: every texel then takes the
    colour of the place on it, so that relief that is gone from the mesh does not shift the photos.
    `correction`, made for colours after the gains (`ColourCorrection.after_gain`), turns them into true ones.
    One page and one photo are in memory at a time. Pages appear only when all are baked. Raises TextureError,
    PhotoError, OutputError.
    """
    settings = settings or AtlasSettings()
    points, triangles = checked_mesh(vertices, faces)
    texel = settings.texel_size or float(np.nanmedian(selection.texel_size))
    yield Progress(0.0, "Laying out the atlas")
    size, padding = settings.page_size, settings.padding
    if settings.charts == "photos":
        layout = photo_charts(triangles, len(points), selection, texel, size, padding)
    else:
        charts = surface_charts_job(points, triangles, selection.view, texel, size, padding)
        layout = yield from part(charts, 0.0, 0.05)
    yield Progress(0.05, "Finding what to blend")
    mix = _mix(points, triangles, selection, views, settings, levels)
    relief = DetailSurface(points, triangles, detail) if detail is not None else None
    paths = tuple(Path(folder) / f"{stem}.{1001 + page}.png" for page in range(layout.pages))
    with ExitStack() as together:  # the pages get their names when all are there
        for page, path in enumerate(paths):
            file = together.enter_context(replacing(path))
            model = _Model(points, triangles, selection, views, texel, relief, correction)
            baking = _bake_page_job(page, layout, model, mix)
            start, end = (0.1 + 0.9 * (page + k) / layout.pages for k in (0, 1))
            linear = yield from part(baking, start, end, f"Page {page + 1} of {layout.pages}: ")
            file.write(_coded_page(linear, settings.depth))
    return Atlas(layout, paths, texel)


@dataclass(frozen=True, eq=False)
class _Mix:
    """What goes into every face: photo `view` (N,) on `face` (N,), sorted by face.

    `low` and `high` (N,3) are its shares at the corners for low frequencies and for the rest; `factor`
    (N,3,3) the linear RGB factors there that level the seams. `low_scale` (V,) reduces each photo to its low
    frequencies, the same on the surface whatever the photo's resolution.
    """

    face: IndexArray
    view: IntArray
    low: Float32Array
    high: Float32Array
    factor: Float32Array
    low_scale: FloatArray


def _mix(
    points: FloatArray,
    faces: IntArray,
    selection: Selection,
    views: Sequence[View],
    settings: AtlasSettings,
    levels: SeamLevels | None,
) -> _Mix:
    """Low frequencies cross-fade over `blend_rings` rings of faces, the rest over one."""
    rings = settings.blend_rings
    high = blend_shares(points, faces, selection.view, views, min(rings, 1))
    low = blend_shares(points, faces, selection.view, views, rings) if rings > 1 else high
    count = len(views)
    keys = [blend.face.astype(np.int64) * count + blend.view for blend in (low, high)]
    key = np.union1d(*keys)
    shares = np.zeros((2, len(key), 3), dtype=np.float32)
    for band, blend in enumerate((low, high)):
        shares[band, np.searchsorted(key, keys[band])] = blend.share
    face, view = key // count, (key % count).astype(np.int32)
    factor = np.ones((len(key), 3, 3), dtype=np.float32)
    if levels is not None:
        factor = levels.at(view[:, None], faces[face])
    return _Mix(face, view, shares[0], shares[1], factor, _low_scales(selection, count))


def _low_scales(selection: Selection, view_count: int) -> FloatArray:
    usual = float(np.nanmedian(selection.texel_size))
    scales = np.full(view_count, 1 / _LOW_TEXELS)
    for number in np.unique(selection.view[selection.view >= 0]):
        own = float(np.median(selection.texel_size[selection.view == number]))
        scales[number] = np.clip(own / (_LOW_TEXELS * usual), 1 / 64, 1 / 4)
    return scales


@dataclass(frozen=True, eq=False)
class _Model:
    """The textured mesh (V,3) m, (F,3), the size of a texel on it (m), and what is done to its texels."""

    points: FloatArray
    faces: IntArray
    selection: Selection
    views: Sequence[View]
    texel: float
    relief: DetailSurface | None
    correction: ColourCorrection | None


def _bake_page_job(page: int, layout: ChartLayout, model: _Model, mix: _Mix) -> Job[Float32Array]:
    """Linear colours of one page (size,size,3)."""
    yield Progress(0.0, "finding its texels")
    chosen = _faces_of_page(layout, page, model.selection.view)
    texels = rasterise(layout.uv[chosen], layout.size)
    on_page = np.zeros(len(model.faces), dtype=np.bool_)
    on_page[chosen] = True
    rows = np.flatnonzero(on_page[mix.face])
    colour = np.zeros((len(texels.face), 3), dtype=np.float32)
    needed = np.unique(mix.view[rows])
    for count, number in enumerate(needed.tolist()):
        name = view_name(model.views[number], number)
        yield Progress((count + 0.2) / (len(needed) + 1), f"resampling {name}")
        of_photo = rows[mix.view[rows] == number]
        local = np.searchsorted(chosen, mix.face[of_photo])
        _add_photo(colour, texels, local, model, number, mix, of_photo)
    if model.correction is not None:
        colour = model.correction.apply(colour).astype(np.float32)
    colour[model.selection.view[chosen[texels.face]] < 0] = np.float32(NEUTRAL)
    image = np.full((layout.size, layout.size, 3), np.float32(NEUTRAL))
    filled = np.zeros((layout.size, layout.size), dtype=np.bool_)
    image[texels.row, texels.column] = colour
    filled[texels.row, texels.column] = True
    yield Progress(0.95, "filling the margins")
    return fill_margins(image, filled) if len(texels.face) else image


def _faces_of_page(layout: ChartLayout, page: int, view: IntArray) -> IndexArray:
    """Faces that lie on a page; of the unseen ones that share a spot, one is enough."""
    on_page = layout.page == page
    unseen = np.flatnonzero(on_page & (view < 0))
    if len(unseen) and np.all(layout.uv[unseen] == layout.uv[unseen[0], 0]):
        on_page[unseen[1:]] = False
    return np.flatnonzero(on_page)


@dataclass(frozen=True, eq=False)
class _Bands:
    """A photo (H,W,3), reduced by `scale`, with its gain; and its `low` frequencies in linear light."""

    full: AnyArray
    low: Float32Array
    gain: FloatArray
    low_scale: float
    scale: float

    @classmethod
    def of_photo(cls, view: View, number: int, gain: FloatArray, low_scale: float, scale: float) -> _Bands:
        """Read a photo; a `scale` well below 1 reduces it to the atlas's texels, lest it alias."""
        full = read_deep_photo(view, number)
        small = cv2.resize(full, None, fx=low_scale, fy=low_scale, interpolation=cv2.INTER_AREA)
        low = cv2.GaussianBlur(to_linear(small), (0, 0), 1.0)
        if scale < _REDUCED:
            full = cv2.resize(full, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
        else:
            scale = 1.0
        return cls(full, np.asarray(low, dtype=np.float32), gain, low_scale, scale)

    def at(self, pixels: FloatArray) -> tuple[Float32Array, Float32Array]:
        """Low frequencies and the rest at pixels: (n,2) -> (n,3), (n,3) linear."""
        low = sample_image(self.low, (pixels + 0.5) * self.low_scale - 0.5)
        full = to_linear(sample_image(self.full, (pixels + 0.5) * self.scale - 0.5, cubic=True))
        gain = self.gain.astype(np.float32)
        return low * gain, (full - low) * gain


def _add_photo(
    colour: Float32Array,
    texels: Texels,
    local: IndexArray,
    model: _Model,
    number: int,
    mix: _Mix,
    rows: IndexArray,
) -> None:
    """Add the share of photo `number` to the texels of the page's faces `local` (n,), entries `rows` (n,)."""
    own = float(np.nanmedian(model.selection.texel_size[mix.face[rows]]))
    gain, low_scale = model.selection.gain[number], mix.low_scale[number]
    photo = _Bands.of_photo(model.views[number], number, gain, low_scale, own / model.texel)
    row_of_face = np.full(int(texels.face.max(initial=-1)) + 1, -1, dtype=np.int64)
    known = local < len(row_of_face)
    row_of_face[local[known]] = np.flatnonzero(known)
    for start in range(0, len(texels.face), _TEXELS):
        part_rows = row_of_face[texels.face[start : start + _TEXELS]]
        here = np.flatnonzero(part_rows >= 0)
        texel, entry = here + start, rows[part_rows[here]]
        weights = texels.weights[texel].astype(np.float64)
        face = mix.face[entry]
        places = np.einsum("nk,nkc->nc", weights, model.points[model.faces[face]])
        if model.relief is not None:
            places = model.relief.beneath(places, face, weights)
        low, high = photo.at(np.nan_to_num(project(model.views[number], places)))
        inside = np.clip(weights, 0, 1)
        inside /= inside.sum(axis=1, keepdims=True)
        low *= np.einsum("nk,nk->n", inside, mix.low[entry])[:, None].astype(np.float32)
        high *= np.einsum("nk,nk->n", inside, mix.high[entry])[:, None].astype(np.float32)
        level = np.einsum("nk,nkc->nc", inside, mix.factor[entry])
        colour[texel] += (low + high) * level.astype(np.float32)


def fill_margins(image: Float32Array, filled: BoolArray) -> Float32Array:
    """Give every empty texel the colour of the nearest filled one, so that mip levels stay clean.

    (H,W,3), (H,W) -> (H,W,3).
    """
    empty = (~filled).astype(np.uint8)
    _, label = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    row, column = np.nonzero(filled)
    source = np.zeros(int(label.max()) + 1, dtype=np.int64)
    source[label[row, column]] = row * filled.shape[1] + column
    flat = image.reshape(-1, 3)
    out = image.copy()
    out[~filled] = flat[source[label[~filled]]]
    return out


def _coded_page(linear: Float32Array, depth: int) -> bytes:
    """Code a page as PNG in 8 or 16 bits."""
    srgb = to_srgb(linear)
    codes = to_bytes(srgb) if depth == 8 else np.rint(srgb * np.float32(65535)).astype(np.uint16)
    return cv2.imencode(".png", codes[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 3])[1].tobytes()
