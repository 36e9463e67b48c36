"""How probable it makes a hypothesis that scans agree with it or contradict it."""

from fractions import Fraction
from math import exp, log, prod

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iceg.slam.contradiction import ContradictionConfig

_CONFIG = ContradictionConfig(right=0.1, right_strength=10.0, wrong=0.5, wrong_strength=2.0)
_few = st.integers(0, 60)


def _probability(agreeing: int, against: int, a: int, b: int) -> Fraction:
    """Of a sequence, the share that contradicts being beta distributed with a and b: Pólya's urn."""
    total = prod(range(a + b, a + b + agreeing + against))
    return Fraction(prod(range(a, a + against)) * prod(range(b, b + agreeing)), total)


@given(agreeing=_few, against=_few)
def test_counts_are_as_probable_as_draws_from_an_urn(agreeing: int, against: int) -> None:
    odds = _probability(agreeing, against, 1, 9) / _probability(agreeing, against, 1, 1)
    assert _CONFIG.log_odds(agreeing, against) == pytest.approx(log(odds.numerator) - log(odds.denominator), abs=1e-9)


@given(agreeing=_few, against=_few)
def test_who_agrees_makes_a_place_more_probable_and_who_contradicts_less(agreeing: int, against: int) -> None:
    before = _CONFIG.log_odds(agreeing, against)
    assert _CONFIG.log_odds(agreeing, against + 1) < before
    if against == 0:
        assert _CONFIG.log_odds(agreeing + 1, 0) > before


def test_places_may_be_alike_all_over() -> None:
    assert _CONFIG.log_odds(0, 0) == pytest.approx(0.0, abs=1e-12)
    many, more = _CONFIG.log_odds(100, 0), _CONFIG.log_odds(200, 0)
    assert more - many < 0.2
    assert exp(ContradictionConfig().log_odds(20, 0)) < 15.0


def test_one_scan_in_ten_against_it_makes_another_of_two_alike_places_the_right_one() -> None:
    config = ContradictionConfig()
    right = config.log_odds(34, 0)
    assert right - config.log_odds(33, 4) > log(3.0)
    assert right - config.log_odds(30, 0) < 0.2  # as many again would not tell them apart
