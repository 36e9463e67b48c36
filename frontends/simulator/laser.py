"""A SICK LMS200-like laser in a world: exact casting, then the device's noise, mixed pixels and quantisation."""

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

from frontends.scan import ScanGeometry
from frontends.simulator._kernels import cast_rays
from frontends.simulator.world import SimulatorError, World
from graph.se2 import compose


def sick_lms200() -> ScanGeometry:
    """181 beams over 180°, 20 m, mounted 0.16 m ahead of the robot's centre."""
    return ScanGeometry(
        bearings=np.linspace(-np.pi / 2, np.pi / 2, 181),
        range_min=0.05,
        range_max=20.0,
        T_robot_laser=np.array([0.16, 0.0, 0.0]),
    )


@dataclass(frozen=True, kw_only=True)
class Laser:
    """What the laser does to a true range.

    Attributes:
        geometry: beams, usable range and mount.
        period: time from scan to scan [s].
        range_std: noise of a short range [m].
        range_std_per_metre: how the noise grows with range.
        quantisation: step of a reported range [m]; 0 for none.
        beam_width: angle from side to side of one beam's spot [rad].
        edge_step: jump in range within the spot from which a beam may mix both surfaces [m].
        mixed_share: share of the beams at such an edge whose range lies somewhere between the two.
    """

    geometry: ScanGeometry = field(default_factory=sick_lms200)
    period: float = 0.2
    range_std: float = 0.005
    range_std_per_metre: float = 0.0005
    quantisation: float = 0.01
    beam_width: float = math.radians(0.5)
    edge_step: float = 0.15
    mixed_share: float = 0.2

    def __post_init__(self) -> None:
        if not 0 <= self.mixed_share <= 1:
            raise SimulatorError(f"laser.mixed_share must lie in [0, 1], found {self.mixed_share}")
        if min(self.range_std, self.range_std_per_metre, self.quantisation) < 0:
            raise SimulatorError("laser.range_std, range_std_per_metre and quantisation must not be negative")


def cast(
    world: World, T_world_laser: ArrayLike, bearings: NDArray[np.float64], range_max: float, times: ArrayLike = 0.0
) -> NDArray[np.float64]:
    """True ranges without noise.

    Args:
        world: what the beams may hit.
        T_world_laser: (n, 3) poses of the laser.
        bearings: (n_beams,) beam directions in the laser frame, increasing, in [−π, π] [rad].
        range_max: how far the beams reach [m].
        times: (n,) when each scan is taken, or one time for all [s].

    Returns:
        (n, n_beams) [m]; inf where nothing stands within `range_max`.
    """
    poses = np.ascontiguousarray(T_world_laser, dtype=np.float64).reshape(-1, 3)
    when = np.ascontiguousarray(np.broadcast_to(np.asarray(times, dtype=np.float64), len(poses)))
    ranges: NDArray[np.float64] = cast_rays(
        poses, when, bearings, world.segments, world.visible_from, world.visible_to, range_max
    )
    return ranges


def sense(
    world: World, T_world_robot: NDArray[np.float64], laser: Laser, rng: np.random.Generator, times: ArrayLike = 0.0
) -> NDArray[np.float32]:
    """Scans as the device reports them.

    Args:
        world: what the beams may hit.
        T_world_robot: (n, 3) true poses of the robot.
        laser: the device.
        rng: its noise.
        times: (n,) when each scan is taken, or one time for all [s].

    Returns:
        (n, n_beams) [m]; NaN where the beam had no usable return.
    """
    geometry = laser.geometry
    T_world_laser = compose(T_world_robot, geometry.T_robot_laser)
    ranges = cast(world, T_world_laser, geometry.bearings, geometry.range_max, times)
    if laser.mixed_share > 0:
        ranges = _mix_edges(ranges, world, T_world_laser, laser, rng, times)
    hit = np.isfinite(ranges)
    noise = rng.standard_normal(ranges.shape)
    ranges[hit] += noise[hit] * (laser.range_std + laser.range_std_per_metre * ranges[hit])
    if laser.quantisation > 0:
        ranges[hit] = np.round(ranges[hit] / laser.quantisation) * laser.quantisation
    usable = hit & (ranges >= geometry.range_min) & (ranges < geometry.range_max)
    return np.where(usable, ranges, np.nan).astype(np.float32)


def _mix_edges(
    ranges: NDArray[np.float64],
    world: World,
    T_world_laser: NDArray[np.float64],
    laser: Laser,
    rng: np.random.Generator,
    times: ArrayLike,
) -> NDArray[np.float64]:
    """Some beams whose spot falls on two surfaces report a range between them.

    A spot on one flat wall is none of these, however slanting: there 1/r of its middle is the mean of 1/r of its sides
    (but for the cosine of half its width).
    """
    half = laser.beam_width / 2
    reach = laser.geometry.range_max
    right, left = (cast(world, T_world_laser, laser.geometry.bearings + side, reach, times) for side in (-half, half))
    spot = np.stack([right, ranges, left])
    chosen = np.isfinite(spot).all(axis=0) & (rng.random(ranges.shape) < laser.mixed_share)
    share = rng.random(ranges.shape)[chosen]
    right, middle, left = spot[:, chosen]
    on_one_wall = 2 * np.cos(half) * right * left / (right + left)
    near, far = spot[:, chosen].min(axis=0), spot[:, chosen].max(axis=0)
    mixed = ranges.copy()
    mixed[chosen] = np.where(np.abs(middle - on_one_wall) > laser.edge_step / 2, near + share * (far - near), middle)
    return mixed
