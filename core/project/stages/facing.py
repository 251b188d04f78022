"""Which side of the scan the photos see: a scan turned inside out would stay without texture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...errors import TextureError
from ...geometry.rays import RayCaster
from ...photos.view import View
from ...scans.scan import Scan

_RAYS = 48
"""Rays across a photo, and as many down."""


def check_facing(scan: Scan, views: Sequence[View]) -> None:
    """Raise TextureError when the photos see more backs of faces than fronts."""
    caster = RayCaster(scan.vertices, scan.faces)
    hits = np.array([_fronts_and_backs(scan, view, caster) for view in views]).sum(axis=0)
    fronts, backs = int(hits[0]), int(hits[1])
    if fronts + backs == 0:
        raise TextureError(
            f"No photo sees {scan.name}: their poses look past it. Check that poses and scan are in the same "
            "coordinates and unit."
        )
    if backs > fronts:
        raise TextureError(
            f"The photos see the back of {scan.name} ({100 * backs // (fronts + backs)} % of their view): "
            "its faces look the wrong way. Turn them over (turn_over = true in [scan]; Mesh > Normals > Flip "
            "in the window), or let faces be seen from both sides (double_sided = true in [texture])."
        )


def _fronts_and_backs(scan: Scan, view: View, caster: RayCaster) -> tuple[int, int]:
    """How many of a grid of rays meet a face from the front, and from the back."""
    u, v = np.meshgrid(
        np.linspace(0, view.camera.width - 1, _RAYS), np.linspace(0, view.camera.height - 1, _RAYS)
    )
    rays = view.camera.unproject(np.stack([u.ravel(), v.ravel()], axis=1)) @ view.rotation
    face = caster.first_hit(view.centre, rays).face
    struck = face >= 0
    a, b, c = (scan.vertices[scan.faces[face[struck], i]] for i in range(3))
    front = np.sum(np.cross(b - a, c - a) * rays[struck], axis=1) < 0
    return int(front.sum()), int((~front).sum())
