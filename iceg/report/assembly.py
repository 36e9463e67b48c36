"""The page of a run, put together from its parts: one file that asks for nothing else."""

import base64
import html
import json
import re
from collections.abc import Iterable, Iterator
from importlib.resources import files
from importlib.resources.abc import Traversable
from itertools import cycle

MODULES = (
    "arrays",
    "bus",
    "run",
    "theme",
    "format",
    "distance",
    "sheet",
    "grid",
    "revealed",
    "layers",
    "draw",
    "moving",
    "mapview",
    "inspector",
    "closureview",
    "player",
    "curves",
    "tables",
    "measure",
    "corrections",
    "dragging",
    "edits",
    "main",
)
"""Each is a module of the page, imported by others as `report/NAME`."""


def assemble(name: str, data: Iterable[str], stages: str) -> Iterator[str]:
    """The page as HTML, piece by piece: the whole of it takes as much memory as a large map.

    Args:
        name: of the log.
        data: of the run, in JSON, in pieces.
        stages: seconds a stage, in JSON, on a line of its own.
    """
    page, vendor = files("iceg.report") / "page", files("iceg.report") / "vendor"
    modules = {f"report/{module}": _data_url(_text(page / f"{module}.js")) for module in MODULES}
    parts = {
        "NAME": html.escape(name),
        "LICENCES": "\n".join(_text(vendor / licence) for licence in ("leaflet.LICENSE", "uPlot.LICENSE")),
        "STYLES": "\n".join(_style(source) for source in _styles(page, vendor)),
        "LEAFLET": _text(vendor / "leaflet.js"),
        "UPLOT": _text(vendor / "uPlot.iife.min.js"),
        "MODULES": json.dumps({"imports": modules}, separators=(",", ":")),
        "STAGES": stages,
    }
    pieces = re.split(r"@@([A-Z]+)@@", _text(page / "page.html"))
    for is_name, piece in zip(cycle((False, True)), pieces, strict=False):
        if is_name and piece == "RUN":
            yield from data
        else:
            yield parts[piece] if is_name else piece


def _styles(page: Traversable, vendor: Traversable) -> tuple[Traversable, ...]:
    return vendor / "leaflet.css", vendor / "uPlot.min.css", page / "page.css"


def _text(source: Traversable) -> str:
    return source.read_text(encoding="utf-8")


def _style(source: Traversable) -> str:
    """A style sheet without the pictures of Leaflet's own buttons, which the page does not have."""
    return re.sub(r"url\(images/[^)]*\)", "none", _text(source))


def _data_url(script: str) -> str:
    return f"data:text/javascript;base64,{base64.b64encode(script.encode()).decode('ascii')}"
