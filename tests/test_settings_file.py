"""Settings files: strict when read, complete when written."""

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from iceg.settings_file import ConfigError, field_documentation, format_settings, parse_settings, read_settings


@dataclass(frozen=True, kw_only=True)
class Inner:
    """The inner stage."""

    width: float = 0.5
    """Width of it [m]."""
    mode: Literal["fast", "slow"] = "fast"
    """How it goes."""

    def __post_init__(self) -> None:
        if not self.width > 0:
            raise ValueError(f"width is {self.width} m, expected > 0")


@dataclass(frozen=True, kw_only=True)
class Stage:
    """A stage.

    Attributes:
        count: how many
            there are.
        inner: what is inside.
    """

    count: int = 3
    on: bool = True
    limit: float | None = None
    window: tuple[float, float] = (1.0, 2.0)
    names: tuple[str, ...] = ()
    place: Path = Path("somewhere")
    inner: Inner = field(default_factory=Inner)


@dataclass(frozen=True, kw_only=True)
class Whole:
    """Everything."""

    stage: Stage = field(default_factory=Stage)
    seed: int = 0
    """Where randomness starts."""


_FLOATS = st.floats(allow_nan=False)
_TEXT = st.text(st.characters(codec="utf-8", exclude_categories=["Cs"]), max_size=8)
_WHOLES = st.builds(
    Whole,
    seed=st.integers(-(2**63), 2**63 - 1),
    stage=st.builds(
        Stage,
        count=st.integers(-(2**63), 2**63 - 1),
        on=st.booleans(),
        limit=st.none() | _FLOATS,
        window=st.tuples(_FLOATS, _FLOATS),
        names=st.lists(_TEXT, max_size=3).map(tuple),
        place=_TEXT.map(Path),
        inner=st.builds(Inner, width=st.floats(min_value=0, exclude_min=True), mode=st.sampled_from(["fast", "slow"])),
    ),
)


@given(_WHOLES)
def test_what_is_written_reads_back_the_same(settings: Whole) -> None:
    assert parse_settings(Whole, format_settings(settings, heading="All of it."), "here") == settings


def test_every_key_is_written_with_its_documentation() -> None:
    text = format_settings(Whole())
    assert text == (
        "# Where randomness starts.\nseed = 0\n\n"
        "# A stage.\n[stage]\n"
        "# how many there are.\ncount = 3\n"
        "on = true\n"
        "# limit =  (unset; a number)\n"
        "window = [1.0, 2.0]\n"
        "names = []\n"
        'place = "somewhere"\n\n'
        "# what is inside.\n[stage.inner]\n"
        "# Width of it [m].\nwidth = 0.5\n"
        "# How it goes. (one of 'fast', 'slow')\nmode = \"fast\"\n"
    )


def test_documentation_is_found_in_both_styles() -> None:
    assert field_documentation(Stage)["count"] == "how many there are."
    assert field_documentation(Inner)["width"] == "Width of it [m]."
    assert field_documentation(Stage)["on"] == ""


def test_what_a_file_leaves_out_keeps_its_default() -> None:
    assert parse_settings(Whole, "[stage.inner]\nwidth = 2\n", "here") == Whole(stage=Stage(inner=Inner(width=2.0)))
    assert parse_settings(Whole, "", "here") == Whole()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("sed = 1", "unknown key 'sed', did you mean 'seed'?"),
        ("[stag]\ncount = 1", "unknown key 'stag', did you mean 'stage'?"),
        ("[stage]\ncuont = 1", "unknown key 'stage.cuont', did you mean 'stage.count'?"),
        ("[stage.inner]\nwdith = 1", "unknown key 'stage.inner.wdith', did you mean 'stage.inner.width'?"),
        ("width = 1", "unknown key 'width', did you mean 'stage.inner.width'?"),
        ("[stage.inner]\ncount = 1", "unknown key 'stage.inner.count', did you mean 'stage.count'?"),
        ("[stage.inner]\nzdt = 1", "unknown key 'stage.inner.zdt', expected one of width, mode"),
        ("zzzzzz = 1", "unknown key 'zzzzzz', expected one of stage, seed"),
        ("seed = 1.5", "seed: found 1.5, expected a whole number"),
        ("seed = true", "seed: found True, expected a whole number"),
        ("seed = '1'", "seed: found '1', expected a whole number"),
        ("stage = 1", "stage: found 1, expected a table [stage]"),
        ("[stage]\non = 1", "stage.on: found 1, expected true or false"),
        ("[stage]\nlimit = 'x'", "stage.limit: found 'x', expected a number"),
        ("[stage]\nlimit = true", "stage.limit: found True, expected a number"),
        ("[stage]\nwindow = [1.0]", "stage.window: found [1.0], expected a list of a number, a number"),
        ("[stage]\nwindow = 1.0", "stage.window: found 1.0, expected a list"),
        ("[stage]\nnames = ['a', 1]", "stage.names: found ['a', 1], expected a list of a string, ..."),
        ("[stage.inner]\nmode = 'medium'", "stage.inner.mode: found 'medium', expected one of 'fast', 'slow'"),
        ("[stage.inner]\nmode = [1]", "stage.inner.mode: found [1], expected one of 'fast', 'slow'"),
        ("[stage.inner]\nwidth = -1", "stage.inner.width: width is -1.0 m, expected > 0"),
        ("[stage.inner]\nmode = 'slow'\nwidth = nan", "stage.inner.width: found nan, expected a number"),
        ("seed = ", "not valid TOML"),
    ],
)
def test_what_is_wrong_is_named_with_file_and_key(text: str, message: str) -> None:
    with pytest.raises(ConfigError) as caught:
        parse_settings(Whole, text, "my.toml")
    assert str(caught.value).startswith("my.toml: ")
    assert message in str(caught.value)


def test_a_refused_combination_names_all_its_keys() -> None:
    @dataclass(frozen=True, kw_only=True)
    class Interval:
        low: float = 0.0
        high: float = 1.0

        def __post_init__(self) -> None:
            if self.low == 0.25 and self.high == 0.75:
                raise ValueError("not these two together")

    with pytest.raises(ConfigError, match=r"my.toml: low, high: not these two together"):
        parse_settings(Interval, "low = 0.25\nhigh = 0.75", "my.toml")


def test_files_are_read_and_missing_ones_named(tmp_path: Path) -> None:
    path = tmp_path / "my.toml"
    path.write_text("seed = 4\n")
    assert read_settings(Whole, path).seed == 4
    with pytest.raises(ConfigError, match=r"none\.toml: cannot be read"):
        read_settings(Whole, tmp_path / "none.toml")
    path.write_bytes(b"\xff")
    with pytest.raises(ConfigError, match="cannot be read"):
        read_settings(Whole, path)


def test_infinities_are_kept() -> None:
    assert parse_settings(Stage, format_settings(Stage(limit=-math.inf)), "here").limit == -math.inf


def test_what_is_not_a_number_is_no_number() -> None:
    with pytest.raises(ConfigError, match=r"here: limit: found nan, expected a number"):
        parse_settings(Stage, "limit = nan", "here")


def test_a_missing_file_is_said_once(tmp_path: Path) -> None:
    path = tmp_path / "missing.toml"
    with pytest.raises(ConfigError) as caught:
        read_settings(Stage, path)
    assert str(caught.value) == f"{path}: cannot be read as a configuration: No such file or directory"
