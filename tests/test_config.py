"""The configuration of a run, as a whole."""

import dataclasses
import subprocess
import sys
import tomllib
import typing
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from graph.errors import IcegError
from iceg.cli.settings_flags import setting_names
from iceg.config import Config, ConfigError, format_config, parse_config, read_config
from iceg.maps.config import GridConfig
from iceg.settings_file import GONE, RENAMED, field_documentation


def leaves(cls: type, prefix: str = "") -> Iterator[tuple[str, Any, Any]]:
    """Dotted name, type and default of every setting."""
    hints = typing.get_type_hints(cls)
    for setting in dataclasses.fields(cls):
        hint = hints[setting.name]
        if dataclasses.is_dataclass(hint):
            yield from leaves(typing.cast("type", hint), f"{prefix}{setting.name}.")
        else:
            yield prefix + setting.name, hint, getattr(cls(), setting.name)


LEAVES = list(leaves(Config))


def replaced(settings: Any, dotted: str, value: object) -> Any:
    head, _, rest = dotted.partition(".")
    return dataclasses.replace(settings, **{head: replaced(getattr(settings, head), rest, value) if rest else value})


def values(hint: Any, default: Any) -> st.SearchStrategy[Any]:
    """Values near the default, which most ranges allow."""
    if typing.get_origin(hint) is Literal:
        return st.sampled_from(typing.get_args(hint))
    if hint is bool:
        return st.booleans()
    if isinstance(default, float):
        return st.floats(0.8, 1.2).map(lambda factor: default * factor)
    if isinstance(default, int):
        return st.integers(default, default + 3)
    return st.just(default)


@st.composite
def configs(draw: st.DrawFn) -> Config:
    config = Config()
    for dotted, hint, default in draw(st.lists(st.sampled_from(LEAVES), max_size=8)):
        try:
            config = replaced(config, dotted, draw(values(hint, default)))
        except (IcegError, ValueError):
            assume(False)
    return config


@pytest.mark.parametrize(
    ("make", "found"),
    [
        (lambda: Config(matcher="foo"), "matcher: found 'foo', expected one of ice, icp"),  # type: ignore[arg-type]
        (lambda: Config(stamps="none"), "stamps: found 'none', expected one of recorded, repaired"),  # type: ignore[arg-type]
        (lambda: Config(grid=GridConfig(mode="foo")), "grid.mode: found 'foo', expected one of"),  # type: ignore[arg-type]
    ],
)
def test_a_choice_that_there_is_not_is_refused_in_python_too(make: Callable[[], Config], found: str) -> None:
    with pytest.raises(ConfigError, match=found):
        make()


@settings(max_examples=40)  # each draws every setting there is
@given(configs())
def test_a_written_configuration_reads_back_the_same(config: Config) -> None:
    assert parse_config(format_config(config)) == config


def test_the_default_file_names_every_setting() -> None:
    table = tomllib.loads(format_config(Config()))
    for dotted, _, default in LEAVES:
        found: Any = table
        for key in dotted.split("."):
            found = found.get(key) if isinstance(found, dict) else None
        assert (found is None) == (default is None), dotted


@pytest.mark.parametrize(("dotted", "hint", "default"), LEAVES, ids=[leaf[0] for leaf in LEAVES])
def test_every_setting_is_documented_and_can_be_written(dotted: str, hint: Any, default: Any) -> None:
    owner: Any = Config()
    for key in dotted.split(".")[:-1]:
        owner = getattr(owner, key)
    assert field_documentation(type(owner))[dotted.rpartition(".")[2]], f"{dotted} says nothing about itself"
    if type(None) in typing.get_args(hint):
        assert default is None, f"{dotted}: TOML has no null, so only a default can be None"


def test_stages_are_frozen() -> None:
    for name, stage in vars(Config()).items():
        if dataclasses.is_dataclass(stage):
            with pytest.raises(dataclasses.FrozenInstanceError):
                setattr(stage, dataclasses.fields(stage)[0].name, None)
            assert name in format_config(Config())


def test_a_value_out_of_range_is_named_with_file_and_key(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[grid]\nresolution = -0.1\n")
    with pytest.raises(ConfigError, match=r"mine\.toml: grid\.resolution: .*-0\.1"):
        read_config(path)
    path.write_text("seed = -1\n")
    with pytest.raises(ConfigError, match=r"mine\.toml: seed: .*-1"):
        read_config(path)


def test_a_misspelt_key_gets_a_suggestion(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text("[grid]\nresolutoin = 0.1\n")
    with pytest.raises(ConfigError, match=r"did you mean 'grid\.resolution'\?"):
        read_config(path)


def test_importing_the_configuration_is_light() -> None:
    heavy = "('gtsam', 'numba', 'matplotlib', 'scipy')"
    code = f"import sys, iceg.config; sys.exit(', '.join(m for m in {heavy} if m in sys.modules))"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False).stderr.strip() == ""
    )


@pytest.mark.parametrize(
    ("setting", "value", "complaint"),
    [
        ("grid.resolution", "inf", "found resolution inf, expected a number from 0.0001 to 100000"),
        ("loops.spacing", "-1.0", "found spacing -1.0, expected 0 or more"),
        ("loops.confirmations", "0", "found confirmations 0, expected 1 or more"),
        ("finish.rounds", "-1", "found rounds -1, expected 0 or more"),
        ("finish.closure_false_alarm", "inf", "found closure_false_alarm inf, expected a number from 1e-09 to 0.5"),
        ("front_end.calibration_scans", "0", "found calibration_scans 0, expected 1 or more"),
        ("ice.hypotheses.field_sigma", "0.0", "found field_sigma 0.0, expected a positive number"),
        ("ice.covariance.points", "0", "found points 0, expected 1 or more"),
    ],
)
def test_numbers_that_a_run_cannot_work_with_are_refused(setting: str, value: str, complaint: str) -> None:
    with pytest.raises(ConfigError) as refusal:
        parse_config(f"{setting} = {value}", "here.toml")
    assert str(refusal.value) == f"here.toml: {setting}: {complaint}"


def test_what_has_no_end_may_be_infinite() -> None:
    assert parse_config("loops.min_path = inf").loops.min_path == np.inf


def test_a_setting_that_had_another_name_is_told_by_the_present_one() -> None:
    known = set(setting_names(Config))
    for before, now in RENAMED.items():
        assert before not in known
        assert now in known
        section, _, name = before.rpartition(".")
        with pytest.raises(ConfigError, match=rf"'{before}' is now '{now}'"):
            parse_config(f"[{section}]\n{name} = 1.0")


def test_a_setting_that_is_gone_is_told_with_what_stands_in_its_place() -> None:
    known = set(setting_names(Config)) | {
        "front_end.odometry_check.contradiction",
        "loops.relocalisation.contradiction",
        "loops.relocalisation.maps",
    }
    for before, why in GONE.items():
        assert before not in known
        assert {word for word in why.replace(",", " ").split() if "." in word} <= known
        section, _, name = before.rpartition(".")
        with pytest.raises(ConfigError, match=rf"'{before}' is gone, leave it out: {why}"):
            parse_config(f"[{section}]\n{name} = 1.0")


@pytest.mark.parametrize(
    "text",
    [
        "[front_end.odometry_check]\nfalse_alarm = 0.0",
        "[front_end.odometry_check]\njump_false_alarm = 0.6",
        "[front_end.calibration]\ngyro_false_alarm = 1e-12",
        "[front_end.standstill]\nsamples = 0",
        "[loops.failures]\nfalse_alarm = 1.0",
        "[loops.relocalisation.maps]\nmost_rays = 100_000_000",
        "[loops.verification]\nnear_distance = -0.1",
    ],
)
def test_thresholds_are_refused_that_mean_nothing(text: str) -> None:
    with pytest.raises(ConfigError):
        parse_config(text)
