"""The methods that can be compared: ICE and the matchers of the literature in one pipeline, and DP-SLAM."""

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, is_dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from frontends.dp_slam.config import DpSlamConfig
from frontends.matcher import Matcher
from frontends.matchers import MATCHERS, make_matcher
from frontends.scan import Log
from iceg.config import Config
from iceg.settings_file import ConfigError, build_settings, shown_value

DP_SLAM = "dp-slam"
METHODS = ("ice", *MATCHERS, DP_SLAM)
"""Every method by the name it has in an experiment."""

_SEEDS = {"ice": ("ice.hypotheses.seed",), DP_SLAM: (f"{DP_SLAM}.seed",)}
"""Settings besides that of the pipeline which the seed of a run is for."""

_DEEPEST = 20
_LONGEST_KEY = 200

Settings = Mapping[str, Any]
"""Values by dotted key. A key that begins with the name of a method is for that method alone."""


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyPoses:
    """What a pose graph knows of some scans.

    Attributes:
        scans: (k,) which scans.
        poses: (k, 3) T_map_robot.
        covariances: (k, 3, 3) in the tangent space at each.
    """

    scans: NDArray[np.int64]
    poses: NDArray[np.float64]
    covariances: NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Estimate:
    """What a method makes of a log.

    Attributes:
        trajectory: (n_scans, 3) T_map_robot of every scan.
        key_poses: those with a covariance; None where the method has none.
        counts: what it tells about itself.
    """

    trajectory: NDArray[np.float64]
    key_poses: KeyPoses | None
    counts: dict[str, float | int]


class Method(Protocol):
    """A method with all its settings."""

    @property
    def config(self) -> Config:
        """Of the pipeline; a method outside it takes from it how a log is read."""
        ...

    def resolved(self) -> dict[str, Any]:
        """Every setting that has a say in the result, defaults included."""
        ...

    def run(self, log: Log) -> Estimate:
        """Estimate the trajectory of a log."""
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class PipelineMethod:
    """A scan matcher in the pipeline of `iceg run`.

    Attributes:
        config: of the pipeline.
        matcher: any but ICE; None for ICE, which the pipeline makes itself.
    """

    config: Config
    matcher: Matcher | None

    def resolved(self) -> dict[str, Any]:
        """Settings of the pipeline and of the matcher."""
        own = None if self.matcher is None else getattr(self.matcher, "config", None)
        matcher = asdict(own) if is_dataclass(own) and not isinstance(own, type) else None
        return {"config": asdict(self.config), "matcher": matcher}

    def run(self, log: Log) -> Estimate:
        """Run the pipeline."""
        from iceg.pipeline import run
        from iceg.slam.stages import Stages

        result = run(log, self.config, stages=Stages(matcher=self.matcher))
        return Estimate(
            trajectory=result.trajectory,
            key_poses=KeyPoses(scans=result.key_scans, poses=result.key_poses, covariances=result.covariances),
            counts={
                "key_poses": len(result.key_scans),
                "closures": result.summary["closures"]["accepted"],
                "carried_by_odometry": result.summary["scans_carried_by_odometry"],
            },
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class DpSlamMethod:
    """The particle filter over whole maps.

    Attributes:
        config: how the log is read; the rest of it has no meaning here.
        filter: settings of the particle filter.
    """

    config: Config
    filter: DpSlamConfig

    def resolved(self) -> dict[str, Any]:
        """How the log is read, and the settings of the filter."""
        return {"log": asdict(self.config.log), "filter": asdict(self.filter)}

    def run(self, log: Log) -> Estimate:
        """Run the filter."""
        from frontends.dp_slam import dp_slam

        result = dp_slam(log, self.filter)
        return Estimate(
            trajectory=result.trajectory,
            key_poses=None,
            counts={"particles_kept": result.summary["particles_kept"]},
        )


def make_method(name: str, settings: Settings, seed: int, where: str) -> Method:
    """A method with its settings, all of them checked.

    Args:
        name: one of `METHODS`.
        settings: those that differ from the defaults.
        seed: of what is random in the method, unless a setting says otherwise.
        where: the source of the settings, for messages.

    Raises:
        IcegError: a setting the method does not have, of a wrong type or out of range.
    """
    table = nested(dict.fromkeys(("seed", *_SEEDS.get(name, ())), seed) | dict(settings))
    own = {} if name == "ice" else table.pop(name, {})
    config = build_settings(Config, table, where)
    if name == DP_SLAM:
        _refuse_what_dp_slam_ignores(settings, where)
        return DpSlamMethod(config=config, filter=build_settings(DpSlamConfig, own, f"{where}: {name}"))
    matcher = None if name == "ice" else _matcher(name, own, f"{where}: {name}")
    return PipelineMethod(config=config, matcher=matcher)


def applies(key: str, method: str) -> bool:
    """Whether a setting given for all methods is one of this method's."""
    first = key.partition(".")[0]
    if first in METHODS:
        return first == method
    return method != DP_SLAM or first == "log"


def flattened(table: Mapping[str, Any], prefix: str = "") -> Iterator[tuple[str, Any]]:
    """Dotted keys and values of nested tables; keys may be dotted already.

    Raises:
        ConfigError: they are nested deeper than any settings are.
    """
    if prefix.count(".") > _DEEPEST:
        raise ConfigError(f"{prefix[:40]}…: found tables nested more than {_DEEPEST} deep")
    for key, value in table.items():
        if len(key) > _LONGEST_KEY:
            raise ConfigError(
                f"{prefix}{key[:40]}…: found a key of {len(key)} characters, expected the name of a setting"
            )
        if isinstance(value, Mapping):
            yield from flattened(value, f"{prefix}{key}.")
        else:
            yield prefix + key, value


def nested(settings: Settings) -> dict[str, Any]:
    """The tables that dotted keys describe.

    Raises:
        ConfigError: a key is a value and a table at once.
    """
    table: dict[str, Any] = {}
    for key, value in settings.items():
        *folders, leaf = key.split(".")
        inner = table
        for folder in folders:
            inner = inner.setdefault(folder, {})
            if not isinstance(inner, dict):
                raise ConfigError(f"{key}: '{folder}' is a value already, expected a table")
        if isinstance(inner.get(leaf), dict):
            raise ConfigError(f"{key}: is a table already, found the value {shown_value(value)}")
        inner[leaf] = value
    return table


def _matcher(name: str, own: Settings, where: str) -> Matcher:
    matcher = make_matcher(name)
    if not own:
        return matcher
    config = getattr(matcher, "config", None)
    if not is_dataclass(config):
        raise ConfigError(f"{where}: has no settings, found {', '.join(own)}")
    remade: Matcher = type(matcher)(build_settings(type(config), own, where))  # type: ignore[call-arg]
    return remade


def _refuse_what_dp_slam_ignores(settings: Settings, where: str) -> None:
    ignored = [key for key in settings if not applies(key, DP_SLAM)]
    if ignored:
        raise ConfigError(
            f"{where}: {', '.join(ignored)} has no meaning for DP-SLAM, expected keys in log or {DP_SLAM}"
        )
