"""The texture stage: large faces split, the best photo for every face."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ...arrays import AnyArray, FloatArray, IndexArray, IntArray
from ...cameras.files.dictionary import camera_to_dict
from ...errors import TextureError
from ...jobs import Job, Progress, drain, part
from ...photos.view import View
from ...scans.scan import Scan
from ...settings import TextureSettings
from ...texture import Selection, SplitMesh, select_views_job, split_large_faces_job
from ...texture.views.kept import KeptPhotos
from ..digest import code_digest, digest, file_digest
from ..store import Store
from .facing import check_facing


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
    priorities: Sequence[float] | None = None,
) -> Job[TexturedScan]:
    """Choose a photo for every face of a scan: the only layer of `texture_layers_job`."""
    one = [""] * len(views)
    layers = yield from texture_layers_job(scan, views, one, settings, occluders, store, priorities)
    return layers[""]


def texture_layers_job(
    scan: Scan,
    views: Sequence[View],
    layers: Sequence[str],
    settings: TextureSettings | None = None,
    occluders: Sequence[Scan] = (),
    store: Store | None = None,
    priorities: Sequence[float] | None = None,
) -> Job[dict[str, TexturedScan]]:
    """Choose a photo for every face of a scan, for each set of photos by itself; sets may cover it in part.

    `views` are in the scan's local coordinates; `layers` names the set of each (visible light, raking light,
    infrared), `priorities` prefer or exclude photos (see `select_views_job`). All layers share one mesh,
    split for the photos of all of them; each has its own gains. `occluders` have the offset of the scan and
    hide it without getting texture. With a `store` finished layers are taken over when nothing changed, and
    an interrupted one goes on at the photo where it stopped. Raises TextureError for a point cloud, no views,
    or views that look past the scan or at its back; PhotoError for a photo that cannot be read.
    """
    settings, store = settings or TextureSettings(), store or Store()
    _check_input(scan, views)
    keys = yield from part(_keys_job(scan, views, settings, occluders, store), 0.0, 0.02)
    weights = [0.0] * len(views) if priorities is None else list(priorities)
    wanted = {name: np.flatnonzero([layer == name for layer in layers]) for name in dict.fromkeys(layers)}
    key_of = {
        name: digest(keys.mesh, keys.views, chosen, [weights[k] for k in chosen]) if store.folder else ""
        for name, chosen in wanted.items()
    }
    done = _finished(store, key_of, wanted, views)
    if len(done) == len(wanted):
        return done
    if not settings.double_sided:
        check_facing(scan, views)
    split = split_large_faces_job(
        scan.vertices, scan.faces, views, settings.uv_tolerance, settings.double_sided
    )
    mesh: SplitMesh = yield from part(split, 0.02, 0.2)
    hiding = [(other.vertices, other.faces) for other in occluders if not other.is_cloud]
    mesh_key = digest(keys.mesh, mesh.vertices, mesh.faces) if store.folder else ""
    missing = [name for name in wanted if name not in done]
    for number, name in enumerate(missing):
        chosen = wanted[name]
        kept = _kept(store, mesh_key, [keys.views[k] for k in chosen])
        of_layer, own = [views[k] for k in chosen], settings_among(settings, chosen)
        priority = [weights[k] for k in chosen]
        job = select_views_job(mesh.vertices, mesh.faces, of_layer, own, hiding, priority, kept)
        start, end = (0.2 + 0.75 * n / len(missing) for n in (number, number + 1))
        selection: Selection = yield from part(job, start, end, f"{name}: " if name else "")
        yield Progress(end, "Keeping the texture")
        done[name] = TexturedScan(mesh.vertices, mesh.faces, mesh.parent, selection, tuple(of_layer))
        store.save_arrays(_file_name(name), key_of[name], _to_arrays(done[name]))
        kept.clear()
    return {name: done[name] for name in wanted}


def _check_input(scan: Scan, views: Sequence[View]) -> None:
    if scan.is_cloud:
        raise TextureError(f"{scan.name}: the scan is a point cloud; mesh it before texturing")
    if not views:
        raise TextureError("No photo has a pose: there is nothing to texture with.")


def _finished(
    store: Store, keys: Mapping[str, str], wanted: Mapping[str, IndexArray], views: Sequence[View]
) -> dict[str, TexturedScan]:
    """Layers that an earlier run has kept, unchanged since."""
    saved = {name: store.load_arrays(_file_name(name), keys[name]) for name in wanted}
    return {
        name: _from_arrays(arrays, [views[k] for k in wanted[name]])
        for name, arrays in saved.items()
        if arrays is not None
    }


def settings_among(settings: TextureSettings, chosen: Sequence[int] | IndexArray) -> TextureSettings:
    """Settings for photos `chosen` by number: the anchor is counted among them, None without it."""
    if settings.gain_anchor is None:
        return settings
    place = np.flatnonzero(np.asarray(chosen) == settings.gain_anchor)
    return dataclasses.replace(settings, gain_anchor=int(place[0]) if len(place) else None)


def _file_name(layer: str) -> str:
    return f"texture-{digest(layer)[:12]}" if layer else "texture"


def _kept(store: Store, mesh: str, views: Sequence[str]) -> KeptPhotos:
    if store.folder is None:
        return KeptPhotos()
    return KeptPhotos(store.folder / "photos", [digest(mesh, view) for view in views])


@dataclass(frozen=True)
class _Keys:
    """Fingerprints: of code, settings and meshes together, and of every view."""

    mesh: str
    views: tuple[str, ...]


def _keys_job(
    scan: Scan, views: Sequence[View], settings: TextureSettings, occluders: Sequence[Scan], store: Store
) -> Job[_Keys]:
    """Fingerprints of all that the texture depends on; without a store they are not needed."""
    if store.folder is None:
        return _Keys("", ("",) * len(views))
    yield Progress(0.0, "Looking for finished texture")
    meshes = [digest(other.vertices, other.faces) for other in (scan, *occluders)]
    photos = []
    for number, view in enumerate(views):
        yield Progress(number / len(views), "Looking for finished texture")
        photos.append(_view_digest(view))
    return _Keys(digest(code_digest(), meshes, settings), tuple(photos))


def _view_digest(view: View) -> str:
    pixels = view.image if isinstance(view.image, np.ndarray) else file_digest(Path(view.image))
    mask = file_digest(Path(view.mask)) if isinstance(view.mask, (str, Path)) else view.mask
    return digest(
        camera_to_dict(view.camera), view.rotation, view.translation, pixels, () if mask is None else mask
    )


def _to_arrays(textured: TexturedScan) -> dict[str, AnyArray]:
    mesh = {name: getattr(textured, name) for name in ("vertices", "faces", "parent")}
    fields = dataclasses.fields(Selection)
    return mesh | {f"selection_{f.name}": getattr(textured.selection, f.name) for f in fields}


def _from_arrays(saved: dict[str, AnyArray], views: Sequence[View]) -> TexturedScan:
    chosen = {f.name: saved[f"selection_{f.name}"] for f in dataclasses.fields(Selection)}
    return TexturedScan(saved["vertices"], saved["faces"], saved["parent"], Selection(**chosen), tuple(views))
