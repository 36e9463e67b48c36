"""Settings of tracking: what a scan must see, when odometry and mount are believed, when tracking is lost."""

from dataclasses import dataclass, field
from math import pi

from graph.odometry import OdometryModel, check_odometry_setting
from graph.ranges import RATES, between, positive
from graph.units import Radians
from iceg.slam.agreement import Tolerance
from iceg.slam.checked_settings import SlamConfigError, SlamSettings
from iceg.slam.contradiction import ContradictionConfig


@dataclass(frozen=True, kw_only=True)
class SightConfig(SlamSettings):
    """What a scan must see to be matched, or to speak against odometry."""

    blind_range: float = 0.5
    """A scan most of whose beams end within this sees nothing: the laser is covered [m]."""
    blind_share: float = 0.8
    """Least share of the returns that end so close in a scan that sees nothing."""
    min_returns: float = 0.1
    """That a scan with a smaller share of returns matches nothing does not mean that the robot is on new ground."""
    few_returns: float = 1.0 / 3.0
    """Where a smaller share of the beams returns, and most from nearby, people close by pass for walls."""
    far: float = 10.0
    """Returns from beyond this come from afar [m]."""


@dataclass(frozen=True, kw_only=True)
class StandstillConfig(SlamSettings, prefix="standstill: "):
    """When odometry stands still although the robot moves."""

    held_prior: float = between(0.001, *RATES)
    """How probable it is that odometry which repeats a reading has not been read anew while the robot moved, before
    the velocities of the log tell how often that is so."""
    stops: float = between(0.1, *RATES)
    """No robot starts from rest in a larger share of its moves: where more follow upon a standstill, the others are
    readings that are held."""
    fastest: float = 2.0
    """Nobody moves more times as fast while a reading is held as in all but one in a hundred of the other steps."""
    held_longest: float = between(3.0, 0.0, 3600.0)
    """A reading that is held for longer [s] tells nothing of the way meanwhile, which need not be the arc from one
    reading to the next: odometry counts as dead."""
    held_scans: int = positive(10)
    """A reading that is held over no more scans than this is never long: where scans are seldom, or have no stamps,
    seconds tell little."""
    held_freedom: float = between(3.0, 1.0, 1000.0)
    """Degrees of freedom of Student's t for changes of velocity: robots stop and start abruptly."""
    least_change: float = positive(0.001)
    """Standard deviation of the change of velocity from one scan to the next, at least [m, rad]."""
    ends: int = 3
    """Scans at either end of a standstill that may show the robot's move already, or still: two clocks."""
    samples: int = positive(64, 1, 100_000)
    """Scans of a standstill that are compared with the one among them that sees most."""
    min_change: float = 0.1
    """Least change of the readings that only a move explains [m]."""
    min_change_factor: float = 3.0
    """Least change of the readings that only a move explains, in changes from one scan to the next."""
    unchanged_share: float = between(0.25, 0.0, 1.0)
    """Largest share of the beams that may change less when the robot moves: people hide what is behind them."""
    changed_samples: int = 3
    """Fewest scans that must show the change."""
    min_seen: float = between(0.05, 0.0, 1.0)
    """Least share of the beams that must return in a scan that tells of a change: a covered laser sees nothing."""
    min_motion: float = 0.3
    """Odometry that stands is dead only where the scans tell of a motion farther than this [m, rad]."""

    @property
    def unjudged(self) -> int:
        """Most scans of a standstill that are too few to tell whether the robot moves."""
        return 2 * self.ends + self.changed_samples


@dataclass(frozen=True, kw_only=True)
class MountConfig(SlamSettings):
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


@dataclass(frozen=True, kw_only=True)
class OdometryCheckConfig(SlamSettings, prefix="odometry check: "):
    """When a match contradicts odometry, and what it takes to be believed all the same."""

    false_alarm: float = between(1.544e-5, *RATES)
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
    jump_false_alarm: float = between(6.334e-5, *RATES)
    """A match is a jump that chance puts so far from odometry with this probability only (normal distribution; 4
    σ)."""
    jump_odds: float = positive(100.0)
    """What is seen must be so many times as probable after a jump as where odometry has the robot."""
    refused_odds: float = positive(5.0)
    """A jump that is so many times as probably wrong as right is refused."""
    reach_distance: float = positive(0.1)
    """Any robot may go so far from one scan to the next [m]; farther, if most of its steps are longer."""
    reach_turn: Radians = positive(0.2)
    """Any robot may turn so far from one scan to the next [rad]."""
    reach_of_mean: float = positive(2.0)
    """Steps reach so many times as far as those that the newest matches tell of, in the mean, if odometry says less."""
    reach_scans: int = positive(64)
    """Scans over which that mean is taken."""
    carried: float = between(1e-6, *RATES)
    """Probability that a robot of which odometry knows nothing went farther than its steps reach, as one that is
    carried, and yet no farther than the local map."""
    contradiction: ContradictionConfig = field(default_factory=ContradictionConfig)
    """What share of what is seen contradicts a pose."""
    ground: ContradictionConfig = field(
        default_factory=lambda: ContradictionConfig(right=0.2, right_strength=3.0, wrong=0.5, wrong_strength=2.0)
    )
    """What share of a scan lies on new ground: little of one that was taken close to the scans before."""
    crowded: float = between(0.05, *RATES)
    """Probability that a scan is taken among people: then its beams end before walls anywhere, and who walks along
    is matched as well. What the beams look through tells all the same."""

    @property
    def jump(self) -> Tolerance:
        """No match so near to odometry is a jump."""
        return Tolerance(self.jump_distance, self.jump_turn)


@dataclass(frozen=True, kw_only=True)
class VelocityFilterConfig(SlamSettings, prefix="velocity filter: "):
    """How a robot goes on from scan to scan where no odometry tells."""

    ahead_at_first: float = positive(0.2)
    """Standard deviation of the velocity along the robot before any match tells it [m per scan]."""
    aside_at_first: float = positive(0.05)
    """Standard deviation of the velocity to its side [m per scan]."""
    change_ahead: float = positive(0.06)
    """Standard deviation by which the velocity along the robot changes from one scan to the next [m per scan]."""
    change_aside: float = positive(0.01)
    """Standard deviation by which the velocity to its side changes [m per scan]."""
    kept_aside: float = between(0.7, 0.0, 1.0)
    """Share of the velocity to the side that is left after a scan: robots go ahead."""
    points_together: float = positive(3.0)
    """So many points of a scan measure its position as one does: those in a row err together."""
    match_deviation: float = positive(0.01)
    """Standard deviation of a match at least [m]."""


@dataclass(frozen=True, kw_only=True)
class TrackingConfig(SlamSettings):
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
    loss_keys: int = positive(3)
    """After so many key scans that match only each other tracking is lost: the tentative map takes over."""
    unknown_scans: int = 5
    """After so many scans that neither odometry nor a match speaks for, a robot may be anywhere."""
    max_step: float = 10.0
    """No robot moves farther from one scan to the next [m]: 180 km/h at 5 Hz."""
    velocity: VelocityFilterConfig = field(default_factory=VelocityFilterConfig)
    """How it goes on where no odometry tells."""
    unknown_odometry: OdometryModel = field(
        default_factory=lambda: OdometryModel(
            along_per_metre=0.3,
            across_per_metre=0.3,
            heading_per_metre=0.3,
            along_floor=0.1,
            across_floor=0.1,
            heading_floor=0.1,
        )
    )
    """What a constant velocity tells in a log without odometry."""

    def __post_init__(self) -> None:
        super().__post_init__()
        check_odometry_setting(self.unknown_odometry, SlamConfigError, "unknown_odometry")


@dataclass(frozen=True, kw_only=True)
class SmoothingConfig(SlamSettings, prefix="smoothing: "):
    """How scans between two key scans are smoothed by odometry."""

    outlier_sigmas: float = positive(6.0)
    """A step that differs from its matches by more robust standard deviations than this counts as if by so many."""
    freedom: float = between(3.0, 0.1, 1e6)
    """Degrees of freedom of Student's t that errors of matches and odometry have: wheels slip, and somebody who walks
    by takes a match along."""
    chance: float = between(0.02275, *RATES)
    """Steps in a row share the error of the match between them where chance explains their covariance with a smaller
    probability (normal distribution, one side; 2 σ). So much of it is not counted."""


@dataclass(frozen=True, kw_only=True)
class SplitHalfConfig(SlamSettings, prefix="split half: "):
    """Whether matches are as sure as they say: two halves of one scan, matched alone, must agree."""

    scans: int = between(40, 0, 100_000)
    """Scans whose halves are matched alone; 0 believes the matches."""
    window: int = between(12, 1, 1000)
    """Key scans in the local map that they are matched to."""
    usual_distance2: float = between(1.2, 0.01, 100.0)
    """Geometric mean of the squared Mahalanobis distances between halves in simulated scenes. They lie nearer together
    than the 2.1 of three degrees of freedom: the covariance of a match is that of a step between two key scans, on a
    map that errs too."""
    min_distance2: float = between(0.05, 1e-6, 100.0)
    """Squared distances are not taken to be smaller: halves that agree by chance prove nothing."""
