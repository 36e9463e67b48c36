"""The recorded log of a run, read as the run has read it."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from frontends.scan import Log
from iceg.config import read_config
from iceg.export.options import ExportError
from iceg.results import read_summary, whole_results
from iceg.slam.kept_scans import KeptScans
from iceg.tum import read_tum


def read_log_of_run(directory: Path, path: Path) -> Log:
    """Read a log with the settings of a run, its beams the way round that the run has taken them.

    Args:
        directory: of the run.
        path: the log.

    Raises:
        IcegError: a file cannot be read, or the log is not the one that was run.
    """
    from frontends.logs import read_log

    settings = dataclasses.asdict(read_config(directory / "config.toml").log)
    with whole_results(directory):
        n_scans, summary = len(read_tum(directory / "trajectory.tum")), read_summary(directory)
    log = read_log(path, skip_bad_lines=bool(summary.get("skipped_lines")), **settings)
    kept = kept_scans(summary)
    if kept is not None and len(log) == kept.recorded:
        log = kept.of(log)
    if len(log) != n_scans:
        raise ExportError(f"{path}: holds {len(log)} scans, the trajectory {n_scans}; expected the log of the run")
    return _as_taken(log, summary)


def kept_scans(summary: Mapping[str, Any]) -> KeptScans | None:
    """Which scans of the recorded log a run has taken, as its summary says; None where it has cut none."""
    cut = summary.get("cut")
    return KeptScans.from_record(cut) if isinstance(cut, dict) else None


def _as_taken(log: Log, summary: Mapping[str, Any]) -> Log:
    """The log with its laser as the run has taken it: where it sits, and its beams the other way round, perhaps."""
    from frontends.logs.laser_mount import placed
    from iceg.slam.tracking.laser_orientation import LaserOrientation

    warnings = summary.get("warnings", [])
    if mount := summary.get("mount"):
        log = placed(log, *(float(mount[name]) for name in ("x_m", "y_m", "heading_rad")))
    mirrored = LaserOrientation(is_mirrored=True).corrected(log)
    return mirrored if mirrored.warnings[-1] in warnings else log
