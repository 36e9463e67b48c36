"""Writing a log as USARSim's sensors would have said it."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from frontends.logs.errors import LogError
from frontends.logs.text_output import write_text_log
from frontends.scan import Log

_LASER = "{Type RangeScanner} {Name Scanner1}"
_BLOCK = 1024  # scans


def write_usarsim(path: Path | str, log: Log) -> None:
    """Write a log, compressed when `path` ends with .gz; reading it back gives the same numbers to the last bit.

    `CONF` and `GEO` messages say what the laser can see and where it sits; each scan is preceded by its odometry, if
    the log has any, and its true pose, if the log knows it. Frames are USARSim's: y to the right, yaw clockwise.
    Beams without return read MaxRange, as the simulator's do. A laser whose beams do not lie evenly about its axis,
    as those from -90 to +89 degrees, is turned on the robot until they do.

    Args:
        path: replaced as a whole when all is written.
        log: what to write.

    Raises:
        LogError: the file cannot be written, or the beams are not evenly spread, for which there is no message.
    """
    path = Path(path)
    if not np.allclose(np.diff(log.geometry.bearings, 2), 0.0, atol=1e-9):
        raise LogError(f"{path}: found unevenly spread beams, expected the same step between all of them")
    write_text_log(path, _text(log))


def _text(log: Log) -> Iterator[str]:
    """The lines, a block of scans at a time."""
    no_return = _no_return(log)
    yield _description(log, no_return)
    scan = f"{{Resolution {log.geometry.resolution!r}}} {{FOV {log.geometry.field_of_view!r}}} {{Range "
    ranges_format = ",".join([_range_format(log.ranges)] * log.geometry.n_beams)
    for start in range(0, len(log), _BLOCK):
        lines = []
        for index in range(start, min(start + _BLOCK, len(log))):
            time = f"SEN {{Time {float(log.stamps[index])!r}}}"
            if log.has_odometry:
                x, y, heading = _left_handed(log.odometry[index])
                lines.append(f"{time} {{Type Odometry}} {{Name Odometry}} {{Pose {x!r},{y!r},{heading!r}}}\n")
            if log.truth is not None:
                x, y, heading = _left_handed(log.truth[index])
                lines.append(
                    f"{time} {{Type GroundTruth}} {{Name GroundTruth}} "
                    f"{{Location {x!r},{y!r},0.0}} {{Orientation 0.0,0.0,{heading!r}}}\n"
                )
            readings = (ranges_format % tuple(log.ranges[index].tolist())).replace("nan", no_return)
            lines.append(f"{time} {_LASER} {scan}{readings}}}\n")
        yield "".join(lines)


def _description(log: Log, no_return: str) -> str:
    geometry = log.geometry
    x, y, yaw = geometry.T_robot_laser.tolist()
    yaw += (geometry.bearings[0] + geometry.bearings[-1]) / 2
    return (
        f"CONF {_LASER} {{MaxRange {no_return}}} {{MinRange {float(geometry.range_min)!r}}} "
        f"{{Resolution {geometry.resolution!r}}} {{Fov {geometry.field_of_view!r}}}\n"
        f"GEO {_LASER} {{Location {x!r},{0.0 - y!r},0.0}} {{Orientation 0.0,0.0,{0.0 - float(yaw)!r}}} {{Mount HARD}}\n"
    )


def _no_return(log: Log) -> str:
    """The laser's range, beyond every reading."""
    longest = float(np.fmax.reduce(log.ranges, axis=None, initial=0.0))
    if longest < np.float32(log.geometry.range_max):
        return repr(float(log.geometry.range_max))
    return repr(float(np.nextafter(np.float32(longest), np.float32(math.inf))))


def _range_format(ranges: NDArray[np.float32]) -> str:
    """The shortest format that gives every reading back to the last bit."""
    for decimals in (2, 3, 4):
        rounded = np.round(ranges.astype(np.float64), decimals).astype(np.float32)
        if np.array_equal(rounded, ranges, equal_nan=True):
            return f"%.{decimals}f"
    return "%.9g"


def _left_handed(pose: NDArray[np.float64]) -> tuple[float, float, float]:
    x, y, heading = pose.tolist()
    return x, 0.0 - y, 0.0 - heading
