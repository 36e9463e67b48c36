"""Recorded logs made worse on purpose: what other robots, lasers and recorders do to a log, one fault at a time."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray

from frontends.logs.plausibility import judge_odometry
from frontends.scan import Log, ScanGeometry
from graph.elementary import arctan2, cos_sin
from graph.se2 import between, compose, transform_points, wrap_angle

_SEED = 0
_JUMPS = 3
_CLOCK_JUMP = 3600.0  # s
_BODY = 0.2  # m, half of its width
_POSTS, _POST_RANGE, _POST_HALF = 4, 0.28, np.radians(3.0)  # m, rad
_LEG = 0.07  # m, half of its width
_GRAZED = 0.3
"""Share of its scans in which a beam that grazes a post returns from it."""
_VISIT = (25, 150)  # scans
_BLIND_SECONDS, _GAP_SECONDS, _CARRIED_SECONDS, _STOP_SCANS = 10.0, 10.0, 60.0, 1000


@dataclass(frozen=True, slots=True, kw_only=True)
class Degraded:
    """A log made worse.

    Attributes:
        log: what is left of it.
        scans: (n,) which scan of the log before each of its scans is.
    """

    log: Log
    scans: NDArray[np.int64]


Degradation = Callable[[Log], Degraded]


def select(log: Log, scans: NDArray[np.int64]) -> Degraded:
    """Only these scans, (n,) indices, in this order; a scan may come more than once."""
    return Degraded(log=log.select(scans), scans=scans)


def every(log: Log, n: int) -> Degraded:
    """Every n-th scan."""
    return select(log, np.arange(0, len(log), n))


def every_metre(log: Log, distance: float = 1.0, turn: float = np.inf) -> Degraded:
    """A scan once the odometry has moved so far from the last one kept [m], or turned [rad]."""
    kept = [0]
    for index, pose in enumerate(log.odometry):
        x, y, heading = between(log.odometry[kept[-1]], pose)
        if np.hypot(x, y) >= distance or abs(heading) >= turn:
            kept.append(index)
    return select(log, np.array(kept))


def clipped(log: Log, reach: float) -> Degraded:
    """A laser that sees no farther than `reach` [m]."""
    ranges = np.where(log.ranges <= reach, log.ranges, np.float32(np.nan))
    geometry = replace(log.geometry, range_max=min(reach, log.geometry.range_max))
    return _with_ranges(replace(log, geometry=geometry), ranges)


def every_beam(log: Log, n: int) -> Degraded:
    """Every n-th beam."""
    return _with_beams(log, slice(0, None, n))


def narrow(log: Log, view: float) -> Degraded:
    """Only the beams within a field of view of `view` around straight ahead [rad]."""
    inside = np.abs(log.geometry.bearings) <= 0.5 * view
    return _with_beams(log, slice(int(np.argmax(inside)), int(len(inside) - np.argmax(inside[::-1]))))


def missing_beams(log: Log, share: float) -> Degraded:
    """A share of the readings lost at random."""
    lost = _rng().random(log.ranges.shape) < share
    return _with_ranges(log, np.where(lost, np.float32(np.nan), log.ranges))


def half_hidden(log: Log) -> Degraded:
    """Something on the robot hides one half of the view."""
    ranges = log.ranges.copy()
    ranges[:, : ranges.shape[1] // 2] = np.nan
    return _with_ranges(log, ranges)


def noisy(log: Log, deviation: float, outliers: float = 0.0) -> Degraded:
    """Ranges with noise of `deviation` [m], and a share of them that end anywhere before."""
    rng = _rng()
    ranges = log.ranges + rng.normal(0.0, deviation, log.ranges.shape)
    short = rng.random(log.ranges.shape) < outliers
    ranges = np.where(short, log.ranges * rng.random(log.ranges.shape), ranges)
    return _with_ranges(log, np.maximum(ranges, log.geometry.range_min).astype(np.float32))


def crowd(log: Log, people: int) -> Degraded:
    """So many visitors within a few metres at any time, who stand or stroll and hide what is behind them."""
    rng, ranges = _rng(), log.ranges.copy()
    T_odom_laser = compose(log.odometry, log.geometry.T_robot_laser)
    for _ in range(people):
        since = 0
        while since < len(log):
            scans = np.arange(since, min(len(log), since + int(rng.integers(*_VISIT))))
            start = transform_points(T_odom_laser[since], rng.uniform((0.5, -3.0), (4.0, 3.0)))
            stroll = rng.uniform(-0.1, 0.1, 2) * rng.integers(0, 2)
            _stand_before(log, ranges, T_odom_laser, scans, start + np.outer(scans - since, stroll))
            since = int(scans[-1]) + 1
    return _with_ranges(log, ranges)


def covered(log: Log, reading: float) -> Degraded:
    """Something covers the laser for ten seconds in the middle of the log."""
    ranges = log.ranges.copy()
    middle = len(log) // 2
    ranges[middle : middle + _scans_in(log, _BLIND_SECONDS)] = reading
    return _with_ranges(log, ranges)


def frozen(log: Log) -> Degraded:
    """The laser repeats one scan for ten seconds in the middle while the robot drives on."""
    ranges = log.ranges.copy()
    middle = len(log) // 2
    ranges[middle : middle + _scans_in(log, _BLIND_SECONDS)] = ranges[middle]
    return _with_ranges(log, ranges)


def posts(log: Log) -> Degraded:
    """Four posts of the robot stand 28 cm from the laser, each 6° wide."""
    ranges, bearings, rng = log.ranges.copy(), log.geometry.bearings, _rng()
    for bearing in np.linspace(bearings[0], bearings[-1], _POSTS + 2)[1:-1]:
        off = np.abs(bearings - bearing)
        for beams, share in ((off < _POST_HALF, 1.0), (np.abs(off - _POST_HALF) < log.geometry.resolution, _GRAZED)):
            shape = (len(log), int(beams.sum()))
            hit, seen = rng.random(shape) < share, _POST_RANGE + rng.normal(0.0, 0.005, shape)
            ranges[:, beams] = np.where(hit, seen.astype(np.float32), ranges[:, beams])
    return _with_ranges(log, ranges)


def cover(log: Log) -> Degraded:
    """The robot's own cover, 25 to 35 cm from the laser, takes 15 % of the view on either side."""
    ranges, n_beams = log.ranges.copy(), log.geometry.n_beams
    beams = np.flatnonzero(np.abs(np.arange(n_beams) - 0.5 * (n_beams - 1)) > 0.35 * n_beams)
    seen = 0.3 + 0.05 * cos_sin(3.0 * log.geometry.bearings[beams])[0]
    ranges[:, beams] = seen + _rng().normal(0.0, 0.008, (len(log), len(beams)))
    return _with_ranges(log, ranges)


def hands(log: Log) -> Degraded:
    """Hands around the laser, 8 to 13 cm from it, take half of the view for ten seconds in the middle."""
    ranges, middle, n_beams = log.ranges.copy(), len(log) // 2, log.geometry.n_beams
    scans = ranges[middle : middle + _scans_in(log, _BLIND_SECONDS)]
    for beams in (slice(0, n_beams // 4), slice(n_beams - n_beams // 4, n_beams)):
        scans[:, beams] = _rng().uniform(0.08, 0.13, scans[:, beams].shape)
    return _with_ranges(log, ranges)


def companion(log: Log) -> Degraded:
    """Somebody walks ahead of the robot all the way, some 1.2 m from its laser, a leg before the other."""
    scan = np.arange(len(log))
    sway, gait = cos_sin(scan / 40.0)[1], cos_sin(scan / 4.0)[1]
    ranges, bearings = log.ranges.copy(), log.geometry.bearings
    for side in (-1.0, 1.0):
        x, y = 1.2 + 0.2 * sway + 0.25 * side * gait, 0.3 + 0.2 * cos_sin(scan / 25.0)[0] + 0.12 * side
        far = np.sqrt(x * x + y * y)
        off = np.abs(bearings - arctan2(y, x)[:, None])
        hidden = off < (_LEG / far)[:, None]
        ranges = np.where(hidden, np.fmin(ranges, (far - _LEG)[:, None].astype(np.float32)), ranges)
    return _with_ranges(log, ranges)


def laser_backwards(log: Log) -> Degraded:
    """A laser that looks backwards, and a log that does not say so."""
    return _with_odometry(log, compose(log.odometry, np.array([0.0, 0.0, np.pi])))


def laser_upside_down(log: Log) -> Degraded:
    """A laser that is mounted upside down, and a log that does not say so."""
    return _with_ranges(log, np.ascontiguousarray(log.ranges[:, ::-1]))


def laser_stuck(log: Log, n: int) -> Degraded:
    """A laser that is read anew only at every n-th scan."""
    return _with_ranges(log, log.ranges[np.arange(len(log)) // n * n])


def gap(log: Log) -> Degraded:
    """The recorder stops for ten seconds in the middle while the robot drives on."""
    middle, length = len(log) // 2, _scans_in(log, _GAP_SECONDS)
    return select(log, np.concatenate([np.arange(middle), np.arange(middle + length, len(log))]))


def stop(log: Log) -> Degraded:
    """The robot stands for a thousand scans in the middle."""
    middle = len(log) // 2
    still = select(log, np.concatenate([np.arange(middle), np.full(_STOP_SCANS, middle), np.arange(middle, len(log))]))
    noise = _rng().normal(0.0, 0.005, (_STOP_SCANS, log.ranges.shape[1])).astype(np.float32)
    ranges = still.log.ranges.copy()
    ranges[middle : middle + _STOP_SCANS] += noise
    return Degraded(log=replace(still.log, ranges=ranges), scans=still.scans)


def carried(log: Log) -> Degraded:
    """Somebody carries the robot for a minute of its way in the middle, and nothing is recorded of it."""
    middle, length = len(log) // 2, min(_scans_in(log, _CARRIED_SECONDS), len(log) // 4)
    left = select(log, np.concatenate([np.arange(middle), np.arange(middle + length, len(log))]))
    odometry, stamps = left.log.odometry.copy(), left.log.stamps.copy()
    odometry[middle:] = compose(odometry[middle - 1], between(odometry[middle], odometry[middle:]))
    stamps[middle:] -= stamps[middle] - stamps[middle - 1]
    return Degraded(log=replace(left.log, odometry=odometry, stamps=stamps), scans=left.scans)


def every_scan_twice(log: Log) -> Degraded:
    """The recorder writes every line twice."""
    return select(log, np.repeat(np.arange(len(log)), 2))


def odometry_scaled(log: Log, move: float = 1.0, turn: float = 1.0) -> Degraded:
    """Wheels that report so many times the distance and the turn."""
    return _with_steps(log, lambda steps: steps * (move, move, turn))


def odometry_drifting(log: Log, per_metre: float) -> Degraded:
    """A heading that drifts [rad/m]."""
    return _with_steps(log, lambda steps: steps + np.outer(np.hypot(steps[:, 0], steps[:, 1]), (0.0, 0.0, per_metre)))


def odometry_noisy(log: Log, move: float, turn: float) -> Degraded:
    """Steps with noise in proportion to their own length and turn."""

    def disturbed(steps: NDArray[np.float64]) -> NDArray[np.float64]:
        noise, length = _rng().normal(size=steps.shape), np.hypot(steps[:, 0], steps[:, 1])
        return steps + noise * np.column_stack([move * length, move * length, turn * (np.abs(steps[:, 2]) + length)])

    return _with_steps(log, disturbed)


def odometry_jumps(log: Log, jump: tuple[float, float, float], times: int = _JUMPS) -> Degraded:
    """The odometry jumps by this pose [m, m, rad] several times, to one side and the other."""

    def jumping(steps: NDArray[np.float64]) -> NDArray[np.float64]:
        for k in range(times):
            at = (k + 1) * len(steps) // (times + 1)
            steps[at] = compose(steps[at], np.array(jump) * (-1.0) ** k)
        return steps

    return _with_steps(log, jumping)


def odometry_reset(log: Log) -> Degraded:
    """The odometry starts again at zero in the middle."""
    odometry, middle = log.odometry.copy(), len(log) // 2
    odometry[middle:] = between(odometry[middle], odometry[middle:])
    return _with_odometry(log, odometry)


def odometry_stuck(log: Log, n: int) -> Degraded:
    """An odometry that is read anew only at every n-th scan."""
    return _with_odometry(log, log.odometry[np.arange(len(log)) // n * n])


def odometry_late(log: Log, n: int) -> Degraded:
    """An odometry that comes n scans late."""
    return _with_odometry(log, log.odometry[np.maximum(np.arange(len(log)) - n, 0)])


def odometry_rounded(log: Log, move: float, turn: float) -> Degraded:
    """An odometry printed with few digits: whole multiples of these [m, rad]."""
    unit = np.array([move, move, turn])
    odometry = np.round(log.odometry / unit) * unit
    odometry[:, 2] = wrap_angle(odometry[:, 2])
    return _with_odometry(log, odometry)


def odometry_missing(log: Log) -> Degraded:
    """Zeros for odometry."""
    return _with_odometry(log, np.zeros_like(log.odometry))


def odometry_dies(log: Log) -> Degraded:
    """An odometry that stops counting in the middle."""
    return _with_odometry(log, log.odometry[np.minimum(np.arange(len(log)), len(log) // 2)])


def stamps_shuffled(log: Log) -> Degraded:
    """Stamps that say nothing about the order."""
    return _with_stamps(log, _rng().permutation(log.stamps))


def stamps_reversed(log: Log) -> Degraded:
    """A clock that runs backwards."""
    return _with_stamps(log, log.stamps[::-1].copy())


def clock_jumps(log: Log) -> Degraded:
    """A clock that is put forward and back by an hour, in turn."""
    is_ahead = np.arange(len(log)) * (_JUMPS + 1) // len(log) % 2 == 1
    return _with_stamps(log, log.stamps + np.where(is_ahead, _CLOCK_JUMP, 0.0))


def together(log: Log, faults: tuple[Degradation, ...]) -> Degraded:
    """Several faults, one after the other."""
    worse = Degraded(log=log, scans=np.arange(len(log)))
    for fault in faults:
        more = fault(worse.log)
        worse = Degraded(log=more.log, scans=worse.scans[more.scans])
    return worse


DEGRADATIONS: Mapping[str, Degradation] = MappingProxyType(
    {
        "every 2nd scan": partial(every, n=2),
        "every 3rd scan": partial(every, n=3),
        "every 5th scan": partial(every, n=5),
        "every 10th scan": partial(every, n=10),
        "every 20th scan": partial(every, n=20),
        "a scan every metre": every_metre,
        "a scan every 10°": partial(every_metre, turn=np.radians(10.0)),
        "30 m": partial(clipped, reach=30.0),
        "8 m": partial(clipped, reach=8.0),
        "4 m": partial(clipped, reach=4.0),
        "every 2nd beam": partial(every_beam, n=2),
        "every 4th beam": partial(every_beam, n=4),
        "90° view": partial(narrow, view=np.radians(90.0)),
        "half the readings": partial(missing_beams, share=0.5),
        "half the view": half_hidden,
        "noise 3 cm": partial(noisy, deviation=0.03),
        "noise 5 cm, 10 % outliers": partial(noisy, deviation=0.05, outliers=0.1),
        "crowd of 4": partial(crowd, people=4),
        "crowd of 10": partial(crowd, people=10),
        "covered": partial(covered, reading=0.1),
        "blind": partial(covered, reading=np.nan),
        "frozen": frozen,
        "laser backwards": laser_backwards,
        "laser upside down": laser_upside_down,
        "laser stuck 2": partial(laser_stuck, n=2),
        "laser stuck 5": partial(laser_stuck, n=5),
        "gap": gap,
        "stop": stop,
        "carried": carried,
        "twice": every_scan_twice,
        "distance 5 %": partial(odometry_scaled, move=1.05),
        "distance 20 %": partial(odometry_scaled, move=1.2),
        "turn 5 %": partial(odometry_scaled, turn=1.05),
        "turn 20 %": partial(odometry_scaled, turn=0.8),
        "drift 1°/m": partial(odometry_drifting, per_metre=np.radians(1.0)),
        "drift 5°/m": partial(odometry_drifting, per_metre=np.radians(5.0)),
        "odometry noise 50 %": partial(odometry_noisy, move=0.5, turn=0.5),
        "jumps 30°": partial(odometry_jumps, jump=(0.0, 0.0, np.radians(30.0))),
        "ten jumps 30°": partial(odometry_jumps, jump=(0.0, 0.0, np.radians(30.0)), times=10),
        "jumps 1 m 60°": partial(odometry_jumps, jump=(1.0, 0.0, np.radians(60.0))),
        "jumps 10 m": partial(odometry_jumps, jump=(10.0, 3.0, 0.0)),
        "reset": odometry_reset,
        "odometry stuck 5": partial(odometry_stuck, n=5),
        "odometry late 3": partial(odometry_late, n=3),
        "odometry rounded": partial(odometry_rounded, move=0.1, turn=np.radians(5.0)),
        "no odometry": odometry_missing,
        "odometry dies": odometry_dies,
        "stamps": stamps_shuffled,
        "stamps reversed": stamps_reversed,
        "clock jumps": clock_jumps,
        "gap + stamps": partial(together, faults=(gap, stamps_shuffled)),
        "covered + reset": partial(together, faults=(partial(covered, reading=0.1), odometry_reset)),
        "half the view + ten jumps 30°": partial(
            together, faults=(half_hidden, partial(odometry_jumps, jump=(0.0, 0.0, np.radians(30.0)), times=10))
        ),
        "odometry dies + covered": partial(together, faults=(odometry_dies, partial(covered, reading=0.1))),
        "odometry dies + crowd of 4": partial(together, faults=(partial(crowd, people=4), odometry_dies)),
        "odometry stuck 5 + noise 3 cm": partial(
            together, faults=(partial(odometry_stuck, n=5), partial(noisy, deviation=0.03))
        ),
        "distance 20 % + turn 20 % + half the readings": partial(
            together,
            faults=(partial(odometry_scaled, move=1.2, turn=0.8), partial(missing_beams, share=0.5)),
        ),
        "every 5th scan + reset": partial(together, faults=(partial(every, n=5), odometry_reset)),
        "posts": posts,
        "cover": cover,
        "hands": hands,
        "companion": companion,
        "cover + no odometry": partial(together, faults=(cover, odometry_missing)),
    }
)
"""Every fault by its name."""


def _stand_before(
    log: Log,
    ranges: NDArray[np.float32],
    T_odom_laser: NDArray[np.float64],
    scans: NDArray[np.int64],
    places: NDArray[np.float64],
) -> None:
    """Let somebody at these places, (n, 2) one for each of the scans, end the beams in `ranges`."""
    x, y, _ = between(T_odom_laser[scans], np.column_stack([places, np.zeros(len(scans))])).T
    far, towards = np.hypot(x, y), arctan2(y, x)
    width = arctan2(_BODY, far)
    for scan, distance, bearing, half in zip(scans, far, towards, width, strict=True):
        hidden = np.abs(wrap_angle(log.geometry.bearings - bearing)) < half
        ranges[scan, hidden] = np.fmin(ranges[scan, hidden], np.float32(max(distance - _BODY, 0.3)))


def _rng() -> np.random.Generator:
    return np.random.default_rng(_SEED)


def _with_ranges(log: Log, ranges: NDArray[np.float32]) -> Degraded:
    return Degraded(log=replace(log, ranges=ranges), scans=np.arange(len(log)))


def _with_stamps(log: Log, stamps: NDArray[np.float64]) -> Degraded:
    return Degraded(log=replace(log, stamps=stamps), scans=np.arange(len(log)))


def _with_beams(log: Log, beams: slice) -> Degraded:
    geometry: ScanGeometry = replace(log.geometry, bearings=log.geometry.bearings[beams])
    ranges = np.ascontiguousarray(log.ranges[:, beams])
    return Degraded(log=replace(log, geometry=geometry, ranges=ranges), scans=np.arange(len(log)))


def _with_odometry(log: Log, odometry: NDArray[np.float64]) -> Degraded:
    has_odometry, warnings = judge_odometry(odometry, log.ranges, log.stamps)
    bad = replace(log, odometry=odometry, has_odometry=has_odometry, warnings=(*log.warnings, *warnings))
    return Degraded(log=bad, scans=np.arange(len(log)))


def _with_steps(log: Log, change: Callable[[NDArray[np.float64]], NDArray[np.float64]]) -> Degraded:
    odometry = [log.odometry[0]]
    for step in change(between(log.odometry[:-1], log.odometry[1:])):
        odometry.append(compose(odometry[-1], step))
    return _with_odometry(log, np.array(odometry))


def _scans_in(log: Log, seconds: float) -> int:
    """How many scans the log takes in so many seconds, whatever single stamps say."""
    duration = float(np.ptp(log.stamps))
    return max(1, round(seconds * len(log) / duration)) if duration > 0 else 1
