"""Odometry does not hold together what a sudden loss has torn apart."""

import numpy as np
import pytest

import iceg
from graph.factors import Factor
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryMotion
from iceg.slam.broken_path.path_break import Break, Outcome, without_lost_odometry
from iceg.slam.track import UNKNOWN_STEP, KeyScan, Track

_SCAN = iceg.Scan.from_ranges(np.full(31, 4.0), field_of_view=np.pi)
_NOTHING = NoMatch(reason="nothing")
_STEP = np.array([0.5, 0.0, 0.1])
_ODOMETRY = np.diag([0.02, 0.01, 0.01]) ** 2


def _match(*weak: tuple[float, float, float]) -> RelativePose:
    return RelativePose(
        T_ref_cur=_STEP,
        covariance=1e-4 * np.eye(3),
        score=1.0,
        inliers=31,
        overlap=1.0,
        weak_directions=np.array(weak).reshape(-1, 3),
    )


def _track(*matches: RelativePose | NoMatch) -> Track:
    keys = [
        KeyScan(
            index=10 * k,
            scan=_SCAN,
            motion=OdometryMotion(T_key_robot=_STEP, covariance=_ODOMETRY),
            match=match,
            anchor=max(0, k - 1),
            T_track_robot=k * _STEP,
        )
        for k, match in enumerate(matches)
    ]
    n = len(keys)
    return Track(keys=keys, key_of_scan=np.arange(n), T_key_scan=np.zeros((n, 3)), failures=0, lost=[])


def _chain(n: int) -> list[Factor]:
    prior = Factor(kind="prior", i=None, j=0, T_i_j=np.zeros(3), covariance=1e-6 * np.eye(3))
    steps = [Factor(kind="odometry", i=k - 1, j=k, T_i_j=_STEP, covariance=_ODOMETRY) for k in range(1, n)]
    return [prior, *steps, Factor(kind="ice", i=0, j=1, T_i_j=_STEP, covariance=1e-4 * np.eye(3))]


def _without_lost_odometry(track: Track, key: int, outcome: Outcome = Outcome.APART, *, agreeing: int = 0) -> list[int]:
    """Second key poses of the steps of which odometry tells nothing."""
    factors = _chain(len(track.keys))
    after = without_lost_odometry(factors, [Break(key=key, outcome=outcome, reason="", closures=agreeing)], track, 3)
    changed = [now for was, now in zip(factors, after, strict=True) if now is not was]
    assert all(np.allclose(factor.covariance, UNKNOWN_STEP) for factor in changed)
    return [factor.j for factor in changed]


def test_a_robot_that_saw_well_and_then_knows_nothing_may_be_anywhere() -> None:
    assert _without_lost_odometry(_track(_NOTHING, _match(), _match(), _NOTHING, _match()), 3) == [3]


def test_one_that_has_a_single_scan_to_know_goes_on_as_odometry_says() -> None:
    assert _without_lost_odometry(_track(_NOTHING, _NOTHING, _match()), 1) == []


@pytest.mark.parametrize(("agreeing", "torn"), [(0, [2]), (2, [2]), (3, [])])
def test_so_does_one_whose_scans_agree_with_odometry_across_the_loss(agreeing: int, torn: list[int]) -> None:
    assert _without_lost_odometry(_track(_NOTHING, _match(), _NOTHING, _match()), 2, agreeing=agreeing) == torn


@pytest.mark.parametrize("before", [_NOTHING, _match((1.0, 0.0, 0.0))])
def test_one_that_saw_little_before_goes_on_as_odometry_says(before: RelativePose | NoMatch) -> None:
    assert _without_lost_odometry(_track(_NOTHING, _match(), before, _NOTHING, _match()), 3) == []


@pytest.mark.parametrize("outcome", [Outcome.JOINED, Outcome.CREDIBLE, Outcome.CONTRADICTED])
def test_only_parts_that_nothing_joins(outcome: Outcome) -> None:
    assert _without_lost_odometry(_track(_NOTHING, _match(), _NOTHING, _match()), 2, outcome) == []
