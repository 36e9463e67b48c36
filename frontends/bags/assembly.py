"""A bag as a log: what is in it, what of it is chosen, and the arrays."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.bags.beams import StackedSweeps, stack, why_no_scan
from frontends.bags.errors import BagError
from frontends.bags.frames import Frames
from frontends.bags.gyro import choose_gyro
from frontends.bags.laser_choice import choose_laser
from frontends.bags.mount import Mount, base_of, find_mount
from frontends.bags.odometry_choice import PosesOfScans, choose_odometry, choose_truth
from frontends.bags.records import Laser, Records, ScanRecords, collect
from frontends.bags.storage import open_bag
from frontends.bags.times import ScanTimes, scan_times
from frontends.bags.urdf import described_frames
from frontends.logs.laser_mount import SILENT
from frontends.logs.plausibility import judge_odometry
from frontends.logs.usable_range import (
    DEFAULT_RANGE_MIN,
    UsableRange,
    mask_no_returns,
    usable_range,
    warn_of_no_returns,
)
from frontends.scan import Log, ScanGeometry
from graph.errors import IcegError
from graph.se2 import compose

_UNKNOWN_MOUNT = f"the bag {SILENT}: at the robot's centre, unless odometry or log.laser_x, log.laser_y say otherwise"
_FEW_RETURNS = 0.35
"""Where fewer of the beams than this return anything [share], a map is thin."""
_TRUTH_SHARE = 0.99
"""Share of the scans that a truth must tell of."""
_LONGEST_SWEEP = 1.5
"""A sweep that takes longer than so many periods of the scans is none."""


@dataclass(frozen=True, kw_only=True)
class BagOptions:
    """What a person may overrule.

    Attributes:
        scan_topic: topic of the laser.
        scan_frame: frame of the laser, where several share a topic.
        odometry_topic: topic of the odometry.
        base_frame: the robot's frame.
        range_min: shortest return [m].
        range_max: longest return [m].
    """

    scan_topic: str | None = None
    scan_frame: str | None = None
    odometry_topic: str | None = None
    base_frame: str | None = None
    range_min: float | None = None
    range_max: float | None = None


@dataclass(frozen=True, kw_only=True)
class Choice:
    """What of a bag makes a log.

    Attributes:
        frames: its tree.
        laser: whose scans.
        laser_reason: why, for a person.
        stacked: its sweeps.
        times: of its scans, as their messages state them.
        sweep: seconds from the smallest bearing to the largest, None where that is not stated.
        stamps: (n,) of the middle of each scan [s].
        odometry: None where there is none.
        odometry_notes: what else there was.
        base: the robot's frame.
        warnings: what is odd about the description, the laser and its sweeps.
    """

    frames: Frames
    laser: Laser
    laser_reason: str
    stacked: StackedSweeps
    times: ScanTimes
    sweep: float | None
    stamps: NDArray[np.float64]
    odometry: PosesOfScans | None
    odometry_notes: tuple[str, ...]
    base: str
    warnings: tuple[str, ...]


def read_bag_as_log(path: Path, options: BagOptions, progress: Callable[[int, int], None] | None = None) -> Log:
    """Read a bag and choose what of it makes a log; see `read_bag`.

    Raises:
        BagError: the bag cannot be read, or holds no scan.
    """
    with open_bag(path) as bag:
        records = collect(bag, progress, options.scan_topic)
        warnings = [*bag.warnings, *records.warnings()]
    try:
        return _assemble(path, records, warnings, options)
    except IcegError as error:
        raise BagError(f"{path}: {error}") from error


def _assemble(path: Path, records: Records, warnings: list[str], options: BagOptions) -> Log:
    """Turn what the messages held into arrays."""
    if not records.scans:
        raise BagError(_why_no_scans(records, warnings))
    chosen = choose(records, options)
    times, stamps, sweep = chosen.times, chosen.stamps, chosen.sweep
    mount = find_mount(chosen.base, chosen.laser.frame, chosen.frames)
    geometry, ranges, usable = _geometry(chosen.stacked, records.scans[chosen.laser], times, mount, options)
    odometry = chosen.odometry
    T_odom_robot, has_odometry, judged, odometry_said = _odometry(chosen, ranges, stamps)
    gyro = choose_gyro(records.imus, times, stamps, has_odometry=has_odometry)
    truth, truth_said = _truth(records, times, stamps, options.odometry_topic)
    sweep = -sweep if sweep is not None and mount.is_upside_down else sweep
    return Log(
        ranges=ranges,
        odometry=T_odom_robot,
        stamps=stamps,
        geometry=geometry,
        path=path,
        has_odometry=has_odometry,
        is_mount_known=mount.is_known,
        warnings=(
            *warnings,
            *chosen.warnings,
            *_warn_of_few_returns(ranges, usable),
            *mount.warnings,
            *([_UNKNOWN_MOUNT] if has_odometry and not mount.is_known else []),
            *times.warnings,
            *(odometry.warnings if odometry else ()),
            *(gyro.warnings if gyro else ()),
            *judged,
        ),
        message_counts={f"{topic} ({kind})": n for (topic, kind), n in sorted(records.counts.items())},
        truth=truth,
        sweep=sweep,
        gyro=gyro.turned if gyro else None,
        choices={
            "laser": chosen.laser_reason,
            "odometry": odometry_said,
            **({"gyro": gyro.reason} if gyro else {}),
            "mount": mount.reason,
            **({"truth": truth_said} if truth_said else {}),
            "sweep": "not stated" if sweep is None else f"{sweep:+.4f} s from the smallest bearing to the largest",
        },
    )


def choose(records: Records, options: BagOptions) -> Choice:
    """Choose the laser, the odometry and the robot's frame of a bag that holds scans.

    Raises:
        BagError: what a person asked for is not there.
    """
    described, description_warnings = described_frames(records.descriptions)
    frames = Frames.of(records.transforms, described)
    laser = choose_laser(records.scans, frames, topic=options.scan_topic, frame=options.scan_frame)
    scans = records.scans[laser.laser]
    stacked = stack(scans)
    if stacked is None:
        raise BagError(f"no message of {laser.laser.topic} makes a scan: {why_no_scan(scans)}")
    times = _times(scans, stacked)
    sweep = _sweep(scans, stacked, times)
    stamps = times.stamps + 0.5 * abs(sweep or 0.0)
    odometry, notes = choose_odometry(records, frames, laser.laser, times, stamps, options.odometry_topic)
    return Choice(
        frames=frames,
        laser=laser.laser,
        laser_reason=laser.reason,
        stacked=stacked,
        times=times,
        sweep=sweep,
        stamps=stamps,
        odometry=odometry,
        odometry_notes=notes,
        base=_base(options.base_frame, odometry, laser.laser.frame, frames),
        warnings=(*description_warnings, *laser.warnings, *stacked.warnings),
    )


def _times(scans: ScanRecords, stacked: StackedSweeps) -> ScanTimes:
    return scan_times(np.array(scans.stamps)[stacked.sweeps], np.array(scans.recorded)[stacked.sweeps])


def _sweep(scans: ScanRecords, stacked: StackedSweeps, times: ScanTimes) -> float | None:
    """Seconds from the beam of the smallest bearing to that of the largest, None where the messages do not say."""
    increments = np.array([scans.settings[k][3] for k in stacked.sweeps.tolist()])
    increment = float(np.median(increments))
    seconds = increment * (len(stacked.bearings) - 1)
    steps = np.diff(times.stamps)
    period = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
    if not 0.0 < seconds <= _LONGEST_SWEEP * period:
        return None
    return -seconds if stacked.is_clockwise else seconds


def _base(asked: str | None, odometry: PosesOfScans | None, laser_frame: str, frames: Frames) -> str:
    """The robot's frame: as asked for, the one odometry moves, or what the laser sits on."""
    if asked is not None:
        if frames.between(asked.lstrip("/"), laser_frame) is None:
            raise BagError(f"nothing joins the base frame '{asked}' to the laser's frame '{laser_frame}'")
        return asked.lstrip("/")
    if odometry is not None and odometry.child and frames.between(odometry.child, laser_frame) is not None:
        return odometry.child
    base = base_of(laser_frame, frames)
    return odometry.child if odometry is not None and odometry.child and base == laser_frame else base


def _geometry(
    stacked: StackedSweeps, scans: ScanRecords, times: ScanTimes, mount: Mount, options: BagOptions
) -> tuple[ScanGeometry, NDArray[np.float32], UsableRange]:
    """The laser, its readings in the order of time with NaN where there was no return, and what of them are returns."""
    is_in_order = bool((np.diff(times.order) == 1).all())
    ranges, bearings = stacked.ranges if is_in_order else stacked.ranges[times.order], stacked.bearings
    if mount.is_upside_down:
        ranges, bearings = np.ascontiguousarray(ranges[:, ::-1]), -bearings[::-1]
    limits = np.array([scans.settings[k][5:] for k in stacked.sweeps.tolist()])
    stated_min, stated_max = np.median(limits, axis=0).tolist()
    shortest = max(stated_min, DEFAULT_RANGE_MIN) if options.range_min is None else options.range_min
    stated_max = stated_max if stated_max > shortest else np.inf
    usable = usable_range(ranges, range_min=shortest, range_max=options.range_max, stated_max=float(stated_max))
    mask_no_returns(ranges, usable)
    geometry = ScanGeometry(
        bearings=bearings, range_min=usable.range_min, range_max=usable.range_max, T_robot_laser=mount.T_robot_laser
    )
    return geometry, ranges, usable


def _odometry(
    choice: Choice, ranges: NDArray[np.float32], stamps: NDArray[np.float64]
) -> tuple[NDArray[np.float64], bool, list[str], str]:
    """T_odom_robot of each scan, whether it says anything, warnings, and where it comes from."""
    chosen, notes = choice.odometry, choice.odometry_notes
    if chosen is None:
        why = f": {'; '.join(notes)}" if notes else ""
        return np.zeros((len(ranges), 3)), False, [f"there is no odometry{why}"], "; ".join(["none", *notes])
    found = choice.frames.between(chosen.child, choice.base) if chosen.child else None
    poses = chosen.poses if found is None else compose(chosen.poses, found[0].planar)
    has_odometry, judged = judge_odometry(poses, ranges, stamps)
    if not has_odometry:
        return np.zeros_like(poses), False, judged, f"none: {chosen.reason} does not move"
    return poses, True, judged, f"{chosen.reason}, of '{chosen.child or choice.base}'"


def _truth(
    records: Records, times: ScanTimes, stamps: NDArray[np.float64], odometry_topic: str | None
) -> tuple[NDArray[np.float64] | None, str]:
    found = choose_truth(records, times, stamps)
    if found is None or (odometry_topic is not None and odometry_topic.strip("/") in found.reason):
        return None, ""
    if found.share < _TRUTH_SHARE:
        return None, f"{found.reason}, which tells of {100 * found.share:.0f} % of the scans only: not used"
    return found.poses, f"{found.reason}; never taken for odometry"


def _warn_of_few_returns(ranges: NDArray[np.float32], usable: UsableRange) -> list[str]:
    share = float(np.isfinite(ranges).mean())
    if 0.0 < share < _FEW_RETURNS:
        return [f"only {100 * share:.0f} % of the beams return anything: the map will be thin, and may be wrong"]
    return warn_of_no_returns(ranges, usable)


def _why_no_scans(records: Records, warnings: list[str]) -> str:
    found = ", ".join(f"{n} {topic} ({kind})" for (topic, kind), n in records.counts.most_common(8))
    reason = f"no scan; the bag holds {found}" if found else "no message found"
    expected = "expected messages of sensor_msgs/LaserScan, MultiEchoLaserScan or PointCloud2"
    return "; ".join([f"{reason}, {expected}", *warnings])
