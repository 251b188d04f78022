"""The inverse of an increasing function: a table to start from, Newton's method to finish."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..arrays import FloatArray

_STEPS = 60
_CLOSE = 2e-16


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
        self._values = np.maximum.accumulate(function(nodes)[0])

    @property
    def highest(self) -> float:
        """Largest value that has an inverse."""
        return float(self._values[-1])

    def start(self, values: FloatArray) -> FloatArray:
        """Inverse by straight lines between the nodes."""
        return np.interp(values, self._values, self._nodes)

    def __call__(self, values: FloatArray) -> FloatArray:
        """Arguments (...) of values (...); NaN below zero and above `highest`."""
        flat = values.ravel()
        out = np.full(flat.shape, np.nan)
        todo = np.flatnonzero((flat >= 0) & (flat <= self.highest))
        goal = flat[todo]
        x = self.start(goal)
        cell = np.clip(np.searchsorted(self._values, goal, side="right"), 1, len(self._nodes) - 1)
        low, high = self._nodes[cell - 1], self._nodes[cell]
        for _ in range(_STEPS):
            if todo.size == 0:
                break
            value, slope = self._function(x)
            error = goal - value
            low, high = np.where(error > 0, x, low), np.where(error < 0, x, high)
            with np.errstate(divide="ignore", invalid="ignore"):
                step = error / slope
            x_new = x + step
            # A step out of the interval that holds the root halves the interval instead.
            x_new = np.where((x_new >= low) & (x_new <= high), x_new, (low + high) / 2)
            done = np.abs(x_new - x) <= _CLOSE * np.abs(x)
            out[todo] = x_new
            if done.any():
                left = ~done
                todo, goal, low, high, x_new = todo[left], goal[left], low[left], high[left], x_new[left]
            x = x_new
        return out.reshape(values.shape)
