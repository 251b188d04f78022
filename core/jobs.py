"""Progress and the job contract: slow functions are generators that yield `Progress` and return their result.

A caller without a window drains a job; a caller with one advances it step by step and closes it to cancel.
Work that must not be left half done is cleaned up in the job's `finally`.
"""

from __future__ import annotations

from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import TypeVar

Result = TypeVar("Result")


@dataclass(frozen=True)
class Progress:
    """How far a job is: `fraction` in [0, 1] and what it is doing, as a short sentence for the user."""

    fraction: float
    message: str


Job = Generator[Progress, None, Result]


def drain(job: Job[Result], on_progress: Callable[[Progress], None] | None = None) -> Result:
    """Run a job to its end and return its result; `on_progress` sees every step."""
    while True:
        try:
            progress = next(job)
        except StopIteration as stop:
            result: Result = stop.value
            return result
        if on_progress is not None:
            on_progress(progress)


def part(job: Job[Result], start: float, end: float, prefix: str = "") -> Job[Result]:
    """Run `job` as the part of a longer one that goes from fraction `start` to `end`."""
    try:
        while True:
            try:
                progress = next(job)
            except StopIteration as stop:
                result: Result = stop.value
                return result
            yield Progress(start + (end - start) * progress.fraction, prefix + progress.message)
    finally:
        job.close()
