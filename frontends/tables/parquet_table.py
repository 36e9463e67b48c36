"""Tables of scans as Parquet: the columns of the layout, and what holds for all in the schema's metadata."""

import json
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

from frontends.logs.errors import LogError
from frontends.plain_numbers import plain_numbers
from frontends.scan import Log, ScanError
from frontends.tables.csv_table import check_laser
from frontends.tables.layout import (
    RANGE,
    SETTINGS,
    ScanTable,
    is_known,
    is_range,
    left_out,
    log_of,
    range_columns,
    table_of,
    unknown_columns,
)
from graph.atomic import replacing
from graph.errors import reason
from graph.files import check_file
from graph.limits import LimitError, check_limit

_MAGIC = b"PAR1"
_METADATA = b"iceg"


def is_parquet(head: bytes) -> bool:
    """Whether a file that begins with `head` is Parquet."""
    return head.startswith(_MAGIC)


def read_parquet(
    path: Path | str, *, laser: str = "front", range_min: float | None = None, range_max: float | None = None
) -> Log:
    """Read a table of scans; a null is no return. Settings stand in the metadata, or in columns of their names.

    Args:
        path: the table.
        laser: "front": a table knows no other.
        range_min: shortest return [m]; None for what the table states, else 2 cm.
        range_max: longest return [m]; None for what the table states, else it is told from the readings.

    Raises:
        LogError: pyarrow is not installed, the file cannot be read, is larger than `graph.limits` allows, or the
            numbers make no log.
    """
    path = Path(path)
    check_laser(path, laser)
    check_file(path, "log_bytes", LogError, "a log")
    parquet = _pyarrow(path)
    try:
        _check_sizes(path, parquet.ParquetFile(path))
        table = parquet.read_table(path)
        said = json.loads((table.schema.metadata or {}).get(_METADATA, b"{}"))
        settings = {str(name): [float(value) for value in values] for name, values in said.items()}
        unknown = [
            *unknown_columns(table.column_names),
            *left_out(settings.keys() - set(SETTINGS), SETTINGS, "settings", ", ".join(SETTINGS)),
        ]
        names = [name for name in table.column_names if is_known(name)]
        columns = {name: plain_numbers(name, table[name].to_numpy(), np.float64) for name in names}
    except LimitError as error:
        raise LogError(str(error)) from error
    except ScanError as error:
        raise LogError(f"{path}: {error}") from error
    except (OSError, ValueError, TypeError, AttributeError) as error:  # pyarrow's own are ValueErrors
        raise LogError(f"{path}: cannot be read as a table of numbers ({' '.join(str(error).split())})") from error
    beams = range_columns(path, names)
    log = log_of(
        path,
        ScanTable(
            settings={name: values for name, values in settings.items() if name in SETTINGS},
            columns={name: column for name, column in columns.items() if not is_range(name)},
            ranges=np.column_stack([columns[name] for name in beams]).astype(np.float32),
        ),
        range_min,
        range_max,
    )
    return replace(log, warnings=(*unknown, *log.warnings))


def write_parquet(path: Path | str, log: Log) -> None:
    """Write a log as a table; reading it back gives the same numbers.

    Raises:
        LogError: pyarrow is not installed, or the file cannot be written.
    """
    path, table = Path(path), table_of(log)
    parquet = _pyarrow(path)
    import pyarrow as pa

    columns = {name: pa.array(column) for name, column in table.columns.items()}
    for beam, readings in enumerate(np.ascontiguousarray(table.ranges.T)):
        columns[f"{RANGE}{beam}"] = pa.array(readings)
    metadata = {_METADATA: json.dumps({name: list(values) for name, values in table.settings.items()}).encode()}
    try:
        with replacing(path) as file:
            parquet.write_table(pa.table(columns).replace_schema_metadata(metadata), file)
    except OSError as error:
        raise LogError(f"{path}: cannot be written ({reason(error)})") from error


def _check_sizes(path: Path, file: Any) -> None:  # noqa: ANN401
    """Refuse what would not fit, by what the end of the file states, before any is unpacked.

    Raises:
        LimitError: more bytes, scans, beams or readings than allowed.
    """
    stated = file.metadata
    total = sum(stated.row_group(group).total_byte_size for group in range(stated.num_row_groups))
    check_limit(total, "log_bytes", f"{path}: found {total} bytes when unpacked")
    found = f"{path}: found {stated.num_rows} rows of {stated.num_columns} columns"
    check_limit(stated.num_rows, "scans", found)
    n_beams = sum(map(is_range, file.schema_arrow.names))
    check_limit(n_beams, "beams", found)
    check_limit(stated.num_rows * n_beams, "readings", found)


def _pyarrow(path: Path) -> ModuleType:
    try:
        from pyarrow import parquet
    except ImportError as error:
        raise LogError(f"{path}: Parquet needs pyarrow, which is not installed: pip install 'iceg[tables]'") from error
    module: ModuleType = parquet
    return module
