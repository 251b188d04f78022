"""Runs of numbers, one after the other: what belongs to each of many things of different length."""

from __future__ import annotations

import numpy as np

from ..arrays import IndexArray


def runs(count: IndexArray) -> tuple[IndexArray, IndexArray]:
    """For each of sum(count) items the run that it belongs to and its place there: (n,) -> (m,), (m,)."""
    run = np.repeat(np.arange(len(count)), count)
    return run, np.arange(len(run)) - np.repeat(np.cumsum(count) - count, count)
