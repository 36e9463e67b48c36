"""How probable it makes a hypothesis that scans agree with it or contradict it."""

from fractions import Fraction
from math import exp, log, prod

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iceg.slam.broken_path.geometric_verification import FitCount
from iceg.slam.closure_config import RelocalisationConfig
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
    right = _fit(34, 0, config).log_odds
    assert right - _fit(33, 4, config).log_odds > log(3.0)
    assert right - _fit(30, 0, config).log_odds < 0.2  # as many again would not tell them apart


@pytest.mark.parametrize(
    ("agreeing", "against", "passed"),
    [
        (3, 1, False),
        (2, 0, False),
        (4, 4, False),
        (9, 4, False),
        (5, 0, False),
        (6, 0, True),
        (6, 1, True),
        (12, 1, True),
        (34, 4, True),
        (40, 13, False),
    ],
)
def test_a_tie_takes_more_than_a_majority(agreeing: int, against: int, passed: bool) -> None:
    assert _fit(agreeing, against, RelocalisationConfig()).is_passed == passed
