"""What became of a cell, and how it is kept so that it need not be run again."""

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from graph.file_names import readable
from graph.publish import publishing
from iceg.evaluation.bench.cell import Cell
from iceg.evaluation.bench.tables import Row

Figures = dict[str, float | int]

FIGURES_FILE, TRAJECTORY_FILE = "figures.json", "trajectory.tum"
_RECORD_FILE = "result.json"


@dataclass(frozen=True, slots=True, kw_only=True)
class Outcome:
    """A cell with its figures, or with the reason why it has none.

    Attributes:
        cell: what was run.
        figures: accuracy and cost; empty when it failed.
        trajectory: the content of its `trajectory.tum`; empty when it failed.
        error: why it failed; None when it did not.
        is_reused: whether it is from an earlier benchmark.
    """

    cell: Cell
    figures: Figures
    trajectory: bytes
    error: str | None = None
    is_reused: bool = False

    def row(self) -> Row:
        """All of it but the trajectory as one row of a table."""
        cell = self.cell
        head: Row = {"run": cell.name, "method": cell.label, "log": cell.log.name, "seed": cell.seed}
        swept = {
            key: value if isinstance(value, float | int | str) else str(value) for key, value in cell.swept.items()
        }
        status = "failed" if self.error else "done"
        return {**head, **swept, "status": status, "error": self.error, **self.figures}


def failed(cell: Cell, error: str) -> Outcome:
    """The outcome of a cell that could not be run to its end."""
    return Outcome(cell=cell, figures={}, trajectory=b"", error=error)


def keep(outcome: Outcome, digest: str, cells: Path) -> None:
    """Write an outcome into a folder of its own, record and trajectory in one step.

    Args:
        outcome: what to keep.
        digest: of all that decided about it.
        cells: the folder of all cells.
    """
    folder = cells / outcome.cell.folder
    content = {
        "run": outcome.cell.name,
        "digest": digest,
        "error": outcome.error,
        "figures": outcome.figures,
        "cell": asdict(outcome.cell),
    }
    with publishing(folder, replaces=(TRAJECTORY_FILE,)) as staging:
        if outcome.error is None:
            (staging / TRAJECTORY_FILE).write_bytes(outcome.trajectory)
        record = json.dumps(content, indent=2, ensure_ascii=False, default=str)
        (staging / _RECORD_FILE).write_bytes(readable(record).encode() + b"\n")


def kept(cell: Cell, digest: str, cells: Path) -> Outcome | None:
    """The outcome of the same cell from an earlier benchmark; None when there is none, or it failed."""
    folder = cells / cell.folder
    try:
        record = json.loads((folder / _RECORD_FILE).read_text(encoding="utf-8"))
        trajectory = (folder / TRAJECTORY_FILE).read_bytes()
    except (OSError, ValueError):
        return None
    if not isinstance(record, dict) or record.get("digest") != digest or record.get("error") is not None:
        return None
    return Outcome(cell=cell, figures=record["figures"], trajectory=trajectory, is_reused=True)


def format_figures(figures: Mapping[str, Any]) -> bytes:
    """Figures as JSON, in full precision."""
    return json.dumps(dict(figures), allow_nan=False).encode()


def parse_figures(content: bytes) -> Figures:
    """What `format_figures` wrote."""
    figures: Figures = json.loads(content)
    return figures
