"""The tables of the settings, made of the dataclasses that hold them, in place of `{settings}` on a page.

What half and twice of a setting do is read from the table that `iceg ablation --scales` has written beside the page.
"""

import csv
import dataclasses
import re
import typing
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from sphinx.application import Sphinx

from graph.units import RADIAN, shown_angle
from iceg.config import Config
from iceg.settings_file import field_documentation

_PLACE = "{settings}"
_SCALES = Path(__file__).parent.parent / "reference" / "settings-scaled.csv"
_COLUMNS = ("half [%]", "half, worst log [%]"), ("twice [%]", "twice, worst log [%]")
_UNIT = re.compile(r" ?\[([^\],\d][^\],]*)\]")


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill the tables in when a page is read."""
    app.connect("source-read", _fill_in)
    return {"parallel_read_safe": True, "parallel_write_safe": True}


def settings_tables(
    settings: Any,  # noqa: ANN401
    name: str = "",
    about: str = "",
    scales: Mapping[str, Mapping[str, str]] | None = None,
) -> Iterator[str]:
    """Lines of Markdown: a heading and a table for each dataclass of settings, nested ones after it.

    Args:
        settings: an instance, whose values are the defaults.
        name: dotted name of this branch, `` for the root.
        about: what the branch is for.
        scales: rows of the table of scaled settings, by setting; that beside the page when left out.
    """
    scales = _scales() if scales is None else scales
    documentation = field_documentation(type(settings))
    values = {key: getattr(settings, key) for key in documentation}
    plain = [key for key, value in values.items() if not dataclasses.is_dataclass(value)]
    if name:
        summary = (type(settings).__doc__ or "").partition("\n")[0]
        yield from (f"## `{name}`", "", _sentence(summary or about), "")
    if plain:
        yield from ("| setting | default | ×½ | ×2 | |", "|---|---|---|---|---|")
        hints = typing.get_type_hints(type(settings), include_extras=True)
        for key in plain:
            text, unit = _without_unit(documentation[key])
            is_angle = RADIAN in getattr(hints[key], "__metadata__", ())
            half, twice = _changes(scales.get(f"{name}.{key}".lstrip(".")))
            default = _default(values[key], unit, is_angle=is_angle)
            yield f"| `{key}` | {default} | {half} | {twice} | {_sentence(text)} |"
        yield ""
    for key, value in values.items():
        if key not in plain:
            yield from settings_tables(value, f"{name}.{key}".lstrip("."), documentation[key], scales)


def _scales() -> dict[str, dict[str, str]]:
    with _SCALES.open(encoding="utf-8", newline="") as file:
        return {row["setting"]: row for row in csv.DictReader(file)}


def _changes(row: Mapping[str, str] | None) -> list[str]:
    """How the error changes at half and at twice: mean and worst log, a dash where no such value may be given."""
    if row is None:
        return ["", ""]
    return [
        f"{round(float(row[mean])):+d} / {round(float(row[worst])):+d} %" if row[mean] else "–"
        for mean, worst in _COLUMNS
    ]


def _fill_in(app: Sphinx, page: str, source: list[str]) -> None:  # noqa: ARG001
    if _PLACE in source[0]:
        app.env.note_dependency(_SCALES)
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
