"""What a match may be off because something else holds it: closed forms, and what becomes of a slip."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from graph.measurement import Held, RelativePose
from graph.se2 import compose
from iceg.ice.config import FalseMatchConfig
from iceg.ice.false_matches import allowing_for_chance

CONFIG = FalseMatchConfig()
ALONG, ACROSS = np.array([[0.6, 0.8, 0.1], [-0.8, 0.6, 0.0]])
SIGMA, TURN = 0.01, 0.002
FIRM = 50.0
"""So much wall leaves no doubt [m]."""


def match_held_by(length: float, **changed: object) -> RelativePose:
    """A match that so much wall holds along one direction, and much along the other."""
    described: dict[str, object] = {
        "T_ref_cur": np.array([2.0, 1.0, 0.5]),
        "covariance": np.diag([SIGMA**2, SIGMA**2, TURN**2]),
        "score": 1.0,
        "inliers": 100,
        "overlap": 1.0,
        "weak_directions": np.empty((0, 3)),
        "held": Held(directions=np.array([ALONG, ACROSS]), lengths=np.array([length, FIRM])),
    }
    return RelativePose(**{**described, **changed})  # type: ignore[arg-type]


def allowed(match: RelativePose, offset: float, deviation: float, *, is_measured: bool = True) -> RelativePose:
    """A match where odometry puts the robot so far along what little holds, and knows it so well."""
    there = compose(match.T_ref_cur, np.array([*(offset * ALONG[:2]), 0.0]))
    covariance = np.diag([deviation**2, deviation**2, 1e-4])
    return allowing_for_chance(match, there, covariance, CONFIG, is_measured=is_measured)


def variance_along(match: RelativePose) -> float:
    """Of the position, along the direction that little holds."""
    return float(ALONG[:2] @ match.covariance[:2, :2] @ ALONG[:2])


@given(offset=st.floats(-0.5, 0.5), deviation=st.floats(0.005, 0.2), length=st.floats(0.0, 3.0))
def test_what_is_added_is_the_probability_of_another_hold(offset: float, deviation: float, length: float) -> None:
    found = allowed(match_held_by(length), offset, deviation)
    before = CONFIG.probability / (1.0 + (length / CONFIG.length) ** 4)
    false = before * stats.norm.pdf(offset, scale=np.hypot(deviation, CONFIG.distance))
    agree = stats.norm.pdf(offset, scale=np.hypot(deviation, SIGMA))
    slipped = stats.cauchy.pdf(offset, scale=CONFIG.distance)
    right = (1.0 - before) * ((1.0 - CONFIG.slip) * agree + CONFIG.slip * slipped)
    added = false / (false + right) * CONFIG.distance**2
    assert variance_along(found) == pytest.approx(SIGMA**2 + added, rel=1e-6)
    assert found.is_fully_observed


@given(deviation=st.floats(0.001, 0.5), length=st.floats(0.0, 3.0))
def test_where_nothing_has_measured_the_guess_it_counts_by_its_cube(deviation: float, length: float) -> None:
    found = allowed(match_held_by(length), 0.0, deviation, is_measured=False)
    added = CONFIG.similar_per_metre * deviation**3 / (1.0 + (length / CONFIG.length) ** 4)
    assert variance_along(found) == pytest.approx(SIGMA**2 + added, rel=1e-5)
    assert (len(found.weak_directions) == 1) == (added > CONFIG.unobserved**2)
    if len(found.weak_directions):
        np.testing.assert_allclose(found.weak_directions[0], ALONG / np.linalg.norm(ALONG), rtol=1e-12)


def test_a_post_that_odometry_contradicts_holds_nothing() -> None:
    found = allowed(match_held_by(0.05), 0.17, 0.03)
    assert variance_along(found) == pytest.approx(CONFIG.distance**2, rel=0.2)
    agreeing = allowed(match_held_by(0.05), 0.02, 0.03)
    assert variance_along(agreeing) < 0.03**2


def test_a_wall_holds_whatever_odometry_says() -> None:
    found = allowed(match_held_by(3.0), 0.2, 0.03)
    assert variance_along(found) < (1.2 * SIGMA) ** 2


def test_odometry_that_slipped_far_says_nothing_of_the_match() -> None:
    found = allowed(match_held_by(0.3), 1.5, 0.03)
    assert variance_along(found) < (1.2 * SIGMA) ** 2


def test_what_is_not_observed_or_not_told_stays_as_it_is() -> None:
    for match in (match_held_by(0.0, held=None), match_held_by(0.0, weak_directions=np.array([[1.0, 0.0, 0.0]]))):
        assert allowed(match, 0.2, 0.03) is match
