"""The command line: parse, call the library, print."""

import atexit
import gc
import os
import sys
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Annotated

import tyro

from frontends.dp_slam.config import DpSlamConfig
from graph.errors import IcegError
from iceg.cli.judge import Eval, Info, Plot
from iceg.cli.options import UsageError
from iceg.cli.run import Demo, DpSlam, Run
from iceg.cli.studies import Ablation, Bench, Nees
from iceg.cli.tools import Optimize, PrintConfig, Simulate
from iceg.config import Config, read_config
from iceg.settings_file import read_settings

_DESCRIPTION = "2D laser SLAM for recorded logs. 'iceg COMMAND --help' tells more; 'iceg --version' the version."
_COLLECTION = (500_000, 20, 20)
"""Thresholds of the garbage collector: hardly anything here forms cycles, and looking for them takes time."""
_FAILED, _USAGE, _INTERRUPTED = 1, 2, 130

Command = Run | DpSlam | Demo | Info | Eval | Plot | Simulate | Optimize | Bench | Ablation | Nees | PrintConfig


def main(arguments: Sequence[str] | None = None) -> int:
    """Run one command.

    Args:
        arguments: what follows the program's name; the process's own when left out.

    Returns:
        The exit code: 0, 1 for an error in the data, 2 in the arguments or settings, 130 when interrupted.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    gc.set_threshold(*_COLLECTION)
    atexit.register(gc.freeze)  # nothing to look for at the end either
    try:
        return _main(words)
    except KeyboardInterrupt as err:
        print("\niceg: " + ", ".join(["interrupted", *map(str, err.args)]), file=sys.stderr)
        return _INTERRUPTED
    except BrokenPipeError:
        # Whoever read our output has seen enough; keep the interpreter from flushing into the closed pipe.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return _FAILED


def _main(words: list[str]) -> int:
    if words == ["--version"]:
        from iceg import __version__

        print(f"iceg {__version__}")
        return 0
    try:
        command = parse(words)
    except IcegError as err:
        return _complain(err, _USAGE)
    try:
        command()
        sys.stdout.flush()
    except UsageError as err:
        return _complain(err, _USAGE)
    except IcegError as err:
        return _complain(err, _FAILED)
    return 0


def parse(words: Sequence[str]) -> Command:
    """The command that the words after the program's name ask for.

    Flags override the file given with --config, which overrides the defaults.

    Raises:
        IcegError: settings in the file or flags that are not valid.
        SystemExit: arguments that are not valid, or a request for help.
    """
    file = _config_file(words)
    is_dp_slam = "dp-slam" in words[:1]
    settings = Config() if file is None or is_dp_slam else read_config(file)
    dp_settings = read_settings(DpSlamConfig, file) if file is not None and is_dp_slam else DpSlamConfig()
    run = Run(log=tyro.MISSING, output=tyro.MISSING, settings=settings)
    dp_slam = DpSlam(log=tyro.MISSING, output=tyro.MISSING, settings=dp_settings)
    commands = (
        Annotated[Run, tyro.conf.subcommand("run", default=run)]
        | Annotated[DpSlam, tyro.conf.subcommand("dp-slam", default=dp_slam)]
        | Annotated[Demo, tyro.conf.subcommand("demo")]
        | Annotated[Info, tyro.conf.subcommand("info")]
        | Annotated[Eval, tyro.conf.subcommand("eval")]
        | Annotated[Plot, tyro.conf.subcommand("plot")]
        | Annotated[Simulate, tyro.conf.subcommand("simulate")]
        | Annotated[Optimize, tyro.conf.subcommand("optimize")]
        | Annotated[Bench, tyro.conf.subcommand("bench")]
        | Annotated[Ablation, tyro.conf.subcommand("ablation")]
        | Annotated[Nees, tyro.conf.subcommand("nees")]
        | Annotated[PrintConfig, tyro.conf.subcommand("config", default=PrintConfig(settings=settings))]
    )
    parsed: Command = tyro.cli(commands, args=words, prog="iceg", description=_DESCRIPTION)
    return parsed


def _config_file(words: Sequence[str]) -> Path | None:
    """The file given with --config, known before the flags are parsed because it sets their defaults."""
    found = None
    for word, following in zip_longest(words, words[1:]):
        if word == "--config" and following is not None:
            found = Path(following)
        elif word.startswith("--config="):
            found = Path(word.partition("=")[2])
    return found


def _complain(error: Exception, code: int) -> int:
    print(f"iceg: {' '.join(str(error).split())}", file=sys.stderr)
    return code
