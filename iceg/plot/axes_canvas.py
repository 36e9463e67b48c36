"""Axes of matplotlib as what a map is painted on: every stroke and marker a vector."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from numpy.typing import NDArray

_MARKERS = {"o": "o", "D": "D"}


class AxesCanvas:
    """A `MapCanvas` whose strokes and markers are matplotlib's; each covers those before it.

    Args:
        ax: axes to paint on, in map coordinates.
        width: of the trajectory's line [points]; all other sizes are given in such widths.
    """

    def __init__(self, ax: Axes, width: float) -> None:
        self._ax = ax
        self._width = width
        self._order = 2.0

    def line(self, points: NDArray[np.float64], colour: str, width: float) -> None:
        """A line through (n, 2) points."""
        self._ax.plot(
            *points.T, color=colour, linewidth=width * self._width, zorder=self._next(), solid_capstyle="round"
        )

    def strokes(self, points: NDArray[np.float64], colour: str, width: float, *, opacity: float = 1.0) -> None:
        """A line through each row of (s, n, 2) points."""
        lines = LineCollection(
            list(points), colors=colour, linewidths=width * self._width, alpha=opacity, zorder=self._next()
        )
        self._ax.add_collection(lines, autolim=False)

    def dots(self, points: NDArray[np.float64], colour: str, diameter: float) -> None:
        """A dot at each of (n, 2) points."""
        self._markers(points, "o", colour, diameter)

    def squares(self, points: NDArray[np.float64], colour: str, side: float) -> None:
        """A square at each of (n, 2) points."""
        self._markers(points, "s", colour, side)

    def crosses(self, points: NDArray[np.float64], colour: str, side: float, *, opacity: float = 1.0) -> None:
        """An x at each of (n, 2) points."""
        self._ax.plot(
            *points.T,
            linestyle="none",
            marker="x",
            color=colour,
            markersize=side * self._width,
            markeredgewidth=0.3 * self._width,
            alpha=opacity,
            zorder=self._next(),
        )

    def marker(self, point: NDArray[np.float64], shape: str, colour: str, size: float, *, edge: str) -> None:
        """One large marker at a (2,) point: "o" round, "D" diamond."""
        # A diamond's width is that of the square it is, turned: √2 of what matplotlib calls its size.
        side = size * self._width / (np.sqrt(2.0) if shape == "D" else 1.0)
        self._ax.plot(
            *point[:, None],
            marker=_MARKERS[shape],
            color=colour,
            markersize=side,
            markeredgecolor=edge,
            markeredgewidth=0.1 * side,
            zorder=self._next(),
        )

    def _markers(self, points: NDArray[np.float64], shape: str, colour: str, size: float) -> None:
        self._ax.plot(
            *points.T,
            linestyle="none",
            marker=shape,
            color=colour,
            markersize=size * self._width,
            markeredgewidth=0.0,
            zorder=self._next(),
        )

    def _next(self) -> float:
        self._order += 0.01
        return self._order
