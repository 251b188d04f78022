"""Work beside the window: a core job in a thread, which others wait for without holding up Blender."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor, wait
from threading import Event
from typing import Generic, TypeVar

from ..core.jobs import Job, Progress

Result = TypeVar("Result")
Signature = tuple[object, ...]
_STEP = 0.005  # s that one look at the thread may take


class Stopped(Exception):
    """The work was given up, because something newer is wanted."""


class Preparation(Generic[Result]):
    """A job that runs in a thread of its own. It must not touch Blender's data.

    `signature` tells what it was made of: another one means that it is out of date.
    """

    def __init__(self, signature: Signature, job: Job[Result]) -> None:
        self.signature = signature
        self.progress = Progress(0.0, "Preparing")
        self._stop = Event()
        self._pool = ThreadPoolExecutor(1, "fresco")
        self._future: Future[Result] = self._pool.submit(self._work, job)

    def _work(self, job: Job[Result]) -> Result:
        try:
            while not self._stop.is_set():
                try:
                    self.progress = next(job)
                except StopIteration as stop:
                    return stop.value
            raise Stopped
        finally:
            job.close()
            self._pool.shutdown(wait=False)

    @property
    def done(self) -> bool:
        """Whether it has ended, well or not."""
        return self._future.done()

    @property
    def failed(self) -> bool:
        """Whether it has ended by an error."""
        return self.done and self.error is not None

    @property
    def error(self) -> BaseException | None:
        """What the finished work raised, if it did."""
        return self._future.exception()

    def result(self) -> Result:
        """Return what the finished work returned, or raise what it raised."""
        return self._future.result()

    def stop(self) -> None:
        """Give the work up at its next step."""
        self._stop.set()

    def wait_job(self) -> Job[Result]:
        """Wait for the result; raises what the work raised. Closing leaves the work going."""
        while not self.done:
            yield self.progress
            wait([self._future], _STEP)
        return self._future.result()


def one_step_job(work: Callable[[], Result], message: str) -> Job[Result]:
    """Job of a function that cannot be cut."""
    yield Progress(0.5, message)
    return work()


def beside_job(job: Job[Result]) -> Job[Result]:
    """Run a job that touches no Blender data in a thread; closing this one stops it at its next step."""
    work = Preparation((), job)
    try:
        return (yield from work.wait_job())
    finally:
        work.stop()
