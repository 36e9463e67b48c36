"""Help that fits a screen, angles in degrees, completion in the shell, figures as JSON."""

import dataclasses
import json
import math
import re
import shutil
import subprocess
from pathlib import Path

import pytest

import iceg
from iceg.cli import main
from iceg.cli.commands import COMMANDS
from iceg.cli.parsing import parse
from iceg.cli.run import Run
from iceg.cli.settings_flags import parse_angle, setting_names
from iceg.config import Config, format_config, parse_config
from iceg.settings_file import field_documentation

SCREEN = 40


def helped(capsys: pytest.CaptureFixture[str], *words: str) -> str:
    with pytest.raises(SystemExit) as done:
        main([*words])
    assert not done.value.code
    return capsys.readouterr().out


@pytest.mark.parametrize("name", ["", *COMMANDS])
def test_help_fits_a_screen(name: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    assert helped(capsys, *filter(None, [name]), "--help").count("\n") <= SCREEN


def test_the_overview_tells_commands_and_exit_codes(capsys: pytest.CaptureFixture[str]) -> None:
    told = helped(capsys, "--help")
    assert all(f"\n  {name} " in told for name in COMMANDS)
    assert re.search(r"Exit codes: 0 .* 1 .* 2 .*\n70 .* 130 by Ctrl-C", told)


@pytest.mark.parametrize("name", [name for name, entry in COMMANDS.items() if entry.settings is not None])
def test_all_settings_are_told_on_request(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    entry = COMMANDS[name]
    assert entry.settings is not None
    flags = [f"--{entry.prefix}{setting}".replace("_", "-") for setting in setting_names(entry.settings)]
    short, long = helped(capsys, name, "--help"), helped(capsys, name, "--help-all")
    shown = {setting for setting in flags if setting in short}
    assert shown == {f"--{entry.prefix}{setting}".replace("_", "-") for setting in entry.common}
    assert all(flag in long for flag in flags)
    assert f"'iceg {name} --help-all' shows {len(flags) - len(entry.common)} more settings" in " ".join(short.split())


@pytest.mark.parametrize("name", COMMANDS)
def test_switches_are_told_as_what_they_do(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    told = " ".join(helped(capsys, name, "--help-all").split())
    assert "default: True" not in told
    assert "default: False" not in told


def test_a_setting_that_is_a_switch_is_on_or_off(capsys: pytest.CaptureFixture[str]) -> None:
    told = re.sub(r"[\s│]+", " ", helped(capsys, "run", "--help-all"))
    assert "--no-report Leave out report.html, the page that shows the run. --truth" in told
    assert "--finish.enabled, --finish.no-enabled Off leaves the incremental solution. (default: on)" in told
    assert "--graph.no-snapshot-before-closure" in told
    assert "rebuilt from its records instead. (default: off)" in told


def test_every_setting_has_a_sentence_of_its_own() -> None:
    def sentences(settings: object) -> list[str]:
        told = field_documentation(type(settings))
        values = {name: getattr(settings, name) for name in told}
        stages = {name: value for name, value in values.items() if dataclasses.is_dataclass(value)}
        own = [text for name, text in told.items() if name not in stages]
        return own + [text for value in stages.values() for text in sentences(value)]

    for kind in {entry.settings for entry in COMMANDS.values()} - {None}:
        assert kind is not None
        for text in sentences(kind()):
            assert text
            assert not text.startswith("…")
            assert not text.rstrip(".").endswith("…")


@pytest.mark.parametrize(
    ("text", "degrees"),
    [("20", 20.0), ("20°", 20.0), ("20deg", 20.0), ("-1.5 deg", -1.5), ("0.5rad", 28.64788975654116)],
)
def test_angles_are_in_degrees_unless_they_say_radians(text: str, degrees: float) -> None:
    assert math.degrees(parse_angle(text)) == pytest.approx(degrees)


@pytest.mark.parametrize("text", ["", "deg", "20grad", "a", "1e"])
def test_what_is_no_angle(text: str) -> None:
    with pytest.raises(ValueError, match="float"):
        parse_angle(text)


def test_angles_on_the_command_line_and_in_files(capsys: pytest.CaptureFixture[str]) -> None:
    told = helped(capsys, "run", "--help-all")
    assert "(default: 25°)" in told
    assert "0.436" not in told
    assert "[rad]" not in told
    words = ["run", "a.clf", "-o", "out", "--front-end.key-scans.angle", "20deg", "--grid.beam-width=1"]
    command = parse(words)
    assert isinstance(command, Run)
    assert command.settings.front_end.key_scans.angle == pytest.approx(math.radians(20))
    assert command.settings.grid.beam_width == pytest.approx(math.radians(1))
    assert "\nmin_angle = 0.4363323129985824  # 25°\n" in format_config(Config())
    assert parse_config(format_config(command.settings)) == command.settings


def test_an_unknown_command_gets_a_suggestion(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as done:
        main(["evl"])
    assert done.value.code == 2
    assert "found the command 'evl', did you mean 'eval'?" in capsys.readouterr().err


def completed(script: Path, *words: str) -> list[str]:
    """What bash offers for the last of the words after `iceg`."""
    line = " ".join(f"'{word}'" for word in ("iceg", *words))
    code = (
        f"source '{script}'; COMP_WORDS=({line}); COMP_CWORD={len(words)}; _iceg; printf '%s\\n' \"${{COMPREPLY[@]}}\""
    )
    bash = shutil.which("bash")
    assert bash is not None
    done = subprocess.run([bash, "--norc", "-c", code], capture_output=True, text=True, check=True)
    return done.stdout.split("\n")[:-1]


@pytest.mark.skipif(shutil.which("bash") is None, reason="no bash")
def test_bash_completes_commands_flags_choices_and_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--completion", "bash"]) == 0
    script = tmp_path / "iceg.bash"
    script.write_text(capsys.readouterr().out)
    assert completed(script, "e") == ["eval", "export"]
    assert completed(script, "run", "--grid.res") == ["--grid.resolution"]
    assert completed(script, "run", "--matcher", "q") == ["qwsm"]
    assert completed(script, "view", "--no-") == ["--no-browser"]
    assert completed(script, "eval", "x", "--by", "s") == ["scan", "stamp"]
    (tmp_path / "a log.clf").touch()
    assert completed(script, "info", f"{tmp_path}/a") == [f"{tmp_path}/a log.clf"]


@pytest.mark.parametrize("shell", ["zsh", "fish"])
def test_other_shells_complete_the_same(shell: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--completion", shell]) == 0
    text = capsys.readouterr().out
    assert all(name in text for name in COMMANDS)
    assert "front-end.key-scans.angle" in text
    found = shutil.which(shell)
    if found is not None:
        (tmp_path / "script").write_text(text)
        subprocess.run([found, "--no-execute", str(tmp_path / "script")], check=True)


@pytest.mark.parametrize("words", [[], ["tcsh"], ["bash", "zsh"]])
def test_no_other_shell(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--completion", *words]) == 2
    assert "expected one of bash, zsh, fish" in capsys.readouterr().err


def test_figures_come_as_one_json_object(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log, graph = str(iceg.demo_log_path()), tmp_path / "in.g2o"
    assert main(["info", log, "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert (info["scans"], info["beams"], info["path"]) == (1848, 181, "office.clf.gz")
    assert info["field_of_view_rad"] == pytest.approx(math.pi)
    assert main(["convert", log, str(tmp_path / "a.csv"), "--json"]) == 0
    captured = capsys.readouterr()
    assert json.loads(captured.out) == {"scans": 1848}
    assert "1848 scans are in" in captured.err
    edge = "EDGE_SE2 {} {} 1 0 0 100 0 0 100 0 100\n"
    graph.write_text(edge.format(0, 1) + edge.format(1, 2))
    assert main(["optimize", str(graph), "-o", str(tmp_path / "out.g2o"), "--json"]) == 0
    solved = json.loads(capsys.readouterr().out)
    assert (solved["vertices"], solved["closures"], solved["rejected"]) == (3, 0, [])


def test_a_run_tells_the_same_figures_as_its_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    short = tmp_path / "short.clf"
    iceg.write_log(short, iceg.read_log(iceg.demo_log_path()).select(slice(0, 80)))
    assert main(["run", str(short), "-o", str(tmp_path / "out"), "--json"]) == 0
    captured = capsys.readouterr()
    figures, folder = json.loads(captured.out), iceg.read_run_folder(tmp_path / "out")
    assert figures["landmarks"] == len(folder.landmarks.settled())
    assert figures["landmarks_in_all"] == len(folder.landmarks)
    assert figures["closures_tried"] == len(folder.closures)
    assert (figures["scans"], figures["key_poses"]) == (80, len(folder.key_scans))
    assert f"{figures['landmarks']} landmarks" in captured.err
