"""Settings of the joint refinement of poses and walls."""

from dataclasses import dataclass

from graph.ranges import RATES, check_between, check_numbers
from iceg.slam.config_error import SlamConfigError


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
    """Least likeness in facing of points grouped together (cosine), and of a wall and its points."""
    cell_facing: float = 0.8
    """Least likeness in facing of points of one cell that are taken together (cosine)."""
    elongation: float = 4.0
    """A piece of wall so many times as long as thick has a direction of its own; that of another its normals give."""
    scale: float = 0.03
    """Width of the Cauchy weight of a point [m]."""
    independence: float = 0.165
    """Share of the points that count as independent: errors of neighbouring ones are correlated. By simulated truth."""
    correlated_points: float = 4.0
    """Points that stand for more others than this count for more, by the power 2/3 of the excess: the fewer are taken,
    the less alike they err. So the NEES of long runs, whose points are thinned, falls no further."""
    min_residual: float = 0.004
    """The residuals of points are never taken to be smaller than this [m]."""
    over_relaxation: float = 1.3
    """Steps are taken so many times longer: a full one brings little more than half of what is left, because weights
    and lines follow the points. Longer ones overshoot where it brings more."""
    regroup_cells: float = 0.5
    """After steps longer than so many cells the points are grouped into pieces of wall anew."""
    contradiction_prior: float = 0.1
    """Weight of the assumption that walls and factors do not contradict each other, as a share of the way that a
    perfect estimate would leave the graph: it decides where both know about as much. Of 192 random scenes 12 are above
    a NEES of 12, with half of it 12, with twice 13."""
    contradiction_false_alarm: float = 0.01
    """Walls and matches contradict each other, and the run says so, where chance makes the way between them so long
    with this probability only (χ², 3 degrees of freedom)."""
    on_wall_weight: float = 0.5
    """Points of at least this Cauchy weight, nearer to the line than its width, tell how far a piece of wall goes."""
    reach: float = 25.0
    """Points farther than this from the robot are left out [m]."""
    telling_reach: float = 15.0
    """Points farther than this from the robot tell nothing of how well the poses are known [m]: near the end of a
    laser's range, noise decides which points return at all."""
    scans_per_key: int = 4
    """Scans of each key pose that take part: the key scan and some of those on the way to the next."""
    max_points: int = 500_000
    """Only every so many beams are used, so that there are no more points than this."""
    max_thinning: int = 4
    """Rather than keep less than one in so many beams, fewer scans take part."""

    def __post_init__(self) -> None:
        check_numbers(self, SlamConfigError, positive=("over_relaxation", "contradiction_prior"))
        check_between(
            self,
            SlamConfigError,
            "joint refinement: ",
            cell=(0.01, 100.0),
            half_length=(0.01, 100.0),
            half_width=(1e-3, 100.0),
            scale=(1e-4, 100.0),
            independence=(1e-3, 1000.0),
            steps=(0, 1000),
            min_residual=(1e-6, 100.0),
            correlated_points=(1.0, 1e6),
            contradiction_false_alarm=RATES,
            max_points=(1, 5_000_000),
            max_thinning=(1, 1000),
            scans_per_key=(1, 1_000_000),
        )
