"""The compiled number parser against Python's own `float`."""

import math
import struct

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from frontends.logs._number_kernels import scan_numbers
from frontends.logs.errors import MalformedLineError
from frontends.logs.number_fields import read_numbers
from frontends.logs.text import Line

plain = st.from_regex(r"\A[+-]?([0-9]{1,12}\.?[0-9]{0,12}|\.[0-9]{1,12})\Z")
long_decimals = st.from_regex(r"\A-?[0-9]{0,20}\.[0-9]{1,30}\Z")
printed = st.floats().map(repr) | st.floats(width=32).map(lambda value: f"{value:g}") | st.just("nan")
fixed = st.floats(-1e9, 1e9).map(lambda value: f"{value:.6f}")
tokens = plain | long_decimals | printed | fixed
gaps = st.sampled_from([" ", "  ", "\t", " \t "])
_not_space = st.characters(max_codepoint=126, exclude_characters=" \t\n\r\x0b\x0c")
rubbish = st.text(_not_space, min_size=1, max_size=12) | st.builds("{}\x00{}".format, fixed, fixed)


def as_line(text: str, *, before: str = "FLASER 12", after: str = "\n1.5 2.5\n") -> tuple[Line, int]:
    block = (before + text + after).encode()
    start = len(before.encode())
    view = np.frombuffer(block, dtype=np.uint8)
    return Line(1, block, view, start, start + len(text.encode()), terminated=True), start


def bits(value: float) -> bytes:
    return b"nan" if math.isnan(value) else struct.pack("<d", value)


@given(st.lists(st.tuples(gaps, tokens), min_size=1, max_size=12))
@example([(" ", "-0.000000"), (" ", "976052857.337530"), (" ", "9007199254740993"), (" ", "0.1"), (" ", "1e22")])
def test_every_number_is_what_float_makes_of_it(parts: list[tuple[str, str]]) -> None:
    line, position = as_line("".join(gap + token for gap, token in parts))
    out = np.full(len(parts), 7.0)
    end = read_numbers(line, position, out, "of the test")
    assert end == line.stop
    assert [bits(value) for value in out.tolist()] == [bits(float(token)) for _, token in parts]


@given(st.lists(tokens, max_size=5), rubbish)
def test_rubbish_is_told_from_numbers_as_float_tells_it(good: list[str], bad: str) -> None:
    line, position = as_line("".join(f" {token}" for token in [*good, bad]))
    out = np.empty(len(good) + 1)
    try:
        expected = float(bad.encode())
    except ValueError:
        with pytest.raises(MalformedLineError, match=f"number {len(good) + 1} of" if good else "found"):
            read_numbers(line, position, out, "of the test")
    else:
        read_numbers(line, position, out, "of the test")
        assert bits(float(out[-1])) == bits(expected)


@given(st.lists(fixed, max_size=6), st.integers(1, 4))
def test_a_line_that_ends_early_never_borrows_from_the_next(good: list[str], missing: int) -> None:
    line, position = as_line("".join(f" {token}" for token in good))
    with pytest.raises(MalformedLineError, match="the end of the line"):
        read_numbers(line, position, np.empty(len(good) + missing), "of the test")


def test_the_kernel_itself_takes_the_common_numbers() -> None:
    text = b" 81.83 -3.141593 976052857.337530 7 +.5 5."
    out = np.empty(6)
    assert scan_numbers(np.frombuffer(text, dtype=np.uint8), 0, len(text), out) == (6, len(text))
    assert out.tolist() == [81.83, -3.141593, 976052857.337530, 7.0, 0.5, 5.0]


def test_digit_grouping_is_no_number() -> None:
    line, position = as_line(" 1_000")
    with pytest.raises(MalformedLineError, match="'1_000'"):
        read_numbers(line, position, np.empty(1), "of the test")
