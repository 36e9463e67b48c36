"""Whole blocks of CARMEN messages, which are read at once, against the same messages read line by line."""

from collections.abc import Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from frontends.logs import LogError, _sweep_kernels, carmen_records
from frontends.logs.carmen_records import Records, collect

_LASERS = ("FLASER", "ROBOTLASER1", "RAWLASER1")
_NUMBERS = ("1.25", "-0.5", ".5", "3", "81.830002", "1e1", "123456789012345678.5", "nan", "1e60", "x", "")
_ODD = st.sampled_from(
    ("# a comment", "", "\t# one", "\r", "ODOM 1 2 0.5 0 0 0 5.0 host 5.0", "ODOM x", "RLASER 1 x", "SYNC a 1 h 1")
)


@st.composite
def messages(draw: st.DrawFn) -> str:
    """A laser message, plain but for one of its words perhaps."""
    name = draw(st.sampled_from(_LASERS))
    n = draw(st.sampled_from((3, 3, 3, 2)))
    words = [name, str(n), *(f"{draw(st.integers(0, 9000)) / 1000:.3f}" for _ in range(n))]
    if name != "FLASER":
        step = draw(st.sampled_from(("0.5", "0.5", "0.25")))
        words[1:1] = ["0", "-0.5", "1.0", step, "81.9", "0.01", "0"]
        words += ["1", "12"]
    if name != "RAWLASER1":
        words += ["1.5", "-2", "0.25"] * 2
    if name == "ROBOTLASER1":
        words += ["0"] * 5
    words += [f"{draw(st.integers(0, 10**9)) / 1000:.6f}", "host", "0.5"]
    if draw(st.integers(0, 5)) == 0:
        words[draw(st.integers(1, len(words) - 1))] = draw(st.sampled_from(_NUMBERS))
    return draw(st.sampled_from((" ", " ", " ", "  ", "\t"))).join(words)


def collected(path: Path, lines: Sequence[str], names: tuple[str, ...]) -> Records:
    path.write_text("".join(f"{line}\n" for line in lines))
    return collect(path, names, skip_bad_lines=True)


@given(lines=st.lists(messages() | _ODD, max_size=12), names=st.permutations(_LASERS))
def test_blocks_hold_what_their_lines_hold(
    tmp_path_factory: pytest.TempPathFactory, lines: list[str], names: list[str]
) -> None:
    path = tmp_path_factory.mktemp("logs") / "robot.clf"
    # A blank before the name leaves a message to the reader of single lines.
    at_once, one_by_one = (collected(path, [f"{indent}{line}" for line in lines], tuple(names)) for indent in ("", " "))
    for field in fields(Records):
        if field.name not in {"ranges", "counts"}:
            assert repr(getattr(at_once, field.name)) == repr(getattr(one_by_one, field.name))
    assert at_once.counts == one_by_one.counts
    for one, other in zip(at_once.ranges, one_by_one.ranges, strict=True):
        assert one.dtype == np.float32
        assert_array_equal(one, other)


@pytest.mark.parametrize("n_before", [0, 1, 500])
def test_a_malformed_line_after_a_block_is_counted_right(tmp_path: Path, n_before: int) -> None:
    sound, path = "FLASER 2 1.5 2.5 0 0 0 0 0 0 1.0 host 1.0", tmp_path / "robot.clf"
    path.write_text("\n".join([*[sound, "ODOM 1 2 3 0 0 0 1 host 1"] * n_before, "FLASER 2 1.5", sound, ""]))
    with pytest.raises(LogError, match=rf":{2 * n_before + 1}: "):
        collect(path, ("FLASER",), skip_bad_lines=False)
    records = collect(path, ("FLASER",), skip_bad_lines=True)
    assert (len(records.ranges), records.counts["ODOM"]) == (n_before + 1, n_before)


def test_comments_are_passed_over_with_the_messages_around_them(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    calls = []

    def counted(*given: Any) -> int:
        calls.append(given)
        return _sweep_kernels.scan_sweeps(*given)

    monkeypatch.setattr(carmen_records, "scan_sweeps", counted)
    sound = "FLASER 2 1.5 2.5 0 0 0 0 0 0 1.0 host 1.0"
    records = collected(
        tmp_path / "robot.clf", [sound, *["# a comment", "", "\t # one more", "\r", sound] * 100], ("FLASER",)
    )
    assert (len(records.ranges), dict(records.counts)) == (101, {"FLASER": 101})
    assert len(calls) == 1
