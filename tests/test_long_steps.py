"""Steps over many key scans: what they say, what covariance they have, and when there is none."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from graph.se2 import between, compose, expmap
from iceg.evaluation.consistency import nees, relative_pose_errors
from iceg.slam.long_steps import LONG_STEP, long_steps
from iceg.slam.tracking.track import KeyScan, Track

Array = NDArray[np.float64]

_SCAN = Scan(
    ranges=np.ones(31, np.float32),
    geometry=ScanGeometry(bearings=np.linspace(-1.5, 1.5, 31), range_min=0.1, range_max=20.0),
)
_OWN = np.array([0.003, 0.002, 0.001])
_DRIFT = np.array([0.001, 0.0007, 0.0003])


def _track(seed: int, n: int = 4 * LONG_STEP) -> tuple[Track, Array]:
    """Matches to one map: each with an error of its own, and a map that drifts slowly; and the truth."""
    rng = np.random.default_rng(seed)
    truth, placed = [np.zeros(3)], [np.zeros(3)]
    drift = np.zeros(3)
    for _ in range(n - 1):
        truth.append(compose(truth[-1], np.array([0.35, 0.0, rng.choice([-0.2, 0.0, 0.2])])))
        drift = compose(drift, expmap(_DRIFT * rng.normal(size=3)))
        placed.append(compose(truth[-1], compose(drift, expmap(_OWN * rng.normal(size=3)))))
    # As calibration finds it: the covariance of the step between two matches is that of both ends, and the drift.
    covariance = np.diag(2.0 * _OWN**2 + _DRIFT**2)
    still = OdometryModel().start()
    keys = [
        KeyScan(
            index=k,
            scan=_SCAN,
            motion=still,
            match=NoMatch(reason="first scan")
            if k == 0
            else RelativePose(
                T_ref_cur=between(placed[k - 1], placed[k]),
                covariance=covariance,
                score=1.0,
                inliers=31,
                overlap=1.0,
                weak_directions=np.zeros((0, 3)),
            ),
            anchor=max(0, k - 1),
            T_track_robot=placed[k],
        )
        for k in range(n)
    ]
    track = Track(keys=keys, key_of_scan=np.arange(n), T_key_scan=np.zeros((n, 3)), failures=0, lost=[])
    return track, np.array(truth)


def test_it_is_the_product_of_its_steps() -> None:
    track, _ = _track(0)
    step = long_steps(track)[2 * LONG_STEP]
    expected = np.zeros(3)
    for key in track.keys[LONG_STEP + 1 : 2 * LONG_STEP + 1]:
        assert isinstance(key.match, RelativePose)
        expected = compose(expected, key.match.T_ref_cur)
    np.testing.assert_allclose(step.T_ref_cur, expected, atol=1e-12)


def test_its_covariance_is_right_and_far_below_that_of_a_chain() -> None:
    values, chained = [], []
    for seed in range(60):
        track, truth = _track(seed)
        steps = long_steps(track)
        for key in range(2 * LONG_STEP, len(truth), LONG_STEP):
            step = steps[key]
            error = relative_pose_errors(step.T_ref_cur, between(truth[key - LONG_STEP], truth[key]))
            values.append(nees(error, step.covariance))
            chained.append(step.covariance[2, 2] / (LONG_STEP * (2.0 * _OWN[2] ** 2 + _DRIFT[2] ** 2)))
    assert np.mean(values) == pytest.approx(3.0, rel=0.3)
    assert np.mean(chained) < 0.3


def test_the_first_key_scan_has_no_error_of_its_own() -> None:
    track, _ = _track(1)
    steps = long_steps(track)
    first, second = steps[LONG_STEP], steps[2 * LONG_STEP]
    assert first.covariance[2, 2] < second.covariance[2, 2]


@pytest.mark.parametrize(
    "spoilt",
    [
        {"match": NoMatch(reason="dark")},
        {"anchor": 0},
        {"weak_directions": np.array([[1.0, 0.0, 0.0]])},
    ],
)
def test_there_is_none_where_a_match_does_not_hang_together_with_the_others(spoilt: dict[str, object]) -> None:
    track, _ = _track(2)
    key = track.keys[LONG_STEP + 2]
    assert isinstance(key.match, RelativePose)
    if "weak_directions" in spoilt:
        spoilt = {"match": replace(key.match, weak_directions=np.array([[1.0, 0.0, 0.0]]))}
    track.keys[LONG_STEP + 2] = replace(key, **spoilt)  # type: ignore[arg-type]
    assert sorted(long_steps(track)) == [LONG_STEP, 3 * LONG_STEP]
