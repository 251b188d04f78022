"""The refinement stage: poses by the edges of the scan, then all photos together; each step is told."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np

from ...arrays import AnyArray, FloatArray
from ...cameras.files.dictionary import camera_to_dict
from ...jobs import Job, Progress, drain, part
from ...photos.photo import Photo
from ...photos.view import View
from ...pose.edges import EdgePose, refine_pose_on_scan_job
from ...pose.edges.rendering import EdgeScan
from ...pose.joint import JointPose, LensFit, TieResiduals, refine_poses_jointly_job
from ...pose.pose import Pose
from ...scans.scan import Scan
from ...settings import EdgeSettings, JointSettings
from ..digest import code_digest, digest, file_digest
from ..store import Store
from .photo_pose import Method, PhotoPose, Refinement, pose_from_dict, pose_to_dict

_HELD = np.diag(np.repeat([1e-6, 1e-5], 3) ** 2)
"""Covariance (rad, m) of a pose that others are tied to and that must not move itself."""

_TIES_ALONG = 30
"""Ties that are kept along the longer side of a photo."""


@dataclass(frozen=True)
class RefineSettings:
    """Which refinements run, and how."""

    edges: EdgeSettings | None = None
    """Every photo by the edges of the scan."""

    joint: JointSettings | None = None
    """All photos together, by what two of them show of the same surface."""

    lenses: bool = False
    """The joint refinement adjusts focal length, principal point and radial distortion of each lens, too."""


def refine_poses(
    scan: Scan,
    photos: Sequence[Photo],
    poses: Sequence[PhotoPose],
    settings: RefineSettings,
    held: Collection[str] = (),
) -> list[PhotoPose]:
    """Run `refine_poses_job` to its end."""
    return drain(refine_poses_job(scan, photos, poses, settings, held))


def refine_poses_job(
    scan: Scan,
    photos: Sequence[Photo],
    poses: Sequence[PhotoPose],
    settings: RefineSettings,
    held: Collection[str] = (),
    store: Store | None = None,
) -> Job[list[PhotoPose]]:
    """Refine the poses of photos on the scan they are in; `photos` and `poses` are in the same order.

    Photos without a usable pose stay as they are. Those named in `held` keep their pose, but the others are
    tied to them. Where lenses are adjusted, see `with_lenses`. With a `store` every finished step is kept and
    taken over when nothing changed. Raises PhotoError for a photo that cannot be read.
    """
    store, found = store or Store(), list(poses)
    mesh = digest(scan.vertices, scan.faces, scan_colours(scan)) if store.folder is not None else ""
    placed = [number for number, pose in enumerate(poses) if pose.solved]
    free = [number for number in placed if poses[number].photo not in held]
    end = 0.5 if settings.joint is not None else 1.0
    if settings.edges is not None:

        @cache
        def ready() -> EdgeScan:
            return EdgeScan.centred(scan.vertices, scan.faces, scan_colours(scan))

        for count, number in enumerate(free):
            photo = photos[number]
            job = _edges_job(ready, mesh, photo, found[number], settings.edges, store)
            span = end * count / len(free), end * (count + 1) / len(free)
            found[number] = yield from part(job, *span, f"{photo.name}: ")
    if settings.joint is not None and free and len(placed) > 1:
        views = [view_of(photos[number], found[number], found[number].photo in held) for number in placed]
        before = [found[number] for number in placed]
        joint = _joint_job(scan, mesh, views, before, settings.joint, settings.lenses, held, store)
        together = yield from part(joint, end if settings.edges is not None else 0.0, 1.0)
        for number, result in zip(placed, together, strict=True):
            found[number] = result
    return found


def view_of(photo: Photo, result: PhotoPose, held: bool = False) -> View:
    """Return a posed photo, `held` with a pose that is sure."""
    assert result.pose is not None
    pose = result.pose
    known = result.sure_pose
    covariance = _HELD if held else None if known is None else known.covariance
    return View(photo.camera, pose.rotation, pose.translation, photo.path, photo.name, photo.mask, covariance)


def _edges_job(
    ready: Callable[[], EdgeScan],
    mesh: str,
    photo: Photo,
    result: PhotoPose,
    settings: EdgeSettings,
    store: Store,
) -> Job[PhotoPose]:
    """Refine one photo on the scan that `ready` prepares once for all photos, when the first one needs it."""
    view = view_of(photo, result)
    yield Progress(0.0, "Looking for a finished refinement")
    key = "" if store.folder is None else digest(code_digest(), mesh, view_key(view), settings)
    saved = store.load(f"edges {photo.name}", key)
    if saved is not None:
        return _taken_over(result, saved)
    pose: EdgePose = yield from refine_pose_on_scan_job(view, ready(), settings)
    step = _stepped(result, pose, "edges", (pose.score_before, pose.score_after), pose.edges, pose.note)
    store.save(f"edges {photo.name}", key, pose_to_dict(step))
    return step


def _joint_job(
    scan: Scan,
    mesh: str,
    views: Sequence[View],
    results: Sequence[PhotoPose],
    settings: JointSettings,
    lenses: bool,
    held: Collection[str],
    store: Store,
) -> Job[list[PhotoPose]]:
    key = ""
    if store.folder is not None:
        keys = []
        for number, view in enumerate(views):
            yield Progress(0.0, f"Looking for a finished refinement of {number + 1} photos")
            keys.append(view_key(view))
        key = digest(code_digest(), mesh, keys, settings, lenses, sorted(held))
    saved = store.load("joint", key)
    if saved is not None:
        before = zip(results, saved["photos"], strict=True)
        return [_taken_over(result, one, result.photo in held) for result, one in before]
    joint = refine_poses_jointly_job(views, scan.vertices, scan.faces, settings, lenses)
    poses: list[JointPose] = yield from joint
    steps = [
        _joint_step(view, result, pose, result.photo in held)
        for view, result, pose in zip(views, results, poses, strict=True)
    ]
    store.save("joint", key, {"photos": [pose_to_dict(step) for step in steps]})
    return steps


def _joint_step(view: View, result: PhotoPose, pose: JointPose, held: bool) -> PhotoPose:
    """Add the joint step; a held photo keeps its pose, but shares the lens that was adjusted."""
    adjusted = pose.camera if pose.lens is not None and not pose.lens.note and not pose.note else None
    if held:
        return result if adjusted is None else replace(result, camera=adjusted)
    shifts = pose.shift_before, pose.shift_after
    step = _stepped(result, pose, "joint", shifts, pose.ties, pose.note)
    told = replace(step.refinements[-1], ties=_told_ties(pose.residuals))
    step = replace(step, refinements=(*step.refinements[:-1], told))
    if pose.lens is None or (pose.note and not pose.lens.note):
        return step
    camera = view.camera if adjusted is not None else None
    last = replace(step.refinements[-1], lens=lens_told(pose.lens), camera=camera)
    refinements = (*step.refinements[:-1], last)
    return replace(step, refinements=refinements, camera=adjusted or result.camera)


def _told_ties(residuals: TieResiduals) -> tuple[tuple[float, float, float, float], ...]:
    """Ties spread over the photo, to a hundredth of a pixel: as many as a picture of them can show."""
    few = residuals.spread(_TIES_ALONG)
    rows = np.round(np.concatenate([few.pixels, few.offsets], axis=1), 2).tolist()
    return tuple((u, v, du, dv) for u, v, du, dv in rows)


def lens_told(lens: LensFit) -> str:
    """Return in words what became of a lens, with standard deviations."""
    if lens.note:
        return lens.note
    change, sigma = lens.change, np.sqrt(np.diag(lens.covariance))
    return (
        f"focal length {100 * change[0]:+.2f} % ± {100 * sigma[0]:.2f} %, principal point "
        f"({change[1]:+.1f}, {change[2]:+.1f}) ± ({sigma[1]:.1f}, {sigma[2]:.1f}) px; known to "
        f"± {lens.pixel_sigma:.2f} px at the border"
    )


def with_lenses(photos: Sequence[Photo], poses: Sequence[PhotoPose]) -> list[Photo]:
    """Photos with the cameras that refinement has adjusted: what uses the poses has to use them, too."""
    pairs = zip(photos, poses, strict=True)
    return [p if pose.camera is None else replace(p, camera=pose.camera) for p, pose in pairs]


def _stepped(
    result: PhotoPose, pose: Pose, method: Method, scores: tuple[float, float], count: int, note: str
) -> PhotoPose:
    """Add a step to what became of a photo; a pose that was kept stays the very same."""
    assert result.pose is not None
    step = Refinement(method, result.pose, float(scores[0]), float(scores[1]), int(count), note)
    moved = Pose(pose.rotation, pose.translation, pose.covariance) if step.moved else result.pose
    return replace(result, pose=moved, refinements=(*result.refinements, step))


def _taken_over(result: PhotoPose, saved: Mapping[str, Any], held: bool = False) -> PhotoPose:
    """Add the last step of a saved result, which started from the same pose; a held one made none."""
    before = pose_from_dict(saved)
    if held:
        return result if before.camera is None else replace(result, camera=before.camera)
    step = before.refinements[-1]
    moved = before.pose if step.moved else result.pose
    return replace(result, pose=moved, refinements=(*result.refinements, step), camera=before.camera)


def restored(result: PhotoPose) -> PhotoPose:
    """Return what became of a photo before its last refinement; the same where there is none."""
    if not result.refinements:
        return result
    step = result.refinements[-1]
    return replace(
        result, pose=step.start, refinements=result.refinements[:-1], camera=step.camera or result.camera
    )


def view_key(view: View) -> str:
    """Fingerprint of a posed photo and its pixels."""
    assert not isinstance(view.image, (str, np.ndarray))
    usable = view.usable
    mask = () if usable is None else usable
    sure: FloatArray | tuple[()] = () if view.covariance is None else view.covariance
    return digest(
        camera_to_dict(view.camera), view.rotation, view.translation, sure, file_digest(view.image), mask
    )


def scan_colours(scan: Scan) -> AnyArray | None:
    """Colours of the scan's vertices, or its intensities from 0 to 1; None where it has neither."""
    if scan.vertex_colors is not None or scan.intensity is None:
        return scan.vertex_colors
    low, high = np.percentile(scan.intensity, [1, 99])
    if not high > low:
        return None
    scaled: FloatArray = np.clip((scan.intensity.astype(np.float64) - low) / (high - low), 0, 1)
    return scaled
