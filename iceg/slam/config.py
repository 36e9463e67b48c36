"""Settings of the SLAM system around the matcher."""

from dataclasses import dataclass, field
from math import pi

from graph.errors import IcegError
from graph.ranges import check_between, check_magnitudes, check_numbers
from graph.units import Radians
from iceg.slam.agreement import Tolerance


class SlamConfigError(IcegError):
    """A setting of the SLAM system outside its range."""


_STEPS = (1e-3, 1000.0)
"""Between key scans [m, rad]."""
_RATES = (1e-9, 0.5)
"""Of false alarms."""


@dataclass(frozen=True, kw_only=True)
class KeyScanConfig:
    """When a scan becomes a key scan, and which of them make up the local reference."""

    distance: float = 0.35
    """A new key scan after driving this far [m]."""
    angle: Radians = 0.4
    """A new key scan after turning this far [rad]."""
    window: int = 25
    """Key scans in the local reference."""
    rebuild: int = 8
    """The reference is built anew after this many key scans; in between it is only extended."""

    def __post_init__(self) -> None:
        if not (self.distance > 0 and self.angle > 0):
            raise SlamConfigError(f"key_scans: distance {self.distance} and angle {self.angle} must be positive")
        if self.window < 1 or self.rebuild < 1:
            raise SlamConfigError(f"key_scans: window {self.window} and rebuild {self.rebuild} must be at least 1")
        check_between(self, SlamConfigError, "key_scans: ", distance=_STEPS, angle=_STEPS, window=(1, 1000))


@dataclass(frozen=True, kw_only=True)
class SightConfig:
    """What a scan must see to be matched, or to speak against odometry."""

    blind_range: float = 0.5
    """A scan most of whose beams end within this sees nothing: the laser is covered [m]."""
    blind_share: float = 0.8
    """Least share of the returns that end so close in a scan that sees nothing."""
    min_returns: float = 0.1
    """A scan with a smaller share of returns sees nothing either …"""
    min_far_returns: int = 20
    """… unless so many return, most of them from afar: on open ground a laser of many beams meets little, but sees."""
    few_returns: float = 1.0 / 3.0
    """Where a smaller share of the beams returns, people close by pass for walls …"""
    far: float = 10.0
    """… but not where most of those that return come from beyond this [m]."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError)


@dataclass(frozen=True, kw_only=True)
class OpenGroundConfig:
    """When a log was taken on open ground, where posts and trunks count as features."""

    near: float = 10.0
    """Returns from within this are nearby [m] …"""
    max_near_beams: float = 0.12
    """… on open ground fewer of the beams than this share …"""
    max_near_returns: float = 0.5
    """… and no more than this share of those that return."""
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
    """Change of the readings that only a move explains [m] …"""
    min_change_factor: float = 3.0
    """… and how many times that from one scan to the next …"""
    unchanged_share: float = 0.25
    """… if no more than this share of the beams is changed less, for people hide what is behind them …"""
    changed_samples: int = 3
    """… and scans that must show it."""
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
    """Turns between two key scans tell their sense if they are larger than this [rad] …"""
    max_turn: Radians = 2.0 * pi / 3.0
    """… and smaller than this [rad]."""
    against_share: float = 0.8
    """Share of the turns, weighed by their size, from which on they are made against the odometry …"""
    min_motions: int = 10
    """… by at least so many."""
    straight_turn: Radians = pi / 18.0
    """A motion tells where the laser looks if it turns by less than this [rad] …"""
    straight_distance: float = 0.15
    """… and moves by more than this [m]."""
    askew: Radians = 5.0 * pi / 36.0
    """A laser that looks farther aside than this is more than the calibration deals with [rad] …"""
    askew_share: float = 0.25
    """… in so many of the motions …"""
    askew_agreement: float = 0.8
    """… and length of the mean of the directions of motion, each as a vector of length 1, if these agree."""
    lost_share: float = 0.3
    """Where more of the key scans than this match nothing, a laser that looks backwards is tried …"""
    lost_gain: float = 0.5
    """… which must leave no more of them than this share."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError)


@dataclass(frozen=True, kw_only=True)
class OdometryCheckConfig:
    """When a match contradicts odometry, and what it takes to be believed all the same."""

    false_alarm: float = 1.544e-5
    """A match contradicts odometry where chance puts it so far off with this probability only (χ², 3 degrees of
    freedom; 5 σ)."""
    min_evidence: float = 0.75
    """A match constrained to odometry is preferred if it explains this share of what the free one does …"""
    evidence_slope: float = 1.0 / 800.0
    """… and all of it but for so much per squared Mahalanobis distance of the free one from odometry."""
    jump_distance: float = 0.3
    """A match farther from odometry than this [m] …"""
    jump_turn: Radians = 0.26
    """… or this [rad] …"""
    jump_false_alarm: float = 6.334e-5
    """… which chance explains with this probability only (normal distribution; 4 σ) is a jump …"""
    jump_inlier_ratio: float = 0.75
    """… and needs this share of the beams on the map to agree with it …"""
    jump_free_space: float = 0.75
    """… and this share of the map in view to be seen (free-space consistency)."""

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
    """Poses no farther apart than so many standard deviations of a tracked position are one optimum …"""
    same_optimum_turn: float = 5.0
    """… nor than so many of a tracked heading."""
    turning_step: float = 2.0
    """A step that is no longer than so many of the one before is sudden, if it is, for its turn."""
    known_overlap: float = 0.3
    """A scan is explained if this share of its beams is on the map …"""
    known_agreement: float = 0.8
    """… where this share of the beams agrees, and of the map in view is seen."""
    tentative_evidence: float = 0.5
    """The key scans of a tentative map come along to the known one if together they explain this share of what the
    newest does there."""
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
    """… of the drift of the heading [rad/m]."""
    delay_sigma: float = 0.7
    """… of the delay [scans]."""
    mount_ahead_sigma: float = 0.2
    """… of where the laser sits, ahead [m] …"""
    mount_aside_sigma: float = 0.1
    """… and aside [m]."""
    mount_heading_sigma: Radians = 0.03
    """… of the heading of the laser [rad]."""
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
    velocity_min_steps: int = 10
    """Fewest steps that tell how well a constant velocity is kept."""

    def __post_init__(self) -> None:
        sigmas = ("scale_sigma", "drift_sigma", "delay_sigma", "mount_ahead_sigma", "mount_aside_sigma")
        check_numbers(self, SlamConfigError, positive=(*sigmas, "mount_heading_sigma", "window", "min_keys"))
        check_between(self, SlamConfigError, "calibration: ", gyro_false_alarm=_RATES, max_delay=(0, 1000))
        check_between(self, SlamConfigError, "calibration: ", gyro_min_turns=(5, 10**6), velocity_min_steps=(1, 10**6))


@dataclass(frozen=True, kw_only=True)
class FrontEndConfig:
    """Matching scan after scan against the local reference."""

    key_scans: KeyScanConfig = field(default_factory=KeyScanConfig)
    sight: SightConfig = field(default_factory=SightConfig)
    """What a scan must see."""
    open_ground: OpenGroundConfig = field(default_factory=OpenGroundConfig)
    """When posts and trunks count."""
    standstill: StandstillConfig = field(default_factory=StandstillConfig)
    """When odometry is dead, or read seldom."""
    mount: MountConfig = field(default_factory=MountConfig)
    """When the laser is mounted otherwise."""
    odometry_check: OdometryCheckConfig = field(default_factory=OdometryCheckConfig)
    """When a match contradicts odometry."""
    tracking: TrackingConfig = field(default_factory=TrackingConfig)
    """Which pose of a scan is believed."""
    calibration: CalibrationConfig = field(default_factory=CalibrationConfig)
    """What matches tell of odometry and gyro."""
    calibrate_odometry: bool = True
    """Learn bias, time shift and noise of the odometry from the log's own matches."""
    calibration_path: float = 40.0
    """Path by odometry that the first pass takes, which calibrates [m]; it ends once path and turning are enough."""
    calibration_turn: Radians = 25.0
    """Turning by odometry that the first pass takes [rad]."""
    calibration_scans: int = 2500
    """Scans after which the first pass ends in any case."""
    tracking_distance: float = 0.02
    """Standard deviation of the position between two key scans [m]."""
    tracking_angle: Radians = 0.01
    """Standard deviation of the heading between two key scans [rad]."""
    deskew: bool = True
    """Move every beam by the motion within the sweep of the laser: as long as the log says it takes, else as long as
    its scans tell. Off takes all beams of a scan as measured at once."""
    gyro: bool = True
    """In a log without odometry, take the turn rate of a gyro for odometry of the heading if the matches confirm it."""
    split_scans: int = 40
    """Scans whose halves are matched alone, to see whether matches are as sure as they say; 0 believes them."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError, positive=("calibration_scans", "tracking_distance", "tracking_angle"))


@dataclass(frozen=True, kw_only=True)
class VerificationConfig:
    """Where loop closures are matched, and which of them agree."""

    min_overlap_ratio: float = 0.5
    """A key scan that overlaps with a pass by less than this share of `min_overlap`, at the pose where the estimate
    puts it, is not matched: on four public logs none was accepted that overlaps by less than 0.75 of it."""
    trusted_distance: float = 0.3
    """Up to this standard deviation in position a search trusts the estimate [m] …"""
    trusted_turn: Radians = 0.1
    """… and up to this one in heading [rad]."""
    uncertain_distance: float = 1.0
    """From this standard deviation on no match is believed without asking what else fits, however close it is [m]."""
    refined_distance: float = 0.03
    """Standard deviation in position of a match around a pose that a wide search found [m] …"""
    refined_turn: Radians = 0.01
    """… and in heading [rad]."""
    anywhere_distance: float = 1.0
    """Two similar places are searched within three times this [m] …"""
    anywhere_turn: Radians = pi / 3.0
    """… and this [rad]."""
    near_distance: float = 0.4
    """A closure no farther than this from the estimate [m] …"""
    near_turn: Radians = 0.12
    """… and this [rad] is near it."""
    partner_distance: float = 0.25
    """Two closures are consistent that differ by less than this [m] …"""
    partner_turn: Radians = 0.05
    """… and this [rad] …"""
    partner_keys: int = 60
    """… if no more than so many key poses lie between them."""
    place_distance: float = 0.5
    """Poses of one key scan no farther apart than this [m] …"""
    place_turn: Radians = 0.1
    """… and this [rad] are one place."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError)

    @property
    def trusted(self) -> Tolerance:
        """How far a search trusts the estimate."""
        return Tolerance(self.trusted_distance, self.trusted_turn)

    @property
    def refined(self) -> Tolerance:
        """Standard deviations of a pose that a wide search found."""
        return Tolerance(self.refined_distance, self.refined_turn)

    @property
    def anywhere(self) -> Tolerance:
        """Standard deviations of the search for a similar place."""
        return Tolerance(self.anywhere_distance, self.anywhere_turn)

    @property
    def near(self) -> Tolerance:
        """Between a closure and an estimate that agree."""
        return Tolerance(self.near_distance, self.near_turn)

    @property
    def partner(self) -> Tolerance:
        """Between two closures that are consistent."""
        return Tolerance(self.partner_distance, self.partner_turn)

    @property
    def place(self) -> Tolerance:
        """Between poses that are one place."""
        return Tolerance(self.place_distance, self.place_turn)


@dataclass(frozen=True, kw_only=True)
class PlaceSignatureConfig:
    """What the signature of a place is made of, by which similar places are found (place recognition)."""

    half: int = 5
    """Key scans on either side that make up the place."""
    word_reach: float = 6.0
    """Words are pairs of features within this [m]: both kinds, …"""
    word_cell: float = 0.4
    """… the distance in cells [m] …"""
    word_sectors: int = 6
    """… and the sectors of both directions against the line between them, …"""
    word_bins: int = 1024
    """… hashed into so many bins."""
    min_scans: float = 2.0
    """Only features that so many scans of the place saw make words, …"""
    merge_radius: float = 0.25
    """… those of different scans closer than this being one [m]."""
    max_features: int = 1500
    """Most features of one place."""
    point_every: int = 3
    """Only the points of every so many key scans are counted …"""
    point_reach: float = 8.0
    """… within this of the middle [m] …"""
    point_cell: float = 0.4
    """… one a cell [m] …"""
    distance_bins: int = 40
    """… in so many bins of distance between two points …"""
    distance_cell: float = 0.25
    """… each this wide [m]."""
    shape_weight: float = 0.3
    """What the distances count beside the words."""
    sequence: int = 2
    """Places on either side that are compared along with a place."""

    def __post_init__(self) -> None:
        check_numbers(
            self,
            SlamConfigError,
            positive=(
                "word_cell",
                "word_sectors",
                "word_bins",
                "point_every",
                "point_cell",
                "distance_bins",
                "distance_cell",
            ),
        )
        check_between(self, SlamConfigError, "signatures: ", word_bins=(1, 1_000_000), max_features=(1, 1_000_000))
        check_between(self, SlamConfigError, "signatures: ", distance_bins=(1, 100_000), half=(0, 1000))
        check_between(self, SlamConfigError, "signatures: ", point_reach=(0.0, 1000.0), point_cell=(0.01, 100.0))


@dataclass(frozen=True, kw_only=True)
class PlaceVotesConfig:
    """When another place fits key scans as well as that of a closure (perceptual aliasing)."""

    rival_share: float = 1.0 / 3.0
    """Another place does not count that so small a share of the key scans fit …"""
    many: int = 6
    """… nor does one where so many key scans fit this one better …"""
    margin: float = 0.05
    """… by this misfit, in the mean."""
    strong_share: float = 0.5
    """A vote is strong if this share of the key scans searched fit a place …"""
    strong_misfit: float = 0.1
    """… but for this misfit, in the mean."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError)


@dataclass(frozen=True, kw_only=True)
class TrackingFailureConfig:
    """At which steps of the path tracking may have failed, and what settles it."""

    false_alarm: float = 1.544e-5
    """A match contradicts odometry where chance puts it so far off with this probability only (χ², 3 degrees of
    freedom; 5 σ): odometry is widened, and the step is suspect."""
    widened_distance2: float = 3.0
    """Squared Mahalanobis distance of a match from the odometry that is widened for it: the mean of χ²."""
    refused_inflation: float = 25.0 / 3.0
    """Factor on the variances of odometry where it was believed against a match: the wheels may have slipped."""
    carried: float = 0.6
    """A match so far from odometry [m, or metres per metre driven if that is more] is suspect whatever it claims."""
    beyond_chance_distance2: float = 99.0
    """Squared Mahalanobis distance of a match from odometry that no chance explains."""
    min_inlier_ratio: float = 0.7
    """A match that explains less of a scan is suspect where few closures span the step …"""
    believed_inlier_ratio: float = 0.8
    """… and the path is believed where one explains this share, if nothing else speaks against it: those who walk past
    evenly spaced doors, or similar rooms, find many key scans that agree about another place."""
    settling_closures: int = 10
    """So many closures that span a step settle what failed there."""
    log_end: float = 12.0
    """A failure so near to the beginning or the end of the path matters to nobody [m]."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError, positive=("widened_distance2",))
        check_between(self, SlamConfigError, "failures: ", false_alarm=_RATES)


@dataclass(frozen=True, kw_only=True)
class RelocalisationConfig:
    """Which hypotheses join parts of a broken path."""

    max_hypotheses: int = 6
    """So many sets of closures that agree are weighed, the largest."""
    max_fits: int = 3
    """Of a pair of similar places that fit several ways, so many are kept."""
    found_distance: float = 0.1
    """Standard deviation in position of a place that a search found [m] …"""
    found_turn: Radians = 0.03
    """… and in heading [rad]."""
    same_pass: int = 3
    """Similar places so few places apart are one pass."""
    most_share: float = 0.75
    """A step that odometry and match contradict beyond all chance may be the one that closures are about if this share
    of them spans it: not all need to, the reference of one may hold key scans from both sides of a break. Any other
    step must be spanned by as many as any is."""
    false_alarm: float = 1.544e-5
    """The path explains an offset that chance makes as large with more than this probability (χ², 3 degrees of freedom;
    5 σ)."""
    spanned_covariance: float = 0.01
    """Of the covariance of a step that closures span, so much is left."""
    bias_sigmas: float = 3.0
    """The path explains an offset if a bias of up to so many standard deviations at every step does."""
    min_agreeing: int = 6
    """A hypothesis needs at least so many scans that agree with it …"""
    majority: float = 3.0
    """… and so many times those that contradict it …"""
    min_credible: int = 3
    """… or so many and a majority, where something else says the same …"""
    lead: float = 2.0
    """… and so many times what speaks for the present estimate …"""
    dissent: int = 2
    """… but to contradict a path in which nothing else has failed, the least number must be left when each scan against
    it has taken so many with it."""
    scan_distance: float = 0.3
    """Standard deviation in position of a scan that verifies a hypothesis [m] …"""
    scan_turn: Radians = 0.1
    """… and in heading [rad]."""
    min_overlap: float = 0.5
    """From this overlap on a scan that does not agree contradicts what was seen there."""
    reach: float = 8.0
    """Key scans within so much path of a closure verify it [m] …"""
    pass_length: float = 16.0
    """… against the pass of the closure, within so much path [m] …"""
    spacing: float = 1.4
    """… one so often [m], lest few be left in a log of few scans …"""
    max_keys: int = 24
    """… at most so many."""
    rival_distance: float = 2.0
    """Hypotheses that put the same scans so far apart are about different places [m]."""
    rival_support: float = 0.5
    """Another is weighed that has this share of the key scans of a hypothesis."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError)
        check_between(self, SlamConfigError, "relocalisation: ", false_alarm=_RATES)

    @property
    def found(self) -> Tolerance:
        """Standard deviations of a place that a search found."""
        return Tolerance(self.found_distance, self.found_turn)

    @property
    def scan(self) -> Tolerance:
        """Standard deviations of a scan that verifies a hypothesis."""
        return Tolerance(self.scan_distance, self.scan_turn)


@dataclass(frozen=True, kw_only=True)
class ConfirmedAreaConfig:
    """Where passes show nothing new, so that loops are looked for more seldom."""

    distance: float = 0.1
    """An area is confirmed where earlier passes put the newest pose no farther off than this [m] …"""
    turn: Radians = 0.03
    """… and this [rad] …"""
    passes: int = 3
    """… if so many do."""
    spacing: float = 3.0
    """There loops are looked for so many times more seldom."""
    small_distance: float = 0.05
    """Closures that move the newest pose by less than this [m] …"""
    small_turn: Radians = 0.015
    """… and this [rad] leave all poses before the last search where they are …"""
    max_waiting: int = 15
    """… but not so many in a row."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError, positive=("spacing",))

    @property
    def confirming(self) -> Tolerance:
        """Between the newest pose and where an earlier pass puts it."""
        return Tolerance(self.distance, self.turn)

    @property
    def small(self) -> Tolerance:
        """A correction that only the newest poses follow."""
        return Tolerance(self.small_distance, self.small_turn)


@dataclass(frozen=True, kw_only=True)
class LoopClosureConfig:
    """Finding places again."""

    enabled: bool = True
    """Off leaves odometry and matches to recent key scans only."""
    spacing: float = 1.5
    """Look for earlier passes again after driving this far [m]."""
    spacing_angle: Radians = 2.0
    """Look for earlier passes again after turning this far [rad]."""
    min_path: float = 8.0
    """A pass counts as earlier when the path since is longer than this [m]."""
    radius: float = 3.0
    """Views of the two key scans may lie this far apart, plus twice the drift [m]."""
    view_distance: float = 2.0
    """A view is the point this far ahead of the robot [m]."""
    pass_gap: int = 12
    """Key scans between two passes."""
    max_passes: int = 3
    """Most earlier passes tried for one key scan."""
    max_pieces: int = 8
    """Most pieces of passes tried for one key scan after much drift."""
    reference_half: int = 7
    """Key scans of the earlier pass on either side that make up the reference."""
    min_overlap: float = 0.4
    """Least share of the beams of a key scan and its neighbours that fall on the earlier pass."""
    min_fit: float = 0.8
    """Least share of the beams on the earlier pass that agree with it."""
    min_view: float = 0.8
    """Least share of the earlier pass in view that the beams see, instead of looking through it."""
    revisits: bool = True
    """With loop closing off: still match against earlier key scans while the drift is small, so that the reference
    holds what was seen before."""
    revisit_drift: float = 0.3
    """Largest standard deviation of the drift taken for such a revisit [m]."""
    drift_factor: float = 1.5
    """The path's covariance since the last closure is trusted only after this factor on its standard deviations."""
    odometry_inflation: float = 2.0
    """Factor on the odometry's standard deviations in a search: a chain of them may do worse than usual."""
    drift_floor: float = 0.1
    """Smallest standard deviation of a search [m]."""
    max_drift: float = 8.0
    """Largest standard deviation of a search [m]."""
    turn_floor: Radians = 0.03
    """Smallest standard deviation of a search in heading [rad]."""
    max_turn: Radians = 0.8
    """Largest standard deviation of a search in heading [rad]."""
    confirmations: int = 3
    """A closure far from the estimate waits until so many say the same."""
    path_probability: float = 0.99999
    """A true closure lies no farther from the path than its covariance explains with this probability; one that does is
    refused, for most likely it is a similar place (perceptual aliasing)."""
    relocalise: bool = True
    """Where no closure joins what follows to what was before, look for similar places anywhere (place recognition)."""
    places: int = 120
    """Most pairs of similar places that are matched; where nothing gives a break away, no more than there are bridge
    edges, steps that no closure spans."""
    places_each: int = 3
    """Most such pairs for one place."""
    place_confirmations: int = 4
    """Key scans that must agree before a recognised place is believed."""
    support_offsets: tuple[int, ...] = (-4, -2, 0, 2, 4)
    """Key scans asked to agree, relative to the one matched."""
    verification: VerificationConfig = field(default_factory=VerificationConfig)
    """Which closures agree."""
    signatures: PlaceSignatureConfig = field(default_factory=PlaceSignatureConfig)
    """By what similar places are found."""
    votes: PlaceVotesConfig = field(default_factory=PlaceVotesConfig)
    """Whether another place fits as well."""
    failures: TrackingFailureConfig = field(default_factory=TrackingFailureConfig)
    """Where tracking may have failed."""
    relocalisation: RelocalisationConfig = field(default_factory=RelocalisationConfig)
    """Which hypotheses join parts of a broken path."""
    confirmed: ConfirmedAreaConfig = field(default_factory=ConfirmedAreaConfig)
    """Where passes show nothing new."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError, positive=("confirmations", "place_confirmations"))
        check_magnitudes(self, SlamConfigError)
        check_between(
            self,
            SlamConfigError,
            radius=(0.0, 1000.0),
            max_drift=(0.0, 200.0),
            reference_half=(0, 1000),
            max_passes=(0, 1000),
            max_pieces=(0, 1000),
            places=(0, 100_000),
            places_each=(0, 1000),
            path_probability=(0.5, 1.0 - 1e-12),
        )


@dataclass(frozen=True, kw_only=True)
class JointRefinementConfig:
    """Poses and map refined together: the points of all key scans on the pieces of wall they share."""

    enabled: bool = True
    """Off leaves the poses where matches and odometry put them."""
    steps: int = 3
    """Most Gauss-Newton steps."""
    tolerance: float = 0.002
    """A step that moves the key poses by less than this on average is the last [m]."""
    cell: float = 0.1
    """Side of a cell whose points are grouped together if they face the same way [m]."""
    half_length: float = 0.25
    """Farthest along the wall that a point is grouped [m]."""
    half_width: float = 0.15
    """Farthest across the wall that a point is grouped [m]: so far may two passes lie apart."""
    facing: float = 0.9
    """Least likeness in facing of points grouped together (cosine)."""
    scale: float = 0.03
    """Width of the Cauchy weight of a point [m]."""
    independence: float = 0.165
    """Share of the points that count as independent: errors of neighbouring ones are correlated. By simulated truth."""
    reach: float = 25.0
    """Points farther than this from the robot are left out [m]."""
    telling_reach: float = 15.0
    """Points farther than this from the robot tell nothing of how well the poses are known [m]: near the end of a
    laser's range, noise decides which points return at all."""
    scans_per_key: int = 4
    """Scans of each key pose that take part: the key scan and some of those on the way to the next."""
    max_points: int = 500_000
    """Only every so many beams are used, so that there are no more points than this."""

    def __post_init__(self) -> None:
        for name in ("cell", "half_length", "half_width", "scale", "independence"):
            if not getattr(self, name) > 0.0:
                raise SlamConfigError(f"joint refinement: {name} must be positive, found {getattr(self, name)}")
        check_numbers(self, SlamConfigError)
        check_between(
            self,
            SlamConfigError,
            "joint refinement: ",
            cell=(0.01, 100.0),
            half_length=(0.01, 100.0),
            half_width=(1e-3, 100.0),
            scale=(1e-4, 100.0),
            steps=(0, 1000),
            max_points=(1, 5_000_000),
        )
        if self.max_points < 1 or self.scans_per_key < 1:
            raise SlamConfigError(
                f"joint refinement: max_points {self.max_points} and scans_per_key {self.scans_per_key} "
                "must be at least 1"
            )


@dataclass(frozen=True, kw_only=True)
class FinishConfig:
    """The offline finish after the log has been read to its end."""

    enabled: bool = True
    """Off leaves the incremental solution."""
    rounds: int = 1
    """Most rounds of matching again and optimising."""
    tolerance: float = 0.002
    """A round that moves no key pose farther than this is the last [m]."""
    spacing: float = 1.5
    """Where no closure ties two passes, match again after this much path [m]."""
    spacing_angle: Radians = 2.0
    """Where no closure ties two passes, match again after this much turning [rad]; in between, the joint refinement
    holds the passes together."""
    max_passes: int = 4
    """Most earlier passes a key scan is matched against."""
    search_distance: float = 0.08
    """Standard deviation in position of the search around the optimum [m]."""
    search_angle: Radians = 0.03
    """Standard deviation in heading of the search around the optimum [rad]."""
    kernel_width: float = 5.0
    """Φ of dynamic covariance scaling on closures (squared standard deviations)."""
    outlier_weight: float = 0.01
    """A closure whose robust kernel leaves it a smaller weight than this is an outlier, and is taken out."""
    joint: JointRefinementConfig = field(default_factory=JointRefinementConfig)
    """In the end, poses and map together."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError, positive=("kernel_width",))
        check_between(
            self,
            SlamConfigError,
            rounds=(0, 1000),
            max_passes=(0, 1000),
            search_distance=(0.0, 100.0),
        )
