"""Matches that contradict odometry: which explanation is believed, by counts as real scans give them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from frontends.scan import Scan, ScanGeometry
from graph.measurement import NoMatch
from graph.odometry import OdometryMotion
from graph.se2 import compose, expmap
from iceg.ice.verification import Agreement
from iceg.slam.config import FrontEndConfig
from iceg.slam.contradiction import ContradictionConfig
from iceg.slam.tracking.odometry_check import Expectation, OdometryCheck
from iceg.slam.tracking.reach import Reach
from tests.scripted_matcher import ScriptedMatcher

_GEOMETRY = ScanGeometry(bearings=np.linspace(-1.5, 1.5, 181), range_min=0.1, range_max=20.0)
_SCAN = Scan(ranges=np.full(181, 5.0, np.float32), geometry=_GEOMETRY)
_EXPECTED = Expectation(
    T_track_key=np.zeros(3),
    motion=OdometryMotion(T_key_robot=np.array([0.5, 0.0, 0.1]), covariance=np.diag([0.03, 0.02, 0.02]) ** 2),
    is_known=True,
    reach=Reach(T_track_before=np.array([0.45, 0.0, 0.1]), most=np.array([1.0, 1.0])),
)
_ODOMETRY = _EXPECTED.T_track_robot
_FAR = compose(_ODOMETRY, np.array([0.3, 0.1, -0.8]))
_COVARIANCE = np.diag([0.01, 0.01, 0.005]) ** 2

_STATIC = Agreement(points=180, known=165, inliers=158, seen=130, contradicted=8)
"""A place that is right, among walls."""
_ELSEWHERE = Agreement(points=180, known=110, inliers=18, seen=22, contradicted=31)
"""One that is not: the scan looks through walls."""
_HIDDEN = Agreement(points=180, known=177, inliers=32, seen=8, contradicted=1)
"""A place that is right, behind people."""
_PEOPLE = Agreement(points=180, known=174, inliers=160, seen=7, contradicted=8)
"""One that is not, where the people of the scan lie on those who were there before."""


@dataclass(frozen=True)
class _Told(ScriptedMatcher):
    """Finds nothing, and counts what it was told of each pose, by its x."""

    counts: Mapping[float, Agreement]

    def prepare(self, scans: Sequence[Scan], T_ref_scans: NDArray[np.float64]) -> None:
        del scans, T_ref_scans

    def match(
        self, reference: object, scan: Scan, T_ref_guess: NDArray[np.float64], covariance_guess: NDArray[np.float64]
    ) -> NoMatch:
        del reference, scan, T_ref_guess, covariance_guess
        return NoMatch(reason="told so")

    def agreement(self, reference: object, scan: Scan, T_ref_cur: NDArray[np.float64]) -> Agreement:
        del reference, scan
        return self.counts[float(T_ref_cur[0])]


def _is_believed(far: Agreement, near: Agreement, expected: Expectation = _EXPECTED) -> bool:
    """A match far from odometry, close to which nothing else is found."""
    check = OdometryCheck(_Told({float(_FAR[0]): far, float(_ODOMETRY[0]): near}), FrontEndConfig())
    instead = check.judge(None, _SCAN, _ODOMETRY, _FAR, _COVARIANCE, expected)
    assert instead is None or isinstance(instead, NoMatch)
    return instead is None


def test_what_slid_along_a_ring_is_as_far_off_as_it_slid() -> None:
    along = np.array([1.0, 0.0, 0.2])
    slid = compose(_ODOMETRY, expmap(2.0 * along))
    covariance = 1e-6 * np.eye(3) + np.outer(along, along)
    assert _EXPECTED.distance2(slid, covariance) == pytest.approx(4.0, abs=0.1)


def test_odometry_that_jumps_is_not_believed_against_walls() -> None:
    assert _is_believed(_STATIC, _ELSEWHERE)


def test_people_who_walk_along_do_not_take_the_robot_with_them() -> None:
    """Of the beams 160 agree there, and 32 where it is: but what they look through tells, not where people stand."""
    assert not _is_believed(_PEOPLE, _HIDDEN)


def test_beams_that_end_on_people_prove_no_jump() -> None:
    """Next to nothing of the map is looked through at either place; all that speaks for a jump is where beams end."""
    found = Agreement(points=180, known=146, inliers=123, seen=37, contradicted=6)
    assert not _is_believed(found, Agreement(points=180, known=93, inliers=28, seen=12, contradicted=5))


def test_who_was_carried_away_is_at_neither_place() -> None:
    assert not _is_believed(_ELSEWHERE, _ELSEWHERE)


def test_a_place_that_fits_as_well_is_no_reason_to_jump() -> None:
    assert not _is_believed(_STATIC, Agreement(points=180, known=160, inliers=150, seen=120, contradicted=10))


def test_new_ground_where_odometry_has_the_robot_speaks_against_it() -> None:
    """A turn of 30° leaves most of what was seen in sight."""
    found = Agreement(points=330, known=318, inliers=309, seen=121, contradicted=0)
    assert _is_believed(found, Agreement(points=330, known=27, inliers=4))
    assert not _is_believed(found, Agreement(points=330, known=240, inliers=230, seen=90))
    nothing_in_view = Agreement(points=361, known=361, inliers=351)
    assert _is_believed(nothing_in_view, Agreement(points=361, known=12, inliers=2))


def test_no_robot_turns_so_far_between_two_scans() -> None:
    """What narrow lasers see of two corners speaks for a jump of 46°, but the robot turns by 6° at most."""
    found, odometry = Agreement(points=180, known=60, inliers=58, seen=40), Agreement(points=180, known=20, inliers=2)
    assert _is_believed(found, odometry)
    slow = replace(_EXPECTED, reach=replace(_EXPECTED.reach, most=np.array([0.1, 0.2])))
    assert not _is_believed(found, odometry, slow)
    assert not _is_believed(_STATIC, _ELSEWHERE, slow)
    nowhere = Agreement(points=180, known=170, inliers=5, contradicted=300)
    assert _is_believed(_STATIC, nowhere, slow)  # carried, it seems


def test_odometry_that_claims_what_no_robot_does_is_worth_as_little() -> None:
    found = Agreement(points=180, known=170, inliers=120, seen=40)
    odometry = Agreement(points=180, known=150, inliers=90)
    assert not _is_believed(found, odometry)
    far_back = replace(_EXPECTED, reach=Reach(T_track_before=_FAR, most=np.array([0.1, 0.2])))
    assert _is_believed(found, odometry, far_back)


@given(agreeing=st.integers(0, 200), against=st.integers(0, 200), unrelated=st.floats(1e-4, 0.5))
def test_what_may_tell_nothing_tells_less(agreeing: int, against: int, unrelated: float) -> None:
    config = ContradictionConfig()
    sure, doubtful = config.log_odds(agreeing, against), config.log_odds(agreeing, against, unrelated)
    assert abs(doubtful) <= abs(sure) + 1e-9
    assert doubtful == pytest.approx(0.0, abs=1e-9) or np.sign(doubtful) == np.sign(sure)


def test_among_people_the_ends_of_beams_decide_nothing_alone() -> None:
    config = ContradictionConfig()
    assert config.log_odds(0, 500) < -30.0
    assert config.log_odds(0, 500, 0.05) > -7.0
