"""Regions of the scan as the project names them."""

from __future__ import annotations

import zipfile
from collections.abc import Iterable, Mapping
from pathlib import Path

import numpy as np

from ...arrays import AnyArray, IntArray
from ...errors import ProjectError, RegionError
from ...regions.surface.cloud_region import cloud_region
from ...regions.surface.files import found_again, read_face_regions
from ...regions.surface.opening import opening_region
from ...regions.surface_region import SurfaceRegion
from ...scans.scan import Scan
from ..entries import LabelSource, Project
from ..file.table import hint


def region_faces(project: Project, scan: Scan) -> dict[str, IntArray]:
    """Face indices of every region of the project; of a point cloud, its point indices.

    Raises ProjectError for label arrays that do not fit the scan, unknown face
    sets, empty regions, and kept ones that are not in the scan.
    """
    entries = project.regions
    found: dict[str, IntArray] = dict(scan.face_sets) if entries.all_face_sets else {}
    for name, face_set in entries.face_sets.items():
        if face_set not in scan.face_sets:
            reason = f"the scan has no face set “{face_set}”{hint(face_set, scan.face_sets)}"
            raise ProjectError(project.path, f"region.{name}", reason)
        found[name] = scan.face_sets[face_set]
    for source in entries.labels:
        found.update(_labelled(project.path, source, scan))
    if entries.kept is not None:
        found.update(_found_again(project.path, entries.kept, scan))
    for name, faces in found.items():
        if len(faces) == 0:
            raise ProjectError(
                project.path, f"region.{name}", f"no {_element(scan)} of {scan.name} belongs to it"
            )
    return found


def _element(scan: Scan) -> str:
    """What the numbers of a region count."""
    return "point" if scan.is_cloud else "face"


def _file_elements(scan: Scan) -> tuple[IntArray, int]:
    """Number in the file of every face (or point) of the scan, and how many the file has."""
    if not scan.is_cloud:
        return scan.file_faces, scan.file_face_count
    return np.arange(len(scan.vertices), dtype=np.int32), len(scan.vertices)


def _found_again(project: Path, kept: Path, scan: Scan) -> dict[str, IntArray]:
    vertices = scan.vertices + scan.offset
    try:
        regions = read_face_regions(kept)
        return {r.name: found_again(r, vertices, scan.faces).astype(np.int32) for r in regions}
    except RegionError as error:
        raise ProjectError(project, "regions.kept", str(error)) from error


def _labelled(project: Path, source: LabelSource, scan: Scan) -> dict[str, IntArray]:
    array = _read_array(project, source)
    elements, count = _file_elements(scan)
    if source.names:
        if array.shape != (count,):
            reason = (
                f"{source.path.name} holds labels of shape {array.shape}, but the scan's file has "
                f"{count} {_element(scan)}s"
            )
            raise ProjectError(project, "regions.labels", reason)
        labels = array[elements]
        return {name: np.flatnonzero(labels == n).astype(np.int32) for n, name in source.names.items()}
    if scan.is_cloud:  # points may have been dropped; a number for each would tell, a list of indices not
        reason = "names faces of a mesh; mark the points of a cloud by labels, a number for each"
        raise ProjectError(project, f"region.{source.name}", reason)
    chosen = np.zeros(count, dtype=np.bool_)
    if array.ndim != 1 or (array.size and not 0 <= int(array.min()) <= int(array.max()) < len(chosen)):
        reason = f"{source.path.name} has to hold face indices from 0 to {len(chosen) - 1}"
        raise ProjectError(project, f"region.{source.name}", reason)
    chosen[array] = True
    return {source.name: np.flatnonzero(chosen[elements]).astype(np.int32)}


def _read_array(project: Path, source: LabelSource) -> AnyArray:
    """Whole numbers of a .npy or .npz file."""
    key = "regions.labels" if source.names else f"region.{source.name}"
    try:
        content = np.load(source.path, allow_pickle=False)
        if isinstance(content, np.lib.npyio.NpzFile):
            with content:
                array = content[_array_name(project, source, content.files)]
        else:
            array = content
    except OSError as error:
        reason = f"{source.path} cannot be read ({error.strerror or error})"
        raise ProjectError(project, key, reason) from error
    except (ValueError, EOFError, zipfile.BadZipFile) as error:
        reason = (
            f"{source.path} is damaged, or no array that numpy wrote; write it again with numpy.save or savez"
        )
        raise ProjectError(project, key, reason) from error
    if not np.issubdtype(array.dtype, np.integer):
        raise ProjectError(project, key, f"{source.path.name} has to hold whole numbers, not {array.dtype}")
    numbers: AnyArray = array
    return numbers


def _array_name(project: Path, source: LabelSource, names: list[str]) -> str:
    if source.key in names:
        return source.key
    if not source.key and len(names) == 1:
        return names[0]
    reason = f"{source.path.name} has no array “{source.key}”{hint(source.key, names)}"
    if not source.key:
        reason = f"{source.path.name} holds several arrays; name one: {', '.join(names)}"
    raise ProjectError(project, "regions.key" if source.names else f"region.{source.name}.key", reason)


def surface_regions(scan: Scan, faces: Mapping[str, IntArray]) -> dict[str, SurfaceRegion]:
    """Surface regions in the scan's local coordinates, each with the vertices it needs.

    The points of a cloud get an outline. Raises RegionError for a region without area or without outline.
    """
    if scan.is_cloud:
        return {name: cloud_region(scan.vertices[chosen], name) for name, chosen in faces.items()}
    surfaces = {}
    for name, chosen in faces.items():
        used, corners = np.unique(scan.faces[chosen].ravel(), return_inverse=True)
        surfaces[name] = SurfaceRegion(scan.vertices[used], corners.reshape(-1, 3), name)
    return surfaces


def opening_regions(project: Project, scan: Scan) -> dict[str, SurfaceRegion]:
    """Return the openings of a project in the scan's local coordinates. Raises ProjectError."""
    found = {}
    for name, corners in project.regions.outlines.items():
        try:
            found[name] = opening_region(corners - scan.offset, name)
        except RegionError as error:
            raise ProjectError(project.path, f"region.{name}.outline", str(error)) from error
    return found


def check_partners(project: Project, surfaces: Iterable[str]) -> None:
    """Refuse marks whose region the scan does not have: a misspelt name must not silently lose its region."""
    names = {*surfaces, *project.regions.unplaced}
    for entry in project.photos:
        for mark in entry.photo.regions:
            if mark.name not in names:
                where = mark.path or f"a polygon of {entry.photo.name}"
                reason = (
                    f"{where} marks “{mark.name}”, but the scan has no such region{hint(mark.name, names)}"
                )
                raise ProjectError(project.path, "photo.regions", reason)
