"""The turn rate of a gyro as odometry of the heading, in a log without any other.

Nobody needs to say how the gyro sits on the robot, nor in what unit, with what bias and how late it reports: a first
pass of matches without it tells. What they saw the robot turn is regressed on what the gyro reports, and the gyro
counts if that explains more than chance would, and foretells turns better than a constant velocity does.
"""

import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from frontends.scan import Log
from graph.measurement import NoMatch
from graph.odometry import OdometryModel
from graph.se2 import between, expmap, logmap, wrap_angle
from iceg.slam.odometry.noise import Differences, heading_noise, robust_deviation
from iceg.slam.odometry.steps import chained
from iceg.slam.odometry.student_fit import StudentFit, chance_of, student_fit
from iceg.slam.run_warning import RunWarning
from iceg.slam.sweep.motion import usual_interval
from iceg.slam.tracking.track import Track

_LEVEL = 1e-4
"""A gyro counts, and so does a further axis of it, where chance explains as much less often than this."""
_FEWEST = 10
"""Fewest turns between matched key scans that tell anything: four coefficients and their scatter."""
_MOST_DELAY = 3.0
"""A delay is looked for up to so many scans …"""
_DELAY_STEPS = (0.25, 0.05, 0.01)
"""… in steps [scans] that get finer."""
_NEARLY_ALL, _NEARLY_ALL_SIGMAS = 0.99, 3.0
"""Nearly all steps are this share, and lie within so many standard deviations."""
_BEFORE = 5
"""Scans whose motion tells a constant velocity."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroFinding:
    """What the matches of a log say of its gyro.

    Attributes:
        doubt: why it is not used; empty where it is.
        chance: how probable it is that it explains as much by chance.
        scale: (3,) radians that the robot turns per unit reported about each axis.
        bias: turn rate of the robot where the gyro reports none [rad/s], [rad/scan] in a log without times.
        delay: the gyro is read so much later than the scans [s], [scans] in a log without times; negative for earlier.
        deviation: what is left of the turn from one key scan to the next [rad].
        deviation_without: the same of a constant velocity [rad].
        has_times: whether the log has times.
    """

    doubt: str = ""
    chance: float = 1.0
    scale: tuple[float, float, float] = (0.0, 0.0, 0.0)
    bias: float = 0.0
    delay: float = 0.0
    deviation: float = math.nan
    deviation_without: float = math.nan
    has_times: bool = True

    def record(self) -> dict[str, Any]:
        """For `summary.json`."""
        if math.isnan(self.deviation):
            return {"used": False, "reason": self.doubt}
        time = "s" if self.has_times else "scans"
        return {
            "used": not self.doubt,
            **({"reason": self.doubt} if self.doubt else {}),
            "chance": float(f"{self.chance:.2g}"),
            "rad_per_unit": [float(f"{scale:.6g}") for scale in self.scale],
            f"bias_rad_per_{time.removesuffix('s') or 's'}": round(self.bias, 6),
            f"delay_{time}": round(self.delay, 4),
            "turn_std_rad": round(self.deviation, 5),
            "turn_std_of_constant_velocity_rad": round(self.deviation_without, 5),
        }

    def warning(self) -> RunWarning | None:
        """A sentence where it is not used."""
        if not self.doubt:
            return None
        return RunWarning(kind="gyro", sentence=f"the turn rates of the gyro are not used: {self.doubt}")


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingNoise:
    """Noise of turns, whatever moves the robot ahead; the names are those of `OdometryModel`."""

    heading_floor: float
    heading_per_metre: float
    heading_per_radian: float

    def within(self, model: OdometryModel) -> OdometryModel:
        """The model of a motion whose turns are known so well."""
        return replace(model, **asdict(self))


@dataclass(frozen=True, slots=True, kw_only=True)
class HeadingOdometry:
    """Headings that take the place of odometry's, which says nothing of translation.

    Attributes:
        headings: (n_scans,) at the scans, all turns counted, from 0 [rad].
        noise: of its turns from one key scan to the next.
        lasting_noise: the same for a graph, see `OdometryCalibration`.
        unforeseen: nearly all steps from scan to scan end nearer than this to where a constant velocity ends [m].
    """

    headings: NDArray[np.float64]
    noise: HeadingNoise
    lasting_noise: HeadingNoise
    unforeseen: float

    def step_noise(self, model: OdometryModel) -> OdometryModel:
        """The model of a motion at constant velocity, on the arcs of the turns, at least as wide as steps demand."""
        floor = self.unforeseen / _NEARLY_ALL_SIGMAS
        return replace(
            self.noise.within(model),
            along_floor=max(model.along_floor, floor),
            across_floor=max(model.across_floor, floor),
        )


def learn_gyro(track: Track, log: Log) -> tuple[HeadingOdometry | None, GyroFinding | None]:
    """Calibrate a log's gyro by the matches of a track.

    Args:
        track: the front end's matches, made with the gyro or without.
        log: with or without gyro.

    Returns:
        The headings, None where they are not to be used; and what was found, None where the log has no gyro or need not
        ask it, since it has odometry.
    """
    if log.gyro is None or log.has_odometry:
        return None, None
    turns = _Turns.of(track)
    if len(turns.seen) < _FEWEST:
        return None, GyroFinding(doubt=f"only {len(turns.seen)} turns were seen by matches, expected {_FEWEST} or more")
    clock, interval = _clock(log)
    spent = _over(turns, clock)[:, None]
    without = student_fit(spent, turns.seen)
    axes, fit, delay, chance = _fitted(turns, log.gyro, clock, interval, without)
    scale = np.zeros(3)
    scale[axes] = fit.coefficients[1:]
    headings = _read(log.gyro, clock, delay)[:, axes]
    headings = (headings * fit.coefficients[1:]).sum(axis=1) + fit.coefficients[0] * (clock - clock[0])
    left, usual = robust_deviation(fit.residuals), robust_deviation(_unforeseen_turns(track, turns))
    finding = GyroFinding(
        doubt=_doubt(chance, left, usual),
        chance=chance,
        scale=(float(scale[0]), float(scale[1]), float(scale[2])),
        bias=float(fit.coefficients[0]),
        delay=delay,
        deviation=left,
        deviation_without=usual,
        has_times=interval is not None,
    )
    if finding.doubt:
        return None, finding
    noise, lasting = _noise(track, turns, headings)
    heading = HeadingOdometry(
        headings=headings, noise=noise, lasting_noise=lasting, unforeseen=_unforeseen_steps(track, headings)
    )
    return heading, finding


def with_headings(track: Track, headings: NDArray[np.float64]) -> NDArray[np.float64]:
    """The way of a track if it had turned otherwise.

    Args:
        track: what the front end found.
        headings: (n_scans,) [rad].

    Returns:
        (n_scans, 3): from scan to scan as far ahead and aside as the track, on the arc of the other turn.
    """
    poses = track.trajectory(np.array([key.T_track_robot for key in track.keys]))
    twists = logmap(between(poses[:-1], poses[1:]))
    twists[:, 2] = np.diff(headings)
    return chained(poses[0], expmap(twists))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Turns:
    """Turns from one key scan to the next, both of them matched.

    Attributes:
        seen: (n,) by the matches [rad].
        claimed: (n,) variances the matches claim [rad²].
        starts: (n,) scan at which each turn starts …
        ends: … and at which it ends.
    """

    seen: NDArray[np.float64]
    claimed: NDArray[np.float64]
    starts: NDArray[np.int64]
    ends: NDArray[np.int64]

    @classmethod
    def of(cls, track: Track) -> "_Turns":
        pairs = [
            (before, after, after.match)
            for k, (before, after) in enumerate(zip(track.keys, track.keys[1:], strict=False))
            if not isinstance(after.match, NoMatch) and (k == 0 or not isinstance(before.match, NoMatch))
        ]
        seen = [after.T_track_robot[2] - before.T_track_robot[2] for before, after, _ in pairs]
        return cls(
            seen=np.asarray(wrap_angle(np.array(seen, dtype=np.float64))),
            claimed=np.array([match.covariance[2, 2] for _, _, match in pairs]),
            starts=np.array([before.index for before, _, _ in pairs], dtype=np.int64),
            ends=np.array([after.index for _, after, _ in pairs], dtype=np.int64),
        )


def _doubt(chance: float, left: float, usual: float) -> str:
    if chance > _LEVEL:
        return (
            f"the turns that the scans show may have nothing to do with them (by chance with probability {chance:.2g})"
        )
    if left > usual:
        return (
            f"they miss the turns that the scans show by {math.degrees(left):.1f}°, a constant velocity only by "
            f"{math.degrees(usual):.1f}°"
        )
    return ""


def _clock(log: Log) -> tuple[NDArray[np.float64], float | None]:
    """(n,) times of the scans, and the usual one between two [s]; the scans numbered where stamps do not advance."""
    if (np.diff(log.stamps) > 0.0).all():
        return log.stamps - log.stamps[0], usual_interval(log.stamps)
    return np.arange(float(len(log))), None


def _over(turns: _Turns, values: NDArray[np.float64]) -> NDArray[np.float64]:
    """What (n_scans, …) values grow by over each turn."""
    return np.asarray(values[turns.ends] - values[turns.starts], dtype=np.float64)


def _read(gyro: NDArray[np.float64], clock: NDArray[np.float64], delay: float) -> NDArray[np.float64]:
    """(n_scans, 3) of the gyro so much later."""
    return np.column_stack([np.interp(clock + delay, clock, gyro[:, axis]) for axis in range(3)])


def _fitted(
    turns: _Turns,
    gyro: NDArray[np.float64],
    clock: NDArray[np.float64],
    interval: float | None,
    without: StudentFit,
) -> tuple[list[int], StudentFit, float, float]:
    """The axes that count, the fit to them (first the bias), the delay, and how probable it is by chance.

    The axis that explains most comes first; a further one counts where it explains more than chance would.
    """
    best: tuple[list[int], StudentFit, float] | None = None
    for axis in range(3):
        delay, fit, tried = _at_best_delay(turns, gyro, clock, interval or 1.0, [axis])
        if best is None or fit.log_likelihood > best[1].log_likelihood:
            best = [axis], fit, delay
    assert best is not None
    axes, fit, delay = best
    chance = chance_of(without, fit, freedom=1, tried=3 * tried)
    for axis in [axis for axis in range(3) if axis not in axes]:
        further_delay, further, _ = _at_best_delay(turns, gyro, clock, interval or 1.0, [*axes, axis])
        if chance_of(fit, further, freedom=1, tried=3) < _LEVEL:
            axes, fit, delay = [*axes, axis], further, further_delay
    return axes, fit, delay, chance


def _at_best_delay(
    turns: _Turns, gyro: NDArray[np.float64], clock: NDArray[np.float64], interval: float, axes: list[int]
) -> tuple[float, StudentFit, int]:
    """The delay that explains most, the fit there, and how many independent ones were tried."""

    def at(shift: float) -> StudentFit:
        read = _over(turns, _read(gyro, clock, shift * interval)[:, axes])
        return student_fit(np.column_stack([_over(turns, clock), read]), turns.seen)

    shift, width = 0.0, _MOST_DELAY
    fit = at(shift)
    for step in _DELAY_STEPS:
        n = round(width / step)
        tries = [(shift + step * k, at(shift + step * k)) for k in range(-n, n + 1) if k]
        shift, fit = max([(shift, fit), *tries], key=lambda tried: tried[1].log_likelihood)
        width = step
    return shift * interval, fit, round(2.0 * _MOST_DELAY) + 1


def _unforeseen_steps(track: Track, headings: NDArray[np.float64]) -> float:
    """How far nearly all steps end from where the step before would, on the arc of the turn [m]."""
    poses = track.trajectory(np.array([key.T_track_robot for key in track.keys]))
    steps = between(poses[:-1], poses[1:])
    expected = logmap(steps[:-1])
    expected[:, 2] = np.diff(headings)[1:]
    apart = steps[1:, :2] - expmap(expected)[:, :2]
    return float(np.quantile(np.hypot(apart[:, 0], apart[:, 1]), _NEARLY_ALL))


def _unforeseen_turns(track: Track, turns: _Turns) -> NDArray[np.float64]:
    """(m,) turns less those of the velocity before them [rad]."""
    headings = track.trajectory(np.array([key.T_track_robot for key in track.keys]))[:, 2]
    late = turns.starts >= _BEFORE
    starts, ends = turns.starts[late], turns.ends[late]
    velocity = wrap_angle(headings[starts] - headings[starts - _BEFORE]) / _BEFORE
    return np.asarray(wrap_angle(turns.seen[late] - velocity * (ends - starts)), dtype=np.float64)


def _noise(track: Track, turns: _Turns, headings: NDArray[np.float64]) -> tuple[HeadingNoise, HeadingNoise]:
    """From one key scan to the next, and for a graph."""
    claims = with_headings(track, headings)
    motions = between(claims[turns.starts], claims[turns.ends])
    errors = np.zeros((len(turns.seen), 3))
    errors[:, 2] = wrap_angle(turns.seen - motions[:, 2])
    claimed = np.zeros_like(errors)
    claimed[:, 2] = turns.claimed
    differences = Differences(errors=errors, claimed=claimed, turns=turns.seen, starts=turns.starts, ends=turns.ends)
    deviations, persistence = heading_noise(differences, claims)
    widened = {name: math.sqrt(persistence) * deviation for name, deviation in deviations.items()}
    return HeadingNoise(**deviations), HeadingNoise(**widened)
