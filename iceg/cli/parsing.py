"""From the words of the command line to a command: only the parser that they need is built."""

import dataclasses
import difflib
import sys
import typing
from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path
from typing import Annotated, Any, NoReturn

import tyro

from iceg.cli.commands import COMMANDS, Command, Entry
from iceg.cli.settings_flags import flags_of, listed_flags_of, named_settings, setting_names, setting_type, with_flags
from iceg.cli.usage_error import UsageError
from iceg.settings_file import RENAMED, ConfigError, read_settings

_HELP, _HELP_ALL = ("-h", "--help"), "--help-all"
_USAGE = 2
_SWITCHED = ("true", "false", "on", "off", "yes", "no", "0", "1")


def parse(words: Sequence[str]) -> Command:
    """The command that the words after the program's name ask for.

    Flags override the file given with --config, which overrides the defaults.

    Raises:
        IcegError: settings in the file or flags that are not valid.
        SystemExit: arguments that are not valid, or a request for help.
    """
    name, *rest = words or [""]
    if name in {*_HELP, _HELP_ALL}:
        from iceg.cli.overview import overview

        print(overview())
        sys.exit(0)
    if name not in COMMANDS:
        sys.exit(_unknown(name))
    return _parsed(COMMANDS[name], rest, name)


def _parsed(entry: Entry, words: Sequence[str], name: str) -> Command:
    if entry.settings is None:
        as_usual = ["--help" if word == _HELP_ALL else word for word in words]
        plain: Command = tyro.cli(entry.kind, args=as_usual, prog=f"iceg {name}")
        return plain
    settings = _settings(entry.settings, words)
    everything = list(setting_names(entry.settings))
    if _HELP_ALL in words:
        _tell(entry, name, flags_of(settings, everything))
    if any(word in _HELP for word in words):
        more = f" 'iceg {name} --help-all' shows {len(everything) - len(entry.common)} more settings."
        _tell(entry, name, listed_flags_of(settings, entry.common), more)
    _refuse_renamed(words, entry.prefix)
    _refuse_values_of_switches(words, entry)
    # To ask about each of the settings takes longer than to read the log.
    named = named_settings(words, entry.settings, entry.prefix, _own_flags(entry.kind))
    names = everything if named is None else named
    parsed: Any = tyro.cli(
        _with_flags_of(entry, flags_of(settings, names) if names else None), args=words, prog=f"iceg {name}"
    )
    own = {field.name: getattr(parsed, field.name) for field in _own_fields(entry.kind)}
    chosen = with_flags(settings, parsed.flags, entry.prefix) if names else settings
    return entry.kind(**{**own, "settings": chosen})


def _refuse_renamed(words: Sequence[str], prefix: str) -> None:
    """Say what the flag of a setting is called that had another name.

    Raises:
        ConfigError: there is one among the words.
    """
    for word in words:
        flag = word.partition("=")[0]
        now = RENAMED.get(flag.removeprefix("--").removeprefix(prefix).replace("-", "_")) if flag[:2] == "--" else None
        if now is not None:
            raise ConfigError(f"'{flag}' is now '--{prefix}{now.replace('_', '-')}'")


def _refuse_values_of_switches(words: Sequence[str], entry: Entry) -> None:
    """Say how a setting is switched that somebody gives a value.

    Raises:
        UsageError: a flag that is a switch is followed by a word for on or off.
    """
    for word, following in zip_longest(words, words[1:], fillvalue=""):
        flag, equals, value = word.partition("=")
        value = value if equals else following
        if flag.startswith("--") and value.lower() in _SWITCHED:
            name = flag.removeprefix(f"--{entry.prefix}").replace("-", "_")
            if entry.settings is not None and name in _switches(entry.settings):
                stage, dot, last = flag.removeprefix("--").rpartition(".")
                raise UsageError(
                    f"found {flag} with '{value}', expected {flag} for on or --{stage}{dot}no-{last} for off"
                )


def _switches(settings: type) -> set[str]:
    """The dotted names of settings that are on or off."""
    return {name for name in setting_names(settings) if setting_type(settings, name) is bool}


def _tell(entry: Entry, name: str, flags: object, more: str = "") -> NoReturn:
    """Print the help of a command with flags of settings, and end."""
    told = (entry.kind.__doc__ or "").partition("\n\n")[0]
    tyro.cli(_with_flags_of(entry, flags), args=["--help"], prog=f"iceg {name}", description=told + more)
    sys.exit(0)


def _with_flags_of(entry: Entry, flags: object | None) -> Any:  # noqa: ANN401
    """A class like the command's, with flags of some settings in the place of all settings."""
    hints = typing.get_type_hints(entry.kind, include_extras=True)
    made: list[Any] = [
        (field.name, hints[field.name], dataclasses.field(default=field.default)) for field in _own_fields(entry.kind)
    ]
    if flags is not None:
        named = tyro.conf.arg(name=entry.prefix.rstrip("."))
        made.append(("flags", Annotated[type(flags), named], dataclasses.field(default=flags)))
    return dataclasses.make_dataclass(entry.kind.__name__, made, frozen=True, kw_only=True)


def _own_fields(kind: type) -> list["dataclasses.Field[Any]"]:
    return [field for field in dataclasses.fields(kind) if field.name != "settings"]


def _own_flags(kind: type) -> set[str]:
    return {"-o", "--help", *(f"--{field.name.replace('_', '-')}" for field in _own_fields(kind))}


def _unknown(name: str) -> int:
    """Say that there is no such command."""
    close = difflib.get_close_matches(name, COMMANDS, n=1)
    hint = f"did you mean '{close[0]}'?" if close else f"expected one of {', '.join(COMMANDS)}"
    found = f"found the command '{name[:40]}', {hint}" if name else f"found no command, {hint}"
    print(f"iceg: {found}; 'iceg --help' tells what each does", file=sys.stderr)
    return _USAGE


def _settings(kind: Any, words: Sequence[str]) -> Any:  # noqa: ANN401
    """What the file given with --config says: known before the flags are parsed because it sets their defaults."""
    file = None
    for word, following in zip_longest(words, words[1:]):
        if word == "--config" and following is not None:
            file = Path(following)
        elif word.startswith("--config="):
            file = Path(word.partition("=")[2])
    return kind() if file is None else read_settings(kind, file)
