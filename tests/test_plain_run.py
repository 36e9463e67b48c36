"""Runs asked for in the plainest way: read as the parser of all commands reads them, which they do without."""

import subprocess
import sys

import pytest

from iceg.cli.parsing import parse
from iceg.cli.plain_run import plain_run
from iceg.cli.run import Run
from iceg.config import Config

PLAIN = [
    ["a.clf", "-o", "out"],
    ["-o", "out", "a.clf"],
    ["--output", "some/where", "a.clf.gz"],
    ["a.clf", "--overwrite", "-o", "out"],
    ["-o", "out", "--skip-bad-lines", "a.clf", "--overwrite"],
    ["a b.clf", "-o", ""],
]
OTHERS = [
    [],
    ["run"],
    ["run", "a.clf"],
    ["run", "-o", "out"],
    ["run", "a.clf", "b.clf", "-o", "out"],
    ["run", "a.clf", "b.clf", "-o"],
    ["run", "a.clf", "out", "-o"],
    ["run", "a.clf", "-o", "--overwrite"],
    ["run", "a.clf", "--output=out"],
    ["run", "a.clf", "-o", "out", "--seed", "1"],
    ["run", "a.clf", "-o", "out", "--config", "c.toml"],
    ["run", "a.clf", "-o", "out", "--overwrite", "--overwrite"],
    ["run", "--help", "-o", "out"],
    ["run", "-o", "-o", "out"],
    ["info", "a.clf", "-o", "out"],
]


@pytest.mark.parametrize("words", PLAIN)
def test_it_says_what_the_parser_says(words: list[str]) -> None:
    plain, parsed = plain_run(["run", *words]), parse(["run", *words])
    assert plain is not None
    assert isinstance(parsed, Run)
    assert parsed == Run(**vars(plain), settings=Config())


@pytest.mark.parametrize("words", OTHERS)
def test_all_else_is_left_to_the_parser(words: list[str]) -> None:
    assert plain_run(words) is None


def test_the_parser_is_not_loaded() -> None:
    code = (
        "import sys\nfrom iceg.cli import main\n"
        "assert main(['run', 'no such log', '-o', 'no such folder']) == 1\n"
        "sys.exit('tyro' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    assert "no such log" in done.stderr


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
