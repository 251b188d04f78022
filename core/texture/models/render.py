"""A neutral renderer: what the textured or plain scan looks like through any central camera.

Every pixel's ray is cast at the mesh and the original photo is sampled at the UV of the point hit, just as
a viewer shows it: UVs are interpolated affinely within a face. Pixels and UVs have the centre of the top-left
pixel at (0, 0).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from ...arrays import ArrayLike, BoolArray, ByteArray, Float32Array, FloatArray, IntArray
from ...cameras.base import Camera
from ...errors import TextureError
from ...geometry.meshes import vertex_normals
from ...geometry.rays import RayCaster
from ...geometry.rigid import camera_centre
from ...jobs import Job, Progress, drain, part
from ...photos.view import View
from ..views.images import full_turn, read_photo, to_bytes, to_linear, to_srgb, view_name

BACKGROUND = (236, 236, 238)
_RAYS_PER_STEP = 1 << 17
_CLAY = np.array([214.0, 205.0, 192.0])


class TexturedFaces(Protocol):
    """The photo and the UVs of every face, as `select_views` returns them."""

    @property
    def view(self) -> IntArray:
        """Photo of every face: (F,), -1 where none."""

    @property
    def uv(self) -> FloatArray:
        """Corners in that photo: (F,3,2) pixels."""

    @property
    def gain(self) -> FloatArray:
        """Linear RGB factors of the photos: (V,3)."""


@dataclass(frozen=True, eq=False)
class PixelHits:
    """What every pixel of a picture sees.

    `face` (H,W) is the face, -1 where the ray hits nothing; `weights` (H,W,3) are the barycentric weights of
    its corners; `rays` (H,W,3) are the unit viewing rays in world axes, NaN outside the camera's field.
    """

    face: IntArray
    weights: Float32Array
    rays: Float32Array


@dataclass(frozen=True, eq=False)
class Rendering:
    """A picture (H,W,3) uint8 RGB, and where it shows the textured surface: `covered` (H,W)."""

    image: ByteArray
    covered: BoolArray


def render_view_job(
    camera: Camera,
    rotation: ArrayLike,
    translation: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    textured: TexturedFaces,
    views: Sequence[View],
    gains: bool = True,
) -> Job[Rendering]:
    """Picture of the textured model through `camera` at the pose `x_cam = rotation @ x_world + translation`.

    `vertices` (V,3) m, `faces` (F,3). Faces without a photo appear as clay and do not count as covered. With
    `gains` the photos are multiplied by `textured.gain` in linear light. Raises TextureError, PhotoError.
    """
    hits = yield from part(
        trace_pixels_job(camera, rotation, translation, vertices, faces), 0.0, 0.5, "Casting rays: "
    )
    shading = shade_textured_job(hits, vertices, faces, textured, views, gains)
    return (yield from part(shading, 0.5, 1.0))


def render_view(
    camera: Camera,
    rotation: ArrayLike,
    translation: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    textured: TexturedFaces,
    views: Sequence[View],
    gains: bool = True,
) -> Rendering:
    """Run `render_view_job` to its end."""
    return drain(render_view_job(camera, rotation, translation, vertices, faces, textured, views, gains))


def trace_pixels_job(
    camera: Camera, rotation: ArrayLike, translation: ArrayLike, vertices: ArrayLike, faces: ArrayLike
) -> Job[PixelHits]:
    """Cast the ray of every pixel of `camera` at the mesh: (V,3) m, (F,3) -> PixelHits."""
    rotation = np.asarray(rotation, dtype=np.float64)
    triangles = np.asarray(faces, dtype=np.int64)
    centre = camera_centre(rotation, translation)
    yield Progress(0.0, "sorting the mesh")
    caster = RayCaster(vertices, triangles)
    local = np.asarray(vertices, dtype=np.float64) - centre
    count = camera.width * camera.height
    face = np.full(count, -1, dtype=np.int32)
    weights = np.zeros((count, 3), dtype=np.float32)
    rays = np.empty((count, 3), dtype=np.float32)
    for start in range(0, count, _RAYS_PER_STEP):
        pixel = np.arange(start, min(start + _RAYS_PER_STEP, count))
        directions = (
            camera.unproject(np.stack([pixel % camera.width, pixel // camera.width], axis=1)) @ rotation
        )
        rays[pixel] = directions
        hit = caster.first_hit(centre, directions).face
        seen = hit >= 0
        face[pixel] = hit
        weights[pixel[seen]] = _barycentric(local[triangles[hit[seen]]], directions[seen])
        yield Progress((start + len(pixel)) / count, f"{min(100, 100 * (start + len(pixel)) // count)} %")
    shape = (camera.height, camera.width)
    return PixelHits(face.reshape(shape), weights.reshape(*shape, 3), rays.reshape(*shape, 3))


def shade_textured_job(
    hits: PixelHits,
    vertices: ArrayLike,
    faces: ArrayLike,
    textured: TexturedFaces,
    views: Sequence[View],
    gains: bool = True,
) -> Job[Rendering]:
    """Colour traced pixels from the photos; one photo is in memory at a time."""
    _check_texture(textured, len(np.asarray(faces)), len(views))
    image = shade_clay(hits, vertices, faces)
    pixel_view = np.where(hits.face >= 0, textured.view[hits.face], -1)
    used = np.unique(pixel_view[pixel_view >= 0])
    for done, index in enumerate(used):
        yield Progress(done / len(used), f"Reading {view_name(views[index], index)}")
        photo = read_photo(views[index], index)
        pixels = pixel_view == index
        uv = np.einsum("nk,nkc->nc", hits.weights[pixels], textured.uv[hits.face[pixels]])
        turn = full_turn(views[index].camera)
        if turn > 0:  # faces across a panorama's seam go on beyond the frame
            photo, uv[:, 0] = np.concatenate([photo, photo[:, :1]], axis=1), np.mod(uv[:, 0], turn)
        colours = sample_bilinear(photo, uv)
        image[pixels] = apply_gain(colours, textured.gain[index]) if gains else np.rint(colours)
    return Rendering(image, pixel_view >= 0)


def shade_clay(hits: PixelHits, vertices: ArrayLike, faces: ArrayLike) -> ByteArray:
    """Colour traced pixels as unpainted clay lit from beside the camera: PixelHits -> (H,W,3) uint8 RGB."""
    normals = vertex_normals(vertices, faces)
    seen = hits.face >= 0
    corners = np.asarray(faces, dtype=np.int64)[hits.face[seen]]
    normal = np.einsum("nk,nkc->nc", hits.weights[seen], normals[corners])
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    towards_viewer = -hits.rays[seen].astype(np.float64)
    facing = np.sum(normal * towards_viewer, axis=1)
    normal *= np.where(facing < 0, -1.0, 1.0)[:, None]  # back faces are lit as if they faced the viewer
    lamp = _lamp_direction(hits.rays)
    light = 0.28 + 0.42 * np.abs(facing) + 0.34 * np.clip(normal @ lamp, 0, 1)
    image = np.empty((*hits.face.shape, 3), dtype=np.uint8)
    image[...] = BACKGROUND
    image[seen] = np.clip(np.rint(light[:, None] * _CLAY), 0, 255)
    return image


def shade_faces(hits: PixelHits, vertices: ArrayLike, faces: ArrayLike, colours: ByteArray) -> ByteArray:
    """Colour traced pixels by face, (F,3) uint8 RGB, in the clay's light and shade: -> (H,W,3) uint8."""
    clay = shade_clay(hits, vertices, faces)
    seen = hits.face >= 0
    light = clay[seen][:, :1] / _CLAY[0]
    clay[seen] = np.clip(np.rint(colours[hits.face[seen]] * light), 0, 255)
    return clay


def sample_bilinear(image: ByteArray, pixels: ArrayLike) -> FloatArray:
    """Bilinear values at pixels, clamped to the frame and not rounded: (H,W,3), (N,2) -> (N,3), 0 to 255."""
    height, width = image.shape[:2]
    at = np.asarray(pixels, dtype=np.float64)
    u, v = np.clip(at[:, 0], 0, width - 1), np.clip(at[:, 1], 0, height - 1)
    left, top = (
        np.minimum(u.astype(np.int64), max(width - 2, 0)),
        np.minimum(v.astype(np.int64), max(height - 2, 0)),
    )
    right, bottom = np.minimum(left + 1, width - 1), np.minimum(top + 1, height - 1)
    fu, fv = (u - left)[:, None], (v - top)[:, None]
    upper = image[top, left] * (1 - fu) + image[top, right] * fu
    lower = image[bottom, left] * (1 - fu) + image[bottom, right] * fu
    values: FloatArray = upper * (1 - fv) + lower * fv
    return values


def apply_gain(colours: FloatArray, gain: ArrayLike) -> ByteArray:
    """Multiply sRGB colours by linear factors: (N,3) 0 to 255, (3,) -> (N,3) uint8."""
    factor = np.asarray(gain, dtype=np.float64)
    if (factor == 1).all():
        return to_bytes(colours / 255.0)
    return to_bytes(to_srgb(to_linear(colours / 255.0) * factor))


def _barycentric(corners: FloatArray, directions: FloatArray) -> FloatArray:
    """Weights of the corners where rays from the origin meet their triangles: (N,3,3), (N,3) -> (N,3).

    The volumes of the tetrahedra spanned by the ray and two corners, in proportion. Source: Moeller and
    Trumbore 1997, eq. 6, in its symmetric form. Rounding at an edge is clipped.
    """
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    volumes = [np.sum(directions * np.cross(p, q), axis=1) for p, q in ((b, c), (c, a), (a, b))]
    weights = np.stack(volumes, axis=1)
    total = weights.sum(axis=1, keepdims=True)
    weights = np.where(total == 0, 1 / 3, weights / np.where(total == 0, 1.0, total))
    weights = np.clip(weights, 0, 1)
    normalised: FloatArray = weights / weights.sum(axis=1, keepdims=True)
    return normalised


def _lamp_direction(rays: Float32Array) -> FloatArray:
    """Direction (3,) to a lamp above the viewer's left shoulder, from the picture's own rays (H,W,3)."""
    rows, columns = np.array(rays.shape[:2]) // 4
    top, bottom = rays[rows, 2 * columns], rays[3 * rows, 2 * columns]
    left, right = rays[2 * rows, columns], rays[2 * rows, 3 * columns]
    lamp = -rays[2 * rows, 2 * columns] + _unit(top - bottom) + _unit(left - right)
    lamp = np.nan_to_num(lamp.astype(np.float64))
    direction: FloatArray = _unit(lamp)
    return direction


def _unit(vector: FloatArray | Float32Array) -> FloatArray:
    length = float(np.linalg.norm(vector))
    unit: FloatArray = vector / length if length > 0 else np.zeros(3)
    return unit


def _check_texture(textured: TexturedFaces, face_count: int, view_count: int) -> None:
    if textured.view.shape != (face_count,) or textured.uv.shape != (face_count, 3, 2):
        raise TextureError(
            f"The texture was made for another mesh: {len(textured.view)} faces instead of {face_count}."
        )
    if face_count and int(textured.view.max()) >= view_count:
        raise TextureError(
            f"A face uses photo {int(textured.view.max())}, but there are only {view_count} photos."
        )
