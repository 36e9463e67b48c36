"""How well the noise of a laser allows poses to be known: the Cramér–Rao bound of localising each scan alone.

It knows the true walls and nothing of where the robot was before or after. A map made of many scans errs less than one
of them, so a SLAM system may come near this bound. With good odometry it may even pass it, for what the wheels tell
from scan to scan averages the errors of neighbouring scans; drift, of which the bound has none, keeps it above.
"""

import numpy as np
from numpy.typing import NDArray

from frontends.simulator.laser import Laser, cast
from frontends.simulator.world import World
from graph import dense
from graph.se2 import compose

_STEP = 1e-5
"""Of a numerical derivative [m, rad]."""
_SINGULAR = 1e12
"""A scan whose information is worse conditioned does not know all of its pose."""
_STEEPEST = 50.0
"""A range that changes by more than so many times the step left one surface for another."""


def scan_information(
    world: World, T_world_robot: NDArray[np.float64], laser: Laser, times: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Fisher information of each scan alone about its pose among known walls.

    Σ gᵢ gᵢᵀ / σ(rᵢ)², gᵢ the derivative of range i by a step of the robot in its own frame. Mixed pixels,
    glass and dark surfaces cost nothing here: the bound is one of the noise.

    Args:
        world: what the beams meet.
        T_world_robot: (n, 3) true poses.
        laser: its beams and its noise; of a sweep, all beams are taken at once.
        times: (n,) of the scans [s].

    Returns:
        (n, 3, 3), order x, y, θ, in the frame of the robot.
    """
    geometry = laser.geometry

    def ranges_at(step: NDArray[np.float64]) -> NDArray[np.float64]:
        T_world_laser = compose(compose(T_world_robot, step), geometry.T_robot_laser)
        return cast(world, T_world_laser, geometry.bearings, geometry.range_max, times)

    ranges, steps = ranges_at(np.zeros(3)), _STEP * np.eye(3)
    with np.errstate(invalid="ignore"):  # beams that meet nothing
        slopes = np.stack([(ranges_at(step) - ranges_at(-step)) / (2.0 * _STEP) for step in steps], axis=-1)
        sigma2 = (laser.range_std + laser.range_std_per_metre * ranges) ** 2 + laser.quantisation**2 / 12.0
    told = np.isfinite(ranges) & np.isfinite(slopes).all(axis=-1) & (np.abs(slopes) < _STEEPEST).all(axis=-1)
    weights = np.where(told, 1.0 / sigma2, 0.0)
    slopes = np.where(told[..., None], slopes, 0.0)
    return dense.matmul(np.swapaxes(slopes * weights[..., None], 1, 2), slopes)


def trajectory_bound(information: NDArray[np.float64]) -> float:
    """Least absolute trajectory error of scans that are localised alone.

    Args:
        information: (n, 3, 3) of `scan_information`.

    Returns:
        Root mean square position error over the scans that know all of their pose [m]; NaN where none does.
    """
    strengths = dense.eigvalsh(information)
    known = information[strengths[:, 0] * _SINGULAR > strengths[:, 2]]
    covariances = dense.inv(known)
    return float(np.sqrt((covariances[:, 0, 0] + covariances[:, 1, 1]).mean())) if len(known) else float("nan")
