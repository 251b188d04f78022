"""Lens distortion on the normalised plane: radial (rational), tangential and thin-prism terms.

With x, y on the plane and r^2 = x^2 + y^2:

    x_d = x N(r^2) / D(r^2) + 2 p1 x y + p2 (r^2 + 2 x^2) + s1 r^2 + s2 r^4
    y_d = y N(r^2) / D(r^2) + p1 (r^2 + 2 y^2) + 2 p2 x y + s3 r^2 + s4 r^4
    N(s) = 1 + k1 s + k2 s^2 + ...        D(s) = 1 + d1 s + d2 s^2 + ...

OpenCV's k1, k2, p1, p2, k3, k4, k5, k6, s1..s4 are N = (k1, k2, k3), D = (k4, k5, k6).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..arrays import ArrayLike, BoolArray, FloatArray
from ..errors import CameraError
from .monotone import MonotoneInverse

FAR = 1e8
"""Largest radius on the normalised plane (89.9999994 degrees): beyond it a pixel has no useful ray."""

_DIRECTIONS = 64
_TABLE_SIZE = 1025
_NEWTON_STEPS = 60
_START = 0.98
_LAST_STEP = 1e-10
_RESIDUAL = 2e-15
_CHUNK = 1 << 15
"""Points worked on together: small enough for the processor's cache."""


@dataclass(frozen=True)
class Distortion:
    """Brown–Conrady distortion with rational radial and thin-prism terms; the formula heads this module.

    `radial` and `denominator` are the coefficients of N and D after the leading 1, `tangential` is (p1, p2),
    `prism` is (s1, s2, s3, s4). It is defined inside the disk `r < limit`, on which it is one to one.
    """

    radial: tuple[float, ...] = ()
    denominator: tuple[float, ...] = ()
    tangential: tuple[float, float] = (0.0, 0.0)
    prism: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not np.all(np.isfinite((*self.radial, *self.denominator, *self.tangential, *self.prism))):
            raise CameraError("The distortion coefficients must be finite numbers.")

    @classmethod
    def from_opencv(cls, coefficients: ArrayLike) -> Distortion:
        """Distortion from OpenCV's vector k1, k2, p1, p2, k3, k4, k5, k6, s1..s4 of any shorter length.

        Raises
        ------
        CameraError
            Coefficients that are not finite, too many, or with a tilted sensor (OpenCV's tau).
        """
        given = np.asarray(coefficients, dtype=np.float64).ravel()
        if given.size > 14:
            raise CameraError(f"At most 12 distortion coefficients are known, {given.size} were given.")
        if np.any(given[12:] != 0):
            raise CameraError("A tilted sensor (tau_x, tau_y) is not supported: calibrate without it.")
        k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4 = np.pad(
            given[:12], (0, max(0, 12 - given.size))
        ).tolist()
        return cls(trimmed(k1, k2, k3), trimmed(k4, k5, k6), (p1, p2), (s1, s2, s3, s4))

    @property
    def opencv(self) -> tuple[float, ...]:
        """OpenCV's vector of 0, 4, 5, 8 or 12 numbers; CameraError if the lens has no form there."""
        if len(self.radial) > 3 or len(self.denominator) > 3:
            raise CameraError("This lens has more radial terms than OpenCV's distortion model can hold.")
        k1, k2, k3 = (*self.radial, 0.0, 0.0, 0.0)[:3]
        full = (k1, k2, *self.tangential, k3, *(*self.denominator, 0.0, 0.0, 0.0)[:3], *self.prism)
        length = max((i + 1 for i, value in enumerate(full) if value != 0), default=0)
        return full[: next(size for size in (0, 4, 5, 8, 12) if size >= length)]

    @cached_property
    def is_zero(self) -> bool:
        """Whether the lens does not distort at all."""
        return not any((*self.radial, *self.denominator, *self.tangential, *self.prism))

    @cached_property
    def is_radial(self) -> bool:
        """Whether the distortion is the same in all directions."""
        return not any((*self.tangential, *self.prism))

    @cached_property
    def limit(self) -> float:
        """Radius on the undistorted plane up to which the distortion is one to one (at most `FAR`)."""
        limit = min(first_fold(self.radial, self.denominator), FAR)
        return limit if self.is_radial else self._directional_limit(limit)

    def _directional_limit(self, upper: float) -> float:
        """First radius at which the symmetric part of the Jacobian loses its definiteness in some direction.

        A map of a convex disk whose Jacobian has a positive definite symmetric part is one to one there.
        """
        worst = np.arctan2(-self.tangential[0], -self.tangential[1])  # where the tangential part folds first
        directions = worst + np.linspace(0, 2 * np.pi, _DIRECTIONS, endpoint=False)
        low, high = 0.0, float(np.arctan(upper))
        for count in (
            257,
            *(17,) * 9,
        ):  # a fine search for the first fold, then every pass narrows it 16 times
            radii = np.tan(np.linspace(low, high, count))[:, None]
            with np.errstate(all="ignore"):  # a pole may be at the end of the interval
                j = self.jacobian(radii * np.cos(directions), radii * np.sin(directions))
                mean, half = (j[0] + j[3]) / 2, np.hypot((j[0] - j[3]) / 2, (j[1] + j[2]) / 2)
            folded = np.flatnonzero(~np.all(mean > half, axis=1))
            if folded.size == 0:
                return float(np.tan(high))
            first = max(int(folded[0]), 1)
            angles = np.arctan(radii[:, 0])
            low, high = float(angles[first - 1]), float(angles[first])
        return float(np.tan(low))

    def apply(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distort points of the plane: (...), (...) -> the same; NaN outside the disk `r < limit`."""
        r2 = x * x + y * y
        r2 = np.where(r2 < self.limit**2, r2, np.nan)
        gain = series(self.radial, r2)
        if self.denominator:
            gain /= series(self.denominator, r2)
        xd, yd = x * gain, y * gain
        if any(self.tangential):
            p1, p2 = self.tangential
            along = 2 * (p2 * x + p1 * y)  # the terms are P r^2 + 2 (P . x) x with P = (p2, p1)
            xd += p2 * r2 + along * x
            yd += p1 * r2 + along * y
        if any(self.prism):
            s1, s2, s3, s4 = self.prism
            xd += r2 * (s1 + s2 * r2)
            yd += r2 * (s3 + s4 * r2)
        return xd, yd

    def jacobian(self, x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """Derivatives of `apply`, also outside the disk: d x_d/dx, d x_d/dy, d y_d/dx, d y_d/dy (...)."""
        r2 = x * x + y * y
        gain = series(self.radial, r2)
        bend = series_slope(self.radial, r2)
        if self.denominator:
            d = series(self.denominator, r2)
            gain = gain / d
            bend = (bend - gain * series_slope(self.denominator, r2)) / d
        xx, mixed, yy = gain + 2 * bend * x * x, 2 * bend * x * y, gain + 2 * bend * y * y
        if any(self.tangential):
            p1, p2 = self.tangential
            along = 2 * (p2 * x + p1 * y)  # derivative of P r^2 + 2 (P . x) x with P = (p2, p1)
            xx, yy = xx + along + 4 * p2 * x, yy + along + 4 * p1 * y
            mixed = mixed + 2 * (p1 * x + p2 * y)
        if not any(self.prism):
            return xx, mixed, mixed, yy
        s1, s2, s3, s4 = self.prism
        prism_x, prism_y = 2 * s1 + 4 * s2 * r2, 2 * s3 + 4 * s4 * r2
        return xx + prism_x * x, mixed + prism_x * y, mixed + prism_y * x, yy + prism_y * y

    def undo(self, xd: FloatArray, yd: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Undistort points of the plane: inverse of `apply`, NaN where no point of the disk is mapped there.

        Newton's method, in one dimension where the distortion is radial; residuals end at rounding error.
        """
        shape = xd.shape
        xd, yd = xd.ravel(), yd.ravel()
        x, y = np.empty_like(xd), np.empty_like(yd)
        solve = self._undo_radial if self.is_radial else self._undo_newton
        for start in range(0, xd.size, _CHUNK):
            part = slice(start, start + _CHUNK)
            x[part], y[part] = solve(xd[part], yd[part])
        return x.reshape(shape), y.reshape(shape)

    def _undo_radial(self, xd: FloatArray, yd: FloatArray) -> tuple[FloatArray, FloatArray]:
        rd = np.sqrt(xd * xd + yd * yd)
        gain = np.divide(self._inverse(rd), rd, out=np.ones(rd.shape), where=~(rd <= 0))
        return xd * gain, yd * gain

    def _undo_newton(self, xd: FloatArray, yd: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Undistort (N,), (N,) in two dimensions, starting from the inverse of the radial part."""
        rd = np.sqrt(xd * xd + yd * yd)
        x_out, y_out = np.full(xd.shape, np.nan), np.full(yd.shape, np.nan)
        todo = np.flatnonzero(rd <= self._reach)
        xd, yd, rd = xd[todo], yd[todo], rd[todo]
        # From inside a fold Newton's method walks up to it, from its very rim it may leap anywhere.
        start = np.minimum(self._inverse.start(rd), _START * self.limit)
        gain = np.divide(start, rd, out=np.ones(rd.shape), where=rd > 0)
        x, y = xd * gain, yd * gain
        for _ in range(_NEWTON_STEPS):
            if todo.size == 0:
                break
            done, x, y = self._newton_step(x, y, xd, yd)
            x_out[todo[done]], y_out[todo[done]] = x[done], y[done]
            left = ~done
            todo, xd, yd, x, y = todo[left], xd[left], yd[left], x[left], y[left]
        return x_out, y_out

    def _newton_step(
        self, x: FloatArray, y: FloatArray, xd: FloatArray, yd: FloatArray
    ) -> tuple[BoolArray, FloatArray, FloatArray]:
        """Return whether this step was the last one, and the points after it."""
        xe, ye = self.apply(x, y)
        a, b, c, d = self.jacobian(x, y)
        ex, ey = xd - xe, yd - ye
        with np.errstate(invalid="ignore", divide="ignore"):
            det = a * d - b * c
            x_new, y_new = x + (d * ex - b * ey) / det, y + (a * ey - c * ex) / det
            # At a fold the step means nothing any more, but the residual tells that the point is found.
            found = ex * ex + ey * ey <= _RESIDUAL**2 * (1 + xd * xd + yd * yd)
            x_new, y_new = np.where(found, x, x_new), np.where(found, y, y_new)
            r2, r2_new = x * x + y * y, x_new * x_new + y_new * y_new
            inside = r2_new < self.limit**2
            # Newton squares a step: the next one would be lost in rounding.
            step2 = (x_new - x) ** 2 + (y_new - y) ** 2
            done: BoolArray = inside & (found | (step2 <= _LAST_STEP**2 * (1 + r2_new)))
            # A step out of the disk goes only half of the way to its rim.
            shrink = np.where(inside, 1.0, (np.sqrt(r2) + self.limit) / 2 / np.sqrt(r2_new))
        return done, x_new * shrink, y_new * shrink

    @cached_property
    def _inverse(self) -> MonotoneInverse:
        """Undistorted radius of a distorted one, for the radial part."""
        nodes = np.tan(np.linspace(0, np.arctan(self.limit), _TABLE_SIZE))
        nodes[-1] = self.limit * (1 - 1e-15)
        return MonotoneInverse(self._radius_with_slope, nodes)

    def _radius_with_slope(self, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distorted radius r N / D and its derivative, (N,) -> (N,), (N,)."""
        r2 = r * r
        d = series(self.denominator, r2)
        gain = series(self.radial, r2) / d
        bend = series_slope(self.radial, r2) - gain * series_slope(self.denominator, r2)
        return r * gain, gain + 2 * r2 * bend / d

    @cached_property
    def _reach(self) -> float:
        """Bound of the distorted radii of the disk."""
        s1, s2, s3, s4 = self.prism
        extra = 3 * np.hypot(*self.tangential) + np.hypot(s1, s3) + np.hypot(s2, s4) * self.limit**2
        return float(self._inverse.highest + extra * self.limit**2)


def trimmed(*coefficients: float) -> tuple[float, ...]:
    """Coefficients without zeros at their end."""
    length = max((i + 1 for i, value in enumerate(coefficients) if value != 0), default=0)
    return coefficients[:length]


def series(coefficients: tuple[float, ...], s: FloatArray) -> FloatArray:
    """Evaluate 1 + c1 s + c2 s^2 + ..."""
    value = np.zeros_like(s)
    for c in reversed(coefficients):
        value += c
        value *= s
    value += 1.0
    return value


def series_slope(coefficients: tuple[float, ...], s: FloatArray) -> FloatArray:
    """Evaluate the derivative c1 + 2 c2 s + ... of `series`."""
    value = np.zeros_like(s)
    for power in range(len(coefficients), 0, -1):
        value *= s
        value += power * coefficients[power - 1]
    return value


def first_fold(radial: tuple[float, ...], denominator: tuple[float, ...]) -> float:
    """First r > 0 at which `r N(r^2) / D(r^2)` stops growing or has a pole; infinite if it never does."""
    n, d = np.array([1.0, *radial]), np.array([1.0, *denominator])
    # The slope has, with s = r^2, the sign of (N + 2 s N') D - 2 N s D'; s N' has terms i n_i.
    slope = np.convolve(n * (1 + 2 * np.arange(n.size)), d) - 2 * np.convolve(n, d * np.arange(d.size))
    root = np.sqrt(min(first_positive_root(slope), first_positive_root(d)))
    # The root is known to rounding only: step back until the function certainly grows there.
    for back in 10.0 ** np.arange(-13, -5):
        limit = float(root * (1 - back))
        if not np.isfinite(limit) or min(np.polyval(p[::-1], limit**2) for p in (slope, d)) > 0:
            break
    return limit


def first_positive_root(coefficients: FloatArray) -> float:
    """Smallest positive real root of a polynomial (constant first, not zero), infinite if it has none."""
    # Backwards the polynomial has the inverse roots: the wanted one is then the largest, the one known best.
    inverse = np.roots(coefficients)
    real = inverse.real[(np.abs(inverse.imag) <= 1e-9 * np.abs(inverse)) & (inverse.real > 0)]
    return float(1 / real.max()) if real.size else np.inf


NO_DISTORTION = Distortion()
