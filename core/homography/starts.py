"""Where the adjustment of cameras and planes starts: cameras turned onto each other, maps decomposed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from ..arrays import BoolArray, FloatArray
from ..errors import PoseNotFound
from ..geometry.rigid import rotation_angle
from .estimate import rough_homographies
from .network import Link, Network
from .relative import RelativePose, relative_poses_from_homography
from .views import RegionView

Maps = dict[Link, list[FloatArray]]
"""Homographies that explain a link's two outlines, best first."""


def maps_of(links: Sequence[Link]) -> Maps:
    """The homographies, by moments, of every link whose outlines have one."""
    found = {link: rough_homographies(*link.views) for link in links}
    return {link: maps for link, maps in found.items() if maps}


def carried_rays(rays: FloatArray, matrix: FloatArray) -> FloatArray:
    """Unit rays (n,3) where a homography carries rays (n,3)."""
    mapped = rays @ matrix.T
    carried: FloatArray = mapped / np.linalg.norm(mapped, axis=1, keepdims=True)
    return carried


def turned_start(
    views: Sequence[Sequence[RegionView | None]], maps: Maps, reference: int
) -> tuple[Network, BoolArray]:
    """Cameras that have only turned, planes that face the reference at distance 1; which cameras are linked.

    Rotations bring regions onto each other as their homographies do.
    """
    rotations = np.tile(np.eye(3), (len(views), 1, 1))
    known = np.zeros(len(views), dtype=np.bool_)
    known[reference] = True
    turns = _turns(maps)
    while True:
        open_links = [link for link in turns if known[link[0]] != known[link[1]]]
        if not open_links:
            break
        first, second = max(open_links, key=lambda link: turns[link][1])
        turn = turns[first, second][0]
        if known[first]:
            rotations[second] = turn @ rotations[first]
        else:
            rotations[first] = turn.T @ rotations[second]
        known[first] = known[second] = True
    normals = np.full((len(views[0]), 3), np.nan)
    for link in maps:
        if known[link.first] and np.isnan(normals[link.plane, 0]):
            normals[link.plane] = rotations[link.first].T @ link.views[0].middle
    translations = np.where(known[:, None], np.zeros((len(views), 3)), np.nan)
    return Network(rotations, translations, normals, reference), known


Carried = tuple[FloatArray, FloatArray]


def _turns(maps: Maps) -> dict[tuple[int, int], tuple[FloatArray, int]]:
    """Rotation between linked cameras that brings their regions nearest to each other, and of how many.

    A region may fit itself in several ways: the one counts that the other regions agree with best.
    """
    ways: dict[tuple[int, int], list[list[Carried]]] = {}
    for link, matrices in maps.items():
        rays = link.views[0].rays
        carried = [(rays, carried_rays(rays, matrix)) for matrix in matrices]
        ways.setdefault((link.first, link.second), []).append(carried)
    return {pair: (_common_turn(regions), len(regions)) for pair, regions in ways.items()}


def _common_turn(regions: Sequence[Sequence[Carried]]) -> FloatArray:
    """Rotation (3,3) that fits one way of every region, and all of these best."""
    best, least = np.eye(3), np.inf
    for way in (way for region in regions for way in region):
        turn = _turn([way])
        chosen = [min(region, key=lambda carried: _misfit(turn, carried)) for region in regions]
        turn = _turn(chosen)
        misfit = sum(_misfit(turn, carried) for carried in chosen)
        if misfit < least:
            best, least = turn, misfit
    return best


def _turn(parts: Sequence[Carried]) -> FloatArray:
    seen, mapped = (np.concatenate([part[side] for part in parts]) for side in (0, 1))
    turn: FloatArray = Rotation.align_vectors(mapped, seen)[0].as_matrix()
    return turn


def _misfit(turn: FloatArray, carried: Carried) -> float:
    seen, mapped = carried
    return float(np.sum((seen @ turn.T - mapped) ** 2))


def decomposed_start(start: Network, maps: Maps) -> Network:
    """Cameras and planes from the decompositions of the homographies that the reference takes part in.

    Every homography has two: those count whose normals agree with the other cameras' and whose rotations
    agree with the other planes'. Translations and planes are then what is left of all together, a matrix of
    rank one (Source: method.md 5.1 and 5.3).
    """
    poses = {
        (link.second, link.plane): _poses(link, matrices)
        for link, matrices in maps.items()
        if link.first == start.reference
    }
    normals = {plane: _agreed_normal(poses, plane) for plane in {plane for _, plane in poses}}
    rotations = start.rotations.copy()
    rest = np.full((len(rotations), 3, len(start.inverse_normals), 3), np.nan)
    for camera in {camera for camera, _ in poses}:
        found = {
            plane: several for (seen_by, plane), several in poses.items() if seen_by == camera and several
        }
        if not found:
            continue
        candidates = [pose.rotation for several in found.values() for pose in several]
        turn = min(candidates, key=lambda each: _disagreement(each, found, normals))
        rotations[camera] = turn
        for plane, several in found.items():
            nearest = min(several, key=lambda pose: _pose_disagreement(turn, pose, normals[plane]))
            rest[camera, :, plane] = np.outer(nearest.translation, nearest.normal)
    return _rank_one(replace(start, rotations=rotations), rest)


def _poses(link: Link, matrices: Sequence[FloatArray]) -> list[RelativePose]:
    poses: list[RelativePose] = []
    for matrix in matrices:
        try:
            poses += relative_poses_from_homography(matrix, link.views[0].rays)
        except PoseNotFound:
            continue
    return [pose for pose in poses if np.all(np.isfinite(pose.normal))]


def _agreed_normal(poses: dict[tuple[int, int], list[RelativePose]], plane: int) -> FloatArray | None:
    """The normal (3,) of a plane that most of its cameras can agree on; None if only one camera tells."""
    by_camera = [several for (_, other), several in poses.items() if other == plane and several]
    if len(by_camera) < 2:
        return None
    candidates = [pose.normal for several in by_camera for pose in several]
    return min(
        candidates,
        key=lambda normal: sum(
            min(_between(normal, pose.normal) for pose in several) for several in by_camera
        ),
    )


def _disagreement(
    turn: FloatArray, found: dict[int, list[RelativePose]], normals: dict[int, FloatArray | None]
) -> float:
    """Angles (rad) that a camera's decompositions are off a rotation and the planes' normals, in sum."""
    return sum(
        min(_pose_disagreement(turn, pose, normals[plane]) for pose in several)
        for plane, several in found.items()
    )


def _pose_disagreement(turn: FloatArray, pose: RelativePose, normal: FloatArray | None) -> float:
    off = float(rotation_angle(pose.rotation @ turn.T))
    return off if normal is None else off + _between(normal, pose.normal)


def _between(one: FloatArray, other: FloatArray) -> float:
    return float(np.arccos(np.clip(one @ other, -1, 1)))


def _rank_one(start: Network, rest: FloatArray) -> Network:
    """Translations and planes whose products `t mᵀ` are nearest to `rest` (M,3,N,3), NaN where not known."""
    cameras, planes = rest.shape[0], rest.shape[2]
    flat = rest.reshape(3 * cameras, 3 * planes)
    known = np.isfinite(flat)
    normals = start.inverse_normals.ravel().copy()
    shifts = np.zeros(3 * cameras)
    for _ in range(20):  # alternating least squares over what is known
        weight = np.sum(known * np.nan_to_num(normals) ** 2, axis=1)
        shifts = np.nansum(np.where(known, flat, 0) * np.nan_to_num(normals), axis=1) / np.maximum(
            weight, 1e-12
        )
        weight = np.sum(known * shifts[:, None] ** 2, axis=0)
        fitted = np.sum(np.where(known, flat, 0) * shifts[:, None], axis=0) / np.maximum(weight, 1e-12)
        normals = np.where(known.any(axis=0), fitted, normals)
    seen = np.isfinite(rest).any(axis=(1, 2, 3))
    translations = np.where(seen[:, None], shifts.reshape(-1, 3), start.translations)
    return replace(start, translations=translations, inverse_normals=normals.reshape(-1, 3))
