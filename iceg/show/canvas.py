"""Strokes and markers over a grey picture of a map, painted with Pillow.

Every run leaves such a picture, and matplotlib takes 0.6 s to load, Pillow 0.03: vectors and figures are matplotlib's,
by the same `MapCanvas`.

They are painted on twice the pixels, each as the number of its colour, so that a byte a pixel holds them; Pillow then
shrinks what was painted tile by tile and lays it over the greys.
"""

from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageChops, ImageColor, ImageDraw

Box = tuple[float, float, float, float]

SMOOTHING = 2
"""Pixels drawn for one pixel of the picture, along each axis: 1, 2 or 4."""
_TILE = 96
"""Pixels of the picture, each way, that are mixed at a time; where nothing was painted nothing is mixed."""
_WALL = 160
"""Greys up to this are walls, which stay visible under what is painted."""


class MapCanvas(Protocol):
    """What a map can be painted on, in map coordinates [m]; sizes are given in widths of the trajectory's line."""

    def line(self, points: NDArray[np.float64], colour: str, width: float) -> None:
        """A line through (n, 2) points."""

    def strokes(self, points: NDArray[np.float64], colour: str, width: float, *, opacity: float = 1.0) -> None:
        """A line through each row of (s, n, 2) points."""

    def dots(self, points: NDArray[np.float64], colour: str, diameter: float) -> None:
        """A dot at each of (n, 2) points."""

    def squares(self, points: NDArray[np.float64], colour: str, side: float) -> None:
        """A square at each of (n, 2) points."""

    def crosses(self, points: NDArray[np.float64], colour: str, side: float, *, opacity: float = 1.0) -> None:
        """An x at each of (n, 2) points."""

    def marker(self, point: NDArray[np.float64], shape: str, colour: str, size: float, *, edge: str) -> None:
        """One large marker at a (2,) point: "o" round, "D" diamond."""


class Canvas:
    """Paints in map coordinates; the last one on a pixel covers those before it.

    Args:
        shape: height and width of the picture [pixels].
        box: x_min, x_max, y_min, y_max of the picture [m], the y axis upwards.
        width: of the trajectory's line [pixels]; all other sizes are given in such widths.
    """

    def __init__(self, shape: tuple[int, int], box: Box, width: float) -> None:
        self._numbers = Image.new("P", (SMOOTHING * shape[1], SMOOTHING * shape[0]), 0)
        self._draw = ImageDraw.Draw(self._numbers)
        self._colours: dict[tuple[str, float], int] = {}
        self._pixels_per_metre = SMOOTHING * shape[1] / (box[1] - box[0])
        self._corner = (box[0], box[3])
        self._width = SMOOTHING * width

    def line(self, points: NDArray[np.float64], colour: str, width: float) -> None:
        """A line through (n, 2) points."""
        self.strokes(points[None], colour, width)

    def strokes(self, points: NDArray[np.float64], colour: str, width: float, *, opacity: float = 1.0) -> None:
        """A line through each row of (s, n, 2) points."""
        number, pixels = self._number(colour, opacity), max(1, round(width * self._width))
        for row in self._pixels(points).reshape(len(points), 2 * points.shape[1]).tolist():
            self._draw.line(row, fill=number, width=pixels)

    def dots(self, points: NDArray[np.float64], colour: str, diameter: float) -> None:
        """A dot at each of (n, 2) points."""
        number = self._number(colour)
        for square in self._squares(points, diameter):
            self._draw.ellipse(square, fill=number)

    def squares(self, points: NDArray[np.float64], colour: str, side: float) -> None:
        """A square at each of (n, 2) points."""
        number = self._number(colour)
        for square in self._squares(points, side):
            self._draw.rectangle(square, fill=number)

    def crosses(self, points: NDArray[np.float64], colour: str, side: float, *, opacity: float = 1.0) -> None:
        """An x at each of (n, 2) points."""
        number, width = self._number(colour, opacity), max(1, round(0.3 * self._width))
        for left, top, right, bottom in self._squares(points, side):
            self._draw.line((left, top, right, bottom), fill=number, width=width)
            self._draw.line((left, bottom, right, top), fill=number, width=width)

    def marker(self, point: NDArray[np.float64], shape: str, colour: str, size: float, *, edge: str) -> None:
        """One large marker at a (2,) point, see `draw_marker`."""
        x, y = self._pixels(point).tolist()
        draw_marker(self._draw, x, y, shape, self._number(colour), size * self._width, edge=self._number(edge))

    def over(self, shades: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The picture; walls show through what was painted.

        Args:
            shades: (height, width) greys below what was painted.

        Returns:
            (height, width, 3) red, green and blue.
        """
        picture = Image.fromarray(np.ascontiguousarray(shades)).convert("RGB")
        walls = Image.fromarray(np.where(shades <= _WALL, shades, np.uint8(255)))
        self._numbers.putpalette(self._palette(), "RGBA")
        for top in range(0, picture.height, _TILE):
            for left in range(0, picture.width, _TILE):
                self._mix(picture, walls, (left, top, left + _TILE, top + _TILE))
        return np.asarray(picture)

    def _mix(self, picture: Image.Image, walls: Image.Image, tile: tuple[int, int, int, int]) -> None:
        """Lay what was painted in a tile over the picture, as far as anything was; walls are as dark as they were."""
        left, top, right, bottom = tile
        width, height = picture.size
        corners = (left, top, min(right, width), min(bottom, height))
        painted = self._numbers.crop(_times(SMOOTHING, corners)).getbbox()
        if painted is None:
            return
        reach = (
            left + painted[0] // SMOOTHING,
            top + painted[1] // SMOOTHING,
            left - (-painted[2] // SMOOTHING),
            top - (-painted[3] // SMOOTHING),
        )
        smooth = self._numbers.crop(_times(SMOOTHING, reach)).convert("RGBA").reduce(SMOOTHING)
        mixed = picture.crop(reach)
        mixed.paste(smooth, (0, 0), smooth)
        picture.paste(ImageChops.darker(mixed, walls.crop(reach).convert("RGB")), reach[:2])

    def _number(self, colour: str, opacity: float = 1.0) -> int:
        """The byte that stands for a colour; 0 is nothing painted."""
        number = self._colours.setdefault((colour, opacity), len(self._colours) + 1)
        assert number <= 255, "more colours than a byte tells apart"
        return number

    def _palette(self) -> bytes:
        """Red, green, blue and opacity of each number."""
        entries = [(0, 0, 0, 0)]
        for colour, opacity in self._colours:
            red, green, blue, *_ = ImageColor.getrgb(colour)
            entries.append((red, green, blue, round(255 * opacity)))
        return bytes(value for entry in entries for value in entry)

    def _squares(self, points: NDArray[np.float64], side: float) -> list[list[float]]:
        """Left, top, right and bottom of the square around each of (n, 2) points [pixels]."""
        half, pixels = 0.5 * side * self._width, self._pixels(points)
        squares: list[list[float]] = np.concatenate([pixels - half, pixels + half], axis=1).tolist()
        return squares

    def _pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        x = (points[..., 0] - self._corner[0]) * self._pixels_per_metre
        y = (self._corner[1] - points[..., 1]) * self._pixels_per_metre
        return np.stack([x, y], axis=-1)


def _times(factor: int, box: tuple[int, int, int, int]) -> tuple[int, int, int, int]:
    left, top, right, bottom = box
    return factor * left, factor * top, factor * right, factor * bottom


def draw_marker(
    draw: ImageDraw.ImageDraw,
    x: float,
    y: float,
    shape: str,
    colour: str | int,
    size: float,
    *,
    edge: str | int | None = None,
) -> None:
    """Paint one marker.

    Args:
        draw: what to paint with.
        x: of its centre [pixels].
        y: of its centre [pixels].
        shape: "o" round, "D" diamond, "s" square, "x" cross.
        colour: of the marker, as the picture painted on has it.
        size: its width [pixels].
        edge: colour of a thin rim; none when left out.
    """
    half, rim = 0.5 * size, max(1, round(0.1 * size))
    around = (x - half, y - half, x + half, y + half)
    if shape == "o":
        draw.ellipse(around, fill=colour, outline=edge, width=rim if edge else 0)
    elif shape == "D":
        corners = [(x, y - half), (x + half, y), (x, y + half), (x - half, y)]
        draw.polygon(corners, fill=colour, outline=edge, width=rim if edge else 0)
    elif shape == "s":
        draw.rectangle(around, fill=colour, outline=edge, width=rim if edge else 0)
    else:
        width = max(1, round(0.25 * size))
        draw.line((x - half, y - half, x + half, y + half), fill=colour, width=width)
        draw.line((x - half, y + half, x + half, y - half), fill=colour, width=width)
