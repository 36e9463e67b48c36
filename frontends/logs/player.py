"""Logs of Player, as which many public data sets of the 2000s are kept (`player_messages` has the format)."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs import laser_mount
from frontends.logs.beams import stack_sweeps, usual_setup
from frontends.logs.budget import check_stack
from frontends.logs.errors import LogError
from frontends.logs.plausibility import check_steps, choose_stamps, judge_odometry
from frontends.logs.player_messages import RECOGNISED, Device
from frontends.logs.player_records import Records, TimedPoses, collect
from frontends.logs.usable_range import mask_no_returns, usable_range, warn_of_no_returns
from frontends.scan import Log, ScanGeometry


def is_player(head: bytes) -> bool:
    """Whether a file that begins with `head` is a Player log: it says so, or has a line that is one of its messages."""
    return RECOGNISED.search(head) is not None


def read_player(
    path: Path | str,
    *,
    laser: str = "front",
    range_min: float | None = None,
    range_max: float | None = None,
    skip_bad_lines: bool = False,
) -> Log:
    """Read a log of Player 1, 2 or 3, plain or compressed, block by block.

    Odometry is the position interface of the laser's robot that has the lowest index, else the poses that came with the
    scans; a scan lies between the two messages around it by the times of reading. Readings at the longest range that
    the messages state and beyond are no returns. Messages of other interfaces are counted and ignored. A last line that
    was cut off is a warning.

    Args:
        path: the log.
        laser: a laser or ranger such as "laser:0"; "front" for the one with most scans.
        range_min: shortest return [m]; None for 2 cm.
        range_max: longest return [m]; None to derive it from the log.
        skip_bad_lines: pass over malformed lines and count them.

    Raises:
        LogError: the file cannot be read, a line is malformed, or there is no scan in it.
    """
    path = Path(path)
    records = collect(path, skip_bad_lines=skip_bad_lines)
    device = _choose_laser(path, records, laser)
    return _assemble(path, records, device, range_min, range_max)


def _choose_laser(path: Path, records: Records, laser: str) -> Device:
    """The laser that is asked for, of several so called the one with most scans."""
    if not records.sweeps:
        found = ", ".join(f"{count} of {name[:40]}" for name, count in records.counts.most_common(8))
        reason = f"no scan; the log holds {found}" if found else "no message found"
        raise LogError("; ".join([f"{path}: {reason}, expected those of a laser", *records.troubles.told()]))
    called = [device for device in records.sweeps if laser in ("front", device.name, f"{device.robot}/{device.name}")]
    if not called:
        present = ", ".join(f"{device.robot}/{device.name}" for device in records.sweeps)
        raise LogError(f"{path}: no laser is called '{laser}': expected 'front' or one of {present}")
    return max(called, key=lambda device: len(records.sweeps[device].ranges))


def _assemble(path: Path, records: Records, laser: Device, range_min: float | None, range_max: float | None) -> Log:
    """Turn what the lines held into arrays."""
    sweeps = records.sweeps[laser]
    usual = usual_setup(sweeps.setups)
    if usual is None:
        raise LogError(f"{path}: no scan of {laser.name} has two beams or more, which a scan in the plane needs")
    check_stack(path, len(sweeps.ranges), usual.n_beams)
    ranges, bearings, beam_warnings = stack_sweeps(sweeps.ranges, sweeps.setups, usual, {})
    usable = usable_range(ranges, range_min=range_min, range_max=range_max, stated_max=usual.stated_max)
    mask_no_returns(ranges, usable)
    stamps, stamp_warnings = choose_stamps(np.column_stack([sweeps.stamps, sweeps.stamps]))
    odometry, has_odometry, source, odometry_warnings = _odometry(path, records, laser, stamps, ranges)
    mount = records.mounts.get(laser)
    return Log(
        ranges=ranges,
        odometry=odometry,
        stamps=stamps,
        geometry=ScanGeometry(
            bearings=bearings,
            range_min=usable.range_min,
            range_max=usable.range_max,
            T_robot_laser=np.zeros(3) if mount is None else np.array(mount),
        ),
        path=path,
        has_odometry=has_odometry,
        is_mount_known=mount is not None,
        warnings=(
            *_warn_of_other_lasers(records, laser),
            *records.troubles.told(),
            *beam_warnings,
            *warn_of_no_returns(ranges, usable),
            *([laser_mount.UNKNOWN] if mount is None else []),
            *stamp_warnings,
            *odometry_warnings,
        ),
        skipped_lines=records.troubles.skipped,
        message_counts=dict(sorted(records.counts.items())),
        choices={"laser": f"{laser.name} of {laser.robot}, {len(ranges)} scans", "odometry": source},
    )


def _odometry(
    path: Path, records: Records, laser: Device, stamps: NDArray[np.float64], ranges: NDArray[np.float32]
) -> tuple[NDArray[np.float64], bool, str, list[str]]:
    """(n, 3) T_odom_robot of each scan, whether it says anything, where it comes from, and warnings."""
    source, poses = _source(records, laser)
    if not len(poses):
        return np.zeros((len(ranges), 3)), False, "none", ["there is no odometry"]
    odometry = poses.at(stamps)
    check_steps(path, odometry)
    has_odometry, judged = judge_odometry(odometry, ranges, stamps)
    return odometry, has_odometry, source, judged


def _source(records: Records, laser: Device) -> tuple[str, TimedPoses]:
    """Where odometry comes from."""
    own = [device for device in records.poses if device.robot == laser.robot]
    if not own:
        return f"the poses in the messages of {laser.name}", records.sweeps[laser].poses
    first = min(own, key=lambda device: device.number)
    others = [device.name for device in own if device != first]
    return f"{first.name}, preferred to {', '.join(others)}" if others else first.name, records.poses[first]


def _warn_of_other_lasers(records: Records, laser: Device) -> list[str]:
    if len(records.sweeps) == 1:
        return []
    found = ", ".join(f"{len(sweeps.ranges)} of {other.robot}/{other.name}" for other, sweeps in records.sweeps.items())
    return [f"several lasers ({found}): {laser.robot}/{laser.name} is used"]
