"""Where a match that is in doubt contradicts odometry and few closures span it, the covariances have room for both."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

import iceg
from graph.factors import Factor
from graph.measurement import RelativePose
from graph.odometry import OdometryMotion
from graph.pose_graph import PoseGraph
from graph.se2 import compose
from iceg.slam.back_end import Solution
from iceg.slam.broken_path.path_break import Break
from iceg.slam.config import LoopClosureConfig
from iceg.slam.odometry.contradicted_steps import other_ways, with_both_ways
from iceg.slam.tracking.track import KeyScan, Track

_N, _TURNED = 61, 30
_STEP = np.array([1.0, 0.0, 0.0])
_TURN = np.array([0.0, 0.0, 0.4])
_KNOWN = np.broadcast_to(np.diag([0.01, 0.01, 1e-4]), (_N, 3, 3))
_SCAN = iceg.Scan.from_ranges(np.full(31, 4.0), field_of_view=np.pi)


class _Run(NamedTuple):
    solution: Solution
    factors: list[Factor]
    track: Track

    def covariances(self) -> NDArray[np.float64]:
        return with_both_ways(_KNOWN, other_ways(self.solution, self.factors, self.track, LoopClosureConfig()))


def _run(*contradicted: int, score: float = 0.5) -> _Run:
    """60 m straight on by odometry; the matches turned by .4 rad before one key pose."""
    match = RelativePose(
        T_ref_cur=_STEP,
        covariance=1e-4 * np.eye(3),
        score=score,
        inliers=20,
        overlap=1.0,
        weak_directions=np.zeros((0, 3)),
    )
    motion = OdometryMotion(T_key_robot=_STEP, covariance=0.01 * np.eye(3), distance=1.0)
    poses = np.zeros((_N, 3))
    for key in range(1, _N):
        poses[key] = compose(poses[key - 1], compose(_STEP, _TURN) if key == _TURNED else _STEP)
    keys = [
        KeyScan(index=k, scan=_SCAN, motion=motion, match=match, anchor=max(0, k - 1), T_track_robot=poses[k])
        for k in range(_N)
    ]
    factors = [Factor(kind="odometry", i=k - 1, j=k, T_i_j=_STEP, covariance=0.01 * np.eye(3)) for k in range(1, _N)]
    solution = Solution(
        graph=PoseGraph(),
        poses=poses,
        attempts=[],
        offered=np.ones(_N, np.bool_),
        odometry_jumps=contradicted,
    )
    track = Track(keys=keys, key_of_scan=np.arange(_N), T_key_scan=np.zeros((_N, 3)), failures=0, lost=[])
    return _Run(solution, factors, track)


def test_what_follows_may_lie_either_way() -> None:
    # Straight on after a turn of -φ against the poses: n steps further, the other way leads aside by nφ, to first
    # order; half of its square is the variance.
    found = _run(_TURNED).covariances()
    np.testing.assert_array_equal(found[:_TURNED], _KNOWN[:_TURNED])
    steps = np.arange(_N - _TURNED)
    np.testing.assert_allclose(found[_TURNED:, 2, 2], 1e-4 + 0.5 * 0.4**2)
    np.testing.assert_allclose(found[_TURNED:, 1, 1], 0.01 + 0.5 * (0.4 * steps) ** 2)
    np.testing.assert_allclose(found[_TURNED:, 0, 0], 0.01)


def test_what_one_step_lacks_and_the_next_makes_up_for_moves_nothing() -> None:
    run = _run(_TURNED, _TURNED + 1)
    run.factors[_TURNED] = replace(run.factors[_TURNED], T_i_j=compose(_TURN, _STEP))
    np.testing.assert_allclose(run.covariances()[_TURNED:], _KNOWN[_TURNED:], atol=1e-12)


@pytest.mark.parametrize("why", ["no contradiction", "near the beginning", "a match that explains its scan", "joined"])
def test_without_doubt_the_covariances_stay(why: str) -> None:
    run = _run(*{"no contradiction": (), "near the beginning": (5,)}.get(why, (_TURNED,)))
    if why == "a match that explains its scan":
        run = _run(_TURNED, score=0.9)
    if why == "joined":
        run = run._replace(
            solution=replace(run.solution, breaks=(Break(key=_TURNED, outcome="joined", reason="carried"),))
        )
    np.testing.assert_array_equal(run.covariances(), _KNOWN)


@pytest.mark.parametrize(("closures", "is_settled"), [(5, False), (6, True)])
def test_several_closures_settle_it(closures: int, is_settled: bool) -> None:
    run = _run(_TURNED)
    run.factors.extend(
        Factor(kind="closure", i=k, j=_N - 1, T_i_j=_STEP, covariance=np.eye(3)) for k in range(closures)
    )
    assert np.array_equal(run.covariances(), _KNOWN) == is_settled
