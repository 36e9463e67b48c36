"""Scans, their features, and how one was matched."""

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
from iceg.show.map_image import INK, KIND_COLOURS, KIND_LABELS, TIME_COLOURS, wall_strokes

if TYPE_CHECKING:
    from iceg.ice.features import Features

_KIND_MARKERS = ("s", "o", "x")


def scan_features(scan: Scan, features: "Features", ax: Axes, *, stroke: float = 0.4) -> None:
    """Draw one scan with its features in the robot frame.

    Args:
        scan: the scan; its points become dots, its laser a triangle.
        features: its features; weak ones are drawn hollow and pale.
        ax: axes to draw on.
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


def alignment(
    reference_points: NDArray[np.float64],
    scan: Scan,
    T_ref_guess: NDArray[np.float64],
    T_ref_match: NDArray[np.float64],
    ax: Axes,
) -> None:
    """Draw a scan on its reference, where it was expected and where it was matched.

    Args:
        reference_points: (n, 2) points of the reference [m].
        scan: the scan.
        T_ref_guess: (3,) where the robot was expected.
        T_ref_match: (3,) where the match put it.
        ax: axes to draw on.
    """
    ax.plot(*reference_points.T, ".", color="#999999", markersize=2.5, label="reference", zorder=1)
    poses = ((T_ref_guess, TIME_COLOURS[0], "scan as expected"), (T_ref_match, "#0072b2", "scan as matched"))
    for zorder, (pose, colour, label) in enumerate(poses, start=2):
        ax.plot(*transform_points(pose, scan.points).T, ".", color=colour, markersize=4, label=label, zorder=zorder)
        nose = transform_points(pose, np.array([[0.0, 0.0], [0.5, 0.0]]))
        ax.plot(*nose.T, "-o", color=colour, markersize=7, markevery=[0], linewidth=2, zorder=4)
    ax.set(aspect="equal", xlabel="x [m]", ylabel="y [m]")
    ax.legend(fontsize="small", frameon=False)


def covariance_ellipse(
    mean: ArrayLike,
    covariance: ArrayLike,
    ax: Axes,
    sigmas: float = 2.0,
    *,
    colour: str = "#c1272d",
    label: str | None = None,
) -> Ellipse:
    """Draw where a point lies with its covariance.

    Args:
        mean: (2,) or longer; x and y come first.
        covariance: (2, 2) or larger, the same order.
        ax: axes to draw on.
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


def correlation_surface(
    xs: NDArray[np.float64],
    ys: NDArray[np.float64],
    scores: NDArray[np.float64],
    ax: Axes,
    best: ArrayLike | None = None,
    covariance: ArrayLike | None = None,
) -> None:
    """Draw the correlation score over (dx, dy) around a match.

    Args:
        xs: (n_x,) shifts along x [m], evenly spaced.
        ys: (n_y,) shifts along y [m], evenly spaced.
        scores: (n_y, n_x) score of each shift.
        ax: axes to draw on.
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
            covariance_ellipse(best, covariance, ax, 2.0, colour="#7fdbca")
    ax.set(xlabel="x [m]", ylabel="y [m]")
    if ax.figure is not None:
        ax.figure.colorbar(image, ax=ax, label="correlation score")
