"""Pose of a photo against pictures of the coloured scan: the second step for telephoto shots."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from ...arrays import ArrayLike, ByteArray, FloatArray
from ...cameras import PerspectiveCamera
from ...cameras.base import Camera
from ...errors import PoseNotFound
from ...jobs import Job, Progress, drain, part
from ...photos.view import View
from ...settings import JointSettings, PointSettings
from ..edges.rendering import EdgeScan, render_scan
from ..points.estimate import PointPose, estimate_pose_from_points_job
from ..points.pictures import read_view
from .features import Features, detect_features


@dataclass(frozen=True, eq=False)
class RenderedView:
    """A picture of the textured scan: `image` (H,W,3) RGB, `points` (H,W,3) m that it shows, NaN for none.

    Any renderer will do; the centre of the top-left pixel is (0, 0) in both.
    """

    image: ByteArray
    points: FloatArray


def render_colored_scan(
    camera: Camera,
    rotation: ArrayLike,
    translation: ArrayLike,
    vertices: ArrayLike,
    faces: ArrayLike,
    vertex_colors: ArrayLike,
) -> RenderedView:
    """Picture of a scan with vertex colours (V,3) from a pose (3,3), (3,) m, world to camera."""
    points = np.asarray(vertices, dtype=np.float64)
    origin = points.mean(axis=0)
    turned = np.asarray(rotation, dtype=np.float64)
    centre = -turned.T @ np.asarray(translation, dtype=np.float64) - origin
    seen = render_scan(camera, turned, centre, EdgeScan.of_mesh(points - origin, faces, vertex_colors))
    rows, columns = np.mgrid[0 : camera.height, 0 : camera.width]
    rays = camera.unproject(np.stack([columns.ravel(), rows.ravel()], axis=1).astype(np.float64))
    met = centre + origin + (rays @ turned).reshape(*seen.hit.shape, 3) * seen.distance[..., None]
    assert seen.colors is not None
    colors = np.broadcast_to(seen.colors, (*seen.hit.shape, 3))
    image = np.clip(np.round(colors), 0, 255).astype(np.uint8)
    return RenderedView(image, np.where(seen.hit[..., None], met, np.nan))


def estimate_pose_from_renderings(
    camera: Camera,
    photo: View | ByteArray,
    renderings: Sequence[RenderedView],
    settings: JointSettings | None = None,
) -> PointPose:
    """Pose of a photo from features it shares with pictures of the textured scan.

    `photo`: (H,W,3) RGB, or a view whose pose is not used. The pictures should look roughly the same way as
    the photo and may cover much more. Raises `PoseNotFound` when too few features agree.
    Source: method.md 2.7.
    """
    return drain(estimate_pose_from_renderings_job(camera, photo, renderings, settings))


def estimate_pose_from_renderings_job(
    camera: Camera,
    photo: View | ByteArray,
    renderings: Sequence[RenderedView],
    settings: JointSettings | None = None,
) -> Job[PointPose]:
    """Job of `estimate_pose_from_renderings`."""
    settings = settings or JointSettings()
    image = read_view(photo) if isinstance(photo, View) else photo
    yield Progress(0.0, "Features of the photo")
    of_photo = detect_features(View(camera, np.eye(3), np.zeros(3), image), settings)
    pixels, points = [np.zeros((0, 2))], [np.zeros((0, 3))]
    for number, rendering in enumerate(renderings):
        yield Progress(0.2 + 0.6 * number / len(renderings), f"Matching rendered view {number + 1}")
        found = _matches(of_photo, rendering, settings)
        pixels.append(found[0])
        points.append(found[1])
    if sum(map(len, pixels)) < 8:
        raise PoseNotFound(
            "The photo shares hardly a feature with the rendered views: render the textured scan from nearer "
            "the photo's direction, or pick points by hand."
        )
    search = replace(PointSettings(seed=settings.seed), sigma=2.0, threshold=12.0)
    job = estimate_pose_from_points_job(
        camera, np.concatenate(pixels), np.concatenate(points), settings=search
    )
    return (yield from part(job, 0.8, 1.0))


def _matches(
    of_photo: Features, rendering: RenderedView, settings: JointSettings
) -> tuple[FloatArray, FloatArray]:
    """Pixels (M,2) of the photo and points (M,3) m of the scan that look alike."""
    features, points = _rendered_features(rendering, settings)
    if len(points) < 2 or len(of_photo) < 2:
        return np.zeros((0, 2)), np.zeros((0, 3))
    matcher = cv2.BFMatcher(cv2.NORM_L2)
    pairs = matcher.knnMatch(of_photo.descriptors.astype(np.float32), features.astype(np.float32), 2)
    good = [m for m, second in (p for p in pairs if len(p) == 2) if m.distance < 0.8 * second.distance]
    return of_photo.pixels[[m.queryIdx for m in good]], points[[m.trainIdx for m in good]]


def _rendered_features(rendering: RenderedView, settings: JointSettings) -> tuple[ByteArray, FloatArray]:
    """Descriptors (N,128) of a picture's features and the points (N,3) m they lie on."""
    height, width = rendering.image.shape[:2]
    # a camera of the picture's size: the rays of its features are not used
    pinhole = PerspectiveCamera(width, height, np.diag([width, width, 1.0]))
    usable = np.isfinite(rendering.points[..., 0])
    view = View(pinhole, np.eye(3), np.zeros(3), rendering.image, mask=usable)
    found = detect_features(view, settings)
    column, row = np.clip(np.round(found.pixels).astype(int), 0, [width - 1, height - 1]).T
    points = rendering.points[row, column]
    on_scan = np.isfinite(points[:, 0])
    return found.descriptors[on_scan], points[on_scan]
