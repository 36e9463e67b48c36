"""The folder a run leaves behind: plain files, complete or not there at all."""

import hashlib
import json
import os
import platform
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from frontends.checked_arguments import type_name
from graph.deferred_signals import signals_deferred
from graph.errors import IcegError, reason
from graph.files import read_text
from graph.publish import check_replaceable, publishing, settle
from iceg.beside import in_second_process
from iceg.config import format_config
from iceg.memory import peak_memory_mb
from iceg.plain_json import format_json
from iceg.slam.closures.closure import CLOSURE_COLUMNS
from iceg.slam.stage_clock import StageClock
from iceg.stamps import repaired_stamps, steps_back
from iceg.tables import TableError, read_csv_table
from iceg.tum import format_tum

if TYPE_CHECKING:
    from iceg.run_result.slam_result import SlamResult

FINDINGS = "run.npz"
"""What the run found before it concluded, for `iceg resolve`."""
RESULT_FILES = (
    "trajectory.tum",
    "graph.g2o",
    "covariances.csv",
    "closures.csv",
    "walls.csv",
    "map.pgm",
    "map.yaml",
    "map.png",
    "features.geojson",
    "config.toml",
    FINDINGS,
    "report.html",
    "summary.json",
)

_VOUCHED_FOR = (
    "trajectory.tum",
    "graph.g2o",
    "covariances.csv",
    "closures.csv",
    "walls.csv",
    "features.geojson",
    FINDINGS,
)
"""Files whose digests `summary.json` holds: those that are read together. Maps and settings are there to be edited."""
_WRITTEN_ASIDE = ("picture",)
"""Writers that a second process runs: a quarter of the time of all."""
_COVARIANCE_COLUMNS = ("scan", "x_m", "y_m", "theta_rad", "xx", "xy", "xtheta", "yy", "ytheta", "thetatheta")
WALL_COLUMNS = ("x1_m", "y1_m", "x2_m", "y2_m", "points", "deviation_m", "key_poses")
_UPPER_TRIANGLE = np.triu_indices(3)


class ResultsError(IcegError):
    """A folder of results that cannot be written or read."""


def check_directory(directory: Path, *, overwrite: bool) -> None:
    """Refuse a folder that results must not go to, before any work is done.

    Args:
        directory: where the results are to go; need not exist.
        overwrite: whether earlier results may be replaced.

    Raises:
        ResultsError: it is a file or below one, cannot be written to, or is not empty although nothing may be
            overwritten.
    """
    paths = (directory, *directory.absolute().parents)
    there = next(path for path in paths if path.exists())
    broken = next((path for path in paths if path.is_symlink() and not path.exists()), None)
    if broken is not None:
        raise ResultsError(f"{directory}: {broken} is a link that leads nowhere, expected a folder")
    if not there.is_dir():
        raise ResultsError(f"{directory}: {'' if there == directory else f'{there} '}is a file, expected a folder")
    try:
        _try_to_write(there)
        if there == directory:
            settle(directory)
            check_replaceable(directory, RESULT_FILES)
    except FileExistsError as err:
        raise ResultsError(f"{err.filename}: {err.strerror}; move it away, or choose another folder") from err
    except OSError as err:
        raise ResultsError(
            f"{directory}: found {there}, where nothing can be written ({reason(err)}), expected a folder for results"
        ) from err
    if not overwrite and directory.is_dir() and any(directory.iterdir()):
        raise ResultsError(
            f"{directory}: is not empty; choose another folder, or replace its results with --overwrite "
            "(in Python overwrite=True)"
        )


def write_results(
    result: "SlamResult",
    directory: Path | str,
    *,
    overwrite: bool = False,
    report: bool = True,
    beside: Mapping[str, str] | None = None,
    progress: Callable[[str, int, int], None] | None = None,
) -> None:
    """Write everything a run found, all files or none.

    Whatever interrupts the writing, a reader finds the whole of the earlier results or of the new ones; `graph.publish`
    says how. Files that are not results are never touched.

    Args:
        result: what the run found.
        directory: made when missing.
        overwrite: whether earlier results in it may be replaced.
        report: whether to write `report.html`; an earlier one goes in any case.
        beside: texts by the names of files, which belong to the results and are replaced together with them.
        progress: called before each part is written, with its name, how many are written and how many there are.

    Raises:
        ResultsError: the folder is not empty, or cannot be written to.
        TypeError: an argument of another type.
    """
    if not hasattr(result, "summary"):
        expected = "iceg.SlamResult, as iceg.run(log) gives: write_results(result, directory)"
        raise TypeError(f"result: found {type_name(result)}, expected {expected}")
    directory = Path(directory)
    writers: dict[str, Callable[[Path], None]] = {
        name: partial(write, result) for name, write in _WRITERS.items() if report or name != "report"
    }
    if beside:
        writers["beside"] = partial(_write_texts, beside)
    if progress:
        writers = _telling(writers, progress)
    warning = stamps_warning(result)
    more = {"warnings": [*result.summary["warnings"], warning]} if warning else {}
    write_folder(directory, writers, {**result.summary, **more}, overwrite=overwrite)


def _telling(
    writers: Mapping[str, Callable[[Path], None]], progress: Callable[[str, int, int], None]
) -> dict[str, Callable[[Path], None]]:
    """The same, each telling of itself first; those that a second process runs, which begin before all, at once."""
    names = sorted(writers, key=lambda name: name not in _WRITTEN_ASIDE)
    for k, name in enumerate(names):
        if name in _WRITTEN_ASIDE:
            progress(name, k, len(names))
    return {
        name: write
        if name in _WRITTEN_ASIDE
        else partial(_write_told, progress, name, names.index(name), len(names), write)
        for name, write in writers.items()
    }


def _write_told(
    progress: Callable[[str, int, int], None],
    name: str,
    k: int,
    n: int,
    write: Callable[[Path], None],
    folder: Path,
) -> None:
    progress(name, k, n)
    write(folder)


def stamps_warning(result: "SlamResult") -> str | None:
    """What whoever pairs the poses of `trajectory.tum` by their stamps should know; None where they increase."""
    n = 0 if result.config.stamps == "repaired" else steps_back(result.log.stamps)
    if not n:
        return None
    return (
        f"the stamps in trajectory.tum are those recorded, in file order, and {n} of {len(result.log)} are not later "
        "than the one before: tools that sort poses by their stamps, as evo does, mix them up; --stamps repaired "
        "writes stamps that increase"
    )


def write_folder(
    directory: Path, writers: Mapping[str, Callable[[Path], None]], summary: Mapping[str, Any], *, overwrite: bool
) -> None:
    """Write the files of any run and its `summary.json`, all files or none.

    Args:
        directory: made when missing.
        writers: by name, each writes its files into the folder it is given.
        summary: what the run has counted; versions, memory and the seconds of writing are added.
        overwrite: whether earlier results may be replaced.

    Raises:
        ResultsError: the folder is not empty, or cannot be written to.
    """
    check_directory(directory, overwrite=overwrite)
    try:
        # What another kind of run left there would pass for this run's: all names are replaced.
        with publishing(directory, replaces=RESULT_FILES) as staging:
            aside = {name: write for name, write in writers.items() if name in _WRITTEN_ASIDE}
            others = {name: write for name, write in writers.items() if name not in _WRITTEN_ASIDE}
            with in_second_process(partial(_written, aside, staging)) as written_aside:
                clock = _written(others, staging)
                clock.add(written_aside())
            taken = {"writing_s": clock.seconds, "writing_cpu_s": clock.cpu_seconds}
            vouched = {"files": _digests(staging)}
            _write_text(staging / "summary.json", _format_summary({**_circumstances(), **summary, **taken, **vouched}))
    except OSError as err:
        raise ResultsError(f"{directory}: results cannot be written: {reason(err)}") from err


def _written(writers: Mapping[str, Callable[[Path], None]], folder: Path) -> StageClock:
    """Write some of the files; how long each took."""
    clock = StageClock()
    for name, write in writers.items():
        with clock.stage(name):
            write(folder)
    return clock


@contextmanager
def whole_results(directory: Path) -> Iterator[None]:
    """Read the files of one run in the block: refuse those of several, and what is replaced meanwhile.

    Results of versions that wrote no digests are not checked.

    Args:
        directory: of the results; checked only if it is a folder that holds a summary.

    Raises:
        ResultsError: a file is not what the run wrote that wrote `summary.json`, that cannot be read, or the results
            were replaced.
    """
    if (directory / "summary.json").exists():
        read_summary(directory)
    before = _summary_of_whole(directory)
    yield
    if _summary_bytes(directory) != before:
        raise ResultsError(f"{directory}: its results were replaced while they were read; read them again")


def read_covariances(path: Path | str) -> tuple[NDArray[np.int64], NDArray[np.float64], NDArray[np.float64]]:
    """Read back `covariances.csv`.

    Args:
        path: the file.

    Returns:
        (k,) scan index of each key pose, (k, 3) T_map_robot and (k, 3, 3) covariances in the tangent space at it.

    Raises:
        TableError: the file cannot be read or is not as expected.
    """
    path = Path(path)
    table = read_csv_table(path, _COVARIANCE_COLUMNS)
    bad = np.flatnonzero((table[:, 0] < 0) | (table[:, 0] != np.floor(table[:, 0])))
    if len(bad):
        raise TableError(f"{path}: row {bad[0] + 1}: found scan {table[bad[0], 0]:g}, expected whole numbers from 0")
    covariances = np.empty((len(table), 3, 3))
    rows, columns = _UPPER_TRIANGLE
    covariances[:, rows, columns] = covariances[:, columns, rows] = table[:, 4:]
    return table[:, 0].astype(np.int64), table[:, 1:4], covariances


def read_summary(directory: Path | str) -> dict[str, Any]:
    """Read back `summary.json`.

    Raises:
        ResultsError: the folder holds no readable summary.
    """
    directory = Path(directory)
    path = directory / "summary.json"
    text = read_text(path, "drawing_bytes", ResultsError, "the summary of a run, expected in the folder of one")
    try:
        summary = json.loads(text)
    except (ValueError, RecursionError) as err:
        raise ResultsError(f"{path}: cannot be read, expected a folder that a run has written: {err}") from err
    if not isinstance(summary, dict):
        raise ResultsError(f"{path}: found {type(summary).__name__}, expected a JSON object")
    return summary


def _summary_of_whole(directory: Path) -> bytes:
    """The content of `summary.json`, once the digests in it are those of the files."""
    while True:
        content = _summary_bytes(directory)
        changed = _changed_file(directory, content)
        if changed is None:
            return content
        if _summary_bytes(directory) == content:  # else another run has just replaced them all
            raise ResultsError(
                f"{directory / changed}: is not what the run has written that wrote summary.json beside it, expected "
                "files of one run: run again, or put the right file back"
            )


def _summary_bytes(directory: Path) -> bytes:
    try:
        return (directory / "summary.json").read_bytes()
    except OSError:
        return b""


def _changed_file(directory: Path, summary: bytes) -> str | None:
    """The first file whose digest is not that in a summary; None without digests."""
    try:
        files = json.loads(summary)["files"]
        expected = {name: files[name] for name in _VOUCHED_FOR if name in files and (directory / name).exists()}
        return next((name for name, digest in expected.items() if _digest(directory / name) != digest), None)
    except (ValueError, KeyError, TypeError, RecursionError, OSError):
        return None  # for the readers of the summary and of the files to tell


def _digests(folder: Path) -> dict[str, str]:
    return {name: _digest(folder / name) for name in _VOUCHED_FOR if (folder / name).exists()}


def _digest(path: Path) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, lambda: hashlib.blake2b(digest_size=16)).hexdigest()


def _try_to_write(folder: Path) -> None:
    """Make a file without a name, or a folder that is removed again: permissions do not tell, root has them all."""
    try:
        os.close(os.open(folder, os.O_WRONLY | os.O_TMPFILE))
    except (OSError, AttributeError):  # not every system has them
        with signals_deferred():
            Path(tempfile.mkdtemp(prefix=".iceg-", dir=folder)).rmdir()


def _write_trajectory(result: "SlamResult", folder: Path) -> None:
    stamps = result.log.stamps
    written = repaired_stamps(stamps) if result.config.stamps == "repaired" else stamps
    _write_text(folder / "trajectory.tum", format_tum(written, result.trajectory))


def _write_graph(result: "SlamResult", folder: Path) -> None:
    from graph.g2o import write_g2o

    write_g2o(folder / "graph.g2o", result.key_poses, result.graph.factors)


def _write_covariances(result: "SlamResult", folder: Path) -> None:
    rows, columns = _UPPER_TRIANGLE
    table = np.column_stack([result.key_scans, result.key_poses, result.covariances[:, rows, columns]])
    line = "%d" + ",%.9f" * 3 + ",%.12g" * 6 + "\n"
    body = (line * len(table)) % tuple(table.ravel().tolist())
    _write_text(folder / "covariances.csv", ",".join(_COVARIANCE_COLUMNS) + "\n" + body)


def _write_closures(result: "SlamResult", folder: Path) -> None:
    lines = [",".join(CLOSURE_COLUMNS)]
    for closure in result.closures:
        x, y, heading = closure.T_i_j
        reason = '"' + closure.reason.replace('"', '""') + '"'
        lines.append(
            f"{closure.scan_i},{closure.scan_j},{x:.9f},{y:.9f},{heading:.9f},"
            f"{closure.score:.6f},{closure.inliers},{closure.overlap:.6f},{closure.verdict},{reason}"
        )
    _write_text(folder / "closures.csv", "\n".join(lines) + "\n")


def _write_walls(result: "SlamResult", folder: Path) -> None:
    walls = result.walls
    table = np.column_stack([walls.ends.reshape(-1, 4), walls.points, walls.deviations, walls.key_poses])
    line = "%.6f" + ",%.6f" * 3 + ",%d,%.6f,%d\n"
    body = (line * len(table)) % tuple(table.ravel().tolist())
    _write_text(folder / "walls.csv", ",".join(WALL_COLUMNS) + "\n" + body)


def _write_map(result: "SlamResult", folder: Path) -> None:
    from iceg.maps.grid import write_ros_map

    write_ros_map(result.grid, folder)


def _write_picture(result: "SlamResult", folder: Path) -> None:
    from iceg.show.drawn_run import drawn_run
    from iceg.show.map_picture import save_map_png

    save_map_png(folder / "map.png", drawn_run(result).layers())


def _write_features(result: "SlamResult", folder: Path) -> None:
    from iceg.maps.geojson import write_geojson

    write_geojson(result.landmarks, folder / "features.geojson")


def _write_config(result: "SlamResult", folder: Path) -> None:
    _write_text(folder / "config.toml", format_config(result.config))


def _write_findings(result: "SlamResult", folder: Path) -> None:
    from iceg.findings_file.codec import write_findings

    write_findings(folder / FINDINGS, result.findings)


def _write_report(result: "SlamResult", folder: Path) -> None:
    from iceg.report import REPORT, write_report

    write_report(result, folder / REPORT)


_WRITERS: Mapping[str, Callable[["SlamResult", Path], None]] = {
    "trajectory": _write_trajectory,
    "graph": _write_graph,
    "covariances": _write_covariances,
    "closures": _write_closures,
    "walls": _write_walls,
    "map": _write_map,
    "picture": _write_picture,
    "features": _write_features,
    "config": _write_config,
    "findings": _write_findings,
    "report": _write_report,
}


def _circumstances() -> dict[str, Any]:
    """What the figures of a run depend on besides log and settings."""
    packages = ("iceg", "gtsam", "numpy", "scipy", "numba", "matplotlib")
    return {
        "versions": {"python": platform.python_version(), **{name: _version(name) for name in packages}},
        "peak_memory_mb": peak_memory_mb(),
    }


def _version(name: str) -> str:
    """Of a package, as it says itself where it is loaded: reading what was installed takes milliseconds each."""
    from importlib.metadata import version

    return getattr(sys.modules.get(name), "__version__", None) or version(name)


def _format_summary(summary: Mapping[str, Any]) -> str:
    return format_json(summary, indent=2) + "\n"


def _write_texts(texts: Mapping[str, str], folder: Path) -> None:
    for name, text in texts.items():
        _write_text(folder / name, text)


def _write_text(path: Path, text: str) -> None:
    path.write_text(text, encoding="utf-8", newline="\n")
