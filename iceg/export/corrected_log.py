"""The recorded log with the trajectory of a run in the place of its odometry, as CARMEN's messages."""

import dataclasses
from pathlib import Path

from iceg.export.options import ExportError, ExportOptions
from iceg.export.recorded_log import read_log_of_run
from iceg.results import whole_results
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
    from frontends.logs.carmen_writer import write_carmen

    if options.log is None:
        raise ExportError("a corrected log holds the scans: give the recorded log with --log")
    log = read_log_of_run(directory, options.log)
    with whole_results(directory):
        trajectory = read_tum(directory / "trajectory.tum")
    write_carmen(path, dataclasses.replace(log, odometry=trajectory.poses), range_decimals=6)
