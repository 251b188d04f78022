"""Photos and scans made ready for clicks, in threads; kept while they are worked on, never saved."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import bpy
import cv2
import numpy as np

from ...core.arrays import ArrayLike, BoolArray, ByteArray, Float32Array, FloatArray, IndexArray, IntArray
from ...core.errors import PhotoError
from ...core.geometry.rays import RayCaster
from ...core.jobs import Job, Progress, part
from ...core.regions.photo.wand import PhotoWand, prepare_wand_job
from ...core.regions.surface.cloud_index import index_cloud_job
from ...core.regions.surface.index import SurfaceIndex, index_surface_job
from ..background import Preparation, Signature
from ..bridge import meshes
from ..bridge.colours import read_scan_colours
from ..bridge.world import matrix_to_array
from ..properties import FrescoPhoto
from .cloud import PreparedCloud
from .levels import WandLevels
from .views import ViewGeometry


@dataclass(frozen=True, eq=False)
class PreparedScan:
    """A scan with what clicks on it need: vertices (V,3) in Blender's world, metres, and faces (F,3)."""

    index: SurfaceIndex
    caster: RayCaster
    vertices: FloatArray
    faces: IntArray

    primitive = "TRIS"

    @property
    def count(self) -> int:
        """Number of faces."""
        return len(self.faces)

    def corners(self, elements: IndexArray) -> Float32Array:
        """Corners (3n,3), m, of faces (n,), to be drawn."""
        return self.vertices[self.faces[elements]].reshape(-1, 3).astype(np.float32)

    def first_hit(self, origins: FloatArray, towards: FloatArray) -> tuple[IndexArray, FloatArray]:
        """Face that each ray (n,3) m, (n,3) meets first, -1 for none, and its distance (n,), m."""
        hit = self.caster.first_hit(origins, towards)
        return hit.face.astype(np.int64), hit.distance.astype(np.float64)

    def facing(self, view: ViewGeometry, inside: BoolArray) -> BoolArray:
        """Which of the faces `inside` (F,) look towards a view."""
        return inside & view.faces_it(self._middles, self.index.normal)

    def visible(self, view: ViewGeometry, elements: IndexArray) -> BoolArray:
        """Which of the faces (n,) a view sees: nothing stands before them, and they look towards it."""
        middle = self._middles[elements]
        seen = view.faces_it(middle, self.index.normal[elements])
        seen[seen] = ~self.caster.occluded(view.origins(middle[seen]), middle[seen])
        return seen

    @property
    def _middles(self) -> FloatArray:
        return self.index.middle.astype(np.float64) + self.index.centre


@dataclass(eq=False)
class LastClick:
    """The wand's last click, so that its tolerance can still be changed by keys in the editor `space`."""

    levels: WandLevels[Any]
    space: str


class Store:
    """The photo and the scan worked on last, and the last click on them."""

    def __init__(self) -> None:
        self.photo: Preparation[PhotoWand] | None = None
        self.scan: Preparation[PreparedScan | PreparedCloud] | None = None
        self.click: LastClick | None = None

    def clear(self) -> None:
        """Give the memory back."""
        for work in (self.photo, self.scan):
            if work is not None:
                work.stop()
        self.photo = self.scan = self.click = None


STORE = Store()
"""Both take seconds to prepare and much memory to keep, and no .blend could hold them."""


def read_pixels(path: str | Path) -> ByteArray:
    """RGB pixels (H,W,3) of a photo's original file, as stored: the camera belongs to these."""
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        data = np.fromfile(path, dtype=np.uint8)
    except OSError as error:
        raise PhotoError(f"{path}: the photo cannot be read ({error.strerror or error})") from error
    image = cv2.imdecode(data, flags) if len(data) else None
    if image is None:
        raise PhotoError(f"{path}: not a photo that can be read")
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB, dst=image)


def _wand_job(path: str) -> Job[PhotoWand]:
    yield Progress(0.0, "Reading the photo")
    pixels = read_pixels(path)
    return (yield from part(prepare_wand_job(pixels), 0.1, 1.0))


def _usable(work: Preparation[Any] | None, signature: Signature) -> bool:
    return work is not None and work.signature == signature and not work.failed


def prepare_photo(photo: FrescoPhoto) -> Preparation[PhotoWand]:
    """Begin to make a photo ready, unless it is or begins to be."""
    signature: Signature = (photo.path,)
    if not _usable(STORE.photo, signature):
        if STORE.photo is not None:
            STORE.photo.stop()
        STORE.photo = Preparation(signature, _wand_job(photo.path))
    return STORE.photo


def photo_job(photo: FrescoPhoto) -> Job[PhotoWand]:
    """Wait until a photo is ready; done at once when it is."""
    return prepare_photo(photo).wait_job()


def scan_signature(scan: bpy.types.Object) -> Signature:
    """Tell whether a scan is still the one that was prepared."""
    mesh = scan.data
    positions = meshes.read_positions(mesh)
    sample = positions[:: max(1, len(positions) // 1000)].tobytes()
    matrix = matrix_to_array(scan.matrix_world).tobytes()
    return (mesh.name, len(mesh.vertices), len(mesh.polygons), matrix, sample)


def _scan_job(
    vertices: FloatArray, faces: IntArray, colours: ByteArray | None
) -> Job[PreparedScan | PreparedCloud]:
    if len(faces) == 0:
        return PreparedCloud((yield from index_cloud_job(vertices, colours)), vertices)
    index = yield from part(index_surface_job(vertices, faces, colours), 0.0, 0.8)
    yield Progress(0.8, "Preparing clicks")
    return PreparedScan(index, RayCaster(vertices, faces), vertices, faces)


def prepare_scan(scan: bpy.types.Object) -> Preparation[PreparedScan | PreparedCloud]:
    """Begin to make a scan ready, unless it is or begins to be."""
    signature = scan_signature(scan)
    if not _usable(STORE.scan, signature):
        if STORE.scan is not None:
            STORE.scan.stop()
        data = meshes.read_vertices(scan), meshes.read_any_faces(scan.data), read_scan_colours(scan.data)[0]
        STORE.scan = Preparation(signature, _scan_job(*data))
    return STORE.scan


def scan_job(scan: bpy.types.Object) -> Job[PreparedScan | PreparedCloud]:
    """Wait until a scan is ready; done at once when it is."""
    return prepare_scan(scan).wait_job()


def face_mask(faces: ArrayLike, count: int) -> BoolArray:
    """Which of `count` faces are among the numbered ones: (count,)."""
    inside = np.zeros(count, dtype=np.bool_)
    inside[np.asarray(faces, dtype=np.int64)] = True
    return inside
