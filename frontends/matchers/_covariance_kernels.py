"""How noise of the ranges moves the minimum of a point matcher, compiled (Censi, ICRA 2007)."""

import math

import numpy as np
from numpy.typing import NDArray

from frontends.matchers._outline_kernels import Outline
from frontends.matchers._pair_kernels import Pairs
from graph.compiled import compiled


@compiled
def covariance_parts(
    outline: Outline, pairs: Pairs, pose: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """H = Σaaᵀ of the distances to the surfaces, and M = Σ (∂g/∂ρ)(∂g/∂ρ)ᵀ over every range ρ of both scans.

    The nearest place slides along its surface as the scan moves, so a pair says nothing along it. The covariance of a
    small motion in the frame of the reference is σ²·H⁻¹MH⁻¹ with the noise σ of a range.

    Returns:
        H and M, (3, 3), and (number of pairs, Σ squared distances to the surfaces [m²]).
    """
    n = len(outline.xy)
    H, M = np.zeros((3, 3)), np.zeros((3, 3))
    of_reference = np.zeros((n, 3))
    count, total = 0, 0.0
    a = np.empty(3)
    for i in range(len(pairs.kept)):
        nx, ny = pairs.normals[i]
        if not pairs.kept[i] or (nx == 0.0 and ny == 0.0):
            continue
        x, y = pairs.moved[i]
        j = pairs.indices[i]
        k = j + 1 if j + 1 < n else 0
        jx, jy = outline.xy[j]
        kx, ky = outline.xy[k]
        count += 1
        total += (nx * (x - jx) + ny * (y - jy)) ** 2
        a[0], a[1], a[2] = nx, ny, ny * x - nx * y
        _add_square(H, a, 1.0)
        bx, by = x - pose[0], y - pose[1]
        _add_square(M, a, ((nx * bx + ny * by) / max(math.hypot(bx, by), 1e-9)) ** 2)
        # Where the foot of the perpendicular lies between the two reference points decides how much each moves it.
        ex, ey = kx - jx, ky - jy
        share = ((x - jx) * ex + (y - jy) * ey) / (ex * ex + ey * ey)
        of_reference[j] -= a * ((1.0 - share) * (nx * jx + ny * jy) / max(math.hypot(jx, jy), 1e-9))
        of_reference[k] -= a * (share * (nx * kx + ny * ky) / max(math.hypot(kx, ky), 1e-9))
    for j in range(n):
        _add_square(M, of_reference[j], 1.0)
    return H, M, np.array([float(count), total])


@compiled
def _add_square(total: NDArray[np.float64], a: NDArray[np.float64], weight: float) -> None:
    """Add a weighted aaᵀ to a sum (3, 3)."""
    for i in range(3):
        for j in range(3):
            total[i, j] += a[i] * a[j] * weight
