import numpy as np
from fresco.core.geometry.runs import runs


def test_items_are_counted_run_by_run():
    run, place = runs(np.array([2, 0, 3]))
    np.testing.assert_array_equal(run, [0, 0, 2, 2, 2])
    np.testing.assert_array_equal(place, [0, 1, 0, 1, 2])


def test_nothing_has_no_runs():
    assert [len(one) for one in runs(np.zeros(0, dtype=np.int64))] == [0, 0]
