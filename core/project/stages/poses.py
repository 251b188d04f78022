"""The pose stage: every photo from its regions; a photo that fails says why and does not stop the others."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ...arrays import ArrayLike, BoolArray
from ...cameras.files.dictionary import camera_to_dict
from ...errors import PoseNotFound, RegionError
from ...jobs import Job, Progress, drain, part
from ...photos.marks import RegionMark, touches_frame
from ...photos.photo import Photo
from ...pose.regions.estimate import estimate_pose_job
from ...pose.regions.region_pose import RegionPose
from ...regions.image_region import ImageRegion
from ...regions.surface_region import SurfaceRegion
from ...settings import PoseSettings
from ..digest import code_digest, digest
from ..store import Store
from .photo_pose import PhotoPose, pose_from_dict, pose_to_dict


def solve_poses(
    photos: Sequence[Photo],
    surfaces: Mapping[str, SurfaceRegion],
    settings: PoseSettings | None = None,
    up: ArrayLike | None = None,
) -> list[PhotoPose]:
    """Run `solve_poses_job` to its end."""
    return drain(solve_poses_job(photos, surfaces, settings, up))


def solve_poses_job(
    photos: Sequence[Photo],
    surfaces: Mapping[str, SurfaceRegion],
    settings: PoseSettings | None = None,
    up: ArrayLike | None = None,
    store: Store | None = None,
) -> Job[list[PhotoPose]]:
    """Find the pose of every photo from its marked regions.

    `surfaces` are the scan's regions by name, in the coordinates the poses shall be in. `up` (3,) is the
    direction there that points up in photos that were not turned. With a `store` every photo's result is kept
    as soon as it is there, and taken over when nothing changed.
    """
    settings, store = settings or PoseSettings(), store or Store()
    surface_digests = {name: digest(s.vertices, s.faces) for name, s in surfaces.items()}
    results = []
    for number, photo in enumerate(photos):
        yield Progress(number / max(len(photos), 1), f"Finding the camera of {photo.name}")
        try:
            images, notes = _read_regions(photo, surfaces)
        except RegionError as error:
            results.append(PhotoPose(photo.name, None, str(error)))
            continue
        key = _key(photo, images, surface_digests, settings, up)
        saved = store.load(f"pose {photo.name}", key)
        if saved is not None:
            results.append(pose_from_dict(saved))
            continue
        partners = [surfaces[image.name] for image in images]
        job = _solve_job(photo, images, partners, settings, up, notes)
        results.append(
            (yield from part(job, number / len(photos), (number + 1) / len(photos), f"{photo.name}: "))
        )
        store.save(f"pose {photo.name}", key, pose_to_dict(results[-1]))
    return results


def _read_regions(
    photo: Photo, surfaces: Mapping[str, SurfaceRegion]
) -> tuple[list[ImageRegion], tuple[str, ...]]:
    """Regions of a photo that have a partner on the scan, and sentences on those that are not used whole.

    Raises RegionError when a mark cannot be read or none can be used.
    """
    images, notes = [], []
    for mark in photo.regions:
        if mark.name not in surfaces:
            notes.append(f"Region “{mark.name}” has no partner on the scan.")
            continue
        mask = mark.read_mask(photo.camera.width, photo.camera.height)
        if mask is not None and touches_frame(mask):
            notes.append(f"Region “{mark.name}” is cut off by the frame: only its outline inside is used.")
        hidden = mark.read_hidden(photo.camera.width, photo.camera.height)
        images.append(_image_region(mark, mask, hidden))
    if not images:
        told = " ".join(notes) or "No region is marked in this photo."
        raise RegionError(f"{told} Mark a region in the photo and on the scan.")
    return images, tuple(notes)


def _image_region(mark: RegionMark, mask: BoolArray | None, hidden: BoolArray | None) -> ImageRegion:
    if mask is not None:
        return ImageRegion.from_mask(mask, mark.name, hidden)
    assert mark.outline is not None  # a mark without mask is a polygon
    return replace(ImageRegion.from_polygon(mark.outline, mark.holes, mark.name), hidden=hidden)


def _solve_job(
    photo: Photo,
    images: list[ImageRegion],
    partners: list[SurfaceRegion],
    settings: PoseSettings,
    up: ArrayLike | None,
    notes: tuple[str, ...],
) -> Job[PhotoPose]:
    start = time.perf_counter()
    pose: RegionPose | None = None
    try:
        # In a photo that was turned the tag tells that up is elsewhere in the stored pixels.
        upright = up if photo.exif.orientation == 1 else None
        pose = yield from estimate_pose_job(photo.camera, images, partners, up=upright, settings=settings)
        failure, notes = ambiguity(pose), (*notes, *pose.remarks)
    except (PoseNotFound, RegionError) as error:
        failure = str(error)
    names = tuple(image.name for image in images)
    return PhotoPose(photo.name, pose, failure, names, notes, False, time.perf_counter() - start)


def ambiguity(pose: RegionPose) -> str:
    """Why a pose does not count although it fits; empty when it does."""
    if not pose.ambiguous:
        return ""
    return f"The regions alone do not decide: {pose.reason}. A region on another wall helps most."


def _key(
    photo: Photo,
    images: Sequence[ImageRegion],
    surfaces: Mapping[str, str],
    settings: PoseSettings,
    up: ArrayLike | None,
) -> str:
    """Fingerprint of all that the pose depends on; the pixels of the photo are not among it."""
    outlines = [
        (image.name, image.frame, list(image.loops), image.hidden, surfaces[image.name]) for image in images
    ]
    upward = np.asarray(() if up is None else up)
    return digest(code_digest(), camera_to_dict(photo.camera), outlines, settings, upward)
