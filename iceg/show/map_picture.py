"""The picture of a map as one would print it: the map, and below it scale bar, title and legend."""

import io
import math
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from frontends.checked_arguments import expect
from graph.atomic import write_atomically
from iceg.show.canvas import SMOOTHING, draw_marker
from iceg.show.map_image import (
    CLOSURE_COLOUR,
    INK,
    KIND_COLOURS,
    KIND_LABELS,
    TIME_COLOURS,
    MapLayers,
    clock_time,
    known_box,
    map_image,
    time_colour,
)

_DPI = 220
_NARROWEST = 1000  # width of the sheet [pixels], as are all sizes below
_STRIP, _LEGEND_LINE = 92, 36
_MARGIN, _GAP = 32, 34
_TEXT = 21
_SYMBOL, _PATH_SYMBOL = 40, 132
_KIND_SHAPES = ("s", "o", "x")


@dataclass(frozen=True)
class _Entry:
    """One entry of the legend, with a symbol before its text.

    Attributes:
        text: what it is.
        colour: of the symbol, unless it is the path's, whose colours run from start to end.
        line: width of its line, 0 for none.
        shape: of its marker.
        size: of its marker, 0 for none.
        is_path: a line in all colours of the path.
    """

    text: str
    colour: str
    line: int = 0
    shape: str = "o"
    size: int = 0
    is_path: bool = False

    @property
    def symbol(self) -> int:
        """Width that the symbol takes."""
        return _PATH_SYMBOL if self.is_path else _SYMBOL


def save_map_png(
    path: Path | str, layers: MapLayers, *, min_seen: int = 3, long_side: int = 2000, title: str | None = None
) -> None:
    """Save the picture of a map with its legend and scale bar.

    Args:
        path: the PNG file, written atomically.
        layers: what it shows.
        min_seen: landmarks seen less often are left out, as are those that have expired.
        long_side: of the map, in pixels, about: a cell gets a whole number of pixels where there is room for one.
        title: a line beside the scale bar; name of the log and side of a cell when left out.

    Raises:
        TypeError: the layers are of another type, such as a result itself.
    """
    expect(layers, MapLayers, "layers", "iceg.MapLayers, as result.layers")
    path = Path(path)
    layers = layers.settled(min_seen)
    box = known_box(layers.grid, layers.trajectory)
    image = map_image(layers, box=box, long_side=long_side)
    map_width = image.shape[1]
    width = max(map_width, _NARROWEST)
    below = np.asarray(
        _strip(width, map_width / (box[1] - box[0]), _legend_entries(layers), layers.title if title is None else title)
    )
    left = (width - map_width) // 2
    if width > map_width:
        image = np.pad(image, ((0, 0), (left, width - map_width - left), (0, 0)), constant_values=255)
    sheet = np.concatenate([image, below])
    content = io.BytesIO()
    Image.fromarray(sheet).save(content, format="PNG", compress_level=2, dpi=(_DPI, _DPI))
    write_atomically(path, content.getvalue())


def _legend_entries(layers: MapLayers) -> list[_Entry]:
    entries: list[_Entry] = []
    if layers.trajectory is not None:
        span = "start to end" if layers.seconds is None else f"0:00 to {clock_time(layers.seconds)}"
        entries.append(_Entry(f"path, {span}", INK, line=5, is_path=True))
    if layers.key_poses is not None:
        entries.append(_Entry("key pose", INK, shape="o", size=6))
    if layers.closures is not None and len(layers.closures):
        entries.append(_Entry(f"loop closure ({len(layers.closures)})", CLOSURE_COLOUR, line=2, size=7))
    if layers.landmarks is not None:
        counts = np.bincount(layers.landmarks.kinds, minlength=3)
        for colour, shape, label, count in zip(KIND_COLOURS, _KIND_SHAPES, KIND_LABELS, counts, strict=True):
            if count:
                entries.append(_Entry(f"{label} ({count})", colour, shape=shape, size=11))
    return entries


def _strip(width: int, pixels_per_metre: float, entries: list[_Entry], title: str) -> Image.Image:
    """The sheet's part below the map; the legend stands beside the scale bar where there is room, else below it."""
    font = ImageFont.load_default(SMOOTHING * _TEXT)
    title = _shortened(title, font, SMOOTHING * (width - _scale_bar_end(pixels_per_metre) - 2 * _GAP))
    widths = [entry.symbol + font.getlength(entry.text) / SMOOTHING + _GAP for entry in entries]
    taken = _scale_bar_end(pixels_per_metre) + (2 * _GAP + font.getlength(title) / SMOOTHING if title else 0.0)
    rows = _rows(widths, width, taken)
    height = _STRIP + (0 if rows is None else _LEGEND_LINE * len(rows))
    strip = Image.new("RGB", (SMOOTHING * width, SMOOTHING * height), "white")
    draw = ImageDraw.Draw(strip)
    _draw_scale_bar(draw, pixels_per_metre, font)
    if title:
        place = (SMOOTHING * (_scale_bar_end(pixels_per_metre) + _GAP), SMOOTHING * _STRIP // 2)
        draw.text(place, title, fill=INK, font=font, anchor="lm")
    if rows is None:
        _draw_entries(draw, entries, widths, width - _MARGIN - sum(widths) + _GAP, 0.5 * _STRIP, font)
    for line, row in enumerate(rows or ()):
        _draw_entries(draw, entries[row], widths[row], _MARGIN, _STRIP + line * _LEGEND_LINE, font)
    return strip.reduce(SMOOTHING)


def _shortened(text: str, font: ImageFont.FreeTypeFont | ImageFont.ImageFont, room: float) -> str:
    """A text as far as there is room for it."""
    if font.getlength(text) <= room:
        return text
    kept = next((n for n in range(len(text) - 1, 0, -1) if font.getlength(f"{text[:n]}…") <= room), 0)
    return f"{text[:kept]}…"


def _rows(widths: list[float], sheet: float, taken: float) -> list[slice] | None:
    """The entries of each line of the legend; None where all fit beside what has taken the left of the sheet."""
    if taken + _GAP + sum(widths) + _MARGIN <= sheet:
        return None
    rows, first, used = [], 0, 0.0
    for index, width in enumerate(widths):
        if index > first and used + width > sheet - 2 * _MARGIN + _GAP:
            rows.append(slice(first, index))
            first, used = index, 0.0
        used += width
    return [*rows, slice(first, len(widths))]


def _draw_entries(
    draw: ImageDraw.ImageDraw,
    entries: list[_Entry],
    widths: list[float],
    left: float,
    middle: float,
    font: ImageFont.FreeTypeFont | ImageFont.ImageFont,
) -> None:
    y = SMOOTHING * middle
    for entry, width in zip(entries, widths, strict=True):
        x, reach = SMOOTHING * left, SMOOTHING * (entry.symbol - (22 if entry.is_path else 10))
        if entry.is_path:
            _draw_path_key(draw, x, y, reach, SMOOTHING * entry.line)
        elif entry.line:
            draw.line((x, y, x + reach, y), fill=entry.colour, width=SMOOTHING * entry.line)
        if entry.size:
            draw_marker(draw, x + 0.5 * reach, y, entry.shape, entry.colour, SMOOTHING * entry.size)
        draw.text((x + SMOOTHING * entry.symbol, y), entry.text, fill=INK, font=font, anchor="lm")
        left += width


def _draw_path_key(draw: ImageDraw.ImageDraw, x: float, y: float, reach: float, width: int) -> None:
    """A line in the colours of the path, between the markers of its start and end."""
    for pixel in range(round(reach)):
        colour = time_colour(pixel / reach)
        draw.line((x + pixel, y - 0.5 * width, x + pixel, y + 0.5 * width), fill=colour, width=1)
    draw_marker(draw, x, y, "o", TIME_COLOURS[0], SMOOTHING * 15)
    draw_marker(draw, x + reach, y, "D", TIME_COLOURS[-1], SMOOTHING * 18)


def scale_bar_length(pixels_per_metre: float) -> float:
    """A round length that takes about an inch at 220 pixels [m]."""
    lengths = (0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100, 200, 500, 1000)
    return min(lengths, key=lambda metres: abs(math.log(metres * pixels_per_metre / _DPI)))


def _scale_bar_end(pixels_per_metre: float) -> float:
    """Where the bar and its label end, seen from the left edge of the sheet."""
    return _MARGIN + scale_bar_length(pixels_per_metre) * pixels_per_metre + _MARGIN


def _draw_scale_bar(
    draw: ImageDraw.ImageDraw, pixels_per_metre: float, font: ImageFont.FreeTypeFont | ImageFont.ImageFont
) -> None:
    length = scale_bar_length(pixels_per_metre)
    left, top, height = SMOOTHING * _MARGIN, SMOOTHING * 0.62 * _STRIP, SMOOTHING * 9
    quarter = SMOOTHING * length * pixels_per_metre / 4
    for part in range(4):
        around = (left + part * quarter, top, left + (part + 1) * quarter, top + height)
        draw.rectangle(around, fill=INK if part % 2 == 0 else "white", outline=INK, width=SMOOTHING)
    for place, text in ((left, "0"), (left + 4 * quarter, f"{length:g} m")):
        draw.text((place, top - SMOOTHING * 8), text, fill=INK, font=font, anchor="mb")
