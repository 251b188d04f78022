from __future__ import annotations

import threading
import time

import pytest
from fresco.core.texture.views.parallel import map_ahead


@pytest.mark.parametrize("threads", [1, 3])
def test_results_come_in_the_order_of_the_items(threads):
    def slow_first(number):
        time.sleep(0.02 if number == 0 else 0)
        return number * number

    assert list(map_ahead(slow_first, range(20), threads)) == [n * n for n in range(20)]


def test_threads_work_ahead_but_not_far():
    begun = []
    results = map_ahead(lambda number: begun.append(number) or number, range(50), 2)
    assert next(results) == 0
    time.sleep(0.05)
    assert 1 <= len(begun) <= 3
    results.close()
    assert len(begun) <= 3


def test_one_thread_works_only_when_asked():
    begun = []
    results = map_ahead(lambda number: begun.append(number), range(5), 1)
    next(results)
    assert begun == [0]


def test_several_items_are_worked_on_at_once():
    meeting = threading.Barrier(3, timeout=10)
    assert len(list(map_ahead(lambda _: meeting.wait(), range(3), 3))) == 3


def test_an_error_reaches_the_caller_and_ends_the_work():
    def fails(number):
        if number == 1:
            raise ValueError("second")
        return number

    results = map_ahead(fails, range(100), 2)
    assert next(results) == 0
    with pytest.raises(ValueError, match="second"):
        next(results)
    assert threading.active_count() < 10
