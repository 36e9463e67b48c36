"""Settings of the joint refinement of poses and walls."""

from dataclasses import dataclass

from graph.ranges import RATES, between, positive
from iceg.slam.checked_settings import SlamSettings


@dataclass(frozen=True, kw_only=True)
class JointRefinementConfig(SlamSettings, prefix="joint refinement: "):
    """Poses and map refined together: the points of all key scans on the pieces of wall they share."""

    enabled: bool = True
    """Off leaves the poses where matches and odometry put them."""
    steps: int = between(3, 0, 1000)
    """Most Gauss-Newton steps."""
    tolerance: float = 0.002
    """A step that moves the key poses by less than this on average is the last [m]."""
    cell: float = between(0.1, 0.01, 100.0)
    """Side of a cell whose points are grouped together if they face the same way [m]."""
    half_length: float = between(0.25, 0.01, 100.0)
    """Farthest along the wall that a point is grouped [m]."""
    half_width: float = between(0.15, 1e-3, 100.0)
    """Farthest across the wall that a point is grouped [m]: so far may two passes lie apart."""
    facing: float = 0.9
    """Least likeness in facing of points grouped together (cosine), and of a wall and its points."""
    cell_facing: float = 0.8
    """Least likeness in facing of points of one cell that are taken together (cosine)."""
    elongation: float = 4.0
    """A piece of wall so many times as long as thick has a direction of its own; that of another its normals give."""
    scale: float = between(0.03, 1e-4, 100.0)
    """Width of the Cauchy weight of a point [m]."""
    roughness: float = between(0.005, 1e-6, 100.0)
    """Standard deviation of a surface about its line: what else has a point off it is the error along its beam [m]."""
    evenness: float = between(2.5, 1.0, 1e6)
    """Neighbours of a point are one surface where they scatter about their line by at most so many times the variance
    that noise and roughness explain. Across a step or corner the normal would be that of neither wall: there the widest
    part of the neighbours that is one surface gives it."""
    wall_reach: float = between(1.5, 0.0, 100.0)
    """Pieces of wall no farther apart than this that lie on one curve tell together how it runs [m]: each alone errs
    and would hold the poses along the wall. Only covariances ask."""
    independence: float = between(0.165, 1e-3, 1000.0)
    """Share of the points that count as independent: errors of neighbouring ones are correlated. By simulated truth."""
    correlated_points: float = between(4.0, 1.0, 1e6)
    """Points that stand for more others than this count for more, by the power 2/3 of the excess: the fewer are taken,
    the less alike they err. So the NEES of long runs, whose points are thinned, falls no further."""
    min_residual: float = between(0.004, 1e-6, 100.0)
    """The residuals of points are never taken to be smaller than this [m]."""
    over_relaxation: float = positive(1.3)
    """Steps are taken so many times longer: a full one brings little more than half of what is left, because weights
    and lines follow the points. Longer ones overshoot where it brings more."""
    regroup_cells: float = 0.5
    """After steps longer than so many cells the points are grouped into pieces of wall anew."""
    contradiction_prior: float = positive(0.1)
    """Weight of the assumption that walls and factors do not contradict each other, as a share of the way that a
    perfect estimate would leave the graph: it decides where both know about as much. Of 192 random scenes 12 are above
    a NEES of 12, with half of it 12, with twice 13."""
    contradiction_false_alarm: float = between(0.01, *RATES)
    """Walls and matches contradict each other, and the run says so, where chance makes the way between them so long
    with this probability only (χ², 3 degrees of freedom)."""
    on_wall_weight: float = 0.5
    """Points of at least this Cauchy weight, nearer to the line than its width, tell how far a piece of wall goes."""
    reach: float = 25.0
    """Points farther than this from the robot are left out [m]."""
    telling_reach: float = 15.0
    """Points farther than this from the robot tell nothing of how well the poses are known [m]: near the end of a
    laser's range, noise decides which points return at all."""
    scans_per_key: int = between(4, 1, 1_000_000)
    """Scans of each key pose that take part: the key scan and some of those on the way to the next."""
    max_points: int = between(500_000, 1, 5_000_000)
    """Only every so many beams are used, so that there are no more points than this."""
    max_thinning: int = between(4, 1, 1000)
    """Rather than keep less than one in so many beams, fewer scans take part."""
