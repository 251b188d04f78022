"""What is made of a texture for delivery: a baked atlas, coloured vertices."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ...arrays import AnyArray, FloatArray
from ...errors import OutputError
from ...files import replacing
from ...jobs import Job, Progress, part
from ...settings import AtlasSettings
from ...texture import Atlas, SeamLevels, bake_atlas_job, level_seams_job
from ...texture.colour.correction import ColourCorrection
from ...texture.models.colours import Colours, colour_vertices_job
from ...texture.selection import Selection
from ...texture.surface import Mesh
from ...texture.views.images import to_bytes, to_linear, to_srgb
from .textures import TexturedScan

_ROWS = 20_000


@dataclass(frozen=True)
class DeliverySettings:
    """A baked atlas, and what is done to colours on the way; the photos and their UVs stay as they are."""

    atlas: AtlasSettings = field(default_factory=AtlasSettings)
    level: bool = True
    """Level the seams that one gain per photo leaves."""
    untouched: bool = False
    """Keep the pixels' colours as they are: no gains, no levelling, no blending; for the archive."""


@dataclass(frozen=True, eq=False)
class BakedAtlas:
    """An atlas and the model that it belongs to: `path` of the OBJ, UVs (F,3,2) in the page of each face.

    `page` (F,) counts from 0; v goes up, (0, 0) is the lower left corner of the page.
    """

    path: Path
    atlas: Atlas
    uv: FloatArray

    @property
    def page(self) -> AnyArray:
        """Page of every face (F,)."""
        return self.atlas.layout.page


def bake_job(
    folder: Path,
    name: str,
    textured: TexturedScan,
    settings: DeliverySettings,
    offset: FloatArray,
    detail: Mesh | None = None,
    correction: ColourCorrection | None = None,
) -> Job[BakedAtlas]:
    """Bake a textured scan into pages beside a model: `folder/name.obj`, `.mtl`, `name.1001.png`, ...

    Vertices are written as `vertices + offset` (m). Every page has its own material with UVs from 0 to 1,
    which every program opens. `detail` and `correction` as for `bake_atlas_job`. Raises TextureError,
    PhotoError, OutputError.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror or error}") from error
    selection, levels = yield from part(corrected_job(textured, settings), 0.0, 0.2)
    atlas_settings = replace(settings.atlas, blend_rings=0) if settings.untouched else settings.atlas
    mesh = textured.vertices, textured.faces
    bake = bake_atlas_job(
        folder, name, *mesh, selection, textured.views, atlas_settings, levels, detail, correction
    )
    atlas: Atlas = yield from part(bake, 0.2, 0.9)
    uv = atlas.udim - np.floor(np.nanmin(atlas.udim, axis=1, keepdims=True))
    path = folder / f"{name}.obj"
    yield from part(_obj_job(path, textured, atlas, uv, offset), 0.9, 1.0)
    return BakedAtlas(path, atlas, uv)


def colour_job(
    textured: TexturedScan, settings: DeliverySettings, correction: ColourCorrection | None = None
) -> Job[Colours]:
    """Colours of a textured scan's vertices, made true by a `correction`. Raises PhotoError."""
    selection, levels = yield from part(corrected_job(textured, settings), 0.0, 0.4)
    job = colour_vertices_job(textured.vertices, textured.faces, selection, textured.views, levels)
    colours: Colours = yield from part(job, 0.4, 1.0)
    return corrected_colours(colours, correction)


def corrected_colours(colours: Colours, correction: ColourCorrection | None) -> Colours:
    """Colours made true by a correction; those that no photo gave stay."""
    if correction is None:
        return colours
    true = to_bytes(to_srgb(correction.apply(to_linear(colours.rgb))))
    return replace(colours, rgb=np.where(colours.seen[:, None], true, colours.rgb))


def corrected_job(
    textured: TexturedScan, settings: DeliverySettings
) -> Job[tuple[Selection, SeamLevels | None]]:
    """Choice of photos with the gains that are wanted, and the levels of its seams."""
    selection = textured.selection
    if settings.untouched:
        return replace(selection, gain=np.ones_like(selection.gain)), None
    if not settings.level:
        return selection, None
    levels = yield from level_seams_job(textured.vertices, textured.faces, selection, textured.views)
    return selection, levels


def write_coloured_ply(path: Path, textured: TexturedScan, colours: Colours, offset: FloatArray) -> Path:
    """Write the model with a colour per vertex; coordinates are `vertices + offset` (m) in doubles."""
    vertices = np.zeros(len(textured.vertices), dtype=[("xyz", "<f8", 3), ("rgb", "u1", 3)])
    vertices["xyz"], vertices["rgb"] = textured.vertices + offset, colours.rgb
    faces = np.zeros(len(textured.faces), dtype=[("count", "u1"), ("corner", "<i4", 3)])
    faces["count"], faces["corner"] = 3, textured.faces
    lines = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    lines += [f"property double {axis}" for axis in "xyz"]
    lines += [f"property uchar {channel}" for channel in ("red", "green", "blue")]
    lines += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    with replacing(path) as file:
        file.write("\n".join(lines).encode())
        file.write(vertices.tobytes())
        file.write(faces.tobytes())
    return path


def _obj_job(
    path: Path, textured: TexturedScan, atlas: Atlas, uv: FloatArray, offset: FloatArray
) -> Job[None]:
    """Write the model with one material per page."""
    library = path.with_suffix(".mtl")
    order = np.argsort(atlas.layout.page, kind="stable")
    corners, index = np.unique(uv[order].reshape(-1, 2).astype(np.float32), axis=0, return_inverse=True)
    numbers = np.stack([textured.faces[order] + 1, index.reshape(-1, 3) + 1], axis=2).reshape(-1, 6)
    with replacing(library) as mtl, replacing(path) as obj:
        for page in atlas.paths:
            mtl.write(f"newmtl {page.stem}\nKd 1 1 1\nmap_Kd {page.name}\n\n".encode())
        obj.write(f"# metres\nmtllib {library.name}\n".encode())
        for text in _lines("v %.6f %.6f %.6f\n", textured.vertices + offset):
            yield Progress(0.2, f"Writing {path.name}")
            obj.write(text)
        for text in _lines("vt %.8f %.8f\n", corners):
            yield Progress(0.5, f"Writing {path.name}")
            obj.write(text)
        pages = atlas.layout.page[order]
        for number, page in enumerate(atlas.paths):
            obj.write(f"usemtl {page.stem}\n".encode())
            for text in _lines("f %d/%d %d/%d %d/%d\n", numbers[pages == number]):
                yield Progress(0.8, f"Writing {path.name}")
                obj.write(text)


def _lines(form: str, rows: AnyArray) -> Iterator[bytes]:
    for start in range(0, len(rows), _ROWS):
        block = rows[start : start + _ROWS]
        yield (form * len(block) % tuple(block.ravel().tolist())).encode()
