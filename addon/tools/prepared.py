"""Photos and scans made ready for clicks; kept while the same photo or scan is worked on, never saved."""

from __future__ import annotations

from dataclasses import dataclass

import bpy
import cv2
import numpy as np

from ...core.arrays import ByteArray, FloatArray, IntArray
from ...core.errors import PhotoError
from ...core.geometry.rays import RayCaster
from ...core.jobs import Job, Progress, part
from ...core.regions.surface_index import SurfaceIndex, index_surface_job
from ...core.regions.wand import PhotoWand, prepare_wand_job
from ..bridge import meshes
from ..bridge.world import matrix_to_array
from ..properties import FrescoPhoto

Signature = tuple[object, ...]


@dataclass(frozen=True, eq=False)
class PreparedScan:
    """A scan with what clicks on it need: vertices (V,3) in Blender's world, metres, and faces (F,3)."""

    index: SurfaceIndex
    caster: RayCaster
    vertices: FloatArray
    faces: IntArray


class Store:
    """The photo and the scan worked on last, each with a signature that tells when it is out of date."""

    def __init__(self) -> None:
        self.photo: tuple[Signature, PhotoWand] | None = None
        self.scan: tuple[Signature, PreparedScan] | None = None

    def clear(self) -> None:
        """Give the memory back."""
        self.photo = self.scan = None


STORE = Store()
"""Both take seconds to prepare and much memory to keep, and no .blend could hold them."""


def read_pixels(photo: FrescoPhoto) -> ByteArray:
    """RGB pixels (H,W,3) of a photo's original file, as stored: the camera belongs to these."""
    flags = cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION
    try:
        data = np.fromfile(photo.path, dtype=np.uint8)
    except OSError as error:
        raise PhotoError(f"{photo.path}: the photo cannot be read ({error.strerror or error})") from error
    image = cv2.imdecode(data, flags) if len(data) else None
    if image is None:
        raise PhotoError(f"{photo.path}: not a photo that can be read")
    return np.ascontiguousarray(image[:, :, ::-1])


def photo_job(photo: FrescoPhoto) -> Job[PhotoWand]:
    """Make a photo ready; done at once when it is."""
    signature: Signature = (photo.path,)
    if STORE.photo is not None and STORE.photo[0] == signature:
        return STORE.photo[1]
    yield Progress(0.0, "Reading the photo")
    pixels = read_pixels(photo)
    wand = yield from part(prepare_wand_job(pixels), 0.1, 1.0)
    STORE.photo = signature, wand
    return wand


def scan_signature(scan: bpy.types.Object) -> Signature:
    """Tell whether a scan is still the one that was prepared."""
    mesh = scan.data
    positions = meshes.read_positions(mesh)
    sample = positions[:: max(1, len(positions) // 1000)].tobytes()
    return (
        mesh.name,
        len(mesh.vertices),
        len(mesh.polygons),
        matrix_to_array(scan.matrix_world).tobytes(),
        sample,
    )


def scan_job(scan: bpy.types.Object) -> Job[PreparedScan]:
    """Make a scan ready; done at once when it is."""
    signature = scan_signature(scan)
    if STORE.scan is not None and STORE.scan[0] == signature:
        return STORE.scan[1]
    vertices, faces = meshes.read_vertices(scan), meshes.read_faces(scan.data)
    index = yield from part(index_surface_job(vertices, faces, read_colours(scan.data)), 0.0, 0.8)
    yield Progress(0.8, "Preparing clicks")
    prepared = PreparedScan(index, RayCaster(vertices, faces), vertices, faces)
    STORE.scan = signature, prepared
    return prepared


def read_colours(mesh: bpy.types.Mesh) -> ByteArray | None:
    """Colours per vertex (V,3), sRGB, of a scan that has them."""
    attribute = mesh.color_attributes.active_color
    if attribute is None or attribute.domain != "POINT":
        return None
    colours = np.empty(4 * len(mesh.vertices), dtype=np.float32)
    attribute.data.foreach_get("color_srgb", colours)
    return np.clip(colours.reshape(-1, 4)[:, :3] * 255 + 0.5, 0, 255).astype(np.uint8)
