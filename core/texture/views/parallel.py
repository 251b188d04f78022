"""Many photos worked on by a few threads, results in order: decoding, rays and most of numpy run together."""

from __future__ import annotations

import os
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from typing import TypeVar

Item = TypeVar("Item")
Result = TypeVar("Result")

CORES = min(os.cpu_count() or 1, 8)
"""Threads that are used, unless memory or a setting allows fewer."""


def map_ahead(function: Callable[[Item], Result], items: Iterable[Item], threads: int) -> Iterator[Result]:
    """Results of `function` in the items' order, from threads that work ahead of whoever takes them.

    At most `threads` items are worked on, and one result waits beside them, so that no thread idles while
    the caller takes its time. One thread is the caller's own: each item is worked on when it is asked for.
    Closing the iterator drops what has not begun and waits for the rest.
    """
    if threads <= 1:
        yield from map(function, items)
        return
    pool = ThreadPoolExecutor(threads)
    waiting: deque[Future[Result]] = deque()
    try:
        for item in items:
            waiting.append(pool.submit(function, item))
            if len(waiting) > threads:
                yield waiting.popleft().result()
        while waiting:
            yield waiting.popleft().result()
    finally:
        pool.shutdown(cancel_futures=True)
