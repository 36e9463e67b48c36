"""What to compare: methods × logs × seeds × the values of a sweep, from one TOML file."""

import itertools
import math
import os
from collections import Counter
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from graph.errors import IcegError, reason
from graph.files import read_text
from graph.limits import LIMITS, at_most
from iceg.evaluation.bench.cell import SCENE, Cell, LogSource
from iceg.evaluation.bench.logs import known_beside
from iceg.evaluation.bench.methods import METHODS, applies, flattened
from iceg.evaluation.errors import EvaluationError
from iceg.settings_file import parse_toml, shown_value

_KEYS = ("methods", "logs", "seeds", "sweep", "time_limit_s")
_METHOD_KEYS = ("method", "name", "settings")
_LOG_KEYS = ("path", "name", "relations", "reference", "truth", "seeds")


class ExperimentError(EvaluationError):
    """An experiment file that is not as expected."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Experiment:
    """All runs of a benchmark.

    Attributes:
        cells: in the order of the file: methods, values of the sweep, logs, seeds.
        time_limit_s: a run that takes longer is stopped and counts as failed [s]; None for no limit.
    """

    cells: tuple[Cell, ...]
    time_limit_s: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class _Named:
    """A method of the file before the sweep."""

    method: str
    name: str
    settings: dict[str, Any]


def read_experiment(path: Path) -> Experiment:
    """Read an experiment and check every combination of it.

    Args:
        path: the TOML file; paths in it are relative to its folder, and may name environment variables.

    Raises:
        IcegError: the file, a key, a setting of any combination or a log is not as expected.
    """
    text = read_text(path, "settings_bytes", ExperimentError, "an experiment")
    return parse_experiment(text, path.parent, str(path))


def parse_experiment(text: str, folder: Path, where: str = "experiment") -> Experiment:
    """The experiment that a TOML text describes.

    Args:
        text: TOML.
        folder: what relative paths in it start from.
        where: the name of its source, for messages.

    Raises:
        IcegError: as `read_experiment`.
    """
    table = parse_toml(text, where, ExperimentError)
    _check_keys(table, _KEYS, where)
    methods = [_method(entry, f"{where}: methods[{k}]") for k, entry in enumerate(_list(table, "methods", where))]
    seeds = _seeds(table.get("seeds", [0]), f"{where}: seeds")
    logs = [_log(entry, folder, seeds, f"{where}: logs[{k}]") for k, entry in enumerate(_list(table, "logs", where))]
    sweep = _sweep(table.get("sweep", {}), methods, f"{where}: sweep")
    _check_number(methods, logs, sweep, where)
    cells = tuple(_cells(methods, logs, sweep))
    _check_cells(cells, where)
    return Experiment(cells=cells, time_limit_s=_time_limit(table, where))


def _cells(
    methods: list[_Named], logs: list[tuple[LogSource, tuple[int, ...]]], sweep: dict[str, list[Any]]
) -> Iterator[Cell]:
    for named in methods:
        values = {key: choices for key, choices in sweep.items() if applies(key, named.method)}
        for combination in itertools.product(*values.values()):
            swept = dict(zip(values, combination, strict=True))
            label = " ".join([named.name, *(f"{key}={_shown(value)}" for key, value in swept.items())])
            for log, seeds in logs:
                for seed in seeds:
                    yield Cell(
                        method=named.method,
                        label=label,
                        settings=named.settings | swept,
                        swept=swept,
                        log=log,
                        seed=seed,
                    )


def _check_number(
    methods: list[_Named], logs: list[tuple[LogSource, tuple[int, ...]]], sweep: dict[str, list[Any]], where: str
) -> None:
    """Refuse more runs than allowed before any of them is made up."""
    runs = sum(
        math.prod(len(choices) for key, choices in sweep.items() if applies(key, named.method)) for named in methods
    ) * sum(len(seeds) for _, seeds in logs)
    if runs > LIMITS.bench_runs:
        raise ExperimentError(f"{where}: found {runs} runs, expected {at_most('bench_runs')}")


def _check_cells(cells: tuple[Cell, ...], where: str) -> None:
    """Make every method with its settings once, and have no two runs share a name."""
    for cell in {cell.label: replace(cell, seed=0) for cell in cells}.values():
        try:
            cell.make()
        except IcegError as err:
            raise ExperimentError(f"{where}: {err}") from err
    folder, times = Counter(cell.folder for cell in cells).most_common(1)[0]
    if times > 1:
        raise ExperimentError(
            f"{where}: {times} runs share the name '{folder}'; give methods and logs names that differ"
        )


def _method(entry: Any, where: str) -> _Named:  # noqa: ANN401
    table = {"method": entry} if isinstance(entry, str) else entry
    if not isinstance(table, dict):
        raise ExperimentError(f"{where}: found {shown_value(entry)}, expected the name of a method or a table")
    _check_keys(table, _METHOD_KEYS, where)
    method = _text(table, "method", where)
    if method not in METHODS:
        raise ExperimentError(f"{where}: no method '{method[:80]}', expected one of {', '.join(METHODS)}")
    settings = table.get("settings", {})
    if not isinstance(settings, dict):
        raise ExperimentError(f"{where}: settings: found {shown_value(settings)}, expected a table")
    return _Named(method=method, name=_text(table, "name", where, method), settings=dict(flattened(settings)))


def _log(
    entry: Any,  # noqa: ANN401
    folder: Path,
    seeds: tuple[int, ...],
    where: str,
) -> tuple[LogSource, tuple[int, ...]]:
    table = {"path": entry} if isinstance(entry, str) else entry
    if not isinstance(table, dict):
        raise ExperimentError(
            f"{where}: found {shown_value(entry)}, expected the path of a log, {SCENE}NAME or a table"
        )
    _check_keys(table, _LOG_KEYS, where)
    given = _text(table, "path", where)
    seeds = _seeds(table["seeds"], f"{where}: seeds") if "seeds" in table else seeds
    known = {kind: _text(table, kind, where) for kind in ("relations", "reference", "truth") if kind in table}
    if given.startswith(SCENE):
        return _scene(table, given, known, folder, where), seeds
    path = _existing(given, folder, f"{where}: path")
    if {"reference", "truth"} <= known.keys():
        raise ExperimentError(f"{where}: found a reference and a truth, expected one of them")
    files = {kind: str(_existing(name, folder, f"{where}: {kind}")) for kind, name in known.items()}
    name = _text(table, "name", where, path.name.partition(".")[0])
    return LogSource(name=name, path=str(path), **(files or known_beside(path))), seeds


def _scene(table: Mapping[str, Any], given: str, known: Mapping[str, str], folder: Path, where: str) -> LogSource:
    from frontends.simulator.scene import load_scene

    if known:
        raise ExperimentError(f"{where}: found {', '.join(known)}, but a simulated log knows its truth")
    scene = given.removeprefix(SCENE)
    if scene.endswith(".world"):
        scene = str(_existing(scene, folder, f"{where}: path"))
    try:
        name = load_scene(scene).name
    except IcegError as err:
        raise ExperimentError(f"{where}: {err}") from err
    return LogSource(name=_text(table, "name", where, name), path=SCENE + scene)


def _sweep(table: Any, methods: list[_Named], where: str) -> dict[str, list[Any]]:  # noqa: ANN401
    if not isinstance(table, dict):
        raise ExperimentError(f"{where}: found {shown_value(table)}, expected a table of settings and lists of values")
    sweep = dict(flattened(table))
    for key, values in sweep.items():
        if not isinstance(values, list) or not values:
            raise ExperimentError(f"{where}: {key}: found {shown_value(values)}, expected a list of values")
        if not any(applies(key, named.method) for named in methods):
            names = ", ".join(dict.fromkeys(named.method for named in methods))
            raise ExperimentError(f"{where}: {key}: has no meaning for any of the methods: {names}")
    return sweep


def _seeds(value: Any, where: str) -> tuple[int, ...]:  # noqa: ANN401
    right = isinstance(value, list) and value and all(type(seed) is int and 0 <= seed < 2**63 for seed in value)
    if not right:
        raise ExperimentError(f"{where}: found {shown_value(value)}, expected a list of whole numbers from 0")
    return tuple(value)


def _time_limit(table: Mapping[str, Any], where: str) -> float | None:
    limit = table.get("time_limit_s")
    if limit is not None and (isinstance(limit, bool) or not isinstance(limit, int | float) or not 0 < limit <= 1e9):
        raise ExperimentError(
            f"{where}: time_limit_s: found {shown_value(limit)}, expected a positive number of seconds"
        )
    return limit


def _list(table: Mapping[str, Any], key: str, where: str) -> list[Any]:
    value = table.get(key)
    if not isinstance(value, list) or not value:
        raise ExperimentError(f"{where}: {key}: found {shown_value(value)}, expected a list of at least one")
    return value


def _text(table: Mapping[str, Any], key: str, where: str, default: str | None = None) -> str:
    value = table.get(key, default)
    if not isinstance(value, str) or not value:
        raise ExperimentError(f"{where}: {key}: found {shown_value(value)}, expected a text")
    return value


def _existing(name: str, folder: Path, where: str) -> Path:
    try:
        path = (folder / Path(os.path.expandvars(name)).expanduser()).resolve()
        is_file = path.is_file()
    except (RuntimeError, OSError, ValueError) as err:  # no such user, a loop of links, no path at all
        raise ExperimentError(
            f"{where}: found {shown_value(name)}, expected the path of a file ({reason(err)})"
        ) from err
    if not is_file:
        raise ExperimentError(f"{where}: no file {path}")
    return path


def _check_keys(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    for key in table:
        if key not in known:
            close = get_close_matches(key, known, n=1)
            hint = f", did you mean '{close[0]}'?" if close else ""
            raise ExperimentError(f"{where}: unknown key '{key[:80]}'{hint} (expected {', '.join(known)})")


def _shown(value: object) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)
