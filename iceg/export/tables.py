"""The tables of a run, one file each, in a folder."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from graph.errors import reason
from graph.publish import publishing
from iceg.export.options import ExportError, ExportOptions
from iceg.folder_tables import read_run_tables
from iceg.result_tables import TABLES, write_csv_table, write_parquet_table


def write_csv_tables(directory: Path, path: Path, options: ExportOptions) -> None:
    """`trajectory.csv`, `key_poses.csv`, `closures.csv`, `landmarks.csv` and `factors.csv`."""
    del options
    _write_all(directory, path, "csv", write_csv_table)


def write_parquet_tables(directory: Path, path: Path, options: ExportOptions) -> None:
    """The same as Parquet."""
    del options
    _write_all(directory, path, "parquet", write_parquet_table)


def _write_all(
    directory: Path, path: Path, ending: str, write: Callable[[Path, dict[str, NDArray[Any]]], None]
) -> None:
    tables = read_run_tables(directory)
    names = {table: f"{table}.{ending}" for table in TABLES}
    try:
        with publishing(path, replaces=set(names.values())) as staging:
            for table, name in names.items():
                write(staging / name, tables.columns(table))
    except OSError as err:
        raise ExportError(f"{path}: cannot be written: {reason(err)}") from err
