"""A random scene: a place of some kind, a route through it, who walks there, laser and wheels of the robot."""

import math
from dataclasses import dataclass, replace
from typing import get_args

import numpy as np

from frontends.simulator.laser import Laser
from frontends.simulator.people import Person
from frontends.simulator.random_scenes.devices import Quality, random_laser, random_odometry
from frontends.simulator.random_scenes.ground import CELL, Cells, Ground, Points, survey
from frontends.simulator.random_scenes.plans import LARGE, PLANS, WIDE, Kind
from frontends.simulator.random_scenes.route import plan_route
from frontends.simulator.random_scenes.site import Site
from frontends.simulator.robot import Driving, OdometryModel, Route, Waypoint
from frontends.simulator.scene import Scene
from frontends.simulator.simulation import Simulation, simulate
from frontends.simulator.world import SimulatorError, World
from graph.se2 import inverse, transform_points

KINDS: tuple[Kind, ...] = get_args(Kind)
"""Every kind of place; seeds take them in turn."""
_REACH_OUTSIDE = 8.0  # m: of lasers for wide places
_WALK = 8.0  # m: nobody walks farther before turning round
_BRAKING = 0.3  # m: the robot stops within this, lest it meets a wall behind a waypoint that it overshoots
_MOST_DIGITS = 18  # of a seed in a name
_AISLE = 0.5  # m: people walk farther than this from the walls


@dataclass(frozen=True, kw_only=True)
class RandomScene:
    """A scene and how it is driven.

    Attributes:
        scene: its route starts at the identity.
        driving: speeds of the robot.
        kind: of the place.
        laser: name of the device.
        odometry: how good the wheels are; "none" for a robot whose log has no odometry.
    """

    scene: Scene
    driving: Driving
    kind: Kind
    laser: str
    odometry: Quality

    @property
    def has_odometry(self) -> bool:
        """Whether the wheels report anything."""
        return self.odometry != "none"


def random_scene(seed: int, kind: Kind | None = None, *, length: float | None = None) -> RandomScene:
    """Draw a scene.

    Args:
        seed: the same seed gives the same scene.
        kind: of place; by the seed unless given.
        length: of the route, about [m]; drawn unless given.

    Returns:
        The scene, named `random-SEED-KIND-LASER-ODOMETRY`.

    Raises:
        SimulatorError: a seed below zero.
    """
    if seed < 0:
        raise SimulatorError(f"a random scene needs a seed of 0 or more, found {seed}")
    kind = kind or kind_of(seed)
    plan_rng, device_rng, route_rng, people_rng, dark_rng = np.random.default_rng(seed).spawn(5)
    site = Site(rng=plan_rng)
    PLANS[kind](site)
    world = site.world
    ground = survey(np.concatenate([world.segments, *site.solid]))
    drawn = route_rng.uniform(60.0, 130.0) * (1.8 if kind in LARGE else 1.0)
    speed = route_rng.uniform(0.4, 0.8) * (1.6 if kind in LARGE else 1.0)
    driving = Driving(speed=speed, acceleration=max(0.5, speed**2 / (2 * _BRAKING)))
    points = plan_route(ground, length or drawn, route_rng)
    (laser_name, laser), (quality, odometry) = _devices(device_rng, kind)
    T_start_site = inverse(_start(points))
    scene = Scene(
        name=f"random-{seed}-{kind}-{laser_name}-{quality}",
        world=_darkened(_moved(world, T_start_site), dark_rng),
        route=Route(start=(0.0, 0.0, 0.0), waypoints=_waypoints(transform_points(T_start_site, points[1:]))),
        people=tuple(
            Person(path=_pairs(transform_points(T_start_site, path)), speed=people_rng.uniform(0.6, 1.4))
            for path in _walks(ground, people_rng)
        ),
        laser=laser,
        odometry=odometry,
    )
    return RandomScene(scene=scene, driving=driving, kind=kind, laser=laser_name, odometry=quality)


def kind_of(seed: int) -> Kind:
    """The kind of place that a seed draws."""
    return KINDS[seed % len(KINDS)]


def drawn_odometry(seed: int) -> Quality:
    """How good the wheels are that a seed draws for the kind of place it draws, without drawing the rest."""
    _, device_rng, *_ = np.random.default_rng(seed).spawn(2)
    _, (quality, _) = _devices(device_rng, kind_of(seed))
    return quality


def simulate_random(
    seed: int, kind: Kind | None = None, *, length: float | None = None, drive: int = 0, laser: Laser | None = None
) -> Simulation:
    """Draw a scene and drive through it.

    Args:
        seed: of the scene, and with `drive` of all that is random on the way.
        kind: of place; by the seed unless given.
        length: of the route, about [m]; drawn unless given.
        drive: number of the drive; others through the same scene have other noise.
        laser: the device, the scene's own unless given.

    Returns:
        Log and truth; without odometry the log says so, and its poses are zero.

    Raises:
        SimulatorError: a seed below zero, or a route that cannot be driven.
    """
    drawn = random_scene(seed, kind, length=length)
    simulation = simulate(drawn.scene, seed + drive, laser=laser, driving=drawn.driving)
    if drawn.has_odometry:
        return simulation
    log = replace(simulation.log, odometry=np.zeros_like(simulation.log.odometry), has_odometry=False)
    return replace(simulation, log=log)


def named_seed(name: str) -> int | None:
    """The seed of a scene named `random:SEED`; None for the name of another scene.

    Raises:
        SimulatorError: a seed that is no whole number of 0 or more.
    """
    prefix, _, seed = name.partition(":")
    if prefix != "random":
        return None
    if not (seed.isascii() and seed.isdigit() and len(seed) <= _MOST_DIGITS):
        raise SimulatorError(f"found scene '{name}', expected random:SEED with a whole number of 0 or more")
    return int(seed)


def _devices(rng: np.random.Generator, kind: Kind) -> tuple[tuple[str, Laser], tuple[Quality, OdometryModel]]:
    """Laser and wheels of a robot for a kind of place."""
    return random_laser(rng, _REACH_OUTSIDE if kind in WIDE else 0.0), random_odometry(rng)


def _start(points: Points) -> Points:
    """(3,) pose at the first of (n, 2) points, heading for the next."""
    (x, y), (to_x, to_y) = points[:2].tolist()
    return np.array([x, y, math.atan2(to_y - y, to_x - x)])


def _waypoints(points: Points) -> tuple[Waypoint, ...]:
    return tuple(Waypoint(x=x, y=y) for x, y in points.tolist())


def _pairs(points: Points) -> tuple[tuple[float, float], ...]:
    return tuple((x, y) for x, y in points.tolist())


def _moved(world: World, T_new_old: Points) -> World:
    """The world in another frame."""
    ends = transform_points(T_new_old, world.segments.reshape(-1, 2))
    return replace(world, segments=ends.reshape(-1, 4))


def _darkened(world: World, rng: np.random.Generator) -> World:
    """One world in three has some pieces of wall that return hardly any beam."""
    if rng.random() > 0.35:
        return world
    return replace(world, dark=np.where(rng.random(len(world.segments)) < 0.06, 0.9, 0.0))


def _walks(ground: Ground, rng: np.random.Generator) -> list[Points]:
    """(2, 2) ends of the straight ways on which up to four people walk to and fro [m]."""
    n = int(rng.integers(5)) if rng.random() < 0.6 else 0
    cells = np.argwhere(ground.is_free & (ground.clearance > _AISLE))
    if not len(cells):
        return []
    walks = [_walk(ground, cells, rng) for _ in range(n)]
    return [walk for walk in walks if not np.array_equal(*walk) and ground.is_free_between(*walk)]


def _walk(ground: Ground, cells: Cells, rng: np.random.Generator) -> Points:
    """Two of the cells that lie near each other."""
    one = cells[rng.integers(len(cells))]
    near = cells[np.hypot(*(cells - one).T) < _WALK / CELL]
    return ground.centres(np.stack([one, near[rng.integers(len(near))]]))
