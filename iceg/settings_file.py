"""Settings as TOML: nested frozen dataclasses read strictly and written with their documentation as comments."""

import ast
import dataclasses
import difflib
import functools
import inspect
import json
import math
import re
import sys
import textwrap
import tomllib
import types
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any, Literal, TypeVar, Union

from graph.errors import IcegError
from graph.files import read_text
from graph.units import RADIAN, shown_angle

Settings = TypeVar("Settings")

_COMMENT_WIDTH = 110
_LONGEST_SHOWN = 200  # characters of a value in a message
_MOST_WHOLE = 2**63 - 1  # as TOML has it
_CLOSE = 0.7
"""How like another a name must be to be meant by it (`difflib`: 1 for the same)."""
RENAMED = {
    "ice.refinement.doubtful": "ice.refinement.wide_below",
    "front_end.split_scans": "front_end.split_half.scans",
    "loops.odometry_doubt": "loops.odometry_inflation",
}
"""Settings that had another name."""
_BY_MAPS = "lost parts are put where their maps belong, see loops.relocalisation.maps"

GONE = {
    "finish.joint.confirmed_share": "the run says where walls and factors contradict each other",
    "finish.joint.credible_ratio": "variances grow as far as walls and factors contradict each other",
    "finish.joint.walls_gain": "variances grow as far as walls and factors contradict each other",
    "finish.kernel_width": "Φ follows from finish.closure_false_alarm",
    "front_end.odometry_check.jump_free_space": "see front_end.odometry_check.contradiction",
    "front_end.odometry_check.jump_inlier_ratio": "see front_end.odometry_check.contradiction",
    "front_end.open_ground": "what is slim counts wherever a scan sees little else",
    "front_end.sight.min_far_returns": "few beams are matched, too: how much wall holds them tells what they are worth",
    "front_end.standstill.min_moves": "see front_end.standstill.held_prior",
    "front_end.standstill.seldom_share": "see front_end.standstill.held_prior",
    "front_end.tracking.polished": "guesses come from a pass before, where turns are all that is known",
    "ice.covariance.doubtful_length": "see ice.false_match.length",
    "ice.covariance.similar_per_metre": "see ice.false_match.similar_per_metre",
    "loops.failures.believed_inlier_ratio": _BY_MAPS,
    "loops.failures.beyond_chance_distance2": "closures that the path refuses stay out",
    "loops.failures.log_end": "failures near the ends of a log are looked at, too",
    "loops.failures.widened_distance2": "odometry is widened as far as loops.failures.false_alarm asks",
    "loops.max_deviations": "closures are believed as far as the path explains them, see loops.path_probability",
    "loops.place_confirmations": _BY_MAPS,
    "loops.places": _BY_MAPS,
    "loops.places_each": _BY_MAPS,
    "loops.relocalisation.alike_exponent": _BY_MAPS,
    "loops.relocalisation.alike_scans": _BY_MAPS,
    "loops.relocalisation.bias_sigmas": _BY_MAPS,
    "loops.relocalisation.dissent": _BY_MAPS,
    "loops.relocalisation.false_alarm": _BY_MAPS,
    "loops.relocalisation.found_distance": _BY_MAPS,
    "loops.relocalisation.found_turn": _BY_MAPS,
    "loops.relocalisation.lead": _BY_MAPS,
    "loops.relocalisation.majority": _BY_MAPS,
    "loops.relocalisation.max_fits": _BY_MAPS,
    "loops.relocalisation.max_hypotheses": _BY_MAPS,
    "loops.relocalisation.max_keys": _BY_MAPS,
    "loops.relocalisation.min_agreeing": _BY_MAPS,
    "loops.relocalisation.min_credible": "what is too little to act on is not told of",
    "loops.relocalisation.most_share": _BY_MAPS,
    "loops.relocalisation.odds": _BY_MAPS,
    "loops.relocalisation.pass_length": _BY_MAPS,
    "loops.relocalisation.reach": _BY_MAPS,
    "loops.relocalisation.right_contradicted": "see loops.relocalisation.contradiction",
    "loops.relocalisation.rival_distance": _BY_MAPS,
    "loops.relocalisation.rival_support": _BY_MAPS,
    "loops.relocalisation.same_pass": _BY_MAPS,
    "loops.relocalisation.spacing": _BY_MAPS,
    "loops.relocalisation.spanned_covariance": _BY_MAPS,
    "loops.revisit_drift": "without loops.enabled no loop is closed",
    "loops.revisits": "without loops.enabled no loop is closed",
    "loops.signatures": _BY_MAPS,
    "loops.verification.min_overlap_ratio": "passes that hardly overlap are matched like others",
    "loops.view.carried_chance": "whether the robot was carried is weighed, see loops.view.carried_prior",
    "loops.view.false_alarm": "whether the robot was carried is weighed, see loops.view.carried_prior",
}
"""Settings of earlier versions, and whole sections, that no run depends on any more, and what stands in their place."""


class ConfigError(IcegError):
    """A setting that is unknown, of the wrong type or out of range."""


def read_settings(cls: type[Settings], path: Path) -> Settings:
    """Read settings from a TOML file; what it does not name keeps its default.

    Args:
        cls: the dataclass of all settings; nested dataclasses are tables.
        path: the file.

    Raises:
        ConfigError: naming the file and the key.
    """
    text = read_text(path, "settings_bytes", ConfigError, "a configuration")
    return parse_settings(cls, text, where=str(path))


def parse_settings(cls: type[Settings], text: str, where: str) -> Settings:
    """Settings from the text of a TOML file.

    Args:
        cls: the dataclass of all settings.
        text: TOML.
        where: the name of its source, for messages.

    Raises:
        ConfigError: not TOML, an unknown key, a wrong type or a value out of range.
    """
    return build_settings(cls, parse_toml(text, where, ConfigError), where=where)


def parse_toml(text: str, where: str, error: type[IcegError]) -> dict[str, Any]:
    """The tables of a TOML text.

    Args:
        text: TOML.
        where: the name of its source, for messages.
        error: raised where it is none.

    Raises:
        IcegError: of the type given.
    """
    try:
        return tomllib.loads(text)
    except RecursionError as err:
        raise error(f"{where}: not valid TOML: nested too deeply") from err
    except ValueError as err:  # TOML's own, and Python's for a number of too many digits
        raise error(f"{where}: not valid TOML: {str(err)[:200]}") from err


def build_settings(cls: type[Settings], table: Mapping[str, Any], where: str) -> Settings:
    """Settings from the tables of a TOML file already read.

    Args:
        cls: the dataclass of all settings.
        table: keys and values, nested as the settings are.
        where: the name of its source, for messages.

    Raises:
        ConfigError: an unknown key, a wrong type or a value out of range.
    """
    return _Reader(where=where, known=tuple(_dotted_keys(cls))).build(cls, table, "")


def format_settings(settings: object, heading: str = "") -> str:
    """The text of a TOML file that reads back as the same settings, every key with its documentation.

    Args:
        settings: an instance of a dataclass of settings.
        heading: comment at the top of the file.
    """
    lines = [*_comment(heading), ""] if heading else []
    return "\n".join([*lines, *_format_table(settings, "")]).strip("\n") + "\n"


def field_documentation(cls: type) -> dict[str, str]:
    """What each field of a dataclass is for.

    Taken from the string under the field or from the `Attributes:` section of the class docstring.
    """
    documented: dict[str, str] = {}
    for base in reversed(cls.__mro__[:-1]):
        documented |= _attributes_section(base.__doc__ or "") | _attribute_docstrings(base)
    return {field.name: documented.get(field.name, "") for field in dataclasses.fields(cls)}


@dataclasses.dataclass(frozen=True, slots=True, kw_only=True)
class _Reader:
    where: str
    known: tuple[str, ...]

    def build(self, cls: type[Settings], table: Mapping[str, Any], prefix: str) -> Settings:
        hints = typing.get_type_hints(cls)
        names = [field.name for field in dataclasses.fields(cls)]  # type: ignore[arg-type]
        for key in table:
            if key not in names:
                raise self.unknown(prefix + key)
        values = {key: self.convert(value, hints[key], prefix + key) for key, value in table.items()}
        try:
            return cls(**values)
        except (ValueError, TypeError, IcegError) as err:
            raise ConfigError(f"{self.where}: {self.culprit(cls, values, prefix)}: {err}") from err

    def convert(self, value: object, hint: Any, key: str) -> Any:  # noqa: ANN401
        if dataclasses.is_dataclass(hint) and isinstance(hint, type):
            if not isinstance(value, dict):
                raise ConfigError(f"{self.where}: {key}: found {shown_value(value)}, expected a table [{key}]")
            return self.build(hint, value, f"{key}.")
        accepted, converted = _convert(value, hint)
        if not accepted:
            raise ConfigError(f"{self.where}: {key}: found {shown_value(value)}, expected {_describe(hint)}")
        return converted

    def unknown(self, key: str) -> ConfigError:
        if key in RENAMED:
            return ConfigError(f"{self.where}: '{key}' is now '{RENAMED[key]}'")
        gone = next((name for name in (key, key.rpartition(".")[0]) if name in GONE), None)
        if gone is not None:
            return ConfigError(f"{self.where}: '{gone}' is gone, leave it out: {GONE[gone]}")
        section, _, name = key.rpartition(".")
        by_name = {known.rpartition(".")[2]: known for known in reversed(self.known)}
        here = {known.rpartition(".")[2]: known for known in self.known if known.rpartition(".")[0] == section}
        suggestion = _closest(name, here) or _closest(name, by_name)
        hint = f", did you mean '{suggestion}'?" if suggestion else f", expected one of {', '.join(here)}"
        return ConfigError(f"{self.where}: unknown key '{key[:200]}'{hint}")

    def culprit(self, cls: type, values: Mapping[str, Any], prefix: str) -> str:
        """The key whose value alone the class refuses; all given keys when only their combination is refused."""
        for key, value in values.items():
            try:
                cls(**{key: value})
            except (ValueError, TypeError, IcegError):
                return prefix + key
        return ", ".join(prefix + key for key in values)


def _closest(name: str, names: Mapping[str, str]) -> str | None:
    """The key of the name most like the one given; None where the likeness is no slip of the fingers."""
    close = difflib.get_close_matches(name, names, n=1, cutoff=_CLOSE)
    return names[close[0]] if close else None


def _dotted_keys(cls: type, prefix: str = "") -> Iterator[str]:
    hints = typing.get_type_hints(cls)
    for field in dataclasses.fields(cls):
        yield prefix + field.name
        if dataclasses.is_dataclass(hints[field.name]):
            yield from _dotted_keys(hints[field.name], f"{prefix}{field.name}.")


def _convert(value: object, hint: Any) -> tuple[bool, Any]:  # noqa: ANN401
    """Whether a TOML value fits a type, and the value as that type."""
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is Literal:
        return value in arguments, value
    if origin in {Union, types.UnionType}:
        attempts = (_convert(value, argument) for argument in arguments if argument is not type(None))
        return next((attempt for attempt in attempts if attempt[0]), (False, None))
    if origin is tuple:
        return _convert_tuple(value, arguments)
    if isinstance(value, int) and not -_MOST_WHOLE - 1 <= value <= _MOST_WHOLE:
        return False, None
    if hint is float and isinstance(value, int) and not isinstance(value, bool):
        return True, float(value)
    if hint is Path and isinstance(value, str):
        return True, Path(value)
    if isinstance(value, float) and math.isnan(value):
        return False, None
    return isinstance(hint, type) and type(value) is hint, value


def shown_value(value: object) -> str:
    """A value for messages, however long or deep it is."""
    try:
        text = repr(value)
    except (RecursionError, ValueError):  # nested too deeply, or a number of too many digits
        return "something too large to show"
    return text if len(text) <= _LONGEST_SHOWN else f"{text[:_LONGEST_SHOWN]}…"


def _convert_tuple(value: object, arguments: tuple[Any, ...]) -> tuple[bool, Any]:
    if not isinstance(value, list):
        return False, None
    hints = arguments[:1] * len(value) if arguments[-1:] == (Ellipsis,) else arguments
    if len(hints) != len(value):
        return False, None
    converted = [_convert(item, hint) for item, hint in zip(value, hints, strict=True)]
    return all(accepted for accepted, _ in converted), tuple(item for _, item in converted)


def _describe(hint: Any) -> str:  # noqa: ANN401
    origin, arguments = typing.get_origin(hint), typing.get_args(hint)
    if origin is Literal:
        return "one of " + ", ".join(repr(choice) for choice in arguments)
    if origin in {Union, types.UnionType}:
        return " or ".join(_describe(argument) for argument in arguments if argument is not type(None))
    if origin is tuple:
        return "a list of " + ", ".join("..." if item is Ellipsis else _describe(item) for item in arguments)
    names = {float: "a number", int: "a whole number", bool: "true or false", str: "a string", Path: "a path"}
    return names.get(hint, str(hint))


def _format_table(settings: Any, prefix: str) -> Iterator[str]:  # noqa: ANN401
    cls = type(settings)
    hints, documentation = typing.get_type_hints(cls), field_documentation(cls)
    annotated = typing.get_type_hints(cls, include_extras=True)
    nested = [name for name in documentation if dataclasses.is_dataclass(getattr(settings, name))]
    for name, text in documentation.items():
        if name in nested:
            continue
        value = getattr(settings, name)
        choices = f" ({_describe(hints[name])})" if typing.get_origin(hints[name]) is Literal else ""
        yield from _comment(text + choices)
        shown = f"  # {shown_angle(value)}" if RADIAN in getattr(annotated[name], "__metadata__", ()) else ""
        yield (
            f"# {name} =  (unset; {_describe(hints[name])})"
            if value is None
            else f"{name} = {_format_value(value)}{shown}"
        )
    for name in nested:
        child = getattr(settings, name)
        summary = documentation[name] or inspect.cleandoc(type(child).__doc__ or "").partition("\n")[0]
        yield from ["", *_comment(summary), f"[{prefix}{name}]"]
        yield from _format_table(child, f"{prefix}{name}.")


def _format_value(value: object) -> str:
    if isinstance(value, bool):
        return "true" if value else "false"
    if isinstance(value, float):
        return repr(float(value))
    if isinstance(value, tuple):
        return "[" + ", ".join(_format_value(item) for item in value) + "]"
    if isinstance(value, str | Path):
        return json.dumps(str(value), ensure_ascii=False).replace("\x7f", "\\u007f")
    return str(value)


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(text.strip(), _COMMENT_WIDTH)]


def _attributes_section(docstring: str) -> dict[str, str]:
    lines = inspect.cleandoc(docstring).split("\n")
    if "Attributes:" not in lines:
        return {}
    documented: dict[str, str] = {}
    name = ""
    for line in lines[lines.index("Attributes:") + 1 :]:
        if line and not line.startswith(" "):
            break
        entry = re.match(r" {4}(\w+)(?: \([^)]*\))?:\s*(.*)", line)
        if entry:
            name, documented[entry[1]] = entry[1], entry[2].strip()
        elif name and line.strip():
            documented[name] += " " + line.strip()
    return documented


def _attribute_docstrings(cls: type) -> dict[str, str]:
    definition = _class_definitions(cls.__module__).get(cls.__qualname__)
    if definition is None:
        return {}
    documented = {}
    for statement, following in zip(definition.body, definition.body[1:], strict=False):
        match statement, following:
            case ast.AnnAssign(target=ast.Name(id=name)), ast.Expr(value=ast.Constant(value=str(text))):
                documented[name] = " ".join(inspect.cleandoc(text).split())
    return documented


@functools.cache
def _class_definitions(module: str) -> dict[str, ast.ClassDef]:
    """The classes at the top of a module, parsed from its source; none where there is no source."""
    try:
        tree = ast.parse(inspect.getsource(sys.modules[module]))
    except (OSError, TypeError, KeyError, SyntaxError):
        return {}
    return {node.name: node for node in tree.body if isinstance(node, ast.ClassDef)}
