"""The table of log formats, and reading a log whose format its content tells."""

import codecs
from collections.abc import Callable
from dataclasses import dataclass
from inspect import signature
from numbers import Real
from pathlib import Path
from typing import Any

from frontends.bags.bag import read_bag
from frontends.bags.magic import container, is_bag
from frontends.checked_arguments import expect
from frontends.logs.carmen import is_carmen, read_carmen
from frontends.logs.dpslam import is_dpslam, read_dpslam
from frontends.logs.errors import LogError
from frontends.logs.laser_mount import placed
from frontends.logs.player import is_player, read_player
from frontends.logs.text import TextLog
from frontends.logs.usarsim import is_usarsim, read_usarsim
from frontends.scan import Log
from frontends.tables.csv_table import is_csv, read_csv
from frontends.tables.npz_table import is_npz, read_npz
from frontends.tables.parquet_table import is_parquet, read_parquet
from graph.errors import reason
from graph.files import check_file


@dataclass(frozen=True, slots=True, kw_only=True)
class Reader:
    """One format of logs.

    Attributes:
        read: takes the path and the format's own options.
        recognises: tells by the (uncompressed) beginning of a file whether it is of this format.
    """

    read: Callable[..., Log]
    recognises: Callable[[bytes], bool]


READERS: dict[str, Reader] = {
    "carmen": Reader(read=read_carmen, recognises=is_carmen),
    "dpslam": Reader(read=read_dpslam, recognises=is_dpslam),
    "usarsim": Reader(read=read_usarsim, recognises=is_usarsim),
    "player": Reader(read=read_player, recognises=is_player),
    "bag": Reader(read=read_bag, recognises=is_bag),
    "csv": Reader(read=read_csv, recognises=is_csv),
    "npz": Reader(read=read_npz, recognises=is_npz),
    "parquet": Reader(read=read_parquet, recognises=is_parquet),
}
"""Every format that can be read, by the name that chooses it."""


def read_log(
    path: Path | str,
    *,
    log_format: str = "auto",
    laser_x: float | None = None,
    laser_y: float | None = None,
    laser_heading: float | None = None,
    progress: Callable[[int, int], None] | None = None,
    **options: Any,  # noqa: ANN401
) -> Log:
    """Read a recorded log.

    Args:
        path: the log, plain or compressed (gz, bz2, xz).
        log_format: a name out of `READERS`, or "auto" to tell it by the content.
        laser_x: where the laser sits ahead of the robot's centre [m]; None for what the log says, as for the others.
        laser_y: to the left of it [m].
        laser_heading: counter-clockwise from straight ahead [rad].
        progress: called with how much is read and how much there is, by readers of formats whose logs are long.
        **options: for the format's reader: `range_max`, `skip_bad_lines` and so on. One that is None or
            False is left to the reader, and need not be known to it.

    Raises:
        LogError: the file cannot be read, its format is unknown, or has no such option.
        TypeError: `range_max` is no number.
    """
    path = Path(path)
    if log_format == "auto":
        log_format = recognise(path)
    if log_format not in READERS:
        raise LogError(f"no log format is called '{log_format}': expected 'auto' or one of {', '.join(READERS)}")
    read = READERS[log_format].read
    given = {name: value for name, value in options.items() if value is not None and value is not False}
    unknown = sorted(given.keys() - signature(read).parameters.keys())
    if unknown:
        raise LogError(f"{path}: a log of the format {log_format} has no option {', '.join(unknown)}")
    expect(given.get("range_max", 0.0), Real, "range_max", "a number [m]")
    if "progress" in signature(read).parameters:
        given["progress"] = progress
    return placed(read(path, **given), laser_x, laser_y, laser_heading)


def _is_plain_bag(path: Path) -> bool:
    """Whether a file is a bag that is not packed as a whole, which may be of any size."""
    try:
        with path.open("rb") as file:
            return container(file.read(16)) is not None
    except OSError as error:
        raise LogError(f"{path}: cannot be read ({reason(error)})") from error


def _is_archive(head: bytes) -> bool:
    """Whether a file that begins with `head` is a TAR, or a ZIP whose first entry is no array of NumPy."""
    name = head[30 : 30 + int.from_bytes(head[26:28], "little")]
    return head[257:262] == b"ustar" or (head.startswith(b"PK\x03\x04") and not name.endswith(b".npy"))


def recognise(path: Path) -> str:
    """The name of the format of a log.

    Raises:
        LogError: the file is empty, cannot be read or is of no known format.
    """
    if path.is_dir():
        return "bag"
    check_file(path, None, LogError, "a log")
    if _is_plain_bag(path):
        return "bag"
    log = TextLog(path)
    head = log.head()
    if not head.strip():
        raise LogError(
            f"{path}: the {'compressed file is cut off before its first line' if log.cut_off else 'log is empty'}"
        )
    if head.startswith((codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)):
        raise LogError(f"{path}: found text in UTF-16, expected UTF-8: save it as that")
    if _is_archive(head):
        raise LogError(f"{path}: found an archive of files, expected one of them: unpack it first")
    for name, reader in READERS.items():
        if reader.recognises(head):
            return name
    lines = [line for line in head.split(b"\n") if line.strip()]
    first = next((line for line in lines if not line.lstrip().startswith(b"#")), lines[0]).lstrip()
    raise LogError(
        f"{path}: found '{str(first[:60])[2:-1]}', expected a log of one of the formats {', '.join(READERS)};"
        " other data come in as a table (CSV, Parquet, NPZ: docs/formats.md) or as arrays (iceg.Log.from_arrays)"
    )
