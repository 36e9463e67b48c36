"""The report of a run: one page that shows its map, replays it and says how good it is."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from graph.atomic import replacing
from graph.file_names import readable
from iceg.report.assembly import assemble
from iceg.report.payload import page_payload, stages_payload

if TYPE_CHECKING:
    from iceg.run_result.slam_result import SlamResult

REPORT = "report.html"
_AT_ONCE = 1 << 20
"""Characters that are encoded together."""


def write_report(result: "SlamResult", path: Path | str, truth: NDArray[np.float64] | None = None) -> None:
    """Write the report of a run.

    The same run gives the same bytes; the seconds a stage took stand on a line of their own.

    Args:
        result: of the run.
        path: the file, replaced when it exists.
        truth: (n_scans, 3) true poses, in any frame; those of the log when left out.
    """
    page = assemble(readable(result.log.path.name), page_payload(result, truth), stages_payload(result))
    with replacing(Path(path)) as stream:
        for piece in page:
            for start in range(0, len(piece), _AT_ONCE):
                stream.write(piece[start : start + _AT_ONCE].encode())
