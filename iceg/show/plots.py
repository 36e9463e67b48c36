"""Pictures: the map, and the parts that notebooks put together.

Everything draws on axes it is given; no global state, no display needed.
"""

import math
from typing import TYPE_CHECKING

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.patches import Ellipse
from numpy.typing import ArrayLike, NDArray

from frontends.scan import Scan
from graph.dense import eigh
from graph.se2 import transform_points
from iceg.show.canvas import Box
from iceg.show.map_image import (
    INK,
    KIND_COLOURS,
    KIND_LABELS,
    TIME_COLOURS,
    MapLayers,
    known_box,
    map_image,
    wall_strokes,
)

if TYPE_CHECKING:
    from iceg.ice.features import Features

_KIND_MARKERS = ("s", "o", "x")
_MAP_PIXELS = 2000


def draw_map(
    ax: Axes, layers: MapLayers, *, min_seen: int = 3, box: Box | None = None, line_width: float = 0.8
) -> None:
    """Draw a map as `map_image` paints it.

    Args:
        ax: axes to draw on; aspect and limits are set, ticks removed.
        layers: what to draw.
        min_seen: landmarks seen less often are left out, as are those that have expired.
        box: x_min, x_max, y_min, y_max to show [m]; the known area when left out.
        line_width: of the trajectory, about [points]; other strokes and markers follow it.
    """
    layers = layers.settled(min_seen)
    box = box or known_box(layers.grid, layers.trajectory)
    pixels = line_width * _MAP_PIXELS / _long_side_in_points(ax, box)
    image = map_image(layers, box=box, long_side=_MAP_PIXELS, line_width=pixels)
    ax.imshow(image, extent=box, interpolation="antialiased")
    ax.set(xlim=box[:2], ylim=box[2:], xticks=[], yticks=[], aspect="equal")
    for spine in ax.spines.values():
        spine.set_visible(False)


def _long_side_in_points(ax: Axes, box: Box) -> float:
    """Length of the longer side of a box that fills the axes as far as its shape allows [points]."""
    width, height = box[1] - box[0], box[3] - box[2]
    assert ax.figure is not None
    pixels = min(ax.bbox.width / width, ax.bbox.height / height) * max(width, height)
    return float(72.0 * pixels / ax.figure.dpi)


def draw_scan_features(ax: Axes, scan: Scan, features: "Features", *, stroke: float = 0.4) -> None:
    """Draw one scan with its features in the robot frame.

    Args:
        ax: axes to draw on.
        scan: the scan; its points become dots, its laser a triangle.
        features: its features; weak ones are drawn hollow and pale.
        stroke: length of the strokes along the walls of a feature [m].
    """
    points = scan.points
    ax.plot(*points.T, ".", color="#999999", markersize=2.5, zorder=1)
    ax.plot(*scan.geometry.origin_robot, marker=(3, 0, -90), color=INK, markersize=8, zorder=2)
    for kind, (colour, marker, label) in enumerate(zip(KIND_COLOURS, _KIND_MARKERS, KIND_LABELS, strict=True)):
        for real in (True, False):
            chosen = (features.kinds == kind) & (features.real == real)
            if not chosen.any():
                continue
            alpha = 1.0 if real else 0.4
            strokes = wall_strokes(features.positions[chosen], features.directions[chosen], stroke)
            ax.add_collection(LineCollection(list(strokes), colors=colour, linewidths=1.2, alpha=alpha, zorder=3))
            ax.plot(
                *features.positions[chosen].T,
                marker,
                color=colour,
                markerfacecolor=colour if real and marker != "x" else "none",
                markersize=5,
                alpha=alpha,
                label=label if real else f"{label} (weak)",
                zorder=4,
            )
    ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    ax.legend(fontsize="small", frameon=False, loc="upper left", bbox_to_anchor=(1.0, 1.0))


def draw_alignment(
    ax: Axes,
    reference_points: NDArray[np.float64],
    scan: Scan,
    T_ref_guess: NDArray[np.float64],
    T_ref_match: NDArray[np.float64],
) -> None:
    """Draw a scan on its reference, where it was expected and where it was matched.

    Args:
        ax: axes to draw on.
        reference_points: (n, 2) points of the reference [m].
        scan: the scan.
        T_ref_guess: (3,) where the robot was expected.
        T_ref_match: (3,) where the match put it.
    """
    ax.plot(*reference_points.T, ".", color="#999999", markersize=2.5, label="reference", zorder=1)
    poses = ((T_ref_guess, TIME_COLOURS[0], "scan as expected"), (T_ref_match, "#0072b2", "scan as matched"))
    for zorder, (pose, colour, label) in enumerate(poses, start=2):
        ax.plot(*transform_points(pose, scan.points).T, ".", color=colour, markersize=4, label=label, zorder=zorder)
        nose = transform_points(pose, np.array([[0.0, 0.0], [0.5, 0.0]]))
        ax.plot(*nose.T, "-o", color=colour, markersize=7, markevery=[0], linewidth=2, zorder=4)
    ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    ax.legend(fontsize="small", frameon=False)


def draw_covariance_ellipse(
    ax: Axes,
    mean: ArrayLike,
    covariance: ArrayLike,
    sigmas: float = 2.0,
    *,
    colour: str = "#c1272d",
    label: str | None = None,
) -> Ellipse:
    """Draw where a point lies with its covariance.

    Args:
        ax: axes to draw on.
        mean: (2,) or longer; x and y come first.
        covariance: (2, 2) or larger, the same order.
        sigmas: size of the ellipse in standard deviations.
        colour: of its line.
        label: for a legend.

    Returns:
        The ellipse.
    """
    centre = np.asarray(mean, dtype=np.float64)[:2]
    variances, axes = eigh(np.asarray(covariance, dtype=np.float64)[:2, :2])
    small, large = 2.0 * sigmas * np.sqrt(np.maximum(variances, 0.0))
    angle = math.degrees(math.atan2(axes[1, 1], axes[0, 1]))
    ellipse = Ellipse(
        (float(centre[0]), float(centre[1])),
        float(large),
        float(small),
        angle=angle,
        fill=False,
        edgecolor=colour,
        linewidth=1.2,
        label=label,
        zorder=5,
    )
    ax.add_patch(ellipse)
    return ellipse


def draw_correlation_surface(
    ax: Axes,
    xs: NDArray[np.float64],
    ys: NDArray[np.float64],
    scores: NDArray[np.float64],
    best: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
) -> None:
    """Draw the correlation score over (dx, dy) around a match.

    Args:
        ax: axes to draw on.
        xs: (n_x,) shifts along x [m], evenly spaced.
        ys: (n_y,) shifts along y [m], evenly spaced.
        scores: (n_y, n_x) score of each shift.
        best: (2,) or longer, where the match came out [m].
        covariance: (2, 2) or larger, drawn as the ellipse of two standard deviations.
    """
    half_x, half_y = 0.5 * (xs[1] - xs[0]), 0.5 * (ys[1] - ys[0])
    extent = (float(xs[0] - half_x), float(xs[-1] + half_x), float(ys[0] - half_y), float(ys[-1] + half_y))
    image = ax.imshow(scores, origin="lower", extent=extent, cmap="magma", interpolation="nearest", aspect="equal")
    if best is not None:
        x, y = np.asarray(best, dtype=np.float64)[:2]
        ax.plot([x], [y], "+", color="#7fdbca", markersize=9, zorder=6)
        if covariance is not None:
            draw_covariance_ellipse(ax, best, covariance, 2.0, colour="#7fdbca")
    ax.set(xlabel="x [m]", ylabel="y [m]")
    if ax.figure is not None:
        ax.figure.colorbar(image, ax=ax, label="correlation score")


def draw_error_over_time(
    ax: Axes,
    stamps: NDArray[np.float64],
    errors: NDArray[np.float64],
    sigmas: NDArray[np.float64] | None = None,
    *,
    label: str = "position error [m]",
    bound: float = 3.0,
) -> None:
    """Draw an error along the trajectory against the uncertainty that was claimed for it.

    Args:
        ax: axes to draw on.
        stamps: (n,) time or path length of each pose.
        errors: (n,) signed or absolute error.
        sigmas: (n,) claimed standard deviation; the band of ± `bound` of them is shaded.
        label: of the vertical axis.
        bound: size of the band in standard deviations.
    """
    if sigmas is not None:
        low = -bound * sigmas if (errors < 0).any() else np.zeros_like(sigmas)
        ax.fill_between(
            stamps, low, bound * sigmas, color="#0072b2", alpha=0.15, linewidth=0, label=f"{bound:g} σ claimed"
        )
    ax.plot(stamps, errors, color=INK, linewidth=1.0, label="error")
    ax.set(xlabel="time [s]", ylabel=label)
    ax.margins(x=0)
    for side in ("top", "right"):
        ax.spines[side].set_visible(False)
    ax.legend(fontsize="small", frameon=False, ncols=2, loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0)
