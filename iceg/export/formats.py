"""What a run can be exported to: a row for each format."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path

from iceg.export.options import ExportError, ExportOptions
from iceg.results import RESULT_FILES, ResultsError

Writer = Callable[[Path, Path, ExportOptions], None]
"""Writes what the run in a folder has to a file or folder."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Format:
    """One format.

    Attributes:
        writer: module in `iceg.export` and function, loaded when needed.
        name: of the file or folder, in that of the run, unless another is given.
        is_folder: whether it is several files in a folder.
    """

    writer: str
    name: str
    is_folder: bool = False


FORMATS: Mapping[str, Format] = {
    "tum": Format(writer="trajectories.write_tum", name="exported.tum"),
    "euroc": Format(writer="trajectories.write_euroc", name="trajectory.euroc.csv"),
    "kitti": Format(writer="trajectories.write_kitti", name="trajectory.kitti.txt"),
    "carmen": Format(writer="corrected_log.write_corrected_carmen", name="corrected.clf"),
    "bag": Format(writer="corrected_bag.write_corrected_bag", name="bag", is_folder=True),
    "g2o": Format(writer="graphs.write_plain_g2o", name="exported.g2o"),
    "gtsam": Format(writer="graphs.write_gtsam", name="gtsam", is_folder=True),
    "csv": Format(writer="tables.write_csv_tables", name="csv", is_folder=True),
    "floorplan.svg": Format(writer="floor_plans.write_floor_plan_svg", name="floorplan.svg"),
    "floorplan.pdf": Format(writer="floor_plans.write_floor_plan_pdf", name="floorplan.pdf"),
    "floorplan.dxf": Format(writer="floor_plans.write_floor_plan_dxf", name="floorplan.dxf"),
    "mcap": Format(writer="mcap_recording.write_mcap", name="mcap", is_folder=True),
    "parquet": Format(writer="tables.write_parquet_tables", name="parquet", is_folder=True),
    "rerun": Format(writer="rerun_recording.write_rerun", name="run.rrd"),
}
"""By the name that asks for it."""


def export_results(
    directory: Path | str, to: str, path: Path | str | None = None, options: ExportOptions | None = None
) -> Path:
    """Write a run's results as another program reads them.

    Args:
        directory: of the run.
        to: one of `FORMATS`.
        path: the file, or the folder of several, replaced if it is there; in the run's folder when left out. Not what
            is exported: the recorded log, or a file of the results.
        options: what some formats need.

    Returns:
        The file or folder.

    Raises:
        IcegError: the folder is none of a run, or lacks what the format holds.
    """
    directory = Path(directory)
    if to not in FORMATS:
        raise ExportError(f"found the format '{to[:40]}', expected one of {', '.join(FORMATS)}")
    if not directory.is_dir():
        raise ResultsError(f"{directory}: is no folder, expected one that a run has written")
    form = FORMATS[to]
    target = directory / form.name if path is None else Path(path)
    if target.exists() and target.is_dir() != form.is_folder:
        found, expected = ("a folder", "a file") if target.is_dir() else ("a file", "a folder")
        raise ExportError(f"{target}: is {found}, expected {expected} for {to}")
    options = options or ExportOptions()
    _check_is_another(target, directory, options.log, to)
    module, _, function = form.writer.partition(".")
    writer: Writer = getattr(import_module(f"iceg.export.{module}"), function)
    writer(directory, target, options)
    return target


def _check_is_another(target: Path, directory: Path, log: Path | None, to: str) -> None:
    """Refuse to write over what is exported.

    Raises:
        ExportError: the target is the folder of the run, a file of its results or the recorded log.
    """
    place = target.resolve()
    if place == directory.resolve():
        raise ExportError(f"{target}: is the folder of the run, expected another one for {to}")
    if log is not None and place == log.resolve():
        raise ExportError(f"{target}: holds the recorded log itself, expected another place for {to}")
    if place.parent == directory.resolve() and place.name in RESULT_FILES:
        raise ExportError(f"{target}: is a file of the results, expected another one for {to}")
