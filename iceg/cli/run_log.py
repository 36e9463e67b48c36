"""From a log to a folder of results: `iceg run` once its arguments are known."""

import dataclasses
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from graph.counted import counted
from iceg.cli.telling import Telling
from iceg.config import Config
from iceg.slam.run_warning import RunWarning, in_short

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from frontends.scan import Log
    from iceg.corrections.corrections import Corrections
    from iceg.kernels.ahead import KernelsAhead
    from iceg.run_result.slam_result import SlamResult
    from iceg.slam.progress import ProgressCallback

_MANY_CARRIED = 0.02
"""More than this share of scans without a match is worth a warning."""


def run_log(
    path: Path,
    directory: Path,
    config: Config,
    *,
    overwrite: bool,
    skip_bad_lines: bool,
    closures: Path | None = None,
    corrections: Path | None = None,
    report: bool = True,
    truth: Path | None = None,
    as_json: bool = False,
) -> None:
    """Read a log, run, write the results, and say on the way what a person should know.

    Args:
        path: the log.
        directory: where the results go.
        config: the settings.
        overwrite: whether earlier results may be replaced.
        skip_bad_lines: pass over malformed lines and count them.
        closures: a file of loops closed by hand.
        corrections: a file of corrections.
        report: whether to write the page that shows the run.
        truth: a file of the true poses, by which that page judges the run.
        as_json: print the figures as one JSON object instead of sentences.

    Raises:
        IcegError: the log cannot be read, or the results not be written.
    """
    from iceg.kernels.ahead import compiling_ahead
    from iceg.results import check_directory, write_results
    from iceg.show.progress import ProgressBar, compile_note

    check_directory(directory, overwrite=overwrite)
    before = written_at(directory)
    started = time.perf_counter()
    asked, beside = _read_corrections(corrections, closures)  # before the log, which may be long
    true_poses = None if truth is None else _read_truth(truth)
    try:
        with compiling_ahead() as kernels:
            log = _read_while_compiling(path, config, kernels, skip_bad_lines=skip_bad_lines)
            if truth is not None and true_poses is not None:
                log = _with_truth(log, true_poses, truth)
            with compile_note(), ProgressBar(log) as progress:
                told = kernels.before_each_stage(progress, progress.compiling)
                result = _corrected_run(log, config, told, asked)
                write_results(
                    result, directory, overwrite=overwrite, report=report, beside=beside, progress=progress.writing
                )
                kernels.wait(progress.compiling)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(what_was_kept(directory, before)) from None
    with Telling(as_json=as_json) as telling:
        _tell_results(result, time.perf_counter() - started, telling)
        _tell_warnings(result, log.warnings)
        page = "report.html, " if report else ""
        files = f"{page}map.png, map.pgm, trajectory.tum, graph.g2o, summary.json and more"
        telling.say(f"Results are in {directory}: {files}")
        _tell_older_corrections(directory, is_given=beside is not None)
        tell_stale_files(directory)
        telling.keep(results=str(directory))


def _read_while_compiling(path: Path, config: Config, kernels: "KernelsAhead", *, skip_bad_lines: bool) -> "Log":
    """The log; with what the run needs loaded, and the kernels compiled that it needs first."""
    from frontends.logs import read_log
    from iceg.show.progress import compiling_bar, reading_bar

    with reading_bar(path) as reading:
        log = read_log(path, skip_bad_lines=skip_bad_lines, progress=reading, **dataclasses.asdict(config.log))
    tell_warnings(log)
    import iceg.pipeline  # noqa: F401 while others compile

    with compiling_bar() as told:
        kernels.wait_for("matching", told)
    return log


def _read_corrections(
    corrections: Path | None, closures: Path | None
) -> "tuple[Corrections | None, dict[str, str] | None]":
    """What is corrected, and the text of it as it is kept beside the results, if that is all that was corrected."""
    given = [path for path in (corrections, closures) if path is not None]
    if not given:
        return None, None
    from iceg.corrections.reading import read_all_corrections, text_of_corrections
    from iceg.view.session import CORRECTIONS

    asked = read_all_corrections(given)
    text = text_of_corrections(corrections) if corrections is not None and closures is None else None
    return asked, None if text is None else {CORRECTIONS: text}


def _read_truth(path: Path) -> "NDArray[np.float64]":
    from iceg.evaluation.trajectory import read_truth_csv

    return read_truth_csv(path)


def _with_truth(log: "Log", truth: "NDArray[np.float64]", path: Path) -> "Log":
    from iceg.evaluation.trajectory import check_one_row_per_scan

    check_one_row_per_scan(log.odometry, truth, path)
    return dataclasses.replace(log, truth=truth)


def _corrected_run(
    log: "Log", config: Config, progress: "ProgressCallback | None", corrections: "Corrections | None"
) -> "SlamResult":
    from graph.errors import GraphError
    from iceg.pipeline import run

    if corrections is not None:
        corrections.check(len(log))
    try:
        return run(log, config, progress, corrections=corrections)
    except GraphError as err:
        raise GraphError(f"{log.path}: {err}") from err


def tell_result_warnings(result: "SlamResult") -> None:
    """Print what a run warns of."""
    _warn(in_short([*_tracking_warnings(result), *result.run_warnings], "warnings and lost_at_scans in summary.json"))


def tell_warnings(log: "Log") -> None:
    """Print what reading a log has found."""
    _warn(log.warnings)


def tell_stale_files(directory: Path) -> None:
    """Print which pictures and exports in a folder are of earlier results."""
    from iceg.derived_files import stale_files

    names = stale_files(directory)
    if names:
        are = f"{', '.join(names)} {'is' if len(names) == 1 else 'are'} of earlier results"
        _warn([f"{directory}: {are}: make anew with iceg plot or iceg export, or remove"])


def written_at(directory: Path) -> int | None:
    """When the results in a folder were completed; None when there are none."""
    summary = directory / "summary.json"
    return summary.stat().st_mtime_ns if summary.exists() else None


def what_was_kept(directory: Path, before: int | None) -> str:
    """What an interrupted command leaves in a folder, given when its results were completed before."""
    now = written_at(directory)
    if now is None:
        return f"nothing was written to {directory}"
    return (
        f"the earlier results in {directory} are untouched"
        if now == before
        else f"the results in {directory} are complete"
    )


def _tell_results(result: "SlamResult", seconds: float, telling: Telling) -> None:
    """The figures of a run; landmarks and closures are counted as the picture shows them."""
    from iceg.show.progress import real_time_factor
    from iceg.slam.closures.closure import joined_scans

    n_landmarks, n_closures = len(result.landmarks.settled()), len(joined_scans(result.closures))
    factor = real_time_factor(result.log.stamps, seconds)
    speed = f", {factor:.0f}x real time" if factor else ""
    telling.say(f"{counted(len(result.log), 'scan')} in {seconds:.1f} s{speed}, everything included")
    tried = len(result.log) - 1
    share = 1.0 - result.summary["scans_carried_by_odometry"] / tried if tried else None
    matched = "" if share is None else f", {100 * share:.1f} % of the matches accepted"
    landmarks = f"{counted(n_landmarks, 'landmark')} ({len(result.landmarks)} with those seen rarely or expired)"
    telling.say(f"{counted(len(result.key_scans), 'key pose')}, {landmarks}{matched}")
    closures = (
        f"{n_closures} of {len(result.closures)} loop closures tried hold" if result.closures else "no loop closed"
    )
    telling.say(f"{closures}{_moved(result)}")
    telling.keep(
        log=result.log.path.name,
        scans=len(result.log),
        seconds=seconds,
        real_time_factor=factor,
        key_poses=len(result.key_scans),
        landmarks=n_landmarks,
        landmarks_in_all=len(result.landmarks),
        matches_accepted=share,
        closures=n_closures,
        closures_tried=len(result.closures),
        warnings=result.summary["warnings"],
    )


def _moved(result: "SlamResult") -> str:
    """What the offline finish did."""
    rounds = result.summary["finish"]
    if not rounds:
        return ""
    joint = f", {1000 * rounds[-1]['mean_move']:.0f} mm by poses and map together" if rounds[-1]["residual"] else ""
    rematched = f"{1000 * sum(done['mean_move'] for done in rounds if done['stage'] != 'joint'):.0f} mm by factors"
    return f"; the finish moved key poses by {rematched}{joint}"


def _tell_warnings(result: "SlamResult", told: Sequence[str]) -> None:
    """What a person should know, but for what was told when the log had been read."""
    from iceg.results import stamps_warning

    _warn([warning for warning in result.log.warnings if warning not in told])
    tell_result_warnings(result)
    _warn([warning for warning in [stamps_warning(result)] if warning])


def _tell_older_corrections(directory: Path, *, is_given: bool) -> None:
    """Warn of corrections of an earlier run, which are nobody's to delete."""
    from iceg.view.session import CORRECTIONS

    path = directory / CORRECTIONS
    if not is_given and path.exists():
        sentence = f"{path} was there before and corrects nothing of this run, but iceg view would apply it: "
        _warn([f"{sentence}move it away if it is of another log, or pass it with --corrections"])


def _tracking_warnings(result: "SlamResult") -> list[RunWarning]:
    """What the counts of a run warn of: where tracking began anew, and how much only odometry tells."""
    warned = {found["scan"] for found in result.summary["breaks"]}
    lost = [scan for scan in result.summary["lost_at_scans"] if scan not in warned]
    warnings = [_began_anew(scan, by_odometry=result.log.has_odometry) for scan in lost]
    carried, n_scans = result.summary["scans_carried_by_odometry"], len(result.log)
    if carried > _MANY_CARRIED * n_scans:
        guide = "odometry alone tells" if result.log.has_odometry else "nothing but the velocity before tells"
        sentence = f"{carried} of {n_scans} scans matched nothing: {guide} the way there"
        warnings.append(RunWarning(kind="carried", sentence=sentence))
    return warnings


def _began_anew(scan: int, *, by_odometry: bool) -> RunWarning:
    """What to say where tracking began anew, and the path is not broken."""
    if by_odometry:
        sentence = f"nothing matched what was known before scan {scan}; odometry tells how what follows lies to it"
        return RunWarning(kind="new ground", sentence=sentence, scan=scan)
    sentence = f"tracking was lost at scan {scan}; loop closures tie what follows to the rest"
    return RunWarning(kind="lost", sentence=sentence, scan=scan)


def _warn(sentences: Sequence[str]) -> None:
    for sentence in dict.fromkeys(sentences):
        print(f"warning: {sentence}", file=sys.stderr)
