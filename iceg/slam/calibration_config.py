"""Settings of the calibration of odometry and gyro by the matches of a log."""

from dataclasses import dataclass, field

from graph.odometry import OdometryModel, check_odometry_setting
from graph.ranges import RATES, between, positive
from graph.units import Radians
from iceg.slam.checked_settings import SlamConfigError, SlamSettings


@dataclass(frozen=True, kw_only=True)
class SuddenStepConfig(SlamSettings, prefix="sudden steps: "):
    """Which steps of odometry no robot made, as where it was set anew."""

    distance: float = 1.0
    """Least length of a step that stands out [m]."""
    turn: Radians = 0.8
    """Least turn of a step that stands out, if it is not long [rad]."""
    factor: float = 3.0
    """How many times as fast as nearly all steps one is, at least, that stands out."""
    nearly_all: float = between(0.99, 0.5, 0.9999)
    """Share of the steps that are nearly all of them."""


@dataclass(frozen=True, kw_only=True)
class CalibrationConfig(SlamSettings, prefix="calibration: "):
    """What the matches of a log tell of its odometry: bias, delay, mount, noise; and of its gyro."""

    min_keys: int = positive(20)
    """Fewest matched key scans to calibrate from."""
    window: int = positive(5)
    """Key scans over which moves are compared: the noise of single steps makes a scale fitted to them too small."""
    min_turn: Radians = 0.3
    """Only windows that turn by more than this tell the scale of turns [rad]."""
    turn_told: Radians = 0.01
    """A match tells of turns, and of the drift of the heading, where it knows them to this standard deviation [rad],
    though it may not see how far the robot came."""
    sudden: SuddenStepConfig = field(default_factory=SuddenStepConfig)
    """Which steps of odometry stand out."""
    scale_sigma: float = positive(0.05)
    """Standard deviation, before any data, of the scale of moves and of turns."""
    drift_sigma: float = positive(0.05)
    """Standard deviation, before any data, of the drift of the heading [rad/m]."""
    delay_sigma: float = positive(0.7)
    """Standard deviation, before any data, of the delay [scans]."""
    mount_ahead_sigma: float = positive(0.2)
    """Standard deviation, before any data, of how far ahead the laser sits [m]."""
    mount_aside_sigma: float = positive(0.1)
    """Standard deviation, before any data, of how far aside the laser sits [m]."""
    mount_heading_sigma: Radians = positive(0.03)
    """Standard deviation, before any data, of the heading of the laser [rad]."""
    mount_false_alarm: float = between(1e-4, *RATES)
    """Odometry tells where the laser sits, where the log does not say it, if chance explains as much with a smaller
    probability."""
    mount_floor: float = 0.02
    """A laser nearer than this to where it is taken to sit stays there [m]: wheels that slip lead as far astray."""
    mount_doubt: float = 0.15
    """A warning says so where odometry puts the laser farther than this from where the log says it sits [m]."""
    max_delay: int = between(16, 0, 1000)
    """Scans up to which a delay is looked for."""
    max_linear_delay: float = 1.0
    """Scans up to which odometry may be late without harm, and a linear fit tells the delay better."""
    delay_gain: float = 2.0
    """So many times smaller must the mean square of the differences become by a delay of several scans."""
    wrong_turn: Radians = 0.3
    """A match that differs by more differs by no more than this: it may be wrong itself [rad]."""
    scale_false_alarm: float = between(5.733e-7, *RATES)
    """Odometry is a measure of moves, or of turns, where chance explains its share of what the matches say with a
    smaller probability (normal distribution; 5 σ)."""
    outlier_sigmas: float = 3.0
    """Standard deviations beyond which a difference counts as being so far and no farther."""
    max_claimed: float = 2.0
    """What cancels from step to step is the match's up to so many times the variance it claims; the rest is clocks."""
    floor_gain: float = 10.0
    """F statistic from which on an error that does not grow with the way explains more than chance would."""
    min_floor: float = between(0.05, 0.0, 1.0)
    """No odometry is believed to be off by less, without any motion, than this share of its usual deviation."""
    max_persistence: float = 4.0
    """By how much the variance is widened at most for errors that persist."""
    persistence_lags: int = between(16, 3, 1000)
    """Steps over which errors may persist."""
    least_noise: OdometryModel = field(
        default_factory=lambda: OdometryModel(
            along_floor=0.0002,
            across_floor=0.0002,
            heading_floor=0.0005,
            along_per_metre=0.01,
            across_per_metre=0.0005,
            position_per_radian=0.0005,
            heading_per_metre=0.003,
            heading_per_radian=0.005,
        )
    )
    """No robot's odometry is believed to be better than this."""
    gyro_false_alarm: float = between(1e-4, *RATES)
    """A gyro counts, and so does a further axis of it, where chance explains as much with a smaller probability."""
    gyro_freedom: float = between(3.0, 1.0, 1000.0)
    """Degrees of freedom of Student's t for what a gyro leaves of the turns: the usual residuals count as normal ones
    do, a few wrong matches hardly at all."""
    gyro_min_turns: int = between(10, 5, 10**6)
    """Fewest turns between matched key scans that tell anything of a gyro: four coefficients and their scatter."""
    gyro_max_delay: float = 3.0
    """Scans up to which the delay of a gyro is looked for."""
    velocity_scans: int = between(5, 1, 1000)
    """Scans whose motion tells the velocity that a gyro must foretell turns better than."""
    velocity_min_steps: int = between(10, 1, 10**6)
    """Fewest pairs of steps in a row that tell how well a robot without odometry keeps its velocity."""
    velocity_min_sigma: float = positive(0.005)
    """Standard deviations of a step that only the velocity tells of are never taken to be smaller [m, rad]."""
    velocity_told: float = positive(0.1)
    """A match tells of the velocity where it leaves no more than this share of the variance by which the velocity
    changes meanwhile."""
    worse_than_velocity: float = positive(1.0)
    """Odometry is left out whose error along the way is more than so many times that of the velocity."""

    def __post_init__(self) -> None:
        check_odometry_setting(self.least_noise, SlamConfigError, "least_noise")
        super().__post_init__()
