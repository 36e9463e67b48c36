"""Where a lost part of the path lies, of several alignments that exclude each other."""

from math import exp, log
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iceg.evaluation.regression.cells import Cell
from iceg.evaluation.regression.recordings import recording_of
from iceg.evaluation.regression.runner import outcomes
from iceg.slam.broken_path.map_merging import Alignment, weighed

_ELSEWHERE = 8.0


def _alignment(log_odds: float, *, is_path: bool = False) -> Alignment:
    return Alignment(correction=np.zeros(3), closures=[], log_odds=log_odds, is_path=is_path)


@given(
    odds=st.lists(st.floats(-20.0, 40.0), min_size=1, max_size=6), path=st.floats(-20.0, 40.0), prior=st.floats(-9, 9)
)
def test_what_is_believed_is_more_probable_than_all_else(odds: list[float], path: float, prior: float) -> None:
    alignments = [_alignment(path, is_path=True), *map(_alignment, odds)]
    weights = [exp(path + prior + _ELSEWHERE), *map(exp, odds), exp(_ELSEWHERE)]
    best = int(np.argmax(weights))
    of_others = log(weights[best] / (sum(weights[:best]) + sum(weights[best + 1 :])))
    if abs(of_others) < 1e-9:
        return
    belief = weighed(alignments, prior + _ELSEWHERE, _ELSEWHERE)
    is_known = of_others > 0.0 and best < len(alignments)
    assert (belief.alignment is not None) == is_known
    if is_known:
        assert belief.alignment is alignments[best]
        assert belief.log_odds == pytest.approx(of_others, rel=1e-6, abs=1e-6)
    assert belief.log_odds_path == pytest.approx(log(weights[0] / sum(weights[1:])), rel=1e-6, abs=1e-6)


def test_two_alignments_alike_are_none() -> None:
    assert weighed([_alignment(20.0), _alignment(20.0)], _ELSEWHERE, _ELSEWHERE).alignment is None


@given(prior=st.floats(-9, 9))
def test_where_maps_tell_nothing_the_path_is_as_probable_as_before(prior: float) -> None:
    belief = weighed([], prior + _ELSEWHERE, _ELSEWHERE)
    assert belief.alignment is None
    assert belief.log_odds_path == pytest.approx(prior)


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


def test_a_robot_that_sees_from_afar_what_it_knows_is_found(data_dir: Path) -> None:
    """It never comes nearer than 4.7 m to where it was before, 5.3 m off when only scans nearby were matched."""
    cell = Cell(group="faults", source="13-warehouse-utm-good", fault="carried")
    (outcome,) = outcomes(recording_of(cell, data_dir), [cell])
    assert outcome.error_m < 0.1
