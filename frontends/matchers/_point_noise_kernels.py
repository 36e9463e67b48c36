"""How uncertain the points of a scan are, compiled. A symmetric 2x2 matrix is a row (xx, xy, yy)."""

import math

import numpy as np
from numpy.typing import NDArray

from graph.compiled import compiled, compiled_for_both


@compiled
def point_model(
    xy: NDArray[np.float64],
    linked: NDArray[np.bool_],
    resolution: float,
    range_sigma: float,
    angle_sigma: float,
    neighbours: int,
    max_spread: float,
    noise: NDArray[np.float64],
    tangents: NDArray[np.float64],
    spreads: NDArray[np.float64],
) -> None:
    """Fill noise covariance, direction of the wall and standard deviation of a correspondence along it, per point."""
    n = len(xy)
    for i in range(n):
        x, y = xy[i]
        r = max(math.hypot(x, y), 1e-6)
        ux, uy = x / r, y / r
        along_beam, across = range_sigma**2, (r * angle_sigma) ** 2
        noise[i, 0] = along_beam * ux * ux + across * uy * uy
        noise[i, 1] = (along_beam - across) * ux * uy
        noise[i, 2] = along_beam * uy * uy + across * ux * ux
        tangents[i, 0], tangents[i, 1] = _wall_direction(xy, linked, i, neighbours)
        if tangents[i, 0] == 0.0 and tangents[i, 1] == 0.0:
            tangents[i, 0], tangents[i, 1] = -uy, ux
        incidence = math.acos(min(1.0, abs(tangents[i, 0] * ux + tangents[i, 1] * uy)))
        step = r * math.sin(resolution)
        shorter = min(max_spread, step / max(math.sin(min(incidence + resolution, 0.5 * math.pi)), 1e-3))
        longer = min(max_spread, step / max(math.sin(incidence - resolution), 1e-3))
        spreads[i] = math.sqrt((shorter**3 + longer**3) / (3.0 * (shorter + longer)))


@compiled
def place(
    xy: NDArray[np.float64],
    noise: NDArray[np.float64],
    tangents: NDArray[np.float64],
    pose: NDArray[np.float64],
    out_xy: NDArray[np.float64],
    out_noise: NDArray[np.float64],
    out_tangents: NDArray[np.float64],
) -> None:
    """Move points with their covariances and wall directions into another frame."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(len(xy)):
        x, y = xy[i]
        out_xy[i, 0], out_xy[i, 1] = pose[0] + c * x - s * y, pose[1] + s * x + c * y
        tx, ty = tangents[i]
        out_tangents[i, 0], out_tangents[i, 1] = c * tx - s * ty, s * tx + c * ty
        out_noise[i, 0], out_noise[i, 1], out_noise[i, 2] = rotated(noise[i, 0], noise[i, 1], noise[i, 2], c, s)


@compiled
def _wall_direction(xy: NDArray[np.float64], linked: NDArray[np.bool_], i: int, neighbours: int) -> tuple[float, float]:
    """Unit vector along the line through a point and its linked neighbours; 0, 0 where it has none."""
    n = len(xy)
    first, last = i, i
    while first > 0 and i - first < neighbours and linked[first - 1]:
        first -= 1
    while last < n - 1 and last - i < neighbours and linked[last]:
        last += 1
    if last == first:
        return 0.0, 0.0
    count = last - first + 1
    mx, my = xy[first : last + 1, 0].mean(), xy[first : last + 1, 1].mean()
    xx, xy_, yy = 0.0, 0.0, 0.0
    for k in range(first, last + 1):
        dx, dy = xy[k, 0] - mx, xy[k, 1] - my
        xx += dx * dx / count
        xy_ += dx * dy / count
        yy += dy * dy / count
    angle = 0.5 * math.atan2(2.0 * xy_, xx - yy)
    return math.cos(angle), math.sin(angle)


@compiled_for_both
def rotated(xx: float, xy: float, yy: float, c: float, s: float) -> tuple[float, float, float]:
    """R P Rᵀ."""
    return (
        c * c * xx - 2.0 * c * s * xy + s * s * yy,
        c * s * (xx - yy) + (c * c - s * s) * xy,
        s * s * xx + 2.0 * c * s * xy + c * c * yy,
    )
