"""How probable it makes a hypothesis that scans agree with it or contradict it."""

from dataclasses import replace
from fractions import Fraction
from math import exp, log, prod

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iceg.slam.broken_path.hypothesis_verification import FitCount
from iceg.slam.broken_path.path_break import FailureKind, TrackingFailure
from iceg.slam.closure_config import RelocalisationConfig, ViewChangeConfig
from iceg.slam.closures.attempt import Attempt
from iceg.slam.contradiction import ContradictionConfig

_CONFIG = RelocalisationConfig(
    contradiction=ContradictionConfig(right=0.1, right_strength=10.0, wrong=0.5, wrong_strength=2.0)
)
_few = st.integers(0, 60)


def _fit(agreeing: int, against: int, config: RelocalisationConfig = _CONFIG) -> FitCount:
    attempt = Attempt(key_old=0, key_new=1, match=None, accepted=True, reason="")
    return FitCount(agreeing=[attempt] * agreeing, against=against, config=config)


def _probability(agreeing: int, against: int, a: int, b: int) -> Fraction:
    """Of a sequence, the share that contradicts being beta distributed with a and b: Pólya's urn."""
    total = prod(range(a + b, a + b + agreeing + against))
    return Fraction(prod(range(a, a + against)) * prod(range(b, b + agreeing)), total)


@given(agreeing=_few, against=_few)
def test_counts_are_as_probable_as_draws_from_an_urn(agreeing: int, against: int) -> None:
    odds = _probability(agreeing, against, 1, 9) / _probability(agreeing, against, 1, 1)
    assert _fit(agreeing, against).log_odds == pytest.approx(log(odds.numerator) - log(odds.denominator), abs=1e-9)


@given(agreeing=_few, against=_few)
def test_who_agrees_makes_a_place_more_probable_and_who_contradicts_less(agreeing: int, against: int) -> None:
    before = _fit(agreeing, against).log_odds
    assert _fit(agreeing, against + 1).log_odds < before
    if against == 0:
        assert _fit(agreeing + 1, 0).log_odds > before


def test_places_may_be_alike_all_over() -> None:
    assert _fit(0, 0).log_odds == pytest.approx(0.0, abs=1e-12)
    many, more = _fit(100, 0).log_odds, _fit(200, 0).log_odds
    assert more - many < 0.2
    assert exp(_fit(20, 0, RelocalisationConfig()).log_odds) < 15.0


def test_one_scan_in_ten_against_it_makes_another_of_two_alike_places_the_right_one() -> None:
    config = RelocalisationConfig()
    right, alike = _fit(34, 0, config), _fit(33, 4, config)
    assert right.beats(alike)
    assert not alike.beats(right)
    assert not right.beats(_fit(30, 0, config))  # as many again would not tell them apart


def test_what_the_laser_sees_at_once_speaks_against_the_path() -> None:
    config = RelocalisationConfig()
    elsewhere, path = _fit(40, 0, config), _fit(39, 0, config)
    view = ViewChangeConfig()
    failure = TrackingFailure(kind=FailureKind.TRACKING_LOSS, reason="", log_odds_carried=5.0)
    assert not elsewhere.beats(path)
    assert elsewhere.beats(path, failure.log_odds_of_path(view))
    assert failure.log_odds_of_path(view) == -5.0


def test_a_view_that_goes_on_says_nothing_against_it() -> None:
    failure = TrackingFailure(kind=FailureKind.TRACKING_LOSS, reason="", log_odds_carried=-2.0)
    assert failure.log_odds_of_path(ViewChangeConfig()) == 0.0


def test_where_nothing_is_known_of_the_view_robots_are_seldom_carried() -> None:
    failure, view = TrackingFailure(kind=FailureKind.UNKNOWN_MOTION, reason=""), ViewChangeConfig(carried_prior=0.001)
    assert failure.log_odds_of_path(view) == pytest.approx(log(1000.0))
    many, one_more = _fit(40, 0, RelocalisationConfig()), _fit(2, 0, RelocalisationConfig())
    assert many.beats(one_more)
    assert not many.beats(one_more, failure.log_odds_of_path(view))


def test_many_similar_places_that_agree_are_seldom_wrong() -> None:
    config = RelocalisationConfig(alike_scans=8.0, alike_exponent=3.0)
    few, usual, many = (replace(_fit(20, 0, config), support=support) for support in (4, 8, 16))
    assert usual.log_odds == _fit(20, 0, config).log_odds
    assert many.log_odds - usual.log_odds == pytest.approx(3.0 * log(2.0)) == usual.log_odds - few.log_odds
    assert many.beats(usual)
    assert not few.is_sure


@pytest.mark.parametrize(
    ("agreeing", "against", "passed", "sure"),
    [(5, 0, False, False), (6, 0, True, True), (12, 1, True, True), (34, 4, True, False), (40, 13, False, False)],
)
def test_what_is_more_probably_wrong_than_right_is_not_sure(
    agreeing: int, against: int, passed: bool, sure: bool
) -> None:
    fit = _fit(agreeing, against, RelocalisationConfig())
    assert (fit.is_passed, fit.is_sure) == (passed, sure)
