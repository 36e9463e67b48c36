"""USARSim logs: what the simulator's sensors say, one message a line (`usarsim_messages` has the format)."""

import math
import re
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs import laser_mount
from frontends.logs.beams import BeamDescription, Setup, stack_sweeps, usual_setup
from frontends.logs.budget import check_stack
from frontends.logs.errors import LogError
from frontends.logs.handedness import handedness
from frontends.logs.plausibility import check_steps, choose_stamps, judge_odometry
from frontends.logs.usable_range import (
    DEFAULT_RANGE_MIN,
    UsableRange,
    mask_no_returns,
    usable_range,
    warn_of_no_returns,
)
from frontends.logs.usarsim_records import POSES, Records, collect
from frontends.logs.usarsim_writer import write_usarsim
from frontends.scan import Log, ScanGeometry
from graph.se2 import wrap_angle

__all__ = ["is_usarsim", "read_usarsim", "write_usarsim"]

_ODOMETRY = ("odometry", "ins")
_LIMIT_REPEATS = 5
"""A greatest reading, in whole metres, that comes at least so often is the limit of the laser."""
_RECOGNISED = re.compile(rb"^\s*(SEN|CONF|GEO|STA|NFO|RES)\s*\{", re.IGNORECASE | re.MULTILINE)


def is_usarsim(head: bytes) -> bool:
    """Whether a file that begins with `head` is a USARSim log: one of its first lines is one of its messages."""
    return _RECOGNISED.search(head) is not None


def read_usarsim(
    path: Path | str,
    *,
    laser: str = "front",
    range_min: float | None = None,
    range_max: float | None = None,
    skip_bad_lines: bool = False,
) -> Log:
    """Read a USARSim log, plain or compressed, block by block.

    Beams run from right to left, evenly over FOV; FOV / (N - 1) lies between two of them, for the printed resolution
    is rounded too much. `CONF` gives the usable range (readings at MaxRange are no returns), else it is found in the
    readings; `GEO` gives the laser's place on the robot, else it sits at the centre. Odometry comes from the
    Odometry messages, else from INS. A scan takes the pose message nearest before it in the file, else behind it,
    that has its `{Time}`; else it lies between its neighbours by time; without times, the one before it where they
    alternate, else between them by their place in the file. GroundTruth, brought to the scans likewise, becomes
    `Log.truth`; it is never taken for odometry.

    USARSim's frames are left-handed (x ahead, y right, yaw clockwise): poses become x, -y, -yaw. Some logs were
    turned over already, so the sign is checked on the scans themselves (`handedness`).

    Messages of other kinds are counted and ignored. A last line that was cut off is a warning.

    Args:
        path: the log.
        laser: the name of a range scanner; "front" for the one with most scans.
        range_min: shortest return [m]; None for what CONF says, else 2 cm.
        range_max: longest return [m]; None for what CONF says, else it is derived from the log.
        skip_bad_lines: pass over malformed lines and count them.

    Raises:
        LogError: the file cannot be read, a line is malformed, or there is no scan in it.
    """
    path = Path(path)
    records = collect(path, skip_bad_lines=skip_bad_lines)
    return _assemble(path, records, _choose_laser(path, records, laser), range_min, range_max)


def _choose_laser(path: Path, records: Records, laser: str) -> str:
    if not records.sweeps:
        found = ", ".join(f"{count} {name[:40]}" for name, count in records.counts.most_common(8))
        reason = f"no scan; the log holds {found}" if found else "no message found"
        raise LogError(
            "; ".join([f"{path}: {reason}, expected SEN messages of type RangeScanner", *records.troubles.told()])
        )
    if laser == "front":
        return max(records.sweeps, key=lambda name: len(records.sweeps[name].ranges))
    for name in records.sweeps:
        if name.lower() == laser.lower():
            return name
    raise LogError(
        f"{path}: no range scanner is called '{laser}': expected 'front' or one of {', '.join(records.sweeps)}"
    )


def _assemble(path: Path, records: Records, name: str, range_min: float | None, range_max: float | None) -> Log:
    """Turn what the lines held into arrays."""
    sweeps = records.sweeps[name]
    shortest, longest, stated_view = records.limits.get(name, records.limits.get("", (math.nan,) * 3))
    setups, view_warnings = _setups(sweeps.setups, stated_view)
    usual = usual_setup(setups)
    if usual is None:
        raise LogError(f"{path}: no RangeScanner message has two beams or more, which a scan in the plane needs")
    check_stack(path, len(setups), usual.n_beams)
    ranges, bearings, beam_warnings = stack_sweeps(sweeps.ranges, setups, usual, {})
    usable = _usable(ranges, range_min, range_max, shortest, longest)
    mask_no_returns(ranges, usable)
    T_robot_laser, upside_down, mount_warnings = _place_laser(records, name)
    if upside_down:
        ranges = np.ascontiguousarray(ranges[:, ::-1])
    stamps, stamp_warnings = choose_stamps(np.column_stack([sweeps.stamps, sweeps.stamps]))
    places = np.array(sweeps.places)

    def poses_of(source: str) -> tuple[NDArray[np.float64], list[str]]:
        recorded = records.poses[source].at_scans(places, stamps)
        return _right_handed(recorded, ranges, bearings, POSES[source])

    odometry, has_odometry, odometry_warnings = np.zeros((len(ranges), 3)), False, ["there is no odometry"]
    for source in _ODOMETRY:
        if len(records.poses[source]) and not has_odometry:
            odometry, pose_warnings = poses_of(source)
            check_steps(path, odometry)
            has_odometry, judged = judge_odometry(odometry, ranges, stamps)
            odometry_warnings = [*pose_warnings, *judged]
            if has_odometry and source != _ODOMETRY[0]:
                odometry_warnings.append(f"{POSES[source]} is taken for odometry")
    truth, truth_warnings = poses_of("groundtruth") if len(records.poses["groundtruth"]) else (None, [])
    if truth is not None and not has_odometry:
        truth_warnings.append("the log holds the truth; it is not taken for odometry")
    return Log(
        ranges=ranges,
        odometry=odometry,
        stamps=stamps,
        geometry=ScanGeometry(
            bearings=bearings, range_min=usable.range_min, range_max=usable.range_max, T_robot_laser=T_robot_laser
        ),
        path=path,
        has_odometry=has_odometry,
        is_mount_known=laser_mount.UNKNOWN not in mount_warnings,
        warnings=(
            *_warn_of_other_lasers(records, name),
            *records.troubles.told(),
            *view_warnings,
            *beam_warnings,
            *warn_of_no_returns(ranges, usable),
            *mount_warnings,
            *stamp_warnings,
            *dict.fromkeys([*odometry_warnings, *truth_warnings]),
        ),
        skipped_lines=records.troubles.skipped,
        message_counts=dict(sorted(records.counts.items())),
        truth=truth,
    )


def _setups(recorded: list[tuple[int, float, float]], stated_view: float) -> tuple[list[Setup], list[str]]:
    """The setting of each scan; its step is its field of view by its number of beams, whatever it says."""
    degrees = any(view > 2 * math.pi + 0.01 for _, view, _ in recorded) or stated_view > 2 * math.pi + 0.01
    unit = math.radians(1.0) if degrees else 1.0
    found: dict[tuple[int, float, float], Setup] = {}
    for key in dict.fromkeys(recorded):
        n_beams, view, resolution = key
        view = view if view > 0 else stated_view if stated_view > 0 else resolution * (n_beams - 1)
        description = None
        if view > 0 and n_beams > 1:
            view *= unit
            description = BeamDescription(-view / 2, view, view / (n_beams - 1), 0.0)
        found[key] = Setup(n_beams, description)
    warnings = ["the field of view is too wide for radians: it is read as degrees"] if degrees else []
    return [found[key] for key in recorded], warnings


def _usable(
    ranges: NDArray[np.float32],
    range_min: float | None,
    range_max: float | None,
    stated_min: float,
    stated_max: float,
) -> UsableRange:
    """What CONF says, unless it is overruled; without it what the readings themselves show."""
    if range_min is None:
        range_min = stated_min if stated_min >= 0 else DEFAULT_RANGE_MIN
    if not stated_max > 0:
        stated_max = _whole_limit(ranges)
    if not stated_max > 0:
        return usable_range(ranges, range_min=range_min, range_max=range_max)
    ranges[~(ranges < np.float32(stated_max))] = np.nan
    longest = stated_max if range_max is None else min(range_max, stated_max)
    return UsableRange(range_min=range_min, range_max=max(longest, range_min))


def _whole_limit(ranges: NDArray[np.float32]) -> float:
    """A greatest reading of so many metres sharp, met again and again, is the scanner's MaxRange; else NaN."""
    greatest = float(np.fmax.reduce(ranges, axis=None, initial=0.0))
    if greatest.is_integer() and np.count_nonzero(ranges == np.float32(greatest)) >= _LIMIT_REPEATS:
        return greatest
    return math.nan


def _place_laser(records: Records, name: str) -> tuple[NDArray[np.float64], bool, list[str]]:
    """The pose of the laser on the robot, whether it hangs upside down, and what a person should know."""
    mount = records.mounts.get(name, records.mounts.get(""))
    if mount is None:
        return (
            np.zeros(3),
            False,
            [laser_mount.UNKNOWN],
        )
    x, y, roll, yaw = mount
    T_robot_laser = np.array([x, -y, wrap_angle(-yaw)]) + 0.0
    if math.cos(roll) > 0:
        return T_robot_laser, False, []
    return T_robot_laser, True, ["the laser is mounted upside down: its beams are put in the usual order"]


def _right_handed(
    recorded: NDArray[np.float64], ranges: NDArray[np.float32], bearings: NDArray[np.float64], source: str
) -> tuple[NDArray[np.float64], list[str]]:
    """Poses in a frame with y to the left and headings that grow counter-clockwise."""
    side, left, right = handedness(recorded, ranges, bearings)
    if side == "right":
        warning = (
            f"the headings of {source} turn with the scans ({right} of {left + right} pairs of scans), against "
            "USARSim's custom: they are taken as they stand"
        )
        return recorded, [warning]
    warnings = []
    if side == "unknown" and recorded[:, 1:].any():
        warnings.append(
            f"the scans do not tell on which side the headings of {source} lie ({left} pairs of scans for the right, "
            f"{right} for the left): USARSim's left-handed frame is assumed"
        )
    turned = recorded * (1.0, -1.0, -1.0) + 0.0
    turned[:, 2] = wrap_angle(turned[:, 2])
    return turned, warnings


def _warn_of_other_lasers(records: Records, name: str) -> list[str]:
    if len(records.sweeps) == 1:
        return []
    found = ", ".join(f"{len(sweeps.ranges)} of '{other}'" for other, sweeps in records.sweeps.items())
    return [f"several range scanners ({found}): '{name}' is used"]
