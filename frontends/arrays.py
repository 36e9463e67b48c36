"""A log from plain arrays, checked."""

import math
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from frontends.logs.laser_mount import UNKNOWN
from frontends.logs.plausibility import judge_odometry, judge_stamps
from frontends.logs.usable_range import mask_no_returns, usable_range, warn_of_no_returns
from frontends.plain_numbers import plain_numbers
from frontends.radians import not_in_radians
from frontends.scan import WHOLE_TURN, Log, ScanError, ScanGeometry
from graph.limits import LIMITS, LimitError, check_limit
from graph.se2 import wrap_angle

_Number = TypeVar("_Number", np.float32, np.float64)

_UNEVEN = 0.5
"""Bearings may lie off an even spread by less than this share of a step."""


def log_from_arrays(
    ranges: ArrayLike,
    *,
    bearings: ArrayLike | None = None,
    field_of_view: float | None = None,
    odometry: ArrayLike | None = None,
    stamps: ArrayLike | None = None,
    truth: ArrayLike | None = None,
    range_min: float | None = None,
    range_max: float | None = None,
    T_robot_laser: ArrayLike | None = None,
    sweep: float | None = None,
    gyro: ArrayLike | None = None,
    path: Path = Path("arrays"),
) -> Log:
    """Check arrays and make a log of them; see `Log.from_arrays`.

    Raises:
        ScanError: an array is not of the shape it must have, or holds what it must not.
    """
    given = _array("ranges", ranges, np.float32, ndim=2)
    n_scans, n_beams = given.shape
    if n_scans < 1 or n_beams < 2:
        raise ScanError(f"found ranges of shape {given.shape}, expected (n_scans, n_beams), at least (1, 2)")
    try:
        check_limit(n_scans, "scans", f"found ranges of shape {given.shape}")
        check_limit(given.size, "readings", f"found ranges of shape {given.shape}")
    except LimitError as error:
        raise ScanError(str(error)) from error
    readings = given.copy()
    directions = _bearings(bearings, field_of_view, n_beams)
    if directions[0] > directions[-1]:
        directions, readings = directions[::-1].copy(), np.ascontiguousarray(readings[:, ::-1])
    shortest, longest = _limits(range_min, range_max)
    usable = usable_range(readings, range_min=shortest, stated_max=longest)
    mask_no_returns(readings, usable)
    warnings = list(warn_of_no_returns(readings, usable))
    times = None if stamps is None else checked_finite("stamps", stamps, (n_scans,))
    T_odom_robot, has_odometry = np.zeros((n_scans, 3)), False
    if odometry is None:
        warnings.append("there is no odometry")
    else:
        T_odom_robot = _poses("odometry", odometry, n_scans)
        has_odometry, judged = judge_odometry(T_odom_robot, readings, times)
        warnings += [*judged, *([UNKNOWN] if has_odometry and T_robot_laser is None else [])]
    if times is not None:
        warnings += judge_stamps(times)
    else:
        warnings.append("there are no stamps: scans are numbered 0, 1, 2 … s instead")
    geometry = ScanGeometry(
        bearings=directions,
        range_min=usable.range_min,
        range_max=usable.range_max,
        T_robot_laser=np.zeros(3) if T_robot_laser is None else _mount(T_robot_laser),
    )
    return Log(
        ranges=readings,
        odometry=T_odom_robot,
        stamps=np.arange(float(n_scans)) if times is None else times,
        geometry=geometry,
        path=path,
        has_odometry=has_odometry,
        is_mount_known=T_robot_laser is not None,
        warnings=tuple(warnings),
        message_counts={"scans": n_scans},
        truth=None if truth is None else _poses("truth", truth, n_scans),
        sweep=None if sweep is None else float(checked_finite("sweep", sweep, ())),
        gyro=None if gyro is None else _gyro(gyro, n_scans),
    )


def _bearings(bearings: ArrayLike | None, field_of_view: float | None, n_beams: int) -> NDArray[np.float64]:
    """(n_beams,) [rad], evenly spread, increasing or decreasing."""
    if (bearings is None) == (field_of_view is None):
        raise ScanError("found bearings and field_of_view, or neither, expected exactly one of them")
    if field_of_view is not None:
        view = float(checked_finite("field_of_view", field_of_view, ()))
        if not 0.0 < view <= WHOLE_TURN:
            in_degrees = f": {view:g}° is {math.radians(view):.6g}" if view > WHOLE_TURN else ""
            raise ScanError(f"found a field of view of {view:g} rad, expected more than 0 and at most 2π{in_degrees}")
        return np.linspace(-0.5 * view, 0.5 * view, n_beams)
    directions = checked_finite("bearings", bearings, (n_beams,))
    steps = np.diff(directions)
    step = float(directions[-1] - directions[0]) / (n_beams - 1)
    if not (np.sign(steps) == np.sign(step)).all() or step == 0.0:
        raise ScanError("found bearings that neither increase nor decrease throughout, expected them in order")
    if abs(step) * (n_beams - 1) > WHOLE_TURN:
        raise ScanError(f"found bearings over {abs(step) * (n_beams - 1):.4f} rad, expected at most 2π, in radians")
    even = directions[0] + step * np.arange(n_beams)
    if float(np.abs(directions - even).max()) > _UNEVEN * abs(step):
        raise ScanError("found bearings that are spread unevenly, expected about the same step between all of them")
    return directions


def _limits(range_min: float | None, range_max: float | None) -> tuple[float | None, float]:
    """What is no return: shorter readings, and those of the greatest length and more [m]."""
    shortest = None if range_min is None else float(checked_finite("range_min", range_min, ()))
    longest = np.inf if range_max is None else float(range_max)
    if (shortest or 0.0) < 0.0 or not longest > (shortest or 0.0):
        raise ScanError(f"found ranges from {shortest} m to {longest} m, expected 0 ≤ range_min < range_max")
    if LIMITS.range < longest < np.inf:
        raise ScanError(f"found a range_max of {longest:g} m, expected at most {LIMITS.range:g} m, or infinity")
    return shortest, longest


def _poses(name: str, values: ArrayLike, n_scans: int) -> NDArray[np.float64]:
    poses = checked_finite(name, values, (n_scans, 3)).copy()
    poses[:, 2] = wrap_angle(poses[:, 2])
    return poses


def _mount(values: ArrayLike) -> NDArray[np.float64]:
    mount = checked_finite("T_robot_laser", values, (3,))
    misread = not_in_radians(float(mount[2]))
    if misread:
        raise ScanError(f"T_robot_laser: {misread}")
    return mount


def _gyro(values: ArrayLike, n_scans: int) -> NDArray[np.float64]:
    """(n_scans, 3) of three axes, or of the vertical one alone."""
    if np.ndim(values) != 1:
        return checked_finite("gyro", values, (n_scans, 3)).copy()
    about_z = checked_finite("gyro", values, (n_scans,))
    return np.column_stack([np.zeros((n_scans, 2)), about_z])


def checked_readings(ranges: ArrayLike, n_beams: int) -> NDArray[np.float32]:
    """(n_beams,) readings of one scan, a copy.

    Raises:
        ScanError: they are not that many numbers.
    """
    readings = _array("ranges", ranges, np.float32, ndim=1)
    if len(readings) != n_beams:
        raise ScanError(f"found ranges of shape {readings.shape}, expected {(n_beams,)}")
    return readings.copy()


def checked_pose(name: str, values: ArrayLike) -> NDArray[np.float64]:
    """(3,) x, y, heading, the heading in (−π, π].

    Raises:
        ScanError: they are not three finite numbers.
    """
    pose = checked_finite(name, values, (3,))
    return np.array([pose[0], pose[1], wrap_angle(float(pose[2]))])


def checked_finite(name: str, values: ArrayLike | None, shape: tuple[int, ...]) -> NDArray[np.float64]:
    """An array of just this shape without NaN and infinity.

    Raises:
        ScanError: it is not.
    """
    array = _array(name, values, np.float64, ndim=len(shape))
    if array.shape != shape:
        raise ScanError(f"found {name} of shape {array.shape}, expected {shape}")
    finite = np.isfinite(array)
    if not finite.all():
        place = f"[{np.argwhere(~finite)[0, 0]}]" if len(shape) > 1 or (shape and name in {"stamps", "gyro"}) else ""
        raise ScanError(f"found NaN or infinity in {name}{place}, expected finite numbers")
    return array


def _array(name: str, values: ArrayLike | None, kind: type[_Number], *, ndim: int) -> NDArray[_Number]:
    try:
        array = plain_numbers(name, values, kind)
    except (TypeError, ValueError) as error:
        raise ScanError(f"found {name} that are no array of numbers ({error})") from error
    if array.ndim != ndim:
        raise ScanError(f"found {name} of shape {array.shape}, expected {ndim} dimensions")
    return array
