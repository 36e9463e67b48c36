"""CARMEN logs: the format of the classic public logs, one message a line (`carmen_messages` has its grammar)."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from frontends.logs import laser_mount, odometry_lines
from frontends.logs.beams import stack_sweeps, usual_setup
from frontends.logs.budget import check_stack
from frontends.logs.carmen_writer import write_carmen
from frontends.logs.errors import LogError
from frontends.logs.plausibility import check_steps, choose_stamps, judge_odometry
from frontends.logs.usable_range import mask_no_returns, usable_range, warn_of_no_returns
from frontends.scan import Log, ScanGeometry
from graph.se2 import wrap_angle

if TYPE_CHECKING:
    from frontends.logs.carmen_records import Records

__all__ = ["is_carmen", "read_carmen", "write_carmen"]

_FRONT = ("ROBOTLASER1", "FLASER", "RAWLASER1")
_REAR = ("ROBOTLASER2", "RLASER", "RAWLASER2")
_LASERS = (*_FRONT, *_REAR, *(f"{family}{number}" for family in ("ROBOTLASER", "RAWLASER") for number in (3, 4, 0, 5)))
_FEWEST = 0.5
"""A message of which there are fewer than this share of that with most is not preferred for what it tells: where a log
has two messages of each scan, some lines of one may be missing; a few strays are no recording."""
_OTHERS = ("ODOM", "PARAM", "SYNC", "TRUEPOS", "NMEAGGA", "NMEARMC")


def is_carmen(head: bytes) -> bool:
    """Whether a file that begins with `head` is a CARMEN log: one of its first whole lines is one of its messages."""
    names = {line.split(None, 1)[0].decode("latin-1") for line in head.split(b"\n") if line.strip()}
    return not names.isdisjoint({*_LASERS, *_OTHERS})


def read_carmen(
    path: Path | str,
    *,
    laser: str = "front",
    range_min: float | None = None,
    range_max: float | None = None,
    skip_bad_lines: bool = False,
) -> Log:
    """Read a CARMEN log, plain or compressed, block by block.

    Of several lasers' messages one is used, of the same scans' messages the fullest: for the front laser ROBOTLASER1,
    else FLASER, else RAWLASER1, else whatever laser there is, of which there are at least half as many as of that with
    most; `warnings` says so. Odometry is the robot pose of the laser's own line; RAWLASER lines have none and take it
    from the ODOM lines around them in file order. The laser's place on the robot is the difference of the two poses of
    a line, where that is the same all through the log, else what PARAM says. Beams come from the message, else from
    their number: 180 run from −90° to +89°, 181 to +90°, 360 and 361 likewise in half degrees; any other number spreads
    over 180°. Scans whose beams differ from the most frequent set-up are placed on its bearings. `usable_range` tells
    how no-return readings are recognised.

    Messages of other kinds are counted and ignored. A last line that was cut off is a warning.

    Args:
        path: the log.
        laser: "front", "rear" or the name of a message, such as "RAWLASER3".
        range_min: shortest return [m]; None for 2 cm.
        range_max: longest return [m]; None to derive it from the log.
        skip_bad_lines: pass over malformed lines and count them.

    Raises:
        LogError: the file cannot be read, a line is malformed, or there is no scan in it.
    """
    from frontends.logs.carmen_records import collect

    path, candidates = Path(path), _candidates(laser)
    records = collect(path, candidates, skip_bad_lines=skip_bad_lines)
    most = max(records.counts[name] for name in candidates)
    if records.counts[records.name] < _FEWEST * most:
        frequent = tuple(name for name in candidates if records.counts[name] >= _FEWEST * most)
        records = collect(path, frequent, skip_bad_lines=skip_bad_lines)
    return _assemble(path, records, rear=records.name in _REAR, range_min=range_min, range_max=range_max)


def _candidates(laser: str) -> tuple[str, ...]:
    """The laser messages that may be used, best first."""
    if laser == "front":
        return (*_FRONT, *(name for name in _LASERS if name not in _FRONT))
    if laser == "rear":
        return _REAR
    if laser in _LASERS:
        return (laser,)
    raise LogError(f"no laser is called '{laser}': expected 'front', 'rear' or one of {', '.join(_LASERS)}")


def _assemble(path: Path, records: "Records", *, rear: bool, range_min: float | None, range_max: float | None) -> Log:
    """Turn what the lines held into arrays."""
    setup = usual_setup(records.setups)
    if setup is None:
        raise LogError(f"{path}: {_why_no_scans(records)}")
    check_stack(path, len(records.ranges), setup.n_beams)
    parameters = laser_mount.scanner_parameters(records.parameters, rear=rear)
    ranges, bearings, beam_warnings = stack_sweeps(records.ranges, records.setups, setup, parameters)
    usable = usable_range(ranges, range_min=range_min, range_max=range_max, stated_max=setup.stated_max)
    mask_no_returns(ranges, usable)
    T_odom_robot, T_odom_laser = _recorded_poses(records)
    T_robot_laser, mount_warnings = laser_mount.find(T_odom_robot, T_odom_laser, records.parameters, rear=rear)
    check_steps(path, T_odom_robot)
    stamps, stamp_warnings = choose_stamps(np.array(records.stamps))
    has_odometry, odometry_warnings = judge_odometry(T_odom_robot, ranges, stamps)
    return Log(
        ranges=ranges,
        odometry=T_odom_robot,
        stamps=stamps,
        geometry=ScanGeometry(
            bearings=bearings, range_min=usable.range_min, range_max=usable.range_max, T_robot_laser=T_robot_laser
        ),
        path=path,
        has_odometry=has_odometry,
        is_mount_known=laser_mount.UNKNOWN not in mount_warnings,
        warnings=(
            *_warn_of_other_lasers(records),
            *records.troubles.told(),
            *beam_warnings,
            *warn_of_no_returns(ranges, usable),
            *mount_warnings,
            *stamp_warnings,
            *odometry_warnings,
        ),
        skipped_lines=records.troubles.skipped,
        message_counts=dict(sorted(records.counts.items())),
    )


def _recorded_poses(records: "Records") -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(n_scans, 3) T_odom_robot, and (n_scans, 3) T_odom_laser or (0, 3) where the messages have no poses."""
    if not records.poses[0]:
        return odometry_lines.at_scans(records.odometry, records.scans_before_odometry, len(records.ranges)), np.empty(
            (0, 3)
        )
    poses = np.array(records.poses)
    poses[:, [2, 5]] = wrap_angle(poses[:, [2, 5]])
    return np.ascontiguousarray(poses[:, 3:6]), poses[:, :3]


def _why_no_scans(records: "Records") -> str:
    if records.ranges:
        reason = f"no {records.name} message has two beams or more, which a scan in the plane needs"
    elif records.counts:
        found = ", ".join(f"{count} {name[:40]}" for name, count in records.counts.most_common(8))
        reason = f"no scan of the wanted laser; the log holds {found}"
    else:
        reason = "no message found, expected a CARMEN log with laser messages such as FLASER"
    return "; ".join([reason, *records.troubles.told()])


def _warn_of_other_lasers(records: "Records") -> list[str]:
    present = [name for name in _LASERS if records.counts[name]]
    if len(present) == 1:
        return []
    found = ", ".join(f"{records.counts[name]} {name}" for name in present)
    return [f"several laser messages ({found}): {records.name} is used"]
