"""The turn rate of a gyro as odometry of the heading, in a log without any other.

Nobody needs to say how the gyro sits on the robot, nor in what unit, with what bias and how late it reports: a first
pass of matches without it tells. What they saw the robot turn is regressed on what the gyro reports, and the gyro
counts if that explains more than chance would, and foretells turns better than a constant velocity does.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from frontends.scan import Log
from graph.arrays import Floats, Ints
from graph.measurement import NoMatch
from graph.se2 import between, wrap_angle
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.config import FrontEndConfig
from iceg.slam.odometry.heading_odometry import HeadingNoise, HeadingOdometry, with_headings
from iceg.slam.odometry.noise import heading_noise, robust_deviation
from iceg.slam.odometry.student_fit import StudentFit, chance_of, student_fit
from iceg.slam.run_warning import RunWarning
from iceg.slam.track import Track

_DELAY_STEPS = (0.5, 0.1, 0.02)
"""Of the search for the delay [scans]: they get finer."""


@dataclass(frozen=True, slots=True, kw_only=True)
class GyroFinding:
    """What the matches of a log say of its gyro.

    Attributes:
        rejection: why it is not used; empty where it is.
        chance: how probable it is that it explains as much by chance.
        scale: (3,) radians that the robot turns per unit reported about each axis.
        bias: turn rate of the robot where the gyro reports none [rad/s], [rad/scan] in a log without times.
        delay: the gyro is read so much later than the scans [s], [scans] in a log without times; negative for earlier.
        deviation: what is left of the turn from one key scan to the next [rad].
        deviation_without: the same of a constant velocity [rad].
        has_times: whether the log has times.
    """

    rejection: str = ""
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
            return {"used": False, "reason": self.rejection}
        time = "s" if self.has_times else "scans"
        return {
            "used": not self.rejection,
            **({"reason": self.rejection} if self.rejection else {}),
            "chance": float(f"{self.chance:.2g}"),
            "rad_per_unit": [float(f"{scale:.6g}") for scale in self.scale],
            f"bias_rad_per_{time.removesuffix('s') or 's'}": round(self.bias, 6),
            f"delay_{time}": round(self.delay, 4),
            "turn_std_rad": round(self.deviation, 5),
            "turn_std_of_constant_velocity_rad": round(self.deviation_without, 5),
        }

    def warning(self) -> RunWarning | None:
        """A sentence where it is not used."""
        if not self.rejection:
            return None
        return RunWarning(kind="gyro", sentence=f"the turn rates of the gyro are not used: {self.rejection}")


def learn_gyro(track: Track, log: Log, settings: FrontEndConfig) -> tuple[HeadingOdometry | None, GyroFinding | None]:
    """Calibrate a log's gyro by the matches of a track.

    Args:
        track: the front end's matches, made with the gyro or without.
        log: with or without gyro.
        settings: whether a gyro is asked, and what it takes for it to count.

    Returns:
        The headings, None where they are not to be used; and what was found, None where the log has no gyro or need not
        ask it, since it has odometry.
    """
    if log.gyro is None or log.has_odometry or not settings.gyro:
        return None, None
    config = settings.calibration
    turns = _Turns.of(track)
    if len(turns.seen) < config.gyro_min_turns:
        return None, GyroFinding(
            rejection=f"only {len(turns.seen)} turns were seen by matches, expected {config.gyro_min_turns} or more"
        )
    if not log.gyro.any():
        return None, GyroFinding(rejection="they are all zero")
    fit, headings = _fitted(turns, log.gyro, *_clock(log), config)
    finding = replace(fit, deviation_without=robust_deviation(_unforeseen_turns(track, turns, config.velocity_scans)))
    finding = replace(finding, rejection=_rejection(finding, config.gyro_false_alarm))
    if finding.rejection:
        return None, finding
    noise, lasting = _noise(track, turns, headings, config)
    return HeadingOdometry(headings=headings, noise=noise, lasting_noise=lasting), finding


@dataclass(frozen=True, slots=True, kw_only=True)
class _Turns:
    """Turns from one key scan to the next, both of them matched.

    Attributes:
        seen: (n,) by the matches [rad].
        claimed: (n,) variances the matches claim [rad²].
        starts: (n,) scan at which each turn starts …
        ends: … and at which it ends.
    """

    seen: Floats
    claimed: Floats
    starts: Ints
    ends: Ints

    @classmethod
    def of(cls, track: Track) -> "_Turns":
        matches = {k: key.match for k, key in enumerate(track.keys) if k and not isinstance(key.match, NoMatch)}
        after = np.array([k for k in matches if k == 1 or k - 1 in matches], dtype=np.int64)
        headings = track.T_track_keys[:, 2]
        return cls(
            seen=wrap_angle(headings[after] - headings[after - 1]),
            claimed=np.array([matches[k].covariance[2, 2] for k in after.tolist()]),
            starts=track.key_scans[after - 1],
            ends=track.key_scans[after],
        )


def _rejection(finding: GyroFinding, false_alarm: float) -> str:
    if finding.chance > false_alarm:
        return (
            "they may have nothing to do with the turns that the scans show, which chance would explain as well with a "
            f"probability of {finding.chance:.2g}"
        )
    if finding.deviation > finding.deviation_without:
        return (
            f"they miss the turns that the scans show by {math.degrees(finding.deviation):.1f}°, a constant velocity "
            f"only by {math.degrees(finding.deviation_without):.1f}°"
        )
    return ""


def _clock(log: Log) -> tuple[Floats, float | None]:
    """(n,) times of the scans, and the usual one between two [s]; the scans numbered where stamps do not advance."""
    if (np.diff(log.stamps) > 0.0).all():
        return log.stamps - log.stamps[0], float(np.median(np.diff(log.stamps)))
    return np.arange(float(len(log))), None


def _over(turns: _Turns, values: Floats) -> Floats:
    """What (n_scans, …) values grow by over each turn."""
    return np.asarray(values[turns.ends] - values[turns.starts], dtype=np.float64)


def _read(gyro: Floats, clock: Floats, delay: float) -> Floats:
    """(n_scans, 3) of the gyro so much later."""
    return np.column_stack([np.interp(clock + delay, clock, gyro[:, axis]) for axis in range(3)])


def _fitted(
    turns: _Turns, gyro: Floats, clock: Floats, interval: float | None, config: CalibrationConfig
) -> tuple[GyroFinding, Floats]:
    """What explains the turns best, and (n_scans,) the headings by that.

    The axis that explains most comes first; a further one counts where it explains more than chance would.
    """
    passed, unit = _over(turns, clock), interval or 1.0

    def at_best_delay(axes: list[int]) -> tuple[float, StudentFit]:
        def at(shift: float) -> StudentFit:
            read = _over(turns, _read(gyro, clock, shift * unit)[:, axes])
            return student_fit(np.column_stack([passed, read]), turns.seen, config.gyro_freedom)

        return _likeliest(at, config.gyro_max_delay)

    without = student_fit(passed[:, None], turns.seen, config.gyro_freedom)
    telling, tries = np.flatnonzero(gyro.any(axis=0)).tolist(), round(config.gyro_max_delay / _DELAY_STEPS[0]) + 1
    alone = {axis: at_best_delay([axis]) for axis in telling}
    best = max(telling, key=lambda axis: alone[axis][1].log_likelihood)
    axes, (shift, fit) = [best], alone[best]
    chance = chance_of(without, fit, freedom=1, tried=len(telling) * tries, lags=config.persistence_lags)
    for axis in [axis for axis in telling if axis != best]:
        further_shift, further = at_best_delay([*axes, axis])
        chance_further = chance_of(fit, further, freedom=1, tried=len(telling), lags=config.persistence_lags)
        if chance_further < config.gyro_false_alarm:
            axes, shift, fit = [*axes, axis], further_shift, further
    delay = shift * unit
    bias, scale = float(fit.coefficients[0]), np.zeros(3)
    scale[axes] = fit.coefficients[1:]
    headings = (_read(gyro, clock, delay) * scale).sum(axis=1) + bias * clock
    finding = GyroFinding(
        chance=chance,
        scale=(float(scale[0]), float(scale[1]), float(scale[2])),
        bias=bias,
        delay=delay,
        deviation=robust_deviation(fit.residuals),
        has_times=interval is not None,
    )
    return finding, headings


def _likeliest(fit_at: Callable[[float], StudentFit], most: float) -> tuple[float, StudentFit]:
    """The shift, up to `most` [scans], whose fit explains most, and that."""
    shift, width, fit = 0.0, most, fit_at(0.0)
    for step in _DELAY_STEPS:
        n = round(width / step)
        tries = [(shift + step * k, fit_at(shift + step * k)) for k in range(-n, n + 1) if k]
        shift, fit = max([(shift, fit), *tries], key=lambda tried: tried[1].log_likelihood)
        width = step
    return shift, fit


def _unforeseen_turns(track: Track, turns: _Turns, scans: int) -> Floats:
    """(m,) turns less those of the velocity over so many scans before them [rad]."""
    headings = track.T_track_scans[:, 2]
    late = turns.starts >= scans
    starts, ends = turns.starts[late], turns.ends[late]
    velocity = wrap_angle(headings[starts] - headings[starts - scans]) / scans
    return np.asarray(wrap_angle(turns.seen[late] - velocity * (ends - starts)), dtype=np.float64)


def _noise(
    track: Track, turns: _Turns, headings: Floats, config: CalibrationConfig
) -> tuple[HeadingNoise, HeadingNoise]:
    """From one key scan to the next, and for a graph."""
    claims = with_headings(track, headings)
    errors = wrap_angle(turns.seen - between(claims[turns.starts], claims[turns.ends])[:, 2])
    deviations, persistence = heading_noise(errors, turns.claimed, turns.starts, turns.ends, claims, config)
    widened = {name: math.sqrt(persistence) * deviation for name, deviation in deviations.items()}
    return HeadingNoise(**deviations), HeadingNoise(**widened)
