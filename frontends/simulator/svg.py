"""The lines of an SVG drawing as straight pieces.

svgelements reads transforms, shapes and paths; what it passes over in silence (a word for a number, an unknown
transform) is refused before. Which elements are drawn, and where, is decided here: those of groups
and of `<use>`, but not what stands in definitions.
"""

import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET

import numpy as np
from numpy.typing import NDArray

from frontends.simulator.world import Segments, SimulatorError, polyline
from graph.dense import matmul
from graph.files import check_file
from graph.limits import LIMITS, at_most

Points = NDArray[np.float64]
"""(n, 2) of a polyline in units of the drawing."""

_MOST = 1e9  # units
_UNITS = {"": 1.0, "px": 1.0, "in": 96.0, "pc": 16.0, "pt": 96.0 / 72.0, "mm": 96.0 / 25.4, "cm": 96.0 / 2.54}
"""Of lengths [units]: 96 to an inch, the pixels of CSS."""
_DECIMALS = 9  # of a unit: the last digits of sine and cosine differ from processor to processor
_CURVE_PIECES = 12
_ARC_PIECE = math.radians(15.0)
_NUMBER = re.compile(r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?")
_LENGTH = re.compile(rf"\s*({_NUMBER.pattern})(px|in|cm|mm|pt|pc|%|)\s*")
_TRANSFORMS = re.compile(r"(?:(?:matrix|translate|scale|rotate|skewX|skewY)\s*\([^()]*\)[\s,]*)*")
_BRACKETS = re.compile(r"\([^()]*\)")
_DIGIT = re.compile(r"\d")
_COMMAND = re.compile(r"([MmLlHhVvZzCcSsQqTtAa])([^MmLlHhVvZzCcSsQqTtAa]*)")
_ARGUMENTS = {"m": 2, "l": 2, "h": 1, "v": 1, "z": 0, "c": 6, "s": 4, "q": 4, "t": 2, "a": 7}
_SHAPES = {
    "line": ("SimpleLine", ("x1", "y1", "x2", "y2")),
    "polyline": ("Polyline", ()),
    "polygon": ("Polygon", ()),
    "rect": ("Rect", ("x", "y", "width", "height", "rx", "ry")),
    "circle": ("Circle", ("cx", "cy", "r")),
    "ellipse": ("Ellipse", ("cx", "cy", "rx", "ry")),
    "path": ("Path", ()),
}
"""By tag: the class of svgelements, and its lengths."""
_HIDDEN = frozenset(
    ("defs", "clipPath", "mask", "pattern", "marker", "metadata", "title", "desc", "text", "style", "script")
)
_MOST_NESTED = 500  # <use> elements inside each other
_HREFS = ("href", "{http://www.w3.org/1999/xlink}href")


class SvgError(ValueError):
    """A drawing that cannot be understood."""


class _View(NamedTuple):
    """What percentages are of [units]."""

    width: float
    height: float


@dataclass(frozen=True, slots=True)
class _Place:
    """An element to draw.

    Attributes:
        element: itself.
        T: (3, 3) of the drawing's units from those around the element.
        view: around it.
        used_by: the `<use>` elements it is drawn for.
        size: width and height that the innermost of them asks for.
    """

    element: ET.Element
    T: Points
    view: _View
    used_by: frozenset[ET.Element] = frozenset()
    size: tuple[str | None, str | None] = (None, None)


def read_svg(path: Path) -> Segments:
    """All lines of a drawing, in its own units, y turned up and the lower left corner of its view at the origin.

    A unit is that of the outermost `viewBox`, a pixel of CSS (1/96 in) where there is none; lengths in mm, cm, in, pt
    and pc are brought to units. Fills, strokes, clipping and style sheets mean nothing here: every outline is a line.
    Text and what stands in `<defs>` or `<symbol>` is left out unless used, so is what is not displayed.

    Returns:
        (n, 4) segments.

    Raises:
        SvgError: the file is missing, no XML, or has a length, path, transform or `<use>` that breaks the format.
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
    left, bottom, view = _view_of_root(root)
    for points in _outlines(root, view):
        total += len(points)
        _check_points(total)
        if not (np.abs(points) <= _MOST).all():
            raise SvgError(f"found a line that leads beyond {_MOST:g} units")
        if len(points) > 1:
            pieces.append(polyline(np.round(points, _DECIMALS)))
    segments = np.concatenate(pieces) if pieces else np.zeros((0, 4))
    segments = segments[np.any(segments[:, :2] != segments[:, 2:], axis=1)]
    return np.stack(
        [segments[:, 0] - left, bottom - segments[:, 1], segments[:, 2] - left, bottom - segments[:, 3]], axis=1
    )


def _check_points(found: int) -> None:
    if found > LIMITS.walls:
        raise SvgError(f"found {found} points of lines or more, expected {at_most('walls')}")


def _view_of_root(root: ET.Element) -> tuple[float, float, _View]:
    """The left and the lower edge of the drawing, and its size."""
    box = _box(root)
    if box is not None:
        return box[0], box[1] + box[3], _View(box[2], box[3])
    none = _View(0.0, 0.0)
    width, height = _length(root, "width", none), _length(root, "height", none)
    return 0.0, height, _View(width, height)


def _outlines(root: ET.Element, view: _View) -> Iterator[Points]:
    """All outlines in the order of the drawing, however deep its groups are nested."""
    named = {element.get("id"): element for element in root.iter() if element.get("id")}
    drawn: dict[tuple[ET.Element, _View], list[Points]] = {}  # what is used often is taken apart once
    waiting = [_Place(child, np.eye(3), view) for child in reversed(root)]
    n_done = 0
    while waiting:
        _check_elements(n_done + len(waiting))
        place = waiting.pop()
        n_done += 1
        element, tag = place.element, _tag(place.element)
        if tag in _HIDDEN or _is_hidden(element) or (tag == "symbol" and not place.used_by):
            continue
        here = _placed(place)
        if tag in _SHAPES:
            shape = (element, here.view)
            if shape not in drawn:
                drawn[shape] = list(_outline(*shape))
            for points in drawn[shape]:
                yield matmul(points, here.T[:2, :2].T) + here.T[:2, 2]
        elif tag == "use":
            waiting.append(_used(here, named))
        else:
            waiting += [_Place(child, here.T, here.view, here.used_by) for child in reversed(element)]


def _check_elements(found: int) -> None:
    if found > LIMITS.walls:
        raise SvgError(f"found {found} elements or more, those of <use> counted each time, expected {at_most('walls')}")


def _is_hidden(element: ET.Element) -> bool:
    return element.get("display") == "none" or "display:none" in element.get("style", "").replace(" ", "")


def _placed(place: _Place) -> _Place:
    """Inside an element: its transform, and where it opens a view of its own, that of the view."""
    element = place.element
    own = element.get("transform", "").strip()
    T = matmul(place.T, _transform(own)) if own else place.T
    if _tag(element) not in {"svg", "symbol"}:
        return _Place(element, T, place.view, place.used_by)
    import svgelements

    width, height = (
        _length(element, name, place.view, "100%" if asked is None and element.get(name) is None else asked)
        for name, asked in zip(("width", "height"), place.size, strict=True)
    )
    x, y = _length(element, "x", place.view), _length(element, "y", place.view)
    box = _box(element)
    shift = np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])
    if box is None:
        return _Place(element, matmul(T, shift), _View(width, height), place.used_by)
    ratio = element.get("preserveAspectRatio", "xMidYMid meet")
    text = svgelements.Viewbox.viewbox_transform(x, y, width, height, *box, ratio)
    return _Place(element, matmul(T, _transform(text)), _View(box[2], box[3]), place.used_by)


def _used(place: _Place, named: dict[str | None, ET.Element]) -> _Place:
    """What a `<use>` draws, moved by its x and y."""
    use = place.element
    href = next((use.get(name) for name in _HREFS if use.get(name)), "") or ""
    target = named.get(href.removeprefix("#")) if href.startswith("#") else None
    if target is None:
        raise SvgError(f"found a <use> of '{href[:40]}', expected '#' and the id of an element of this drawing")
    if use in place.used_by:
        raise SvgError(f"found a <use> of '{href[:40]}' inside what it uses")
    if len(place.used_by) >= _MOST_NESTED:
        raise SvgError(f"found a <use> of '{href[:40]}' inside {_MOST_NESTED} others, expected fewer")
    x, y = _length(use, "x", place.view), _length(use, "y", place.view)
    T = matmul(place.T, np.array([[1.0, 0.0, x], [0.0, 1.0, y], [0.0, 0.0, 1.0]])) if x or y else place.T
    return _Place(target, T, place.view, place.used_by | {use}, (use.get("width"), use.get("height")))


def _outline(element: ET.Element, view: _View) -> Iterator[Points]:
    """Every stroke of a shape without lifting the pen, as svgelements takes it apart."""
    import svgelements

    tag = _tag(element)
    name, lengths = _SHAPES[tag]
    given: dict[str, Any] = {
        each: _length(element, each, view) for each in lengths if element.get(each, "auto") != "auto"
    }
    if tag == "path":
        given = {"d": _checked_path(element.get("d", ""))}
    elif not lengths:
        given = {"points": _checked_points(element)}
    try:
        shape = getattr(svgelements, name)(given)
        strokes = list(shape.segments(transformed=False))
    except (TypeError, ValueError) as error:  # svgelements reads no flag of an arc but 0 and 1, and goes on without
        raise SvgError(f"found a {tag} that cannot be drawn: {element.get('d', '')[:40]} {error}".rstrip()) from error
    yield from _polylines(strokes)


def _polylines(strokes: list[Any]) -> Iterator[Points]:
    points: list[Any] = []
    for stroke in strokes:
        kind = type(stroke).__name__
        if kind == "Move":
            yield _as_points(points)
            points = [stroke.end]
            continue
        if kind in {"Line", "Close"}:
            points.append(stroke.end)
        else:
            pieces = _CURVE_PIECES
            if kind == "Arc":
                pieces = max(1, math.ceil(abs(stroke.sweep) / _ARC_PIECE - 1e-6))
            points += [stroke.point(k / pieces) for k in range(1, pieces)]
            points.append(stroke.end)
        _check_points(len(points))
    yield _as_points(points)


def _as_points(points: list[Any]) -> Points:
    return np.array([(point.x, point.y) for point in points if point is not None]).reshape(-1, 2)


def _checked_path(text: str) -> str:
    """A path whose commands have their numbers, and not too many strokes."""
    leftover = _COMMAND.sub("", text).strip()
    if leftover:
        raise SvgError(f"found '{leftover[:20]}' in a path, expected a command such as M")
    n_strokes = 0
    for match in _COMMAND.finditer(text):
        command, arguments = match.group(1), match.group(2)
        count = _ARGUMENTS[command.lower()]
        strange = _NUMBER.sub("", arguments).strip(" ,\t\r\n")
        if strange:
            raise SvgError(f"found '{strange[:20]}' in a path, expected commands and numbers")
        n_numbers = len(_numbers(arguments))
        is_whole = command in "Aa" or (n_numbers % count == 0 if count else not n_numbers)  # flags of arcs may touch
        if not is_whole or (count and not n_numbers):
            raise SvgError(f"found {n_numbers} numbers after '{command}' in a path, expected {count} each time")
        n_strokes += n_numbers // count if count else 1
        _check_points(n_strokes)
    return text


def _checked_points(element: ET.Element) -> str:
    text = element.get("points", "")
    n_numbers = len(_numbers(text))
    if n_numbers % 2:
        raise SvgError(f"found {n_numbers} numbers in the points of a {_tag(element)}, expected two a point")
    _check_points(n_numbers // 2)
    return text


def _transform(text: str) -> Points:
    """(3, 3) of a list of transforms."""
    import svgelements

    _numbers(text)
    shown = text.strip()[:60]
    is_list = _TRANSFORMS.fullmatch(text.strip()) is not None
    if not (is_list and all(_DIGIT.search(arguments) for arguments in _BRACKETS.findall(text))):
        raise SvgError(f"found the transform {shown}, expected some of SVG's own")
    try:
        matrix = svgelements.Matrix(text)
        a, b, c, d, e, f = (float(number) for number in (matrix.a, matrix.b, matrix.c, matrix.d, matrix.e, matrix.f))
    except (ValueError, TypeError, IndexError) as error:
        raise SvgError(f"found the transform {shown}, expected some of SVG's own with all their numbers") from error
    return np.array([[a, c, e], [b, d, f], [0.0, 0.0, 1.0]])


def _length(element: ET.Element, name: str, view: _View, asked: str | None = None) -> float:
    """An attribute [units]; percentages are of the view around the element."""
    text = asked if asked is not None else element.get(name, "0")
    match = _LENGTH.fullmatch(text)
    if match is None:
        raise SvgError(
            f"found {name}='{text[:20]}' in a {_tag(element)[:20]}, expected a number, or one with px, mm, cm, in, pt, "
            "pc or %"
        )
    (number,) = _numbers(match.group(1))
    if match.group(2) != "%":
        return number * _UNITS[match.group(2)]
    across, up = name in {"x", "x1", "x2", "cx", "rx", "width"}, name in {"y", "y1", "y2", "cy", "ry", "height"}
    return number / 100.0 * (view.width if across else view.height if up else math.hypot(*view) / math.sqrt(2.0))


def _box(element: ET.Element) -> list[float] | None:
    """The viewBox: left, top, width, height."""
    if element.get("viewBox") is None:
        return None
    box = _numbers(element.get("viewBox", ""))
    if len(box) != 4 or not (box[2] > 0.0 and box[3] > 0.0):
        raise SvgError(f"found viewBox='{element.get('viewBox', '')[:40]}', expected left, top, width and height")
    return box


def _numbers(text: str) -> list[float]:
    numbers = [float(number) for number in _NUMBER.findall(text)]
    if not all(abs(number) <= _MOST for number in numbers):
        raise SvgError(f"found a number beyond {_MOST:g}, expected smaller ones")
    return numbers


def _tag(element: ET.Element) -> str:
    return str(element.tag).rpartition("}")[2]
