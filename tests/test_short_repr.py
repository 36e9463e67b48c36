"""Records as one line for people."""

from dataclasses import dataclass, field, replace

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from frontends.scan import ScanGeometry
from graph.ranges import CheckedSettings
from graph.short_repr import changed_repr, short_repr
from iceg.config import Config
from iceg.slam.config import FinishConfig


@dataclass(frozen=True)
class Record:
    numbers: NDArray[np.float64]
    names: list[str]
    hidden: int = field(default=0, repr=False)

    __repr__ = short_repr


@dataclass(frozen=True, kw_only=True)
class Inner(CheckedSettings):
    width: float = 0.5


@dataclass(frozen=True, kw_only=True)
class Outer:
    count: int = 3
    inner: Inner = field(default_factory=Inner)

    __repr__ = changed_repr


@given(st.integers(0, 10_000), st.integers(0, 1000))
def test_a_record_takes_a_line_however_much_it_holds(numbers: int, names: int) -> None:
    shown = repr(Record(np.zeros(numbers), ["a"] * names))
    assert len(shown) < 150
    assert (f"<{numbers} float64>" in shown) == (numbers > 9)
    assert (f"<list of {names}>" in shown) == (names > 9)
    assert "hidden" not in shown


def test_few_numbers_are_shown() -> None:
    assert repr(Record(np.array([[1.0, 2.5]]), ["a"])) == "Record(numbers=[[1, 2.5]], names=['a'])"


def test_small_numbers_keep_their_digits() -> None:
    assert repr(Record(np.array([8.60019961e-07, -0.25]), [])) == "Record(numbers=[8.6002e-07, -0.25], names=[])"


@given(st.integers(0, 5), st.floats(0.25, 10.0))
def test_settings_show_what_makes_them_what_they_are(count: int, width: float) -> None:
    settings = Outer(count=count, inner=Inner(width=width))
    assert eval(repr(settings)) == settings
    assert ("count" in repr(settings), "inner" in repr(settings)) == (count != 3, width != 0.5)


def test_a_laser_given_in_plain_lists_is_shown_too() -> None:
    given = ScanGeometry(bearings=[-0.5, 0.0, 0.5], range_min=0.1, range_max=8.0, T_robot_laser=(0.2, 0.0, 0.0))  # type: ignore[arg-type]
    assert repr(given) == "ScanGeometry(3 beams from -28.65° to 28.65°, 0.1 to 8 m, at 0.2, 0 m, 0°)"


def test_all_settings_of_a_run_do() -> None:
    config = replace(Config(), seed=7, finish=FinishConfig(enabled=False))
    assert repr(Config()) == "Config()"
    assert repr(config) == "Config(seed=7, finish=FinishConfig(enabled=False))"
