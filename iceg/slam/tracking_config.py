"""Settings of tracking: what a scan must see, when odometry and mount are believed, when tracking is lost."""

from dataclasses import dataclass
from math import pi

from graph.ranges import check_between, check_numbers
from graph.units import Radians
from iceg.slam.agreement import Tolerance
from iceg.slam.config_error import SlamConfigError

_RATES = (1e-9, 0.5)
"""Of false alarms."""


@dataclass(frozen=True, kw_only=True)
class SightConfig:
    """What a scan must see to be matched, or to speak against odometry."""

    blind_range: float = 0.5
    """A scan most of whose beams end within this sees nothing: the laser is covered [m]."""
    blind_share: float = 0.8
    """Least share of the returns that end so close in a scan that sees nothing."""
    min_returns: float = 0.1
    """A scan with a smaller share of returns sees nothing, unless many of them come from afar."""
    min_far_returns: int = 20
    """So many returns, most of them from afar, are enough: on open ground a laser of many beams meets little, but
    sees."""
    few_returns: float = 1.0 / 3.0
    """Where a smaller share of the beams returns, and most from nearby, people close by pass for walls."""
    far: float = 10.0
    """Returns from beyond this come from afar [m]."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError)


@dataclass(frozen=True, kw_only=True)
class OpenGroundConfig:
    """When a log was taken on open ground, where posts and trunks count as features."""

    near: float = 10.0
    """Returns from within this are nearby [m]."""
    max_near_beams: float = 0.12
    """On open ground fewer of the beams than this share meet something nearby."""
    max_near_returns: float = 0.5
    """On open ground no more of the returns than this share come from nearby."""
    scans: int = 500
    """So many scans, spread over the log, tell."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError, positive=("scans",))


@dataclass(frozen=True, kw_only=True)
class StandstillConfig:
    """When odometry stands still although the robot moves."""

    seldom_share: float = 0.5
    """Where more of the moves than this follow upon a standstill, odometry is read more seldom than the laser."""
    min_moves: int = 20
    """Fewest moves that tell how often the odometry is read."""
    ends: int = 3
    """Scans at either end of a standstill that may show the robot's move already, or still: two clocks."""
    samples: int = 64
    """Scans of a standstill that are compared with its beginning."""
    min_change: float = 0.1
    """Least change of the readings that only a move explains [m]."""
    min_change_factor: float = 3.0
    """Least change of the readings that only a move explains, in changes from one scan to the next."""
    unchanged_share: float = 0.25
    """Largest share of the beams that may change less when the robot moves: people hide what is behind them."""
    changed_samples: int = 3
    """Fewest scans that must show the change."""
    min_common: float = 0.2
    """Share of the beams that two scans need in common."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError, positive=("samples",))
        check_between(self, SlamConfigError, "standstill: ", unchanged_share=(0.0, 1.0), min_common=(0.0, 1.0))
        check_between(self, SlamConfigError, "standstill: ", samples=(1, 100_000))


@dataclass(frozen=True, kw_only=True)
class MountConfig:
    """When the matches say that the laser is mounted otherwise than the log does."""

    min_turn: Radians = 6.0 * (pi / 180.0)
    """Smallest turn between two key scans that tells its sense [rad]."""
    max_turn: Radians = 2.0 * pi / 3.0
    """Largest turn between two key scans that tells its sense [rad]."""
    against_share: float = 0.8
    """Share of the turns, weighed by their size, from which on the scans turn against the odometry."""
    min_motions: int = 10
    """Fewest motions that tell how the laser is mounted."""
    straight_turn: Radians = pi / 18.0
    """Largest turn of a motion that tells where the laser looks [rad]."""
    straight_distance: float = 0.15
    """Shortest motion that tells where the laser looks [m]."""
    askew: Radians = 5.0 * pi / 36.0
    """Least angle between where the laser looks and where the log says that calibration does not deal with
    [rad]."""
    askew_share: float = 0.25
    """Share of the motions that must say that the laser looks so far aside."""
    askew_agreement: float = 0.8
    """Least length of the mean of their directions, each as a vector of length 1."""
    lost_share: float = 0.3
    """Where more of the key scans than this match nothing, a laser that looks backwards is tried."""
    lost_gain: float = 0.5
    """Largest share of the unmatched key scans that a laser taken to look backwards may leave."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError)


@dataclass(frozen=True, kw_only=True)
class OdometryCheckConfig:
    """When a match contradicts odometry, and what it takes to be believed all the same."""

    false_alarm: float = 1.544e-5
    """A match contradicts odometry where chance puts it so far off with this probability only (χ², 3 degrees of
    freedom; 5 σ)."""
    min_evidence: float = 0.75
    """Least share of what a match explains that one constrained to odometry must explain to be preferred."""
    evidence_slope: float = 1.0 / 800.0
    """How much less it may explain per squared Mahalanobis distance of the free match from odometry."""
    jump_distance: float = 0.3
    """A match may be a jump that is farther from odometry than this [m]."""
    jump_turn: Radians = 0.26
    """A match may be a jump that is turned against odometry by more than this [rad]."""
    jump_false_alarm: float = 6.334e-5
    """A match is a jump that chance puts so far from odometry with this probability only (normal distribution; 4
    σ)."""
    jump_inlier_ratio: float = 0.75
    """Least share of the beams on the map that must agree with it after a jump."""
    jump_free_space: float = 0.75
    """Least share of the map in view that must be seen after a jump (free-space consistency)."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError)
        check_between(self, SlamConfigError, "odometry check: ", false_alarm=_RATES, jump_false_alarm=_RATES)

    @property
    def jump(self) -> Tolerance:
        """No match so near to odometry is a jump."""
        return Tolerance(self.jump_distance, self.jump_turn)


@dataclass(frozen=True, kw_only=True)
class TrackingConfig:
    """Which pose of a scan is believed, and when tracking is lost."""

    odometry_ratio: float = 4.0
    """Ratio of variances (match over odometry) from which on a direction is shared with odometry."""
    refuted_distance2: float = 200.0
    """Squared Mahalanobis distance from which on odometry is no longer imprecise but wrong: the match stands alone."""
    same_optimum_distance: float = 4.0
    """Poses no farther apart than so many standard deviations of a tracked position are one optimum."""
    same_optimum_turn: float = 5.0
    """Poses turned by no more than so many standard deviations of a tracked heading are one optimum."""
    turning_step: float = 2.0
    """A step that is no longer than so many of the one before is sudden, if it is, for its turn."""
    known_overlap: float = 0.3
    """Least share of the beams on the map in a scan that is explained though it sees much new."""
    known_agreement: float = 0.8
    """Least share of those beams that agree with the map, and of the map in view that is seen, in such a scan."""
    loss_keys: int = 3
    """After so many key scans that match only each other tracking is lost: the tentative map takes over."""
    unknown_scans: int = 5
    """After so many scans that neither odometry nor a match speaks for, a robot may be anywhere."""
    polished: float = 0.15
    """Where turns are known and nearly all guesses lie nearer than this [m], a polished guess is enough. Farther off,
    it is found credible where it stands: along a corridor a wrong place explains as many beams, and a wrong turn no
    longer gives it away."""
    max_step: float = 10.0
    """No robot moves farther from one scan to the next [m]: 180 km/h at 5 Hz."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError, positive=("loss_keys",))


@dataclass(frozen=True, kw_only=True)
class CalibrationConfig:
    """What the matches of a log tell of its odometry: bias, delay, mount, noise; and of its gyro."""

    min_keys: int = 20
    """Fewest matched key scans to calibrate from."""
    window: int = 5
    """Key scans over which moves are compared: the noise of single steps makes a scale fitted to them too small."""
    min_turn: Radians = 0.3
    """Only windows that turn by more than this tell the scale of turns [rad]."""
    scale_sigma: float = 0.05
    """Standard deviation, before any data, of the scale of moves and of turns."""
    drift_sigma: float = 0.05
    """Standard deviation, before any data, of the drift of the heading [rad/m]."""
    delay_sigma: float = 0.7
    """Standard deviation, before any data, of the delay [scans]."""
    mount_ahead_sigma: float = 0.2
    """Standard deviation, before any data, of how far ahead the laser sits [m]."""
    mount_aside_sigma: float = 0.1
    """Standard deviation, before any data, of how far aside the laser sits [m]."""
    mount_heading_sigma: Radians = 0.03
    """Standard deviation, before any data, of the heading of the laser [rad]."""
    max_delay: int = 16
    """Scans up to which a delay is looked for."""
    delay_gain: float = 2.0
    """So many times smaller must the mean square of the differences become by a delay of several scans."""
    wrong_turn: Radians = 0.3
    """A match that differs by more differs by no more than this: it may be wrong itself [rad]."""
    outlier_sigmas: float = 3.0
    """Standard deviations beyond which a difference counts as being so far and no farther."""
    max_claimed: float = 2.0
    """What cancels from step to step is the match's up to so many times the variance it claims; the rest is clocks."""
    floor_gain: float = 10.0
    """F statistic from which on an error that does not grow with the way explains more than chance would."""
    min_floor: float = 0.05
    """No odometry is believed to be off by less, without any motion, than this share of its usual deviation."""
    max_persistence: float = 4.0
    """By how much the variance is widened at most for errors that persist."""
    gyro_false_alarm: float = 1e-4
    """A gyro counts, and so does a further axis of it, where chance explains as much with a smaller probability."""
    gyro_min_turns: int = 10
    """Fewest turns between matched key scans that tell anything of a gyro: four coefficients and their scatter."""
    gyro_max_delay: float = 3.0
    """Scans up to which the delay of a gyro is looked for."""
    velocity_scans: int = 5
    """Scans whose motion tells the velocity that is taken to be constant."""
    velocity_min_steps: int = 10
    """Fewest steps that tell how well a constant velocity is kept."""

    def __post_init__(self) -> None:
        sigmas = ("scale_sigma", "drift_sigma", "delay_sigma", "mount_ahead_sigma", "mount_aside_sigma")
        check_numbers(self, SlamConfigError, positive=(*sigmas, "mount_heading_sigma", "window", "min_keys"))
        check_between(self, SlamConfigError, "calibration: ", gyro_false_alarm=_RATES, max_delay=(0, 1000))
        check_between(
            self,
            SlamConfigError,
            "calibration: ",
            gyro_min_turns=(5, 10**6),
            velocity_min_steps=(1, 10**6),
            velocity_scans=(1, 1000),
        )
