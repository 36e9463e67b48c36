"""What a run can be exported to: a writer for each name."""

from collections.abc import Callable, Mapping
from pathlib import Path

from iceg.floor_plan.config import FloorPlanError
from iceg.floor_plan.plan import FloorPlan, floor_plan
from iceg.run_folder import read_run_folder

Writer = Callable[[Path, Path], None]
"""Writes what the run in a folder has to a file."""


def export(directory: Path, name: str, path: Path | None = None) -> Path:
    """Write a run's results as another program reads them.

    Args:
        directory: of the run.
        name: one of `FORMATS`.
        path: the file, replaced if it exists; named like the format in the run's folder when left out.

    Returns:
        The file.

    Raises:
        IcegError: the folder is none of a run, or lacks what the format holds.
    """
    path = directory / name if path is None else path
    FORMATS[name](directory, path)
    return path


def _floor_plan_svg(directory: Path, path: Path) -> None:
    from iceg.floor_plan.svg import write_svg

    write_svg(_plan(directory), path)


def _floor_plan_pdf(directory: Path, path: Path) -> None:
    from iceg.floor_plan.pdf import write_pdf

    write_pdf(_plan(directory), path)


def _floor_plan_dxf(directory: Path, path: Path) -> None:
    from iceg.floor_plan.dxf import write_dxf

    write_dxf(_plan(directory), path)


def _plan(directory: Path) -> FloorPlan:
    run = read_run_folder(directory)
    plan = floor_plan(run.walls, name=run.log_name)
    if not len(plan.walls):
        raise FloorPlanError(
            f"{directory / 'walls.csv'}: tells of no walls, expected those of a run that has refined poses and map "
            "together (finish.joint.enabled): run the log again"
        )
    return plan


FORMATS: Mapping[str, Writer] = {
    "floorplan.svg": _floor_plan_svg,
    "floorplan.pdf": _floor_plan_pdf,
    "floorplan.dxf": _floor_plan_dxf,
}
"""By name, which ends as the file does."""
