"""Tables of scans as NPZ of NumPy: arrays `ranges`, `stamps`, `odometry`, `truth`, `gyro`, and what holds for all."""

import math
import tokenize
import zipfile
import zlib
from dataclasses import replace
from pathlib import Path
from typing import IO

import numpy as np
from numpy.typing import NDArray

from frontends.logs.errors import LogError
from frontends.plain_numbers import plain_numbers
from frontends.scan import Log, ScanError
from frontends.tables.csv_table import check_laser
from frontends.tables.layout import GYRO, ODOMETRY, SETTINGS, STAMP, TRUTH, ScanTable, left_out, log_of, table_of
from graph.atomic import replacing
from graph.errors import reason
from graph.files import check_file
from graph.limits import LimitError, check_limit

_MAGIC = b"PK\x03\x04"
_DAMAGE = (
    OSError,
    ValueError,
    TypeError,
    EOFError,
    KeyError,
    RuntimeError,
    MemoryError,
    SyntaxError,
    zipfile.BadZipFile,
    zlib.error,
    tokenize.TokenError,
)
"""What NumPy and zipfile make of damage."""
_THREE = {"odometry": ODOMETRY, "truth": TRUTH, "gyro": GYRO}
_NAMES = ("ranges", "stamps", *_THREE, *SETTINGS)
_ENDING = ".npy"


def is_npz(head: bytes) -> bool:
    """Whether a file that begins with `head` may be NPZ."""
    return head.startswith(_MAGIC)


def read_npz(
    path: Path | str, *, laser: str = "front", range_min: float | None = None, range_max: float | None = None
) -> Log:
    """Read arrays of scans: `ranges` (n, n_beams), `stamps` (n,), `odometry`, `truth`, `gyro` (n, 3), the settings.

    Args:
        path: the file.
        laser: "front": a table knows no other.
        range_min: shortest return [m]; None for what the file states, else 2 cm.
        range_max: longest return [m]; None for what the file states, else it is told from the readings.

    Raises:
        LogError: the file cannot be read, is larger than `graph.limits` allows, or its arrays make no log.
    """
    path = Path(path)
    check_laser(path, laser)
    check_file(path, "log_bytes", LogError, "a log")
    try:
        _check_sizes(path)
        with np.load(path, allow_pickle=False) as file:
            others = [name for name in file.files if name not in _NAMES]
            unknown = left_out(others, _NAMES, "arrays", ", ".join(_NAMES))
            arrays = {name: plain_numbers(name, file[name], np.float64) for name in file.files if name in _NAMES}
    except LimitError as error:
        raise LogError(str(error)) from error
    except ScanError as error:
        raise LogError(f"{path}: {error}") from error
    except _DAMAGE as error:
        raise LogError(f"{path}: cannot be read as arrays of numbers ({' '.join(str(error).split())})") from error
    log = log_of(path, _table(path, arrays), range_min, range_max)
    return replace(log, warnings=(*unknown, *log.warnings))


def write_npz(path: Path | str, log: Log) -> None:
    """Write a log as arrays; reading it back gives the same numbers.

    Raises:
        LogError: the file cannot be written.
    """
    path, table = Path(path), table_of(log)
    arrays: dict[str, NDArray[np.generic]] = {"ranges": table.ranges, "stamps": table.columns[STAMP]}
    for name, columns in _THREE.items():
        if columns[0] in table.columns:
            arrays[name] = np.column_stack([table.columns[column] for column in columns])
    arrays |= {name: np.array(values) for name, values in table.settings.items()}
    try:
        with replacing(path) as file, zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
            for name, array in arrays.items():
                # Of a fixed date: the same log gives the same bytes.
                entry = zipfile.ZipInfo(f"{name}.npy", (1980, 1, 1, 0, 0, 0))
                entry.compress_type = zipfile.ZIP_DEFLATED
                with archive.open(entry, "w", force_zip64=True) as stream:
                    np.lib.format.write_array(stream, np.ascontiguousarray(array), allow_pickle=False)
    except OSError as error:
        raise LogError(f"{path}: cannot be written ({reason(error)})") from error


def _check_sizes(path: Path) -> None:
    """Refuse what would not fit, by what the archive and the arrays in it state, before any is unpacked.

    Raises:
        LimitError: more bytes, scans, beams or readings than allowed.
    """
    with zipfile.ZipFile(path) as archive:
        entries = archive.infolist()
        total = sum(entry.file_size for entry in entries)
        check_limit(total, "log_bytes", f"{path}: found {total} bytes when unpacked")
        for entry in entries:
            name = entry.filename.removesuffix(_ENDING)
            if name in _NAMES:
                with archive.open(entry) as stream:
                    shape, dtype = _header(stream)
                if math.prod(shape) * dtype.itemsize > entry.file_size:
                    raise ValueError(f"found {name} of shape {shape} in {entry.file_size} bytes, expected more")
                _check_shape(path, name, shape)


def _header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[np.generic]]:
    """Shape and type of an array, as the beginning of its entry states them."""
    version = np.lib.format.read_magic(stream)
    if version not in {(1, 0), (2, 0)}:
        raise ValueError(f"found an array of the format {version}, expected 1.0 or 2.0")
    is_first = version == (1, 0)
    read = np.lib.format.read_array_header_1_0 if is_first else np.lib.format.read_array_header_2_0
    shape, _, dtype = read(stream)
    return shape, dtype


def _check_shape(path: Path, name: str, shape: tuple[int, ...]) -> None:
    found = f"{path}: found the array '{name}' of shape {shape}"
    if name == "ranges":
        check_limit(max(shape[:1], default=0), "scans", found)
        check_limit(max(shape[1:], default=0), "beams", found)
        check_limit(math.prod(shape), "readings", found)
    elif name in SETTINGS:
        check_limit(math.prod(shape), "beams", found)
    else:
        check_limit(math.prod(shape) / 3, "scans", found)


def _table(path: Path, arrays: dict[str, NDArray[np.float64]]) -> ScanTable:
    if "ranges" not in arrays or arrays["ranges"].ndim != 2 or arrays["ranges"].shape[1] < 2:
        found = f"of shape {arrays['ranges'].shape}" if "ranges" in arrays else "missing"
        raise LogError(f"{path}: the array 'ranges' is {found}, expected (n_scans, n_beams)")
    n_scans = len(arrays["ranges"])
    columns = {}
    for name, shape in {"stamps": (n_scans,), **dict.fromkeys(_THREE, (n_scans, 3))}.items():
        if name in arrays and arrays[name].shape != shape:
            raise LogError(f"{path}: the array '{name}' is of shape {arrays[name].shape}, expected {shape}")
    if "stamps" in arrays:
        columns[STAMP] = arrays["stamps"]
    for name, names in _THREE.items():
        if name in arrays:
            columns |= dict(zip(names, arrays[name].T, strict=True))
    settings = {name: arrays[name].ravel().tolist() for name in SETTINGS if name in arrays}
    return ScanTable(settings=settings, columns=columns, ranges=arrays["ranges"].astype(np.float32))
