"""Settings of ICE matching, one small class per stage."""

from dataclasses import dataclass, field
from math import pi
from typing import Literal

from graph.errors import IcegError
from graph.ranges import RATES, CheckedSettings, between, positive
from graph.short_repr import changed_repr
from graph.units import Radians

Fitness = Literal["points", "probabilistic", "paper"]
Search = Literal["hierarchy", "exhaustive", "genetic", "evolutionary"]


class IceConfigError(IcegError):
    """A setting of ICE outside its range."""


_CELLS = (0.01, 100.0)
_WIDTHS = (1e-3, 100.0)
_REACHES = (0.0, 200.0)
_COUNTS = (1, 10_000)
"""What lengths [m] and counts may be, so that no reference fills the memory and no search lasts for ever."""


@dataclass(frozen=True, kw_only=True)
class _IceSettings(CheckedSettings, error=IceConfigError):
    """Settings of ICE."""


@dataclass(frozen=True, kw_only=True)
class SegmentConfig(_IceSettings):
    """How a scan is cut into straight segments."""

    gap: float = positive(0.3)
    """Neighbouring points farther apart than this plus four beam spacings start a new cluster [m]."""
    split: float = positive(0.03)
    """A cluster splits where a point lies farther than this from its line [m], or than split_sigmas if that is more."""
    split_sigmas: float = 3.5
    """A cluster splits only where a point lies farther from its line than so many standard deviations of the scan's
    noise."""
    min_points: int = between(3, 2, 10_000)
    """Fewest points of a segment."""
    min_length: float = 0.2
    """Shortest segment [m]."""
    wall_points: int = 5
    """Fewest points of a segment that is a wall: in the local map its points lie on the line."""
    wall_length: float = 0.6
    """Shortest segment that is a wall [m]."""
    range_noise: float = positive(0.01)
    """Least standard deviation of a point across its line [m]."""


@dataclass(frozen=True, kw_only=True)
class FeatureConfig(_IceSettings):
    """Which corners, wall ends and intersections are kept."""

    corner_gap: float = 0.5
    """Facing ends of two segments closer than this make a corner [m]."""
    extension: float = 4.0
    """Farthest a wall is extended to an intersection [m]."""
    min_angle: Radians = positive(25.0 * pi / 180.0, most=0.5 * pi)
    """Smallest angle between the two walls of a corner or intersection [rad]."""
    weak_sigma: float = 0.5
    """Standard deviation along the wall of an end that is only occluded or cut off [m]."""
    merge_radius: float = 0.25
    """Features of different scans closer than this are one feature of the local map [m]."""


@dataclass(frozen=True, kw_only=True)
class HypothesisConfig(_IceSettings):
    """How pairs of features become relative poses and how these are ranked."""

    search: Search = "hierarchy"
    """Filters from cheap to dear over all pairs of features, a regular grid of poses over the whole window, the paper's
    genetic algorithm over (dx, dy, dθ), or differential evolution. Two single scans of MIT CSAIL that share half their
    view, in this order: from up to ±1 m and ±45° 96 % in 0.5 ms, 92 % in 2 ms, 81 % in 4 ms, 86 % in 12 ms; from up to
    ±2 m and ±90° 96 % in 0.6 ms, 92 % in 11 ms, 57 % in 4 ms, 78 % in 15 ms."""
    seed: int = 0
    """Start of the random numbers of the genetic and the evolutionary search."""
    population: int = positive(20, *_COUNTS)
    """Population of the genetic and the evolutionary search, a third of the poses of one generation."""
    generations: int = positive(40, *_COUNTS)
    """Most generations of the genetic and the evolutionary search."""
    fitness: Fitness = "points"
    """Ranking: dense point agreement, features weighed by their covariances, or equations (1)-(3) of the paper. Points
    are the default because they find as much in less time: one scan against another pass of MIT CSAIL, from up to ±1 m
    and ±45°, 97 % in 1.1 ms, 92 % in 7 ms, 98 % in 8 ms; from up to ±3 m, any heading, 94 % in 1.6 ms, 83 % in 74 ms,
    89 % in 83 ms."""
    opening_gate: Radians = 20.0 * pi / 180.0
    """Largest difference between the opening angles of two paired features [rad]."""
    field_sigma: float = positive(0.2, *_WIDTHS)
    """Width of the likelihood field that ranks hypotheses by points [m]."""
    ranking_points: int = between(90, 10, 10_000)
    """Points of the scan used to rank one hypothesis."""
    sifting_points: int = positive(30, *_COUNTS)
    """Points of the scan used to sift all hypotheses before they are ranked."""
    candidates: int = positive(12, *_COUNTS)
    """Most distinct hypotheses that are refined."""
    lead: float = 0.8
    """A hypothesis is refined if its correlation is at least this share of the best."""
    alternatives: int = positive(10, *_COUNTS)
    """Distinct hypotheses that are compared where the place may be ambiguous (loop closing after much drift)."""
    sigmas: float = 3.0
    """Size of the search window in standard deviations of the guess."""
    min_window: float = between(0.15, *_REACHES)
    """Smallest half-width of the search window [m]."""
    min_turn: Radians = 5.0 * pi / 180.0
    """Smallest half-width of the search window in heading [rad]."""

    trusted_window: float = between(0.3, *_REACHES)
    """In a larger window a credible polished guess ends the search only if it hardly moved: it may have slid along a
    corridor [m]."""
    wide_window: float = between(1.0, *_REACHES)
    """Half-width of the window of a second try, when nothing in the first explains the scan [m]."""
    wide_turn: Radians = 75.0 * pi / 180.0
    """Half-width in heading of the window of a second try [rad]."""


@dataclass(frozen=True, kw_only=True)
class RefinementConfig(_IceSettings):
    """Polish of a hypothesis on all points, point to line."""

    enabled: bool = True
    """Off leaves the pose as the features give it."""
    scale: float = between(0.04, *_WIDTHS)
    """Final width of the Cauchy weight [m]."""
    coarse_scale: float = between(0.5, *_WIDTHS)
    """Width at which the first, wide stage starts [m]."""
    iterations: int = between(20, 0, 10_000)
    """Most Gauss-Newton steps of the fine stage."""
    tracking_prior: float = 3.0
    """Pull of odometry on a pose between two key scans, in points."""
    credible: float = 0.75
    """The guess is taken without further hypotheses when this share of the points agrees after its polish."""
    wide_below: float = 0.6
    """Below this share the search is repeated in the wide window."""
    min_inliers: float = between(0.45, 0.0, 1.0)
    """A match needs at least this share of its points on the reference."""
    min_points: int = positive(15)
    """Fewest returns of a scan that is matched."""
    new_overlap: float = 0.3
    """Least share of the beams on the map in a scan that is matched though it sees much new."""
    new_agreement: float = 0.8
    """Least share of those beams that agree with the map, and of the map in view that is seen, in such a scan."""
    lead: float = 1.03
    """A hypothesis must have so many times the support of the polished guess to be preferred to it."""
    contradiction: float = 3.0
    """One beam that contradicts the reference outweighs this many points that agree with it."""
    hopeful: float = 0.5
    """Among alternatives one is polished whose points lie near the reference to this share of what is asked in the
    end."""
    alike: float = between(0.75, -1.0, 1.0)
    """Least cosine between the normals of a point and of its surfel for the point to tell where the scan lies."""
    agreeing: float = 2.0
    """A point within so many widths of its weight agrees with the reference."""
    view_reach: float = 8.0
    """Surfels within this of the laser are judged by its beams [m]."""
    contradiction_reach: float = 20.0
    """Surfaces farther than this from a laser contradict nothing: its heading is not known that well [m]."""
    margin: float = positive(0.2)
    """A beam sees a surface of the reference if it ends within this of it [m]."""
    across: float = positive(0.15)
    """A beam contradicts a surface seen at a flat angle only if it ends this far beyond it [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.scale > self.coarse_scale:
            raise IceConfigError(f"found scale {self.scale} m, expected at most coarse_scale, {self.coarse_scale} m")


@dataclass(frozen=True, kw_only=True)
class LocalMapConfig(_IceSettings):
    """The reference: surfels and features of recent and revisited key scans."""

    cell: float = between(0.1, *_CELLS)
    """Reference points in one cell that face the same way are averaged to one surfel [m]."""
    reach: float = positive(25.0, *_REACHES)
    """Points farther than this from the newest key pose are left out [m], unless its scan sees much beyond."""
    fine_radius: float = positive(0.4, *_REACHES)
    """Farthest correspondence of the fine stage [m]."""
    coarse_cell: float = between(0.2, *_CELLS)
    """Cell of the wide field [m]."""
    coarse_radius: float = positive(1.0, *_REACHES)
    """Farthest correspondence of the wide stage [m]."""
    normal_reach: float = positive(0.2)
    """Neighbours up to this far on either side give a point its normal [m]."""
    sharpen: float = between(0.0, 0.0, 1.0)
    """Surfels gather where most points of a wall lie that are spread by so much [m]."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.cell > self.coarse_cell:
            raise IceConfigError(f"found cell {self.cell} m, expected at most coarse_cell, {self.coarse_cell} m")


@dataclass(frozen=True, kw_only=True)
class CovarianceConfig(_IceSettings):
    """Covariance from the correlation scores around the optimum."""

    min_sigma: float = positive(0.004)
    """The residuals of a match are never taken to be smaller than this [m]."""
    independence: float = positive(0.8)
    """Share of the points that count as independent where neighbouring residuals are uncorrelated (correlation
    lessens it further); calibrated against simulated truth."""
    points: int = positive(60, *_COUNTS)
    """Points of the scan used for the scores."""
    max_step: float = positive(0.15, 1e-4, 10.0)
    """Largest spacing of the score grid; two of them on each side bound the window [m, rad]."""
    weak_sigma: float = positive(1.0, most=100.0)
    """Standard deviation given to a direction the match cannot observe [m, rad]: gates and closures compute with it,
    the path takes nothing from there."""


@dataclass(frozen=True, kw_only=True)
class FalseMatchConfig(_IceSettings):
    """How probably something else holds a match than what holds the map there, see `iceg.ice.false_matches`."""

    probability: float = between(0.03, *RATES)
    """A match that next to no wall holds is false with this probability, before it is asked where it was expected."""
    length: float = positive(0.2)
    """What so much wall holds is half as probably false [m]; a door's edge, a chair or a person is less. Of twice as
    much that is one in seventeen, and so on with the fourth power."""
    distance: float = positive(0.15)
    """How far off a false match is [m], one standard deviation: what is similar, within reach of the guess."""
    slip: float = between(0.01, *RATES)
    """Wheels slip between two key scans with this probability, by as much as a false match is off or by far more
    (Cauchy): a match that odometry contradicts need not be false."""
    similar_per_metre: float = 20.0
    """Where nothing has measured the guess, so many similar things lie within reach for each metre of its standard
    deviation [1/m]: the squared error of a match that something else holds is so many times the cube of that."""
    unobserved: float = positive(0.3)
    """A direction that something else may hold so far off, by standard deviation, is not observed [m]."""


@dataclass(frozen=True, kw_only=True)
class IceConfig:
    """All settings of the ICE matcher."""

    segments: SegmentConfig = field(default_factory=SegmentConfig)
    features: FeatureConfig = field(default_factory=FeatureConfig)
    hypotheses: HypothesisConfig = field(default_factory=HypothesisConfig)
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    local_map: LocalMapConfig = field(default_factory=LocalMapConfig)
    covariance: CovarianceConfig = field(default_factory=CovarianceConfig)
    false_match: FalseMatchConfig = field(default_factory=FalseMatchConfig)
    use_features: bool = True
    """Off leaves only the guess as hypothesis (the ablation of ICE)."""

    __repr__ = changed_repr
