"""Floor plans of a run in the formats of drawing programs."""

from pathlib import Path

from iceg.export.options import ExportOptions
from iceg.floor_plan.config import FloorPlanError
from iceg.floor_plan.dxf import write_dxf
from iceg.floor_plan.pdf import write_pdf
from iceg.floor_plan.plan import FloorPlan, floor_plan
from iceg.floor_plan.svg import write_svg
from iceg.run_folder import read_run_folder


def write_floor_plan_svg(directory: Path, path: Path, _options: ExportOptions) -> None:
    """Write the floor plan of the run in a folder as SVG."""
    write_svg(_plan(directory), path)


def write_floor_plan_pdf(directory: Path, path: Path, _options: ExportOptions) -> None:
    """Write the floor plan of the run in a folder as PDF."""
    write_pdf(_plan(directory), path)


def write_floor_plan_dxf(directory: Path, path: Path, _options: ExportOptions) -> None:
    """Write the floor plan of the run in a folder as DXF."""
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
