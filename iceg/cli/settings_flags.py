"""Settings as flags: `--grid.resolution 0.1`, for some of the settings or all, angles in degrees.

What the settings are and say is told by their dataclasses; here is made from them what the parser of the command line
takes: the same tree of dataclasses, with a name, a unit and a sentence for each flag.
"""

import dataclasses
import functools
import math
import re
import types
import typing
from collections.abc import Collection, Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, TypeVar, Union

import tyro
from tyro.constructors import PrimitiveConstructorSpec

from graph.errors import IcegError
from graph.units import RADIAN, shown_angle
from iceg.settings_file import ConfigError, field_documentation

Settings = TypeVar("Settings")

_ANGLE = re.compile(r"(.*?)\s*(°|deg|rad|)")


def setting_names(cls: type, prefix: str = "") -> Iterator[str]:
    """The dotted names of all settings, such as `grid.resolution`, in the order of the help."""
    hints = typing.get_type_hints(cls)
    nested = [field.name for field in dataclasses.fields(cls) if dataclasses.is_dataclass(hints[field.name])]
    for field in dataclasses.fields(cls):
        if field.name not in nested:
            yield f"{prefix}{field.name}"
    for name in nested:
        yield from setting_names(hints[name], f"{prefix}{name}.")


def setting_type(cls: type, name: str) -> Any:  # noqa: ANN401
    """The type of the setting with a dotted name."""
    *stages, last = name.split(".")
    for stage in stages:
        cls = typing.get_type_hints(cls)[stage]
    return typing.get_type_hints(cls)[last]


def named_settings(words: Sequence[str], cls: type, prefix: str, others: Collection[str]) -> set[str] | None:
    """Which settings the words of a command line name.

    Args:
        words: of the command line.
        cls: the dataclass of all settings.
        prefix: of their flags, such as `log.`.
        others: flags that are no settings.

    Returns:
        Their dotted names without the prefix; None where a flag is neither one of them nor of the others.
    """
    known = {f"--{prefix}{name}".replace("_", "-"): name for name in setting_names(cls)}
    flags = {word.partition("=")[0].replace("_", "-") for word in words if word.startswith("--")} - set(others)
    positive = {flag if flag in known else _without_no(flag) for flag in flags}
    return {known[flag] for flag in positive} if positive <= known.keys() else None


def flags_of(settings: Any, names: Collection[str], prefix: str = "") -> Any:  # noqa: ANN401
    """What stands for settings in the parser: a tree of dataclasses with the flags named, and the values as defaults.

    Args:
        settings: an instance of a dataclass of settings.
        names: dotted names of those that become flags.
        prefix: of the names in this branch.

    Returns:
        An instance; its type is made for it.
    """
    cls = type(settings)
    hints, documentation = typing.get_type_hints(cls, include_extras=True), field_documentation(cls)
    made: list[tuple[str, Any, Any]] = []
    for name, text in documentation.items():
        value = getattr(settings, name)
        if dataclasses.is_dataclass(value):
            if any(chosen.startswith(f"{prefix}{name}.") for chosen in names):
                branch = flags_of(value, names, f"{prefix}{name}.")
                made.append((name, type(branch), dataclasses.field(default=branch)))
        elif f"{prefix}{name}" in names:
            made.append((name, _flag(hints[name], text, value), dataclasses.field(default=value)))
    twin = dataclasses.make_dataclass(cls.__name__, made, frozen=True, kw_only=True)
    twin.__doc__ = (cls.__doc__ or "").partition("\n")[0]
    return twin()


def listed_flags_of(settings: Any, names: Sequence[str]) -> Any:  # noqa: ANN401
    """The same flags for help alone, side by side in one list instead of a group for each stage.

    Args:
        settings: as for `flags_of`.
        names: in the order to list them.

    Returns:
        An instance; its type is made for it.
    """
    made: list[tuple[str, Any, Any]] = []
    for place, name in enumerate(names):
        *stages, last = name.split(".")
        stage = functools.reduce(getattr, stages, settings)
        hint = typing.get_type_hints(type(stage), include_extras=True)[last]
        named = tyro.conf.arg(name=name.replace("_", "-"))
        flag = _flag(hint, field_documentation(type(stage))[last], getattr(stage, last))
        made.append((f"flag_{place}", Annotated[flag, named], dataclasses.field(default=getattr(stage, last))))
    return dataclasses.make_dataclass("Listed", made, frozen=True, kw_only=True)()


def with_flags(settings: Settings, flags: Any, prefix: str) -> Settings:  # noqa: ANN401
    """The settings with the values that the parser found.

    Args:
        settings: an instance of a dataclass of settings.
        flags: what `flags_of` has made of them, parsed.
        prefix: of their flags, such as `log.`.

    Raises:
        ConfigError: a value is out of range, with the flag.
    """
    changed: dict[str, Any] = {}
    for field in dataclasses.fields(flags):
        value, before = getattr(flags, field.name), getattr(settings, field.name)
        is_stage = dataclasses.is_dataclass(before)
        changed[field.name] = with_flags(before, value, f"{prefix}{field.name}.") if is_stage else value
    try:
        return dataclasses.replace(settings, **changed)  # type: ignore[type-var]
    except IcegError as err:
        refused = [name for name in changed if _is_refused(settings, name, changed[name])] or changed
        named = ", ".join(f"--{prefix}{name}".replace("_", "-") for name in refused)
        hints = typing.get_type_hints(type(settings), include_extras=True)
        in_radians = " (in radians)" if any(_unwrapped(hints[name])[1] for name in refused) else ""
        raise ConfigError(f"{named}: {err}{in_radians}") from err


def _is_refused(settings: Any, name: str, value: object) -> bool:  # noqa: ANN401
    """Whether settings do not take a value even if nothing else changes."""
    try:
        dataclasses.replace(settings, **{name: value})
    except IcegError:
        return True
    return False


def parse_angle(text: str) -> float:
    """An angle [rad] as people write it: `20`, `20°` or `20deg` in degrees, `0.35rad` in radians.

    Raises:
        ValueError: it is none.
    """
    number, unit = _ANGLE.fullmatch(text.strip()).groups()  # type: ignore[union-attr]  # it matches anything
    return float(number) if unit == "rad" else math.radians(float(number))


def _without_no(flag: str) -> str:
    """`--a.no-b` switches `--a.b` off."""
    head, dot, tail = flag.rpartition(".")
    return f"{head}{dot}{tail.removeprefix('no-')}" if dot else f"--{flag.removeprefix('--no-')}"


def _flag(hint: Any, text: str, value: Any) -> Any:  # noqa: ANN401
    """The type of one flag, with what its help says."""
    plain, is_angle, is_optional = _unwrapped(hint)
    text = text[:1].upper() + text[1:]
    if plain is bool:
        return Annotated[hint, tyro.conf.arg(help=text, help_behavior_hint=f"(default: {'on' if value else 'off'})")]
    hint_of_default = "" if value is None else None
    if is_angle:
        spec: PrimitiveConstructorSpec[Any] = PrimitiveConstructorSpec(
            nargs=1,
            metavar="DEGREES",
            instance_from_str=lambda words: parse_angle(words[0]),
            is_instance=lambda found: isinstance(found, float | int) or (is_optional and found is None),
            str_from_instance=lambda found: ["" if found is None else shown_angle(found)],
        )
        default = "" if value is None else f"(default: {shown_angle(value)})"
        configured = tyro.conf.arg(help=text.replace("[rad]", "[°]"), help_behavior_hint=default)
        return Annotated[plain | None if is_optional else plain, spec, configured]
    if is_optional:
        metavar = {float: "FLOAT", int: "INT", str: "NAME", Path: "FILE"}[plain]
        return Annotated[hint, tyro.conf.arg(help=text, metavar=metavar, help_behavior_hint=hint_of_default)]
    return Annotated[hint, tyro.conf.arg(help=text)]


@functools.cache
def _unwrapped(hint: Any) -> tuple[Any, bool, bool]:  # noqa: ANN401
    """The type itself, whether it is an angle, and whether it may be left out."""
    origin = typing.get_origin(hint)
    if origin is Annotated:
        plain, *metadata = typing.get_args(hint)
        return plain, RADIAN in metadata, False
    if origin in {Union, types.UnionType}:
        inner = [argument for argument in typing.get_args(hint) if argument is not types.NoneType]
        plain, is_angle, _ = _unwrapped(inner[0])
        return plain, is_angle, True
    return hint, False, False
