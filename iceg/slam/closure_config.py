"""Settings of loop closures: which are consistent, which places similar, and when parts of a broken path are joined."""

from dataclasses import dataclass
from math import pi

from graph.ranges import check_between, check_numbers
from graph.units import Radians
from iceg.slam.agreement import Tolerance
from iceg.slam.config_error import SlamConfigError

_RATES = (1e-9, 0.5)
"""Of false alarms."""


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
