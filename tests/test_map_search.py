"""Where a lost part of the path lies, of several ways that exclude each other."""

from math import exp, log
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iceg.evaluation.regression.cells import Cell
from iceg.evaluation.regression.recordings import recording_of
from iceg.evaluation.regression.runner import outcomes
from iceg.slam.broken_path.map_search import Way, best_way

_ELSEWHERE = 8.0


def _way(log_odds: float, *, is_path: bool = False) -> Way:
    return Way(correction=np.zeros(3), closures=[], log_odds=log_odds, is_path=is_path)


@given(
    odds=st.lists(st.floats(-20.0, 40.0), min_size=1, max_size=6), path=st.floats(-20.0, 40.0), prior=st.floats(-9, 9)
)
def test_the_best_way_is_more_probable_than_all_else(odds: list[float], path: float, prior: float) -> None:
    ways = [_way(path, is_path=True), *map(_way, odds)]
    weights = [exp(path + prior + _ELSEWHERE), *map(exp, odds)]
    first = 1 + int(np.argmax(odds))
    others = [exp(_ELSEWHERE), *weights[:first], *weights[first + 1 :]]
    best = best_way(ways, prior, _ELSEWHERE)
    expected = log(weights[first] / sum(others))
    if abs(expected) < 1e-9:
        return
    assert (best is not None) == (expected > 0.0)
    if best is not None:
        assert best[0].log_odds == max(odds)
        assert best[1] == pytest.approx(expected, rel=1e-6, abs=1e-6)


def test_two_ways_alike_are_none() -> None:
    assert best_way([_way(20.0), _way(20.0)], 0.0, _ELSEWHERE) is None


def test_robots_with_short_lasers_are_found_where_they_were_carried(data_dir: Path) -> None:
    """Lasers of 4 m: by places of single scans neither was, 8.5 and 7.2 m off."""
    errors = []
    for seed in (36009, 36019):
        cell = Cell(group="random", source=f"random:{seed}", fault="carried")
        (outcome,) = outcomes(recording_of(cell, data_dir), [cell])
        errors.append(outcome.error_m)
    assert max(errors) < 0.1


def test_a_robot_carried_without_a_failure_is_found(data_dir: Path) -> None:
    """Every scan matched: 5.4 m off, and nothing was said. The maps of before and after contradict each other."""
    cell = Cell(group="random", source="random:36012", fault="carried")
    (outcome,) = outcomes(recording_of(cell, data_dir), [cell])
    assert outcome.error_m < 0.1
    assert outcome.is_said
