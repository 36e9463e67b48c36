"""What a match errs by: a closure's lever, and odometry as the limit of a weak match."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.measurement import NoMatch, RelativePose
from graph.odometry import OdometryModel
from graph.se2 import compose, expmap
from iceg.evaluation.consistency import nees, relative_pose_errors
from iceg.slam.match_errors import closure_covariance, placement_covariance
from iceg.slam.track import KeyScan, Track

Array = NDArray[np.float64]

_SCAN = Scan(
    ranges=np.ones(31, np.float32),
    geometry=ScanGeometry(bearings=np.linspace(-1.5, 1.5, 31), range_min=0.1, range_max=20.0),
)


def _match(T_ref_cur: Array, covariance: Array) -> RelativePose:
    return RelativePose(
        T_ref_cur=T_ref_cur,
        covariance=covariance,
        score=1.0,
        inliers=31,
        overlap=1.0,
        weak_directions=np.zeros((0, 3)),
    )


def _track(covariances: list[Array | None]) -> Track:
    """Key scans with matches of these covariances, and odometry good to 0.1 m and 0.1 rad."""
    moved = replace(OdometryModel().start(), covariance=0.01 * np.eye(3))
    keys = [
        KeyScan(
            index=k,
            scan=_SCAN,
            motion=moved,
            match=NoMatch(reason="nothing") if covariance is None else _match(np.zeros(3), covariance),
            anchor=max(0, k - 1),
            T_track_robot=np.zeros(3),
        )
        for k, covariance in enumerate(covariances)
    ]
    n = len(keys)
    return Track(keys=keys, key_of_scan=np.arange(n), T_key_scan=np.zeros((n, 3)), failures=0, lost=[])


def test_a_closure_errs_by_the_heading_of_the_key_pose_it_hangs_on() -> None:
    # 1 mrad at 6 m is 6 mm across, and nothing along.
    match = _match(np.array([6.0, 0.0, 0.0]), 1e-6 * np.eye(3))
    widened = closure_covariance(match, np.diag([0.0, 0.0, 1e-6])) - match.covariance
    assert np.sqrt(np.diag(widened)) == pytest.approx([0.0, 6e-3, 1e-3])


def test_closures_are_as_far_off_as_they_say() -> None:
    rng = np.random.default_rng(0)
    own, placement = np.diag([2e-3, 1e-3, 5e-4]) ** 2, np.diag([1e-3, 3e-3, 1e-3]) ** 2
    T_old_new = np.array([-2.0, 3.0, 2.0])
    a, b = (rng.multivariate_normal(np.zeros(3), covariance, 3000) for covariance in (placement, own))
    measured = compose(compose(expmap(a), T_old_new), expmap(b))
    covariance = closure_covariance(_match(T_old_new, own), placement)
    errors = relative_pose_errors(measured, T_old_new)
    assert nees(errors, np.broadcast_to(covariance, (3000, 3, 3))).mean() == pytest.approx(3.0, rel=0.05)


def test_odometry_limits_what_a_weak_or_missing_match_leaves_open() -> None:
    good, weak = 1e-6 * np.eye(3), np.diag([1.0, 1e-6, 1e-6])
    track = _track([None, good, weak, None])
    assert placement_covariance(track, 1) == pytest.approx(0.5 * 1e-6 * np.eye(3), rel=1e-3)
    assert placement_covariance(track, 2)[0, 0] == pytest.approx(0.5 * 0.01, rel=0.02)
    assert placement_covariance(track, 3) == pytest.approx(0.01 * np.eye(3))


def test_the_first_key_scan_lies_as_well_as_the_second() -> None:
    track = _track([None, 1e-6 * np.eye(3), 4e-6 * np.eye(3)])
    assert (placement_covariance(track, 0) == placement_covariance(track, 1)).all()
