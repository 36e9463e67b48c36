"""Strokes and markers over a grey picture of a map, smooth without a plotting library.

They are drawn with Pillow on twice the pixels, each as the number of its colour: a byte a pixel, of which few are set.
What they cover of each pixel of the picture is then mixed with its grey.
"""

from functools import reduce

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageColor, ImageDraw

Box = tuple[float, float, float, float]

SMOOTHING = 2
"""Pixels drawn for one pixel of the picture, along each axis: 1, 2 or 4."""
_BAND = 64
"""Rows of the picture that are mixed at a time: few enough to stay in the processor's cache."""


class Canvas:
    """Paints in map coordinates; the last one on a pixel covers those before it.

    Args:
        shape: height and width of the picture [pixels].
        box: x_min, x_max, y_min, y_max of the picture [m], the y axis upwards.
        width: of the trajectory's line [pixels]; all other sizes are given in such widths.
    """

    def __init__(self, shape: tuple[int, int], box: Box, width: float) -> None:
        self._numbers = Image.new("L", (SMOOTHING * shape[1], SMOOTHING * shape[0]), 0)
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
        """The picture.

        Args:
            shades: (height, width) greys below what was painted.

        Returns:
            (height, width, 3) red, green and blue.
        """
        picture = np.empty((*shades.shape, 3), dtype=np.uint8)
        colours = self._premultiplied()
        for top in range(0, len(shades), _BAND):
            band = shades[top : top + _BAND]
            numbers = self._numbers.crop((0, SMOOTHING * top, self._numbers.width, SMOOTHING * (top + len(band))))
            picture[top : top + _BAND] = _mixed(np.asarray(numbers), colours, band)
        return picture

    def _number(self, colour: str, opacity: float = 1.0) -> int:
        """The byte that stands for a colour; 0 is nothing painted."""
        number = self._colours.setdefault((colour, opacity), len(self._colours) + 1)
        assert number <= 255, "more colours than a byte tells apart"
        return number

    def _premultiplied(self) -> NDArray[np.float32]:
        """(n, 4) red, green and blue times opacity, and opacity, of each number."""
        known = [(0.0, 0.0, 0.0, 0.0)]
        for colour, opacity in self._colours:
            red, green, blue, *_ = ImageColor.getrgb(colour)
            known.append((opacity * red, opacity * green, opacity * blue, opacity))
        return np.array(known, dtype=np.float32)

    def _squares(self, points: NDArray[np.float64], side: float) -> list[list[float]]:
        """Left, top, right and bottom of the square around each of (n, 2) points [pixels]."""
        half, pixels = 0.5 * side * self._width, self._pixels(points)
        squares: list[list[float]] = np.concatenate([pixels - half, pixels + half], axis=1).tolist()
        return squares

    def _pixels(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        x = (points[..., 0] - self._corner[0]) * self._pixels_per_metre
        y = (self._corner[1] - points[..., 1]) * self._pixels_per_metre
        return np.stack([x, y], axis=-1)


def _mixed(numbers: NDArray[np.uint8], colours: NDArray[np.float32], shades: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """(height, width, 3) pixels of what was drawn, given by the numbers of its colours, over greys."""
    picture = shades.repeat(3).reshape(*shades.shape, 3)
    beside = numbers.view(f"u{SMOOTHING}")  # the pixels of a row that become one
    painted = reduce(np.bitwise_or, [beside[row::SMOOTHING] for row in range(SMOOTHING)])
    rows, cols = np.divmod(np.flatnonzero(painted != 0), shades.shape[1])
    first = SMOOTHING * (rows * numbers.shape[1] + cols)
    mixed = np.zeros((len(rows), 4), dtype=np.float32)
    for down in range(SMOOTHING):
        for right in range(SMOOTHING):
            mixed += colours.take(numbers.take(first + (down * numbers.shape[1] + right)), axis=0)
    mixed /= SMOOTHING**2
    picture[rows, cols] = np.rint(mixed[:, :3] + (1.0 - mixed[:, 3:]) * shades[rows, cols, None])
    return picture


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
