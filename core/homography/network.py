"""Cameras and planes as unknowns, and what one photo's region says about another's: rays and derivatives.

Camera k sees the ray `(R_k + t_k m_iᵀ) r` where the reference camera sees r on plane i, `m = n / d`
(Source: method.md 5.3, Alg. 6).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..arrays import BoolArray, FloatArray, IndexArray
from ..geometry.rigid import exp_so3, skew
from .views import RegionView


@dataclass(frozen=True, eq=False)
class Link:
    """One plane as cameras `first` and `second` see it."""

    plane: int
    first: int
    second: int
    views: tuple[RegionView, RegionView]

    @property
    def reversed(self) -> Link:
        """The same from the other side."""
        return Link(self.plane, self.second, self.first, self.views[::-1])


@dataclass(frozen=True, eq=False)
class Network:
    """Rotations (M,3,3), translations (M,3) and planes' `inverse_normals` (N,3); the reference stays.

    The translations' unit is open: it goes with the planes' distances.
    """

    rotations: FloatArray
    translations: FloatArray
    inverse_normals: FloatArray
    reference: int

    @property
    def size(self) -> int:
        """Number of parameters: six of every camera and three of every plane."""
        return 6 * len(self.rotations) + 3 * len(self.inverse_normals)

    @property
    def free(self) -> BoolArray:
        """Which parameters (P,) are free: not those of the reference."""
        free = np.ones(self.size, dtype=np.bool_)
        free[6 * self.reference : 6 * self.reference + 6] = False
        return free

    def matrix(self, camera: int, plane: int) -> FloatArray:
        """Homography (3,3) from the reference to a camera."""
        shift = np.outer(self.translations[camera], self.inverse_normals[plane])
        matrix: FloatArray = self.rotations[camera] + shift
        return matrix

    def stepped(self, step: FloatArray) -> Network:
        """The network after a step (P,) of its parameters."""
        cameras = step[: 6 * len(self.rotations)].reshape(-1, 6)
        return replace(
            self,
            rotations=exp_so3(cameras[:, :3]) @ self.rotations,
            translations=self.translations + cameras[:, 3:],
            inverse_normals=self.inverse_normals + step[6 * len(self.rotations) :].reshape(-1, 3),
        )

    def columns(self, link: Link) -> IndexArray:
        """Places (15,) of a link's parameters: second camera, first camera, plane."""
        planes = 6 * len(self.rotations) + 3 * link.plane
        return np.concatenate(
            [6 * link.second + np.arange(6), 6 * link.first + np.arange(6), planes + np.arange(3)]
        )

    def carried(self, link: Link, rays: FloatArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Rays (n,3) of the first camera, by default its outline's, in the second; derivatives (n,3,15)."""
        back = np.linalg.inv(self.matrix(link.first, link.plane))
        onwards = self.matrix(link.second, link.plane)
        at_reference = (link.views[0].rays if rays is None else rays) @ back.T
        inwards = onwards @ back
        moved, by_plane = self._rates(link.second, link.plane, at_reference)
        undone, by_plane_back = self._rates(link.first, link.plane, at_reference)
        rates = np.concatenate([moved, -inwards @ undone, by_plane - inwards @ by_plane_back], axis=2)
        return at_reference @ onwards.T, rates

    def _rates(self, camera: int, plane: int, rays: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Change of a camera's rays of reference rays (n,3) with its six parameters and the plane's three."""
        along = rays @ self.inverse_normals[plane]
        turned = -skew(rays @ self.rotations[camera].T)
        shifted = along[:, None, None] * np.eye(3)
        by_plane = self.translations[camera][:, None] * rays[:, None, :]
        return np.concatenate([turned, shifted], axis=2), by_plane


def links_of(views: Sequence[Sequence[RegionView | None]], reference: int) -> list[Link]:
    """Every plane from its first view, the reference's if it sees the plane, to all its others."""
    links = []
    for plane in range(len(views[0])):
        seeing = [k for k, row in enumerate(views) if row[plane] is not None]
        seeing.sort(key=lambda k: (k != reference, -_size(views[k][plane])))
        for other in seeing[1:]:
            first, second = views[seeing[0]][plane], views[other][plane]
            if first is not None and second is not None:
                links.append(Link(plane, seeing[0], other, (first, second)))
    return links


def reaching(links: Sequence[Link], reference: int) -> list[Link]:
    """Links of cameras that other links join with the reference; without these a camera's place is open."""
    joined = {reference}
    while True:
        beside = [link for link in links if (link.first in joined) != (link.second in joined)]
        if not beside:
            return [link for link in links if link.first in joined]
        joined.update(camera for link in beside for camera in (link.first, link.second))


def _size(view: RegionView | None) -> float:
    return 0.0 if view is None else view.size
