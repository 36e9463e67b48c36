"""All settings of a run: one small dataclass per stage, defined where the stage is, put together here."""

from dataclasses import dataclass, field, fields, is_dataclass
from math import pi
from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from graph.config import PoseGraphConfig
from graph.limits import LIMITS
from graph.odometry import OdometryModel, check_odometry_setting
from graph.ranges import check_magnitudes, shown_number
from graph.short_repr import changed_repr
from graph.units import Radians
from iceg.ice.config import IceConfig
from iceg.maps.config import FeatureMapConfig, GridConfig
from iceg.settings_file import ConfigError, format_settings, parse_settings, read_settings
from iceg.slam.config import FinishConfig, FrontEndConfig, LoopClosureConfig

__all__ = ["Config", "ConfigError", "MatcherName", "format_config", "parse_config", "read_config"]

StampsWritten = Literal["recorded", "repaired"]

MatcherName = Literal["ice", "icp", "plicp", "idc", "mbicp", "wsm", "qwsm", "ndt", "csm"]
"""ICE, and the keys of `frontends.matchers.MATCHERS`."""

_MOST_SEED = 2**63 - 1
_FARTHEST_LASER = 100.0  # m: no robot is larger
_HEADING = "Settings of iceg: SI units, angles in radians. Leave a key out to get its default."


@dataclass(frozen=True, kw_only=True)
class LogConfig:
    """How the log is read."""

    laser: str = "front"
    """Which laser: front, rear or a name, such as RAWLASER3 (CARMEN), Scanner1 (USARSim) or laser:1 (Player)."""
    range_min: float | None = None
    """Shortest reading taken as a return [m]; left out: 2 cm."""
    range_max: float | None = None
    """Longest reading taken as a return [m]; left out: derived from the log."""
    laser_x: float | None = None
    """Where the laser sits ahead of the robot's centre [m]; left out, as for the next two: as the log says."""
    laser_y: float | None = None
    """Where it sits to the left of the centre [m]."""
    laser_heading: Radians | None = None
    """Which way it looks, counter-clockwise from straight ahead."""
    scan_topic: str | None = None
    """Of a bag: topic of the laser; left out: the one that sees most."""
    scan_frame: str | None = None
    """Of a bag: frame of the laser, where several share a topic."""
    odometry_topic: str | None = None
    """Of a bag: topic of the odometry, whatever is on it; left out: the robot's own, or the transform from odom."""
    base_frame: str | None = None
    """Of a bag: the robot's frame; left out: the one whose odometry it is."""

    __repr__ = changed_repr

    def __post_init__(self) -> None:
        for name, most in (("laser_x", _FARTHEST_LASER), ("laser_y", _FARTHEST_LASER), ("laser_heading", 2.0 * pi)):
            value = getattr(self, name)
            if value is not None and not abs(value) <= most:
                raise ConfigError(f"{name} is {value}, expected at most {most:g} on either side of zero")
        most = LIMITS.range
        if self.range_min is not None and not 0 <= self.range_min <= most:
            raise ConfigError(f"range_min is {self.range_min} m, expected ≥ 0 and at most {most:g} m")
        if self.range_max is not None and not (self.range_min or 0.0) < self.range_max <= most:
            raise ConfigError(
                f"range_max is {self.range_max} m, expected more than {self.range_min or 0.0} m, at most {most:g} m"
            )


@dataclass(frozen=True, kw_only=True)
class LaserConfig:
    """How far the ranges of the laser scatter: √(noise² + (noise_per_metre · range)²)."""

    noise: float | None = None
    """Standard deviation of a short range [m]; left out: both learned from the log."""
    noise_per_metre: float = 0.0
    """How much that grows per metre of range, where `noise` is given."""

    __repr__ = changed_repr

    def __post_init__(self) -> None:
        if not ((self.noise is None or self.noise >= 0) and self.noise_per_metre >= 0):
            raise ConfigError(
                f"laser: found noise {self.noise} m and noise_per_metre {self.noise_per_metre}, expected 0 or more"
            )


@dataclass(frozen=True, kw_only=True)
class Config:
    """All settings of a run.

    Attributes:
        seed: start of every random number drawn; the same log, settings and version give the same bytes.
        matcher: what matches the scans: ice, or one of the literature's with its defaults.
        stamps: of trajectory.tum: as recorded, or repaired so that they increase from scan to scan.
        log: how the log is read.
        laser: its noise.
        ice: ICE matching.
        front_end: tracking, key scans and the local reference.
        odometry: noise of the wheels before it is calibrated.
        graph: the pose graph.
        loops: places seen again.
        finish: the offline optimisation at the end.
        feature_map: landmarks and when they expire.
        grid: the occupancy grid.
    """

    seed: int = 0
    matcher: MatcherName = "ice"
    stamps: StampsWritten = "recorded"
    log: LogConfig = field(default_factory=LogConfig)
    laser: LaserConfig = field(default_factory=LaserConfig)
    ice: IceConfig = field(default_factory=IceConfig)
    front_end: FrontEndConfig = field(default_factory=FrontEndConfig)
    odometry: OdometryModel = field(default_factory=OdometryModel)
    graph: PoseGraphConfig = field(default_factory=PoseGraphConfig)
    loops: LoopClosureConfig = field(default_factory=LoopClosureConfig)
    finish: FinishConfig = field(default_factory=FinishConfig)
    feature_map: FeatureMapConfig = field(default_factory=FeatureMapConfig)
    grid: GridConfig = field(default_factory=GridConfig)

    __repr__ = changed_repr

    def __post_init__(self) -> None:
        if not 0 <= self.seed <= _MOST_SEED:
            raise ConfigError(f"seed: found {shown_number(self.seed)}, expected 0 or more, at most 2⁶³ - 1")
        check_odometry_setting(self.odometry, ConfigError, "odometry")
        _check_values(self)


def _check_values(settings: Any, prefix: str = "") -> None:  # noqa: ANN401
    """Refuse numbers beyond all sense and unknown choices, stage by stage, besides what a stage refuses itself."""
    try:
        check_magnitudes(settings, ConfigError)
    except ConfigError as err:
        raise ConfigError(f"{prefix.rstrip('.')}: {err}" if prefix else str(err)) from None
    for stage in fields(settings):
        value = getattr(settings, stage.name)
        if get_origin(stage.type) is Literal and value not in get_args(stage.type):
            expected = ", ".join(map(str, get_args(stage.type)))
            raise ConfigError(f"{prefix}{stage.name}: found {str(value)[:40]!r}, expected one of {expected}")
        if is_dataclass(value):
            _check_values(value, f"{prefix}{stage.name}.")


def read_config(path: Path | str) -> Config:
    """Read a TOML file; what it does not name keeps its default.

    Raises:
        ConfigError: unreadable, an unknown key, a wrong type or a value out of range, named with file and key.
    """
    return read_settings(Config, Path(path))


def parse_config(text: str, where: str = "configuration") -> Config:
    """A configuration from TOML text; `where` names its source in messages.

    Raises:
        ConfigError: as `read_config`.
    """
    return parse_settings(Config, text, where=where)


def format_config(config: Config) -> str:
    """TOML with every key and its documentation as comment; reads back as the same configuration."""
    return format_settings(config, heading=_HEADING)
