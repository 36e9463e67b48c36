"""What `result.summary` and `summary.json` hold, by name and type; lengths in metres, angles in radians."""

from typing import Any, Literal, NotRequired, TypedDict


class BreakSummary(TypedDict):
    """A place where the path does not hold: before which scan, what became of it, and how far it moved.

    And how probable it is that what follows is displaced nevertheless.
    """

    scan: int
    outcome: str
    moved_m: float
    probability_displaced: float


class ClosureCounts(TypedDict):
    """Loop closures tried and accepted."""

    tried: int
    accepted: int


class RoundSummary(TypedDict):
    """What one stage of the finish did; the fields of `iceg.slam.finish.Round`."""

    stage: Literal["solve", "rematch", "joint"]
    closures: int
    fresh: int
    error_before: float
    error: float
    largest_move: float
    mean_move: float
    residual_before: float | None
    residual: float | None
    covariances_from: Literal["walls", "graph"] | None
    walls_share: float | None
    variance_factor: float | None
    seconds: float


class OdometrySummary(TypedDict):
    """What the odometry was found to do wrong."""

    translation_scale: float
    heading_scale: float
    heading_per_metre_rad: float
    heading_shift_scans: float
    translation_shift_scans: float
    T_odometry_laser: tuple[float, float, float]


class LeastKnownSummary(TypedDict):
    """The key scan whose position is known least."""

    scan: int
    position_std_m: float


class LaserSummary(TypedDict):
    """How far the ranges scatter."""

    noise_m: float
    noise_per_metre: float
    typical_range_m: float
    outlier_share: float
    no_return_share: float
    step_m: float


class MountSummary(TypedDict):
    """Where the laser is taken to sit on the robot, which the log does not say."""

    x_m: float
    y_m: float
    heading_rad: float


class RunCounts(TypedDict):
    """Counts, warnings and calibration of a run."""

    log: str
    scans: int
    skipped_lines: int
    chosen: dict[str, str]
    warnings: list[str]
    key_poses: int
    scans_carried_by_odometry: int
    lost_at_scans: list[int]
    breaks: list[BreakSummary]
    odometry_jumps: int
    odometry_breaks_at_scans: list[int]
    match_covariance_scale: float
    weak_matches: int
    factors: dict[str, int]
    closures: ClosureCounts
    finish: list[RoundSummary]
    odometry: OdometrySummary
    least_known: LeastKnownSummary
    mount: NotRequired[MountSummary]
    gyro: NotRequired[dict[str, Any]]
    corrections: NotRequired[dict[str, Any]]
    cut: NotRequired[dict[str, Any]]


class RunSummary(RunCounts):
    """All that a run tells of itself; `summary.json` adds versions, memory, the seconds of writing and digests."""

    laser: LaserSummary | None
    sweep: dict[str, Any]
    seconds: dict[str, float]
    cpu_seconds: dict[str, float]
