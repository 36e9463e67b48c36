"""The command line: what it takes, prints and returns."""

import os
import shlex
import subprocess
import sys
from importlib.metadata import version

import pytest

import iceg
from iceg.cli import main
from iceg.demo import demo_log_path


def iceg_process(*words: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-m", "iceg", *words], capture_output=True, text=True, check=False)


def test_help_names_the_commands_and_loads_nothing_heavy() -> None:
    code = (
        "import sys, iceg.cli\n"
        "try: iceg.cli.main(['--help'])\n"
        "except SystemExit as done: assert not done.code\n"
        "sys.exit(', '.join(m for m in ('gtsam', 'numba', 'matplotlib', 'scipy') if m in sys.modules))"
    )
    words, env = [sys.executable, "-c", code], os.environ | {"PYTHONIOENCODING": "utf-8"}
    done = subprocess.run(words, capture_output=True, encoding="utf-8", check=False, env=env)
    assert done.stderr.strip() == ""
    for command in ("run", "demo", "info", "eval", "plot", "config"):
        assert f"\n  {command} " in done.stdout


def test_version_tells_of_iceg_and_what_it_rests_on(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["--version"]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == f"iceg {version('iceg')}"
    for name in ("gtsam", "numba", "numpy", "scipy"):
        assert f"{name} {version(name)}" in lines
    assert f"extra dxf: ezdxf {version('ezdxf')}" in lines
    assert not [line for line in lines if line.startswith("extra dev")]


def test_an_extra_that_is_not_installed_is_named_with_what_it_lacks(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = [
        "numpy>=2",
        "ezdxf<2,>=1.3; extra == 'dxf'",
        "no-such-package; extra == 'more'",
        "ruff>=0.8; extra == 'dev'",
    ]
    monkeypatch.setattr("iceg.cli.versions.requires", lambda _: asked)
    assert main(["--version"]) == 0
    extras = [line for line in capsys.readouterr().out.splitlines() if line.startswith("extra")]
    assert extras == [f"extra dxf: ezdxf {version('ezdxf')}", "extra more: not installed, lacks no-such-package"]


@pytest.mark.parametrize(("given", "expected"), [({}, "1"), ({"OPENBLAS_NUM_THREADS": "3"}, "3")])
def test_matrices_are_multiplied_by_one_thread_unless_the_user_wants_more(given: dict[str, str], expected: str) -> None:
    code = (
        "import os, sys\n"
        "from iceg.cli import main\n"
        "assert 'numpy' not in sys.modules, 'too late to tell NumPy'\n"
        "main(['--version'])\n"
        "sys.exit(os.environ['OPENBLAS_NUM_THREADS'])"
    )
    others = {name: value for name, value in os.environ.items() if not name.endswith("_NUM_THREADS")}
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, capture_output=True, text=True, check=False, env=others | given)
    assert done.stderr.strip() == expected


@pytest.mark.parametrize("words", [["fly"], [], ["run"], ["run", "a.clf", "-o", "out", "--grid.resolutoin", "1"]])
def test_what_cannot_be_parsed_is_a_usage_error(words: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as done:
        main(words)
    assert done.value.code == 2
    assert capsys.readouterr().out == ""


def test_a_misspelt_flag_gets_a_suggestion() -> None:
    done = iceg_process("run", "a.clf", "-o", "out", "--grid.resolutoin", "1")
    assert done.returncode == 2
    assert "--grid.resolution" in done.stderr


def test_parsing_a_run_loads_only_what_it_needs() -> None:
    code = (
        "import sys, iceg.cli.parsing\n"
        "iceg.cli.parsing.parse(['run', 'a.clf', '-o', 'out'])\n"
        "sys.exit(', '.join(m for m in ('gtsam', 'numba', 'typeguard', 'asyncio', 'unittest') if m in sys.modules))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


def test_info_describes_a_log(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(demo_log_path())]) == 0
    assert "181" in capsys.readouterr().out


@pytest.mark.parametrize("command", ["ablation", "nees", "bench", "eval"])
def test_help_shows_no_default_where_there_is_none(command: str) -> None:
    shown = iceg_process(command, "--help").stdout
    assert "left out" in shown or "--truth" in shown
    assert "(default: )" not in shown
    assert "(default: None)" not in shown


@pytest.mark.skipif(os.name != "posix", reason="a shell that closes streams")
@pytest.mark.parametrize("closing", [">&-", "2>&- > /dev/null", "<&- > /dev/null"])
def test_closed_streams_are_no_error(closing: str) -> None:
    command = f"{shlex.quote(sys.executable)} -m iceg config {closing}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.parametrize("word", ["config", "info"])
def test_an_output_that_lacks_some_letters_is_no_error(word: str) -> None:
    words = [sys.executable, "-m", "iceg", word, *([str(demo_log_path())] if word == "info" else [])]
    done = subprocess.run(words, capture_output=True, check=False, env=os.environ | {"PYTHONIOENCODING": "ascii"})
    assert (done.returncode, done.stderr) == (0, b"")
    assert b"?" in done.stdout


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    command = f"{shlex.quote(sys.executable)} -m iceg config | head -c 1"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert done.stderr == ""


def test_public_names_are_all_there() -> None:
    for name in iceg.__all__:
        assert getattr(iceg, name) is not None
    assert set(iceg.__all__) <= set(dir(iceg))
    assert set(iceg._HOMES) | {"__version__"} == set(iceg.__all__)
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = iceg.nothing


def test_importing_iceg_is_light() -> None:
    heavy = "('gtsam', 'numba', 'matplotlib', 'numpy')"
    code = f"import sys, iceg; sys.exit(', '.join(m for m in {heavy} if m in sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.stderr.strip() == ""


@pytest.mark.parametrize("word", ["run", "info"])
def test_the_program_says_all_and_ends_with_its_code(word: str) -> None:
    code = (
        "import sys, iceg.cli\n"
        "iceg.cli.main = lambda: print('told') or print('warned', file=sys.stderr) or 3\n"
        f"sys.argv = ['iceg', '{word}']\n"
        "iceg.cli.command()"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (3, "told\n", "warned\n")
