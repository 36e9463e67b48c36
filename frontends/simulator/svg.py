"""The lines of an SVG drawing as straight pieces: lines, polylines, polygons, rectangles, circles, ellipses, paths."""

import math
import re
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from frontends.simulator.world import Segments, SimulatorError, polyline
from graph.dense import matmul, matvec
from graph.elementary import cos_sin
from graph.files import check_file
from graph.limits import LIMITS, at_most

Points = NDArray[np.float64]
"""(n, 2) of a polyline in units of the drawing."""

_MOST = 1e9  # units
_PIECES = 12  # straight pieces of a curve
_NUMBER = re.compile(r"[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?")
_COMMAND = re.compile(r"([MmLlHhVvZzCcSsQqTtAa])([^MmLlHhVvZzCcSsQqTtAa]*)")
_ARGUMENTS = {"m": 2, "l": 2, "h": 1, "v": 1, "z": 0, "c": 6, "s": 4, "q": 4, "t": 2, "a": 7}
_HIDDEN = ("defs", "symbol", "clipPath", "mask", "pattern", "marker", "metadata", "title", "desc", "text", "style")


class SvgError(ValueError):
    """A drawing that cannot be understood."""


def read_svg(path: Path) -> Segments:
    """All lines of a drawing, in its own units, y turned up and the lower left corner of its view at the origin.

    Fills, strokes and clipping mean nothing here: every outline is a line. Text and what stands in `<defs>` is left
    out, so is what is not displayed.

    Returns:
        (n, 4) segments.

    Raises:
        SvgError: the file is missing, no XML, or has a path or transform that breaks the format.
    """
    check_file(path, "drawing_bytes", SimulatorError, "an SVG drawing")
    try:
        root = ET.parse(path).getroot()  # noqa: S314
    except (OSError, ET.ParseError, LookupError, ValueError) as error:  # an encoding nobody knows or expat cannot read
        raise SvgError(f"cannot be read as an SVG drawing: {error}") from error
    if _tag(root) != "svg":
        raise SvgError(f"found <{_tag(root)[:40]}>, expected <svg>")
    try:
        with np.errstate(over="ignore", invalid="ignore"):
            return _segments(root)
    except ArithmeticError as error:
        raise SvgError(f"found numbers too large or too small to draw with ({error})") from error


def _segments(root: ET.Element) -> Segments:
    pieces, total = [], 0
    for points in _outlines(root):
        total += len(points)
        _check_points(total)
        if not (np.abs(points) <= _MOST).all():
            raise SvgError(f"found a line that leads beyond {_MOST:g} units")
        if len(points) > 1:
            pieces.append(polyline(points))
    segments = np.concatenate(pieces) if pieces else np.zeros((0, 4))
    segments = segments[np.any(segments[:, :2] != segments[:, 2:], axis=1)]
    left, bottom = _lower_left(root)
    return np.stack(
        [segments[:, 0] - left, bottom - segments[:, 1], segments[:, 2] - left, bottom - segments[:, 3]], axis=1
    )


def _check_points(found: int) -> None:
    if found > LIMITS.walls:
        raise SvgError(f"found {found} points of lines or more, expected {at_most('walls')}")


def _lower_left(root: ET.Element) -> tuple[float, float]:
    view = _numbers(root.get("viewBox", ""))
    if len(view) == 4:
        return view[0], view[1] + view[3]
    return 0.0, _length(root, "height")


def _outlines(root: ET.Element) -> Iterator[Points]:
    """All outlines in the order of the drawing, however deep its groups are nested."""
    waiting = [(root, np.eye(3))]
    while waiting:
        element, T_drawing_parent = waiting.pop()
        if _tag(element) in _HIDDEN or element.get("display") == "none" or "display:none" in element.get("style", ""):
            continue
        T_drawing_element = matmul(T_drawing_parent, _transform(element.get("transform", "")))
        outline = _OUTLINES.get(_tag(element))
        if outline is not None:
            for points in outline(element):
                yield matmul(points, T_drawing_element[:2, :2].T) + T_drawing_element[:2, 2]
        waiting += [(child, T_drawing_element) for child in reversed(element)]


def _line(element: ET.Element) -> Iterator[Points]:
    ends = [_length(element, name) for name in ("x1", "y1", "x2", "y2")]
    yield np.array(ends).reshape(2, 2)


def _polyline(element: ET.Element) -> Iterator[Points]:
    numbers = _numbers(element.get("points", ""))
    if len(numbers) % 2:
        raise SvgError(f"found {len(numbers)} numbers in the points of a {_tag(element)}, expected two a point")
    points = np.array(numbers).reshape(-1, 2)
    yield np.concatenate([points, points[:1]]) if _tag(element) == "polygon" else points


def _rect(element: ET.Element) -> Iterator[Points]:
    x, y, width, height = (_length(element, name) for name in ("x", "y", "width", "height"))
    yield np.array([(x, y), (x + width, y), (x + width, y + height), (x, y + height), (x, y)])


def _ellipse(element: ET.Element) -> Iterator[Points]:
    x, y, r = (_length(element, name) for name in ("cx", "cy", "r"))
    rx, ry = (r, r) if _tag(element) == "circle" else (_length(element, "rx"), _length(element, "ry"))
    bearings = np.linspace(0.0, 2 * np.pi, 2 * _PIECES + 1)
    cos, sin = cos_sin(bearings)
    yield np.stack([x + rx * cos, y + ry * sin], axis=1)


def _path(element: ET.Element) -> Iterator[Points]:
    """Every stroke of a path without lifting the pen (SVG 1.1, section 8.3)."""
    here = start = complex(0.0)
    control = here
    before = ""
    stroke: list[complex] = []
    for command, values in _commands(element.get("d", "")):
        kind, origin = command.lower(), here if command.islower() else 0j
        ends = [complex(a, b) + origin for a, b in zip(values[::2], values[1::2], strict=False)]
        if kind == "m":
            yield _as_points(stroke)
            here = start = ends[0]
            stroke = [here]
        elif kind == "z":
            stroke.append(start)
            yield _as_points(stroke)
            here, stroke = start, [start]
        elif kind in "lhv":
            if kind == "h":
                here = complex(values[0] + origin.real, here.imag)
            elif kind == "v":
                here = complex(here.real, values[0] + origin.imag)
            else:
                here = ends[0]
            stroke.append(here)
        elif kind == "a":
            end = complex(values[5], values[6]) + origin
            stroke += _arc(here, end, values)
            here = end
        else:
            if kind in "st":
                ends = [2 * here - control if before in ("cs" if kind == "s" else "qt") and before else here, *ends]
            stroke += _bezier([here, *ends])
            control, here = ends[-2], ends[-1]
        _check_points(len(stroke))
        before = kind
    yield _as_points(stroke)


def _commands(text: str) -> Iterator[tuple[str, list[float]]]:
    """Each command with its own numbers; what repeats a command without its letter gets the letter."""
    leftover = _COMMAND.sub("", text).strip()
    if leftover:
        raise SvgError(f"found '{leftover[:20]}' in a path, expected a command such as M")
    for match in _COMMAND.finditer(text):
        command, arguments = match.group(1), match.group(2)
        count = _ARGUMENTS[command.lower()]
        if count == 0:
            yield command, []
            continue
        strange = _NUMBER.sub("", arguments).strip(" ,\t\r\n")
        if strange:
            raise SvgError(f"found '{strange[:20]}' in a path, expected commands and numbers")
        numbers = _arc_numbers(arguments) if count == 7 else _numbers(arguments)
        if not numbers or len(numbers) % count:
            raise SvgError(f"found {len(numbers)} numbers after '{command}' in a path, expected {count} each time")
        for first in range(0, len(numbers), count):
            yield command, numbers[first : first + count]
            command = {"m": "l", "M": "L"}.get(command, command)


def _bezier(points: list[complex]) -> list[complex]:
    curve = []
    for share in np.linspace(0.0, 1.0, _PIECES + 1)[1:].tolist():
        level = points
        while len(level) > 1:
            level = [a + share * (b - a) for a, b in pairwise(level)]
        curve.append(level[0])
    return curve


def _arc(start: complex, end: complex, values: list[float]) -> list[complex]:
    """An elliptical arc from its ends (SVG 1.1, appendix F.6)."""
    rx, ry, tilt, large, sweep = abs(values[0]), abs(values[1]), math.radians(values[2]), values[3], values[4]
    if start == end:
        return []
    if rx == 0 or ry == 0:
        return [end]
    turn = complex(math.cos(tilt), math.sin(tilt))
    half = (start - end) / 2 / turn
    p = complex(half.real / rx, half.imag / ry)
    if abs(p) > 1:
        rx, ry, p = rx * abs(p), ry * abs(p), p / abs(p)
    height = math.sqrt(max(0.0, 1 - abs(p) ** 2)) / abs(p)
    centre = p * complex(0, height if bool(large) == bool(sweep) else -height)
    first, last = p - centre, -p - centre
    swept = math.remainder(math.atan2(last.imag, last.real) - math.atan2(first.imag, first.real), 2 * math.pi)
    if sweep and swept < 0:
        swept += 2 * math.pi
    elif not sweep and swept > 0:
        swept -= 2 * math.pi
    middle = (start + end) / 2
    arc = []
    for share in np.linspace(0.0, 1.0, _PIECES + 1)[1:-1].tolist():
        unit = centre + first * complex(math.cos(share * swept), math.sin(share * swept))
        arc.append(middle + turn * complex(rx * unit.real, ry * unit.imag))
    return [*arc, end]


def _transform(text: str) -> Points:
    """(3, 3) of a list of transforms."""
    whole = np.eye(3)
    for name, arguments in re.findall(r"(\w+)\s*\(([^)]*)\)", text):
        whole = matmul(whole, _one_transform(name, _numbers(arguments)))
    return whole


def _one_transform(name: str, v: list[float]) -> Points:
    matrix = np.eye(3)
    if name == "matrix" and len(v) == 6:
        matrix[:2] = np.array(v).reshape(3, 2).T
    elif name == "translate" and len(v) in {1, 2}:
        matrix[:2, 2] = v[0], (v[1] if len(v) == 2 else 0.0)
    elif name == "scale" and len(v) in {1, 2}:
        matrix[0, 0], matrix[1, 1] = v[0], v[-1]
    elif name == "rotate" and len(v) in {1, 3}:
        c, s = math.cos(math.radians(v[0])), math.sin(math.radians(v[0]))
        matrix[:2, :2] = [[c, -s], [s, c]]
        centre = np.array(v[1:] or (0.0, 0.0))
        matrix[:2, 2] = centre - matvec(matrix[:2, :2], centre)
    elif name == "skewX" and len(v) == 1:
        matrix[0, 1] = math.tan(math.radians(v[0]))
    elif name == "skewY" and len(v) == 1:
        matrix[1, 0] = math.tan(math.radians(v[0]))
    else:
        found = f"{name[:20]}({', '.join(f'{x:g}' for x in v[:6])})"
        raise SvgError(f"found the transform {found}, expected one of SVG's own")
    return matrix


def _arc_numbers(text: str) -> list[float]:
    """The numbers of arcs, whose two flags may stand without a space between them and what follows."""
    numbers: list[float] = []
    position = 0
    while match := re.compile(r"[\s,]*").match(text, position):
        position = match.end()
        pattern = re.compile(r"[01]") if len(numbers) % 7 in {3, 4} else _NUMBER
        found = pattern.match(text, position)
        if found is None:
            break
        numbers += _numbers(found.group())
        position = found.end()
    return numbers


def _numbers(text: str) -> list[float]:
    numbers = [float(number) for number in _NUMBER.findall(text)]
    if not all(abs(number) <= _MOST for number in numbers):
        raise SvgError(f"found a number beyond {_MOST:g}, expected smaller ones")
    return numbers


def _length(element: ET.Element, name: str) -> float:
    numbers = _numbers(element.get(name, "0"))
    if not numbers:
        raise SvgError(f"found {name}='{str(element.get(name))[:20]}' in a {_tag(element)[:20]}, expected a number")
    return numbers[0]


def _tag(element: ET.Element) -> str:
    return str(element.tag).rpartition("}")[2]


def _as_points(stroke: list[complex]) -> Points:
    return np.array([(point.real, point.imag) for point in stroke]).reshape(-1, 2)


_OUTLINES: dict[str, Callable[[ET.Element], Iterator[Points]]] = {
    "line": _line,
    "polyline": _polyline,
    "polygon": _polyline,
    "rect": _rect,
    "circle": _ellipse,
    "ellipse": _ellipse,
    "path": _path,
}
