"""Telephoto shots, which show too little for regions: posed by what they share with photos placed already.

A placed photo is the textured scan as seen from where it was taken, without any loss; so it stands for the
rendered view of it, and the scan tells the point behind each of its pixels.
"""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import replace

import numpy as np

from ...arrays import FloatArray
from ...errors import PoseNotFound
from ...geometry.rays import RayCaster
from ...geometry.rigid import skew
from ...jobs import Job, Progress, part
from ...photos.image import read_image
from ...photos.photo import Photo
from ...pose.joint.rendered import RenderedView, estimate_pose_from_renderings_job
from ...pose.pose import Pose
from ...scans.scan import Scan
from .photo_pose import PhotoPose

_SIZE = 1600
"""Longer side (pixels) of the placed photos as they are matched."""
_MOST = 8
"""Placed photos that a telephoto shot is compared with; each takes about 60 MB for a while."""


def pose_telephoto_job(
    scan: Scan, photos: Sequence[Photo], poses: Sequence[PhotoPose], wanted: Collection[str]
) -> Job[list[PhotoPose]]:
    """Find the poses of the photos named in `wanted` by the others; `photos` and `poses` go in one order.

    A photo that shares too little keeps what it has and says why. Raises PhotoError for a photo that cannot
    be read. Source: method.md 2.7, the second step for telephoto shots.
    """
    placed = [n for n, pose in enumerate(poses) if pose.solved and pose.photo not in wanted][:_MOST]
    tasks = [n for n, pose in enumerate(poses) if pose.photo in wanted]
    found = list(poses)
    if not tasks:
        return found
    if not placed:
        reason = "No other photo is placed yet that it could be compared with."
        return [replace(p, failure=reason) if p.photo in wanted and not p.solved else p for p in found]
    caster = RayCaster(scan.vertices, scan.faces)
    pictures = []
    for count, number in enumerate(placed):
        yield Progress(0.4 * count / len(placed), f"Meeting the scan with {photos[number].name}")
        pictures.append(_picture(caster, photos[number], poses[number].pose))
    for count, number in enumerate(tasks):
        span = 0.4 + 0.6 * count / len(tasks), 0.4 + 0.6 * (count + 1) / len(tasks)
        photo = photos[number]
        yield Progress(span[0], f"Comparing {photo.name}")
        job = estimate_pose_from_renderings_job(photo.camera, read_image(photo.path), pictures)
        try:
            pose = yield from part(job, *span, f"{photo.name}: ")
        except PoseNotFound as error:
            found[number] = _failed(found[number], str(error))
            continue
        note = f"Placed by {int(pose.inliers.sum())} features that it shares with {len(placed)} other photos."
        own = Pose(pose.rotation, pose.translation, pose.covariance)
        standing_on = [other for n in placed if (other := poses[n].pose) is not None]
        plain = replace(own, covariance=own.covariance + inherited_covariance(own, standing_on))
        found[number] = PhotoPose(photo.name, plain, notes=(note,))
    return found


def inherited_covariance(pose: Pose, others: Sequence[Pose]) -> FloatArray:
    """Covariance (6,6) that a pose takes over from the photos it was found by, each as if tied to it rigidly.

    The mean over them: it bounds the covariance of their mean, however their errors go together. Poses
    of unknown covariance, which were given, count as exact.
    """
    total = np.zeros((6, 6))
    for other in others:
        if np.isfinite(other.covariance).all():
            turn = other.rotation.T
            lever = skew(pose.centre - other.centre) @ turn
            moved = np.block([[pose.rotation @ turn, np.zeros((3, 3))], [lever, np.eye(3)]])
            total += moved @ other.covariance @ moved.T
    return total / max(1, len(others))


def _failed(before: PhotoPose, reason: str) -> PhotoPose:
    if before.solved:
        return replace(before, notes=(*before.notes, f"Not placed by other photos: {reason}"))
    return replace(before, pose=None, failure=reason)


def _picture(caster: RayCaster, photo: Photo, pose: Pose | None) -> RenderedView:
    """Return a placed photo as a picture of the textured scan, with the point behind every pixel."""
    assert pose is not None
    factor = min(1.0, _SIZE / max(photo.camera.width, photo.camera.height))
    image = read_image(photo.path, factor)
    height, width = image.shape[:2]
    camera = photo.camera.resized(width, height)
    points: FloatArray = np.full((height, width, 3), np.nan)
    columns = np.arange(width, dtype=np.float64)
    for top in range(0, height, 64):
        rows = np.arange(top, min(top + 64, height), dtype=np.float64)
        pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
        rays = camera.unproject(pixels) @ pose.rotation
        hits = caster.first_hit(pose.centre, rays)
        met = np.where(hits.face[:, None] >= 0, pose.centre + rays * hits.distance[:, None], np.nan)
        points[top : top + len(rows)] = met.reshape(len(rows), width, 3)
    return RenderedView(image, points)
