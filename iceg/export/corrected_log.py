"""The recorded log with the trajectory of a run in the place of its odometry, as CARMEN's messages."""

import dataclasses
from pathlib import Path

from frontends.scan import Log
from iceg.config import read_config
from iceg.export.options import ExportError, ExportOptions
from iceg.results import read_summary, whole_results
from iceg.tum import read_tum


def write_corrected_carmen(directory: Path, path: Path, options: ExportOptions) -> None:
    """Write the scans with the poses of the run, both as the robot's odometry and as the pose of the laser.

    Args:
        directory: of the run.
        path: the file, compressed when it ends with .gz.
        options: with the log, which is read with the settings of the run.

    Raises:
        IcegError: there is no log, or not the one that was run.
    """
    from frontends.logs import read_log
    from frontends.logs.carmen_writer import write_carmen

    if options.log is None:
        raise ExportError("a corrected log holds the scans: give the recorded log with --log")
    settings = dataclasses.asdict(read_config(directory / "config.toml").log)
    with whole_results(directory):
        trajectory, summary = read_tum(directory / "trajectory.tum"), read_summary(directory)
    log = read_log(options.log, skip_bad_lines=bool(summary.get("skipped_lines")), **settings)
    if len(log) != len(trajectory):
        raise ExportError(
            f"{options.log}: holds {len(log)} scans, the trajectory {len(trajectory)}; expected the log of the run"
        )
    log = _as_taken(log, summary.get("warnings", []))
    write_carmen(path, dataclasses.replace(log, odometry=trajectory.poses), range_decimals=6)


def _as_taken(log: Log, warnings: list[str]) -> Log:
    """The log with its beams the other way round if the run has taken them so, as its warnings say."""
    from iceg.slam.tracking.laser_orientation import LaserOrientation

    mirrored = LaserOrientation(is_mirrored=True).corrected(log)
    return mirrored if mirrored.warnings[-1] in warnings else log
