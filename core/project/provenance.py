"""Where a result comes from: inputs with fingerprints, settings, versions, what became of every photo."""

from __future__ import annotations

import dataclasses
import importlib.metadata
import json
import platform
import tomllib
from collections.abc import Mapping, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import scipy

from ..arrays import FloatArray
from ..cameras.files.dictionary import camera_to_dict
from ..files import replacing
from ..scans.scan import Scan
from .digest import FINGERPRINT, code_digest
from .entries import PhotoEntry, Project
from .stages.photo_pose import PhotoPose, Refinement
from .stages.textures import TexturedScan
from .store import packed

_MANIFEST = Path(__file__).resolve().parents[2] / "blender_manifest.toml"


def fresco_version() -> str:
    """Version of this program: of the extension, else of the installed package."""
    if _MANIFEST.is_file():
        return str(tomllib.loads(_MANIFEST.read_text(encoding="utf-8"))["version"])
    return importlib.metadata.version("fresco")


def provenance(
    project: Project,
    digests: Mapping[Path, str],
    scan: Scan,
    poses: Sequence[PhotoPose],
    textured: TexturedScan | None,
    seconds: Mapping[str, float],
    layers: Mapping[str, TexturedScan] | None = None,
    versions: Mapping[str, str] | None = None,
) -> dict[str, Any]:
    """Everything needed to tell later how a result was made, as plain numbers and texts.

    Poses are in the world of the scan's file, in metres; paths are relative to the project file.
    """
    return {
        "written": datetime.now(UTC).isoformat(timespec="seconds"),
        "versions": {
            "fresco": fresco_version(),
            "code": code_digest(),
            "python": platform.python_version(),
            "numpy": np.__version__,
            "scipy": scipy.__version__,
            "opencv": cv2.__version__,
            **(versions or {}),
        },
        "project": project.path.name,
        "fingerprint": FINGERPRINT,
        "inputs": {_relative(path, project): digests[path] for path in sorted(digests)},
        "settings": {
            "scan": dataclasses.asdict(project.scan.settings),
            "pose": dataclasses.asdict(project.pose),
            "refine": dataclasses.asdict(project.refine),
            "texture": dataclasses.asdict(project.texture),
            "simplify": None if project.simplify is None else dataclasses.asdict(project.simplify),
        },
        "scan": {
            "faces": len(scan.faces),
            "vertices": len(scan.vertices),
            "offset": scan.offset.tolist(),
            "report": list(scan.report),
        },
        "photos": [
            _photo(entry, pose, scan, (layers or {}).get(entry.layer, textured))
            for entry, pose in zip(project.photos, poses, strict=True)
        ],
        "texture": {}
        if textured is None
        else {
            "faces": len(textured.faces),
            "coverage": textured.coverage,
            "photo_per_face": f"{project.output.name}_faces.npz",
        },
        "layers": {
            name: {
                "coverage": one.coverage,
                "photo_per_face": f"{project.output.name}_{name}_faces.npz",
            }
            for name, one in (layers or {}).items()
            if name
        },
        "seconds": {name: round(value, 3) for name, value in seconds.items()},
    }


def write_provenance(path: Path, content: Mapping[str, Any]) -> None:
    """Write provenance as JSON; raises OutputError."""
    with replacing(path) as file:
        file.write(json.dumps(content, indent=1, ensure_ascii=False).encode() + b"\n")


def write_photo_per_face(path: Path, scan: Scan, textured: TexturedScan) -> None:
    """Write which photo every face shows, as .npz; raises OutputError.

    `view` (F,) is an index into `photo_name`, -1 where no photo sees the face; `file_face` (F,) the face of
    the scan's file, counted from 0. Faces are in the order of the OBJ (photo after photo, large
    ones split).
    """
    order = np.argsort(textured.selection.view, kind="stable")
    view = textured.selection.view[order]
    names = np.array([view.name for view in textured.views])
    file_face = scan.file_faces[textured.parent[order]]
    with replacing(path) as file:
        file.write(packed({"view": view, "photo_name": names, "file_face": file_face}))


def world_translation(rotation: FloatArray, translation: FloatArray, offset: FloatArray) -> FloatArray:
    """Translation of a pose for world coordinates, from that for local ones (world = local + offset)."""
    moved: FloatArray = translation - rotation @ offset
    return moved


def local_translation(rotation: FloatArray, translation: FloatArray, offset: FloatArray) -> FloatArray:
    """Translation of a pose for local coordinates, from that for world ones: undoes `world_translation`."""
    moved: FloatArray = translation + rotation @ offset
    return moved


def _photo(entry: PhotoEntry, result: PhotoPose, scan: Scan, textured: TexturedScan | None) -> dict[str, Any]:
    out: dict[str, Any] = {
        "name": entry.photo.name,
        "layer": entry.layer,
        "priority": entry.priority,
        "file": entry.photo.path.name,
        "use": entry.use,
        "camera": camera_to_dict(entry.photo.camera),
        "notes": [*entry.photo.notes, *result.notes],
        "regions": list(result.regions),
        "solved": result.solved,
        "failure": result.failure,
        "faces": 0 if textured is None else _face_count(entry, textured),
    }
    if result.pose is not None:
        pose, sure = result.pose, result.sure_pose
        out["pose"] = {
            "given": result.given,
            "rotation": pose.rotation.tolist(),
            "translation": world_translation(pose.rotation, pose.translation, scan.offset).tolist(),
            "centre": (pose.centre + scan.offset).tolist(),
            "overlap_error": result.overlap_error,
            "rotation_sigma": None if sure is None else sure.rotation_sigma,
            "centre_sigma": None if sure is None else sure.centre_sigma,
            "covariance": None if sure is None else sure.covariance.tolist(),
            "points": [vars(point) for point in result.points],
            "refinements": [_refinement(step, scan) for step in result.refinements],
        }
    return out


def _refinement(step: Refinement, scan: Scan) -> dict[str, Any]:
    """One step of refining: the pose before it, in the world of the scan's file, and what it found."""
    start = step.start
    return {
        "method": step.method,
        "start": {
            "rotation": start.rotation.tolist(),
            "translation": world_translation(start.rotation, start.translation, scan.offset).tolist(),
        },
        "score_before": _number(step.score_before),
        "score_after": _number(step.score_after),
        "count": step.count,
        "note": step.note,
        "lens": step.lens,
        "camera_before": None if step.camera is None else camera_to_dict(step.camera),
    }


def _number(value: float) -> float | None:
    """A number as JSON knows it: nothing where it is not known."""
    return value if np.isfinite(value) else None


def _face_count(entry: PhotoEntry, textured: TexturedScan) -> int:
    numbers = [number for number, view in enumerate(textured.views) if view.name == entry.photo.name]
    return int(np.isin(textured.selection.view, numbers).sum())


def _relative(path: Path, project: Project) -> str:
    folder = project.path.parent
    return (path.relative_to(folder) if path.is_relative_to(folder) else path).as_posix()
