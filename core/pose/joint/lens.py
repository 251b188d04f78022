"""Lenses adjusted together with the poses: focal length, principal point, radial distortion.

Photos whose cameras have the same values share one lens. A lens changes by five numbers: the focal length
relative to itself, the principal point (u, v) in pixels, and the first two radial coefficients.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ...arrays import FloatArray, IndexArray
from ...cameras import CatadioptricCamera, FisheyeCamera, PerspectiveCamera, PolynomialCamera
from ...cameras.base import Camera
from ...settings import JointSettings

UNKNOWNS = 5
"""Numbers that a lens changes by: focal length, principal point u and v, radial k1 and k2."""

STEPS = np.array([1e-5, 1e-2, 1e-2, 1e-5, 1e-5])
"""Changes that the derivatives are differences of."""

GRID = 9
"""Pixels a side at which a lens is judged, from border to border of the frame."""


class LensRefused(Exception):
    """Why the lens of a camera cannot be adjusted, as a sentence for the user."""


@dataclass(frozen=True, eq=False)
class LensFit:
    """What became of a lens.

    `camera` as adjusted, `change` (5,) of focal length (relative), principal point u, v (px), k1, k2 and its
    `covariance` (5,5); `pixel_sigma`: largest standard deviation (px) in the frame of where the lens puts a
    ray; `note`: why the lens was kept, empty when it was adjusted.
    """

    camera: Camera
    change: FloatArray
    covariance: FloatArray
    pixel_sigma: float
    note: str


@dataclass(frozen=True, eq=False)
class Lenses:
    """Lenses of a network: `of_view` (N,) number of each photo's lens, `given` (L) as they came.

    `total` (L,5): change so far, already in the sightings' rays. `free` (L,): which ones are adjusted;
    `information` (L,5): of the given values, one over variance.
    """

    of_view: IndexArray
    given: tuple[Camera, ...]
    total: FloatArray
    free: tuple[bool, ...]
    information: FloatArray

    @property
    def count(self) -> int:
        """Number of lenses that are adjusted."""
        return sum(self.free)

    @property
    def column(self) -> IndexArray:
        """Place (N,) of each photo's lens among the adjusted ones, -1 where it is kept."""
        place = np.where(self.free, np.cumsum(self.free) - 1, -1)
        out: IndexArray = place[self.of_view] if len(self.of_view) else self.of_view
        return out

    def changed(self, by: FloatArray) -> Lenses:
        """Lenses after a further change (L',5) of the adjusted ones."""
        total = self.total.copy()
        total[np.flatnonzero(self.free)] += by
        return replace(self, total=total)

    def camera(self, lens: int) -> Camera:
        """Camera of a lens as changed so far."""
        return changed_camera(self.given[lens], self.total[lens]) if self.free[lens] else self.given[lens]

    def kept(self, lens: int) -> Lenses:
        """Lenses of which one more is kept as it was given."""
        total = self.total.copy()
        total[lens] = 0.0
        free = tuple(now and number != lens for number, now in enumerate(self.free))
        return replace(self, total=total, free=free)

    def reprojection(
        self, view: IndexArray, pixels: FloatArray, in_camera: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Projected minus seen pixels (M,2) of points (M,3), derivative (M,2,3) by them; NaN: kept lens."""
        errors, by_point = np.full((len(view), 2), np.nan), np.full((len(view), 2, 3), np.nan)
        for lens in np.flatnonzero(self.free).tolist():
            mine = self.of_view[view] == lens
            projected, by_point[mine] = self.camera(lens).project_with_jacobian(in_camera[mine])
            errors[mine] = projected - pixels[mine]
        return errors, by_point

    def slopes(self, view: IndexArray, in_camera: FloatArray) -> FloatArray:
        """Change of the pixels of points (M,3), seen in photos `view` (M,), by their lens: (M,2,5)."""
        out = np.zeros((len(view), 2, UNKNOWNS))
        for lens in np.flatnonzero(self.free).tolist():
            mine = self.of_view[view] == lens
            out[mine] = pixel_slopes(self.given[lens], self.total[lens], in_camera[mine])
        return out


class _HasCamera(Protocol):
    @property
    def camera(self) -> Camera: ...


def shared_lenses(views: Sequence[_HasCamera], adjusted: bool, settings: JointSettings) -> Lenses:
    """Lenses of photos; those that can change are free when they are to be `adjusted`."""
    numbers: dict[tuple[object, ...], int] = {}
    given: list[Camera] = []
    of_view = np.zeros(len(views), dtype=np.int64)
    for place, view in enumerate(views):
        key = _values(view.camera)
        if key not in numbers:
            numbers[key] = len(given)
            given.append(view.camera)
        of_view[place] = numbers[key]
    free = tuple(adjusted and not why_fixed(camera) for camera in given)
    information = [1.0 / _sigmas(camera, settings) ** 2 for camera in given]
    return Lenses(
        of_view,
        tuple(given),
        np.zeros((len(given), UNKNOWNS)),
        free,
        np.reshape(information, (-1, UNKNOWNS)),
    )


def _values(camera: Camera) -> tuple[object, ...]:
    """Everything that makes a camera what it is; one that cannot be adjusted is its own."""
    if isinstance(camera, PerspectiveCamera | FisheyeCamera | CatadioptricCamera):
        lens = tuple(camera.K.ravel()), camera.distortion
        rest = getattr(camera, "coefficients", ()), getattr(camera, "xi", 0.0)
        return type(camera), camera.width, camera.height, *lens, *rest
    if isinstance(camera, PolynomialCamera):
        size = type(camera), camera.width, camera.height
        return *size, camera.centre, camera.coefficients, camera.stretch
    return (id(camera),)


def _sigmas(camera: Camera, settings: JointSettings) -> FloatArray:
    size = max(camera.width, camera.height)
    centre = settings.principal_point_sigma * size
    radial = settings.radial_sigma
    return np.array([settings.focal_sigma, centre, centre, radial, radial])


def why_fixed(camera: Camera) -> str:
    """Sentence that tells why a camera's lens cannot be adjusted, empty when it can."""
    try:
        changed_camera(camera, np.zeros(UNKNOWNS))
    except LensRefused as refusal:
        return str(refusal)
    return ""


def changed_camera(camera: Camera, change: FloatArray) -> Camera:
    """Camera whose focal length, principal point and radial terms are changed by (5,).

    Mirrors and polynomial lenses have no k1, k2 of their own: only the first three count. Raises
    `LensRefused` for a camera without a lens to adjust.
    """
    focal, u, v, k1, k2 = change.tolist()
    size = camera.width, camera.height
    if isinstance(camera, PolynomialCamera):
        scaled = [a * (1 + focal) ** (1 - power) for power, a in enumerate(camera.coefficients)]
        centre = camera.centre[0] + u, camera.centre[1] + v
        return PolynomialCamera(*size, centre, scaled, camera.stretch)
    if not isinstance(camera, PerspectiveCamera | FisheyeCamera | CatadioptricCamera):
        raise LensRefused("A panorama and lenses of this model have nothing that is adjusted: it was kept.")
    K = camera.K.copy()
    K[:2, :2] *= 1 + focal
    K[:2, 2] += u, v
    if isinstance(camera, PerspectiveCamera):
        distortion = replace(camera.distortion, radial=_raised(camera.distortion.radial, k1, k2))
        return PerspectiveCamera(*size, K, distortion)
    if isinstance(camera, FisheyeCamera):
        return FisheyeCamera(*size, K, _raised(camera.coefficients, k1, k2), camera.distortion)
    return CatadioptricCamera(*size, K, camera.xi, camera.distortion)


def _raised(coefficients: Sequence[float], k1: float, k2: float) -> tuple[float, ...]:
    padded = [*coefficients, *[0.0] * (2 - len(coefficients))]
    return padded[0] + k1, padded[1] + k2, *padded[2:]


def pixel_slopes(camera: Camera, total: FloatArray, points: FloatArray) -> FloatArray:
    """Derivative (M,2,5) of the pixels of points (M,3) by the change of a lens, at the change `total`."""
    out = np.zeros((len(points), 2, UNKNOWNS))
    for number, step in enumerate(np.diag(STEPS)):
        plus, minus = (changed_camera(camera, total + way * step).project(points) for way in (1.0, -1.0))
        # at the very end of the model's field a ray may fall out of it: it tells nothing then
        out[:, :, number] = np.nan_to_num((plus - minus) / (2 * STEPS[number]))
    return out


def fitted_lens(lenses: Lenses, lens: int, covariance: FloatArray, limit: float) -> LensFit:
    """Judge an adjusted lens by its covariance (5,5): refused where it may be off by more than `limit` px."""
    camera = lenses.camera(lens)
    sigma = _pixel_sigma(lenses.given[lens], lenses.total[lens], covariance)
    note = ""
    if not sigma <= limit:
        note = (
            f"The photos do not determine their lens (it may be off by {sigma:.1f} pixels at the border): "
            "it was kept. Add photos from other sides and distances, or calibrate the camera."
        )
        return LensFit(lenses.given[lens], np.zeros(UNKNOWNS), covariance, sigma, note)
    return LensFit(camera, lenses.total[lens], covariance, sigma, note)


def _pixel_sigma(camera: Camera, total: FloatArray, covariance: FloatArray) -> float:
    """Largest standard deviation (px, both directions) of a pixel of the frame for its ray."""
    columns, rows = np.linspace(0, camera.width - 1, GRID), np.linspace(0, camera.height - 1, GRID)
    pixels = np.stack(np.meshgrid(columns, rows), axis=-1).reshape(-1, 2)
    rays = changed_camera(camera, total).unproject(pixels)
    slopes = pixel_slopes(camera, total, rays[np.isfinite(rays).all(axis=1)])
    variance = np.einsum("mia,ab,mib->m", slopes, covariance, slopes)
    return float(np.sqrt(variance.max(initial=0.0)))
