"""The sizes that a click of the wand offers, made ready beside the window and kept."""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import partial
from typing import Any, Generic, TypeVar

import bpy

from ..background import Preparation, one_step_job

Mark = TypeVar("Mark")


class WandLevels(ABC, Generic[Mark]):
    """A click that found regions of several sizes, of which keys choose another one later.

    `found` is what the click has found: its `levels` by growing size and the `best`; `uid` is the region that
    it marks. `mark` computes in a thread what a level marks, `write` puts that into the scene.
    """

    def __init__(self, found: Any, uid: int) -> None:
        self.found, self.uid = found, uid
        self._ready: dict[int, Preparation[Mark]] = {}

    @abstractmethod
    def mark(self, level: Any) -> Mark:
        """Return what a level marks; touches no Blender data."""

    @abstractmethod
    def write(self, context: bpy.types.Context, mark: Mark) -> bool:
        """Mark the region; false where the photo, the scan or the region is gone."""

    def has(self, steps: int) -> bool:
        """Whether there is a level so many steps larger than the best."""
        return 0 <= self.found.best + steps < len(self.found.levels)

    def ready(self, steps: int) -> Preparation[Mark]:
        """What the level so many steps from the best marks; begun when it is first asked for, then kept."""
        if steps not in self._ready:
            job = one_step_job(partial(self.mark, self.found.level(steps)), "Finishing the outline")
            self._ready[steps] = Preparation((), job)
        return self._ready[steps]
