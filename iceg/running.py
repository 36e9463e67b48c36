"""A log run from Python: what a person waits for is shown."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from types import NoneType
from typing import TYPE_CHECKING

from frontends.checked_arguments import expect
from frontends.scan import Log
from iceg.config import Config
from iceg.corrections.corrections import CORRECTIONS_EXPECTED, Corrections
from iceg.corrections.manual_closures import ManualClosure
from iceg.slam.progress import ProgressCallback

if TYPE_CHECKING:
    from iceg.run_result.slam_result import SlamResult
    from iceg.slam.stages import Stages


def run(
    log: Log | Path | str,
    config: Config | None = None,
    progress: ProgressCallback | bool | None = True,
    *,
    stages: "Stages | None" = None,
    closures: Sequence[ManualClosure] = (),
    corrections: Corrections | None = None,
) -> "SlamResult":
    """Estimate the trajectory and the maps of a log.

    Args:
        log: the log, or the path of a recording, which `config.log` says how to read.
        config: settings; the defaults when left out.
        progress: True for a bar, on standard error or in the notebook; False or None for none; else called as scans are
            matched, and when a stage begins.
        stages: those that are replaced by functions of one's own, the matcher among them.
        closures: loops closed by hand, besides those of the corrections.
        corrections: what a person corrects, scans counted as in `log`.

    Returns:
        Everything that was found.

    Raises:
        IcegError: a recording that cannot be read, a correction that does not fit the log, or a stage that returns what
            is of no use.
        TypeError: an argument of another type.
    """
    from frontends.logs import read_log
    from iceg import pipeline
    from iceg.kernels.ahead import compiling_ahead
    from iceg.show.progress import ProgressBar, compiling_bar
    from iceg.slam.stages import Stages

    expect(log, (Log, Path, str), "log", "iceg.Log, or the path of a recording")
    expect(config, (Config, NoneType), "config", "iceg.Config, as iceg.read_config(path) gives")
    expect(corrections, (Corrections, NoneType), "corrections", CORRECTIONS_EXPECTED)
    expect(stages, (Stages, NoneType), "stages", "iceg.Stages")
    asked = config or Config()
    found = log if isinstance(log, Log) else read_log(log, **dataclasses.asdict(asked.log))

    def run_told(callback: ProgressCallback | None) -> "SlamResult":
        return pipeline.run(found, asked, callback, stages=stages, closures=closures, corrections=corrections)

    with compiling_ahead() as kernels:
        if progress is not True:
            result = run_told(kernels.before_each_stage(progress or None))
            kernels.wait()
            return result
        with compiling_bar() as told:
            kernels.wait_for("matching", told)
        with ProgressBar(found) as bar:
            result = run_told(kernels.before_each_stage(bar, bar.compiling))
            kernels.wait(bar.compiling)
        return result
