"""The texture stage: large faces split, the best photo for every face."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..arrays import AnyArray, FloatArray, IntArray
from ..cameras.files.dictionary import camera_to_dict
from ..errors import TextureError
from ..jobs import Job, Progress, drain, part
from ..photos.view import View
from ..scans.scan import Scan
from ..settings import TextureSettings
from ..texture import Selection, SplitMesh, select_views_job, split_large_faces_job
from .digest import code_digest, digest, file_digest
from .facing import check_facing
from .store import Store


@dataclass(frozen=True, eq=False)
class TexturedScan:
    """A scan with a photo for every face.

    `vertices` (V,3) and `faces` (F,3) are the scan's with large faces split, in its local coordinates;
    `parent` (F,) is the face of the scan each one comes from. `selection` refers to `views` and
    to these faces.
    """

    vertices: FloatArray
    faces: IntArray
    parent: IntArray
    selection: Selection
    views: tuple[View, ...]

    @property
    def coverage(self) -> float:
        """Share of the surface that has a photo, in 0..1."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        areas = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        return float(areas[self.selection.view >= 0].sum() / areas.sum())


def texture_scan(scan: Scan, views: Sequence[View], settings: TextureSettings | None = None) -> TexturedScan:
    """Run `texture_scan_job` to its end."""
    return drain(texture_scan_job(scan, views, settings))


def texture_scan_job(
    scan: Scan,
    views: Sequence[View],
    settings: TextureSettings | None = None,
    occluders: Sequence[Scan] = (),
    store: Store | None = None,
) -> Job[TexturedScan]:
    """Choose a photo for every face of a scan.

    `views` are in the scan's local coordinates; `occluders` have the offset of the scan and hide it without
    getting texture. With a `store` the result is taken over when nothing changed. Raises TextureError for a
    point cloud, no views, or views that look past the scan or at its back; PhotoError for a photo that
    cannot be read.
    """
    settings, store = settings or TextureSettings(), store or Store()
    if scan.is_cloud:
        raise TextureError(f"{scan.name}: the scan is a point cloud; mesh it before texturing")
    if not views:
        raise TextureError("No photo has a pose: there is nothing to texture with.")
    key = yield from part(_key_job(scan, views, settings, occluders, store), 0.0, 0.02)
    saved = store.load_arrays("texture", key)
    if saved is not None:
        return _from_arrays(saved, views)
    if not settings.double_sided:
        check_facing(scan, views)
    hiding = [(other.vertices, other.faces) for other in occluders if not other.is_cloud]
    mesh: SplitMesh = yield from part(
        split_large_faces_job(scan.vertices, scan.faces, views, settings.uv_tolerance, settings.double_sided),
        0.02,
        0.2,
    )
    selection: Selection = yield from part(
        select_views_job(mesh.vertices, mesh.faces, views, settings, hiding), 0.2, 0.95
    )
    yield Progress(0.95, "Keeping the texture")
    textured = TexturedScan(mesh.vertices, mesh.faces, mesh.parent, selection, tuple(views))
    store.save_arrays("texture", key, _to_arrays(textured))
    return textured


def _key_job(
    scan: Scan, views: Sequence[View], settings: TextureSettings, occluders: Sequence[Scan], store: Store
) -> Job[str]:
    """Fingerprint of all that the texture depends on; without a store it is not needed."""
    if store.folder is None:
        return ""
    yield Progress(0.0, "Looking for finished texture")
    meshes = [digest(other.vertices, other.faces) for other in (scan, *occluders)]
    photos = []
    for number, view in enumerate(views):
        yield Progress(number / len(views), "Looking for finished texture")
        photos.append(_view_digest(view))
    return digest(code_digest(), meshes, settings, photos)


def _view_digest(view: View) -> str:
    pixels = view.image if isinstance(view.image, np.ndarray) else file_digest(Path(view.image))
    mask = () if view.mask is None else view.mask
    return digest(camera_to_dict(view.camera), view.rotation, view.translation, pixels, mask)


def _to_arrays(textured: TexturedScan) -> dict[str, AnyArray]:
    mesh = {name: getattr(textured, name) for name in ("vertices", "faces", "parent")}
    fields = dataclasses.fields(Selection)
    return mesh | {f"selection_{f.name}": getattr(textured.selection, f.name) for f in fields}


def _from_arrays(saved: dict[str, AnyArray], views: Sequence[View]) -> TexturedScan:
    chosen = {f.name: saved[f"selection_{f.name}"] for f in dataclasses.fields(Selection)}
    return TexturedScan(saved["vertices"], saved["faces"], saved["parent"], Selection(**chosen), tuple(views))
