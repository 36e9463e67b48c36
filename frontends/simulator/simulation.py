"""From a scene and a seed to a log with its truth."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log, ScanGeometry
from frontends.simulator.gyro import GyroModel, measure_turns
from frontends.simulator.laser import Course, Laser, sense
from frontends.simulator.people import walk
from frontends.simulator.robot import TICK, Driving, OdometryModel, drive, measure_odometry, whole_ticks
from frontends.simulator.scene import Scene, load_scene
from frontends.simulator.world import SimulatorError
from graph.elementary import cos_sin
from graph.limits import check_limit
from graph.se2 import compose, wrap_angle

_CLEARANCE = 0.3
"""Pairs of scans are taken no nearer to a wall than this [m] …"""
_TRIES_PER_PAIR = 200
"""… from at most so many random places for each pair asked for."""


@dataclass(frozen=True, kw_only=True)
class Simulation:
    """What was recorded, and what was true.

    Attributes:
        log: as a reader would return it.
        truth: (n_scans, 3) T_map_robot at each scan, map = the world frame of the scene; the scenes of the package
            start at the identity.
        scene: what was driven through.
    """

    log: Log
    truth: NDArray[np.float64]
    scene: Scene


@dataclass(frozen=True, kw_only=True)
class ScanPairs:
    """Pairs of scans from nearby poses, with the exact pose between them.

    Attributes:
        reference: (n, n_beams) ranges of the first scan of each pair [m]; NaN without return.
        current: (n, n_beams) ranges of the second one.
        T_ref_cur: (n, 3) exact pose of the second robot in the frame of the first.
        T_map_ref: (n, 3) where the first scan was taken.
        geometry: the laser.
    """

    reference: NDArray[np.float32]
    current: NDArray[np.float32]
    T_ref_cur: NDArray[np.float64]
    T_map_ref: NDArray[np.float64]
    geometry: ScanGeometry


def simulate(
    scene: str | Scene,
    seed: int = 0,
    *,
    laser: Laser | None = None,
    driving: Driving | None = None,
    odometry: OdometryModel | None = None,
    gyro: GyroModel | None = None,
) -> Simulation:
    """Drive through a scene and record what laser and wheels report.

    Args:
        scene: a scene, the name of one of the package's, or the path of a `.world` file.
        seed: of all that is random; the operator, the wheels and the laser draw from streams of their own.
        laser: the device, the scene's own unless given.
        driving: speeds and the operator's skill.
        odometry: how wrong the wheels are; the scene's own unless given.
        gyro: how wrong a gyro is; the robot has none unless given.

    Returns:
        Log and truth, one row per scan, the first at the start of the route.

    Raises:
        SimulatorError: no such scene, a route that cannot be driven, or a laser whose period is no multiple of a tick.
    """
    where = load_scene(scene) if isinstance(scene, str) else scene
    laser = laser or where.laser
    operator_rng, wheels_rng, laser_rng, gyro_rng = np.random.default_rng(seed).spawn(4)
    ticks = whole_ticks(laser.period)
    step = laser.period if laser.sweep_time == 0 else TICK
    course = Course(T_world_robot=drive(where.route, driving or Driving(), step, operator_rng), step=step)
    truth = course.T_world_robot[:: 1 if laser.sweep_time == 0 else ticks]
    stamps = np.arange(len(truth), dtype=np.float64) * laser.period
    _check_work(where, len(truth), laser)
    log = Log(
        ranges=sense(
            where.world,
            truth,
            laser,
            laser_rng,
            stamps,
            legs=walk(where.people, truth, stamps),
            course=course,
        ),
        odometry=measure_odometry(truth, odometry or where.odometry, laser.period, wheels_rng),
        stamps=stamps,
        geometry=laser.geometry,
        path=Path(f"{where.name}.clf"),
        gyro=None if gyro is None else measure_turns(truth, gyro, laser.period, gyro_rng),
    )
    return Simulation(log=log, truth=truth, scene=where)


def _check_work(scene: Scene, n_scans: int, laser: Laser) -> None:
    """Refuse a drive that would fill the memory or take for ever."""
    for found, name, what in (
        (n_scans, "simulated_scans", "scans"),
        (n_scans * laser.geometry.n_beams, "simulated_beams", "beams in all scans"),
        (n_scans * len(scene.world.segments), "simulated_walls", "scans times pieces of wall"),
        (n_scans * len(scene.people), "simulated_people", "scans times people"),
    ):
        check_limit(found, name, f"scene '{scene.name}': found {found} {what}")


def scan_pairs(
    scene: str | Scene,
    n: int,
    seed: int = 0,
    *,
    max_translation: float = 0.5,
    max_rotation: float = 0.35,
    laser: Laser | None = None,
) -> ScanPairs:
    """Pairs of scans for Monte Carlo tests of a matcher, taken along the route of a scene.

    Args:
        scene: as for `simulate`; the world as it stands at time 0, without people.
        n: number of pairs.
        seed: of places, offsets and noise.
        max_translation: the second pose lies anywhere in a disc of this radius around the first [m].
        max_rotation: and is turned by at most this [rad].
        laser: the device, the scene's own unless given; it stands while it scans.

    Returns:
        The pairs; the way from one pose to the other keeps 0.3 m from every wall.

    Raises:
        SimulatorError: the scene has no room for such pairs.
    """
    where = load_scene(scene) if isinstance(scene, str) else scene
    laser = laser or where.laser
    places_rng, reference_rng, current_rng = np.random.default_rng(seed).spawn(3)
    path = drive(where.route, Driving(), laser.period, places_rng)
    kept: list[NDArray[np.float64]] = []
    found = 0
    for _ in range(_TRIES_PER_PAIR):
        T_map_ref, T_ref_cur = _candidates(path, n, max_translation, max_rotation, places_rng)
        free = _is_free(where, T_map_ref, compose(T_map_ref, T_ref_cur))
        kept.append(np.concatenate([T_map_ref, T_ref_cur], axis=1)[free])
        found += int(free.sum())
        if found >= n:
            break
    else:
        raise SimulatorError(f"scene '{where.name}' has room for {found} scan pairs in {_TRIES_PER_PAIR * n} tries")
    both = np.concatenate(kept)[:n]
    T_map_ref, T_ref_cur = both[:, :3], both[:, 3:]
    return ScanPairs(
        reference=sense(where.world, T_map_ref, laser, reference_rng),
        current=sense(where.world, compose(T_map_ref, T_ref_cur), laser, current_rng),
        T_ref_cur=T_ref_cur,
        T_map_ref=T_map_ref,
        geometry=laser.geometry,
    )


def _candidates(
    path: NDArray[np.float64], n: int, max_translation: float, max_rotation: float, rng: np.random.Generator
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Poses near the path with any heading, and offsets from them."""
    T_map_ref = path[rng.integers(len(path), size=n)]
    T_map_ref[:, :2] += rng.uniform(-0.3, 0.3, size=(n, 2))
    T_map_ref[:, 2] = wrap_angle(T_map_ref[:, 2] + rng.uniform(-0.5, 0.5, size=n))
    distance, bearing = max_translation * np.sqrt(rng.random(n)), rng.uniform(-np.pi, np.pi, size=n)
    turn = rng.uniform(-max_rotation, max_rotation, size=n)
    cos, sin = cos_sin(bearing)
    return T_map_ref, np.stack([distance * cos, distance * sin, wrap_angle(turn)], axis=1)


def _is_free(where: Scene, T_map_a: NDArray[np.float64], T_map_b: NDArray[np.float64]) -> NDArray[np.bool_]:
    """Whether both poses keep clear of all walls and nothing stands between them."""
    free = np.ones(len(T_map_a), dtype=np.bool_)
    for share in np.linspace(0.0, 1.0, 9).tolist():
        points = T_map_a[:, :2] + share * (T_map_b - T_map_a)[:, :2]
        free &= where.world.clearance(points) > _CLEARANCE
    return free
