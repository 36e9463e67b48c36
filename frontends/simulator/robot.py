"""A skid-steer robot: driven along waypoints as an operator would, and what its wheels say about it."""

import math
from array import array
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from frontends.simulator.world import SimulatorError
from graph.elementary import cos_sin
from graph.limits import LIMITS, at_most
from graph.ranges import check_between
from graph.se2 import between, wrap_angle

TICK = 0.02
"""Time step of the simulation [s]."""
_ARRIVED = 0.08
"""A waypoint nearer than this is reached [m]."""
_ALIGNED = math.radians(2)
_TURN_ON_THE_SPOT = math.radians(25)
_PATIENCE = 600.0
_SCALES, _DEVIATIONS = (-10.0, 10.0), (0.0, 10.0)
"""What wheels can be wrong by, in the units of `OdometryModel`."""


@dataclass(frozen=True, kw_only=True)
class Waypoint:
    """A place to drive to.

    Attributes:
        x: world frame [m].
        y: world frame [m].
        pause: how long to stand there [s].
    """

    x: float
    y: float
    pause: float = 0.0


@dataclass(frozen=True, kw_only=True)
class Route:
    """Where the robot starts and the waypoints it drives to, in order.

    Attributes:
        start: x [m], y [m], heading [rad] in the world frame.
        waypoints: at least one.
        laps: how often they are driven to, all of them in order each time.
        duration: of the whole drive [s]: whatever the operator does it ends then, having stood at the last waypoint
            before if need be; None to end there.
    """

    start: tuple[float, float, float]
    waypoints: tuple[Waypoint, ...]
    laps: int = 1
    duration: float | None = None

    def __post_init__(self) -> None:
        if not self.waypoints:
            raise SimulatorError("a route needs at least one waypoint, found none")
        if self.laps < 1:
            raise SimulatorError(f"a route needs one lap or more, found {self.laps}")
        if self.duration is not None and not 0 <= self.duration < math.inf:
            raise SimulatorError(f"a route's duration must not be negative, found {self.duration} s")
        _check_time(self.duration or 0.0)
        if self.laps * len(self.waypoints) > LIMITS.simulated_waypoints:
            raise SimulatorError(
                f"found {self.laps} laps of {len(self.waypoints)} waypoints, expected "
                f"{at_most('simulated_waypoints')} together"
            )


@dataclass(frozen=True, kw_only=True)
class Driving:
    """How the operator drives a P2AT-like robot.

    Attributes:
        speed: cruising speed [m/s].
        acceleration: forward and braking [m/s²].
        turn_rate: fastest turn [rad/s].
        turn_acceleration: [rad/s²].
        steering_std: how far the operator's aim wanders off the waypoint [rad].
        steering_time: over how long the aim forgets itself [s].
    """

    speed: float = 0.6
    acceleration: float = 0.5
    turn_rate: float = math.radians(45)
    turn_acceleration: float = math.radians(120)
    steering_std: float = math.radians(1.5)
    steering_time: float = 2.0

    def __post_init__(self) -> None:
        for name in ("speed", "acceleration", "turn_rate", "turn_acceleration", "steering_time"):
            if getattr(self, name) <= 0:
                raise SimulatorError(f"driving.{name} must be positive, found {getattr(self, name)}")


@dataclass(frozen=True, kw_only=True)
class OdometryModel:
    """How wrong wheel odometry is. Random parts grow with the square root of the motion, as random walks do.

    Attributes:
        translation_scale: reported over true distance.
        rotation_scale: reported over true rotation; skidding wheels turn more than the robot.
        heading_drift: reported heading per true distance, one wheel a little larger than the other [rad/m].
        translation_std: after one metre [m/√m].
        rotation_std: after one radian [rad/√rad].
        drift_std: heading after one metre [rad/√m].
        slip_std: spread of the rotation scale from one skid to the next.
        slip_time: how long one skid lasts [s].
    """

    translation_scale: float = 1.01
    rotation_scale: float = 1.02
    heading_drift: float = math.radians(0.1)
    translation_std: float = 0.03
    rotation_std: float = 0.05
    drift_std: float = math.radians(0.5)
    slip_std: float = 0.02
    slip_time: float = 2.0

    def __post_init__(self) -> None:
        check_between(
            self,
            SimulatorError,
            "odometry.",
            translation_scale=_SCALES,
            rotation_scale=_SCALES,
            heading_drift=_SCALES,
            translation_std=_DEVIATIONS,
            rotation_std=_DEVIATIONS,
            drift_std=_DEVIATIONS,
            slip_std=_DEVIATIONS,
            slip_time=(TICK, 1e6),
        )


def whole_ticks(period: float) -> int:
    """How many ticks of the simulator a period takes [s].

    Raises:
        SimulatorError: no whole number of them.
    """
    ticks = round(period / TICK)
    if ticks < 1 or not math.isclose(ticks * TICK, period):
        raise SimulatorError(f"the scan period must be a multiple of {TICK} s, found {period} s")
    return ticks


def drive(route: Route, driving: Driving, period: float, rng: np.random.Generator) -> NDArray[np.float64]:
    """Drive along a route.

    Args:
        route: start and waypoints.
        driving: speeds and the operator's skill.
        period: time between two samples [s].
        rng: the operator's wandering aim.

    Returns:
        (n, 3) T_world_robot every `period`, the first at the start; headings in (−π, π].

    Raises:
        SimulatorError: when a waypoint is not reached, or the period is no multiple of the simulator's tick.
    """
    ticks = whole_ticks(period)
    operator = _Operator(route.start, driving, rng)
    for here, after in _legs(route):
        operator.go_to(here, after)
        operator.stand(here.pause)
        if route.duration is not None and operator.time >= route.duration:
            break
    if route.duration is not None:
        operator.stand(route.duration - operator.time)
    T_world_robot = np.array(operator.trace).reshape(-1, 3)[::ticks]
    if route.duration is not None:
        T_world_robot = T_world_robot[: round(route.duration / period) + 1]
    T_world_robot[:, 2] = wrap_angle(T_world_robot[:, 2])
    return T_world_robot


def measure_odometry(
    T_world_robot: NDArray[np.float64], model: OdometryModel, period: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """What the wheels report along a true path.

    Args:
        T_world_robot: (n, 3) true poses.
        model: scales, drifts and noise.
        period: time between two poses [s].
        rng: the noise.

    Returns:
        (n, 3) T_odom_robot, the first one the identity.
    """
    steps = between(T_world_robot[:-1], T_world_robot[1:])
    distance, rotation = np.hypot(steps[:, 0], steps[:, 1]), steps[:, 2]
    noise = rng.standard_normal((len(steps), 4))
    moving = np.sqrt(distance)
    slip = _wander(noise[:, 3], model.slip_std, period / model.slip_time)
    reported = np.empty_like(steps)
    reported[:, 0] = model.translation_scale * steps[:, 0] + model.translation_std * moving * noise[:, 0]
    reported[:, 1] = steps[:, 1]
    reported[:, 2] = (
        (model.rotation_scale + slip) * rotation
        + model.heading_drift * distance
        + model.rotation_std * np.sqrt(np.abs(rotation)) * noise[:, 1]
        + model.drift_std * moving * noise[:, 2]
    )
    return _chain(reported)


def _legs(route: Route) -> Iterator[tuple[Waypoint, Waypoint | None]]:
    """Each waypoint and the one after it, lap by lap."""
    for lap in range(1, route.laps + 1):
        last = None if lap == route.laps else route.waypoints[0]
        yield from zip(route.waypoints, (*route.waypoints[1:], last), strict=True)


def _chain(steps: NDArray[np.float64]) -> NDArray[np.float64]:
    headings = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    c, s = cos_sin(headings[:-1])
    x = np.cumsum(c * steps[:, 0] - s * steps[:, 1])
    y = np.cumsum(s * steps[:, 0] + c * steps[:, 1])
    return np.stack([np.concatenate([[0.0], x]), np.concatenate([[0.0], y]), wrap_angle(headings)], axis=1)


def _wander(white: NDArray[np.float64], std: float, rate: float) -> NDArray[np.float64]:
    """A Gauss-Markov sequence of standard deviation `std` that forgets itself at `rate` per sample."""
    keep = math.exp(-rate)
    values: list[float] = []
    value = 0.0
    for w in white.tolist():
        value = keep * value + math.sqrt(1 - keep**2) * std * w
        values.append(value)
    return np.array(values)


class _Operator:
    """The robot's motion, tick by tick, and the person who steers it."""

    def __init__(self, start: tuple[float, float, float], driving: Driving, rng: np.random.Generator) -> None:
        self.trace = array("d", start)
        self._x, self._y, self._heading = start
        self._speed = self._turn_rate = self._aim = 0.0
        self._driving = driving
        self._rng = rng
        self._forget = math.exp(-TICK / driving.steering_time)

    @property
    def time(self) -> float:
        """Since the start [s]."""
        return (len(self.trace) // 3 - 1) * TICK

    def go_to(self, goal: Waypoint, after: Waypoint | None) -> None:
        """Turn towards the goal on the spot if it lies aside, then drive there."""
        passing_speed = self._passing_speed(goal, after)
        patience = round(_PATIENCE / TICK)
        turning = False
        while (distance := math.hypot(goal.x - self._x, goal.y - self._y)) > _ARRIVED:
            aside = _wrapped(math.atan2(goal.y - self._y, goal.x - self._x) - self._heading)
            turning = abs(aside) > (_ALIGNED if turning else _TURN_ON_THE_SPOT)
            if turning:
                self._tick(0.0, self._turn_towards(aside) if abs(self._speed) < 0.05 else 0.0)
            else:
                braking = math.sqrt(passing_speed**2 + 2 * self._driving.acceleration * distance)
                fade = min(1.0, distance / 0.5)
                self._tick(min(self._driving.speed, braking), 2.0 * fade * (aside + self._wandering_aim()))
            patience -= 1
            if patience == 0:
                raise SimulatorError(f"the robot did not reach waypoint ({goal.x}, {goal.y}) within {_PATIENCE} s")

    def stand(self, duration: float) -> None:
        """Brake and stand still."""
        _check_time(self.time + duration)
        while duration > 0 and (self._speed or self._turn_rate):
            self._tick(0.0, 0.0)
        for _ in range(round(duration / TICK)):
            self._tick(0.0, 0.0)

    def _passing_speed(self, goal: Waypoint, after: Waypoint | None) -> float:
        if after is None or goal.pause > 0:
            return 0.05
        arriving = math.atan2(goal.y - self._y, goal.x - self._x)
        leaving = math.atan2(after.y - goal.y, after.x - goal.x)
        return self._driving.speed if abs(_wrapped(leaving - arriving)) < _TURN_ON_THE_SPOT else 0.05

    def _turn_towards(self, aside: float) -> float:
        braking = math.sqrt(2 * 0.7 * self._driving.turn_acceleration * abs(aside))
        return math.copysign(min(self._driving.turn_rate, braking), aside)

    def _wandering_aim(self) -> float:
        kick = self._driving.steering_std * math.sqrt(1 - self._forget**2)
        self._aim = self._forget * self._aim + kick * self._rng.standard_normal()
        return self._aim

    def _tick(self, speed: float, turn_rate: float) -> None:
        d = self._driving
        self._speed = _towards(self._speed, speed, d.acceleration * TICK)
        turn_rate = max(-d.turn_rate, min(d.turn_rate, turn_rate))
        self._turn_rate = _towards(self._turn_rate, turn_rate, d.turn_acceleration * TICK)
        middle = self._heading + self._turn_rate * TICK / 2
        self._x += self._speed * TICK * math.cos(middle)
        self._y += self._speed * TICK * math.sin(middle)
        self._heading += self._turn_rate * TICK
        self.trace.extend((self._x, self._y, self._heading))


def _check_time(time: float) -> None:
    if not time <= LIMITS.simulated_time:
        raise SimulatorError(f"found a drive of {time:.6g} s or more, expected {at_most('simulated_time')}")


def _towards(value: float, target: float, step: float) -> float:
    return min(target, value + step) if target > value else max(target, value - step)


def _wrapped(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)
