"""The simplified model of a project: fewer faces, texture baked anew from the photos, deviation told."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...arrays import AnyArray, FloatArray, IntArray
from ...jobs import Job, part
from ...settings import TextureSettings
from ...texture.colour.correction import ColourCorrection
from ...texture.models.deviation import Deviation
from ...texture.models.simplify import SimplifiedMesh, simplify_mesh_job
from ...texture.select import select_views_job
from ...texture.selection import Selection
from ...texture.surface import Mesh
from .delivery import BakedAtlas, DeliverySettings, bake_job
from .textures import TexturedScan


@dataclass(frozen=True)
class SimplifySettings:
    """How far to simplify: to a number of faces, or to the fewest that hold a tolerance."""

    faces: int | None = None
    """Faces that are left."""

    tolerance: float | None = None
    """Distance (m) from the scan that 95 % of the surface may have."""


@dataclass(frozen=True, eq=False)
class SimplifiedModel:
    """A simplified model on disk: `path` of its OBJ, `pages` of its atlas, and the mesh, local to the scan.

    `vertices` (V,3) m, `faces` (F,3), `uv` (F,3,2) in the `page` (F,) of each face; `deviation` from
    the scan.
    """

    path: Path
    vertices: FloatArray
    faces: IntArray
    uv: FloatArray
    page: AnyArray
    pages: tuple[Path, ...]
    texel_size: float
    deviation: Deviation

    @property
    def told(self) -> str:
        """Its numbers in words."""
        off = self.deviation
        pages = f"{len(self.pages)} atlas page{'s' if len(self.pages) > 1 else ''}"
        return (
            f"{len(self.faces)} faces, {pages}; from the scan: RMS {1000 * off.rms:.2f} mm, 95 % within "
            f"{1000 * off.percentile_95:.2f} mm, largest {1000 * off.maximum:.2f} mm"
        )


def simplified_job(
    folder: Path,
    name: str,
    scan: Mesh,
    textured: TexturedScan,
    wanted: SimplifySettings,
    texture: TextureSettings,
    delivery: DeliverySettings,
    offset: FloatArray,
    occluders: Sequence[Mesh] = (),
    correction: ColourCorrection | None = None,
    priorities: Sequence[float] | None = None,
) -> Job[SimplifiedModel]:
    """Simplify a scan and bake the photos of `textured` onto it, as files like those of `bake_job`.

    Vertices are written as `vertices + offset` (m). The photos are chosen anew for the simplified faces.
    Raises TextureError, PhotoError, OutputError.
    """
    mesh: SimplifiedMesh = yield from part(simplify_mesh_job(*scan, wanted.faces, wanted.tolerance), 0.0, 0.3)
    choosing = select_views_job(
        mesh.vertices, mesh.faces, textured.views, texture, occluders, priorities=priorities
    )
    selection: Selection = yield from part(choosing, 0.3, 0.6)
    parent = np.full(len(mesh.faces), -1, dtype=np.int32)  # its faces are not the scan's
    chosen = TexturedScan(mesh.vertices, mesh.faces, parent, selection, textured.views)
    baking = bake_job(folder, name, chosen, delivery, offset, scan, correction)
    baked: BakedAtlas = yield from part(baking, 0.6, 1.0)
    pages, texel = baked.atlas.paths, baked.atlas.texel_size
    return SimplifiedModel(
        baked.path, mesh.vertices, mesh.faces, baked.uv, baked.page, pages, texel, mesh.deviation
    )


def model_arrays(model: SimplifiedModel) -> dict[str, AnyArray]:
    """Return a model as arrays, to be kept between runs."""
    arrays = {
        key: np.asarray(getattr(model, key)) for key in ("vertices", "faces", "uv", "page", "texel_size")
    }
    arrays["deviation"] = np.array(dataclasses.astuple(model.deviation))
    return arrays | {"pages": np.array([page.name for page in model.pages])}


def model_from_arrays(path: Path, kept: dict[str, AnyArray]) -> SimplifiedModel:
    """Return the model that `model_arrays` took apart; its files lie beside `path`."""
    pages = tuple(path.with_name(str(name)) for name in kept["pages"])
    off = Deviation(*(float(value) for value in kept["deviation"]))
    mesh = (kept["vertices"], kept["faces"], kept["uv"], kept["page"])
    return SimplifiedModel(path, *mesh, pages, float(kept["texel_size"]), off)
