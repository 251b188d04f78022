"""The solved cameras for other programs."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from ...cameras.exchange import WRITE_FORMATS, PosedCamera, Reconstruction, write_reconstruction
from ...cameras.files.dictionary import camera_from_dict
from ...errors import OutputError, PoseNotFound
from ...photos.photo import Photo
from ...scans.scan import Scan
from ..provenance import world_translation
from .photo_pose import PhotoPose

FORMATS = WRITE_FORMATS
"""Programs that cameras can be written for."""

_ENDINGS = {
    "colmap": "_colmap",
    "colmap-binary": "_colmap_binary",
    "metashape": "_metashape.xml",
    "realityscan-xmp": "_realityscan",
    "realityscan-csv": "_realityscan.csv",
    "bundler": "_bundler/bundle.out",
}


def solved_cameras(photos: Sequence[Photo], poses: Sequence[PhotoPose], scan: Scan) -> Reconstruction:
    """Photos with their poses in the world of the scan's file. Raises PoseNotFound when there is none."""
    cameras = []
    for photo, result in zip(photos, poses, strict=True):
        if result.solved and result.pose is not None:
            rotation = result.pose.rotation
            translation = world_translation(rotation, result.pose.translation, scan.offset)
            cameras.append(PosedCamera(photo.path.name, photo.camera, rotation, translation))
    solved = {pose.photo for pose in poses if pose.solved}
    return _some(cameras, [photo.path.name for photo in photos if photo.name not in solved])


def recorded_cameras(record: Path) -> Reconstruction:
    """Photos with their poses from the provenance of a run. Raises OutputError when there was none."""
    try:
        content: dict[str, Any] = json.loads(record.read_text(encoding="utf-8"))
        photos = content["photos"]
    except (OSError, ValueError, KeyError) as error:
        raise OutputError(f"{record} is not there: run the project first (fresco run).") from error
    cameras = [
        PosedCamera(
            photo["file"],
            camera_from_dict(photo["camera"]),
            np.array(photo["pose"]["rotation"]),
            np.array(photo["pose"]["translation"]),
        )
        for photo in photos
        if photo["solved"]
    ]
    return _some(cameras, [photo["file"] for photo in photos if not photo["solved"]])


def cameras_path(folder: Path, name: str, file_format: str) -> Path:
    """Where cameras for another program are written."""
    return folder / (name + _ENDINGS[file_format])


def write_cameras(path: Path, reconstruction: Reconstruction, file_format: str) -> Path:
    """Write cameras for another program; return the path. Raises CameraError, OutputError."""
    write_reconstruction(path, reconstruction, file_format)
    return path


def check_exportable(photos: Sequence[Photo], formats: Sequence[str]) -> None:
    """Try formats on the cameras, before anything is computed. Raises CameraError where one has no model."""
    cameras = [PosedCamera(photo.path.name, photo.camera, np.eye(3), np.zeros(3)) for photo in photos]
    with TemporaryDirectory() as folder:
        for file_format in formats:
            write_cameras(cameras_path(Path(folder), "trial", file_format), _some(cameras, []), file_format)


def _some(cameras: list[PosedCamera], unposed: list[str]) -> Reconstruction:
    if not cameras:
        raise PoseNotFound("No photo has a pose: there are no cameras to write.")
    return Reconstruction(tuple(cameras), unposed=tuple(unposed))
