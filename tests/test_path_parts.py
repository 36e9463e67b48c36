"""Parts of a path between the steps that do not hold: what holds together, and what moves with what."""

import numpy as np

from iceg.slam.broken_path.path_parts import PathParts
from iceg.slam.closures.attempt import Attempt


def _keys(*ranges: tuple[int, int]) -> set[int]:
    return {key for first, last in ranges for key in range(first, last)}


def _claim(key_old: int, key_new: int) -> Attempt:
    return Attempt(key_old=key_old, key_new=key_new, match=None, accepted=True, reason="scripted")


def test_parts_are_apart_until_closures_tie_them() -> None:
    parts = PathParts(40, [10, 30], {20: 5})
    assert parts.starts == [0, 10, 20, 30]
    assert [set(np.flatnonzero(parts.whole == first)) for first in (0, 10, 30)] == [
        _keys((0, 10), (20, 30)),
        _keys((10, 20)),
        _keys((30, 40)),
    ]
    assert [parts.end_of(key) for key in (0, 10, 25, 30)] == [10, 20, 30, 40]


def test_what_is_tied_to_what_is_tied_holds_together_whatever_came_first() -> None:
    whole = PathParts(50, [10], {20: 45, 30: 2, 40: 15}).whole
    assert set(np.flatnonzero(whole == 10)) == _keys((10, 30), (40, 50))
    assert set(np.flatnonzero(whole == 0)) == _keys((0, 10), (30, 40))


def test_a_part_of_which_nothing_else_is_known_moves_with_the_one_before() -> None:
    parts = PathParts(50, [10, 20, 40], {30: 25})  # what begins at 20 and at 30 is one
    moving = parts.moved_by(_claim(0, 12), 10)
    assert set(np.flatnonzero(moving)) == _keys((10, 50))
    tied = PathParts(50, [10, 40], {20: 5, 30: 12})
    assert set(np.flatnonzero(tied.moved_by(_claim(0, 12), 10))) == _keys((10, 20), (30, 50))
