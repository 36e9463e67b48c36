"""A laser in a world: exact casting, each beam at its own time, then noise, mixed pixels and quantisation."""

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike, NDArray

from frontends.scan import ScanGeometry
from frontends.simulator._kernels import cast_on_circles, cast_rays, cast_sweeps
from frontends.simulator.people import LEG_RADIUS
from frontends.simulator.world import SimulatorError, World
from graph.elementary import arctan2, cos_sin
from graph.ranges import check_between
from graph.se2 import between, compose, expmap, logmap

_MIRRORING = math.radians(8)  # glass met more squarely than this returns the beam
_LEAST_STEP = 1e-6  # m
_BLOCK = 4096  # scans cast at a time


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
        sweep_time: from the beam of the smallest bearing to the one of the largest [s], while the robot moves on (an
            LMS200 takes 0.007); negative for a laser that turns clockwise, 0 for all beams at once. The pose of a scan
            is that of the middle of its sweep.
    """

    geometry: ScanGeometry = field(default_factory=sick_lms200)
    period: float = 0.2
    range_std: float = 0.005
    range_std_per_metre: float = 0.0005
    quantisation: float = 0.01
    beam_width: float = math.radians(0.5)
    edge_step: float = 0.15
    mixed_share: float = 0.2
    sweep_time: float = 0.0

    def __post_init__(self) -> None:
        check_between(
            self,
            SimulatorError,
            "laser.",
            period=(0.0, 3600.0),
            range_std=(-math.inf, 100.0),
            range_std_per_metre=(-math.inf, 10.0),
            quantisation=(-math.inf, 100.0),
            beam_width=(0.0, math.pi),
            edge_step=(0.0, 1e6),
        )
        if 0 < self.quantisation < _LEAST_STEP:
            raise SimulatorError(f"laser.quantisation is 0 or at least {_LEAST_STEP} m, found {self.quantisation}")
        if not 0 <= self.mixed_share <= 1:
            raise SimulatorError(f"laser.mixed_share must lie in [0, 1], found {self.mixed_share}")
        if min(self.range_std, self.range_std_per_metre, self.quantisation) < 0:
            raise SimulatorError("laser.range_std, range_std_per_metre and quantisation must not be negative")
        if not abs(self.sweep_time) <= self.period:
            raise SimulatorError(
                f"laser.sweep_time must be no longer than the period of {self.period} s, found {self.sweep_time}"
            )


@dataclass(frozen=True, kw_only=True)
class Course:
    """Where the robot is while its laser sweeps.

    Attributes:
        T_world_robot: (m, 3) true poses, the first at time 0; before and after them the robot stands.
        step: time from each to the next [s].
    """

    T_world_robot: NDArray[np.float64]
    step: float

    def at(self, times: NDArray[np.float64]) -> NDArray[np.float64]:
        """(..., 3) true poses at (...,) times [s]; constant velocity from one pose to the next."""
        place = np.clip(times / self.step, 0.0, len(self.T_world_robot) - 1)
        before = np.floor(place).astype(np.int64)
        after = np.minimum(before + 1, len(self.T_world_robot) - 1)
        steps = logmap(between(self.T_world_robot[:-1], self.T_world_robot[1:]))
        steps = np.concatenate([steps, np.zeros((1, 3))])
        moved = np.where(after > before, place - before, 0.0)[..., None] * steps[before]
        return compose(self.T_world_robot[before], expmap(moved))


def cast(
    world: World, T_world_laser: ArrayLike, bearings: NDArray[np.float64], range_max: float, times: ArrayLike = 0.0
) -> NDArray[np.float64]:
    """True ranges without noise; glass is a wall like others.

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
    ranges: NDArray[np.float64]
    ranges, _ = cast_rays(poses, when, bearings, world.segments, world.visible_from, world.visible_to, range_max)
    return ranges


def sense(
    world: World,
    T_world_robot: NDArray[np.float64],
    laser: Laser,
    rng: np.random.Generator,
    times: ArrayLike = 0.0,
    *,
    legs: NDArray[np.float64] | None = None,
    course: Course | None = None,
) -> NDArray[np.float32]:
    """Scans as the device reports them.

    Args:
        world: what the beams may hit.
        T_world_robot: (n, 3) true poses of the robot.
        laser: the device.
        rng: its noise.
        times: (n,) when each scan is taken, or one time for all [s].
        legs: (n, m, 2) where people's legs stand at each scan [m], NaN where nobody is; None without people.
        course: where the robot is before and after each scan, for lasers that take time for a sweep; None for a robot
            that stands while it scans.

    Returns:
        (n, n_beams) [m]; NaN where the beam had no usable return.
    """
    when = np.ascontiguousarray(np.broadcast_to(np.asarray(times, dtype=np.float64), len(T_world_robot)))
    ranges = np.empty((len(T_world_robot), laser.geometry.n_beams), dtype=np.float32)
    for start in range(0, len(ranges), _BLOCK):
        block = slice(start, start + _BLOCK)
        view = _View(
            world=world,
            laser=laser,
            T_world_robot=T_world_robot[block],
            times=when[block],
            legs=None if legs is None or legs.shape[1] == 0 else np.ascontiguousarray(legs[block]),
            course=None if laser.sweep_time == 0 else course,
        )
        ranges[block] = _report(view, rng)
    return ranges


@dataclass(frozen=True, kw_only=True)
class _View:
    """A block of scans to be taken."""

    world: World
    laser: Laser
    T_world_robot: NDArray[np.float64]
    times: NDArray[np.float64]
    legs: NDArray[np.float64] | None
    course: Course | None

    def look(self, side: float, luck: NDArray[np.float64] | None) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        """True range of each beam turned `side`, and the segment hit; `luck` in [0, 1) passes panes of more glass."""
        ranges, hits = self._cast(self.world, side)
        if luck is None or self.world.glass is None:
            return ranges, hits
        passes = (hits >= 0) & (luck < self.world.glass[hits]) & (self._slant(hits, side) > _MIRRORING)
        behind, hits_behind = self._cast(self.world.without_glass(), side)
        return np.where(passes, behind, ranges), np.where(passes, hits_behind, hits)

    def _cast(self, world: World, side: float) -> tuple[NDArray[np.float64], NDArray[np.int32]]:
        geometry = self.laser.geometry
        bearings, reach = geometry.bearings + side, geometry.range_max
        T_world_laser = compose(self.T_world_robot, geometry.T_robot_laser)
        walls = (world.segments, world.visible_from, world.visible_to, reach)
        if self.course is None and self.legs is None:
            ranges, hits = cast_rays(T_world_laser, self.times, bearings, *walls)
            return ranges, hits
        T_world_beam = self._beams(T_world_laser, bearings)
        if self.course is None:
            ranges, hits = cast_rays(T_world_laser, self.times, bearings, *walls)
        else:
            ranges, hits = cast_sweeps(T_world_laser, T_world_beam, self.times, bearings, *walls)
        if self.legs is not None:
            cast_on_circles(T_world_beam, self.legs, LEG_RADIUS, reach, ranges, hits)
        return ranges, hits

    def _beams(self, T_world_laser: NDArray[np.float64], bearings: NDArray[np.float64]) -> NDArray[np.float64]:
        """(n, n_beams, 3) where each beam starts from and its direction."""
        T_laser_beam = np.zeros((len(bearings), 3))
        T_laser_beam[:, 2] = bearings
        return compose(T_world_laser[:, None] if self.course is None else self._T_world_lasers, T_laser_beam)

    @cached_property
    def _T_world_lasers(self) -> NDArray[np.float64]:
        """(n, n_beams, 3) the laser as each beam leaves it, while the robot goes on: whatever side it is turned."""
        assert self.course is not None
        delays = np.linspace(-0.5, 0.5, self.laser.geometry.n_beams) * self.laser.sweep_time
        return compose(self.course.at(self.times[:, None] + delays), self.laser.geometry.T_robot_laser)

    def _slant(self, hits: NDArray[np.int32], side: float) -> NDArray[np.float64]:
        """Angle between each beam and the normal of the segment it hits [rad]."""
        x0, y0, x1, y1 = self.world.segments.T
        walls = arctan2(y1 - y0, x1 - x0)[hits]
        headings = self.T_world_robot[:, 2] + self.laser.geometry.T_robot_laser[2]
        beams = headings[:, None] + self.laser.geometry.bearings + side
        cos, sin = cos_sin(beams - walls)
        return arctan2(np.abs(cos), np.abs(sin))


def _report(view: _View, rng: np.random.Generator) -> NDArray[np.float32]:
    """What the device makes of the true ranges."""
    world, laser, geometry = view.world, view.laser, view.laser.geometry
    shape = (len(view.times), geometry.n_beams)
    luck = None if world.glass is None else rng.random(shape)
    ranges, hits = view.look(0.0, luck)
    if laser.mixed_share > 0:
        ranges = _mix_edges(ranges, view, luck, rng)
    if world.dark is not None:
        swallowed = (hits >= 0) & (rng.random(shape) < world.dark[hits])
        ranges[swallowed] = np.inf
    hit = np.isfinite(ranges)
    noise = rng.standard_normal(shape)
    ranges[hit] += noise[hit] * (laser.range_std + laser.range_std_per_metre * ranges[hit])
    if laser.quantisation > 0:
        ranges[hit] = np.round(ranges[hit] / laser.quantisation) * laser.quantisation
    usable = hit & (ranges >= geometry.range_min) & (ranges < geometry.range_max)
    return np.where(usable, ranges, np.nan).astype(np.float32)


def _mix_edges(
    ranges: NDArray[np.float64], view: _View, luck: NDArray[np.float64] | None, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Some beams whose spot falls on two surfaces report a range between them.

    A spot on one flat wall is none of these, however slanting: there 1/r of its middle is the mean of 1/r of its sides
    (but for the cosine of half its width).
    """
    laser = view.laser
    half = laser.beam_width / 2
    right, left = (view.look(side, luck)[0] for side in (-half, half))
    spot = np.stack([right, ranges, left])
    chosen = np.isfinite(spot).all(axis=0) & (rng.random(ranges.shape) < laser.mixed_share)
    share = rng.random(ranges.shape)[chosen]
    right, middle, left = spot[:, chosen]
    on_one_wall = 2 * math.cos(half) * right * left / (right + left)
    near, far = spot[:, chosen].min(axis=0), spot[:, chosen].max(axis=0)
    mixed = ranges.copy()
    mixed[chosen] = np.where(np.abs(middle - on_one_wall) > laser.edge_step / 2, near + share * (far - near), middle)
    return mixed
