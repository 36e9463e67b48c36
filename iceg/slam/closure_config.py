"""Settings of loop closures: which are consistent, and when parts of a broken path are joined."""

from dataclasses import dataclass, field
from math import pi

from graph.ranges import RATES, between, positive
from graph.units import Radians
from iceg.slam.agreement import Tolerance
from iceg.slam.checked_settings import SlamSettings
from iceg.slam.contradiction import ContradictionConfig


@dataclass(frozen=True, kw_only=True)
class VerificationConfig(SlamSettings):
    """Where loop closures are matched, and which of them agree."""

    trusted_distance: float = 0.3
    """Largest standard deviation in position at which a search trusts the estimate [m]."""
    trusted_turn: Radians = 0.1
    """Largest standard deviation in heading at which a search trusts the estimate [rad]."""
    uncertain_distance: float = 1.0
    """From this standard deviation on no match is believed without asking what else fits, however close it is [m]."""
    refined_distance: float = 0.03
    """Standard deviation in position of a match around a pose that a wide search found [m]."""
    refined_turn: Radians = 0.01
    """Standard deviation in heading of a match around a pose that a wide search found [rad]."""
    anywhere_distance: float = 1.0
    """A closure that somebody adds by hand is searched within three times this [m]."""
    anywhere_turn: Radians = pi / 3.0
    """A closure that somebody adds by hand is searched within three times this turn [rad]."""
    near_distance: float = 0.4
    """A closure agrees with the estimate if it is no farther off than this [m]."""
    near_turn: Radians = 0.12
    """A closure agrees with the estimate if it is turned by no more than this [rad]."""
    partner_distance: float = positive(0.25)
    """Two closures are consistent that differ by less than this [m]."""
    partner_turn: Radians = positive(0.05)
    """Two closures are consistent that are turned against each other by less than this [rad]."""
    partner_keys: int = 60
    """Most key poses between two closures that can be consistent."""
    place_distance: float = 0.5
    """Poses of one key scan no farther apart than this are one place [m]."""
    place_turn: Radians = 0.1
    """Poses of one key scan turned by no more than this are one place [rad]."""

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
        """Standard deviations of the search for a closure by hand."""
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
class PlaceVotesConfig(SlamSettings):
    """When another place fits key scans as well as that of a closure (perceptual aliasing)."""

    rival_share: float = 1.0 / 3.0
    """Another place does not count that no larger share of the key scans fit."""
    many: int = 6
    """Fewest key scans that can outweigh another place by fitting this one better."""
    margin: float = 0.05
    """Least difference of the misfits, in the mean, by which they do."""
    strong_share: float = 0.5
    """Least share of the key scans searched that must fit a place whose vote is strong."""
    strong_misfit: float = 0.1
    """Largest misfit, in the mean, of a place whose vote is strong."""


@dataclass(frozen=True, kw_only=True)
class TrackingFailureConfig(SlamSettings, prefix="failures: "):
    """At which steps of the path tracking may have failed, and what settles it."""

    false_alarm: float = between(1.544e-5, *RATES)
    """A match contradicts odometry where chance puts it so far off with this probability only (χ², 3 degrees of
    freedom; 5 σ): the step is suspect, and odometry is widened until chance explains it."""
    carried: float = 0.6
    """A match so far from odometry [m, or metres per metre driven if that is more] is suspect whatever it claims."""
    min_inlier_ratio: float = 0.7
    """A match that explains less of a scan is suspect where few closures span the step."""
    settling_closures: int = 10
    """So many closures that span a step settle what failed there."""
    unknown_distance: float = between(0.5, 1e-3, 1000.0)
    """Standard deviation in position of a step between key scans that neither odometry nor a match has seen [m]."""
    unknown_turn: Radians = between(0.5, 1e-3, 1000.0)
    """Standard deviation in heading of such a step [rad]."""
    doubt: float = between(0.05, *RATES)
    """From this probability on that the robot was carried where tracking failed, and no closure tells, or that it was
    found again at the wrong place, the run says so and covariances allow for it."""

    @property
    def unknown(self) -> Tolerance:
        """Standard deviations of a step that nothing has seen."""
        return Tolerance(self.unknown_distance, self.unknown_turn)


@dataclass(frozen=True, kw_only=True)
class ViewChangeConfig(SlamSettings, prefix="view: "):
    """By how much what the laser sees changes from scan to scan, and whether the robot was carried then."""

    distance: float = 0.05
    """Two scans agree about a beam that ends within this of what the other sees there [m]."""
    share: float = 0.02
    """Two scans agree about a beam that ends within this share of its range, added to that distance."""
    step_distance: float = between(0.5, 1e-3, 100.0)
    """Where the view seems to have changed at once the two scans are matched to each other: standard deviation in
    position of the step that tracking has found [m]."""
    step_turn: Radians = between(0.3, 1e-3, 10.0)
    """The same in heading [rad]."""
    most_elsewhere: int = between(60, 1, 1_000_000)
    """So many pairs of scans of different parts of the log tell how much the view changes if the robot is carried."""
    most_beams: int = between(120, 1, 1_000_000)
    """Most beams of a scan that are looked at, evenly spread."""
    min_compared: int = 10
    """So many beams of one of two scans at least must be comparable: where walls were and nothing returns any more, the
    view has changed, too."""
    keys: int = between(3, 1, 1000)
    """So many key scans before a failure the view may have changed."""
    most_steps: int = between(1000, 1, 1_000_000)
    """Most steps of the log that tell how the view changes by chance."""
    min_steps: int = 50
    """Fewest such steps; of a log with fewer nothing is said."""
    tail: float = between(0.05, *RATES)
    """Share of the steps, those that change most, to which a Pareto tail is fitted."""
    window: float = between(0.1, 1e-3, 1.0)
    """Changes within this of one tell how probable it is for a robot that is carried."""
    any_change: float = positive(10.0)
    """So many pairs of scans it is worth that such a change may be anything, before any is seen."""
    carried_prior: float = between(0.03, *RATES)
    """Probability, before anything is seen, that the robot was carried somewhere in a log in which tracking fails."""
    unnoticed: float = between(0.05, *RATES)
    """Probability that nothing fails where a robot is carried."""
    usual_failures: float = positive(0.15)
    """Failures of tracking in a log, in the mean, beside those of a robot that is carried."""
    slip: float = between(0.05, *RATES)
    """Probability that wheels slip where match and odometry contradict each other, so that they may do so by
    anything."""
    magnitudes: float = positive(10.0)
    """So many factors of e lie between the least squared distance of such a contradiction and the largest, 25 and
    10⁶."""

    @property
    def step(self) -> Tolerance:
        """Standard deviations of a step that tracking has found."""
        return Tolerance(self.step_distance, self.step_turn)


@dataclass(frozen=True, kw_only=True)
class MapAlignmentConfig(SlamSettings, prefix="relocalisation: maps: "):
    """How the maps of two parts of the path are laid onto each other, and what that tells."""

    cell: float = between(0.2, 0.02, 10.0)
    """Cell of the maps that are compared [m]."""
    most_cells: int = between(192, 16, 4096)
    """For the search cells are larger where a map would be wider than so many."""
    most_compared: int = between(2000, 16, 20_000)
    """For the comparison they are where it would be wider than so many."""
    resolution: float = between(16.0, 1.0, 1e6)
    """Log-odds of a cell are multiples of the inverse of this, so that sums are the same on every machine."""
    reach: float = between(25.0, 1.0, 1000.0)
    """Farthest that a beam is entered [m]."""
    most_rays: int = between(20_000, 100, 10_000_000)
    """Most beams of a part that are entered, evenly spread."""
    path: float = between(60.0, 1.0, 1e6)
    """Path after the break whose map is laid onto what was before [m]."""
    least_share: float = between(0.25, 0.0, 1.0)
    """Share of the beams through a cell that must end there for it to be occupied."""
    agree: float = between(0.98, 0.5, 1.0 - 1e-6)
    """Probability that a cell is what the other map shows there where the parts lie rightly."""
    each_rotation: int = between(3, 1, 100)
    """So many shifts of each rotation are kept."""
    most: int = between(10, 1, 1000)
    """So many ways in which the maps fit are verified, the best."""
    apart: float = between(1.0, 0.01, 1000.0)
    """Ways are distinct that put the middle of a part farther apart than this [m]."""
    turned: Radians = between(0.15, 0.001, pi)
    """Ways are distinct that turn it by more than this against each other [rad]."""
    scans: int = positive(32)
    """So many key scans are matched where a way puts them."""
    cell_weight: float = between(0.45, 0.0, 10.0)
    """Cells are not independent of each other: log-odds by the root of what they would tell if they were."""
    scan_weight: float = between(0.5, 0.0, 10.0)
    """Nor are the key scans that are matched: share that is left of what they would tell."""
    elsewhere: float = positive(8.0)
    """Log-odds at which a way is as probable as that the parts have seen nothing of each other."""
    suspected: float = between(0.01, *RATES)
    """From this probability on that the robot was carried where tracking failed the maps are asked."""
    most_failures: int = positive(6)
    """So many failures they are asked about at a time, those where it was carried most probably."""
    most_searches: int = positive(24)
    """So often in all they are asked about a failure."""
    most_parts: int = positive(3)
    """So many parts of what was before they are laid onto, the one just before and those of most key scans."""

    @property
    def one_way(self) -> Tolerance:
        """Between two ways that are one."""
        return Tolerance(self.apart, self.turned)


@dataclass(frozen=True, kw_only=True)
class RelocalisationConfig(SlamSettings, prefix="relocalisation: "):
    """What joins parts of a broken path."""

    contradiction: ContradictionConfig = field(default_factory=ContradictionConfig)
    """What share of the scans contradicts a place that is right, and one that is wrong."""
    maps: MapAlignmentConfig = field(default_factory=MapAlignmentConfig)
    """How the maps of two parts of the path are laid onto each other."""
    scan_distance: float = 0.3
    """Standard deviation in position of a scan that is matched where maps put it [m]."""
    scan_turn: Radians = 0.1
    """Standard deviation in heading of such a scan [rad]."""
    min_overlap: float = 0.5
    """From this overlap on a scan that does not agree contradicts what was seen there."""

    @property
    def scan(self) -> Tolerance:
        """Standard deviations of a scan that is matched where maps put it."""
        return Tolerance(self.scan_distance, self.scan_turn)


@dataclass(frozen=True, kw_only=True)
class ConfirmedAreaConfig(SlamSettings):
    """Where passes show nothing new, so that loops are looked for more seldom."""

    distance: float = 0.1
    """An area is confirmed where earlier passes put the newest pose no farther off than this [m]."""
    turn: Radians = 0.03
    """An area is confirmed where earlier passes turn the newest pose by no more than this [rad]."""
    passes: int = 3
    """Fewest earlier passes that confirm an area."""
    spacing: float = positive(3.0)
    """How many times more seldom loops are looked for in a confirmed area."""
    small_distance: float = 0.05
    """Closures that move the newest pose by less than this leave all poses before the last search where they are
    [m]."""
    small_turn: Radians = 0.015
    """Closures that turn the newest pose by less than this do so, too [rad]."""
    max_waiting: int = 15
    """Most such closures in a row."""

    @property
    def confirming(self) -> Tolerance:
        """Between the newest pose and where an earlier pass puts it."""
        return Tolerance(self.distance, self.turn)

    @property
    def small(self) -> Tolerance:
        """A correction that only the newest poses follow."""
        return Tolerance(self.small_distance, self.small_turn)
