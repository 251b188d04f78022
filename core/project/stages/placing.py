"""Brings cameras of another program onto the scan: seven parameters from poses, points or the surface."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ...arrays import FloatArray
from ...cameras.exchange import Reconstruction
from ...errors import PoseNotFound
from ...geometry.meshes import vertex_normals
from ...geometry.rigid import exp_so3
from ...pose.joint.similarity import Similarity, estimate_similarity, similarity_from_poses
from ...pose.points.smoothing import averaged_normals
from ...pose.points.survey import read_survey
from ...pose.pose import Pose
from ...scans.icp import surface_normals
from ...scans.scan import Scan
from ..entries import PhotoEntry
from ..imported import ImportedCameras
from .photo_pose import PhotoPose

_ROUNDS = 60
_LEAST_POINTS = 60
_REACH = 0.03
"""Distance, in parts of the points' spread, within which a point is paired with the scan at first."""
_HELD = 2e-3
"""Smallest eigenvalue of the normalised equations at which the surface holds the points; the noise of a plain
wall's normals gives a tenth of it."""
_AVERAGED = 6
"""Rounds of averaging normals, so that noise does not pass for relief that holds the points."""


@dataclass(frozen=True, eq=False)
class Placed:
    """A similarity into the scan's local coordinates, and a sentence that says what it rests on."""

    scale: float
    rotation: FloatArray
    translation: FloatArray
    note: str

    def pose(self, rotation: FloatArray, translation: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Pose (3,3), (3,) on the scan of a camera of the other world."""
        turned = rotation @ self.rotation.T
        return turned, self.scale * translation - turned @ self.translation


def place_cameras(
    imported: ImportedCameras,
    entries: Sequence[PhotoEntry],
    solved: Mapping[str, PhotoPose],
    scan: Scan,
) -> dict[str, PhotoPose]:
    """Poses on the scan of the photos whose cameras were imported, by name. Raises PoseNotFound."""
    cameras = {entry.photo.name: entry.imported for entry in entries if entry.imported is not None}
    known = {name: one.pose for name, one in solved.items() if one.solved and one.pose is not None}
    placed = place(imported, cameras, known, scan)
    return {name: unsure(name, placed, *pose) for name, pose in cameras.items()}


def unsure(name: str, placed: Placed, rotation: FloatArray, translation: FloatArray) -> PhotoPose:
    """Return a camera of the other world as a given pose on the scan; how sure it is, nobody knows."""
    pose = Pose(*placed.pose(rotation, translation), np.full((6, 6), np.nan))
    return PhotoPose(name, pose, notes=(placed.note,) if placed.note else (), given=True)


def place(
    imported: ImportedCameras,
    cameras: Mapping[str, tuple[FloatArray, FloatArray]],
    known: Mapping[str, Pose],
    scan: Scan,
) -> Placed:
    """Find the similarity that brings imported cameras onto the scan, the way that was asked for.

    `cameras` are poses in the other world, `known` poses on the scan, both by the photo's name.
    """
    same = (1.0, np.eye(3), np.zeros(3))
    if imported.placing == "poses":
        return place_by_poses(cameras, known)
    if imported.placing == "points":
        assert imported.points is not None  # read with the table
        return place_by_points(*imported.points, scan)
    start = place_by_matrix(*(imported.given or same), scan)
    return place_on_surface(imported.reconstruction, scan, start) if imported.placing == "surface" else start


def place_by_matrix(scale: float, rotation: FloatArray, translation: FloatArray, scan: Scan) -> Placed:
    """Return a similarity that was given for the world of the scan's file."""
    return Placed(scale, rotation, translation - scan.offset, "")


def place_by_poses(cameras: Mapping[str, tuple[FloatArray, FloatArray]], poses: Mapping[str, Pose]) -> Placed:
    """Find the similarity from photos that have a pose in both worlds, by name.

    Raises PoseNotFound for fewer than three, or such that stand on one line.
    """
    names = sorted(cameras.keys() & poses.keys())
    if len(names) < 3:
        raise PoseNotFound(
            f"Only {len(names)} of the imported photos found their place by regions: at least three are "
            "needed to bring the others onto the scan. Mark regions in more of them."
        )
    centres = np.array([poses[name].centre for name in names])
    distance = float(np.linalg.norm(centres - centres.mean(axis=0), axis=1).mean())
    # poses from regions are known to about half a percent of the distance; wrong ones are far beyond
    threshold = max(0.05, 0.05 * distance)
    found = similarity_from_poses([cameras[n] for n in names], [poses[n] for n in names], threshold)
    return _told(found, "photos that have a pose of their own")


def place_by_points(other: Path, scan_points: Path, scan: Scan) -> Placed:
    """Find the similarity from two tables of points, matched by name; those of the scan in its file's world.

    Raises PoseNotFound for fewer than three common points, or points that contradict each other.
    """
    theirs, ours = read_survey(other), read_survey(scan_points)
    names = [name for name in theirs.names if name in ours.names]
    if len(names) < 3:
        raise PoseNotFound(
            f"{other.name} and {scan_points.name} have {len(names)} names in common: at least three points "
            "are needed to bring the cameras onto the scan."
        )
    a = theirs.points[[theirs.names.index(name) for name in names]]
    b = ours.points[[ours.names.index(name) for name in names]] - scan.offset
    size = float(np.linalg.norm(np.ptp(b, axis=0)))
    return _told(estimate_similarity(a, b, threshold=max(0.02, 0.01 * size)), "points")


def place_on_surface(reconstruction: Reconstruction, scan: Scan, start: Placed) -> Placed:
    """Improve a similarity until the sparse points lie on the surface of the scan.

    Raises PoseNotFound when there are too few points, they do not meet the scan, or the surface leaves the
    similarity open. Source: point-to-plane ICP (Chen and Medioni 1992) with a free scale, weights of Tukey.
    """
    points = reconstruction.points
    if len(points) < _LEAST_POINTS:
        raise PoseNotFound(
            f"The cameras come with {len(points)} points: too few to lay them onto the scan's surface."
        )
    tree = cKDTree(scan.vertices)
    normals = _surface_normals(scan, tree)
    moved = start.scale * points @ start.rotation.T + start.translation
    spread = float(np.median(np.linalg.norm(moved - np.median(moved, axis=0), axis=1)))
    scale, rotation, translation, reach = start.scale, start.rotation, start.translation, _REACH * spread
    sigma = reach
    for _ in range(_ROUNDS):
        moved = scale * points @ rotation.T + translation
        near = _near(tree, moved, normals, scan.vertices, reach)
        step, sigma = _step(*near)
        centre = near[0].mean(axis=0)
        turn, grow, shift = exp_so3(step[:3]), 1 + step[3], step[4:]
        rotation, scale = turn @ rotation, grow * scale
        translation = grow * turn @ (translation - centre) + centre + shift
        if np.linalg.norm(step[4:]) + spread * np.linalg.norm(step[:4]) < 1e-3 * sigma:
            break
        reach = max(0.8 * reach, 5 * sigma)
    share = len(near[0]) / len(points)
    note = f"{100 * share:.0f} % of its points lie on the scan, ± {1000 * sigma:.0f} mm."
    return Placed(scale, rotation, translation, f"{start.note} {note}".strip())


def _surface_normals(scan: Scan, tree: cKDTree) -> FloatArray:
    """Unit normals (V,3) at the scan's vertices; those of a cloud point to either side."""
    if scan.is_cloud:
        return surface_normals(scan.vertices, tree)
    faces = scan.faces.astype(np.int64)
    return averaged_normals(vertex_normals(scan.vertices, faces), faces, _AVERAGED)


def _near(
    tree: cKDTree, moved: FloatArray, normals: FloatArray, vertices: FloatArray, reach: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points (N,3) that the scan is near to, its normals (N,3) there, and the distances (N,) along them."""
    _, index = tree.query(moved)
    off = moved - vertices[index]
    # between coarse vertices a point may be far from the next one and yet on the surface
    height = np.einsum("nk,nk->n", off, normals[index])
    flat = np.linalg.norm(off - height[:, None] * normals[index], axis=1)
    near = (np.abs(height) < reach) & (flat < 4 * reach)
    if near.sum() < _LEAST_POINTS:
        raise PoseNotFound(
            "The points that come with the cameras do not meet the scan: place the cameras by poses or by "
            "points, and check the unit."
        )
    return moved[near], normals[index][near], height[near]


def _step(points: FloatArray, normals: FloatArray, height: FloatArray) -> tuple[FloatArray, float]:
    """Turn (rad), growth and shift (m) (7,) that close the distances; the scale (m) of what remains."""
    local = points - points.mean(axis=0)
    radius = float(np.sqrt((local**2).sum(axis=1).mean()))
    along = np.einsum("nk,nk->n", local, normals)
    rows = np.column_stack([np.cross(local, normals) / radius, along / radius, normals])
    sigma = max(1.4826 * float(np.median(np.abs(height))), 1e-6)
    weight = np.clip(1 - (height / (4.685 * sigma)) ** 2, 0, None) ** 2
    matrix = (rows * weight[:, None]).T @ rows / float(weight.sum())
    if np.linalg.eigvalsh(matrix)[0] < _HELD:
        raise PoseNotFound(
            "The scan's surface leaves open how the cameras lie on it (a plain wall or floor): place them by "
            "poses or by points."
        )
    solution = np.linalg.solve(matrix, -(rows * (weight * height)[:, None]).sum(axis=0) / float(weight.sum()))
    solution[:4] /= radius
    return solution, sigma


def _told(found: Similarity, what: str) -> Placed:
    note = (
        f"Placed on the scan by {int(found.inliers.sum())} of {len(found.inliers)} {what}, "
        f"± {1000 * found.sigma:.0f} mm, scale {found.scale:.6g}."
    )
    return Placed(found.scale, found.rotation, found.translation, note)
