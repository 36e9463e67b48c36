"""Returns of the robot itself: posts, covers and cables in the view of its own laser.

They move with the robot, so they tell the matcher that nothing moves, and draw an object wherever the robot was. What
gives them away is that the range of a beam stays the same while the surroundings change, and that what is seen beside
them is farther away by a leap, always on the same bearing: along a wall the range stays the same, too, as long as the
robot follows it, but it has no end that goes along.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from frontends.scan import Log, ScanGeometry
from graph.arrays import Bools, Float32s, Floats, Ints
from iceg.slam.own_body_config import OwnBodyConfig

_SCANS = 1000
"""Most scans that are asked, spread over the log."""


def without_own_body(log: Log, config: OwnBodyConfig) -> Log:
    """The same log; where it sees the robot itself, or somebody holds the robot, with nothing seen and a warning."""
    limits, held = own_limits(log.ranges, log.geometry, config), intervals_in_hands(log.ranges, config)
    ranges = beyond(log.ranges, limits)
    for first, last in held:
        ranges[first : last + 1] = np.nan
    if (np.isnan(ranges) == np.isnan(log.ranges)).all():
        return log
    return replace(log, ranges=ranges, warnings=(*log.warnings, *_warnings(limits, held, config)))


def intervals_in_hands(ranges: Float32s, config: OwnBodyConfig) -> list[tuple[int, int]]:
    """Where somebody holds the robot, hands around its laser, and moves it.

    Args:
        ranges: (n, n_beams) [m], NaN where nothing came back.
        config: how near hands are, and how much they hide.

    Returns:
        First and last scan of each interval.
    """
    share = (ranges < config.nearest).sum(axis=1) / np.maximum(np.isfinite(ranges).sum(axis=1), 1)
    held = np.flatnonzero((share >= config.hands) & (share < config.cloth))
    found = []
    for scans in np.split(held, np.flatnonzero(np.diff(held) > config.places) + 1):
        if len(scans) < config.places:
            continue
        first, last = int(scans[0]), int(scans[-1])
        around = ranges[first : last + 1]
        if len(_different(np.where(around < config.nearest, np.float32(np.nan), around), config)):
            found.append((first, last))
    return found


def beyond(ranges: Float32s, limits: Floats) -> Float32s:
    """(n, n_beams) ranges without those nearer than (n_beams,) limits [m]."""
    return np.where(ranges < limits, np.float32(np.nan), ranges)


def own_limits(ranges: Float32s, geometry: ScanGeometry, config: OwnBodyConfig) -> Floats:
    """(n_beams,) how far away at least what is seen must be that is not the robot [m], see `own_body`."""
    return np.maximum(own_body(ranges, geometry, config), config.nearest)


def own_body(ranges: Float32s, geometry: ScanGeometry, config: OwnBodyConfig) -> Floats:
    """How far the robot itself reaches in each beam.

    Args:
        ranges: (n, n_beams) [m], NaN where nothing came back.
        geometry: of the laser.
        config: what gives the robot away.

    Returns:
        (n_beams,) [m], with the margin; 0 where a beam does not see the robot.
    """
    body, found = np.zeros(geometry.n_beams), np.zeros(geometry.n_beams)
    asked = ranges[:: max(1, -(-len(ranges) // _SCANS))]
    is_near = asked < config.reach
    often = np.flatnonzero(is_near.sum(axis=0) > config.seen * np.isfinite(asked).sum(axis=0))
    if not len(often):
        return body
    nearest = _nearest(np.where(is_near[:, often], asked[:, often], np.inf))
    stays = _stays(asked[:, often], nearest, config)
    candidates, nearest = often[stays], nearest[stays]
    others = np.setdiff1d(np.arange(geometry.n_beams), candidates)
    if not len(candidates) or len(others) < config.fewest_others:
        return body
    asked = asked[_different(asked[:, others], config)]
    if len(asked) < config.places:
        return body
    stays = _stays(asked[:, candidates], nearest, config)
    found[candidates[stays]] = nearest[stays]
    half = max(2, int(np.ceil(config.close_by / geometry.resolution)))
    for part in _parts(found > 0.0, half, geometry.is_full_circle):
        if _ends_with_leaps(asked, found, part, half, geometry, config):
            body[part] = found[part] + config.margin
    around = np.pad(body, half, mode="wrap" if geometry.is_full_circle else "constant")
    # SciPy's filter is the only part of it that a run would need: importing it takes a tenth of a second.
    widest: Floats = np.lib.stride_tricks.sliding_window_view(around, 2 * half + 1).max(axis=1)
    return widest


def _nearest(ranges: Float32s) -> Float32s:
    """(k,) the lower quartile of what is finite in each column of (n, k): no return comes from before the robot."""
    n_finite = np.isfinite(ranges).sum(axis=0)
    nearest: Float32s = np.sort(ranges, axis=0)[(n_finite - 1) // 4, np.arange(ranges.shape[1])]
    return nearest


def _stays(ranges: Float32s, nearest: Float32s, config: OwnBodyConfig) -> Bools:
    """(k,) whether much of what (n, k) beams return comes from (k,) ranges, and hardly anything from before them."""
    within = ranges <= nearest + config.scatter
    n_own = (within & (ranges >= nearest - config.scatter)).sum(axis=0)
    n_seen = np.isfinite(ranges).sum(axis=0)
    return np.asarray((n_own >= config.seen * n_seen) & (n_own >= config.agreement * within.sum(axis=0)) & (n_own > 0))


def _different(ranges: Float32s, config: OwnBodyConfig) -> Ints:
    """Scans each of which is taken elsewhere than the one before: half of what both see has changed.

    Args:
        ranges: (n, k) [m], NaN where nothing came back, which tells nothing: some lasers lose most returns.
        config: what a change is, and how many beams tell of it.

    Returns:
        (m,) increasing.
    """
    places: list[int] = []
    seen = np.flatnonzero(np.isfinite(ranges).sum(axis=1) >= config.fewest_others).tolist()
    last = seen[0] if seen else 0
    for scan in seen:
        changes = np.abs(ranges[scan] - ranges[last])
        n_both = int(np.count_nonzero(changes >= 0.0))
        if n_both < config.fewest_others:
            last = scan
        elif 2 * int(np.count_nonzero(changes <= config.change)) < n_both:
            places.append(scan)
            last = scan
    return np.array(places, dtype=np.int64)


def _parts(is_own: Bools, most: int, is_full_circle: bool) -> Iterator[Ints]:
    """Beams of each part of the robot in the order of their bearings, with no more than so many beams between two."""
    beams = np.flatnonzero(is_own)
    if not len(beams):
        return
    parts = np.split(beams, np.flatnonzero(np.diff(beams) > most) + 1)
    if is_full_circle and len(parts) > 1 and parts[0][0] + len(is_own) - parts[-1][-1] <= most:
        parts[0] = np.concatenate([parts.pop(), parts[0]])
    yield from parts


def _ends_with_leaps(
    ranges: Float32s,
    found: Floats,
    part: Ints,
    half: int,
    geometry: ScanGeometry,
    config: OwnBodyConfig,
) -> bool:
    """Whether what is seen on either side of a part of the robot is much farther away, nearly wherever that is seen.

    Args:
        ranges: (m, n_beams) of scans in different places [m].
        found: (n_beams,) range of the robot [m].
        part: its beams in the order of their bearings.
        half: beams that pass so close may hit it.
        geometry: of the laser; beyond its first and last beam nothing is asked.
        config: how much farther.
    """
    n_beams, reach = geometry.n_beams, half + max(half, int(config.beside / geometry.resolution))
    told = False
    for end, step in ((int(part[0]), -1), (int(part[-1]), 1)):
        beside = end + step * np.arange(half + 1, reach + 1)
        beside = beside % n_beams if geometry.is_full_circle else beside[(beside >= 0) & (beside < n_beams)]
        if len(beside) < half:
            continue
        around = ranges[np.abs(ranges[:, end] - found[end]) <= config.scatter][:, beside]
        seen = np.isfinite(around)
        first = around[np.arange(len(around)), seen.argmax(axis=1)][seen.any(axis=1)]
        leaps = first > 1.25 * found[end] + config.gap
        if len(first) < config.places or leaps.sum() < config.agreement * len(first):
            return False
        told = True
    return told


def _warnings(limits: Floats, held: Sequence[tuple[int, int]], config: OwnBodyConfig) -> Iterator[str]:
    beams = np.flatnonzero(limits > config.nearest)
    if len(beams):
        yield (
            f"the robot itself is in the view of its laser, in {len(beams)} of {len(limits)} beams, first in beam "
            f"{beams[0]}, up to {limits.max() - config.margin:.2f} m away: what they return from there is left out"
        )
    for first, last in held:
        yield (
            f"somebody holds the robot from scan {first} to scan {last}, hands around its laser: what it sees there is "
            "left out"
        )
