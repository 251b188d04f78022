"""What is drawn, kept until it changes; what takes long is made in a thread, the old shown meanwhile."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Generic, TypeVar

from ...core.jobs import Job, Progress
from ..background import Preparation

Value = TypeVar("Value")


class Kept(Generic[Value]):
    """Values by name, each with a key that tells whether it is up to date; at most `limit` of them."""

    def __init__(self, limit: int = 200) -> None:
        self._limit = limit
        self._known: dict[str, tuple[object, Value]] = {}
        self._made: dict[str, Preparation[Value]] = {}

    def of(
        self, name: str, key: object, large: bool, gather: Callable[[], Callable[[], Value]]
    ) -> Value | None:
        """Return the value of a name; while a `large` one is made, what it was before, or None.

        `gather` takes out of Blender what is needed, and returns the function that makes the value of it.
        """
        known = self._known.get(name)
        if known is not None and known[0] == key:
            return known[1]
        if not large:
            return self._keep(name, key, gather()())
        work = self._made.get(name)
        if work is None or work.signature != (key,):
            if work is not None:
                work.stop()
            work = self._made[name] = Preparation((key,), _job(gather()))
        if work.done:
            return self._keep(name, key, self._made.pop(name).result())
        return None if known is None else known[1]

    def _keep(self, name: str, key: object, value: Value) -> Value:
        if len(self._known) >= self._limit:
            self._known.pop(next(iter(self._known)))
        self._known[name] = key, value
        return value

    @property
    def news(self) -> bool:
        """Whether something was finished that is not shown yet."""
        return any(work.done for work in self._made.values())

    def clear(self) -> None:
        """Forget all."""
        for work in self._made.values():
            work.stop()
        self._made.clear()
        self._known.clear()


def _job(make: Callable[[], Value]) -> Job[Any]:
    yield Progress(0.0, "Preparing what is drawn")
    return make()
