"""Baked atlases for delivery: photos resampled once into charts, levelled and blended at the seams."""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from ...arrays import AnyArray, ArrayLike, BoolArray, Float32Array, FloatArray, IndexArray, IntArray
from ...files import replacing
from ...jobs import Job, Progress, drain, part
from ...photos.view import View
from ...settings import AtlasSettings
from ..colour.bands import BandMix, PhotoBands, mix_bands
from ..colour.correction import ColourCorrection
from ..colour.levelling import SeamLevels
from ..selection import Selection
from ..surface import Mesh, checked_mesh
from ..views.images import to_bytes, to_srgb, view_name
from ..views.visibility import project
from .charts import ChartLayout, photo_charts
from .detail import DetailSurface
from .raster import Texels, rasterise
from .unwrapping import surface_charts_job

NEUTRAL = 0.2140
"""Linear value of the grey that unseen faces get: 128 of 255 in sRGB."""
_TEXELS = 1 << 20


@dataclass(frozen=True, eq=False)
class Atlas:
    """A baked atlas: `layout` says where faces lie, `paths` are the pages in UDIM order, 1001 first.

    `texel_size` (m) is the one asked for, or the median of what the photos show.
    """

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
        scaled = settings.texel_size
        layout = photo_charts(triangles, len(points), selection, scaled, size, padding)
    else:
        scaled = texel
        charts = surface_charts_job(points, triangles, selection.view, texel, size, padding)
        layout = yield from part(charts, 0.0, 0.05)
    yield Progress(0.05, "Finding what to blend")
    mix = mix_bands(points, triangles, selection, views, settings.blend_rings, levels)
    relief = DetailSurface(points, triangles, detail) if detail is not None else None
    paths = tuple(Path(folder) / f"{stem}.{1001 + page}.png" for page in range(layout.pages))
    with ExitStack() as together:  # the pages get their names when all are there
        for page, path in enumerate(paths):
            file = together.enter_context(replacing(path))
            model = _Model(points, triangles, selection, views, scaled, relief, correction)
            baking = _bake_page_job(page, layout, model, mix, settings.depth)
            start, end = (0.1 + 0.9 * (page + k) / layout.pages for k in (0, 1))
            codes = yield from part(baking, start, end, f"Page {page + 1} of {layout.pages}: ")
            file.write(_as_png(codes))
    return Atlas(layout, paths, texel)


@dataclass(frozen=True, eq=False)
class _Model:
    """The textured mesh (V,3) m, (F,3), the size of a texel on it (m), and what is done to its texels.

    Where the size is 0 texels are the pixels of the photos.
    """

    points: FloatArray
    faces: IntArray
    selection: Selection
    views: Sequence[View]
    texel: float
    relief: DetailSurface | None
    correction: ColourCorrection | None


def _bake_page_job(page: int, layout: ChartLayout, model: _Model, mix: BandMix, depth: int) -> Job[AnyArray]:
    """Codes of one page, (size,size,3) sRGB in 8 or 16 bits."""
    yield Progress(0.0, "finding its texels")
    chosen = _faces_of_page(layout, page, model.selection.view)
    texels = rasterise(layout.uv[chosen], layout.size)
    colour = np.zeros((len(texels.face), 3), dtype=np.float32)
    place = np.full(len(model.faces), -1, dtype=np.int64)
    place[chosen] = np.arange(len(chosen))
    rows = np.flatnonzero(place[mix.face] >= 0)
    needed = np.unique(mix.view[rows])
    for count, number in enumerate(needed.tolist()):
        name = view_name(model.views[number], number)
        yield Progress((count + 0.2) / (len(needed) + 1), f"resampling {name}")
        entry_of_face = np.full(len(chosen), -1, dtype=np.int64)
        of_photo = rows[mix.view[rows] == number]
        entry_of_face[place[mix.face[of_photo]]] = of_photo
        _add_photo(colour, texels, entry_of_face, model, number, mix)
    if model.correction is not None:
        colour = model.correction.apply(colour).astype(np.float32)
    colour[model.selection.view[chosen[texels.face]] < 0] = np.float32(NEUTRAL)
    yield Progress(0.95, "filling the margins")
    image = np.broadcast_to(_coded(np.full(3, NEUTRAL), depth), (layout.size, layout.size, 3)).copy()
    filled = np.zeros((layout.size, layout.size), dtype=np.bool_)
    image[texels.row, texels.column] = _coded(colour, depth)
    filled[texels.row, texels.column] = True
    if len(texels.face):
        fill_margins(image, filled)
    return image


def _faces_of_page(layout: ChartLayout, page: int, view: IntArray) -> IndexArray:
    """Faces that lie on a page; of the unseen ones that share a spot, one is enough."""
    on_page = layout.page == page
    unseen = np.flatnonzero(on_page & (view < 0))
    if len(unseen) and np.all(layout.uv[unseen] == layout.uv[unseen[0], 0]):
        on_page[unseen[1:]] = False
    return np.flatnonzero(on_page)


def _add_photo(
    colour: Float32Array, texels: Texels, entry_of_face: IndexArray, model: _Model, number: int, mix: BandMix
) -> None:
    """Add photo `number` to the texels of the page; `entry_of_face` is its entry of the mix, or -1."""
    chosen = np.flatnonzero((entry_of_face >= 0)[texels.face])
    entries = entry_of_face[entry_of_face >= 0]
    own = float(np.nanmedian(model.selection.texel_size[mix.face[entries]]))
    scale = own / model.texel if model.texel > 0 else 1.0
    gain = model.selection.gain[number]
    photo = PhotoBands.of_photo(model.views[number], number, gain, mix.scale[:, number], scale)
    for start in range(0, len(chosen), _TEXELS):
        texel = chosen[start : start + _TEXELS]
        entry = entry_of_face[texels.face[texel]]
        single = mix.alone[entry]
        for part_of, mixed in ((single, False), (~single, True)):
            at, rows = texel[part_of], entry[part_of]
            weights = texels.weights[at]
            pixels = _texel_pixels(model, mix.face[rows], weights, model.views[number])
            inside = np.clip(weights, 0, 1)
            inside /= inside.sum(axis=1, keepdims=True)
            if mixed:
                shown = photo.mixed(pixels, np.einsum("nk,bnk->bn", inside, mix.share[:, rows]))
            else:
                shown = photo.whole(pixels)
            if mix.factor is not None:
                shown *= np.einsum("nk,nkc->nc", inside, mix.factor[rows])
            colour[at] += shown


def _texel_pixels(model: _Model, face: IndexArray, weights: Float32Array, view: View) -> FloatArray:
    """Pixels (n,2) of a photo at which the texels' places on the surface lie."""
    share = weights.astype(np.float64)
    places = np.zeros((len(face), 3))
    for corner in range(3):
        places += share[:, corner, None] * model.points[model.faces[face, corner]]
    if model.relief is not None:
        places = model.relief.beneath(places, face, share)
    return np.nan_to_num(project(view, places))


def fill_margins(image: AnyArray, filled: BoolArray) -> None:
    """Give every empty texel the colour of the nearest filled one, so that mip levels stay clean.

    Changes the image (H,W,3); `filled` (H,W).
    """
    empty = (~filled).astype(np.uint8)
    _, label = cv2.distanceTransformWithLabels(empty, cv2.DIST_L2, 5, labelType=cv2.DIST_LABEL_PIXEL)
    source = np.zeros(int(label.max()) + 1, dtype=np.int64)
    source[label[filled]] = np.flatnonzero(filled)
    image[~filled] = image.reshape(-1, 3)[source[label[~filled]]]


def _coded(linear: Float32Array | FloatArray, depth: int) -> AnyArray:
    """Values in sRGB of linear light, in 8 or 16 bits."""
    srgb = to_srgb(linear)
    return to_bytes(srgb) if depth == 8 else np.rint(srgb * np.float32(65535)).astype(np.uint16)


def _as_png(codes: AnyArray) -> bytes:
    return cv2.imencode(".png", codes[..., ::-1], [cv2.IMWRITE_PNG_COMPRESSION, 3])[1].tobytes()
