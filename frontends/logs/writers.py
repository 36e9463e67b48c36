"""The table of formats that logs are written in, and what each cannot carry."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from frontends.checked_arguments import expect
from frontends.logs.carmen_writer import write_carmen
from frontends.logs.dpslam import write_dpslam
from frontends.logs.errors import LogError
from frontends.logs.usarsim_writer import write_usarsim
from frontends.scan import Log
from frontends.tables.csv_table import write_csv
from frontends.tables.npz_table import write_npz
from frontends.tables.parquet_table import write_parquet


def _write_ros1(path: Path, log: Log) -> None:
    from frontends.bags.writer import write_ros1_bag  # loads the rosbags library

    write_ros1_bag(path, log)


def _write_sqlite3(path: Path, log: Log) -> None:
    from frontends.bags.writer import write_ros2_bag

    write_ros2_bag(path, log, "sqlite3")


def _write_mcap(path: Path, log: Log) -> None:
    from frontends.bags.writer import write_ros2_bag

    write_ros2_bag(path, log, "mcap")


@dataclass(frozen=True, slots=True, kw_only=True)
class Writer:
    """One format that logs are written in.

    Attributes:
        write: takes the path and the log.
        suffixes: ends of names that ask for it.
        carries: what of `truth`, `sweep`, `stamps` (any, also those that step back), `mount` and `gyro` the format has
            room for.
    """

    write: Callable[[Path, Log], None]
    suffixes: tuple[str, ...]
    carries: frozenset[str]


_ALL = frozenset({"truth", "sweep", "stamps", "mount", "gyro"})

WRITERS: dict[str, Writer] = {
    "carmen": Writer(
        write=partial(write_carmen, range_decimals=6),
        suffixes=(".clf", ".log", ".carmen"),
        carries=frozenset({"stamps", "mount"}),
    ),
    "usarsim": Writer(write=write_usarsim, suffixes=(".usarsim",), carries=frozenset({"truth", "stamps", "mount"})),
    "dpslam": Writer(write=write_dpslam, suffixes=(".dpslam",), carries=frozenset()),
    "ros1": Writer(write=_write_ros1, suffixes=(".bag",), carries=_ALL - {"stamps", "gyro"}),
    "ros2": Writer(write=_write_sqlite3, suffixes=(".db3",), carries=_ALL - {"stamps", "gyro"}),
    "mcap": Writer(write=_write_mcap, suffixes=(".mcap",), carries=_ALL - {"stamps", "gyro"}),
    "csv": Writer(write=write_csv, suffixes=(".csv",), carries=_ALL),
    "npz": Writer(write=write_npz, suffixes=(".npz",), carries=_ALL),
    "parquet": Writer(write=write_parquet, suffixes=(".parquet",), carries=_ALL),
}
"""Every format that can be written, by its name."""


def write_log(path: Path | str, log: Log, *, log_format: str | None = None, overwrite: bool = False) -> tuple[str, ...]:
    """Write a log.

    Args:
        path: the file, or for bags of ROS 2 a folder that is not there yet.
        log: what to write.
        log_format: a name out of `WRITERS`; None to tell it by the end of the name.
        overwrite: whether a file that is there may be replaced, as a whole when all is written.

    Returns:
        What the format could not carry, a sentence each.

    Raises:
        LogError: the format is unknown, cannot carry the beams, or the file is there already or cannot be written.
        TypeError: an argument of another type.
    """
    if isinstance(path, Log):
        raise TypeError("path: found Log first, expected write_log(path, log)")
    expect(log, Log, "log", "iceg.Log, as iceg.read_log(path) gives")
    path = Path(path)
    name = log_format or format_of(path)
    if name not in WRITERS:
        raise LogError(f"no log format is called '{name}': expected one of {', '.join(WRITERS)}")
    check_free(path, overwrite=overwrite)
    WRITERS[name].write(path, log)
    return _lost(name, log)


def check_free(path: Path, *, overwrite: bool) -> None:
    """Refuse to write a log in the place of something else: it may be the only recording.

    Args:
        path: where it is to go.
        overwrite: whether a file may be replaced.

    Raises:
        LogError: a folder is there, or a file that may not be replaced.
    """
    if path.is_dir():
        raise LogError(f"{path}: is a folder, expected a name that is free")
    if not overwrite and path.exists():
        raise LogError(
            f"{path}: is there already; choose another name, or replace it with --overwrite (in Python overwrite=True)"
        )


def format_of(path: Path) -> str:
    """The format out of `WRITERS` that the end of a name asks for.

    Raises:
        LogError: it tells none.
    """
    name = path.name.removesuffix(".gz").lower()
    for log_format, writer in WRITERS.items():
        if name.endswith(writer.suffixes):
            return log_format
    known = ", ".join(suffix for writer in WRITERS.values() for suffix in writer.suffixes)
    raise LogError(
        f"{path}: the end of the name tells no format: expected one of {known}, or --to (in Python log_format)"
    )


def _lost(name: str, log: Log) -> tuple[str, ...]:
    carries = WRITERS[name].carries
    lost = []
    if log.truth is not None and "truth" not in carries:
        lost.append("the true poses")
    if log.sweep is not None and "sweep" not in carries:
        lost.append("how long a sweep takes")
    if log.sweep == 0.0 and name in {"ros1", "ros2", "mcap"}:
        lost.append("that all beams are measured at once")
    if log.gyro is not None and "gyro" not in carries:
        lost.append("the turn rates of the gyro")
    if log.geometry.T_robot_laser.any() and "mount" not in carries:
        lost.append("where the laser sits")
    said = [f"{name} cannot carry {', '.join(lost)}"] if lost else []
    steps = np.diff(log.stamps)
    if "stamps" not in carries and (name == "dpslam" or float(log.stamps.min()) < 0.0 or (steps <= 0.0).any()):
        said.append(
            "the stamps are lost"
            if name == "dpslam"
            else "stamps that step back, repeat or are negative are moved: bags are read in the order of their stamps"
        )
    return tuple(said)
