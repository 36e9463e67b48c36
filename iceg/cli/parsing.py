"""From the words of the command line to a command: only the parser that they need is built."""

from collections.abc import Callable, Sequence
from dataclasses import fields
from itertools import zip_longest
from pathlib import Path
from typing import TypeVar

import tyro
from tyro.extras import subcommand_cli_from_dict

from frontends.dp_slam.config import DpSlamConfig
from iceg.cli.judge import Eval, Info, Plot
from iceg.cli.resolve import Resolve
from iceg.cli.run import Demo, DpSlam, Run, RunOptions
from iceg.cli.studies import Ablation, Bench, Nees
from iceg.cli.tools import Convert, Optimize, PrintConfig, Simulate
from iceg.cli.view import View
from iceg.config import Config
from iceg.settings_file import read_settings

Command = (
    Run
    | Resolve
    | View
    | DpSlam
    | Demo
    | Info
    | Eval
    | Plot
    | Simulate
    | Convert
    | Optimize
    | Bench
    | Ablation
    | Nees
    | PrintConfig
)
Kind = TypeVar("Kind", bound=Command | RunOptions)
Settings = TypeVar("Settings", Config, DpSlamConfig)

_DESCRIPTION = (
    "2D laser SLAM for recorded logs. 'iceg COMMAND --help' tells more; 'iceg --version' the version; --debug with any "
    "command the traceback of an error of iceg itself."
)

_COMMANDS: dict[str, type[Command]] = {
    "run": Run,
    "dp-slam": DpSlam,
    "resolve": Resolve,
    "view": View,
    "demo": Demo,
    "info": Info,
    "eval": Eval,
    "plot": Plot,
    "simulate": Simulate,
    "convert": Convert,
    "optimize": Optimize,
    "bench": Bench,
    "ablation": Ablation,
    "nees": Nees,
    "config": PrintConfig,
}

_RUN_FLAGS = {"-o", *("--" + option.name.replace("_", "-") for option in fields(RunOptions))}


def parse(words: Sequence[str]) -> Command:
    """The command that the words after the program's name ask for.

    Flags override the file given with --config, which overrides the defaults.

    Raises:
        IcegError: settings in the file or flags that are not valid.
        SystemExit: arguments that are not valid, or a request for help.
    """
    if not words or words[0] not in _COMMANDS:
        all_of_them: dict[str, Callable[..., Command]] = {**_COMMANDS}
        chosen: Command = subcommand_cli_from_dict(all_of_them, args=words, prog="iceg", description=_DESCRIPTION)
        return chosen
    name, *rest = words
    command = _COMMANDS[name]
    if command is Run:
        return _parse_run(rest)
    if command is DpSlam:
        settings = _settings(DpSlamConfig, rest)
        return _parsed(DpSlam, rest, name, DpSlam(log=tyro.MISSING, output=tyro.MISSING, settings=settings))
    if command is PrintConfig:
        return _parsed(PrintConfig, rest, name, PrintConfig(settings=_settings(Config, rest)))
    return _parsed(command, rest, name)


def _parse_run(words: Sequence[str]) -> Run:
    settings = _settings(Config, words)
    if all(word.partition("=")[0] in _RUN_FLAGS for word in words if word.startswith("-")):
        # To ask about each of the settings takes longer than to read the log.
        return Run(**vars(_parsed(RunOptions, words, "run")), settings=settings)
    return _parsed(Run, words, "run", Run(log=tyro.MISSING, output=tyro.MISSING, settings=settings))


def _parsed(kind: type[Kind], words: Sequence[str], name: str, default: Kind | None = None) -> Kind:
    prog = f"iceg {name}"
    return (
        tyro.cli(kind, args=words, prog=prog)
        if default is None
        else tyro.cli(kind, args=words, prog=prog, default=default)
    )


def _settings(kind: type[Settings], words: Sequence[str]) -> Settings:
    """What the file given with --config says: known before the flags are parsed because it sets their defaults."""
    file = None
    for word, following in zip_longest(words, words[1:]):
        if word == "--config" and following is not None:
            file = Path(following)
        elif word.startswith("--config="):
            file = Path(word.partition("=")[2])
    return kind() if file is None else read_settings(kind, file)
