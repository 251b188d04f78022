from __future__ import annotations

import numpy as np
from fresco.core.texture.views.agreement import _Comparison, _Pairs, _verdicts


def judged(count, entries, scale=0.5):
    pairs = _Pairs.empty(count)
    for i, j, distances, tried in entries:
        pairs.enter(i, j, _Comparison(tried, distances))
        pairs.enter(j, i, _Comparison(tried, distances))
    return _verdicts(pairs, np.full(count, scale))


def agreeing(i, j):
    return i, j, [0.0, 0.0, 1.0, 0.0, 1.0, 0.0], 6


def shifted(i, j):
    return i, j, [9.0, 10.0, 11.0], 4


def test_the_photo_that_all_contradict_is_wrong_and_its_shift_is_in_full_pixels():
    result = judged(4, [agreeing(0, 1), agreeing(1, 2), agreeing(0, 2), shifted(3, 0), shifted(3, 1)])
    assert [r.wrong for r in result] == [False, False, False, True]
    assert result[3].shift == 20


def test_a_photo_is_not_condemned_for_its_wrong_neighbours():
    entries = [agreeing(0, 1), agreeing(1, 2), agreeing(0, 2), shifted(3, 0), shifted(3, 1), shifted(3, 4)]
    result = judged(5, entries)
    assert [r.wrong for r in result] == [False, False, False, True, False]
    assert np.isnan(result[4].shift)


def test_of_two_photos_alone_none_is_called_wrong():
    result = judged(2, [shifted(0, 1)])
    assert not any(r.wrong for r in result)
    assert result[0].shift == 20


def test_a_photo_whose_pieces_are_nowhere_is_wrong():
    entries = [agreeing(0, 1), agreeing(1, 2), agreeing(0, 2), (3, 0, [], 6), (3, 1, [], 6)]
    result = judged(4, entries)
    assert result[3].wrong
    assert result[3].matched == 0


def test_nothing_compared_is_no_reproach():
    result = judged(3, [])
    assert not any(r.wrong for r in result)
    assert all(np.isnan(r.shift) and np.isnan(r.matched) for r in result)
