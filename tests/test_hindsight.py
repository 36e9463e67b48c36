"""Closures that the path refused, weighed once more: there and back along a corridor, with what leads a path astray."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from graph.batch import optimize
from graph.factors import Factor
from graph.measurement import RelativePose
from graph.se2 import between, compose
from iceg.slam.closures.attempt import Attempt, Verdict, closure_factor
from iceg.slam.config import LoopClosureConfig
from iceg.slam.hindsight import _refused_by_path, weighed
from iceg.slam.solution import Solution

Array = NDArray[np.float64]

_HALF, _STEP = 20, 0.5
_TRUTH = np.array(
    [(_STEP * k, 0.0, 0.0) for k in range(_HALF)] + [(_STEP * (_HALF - 1 - k), 0.0, np.pi) for k in range(_HALF)]
)
_ODOMETRY, _MATCH = np.diag([0.05, 0.05, 0.03]) ** 2, np.diag([0.005, 0.005, 0.002]) ** 2
_SLID = np.array([0.3, 0.0, 0.0])
"""What a match that leads astray is off by."""
_CONTESTED = {22: _ODOMETRY}
_NOTHING: dict[int, Array] = {}


def closure(old: int, new: int, off: Array, off_path: float, *, accepted: bool = False) -> Attempt:
    match = RelativePose(
        T_ref_cur=compose(between(_TRUTH[old], _TRUTH[new]), off),
        covariance=_MATCH,
        score=0.9,
        inliers=150,
        overlap=0.9,
        weak_directions=np.zeros((0, 3)),
    )
    return Attempt(key_old=old, key_new=new, match=match, accepted=accepted, reason="fits", off_path=off_path)


def refused(n: int, off: Array) -> list[Attempt]:
    """Of so many key scans on the way back, each to the place where it was before, all off by as much."""
    return [closure(_HALF - 1 - k, _HALF + k, off, 12.0) for k in range(4, 4 + n)]


def solution(attempts: list[Attempt], astray: int | None, *, is_doubtful: bool = True) -> Solution:
    """Odometry and matches; the match of key scan `astray` has slid, and the graph has odometry the wider for it."""
    factors = [Factor(kind="prior", i=None, j=0, T_i_j=_TRUTH[0], covariance=_MATCH)]
    for k in range(1, len(_TRUTH)):
        step = between(_TRUTH[k - 1], _TRUTH[k])
        matched = compose(step, _SLID) if k == astray else step
        known = 2.0 * _ODOMETRY if k == astray and is_doubtful else _ODOMETRY
        factors.append(Factor(kind="odometry", i=k - 1, j=k, T_i_j=step, covariance=known))
        factors.append(Factor(kind="ice", i=k - 1, j=k, T_i_j=matched, covariance=_MATCH))
    factors += [closure_factor(attempt) for attempt in attempts if attempt.accepted]
    return Solution(
        factors=factors,
        poses=optimize(factors, _TRUTH).poses,
        attempts=attempts,
        searchable=np.ones(len(_TRUTH), dtype=np.bool_),
        odometry_jumps=() if astray is None or not is_doubtful else (astray,),
    )


def worst(poses: Array) -> float:
    return float(np.hypot(*(poses - _TRUTH)[:, :2].T).max())


def test_many_that_agree_refute_the_match_that_led_the_path_astray() -> None:
    config, claimed = LoopClosureConfig(), refused(6, np.zeros(3))
    before = solution(claimed, astray=22)
    after = weighed(before, claimed, config, _CONTESTED)
    assert worst(before.poses) > 0.25
    assert worst(after.poses) < 0.02
    gone = [factor for factor in before.factors if factor not in after.factors]
    assert [(factor.kind, factor.j) for factor in gone] == [("odometry", 22), ("ice", 22)]
    (odometry,) = [factor for factor in after.factors if factor.kind == "odometry" and factor.j == 22]
    np.testing.assert_array_equal(
        odometry.covariance, _ODOMETRY, "the match is wrong, and odometry alone tells the step"
    )
    assert {factor.kind for factor in after.factors} == {"prior", "odometry", "ice", "closure"}
    assert all(attempt.verdict is Verdict.ACCEPTED for attempt in after.attempts)
    assert after.attempts[0].reason == "in hindsight; fits"


def test_a_closure_that_led_the_path_astray_leaves_the_graph() -> None:
    wrong, claimed = closure(17, 22, _SLID, 0.5, accepted=True), refused(6, np.zeros(3))
    after = weighed(solution([wrong, *claimed], astray=22), claimed, LoopClosureConfig(), _CONTESTED)
    assert worst(after.poses) < 0.02
    assert after.attempts[0].verdict is Verdict.REMOVED
    assert after.attempts[0].reason == "refuted in hindsight; fits"


@pytest.mark.parametrize(
    ("n", "off", "astray", "is_doubtful"),
    [
        pytest.param(2, [0.0, 0.0, 0.0], 22, True, id="too few"),
        pytest.param(6, [2.5, 0.0, 0.0], None, True, id="similar places, and nothing contradicts the path"),
        pytest.param(6, [0.0, 0.0, 0.0], 22, False, id="nothing else contradicts the match"),
        pytest.param(6, [0.6, 0.0, 0.0], 22, True, id="similar places, which odometry explains no better"),
    ],
)
def test_the_path_stays_as_it_is(n: int, off: list[float], astray: int | None, is_doubtful: bool) -> None:
    claimed = refused(n, np.array(off))
    before = solution(claimed, astray, is_doubtful=is_doubtful)
    after = weighed(before, claimed, LoopClosureConfig(), _CONTESTED if astray and is_doubtful else _NOTHING)
    assert after is before


def test_where_nothing_led_the_path_astray_many_that_agree_are_no_witnesses() -> None:
    """All slid along one wall: odometry alone could bend so far, and nothing else would have to go."""
    claimed = refused(9, np.array([0.6, 0.0, 0.0]))
    known = solution(claimed, None)
    before = replace(known, factors=[factor for factor in known.factors if factor.kind != "ice"])
    assert weighed(before, claimed, LoopClosureConfig(), _NOTHING) is before


def test_only_what_the_path_alone_refused_is_asked_again() -> None:
    asked = closure(3, 30, np.zeros(3), 5.0)
    others = [
        closure(3, 31, np.zeros(3), 5.0, accepted=True),
        closure(3, 32, np.zeros(3), 1.0),
        replace(closure(3, 33, np.zeros(3), 5.0), off_path=np.nan),
    ]
    assert _refused_by_path([asked, *others], LoopClosureConfig()) == [asked]
