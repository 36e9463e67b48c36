"""What half and twice of each number among the settings does to the error of a run."""

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

from frontends.logs import read_log
from frontends.scan import Log
from graph.errors import IcegError
from graph.publish import publishing
from iceg.config import Config
from iceg.evaluation.ablation import Judge, judge_of
from iceg.evaluation.bench.logs import BenchLog
from iceg.evaluation.bench.tables import Row, write_csv
from iceg.evaluation.errors import EvaluationError
from iceg.maps.config import GridConfig
from iceg.pipeline import run

FILE = "settings-scaled.csv"
FACTORS = {"half": 0.5, "twice": 2.0}
"""Columns of the table."""
STAGES = ("ice", "front_end", "odometry", "graph", "loops", "finish")
"""Whose settings decide the trajectory: those of the maps come after it."""
_ERRORS = ("trans_mean", "ate_rmse")
"""The figure a log is judged by: of relations, else of the trajectory [m]."""
_COARSE = GridConfig(resolution=0.5)


def scalable_settings(settings: Any, name: str = "") -> Iterator[tuple[str, float]]:  # noqa: ANN401
    """Dotted names and values of the numbers other than zero among dataclasses of settings."""
    for field in dataclasses.fields(settings):
        value, full = getattr(settings, field.name), f"{name}.{field.name}".lstrip(".")
        if dataclasses.is_dataclass(value):
            yield from scalable_settings(value, full)
        elif isinstance(value, int | float) and not isinstance(value, bool) and value:
            yield full, value


def scaled(settings: Any, name: str, factor: float) -> Any:  # noqa: ANN401
    """The settings with one of them multiplied; whole numbers stay whole, and differ.

    Args:
        settings: an instance of a dataclass of settings.
        name: of the setting, dotted.
        factor: to multiply it by.

    Raises:
        IcegError: the product is out of the setting's range.
    """
    first, _, rest = name.partition(".")
    value = getattr(settings, first)
    if rest:
        return dataclasses.replace(settings, **{first: scaled(value, rest, factor)})
    product = value * factor
    if isinstance(value, int):
        product = math.ceil(product) if factor > 1.0 else math.floor(product)
    return dataclasses.replace(settings, **{first: product})


def names_to_scale(asked: Sequence[str]) -> list[str]:
    """The settings asked for, by their names or those of their stages; all that decide the trajectory where none is.

    Raises:
        EvaluationError: there is no such number.
    """
    known = [name for name, _ in scalable_settings(Config())]
    chosen = asked or STAGES
    for each in chosen:
        if not any(_is_in(name, each) for name in known):
            raise EvaluationError(f"found the setting '{each[:60]}', expected a number or a stage that has one")
    return [name for name in known if any(_is_in(name, each) for each in chosen)]


def write_scales(
    logs: Sequence[BenchLog], names: Sequence[str], output: Path, tell: Callable[[int, int], None]
) -> list[Row]:
    """Run every log with half and twice of each setting, and keep how the errors change.

    Args:
        logs: with something to be judged by.
        names: of the settings.
        output: folder of `settings-scaled.csv`, made if missing, written anew after each setting.
        tell: how many of the settings are done, and how many there are.

    Returns:
        A row a setting: its name, its default, and for `half` and `twice` the change of the error [%], geometric mean
        over the logs, and on the log where it is worst; empty where that value is out of the setting's range.

    Raises:
        EvaluationError: nothing is known about a log.
    """
    config = dataclasses.replace(Config(), grid=_COARSE)
    cases = [(read_log(log.path), judge_of(log)) for log in logs]
    usual = [_error(config, *case) for case in cases]
    defaults, rows = dict(scalable_settings(config)), list[Row]()
    for n, name in enumerate(names):
        row: Row = {"setting": name, "default": defaults[name]}
        for column, factor in FACTORS.items():
            mean, worst = _changes(config, name, factor, cases, usual)
            row |= {f"{column} [%]": mean, f"{column}, worst log [%]": worst}
        rows.append(row)
        with publishing(output) as staging:
            write_csv(rows, staging / FILE)
        tell(n + 1, len(names))
    return rows


def _changes(
    config: Config, name: str, factor: float, cases: list[tuple[Log, Judge]], usual: list[float]
) -> tuple[float | None, float | None]:
    """Mean and worst change of the error [%]; infinite where a run fails, None where the value is out of range."""
    try:
        changed = scaled(config, name, factor)
    except IcegError:
        return None, None
    logs = [math.log(_error(changed, *case) / error) for case, error in zip(cases, usual, strict=True)]
    return _percent(sum(logs) / len(logs)), _percent(max(logs))


def _error(config: Config, log: Log, judge: Judge) -> float:
    try:
        figures = judge(run(log, config).trajectory)
    except IcegError:
        return math.inf
    return next(figures[name] for name in _ERRORS if name in figures)


def _percent(logarithm: float) -> float:
    return round(100.0 * math.expm1(logarithm), 1)


def _is_in(name: str, asked: str) -> bool:
    return name == asked or name.startswith(f"{asked}.")
