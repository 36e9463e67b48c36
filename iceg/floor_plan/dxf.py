"""A floor plan as DXF for CAD: metres, walls and walls in doubt on layers of their own."""

import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from graph.atomic import write_atomically
from iceg.floor_plan.config import FloorPlanError
from iceg.floor_plan.plan import FloorPlan

WALLS, DOUBT = "WALLS", "WALLS_IN_DOUBT"
_BLACK_OR_WHITE, _RED = 7, 1  # AutoCAD's colour index
_METRES = 6  # $INSUNITS


def write_dxf(plan: FloorPlan, path: Path) -> None:
    """Write a plan as DXF R2010, a LINE for each wall: the same bytes whenever it is written.

    Args:
        plan: the walls.
        path: the file, written atomically.

    Raises:
        FloorPlanError: `ezdxf` is not installed.
    """
    try:
        import ezdxf
    except ImportError as err:
        raise FloorPlanError(f"{path}: DXF needs the package ezdxf: pip install 'iceg[dxf]'") from err
    text = io.StringIO()
    with _without_date():
        document = ezdxf.new("R2010", units=_METRES)
        space = document.modelspace()
        for layer, colour, walls in ((WALLS, _BLACK_OR_WHITE, plan.sure), (DOUBT, _RED, plan.doubtful)):
            document.layers.add(layer, color=colour)
            for first, second in walls.round(6).tolist():
                space.add_line(first, second, dxfattribs={"layer": layer})
        document.write(text)
    write_atomically(path, text.getvalue().encode())


@contextmanager
def _without_date() -> Iterator[None]:
    """A document made and written in the block tells no time and has no random number."""
    import ezdxf

    before = ezdxf.options.write_fixed_meta_data_for_testing
    ezdxf.options.write_fixed_meta_data_for_testing = True
    try:
        yield
    finally:
        ezdxf.options.write_fixed_meta_data_for_testing = before
