"""The inverse of an increasing function: a table to start from, Newton's method to finish."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import FloatArray, IndexArray

_STEPS = 60
_LAST_STEP = 1e-10
"""Relative step after which Newton's method, which squares it, is exact to rounding."""


class MonotoneInverse:
    """Inverse of a function that increases on [0, nodes[-1]], to rounding error, NaN outside its range.

    Parameters
    ----------
    function
        (N,) arguments -> (N,) values and (N,) slopes; zero at zero.
    nodes
        (M,) increasing arguments from 0, dense where the function bends.
    """

    def __init__(self, function: Callable[[FloatArray], tuple[FloatArray, FloatArray]], nodes: FloatArray):
        self._function = function
        self._nodes = nodes
        values, slopes = function(nodes)
        self._values = np.maximum.accumulate(values)
        rise, run = np.diff(self._values), np.diff(nodes)
        with np.errstate(divide="ignore", invalid="ignore"):
            # Slopes of the inverse in every cell, scaled to it; a cubic with at most three times the secant's
            # slope at its ends stays increasing (Fritsch and Carlson 1980).
            self._left = np.clip(rise / slopes[:-1], 0, 3 * run)
            self._right = np.clip(rise / slopes[1:], 0, 3 * run)
        self._left[~np.isfinite(self._left)] = 0.0
        self._right[~np.isfinite(self._right)] = 0.0

    @property
    def highest(self) -> float:
        """Largest value that has an inverse."""
        return float(self._values[-1])

    def start(self, values: FloatArray) -> FloatArray:
        """Inverse (N,) by the cubics through the nodes; the nearest end outside the range."""
        return self._start(values, self._cells(values))

    def _cells(self, values: FloatArray) -> IndexArray:
        cells = np.searchsorted(self._values, values, side="right") - 1
        return np.clip(cells, 0, len(self._nodes) - 2)

    def _start(self, values: FloatArray, cells: IndexArray) -> FloatArray:
        low, high = self._nodes[cells], self._nodes[cells + 1]
        bottom, top = self._values[cells], self._values[cells + 1]
        with np.errstate(divide="ignore", invalid="ignore"):
            t = (values - bottom) / (top - bottom)
        t = np.clip(np.nan_to_num(t), 0, 1)
        s = 1 - t
        edge = low * s * s * (1 + 2 * t) + high * t * t * (1 + 2 * s)
        start: FloatArray = edge + t * s * (s * self._left[cells] - t * self._right[cells])
        return start

    def __call__(self, values: FloatArray) -> FloatArray:
        """Arguments (...) of values (...); NaN below zero and above `highest`."""
        flat = values.ravel()
        inside = (flat >= 0) & (flat <= self.highest)
        if inside.all():
            return self._solve(flat).reshape(values.shape)
        out = np.full(flat.shape, np.nan)
        out[inside] = self._solve(flat[inside])
        return out.reshape(values.shape)

    def _solve(self, goal: FloatArray) -> FloatArray:
        """Arguments (N,) of values (N,) within the range."""
        cells = self._cells(goal)
        x = self._start(goal, cells)
        low, high = self._nodes[cells], self._nodes[cells + 1]
        out = np.empty_like(x)
        todo = np.arange(x.size)
        for _ in range(_STEPS):
            value, slope = self._function(x)
            error = goal - value
            with np.errstate(divide="ignore", invalid="ignore"):
                x_new = x + error / slope
            low, high = np.where(error > 0, x, low), np.where(error < 0, x, high)
            # A step out of the interval that holds the root halves the interval instead.
            x_new = np.where((x_new >= low) & (x_new <= high), x_new, (low + high) / 2)
            left = np.abs(x_new - x) > _LAST_STEP * x_new
            out[todo] = x_new
            if not left.any():
                break
            todo, goal, low, high, x = todo[left], goal[left], low[left], high[left], x_new[left]
        return out
