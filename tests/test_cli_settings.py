"""Settings on the command line: flags, files, and what is refused."""

from pathlib import Path

import pytest

from iceg.cli import main
from iceg.cli.parsing import parse
from iceg.cli.run import Run
from iceg.cli.tools import PrintConfig
from iceg.config import Config, format_config, parse_config


@pytest.mark.parametrize("words", [["--loops.enabled", "False"], ["--loops.enabled=off"], ["--loops.enabled", "1"]])
def test_a_switch_that_is_given_a_value_is_told_how_it_is_switched(
    words: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "a.clf", "-o", "out", *words]) == 2
    error = capsys.readouterr().err
    assert "expected --loops.enabled for on or --loops.no-enabled for off" in error
    assert error.count("\n") == 1


def test_flags_override_the_file_which_overrides_the_defaults(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("seed = 5\n[grid]\nresolution = 0.2\nmode = 'binary'\n")
    command = parse(["run", "a.clf", "-o", "out", "--config", str(file), "--grid.resolution", "0.1"])
    assert isinstance(command, Run)
    assert (command.log, command.output) == (Path("a.clf"), Path("out"))
    assert command.settings.seed == 5
    assert command.settings.grid.mode == "binary"
    assert command.settings.grid.resolution == 0.1
    assert command.settings.grid.max_range == Config().grid.max_range
    again = parse(["run", "--grid.resolution=0.1", f"--config={file}", "a.clf", "-o", "out"])
    assert isinstance(again, Run)
    assert again.settings == command.settings
    plain = parse(["run", "a.clf", "-o", "out"])
    assert isinstance(plain, Run)
    assert plain.settings == Config()


def test_a_run_without_flags_for_settings_is_parsed_as_one_with_them(tmp_path: Path) -> None:
    file = tmp_path / "mine.toml"
    file.write_text("seed = 5\n")
    words = ["run", "a.clf", "-o", "out", "--config", str(file), "--closures=by-hand.csv", "--skip-bad-lines"]
    command = parse(words)
    assert command == parse([*words, "--seed", "5"])
    assert isinstance(command, Run)
    assert (command.closures, command.skip_bad_lines, command.overwrite) == (Path("by-hand.csv"), True, False)
    assert parse([*words, "--overwrite"]) == parse(["run", "--overwrite", "--seed=5", *words[1:]])


def test_config_prints_a_file_that_reads_back(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["config"]) == 0
    text = capsys.readouterr().out
    assert text == format_config(Config())
    assert parse_config(text) == Config()
    file = tmp_path / "mine.toml"
    file.write_text("[grid]\nresolution = 0.2\n")
    command = parse(["config", "--config", str(file), "--seed", "3"])
    assert isinstance(command, PrintConfig)
    assert (command.settings.seed, command.settings.grid.resolution) == (3, 0.2)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[grid]\nresolutoin = 1\n", "did you mean 'grid.resolution'?"),
        ("[grid]\nresolution = -1\n", "grid.resolution: "),
        ("[loops.relocalisation.maps]\nscans = 0\n", "loops.relocalisation.maps.scans: "),
        ("[loops.verification]\npartner_turn = 0.0\n", "loops.verification.partner_turn: "),
    ],
)
def test_bad_settings_in_a_file_are_a_usage_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], text: str, message: str
) -> None:
    file = tmp_path / "mine.toml"
    file.write_text(text)
    assert main(["run", "a.clf", "-o", str(tmp_path / "out"), "--config", str(file)]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"iceg: {file}: ")
    assert message in error
    assert error.count("\n") == 1


@pytest.mark.parametrize(
    ("flags", "complaint"),
    [
        (["--grid.resolution", "-1"], "--grid.resolution: found resolution -1.0, expected 0 or more"),
        (
            ["--ice.segments.gap", "1", "--ice.segments.min-points", "1"],
            "--ice.segments.min-points: found min_points 1, expected a number from 2 to 10000",
        ),
        (
            ["--ice.features.min-angle", "3rad"],
            "--ice.features.min-angle: found min_angle 3.0, expected a number from 0 to 1.5708 (in radians)",
        ),
        (
            ["--ice.refinement.scale", "2", "--ice.refinement.coarse-scale", "1"],
            "--ice.refinement.scale: found scale 2.0 m, expected at most coarse_scale, 1.0 m",
        ),
        (["--log.range-max", "-1"], "--log.range-max: range_max is -1.0 m, expected more than 0.0 m, at most 10000 m"),
        (["--log.laser-x", "200"], "--log.laser-x: laser_x is 200.0, expected at most 100 on either side of zero"),
    ],
)
def test_a_flag_out_of_range_is_a_usage_error(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], flags: list[str], complaint: str
) -> None:
    assert main(["run", "a.clf", "-o", str(tmp_path / "out"), *flags]) == 2
    assert capsys.readouterr().err == f"iceg: {complaint}\n"


@pytest.mark.parametrize("flag", [["--loops.odometry-doubt", "3"], ["--loops.odometry-doubt=3"]])
def test_a_flag_that_had_another_name_is_told_by_the_present_one(
    flag: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", "a.clf", "-o", "out", *flag]) == 2
    assert "'--loops.odometry-doubt' is now '--loops.odometry-inflation'" in capsys.readouterr().err
