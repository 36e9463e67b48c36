"""The tables of the settings, made of the dataclasses that hold them, in place of `{settings}` on a page."""

import dataclasses
import re
import typing
from collections.abc import Iterator
from typing import Any

from sphinx.application import Sphinx

from graph.units import RADIAN, shown_angle
from iceg.config import Config
from iceg.settings_file import field_documentation

_PLACE = "{settings}"
_UNIT = re.compile(r" ?\[([^\],\d][^\],]*)\]")


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill the tables in when a page is read."""
    app.connect("source-read", _fill_in)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def settings_tables(settings: Any, name: str = "", about: str = "") -> Iterator[str]:  # noqa: ANN401
    """Lines of Markdown: a heading and a table for each dataclass of settings, nested ones after it.

    Args:
        settings: an instance, whose values are the defaults.
        name: dotted name of this branch, `` for the root.
        about: what the branch is for.
    """
    documentation = field_documentation(type(settings))
    values = {key: getattr(settings, key) for key in documentation}
    plain = [key for key, value in values.items() if not dataclasses.is_dataclass(value)]
    if name:
        summary = (type(settings).__doc__ or "").partition("\n")[0]
        yield from (f"## `{name}`", "", _sentence(summary or about), "")
    if plain:
        yield from ("| setting | default | |", "|---|---|---|")
        hints = typing.get_type_hints(type(settings), include_extras=True)
        for key in plain:
            text, unit = _without_unit(documentation[key])
            is_angle = RADIAN in getattr(hints[key], "__metadata__", ())
            yield f"| `{key}` | {_default(values[key], unit, is_angle=is_angle)} | {_sentence(text)} |"
        yield ""
    for key, value in values.items():
        if key not in plain:
            yield from settings_tables(value, f"{name}.{key}".lstrip("."), documentation[key])


def _fill_in(app: Sphinx, page: str, source: list[str]) -> None:  # noqa: ARG001
    if _PLACE in source[0]:
        source[0] = source[0].replace(_PLACE, "\n".join(settings_tables(Config())))


def _without_unit(text: str) -> tuple[str, str]:
    """What a setting says, and the one unit it names in brackets; of several, all stay where they are."""
    text = " ".join(text.split())
    units = _UNIT.findall(text)
    return (_UNIT.sub("", text), units[0]) if len(units) == 1 else (text, "")


def _default(value: object, unit: str, *, is_angle: bool) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if not isinstance(value, float | int):
        return f"`{value}`"
    number = f"{value:.4g}"
    return f"{number} rad ({shown_angle(value)})" if is_angle else f"{number} {unit}".strip()


def _sentence(text: str) -> str:
    escaped = text.replace("|", r"\|").replace("*", r"\*").replace("<", "&lt;")
    return escaped[:1].upper() + escaped[1:]
