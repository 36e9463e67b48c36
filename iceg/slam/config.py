"""Settings of the SLAM system around the matcher."""

from dataclasses import dataclass, field

from graph.ranges import RATES, between, positive
from graph.units import Radians
from iceg.slam.agreement import Tolerance
from iceg.slam.calibration_config import CalibrationConfig
from iceg.slam.checked_settings import SlamSettings
from iceg.slam.closure_config import (
    ConfirmedAreaConfig,
    PlaceVotesConfig,
    RelocalisationConfig,
    TrackingFailureConfig,
    VerificationConfig,
    ViewChangeConfig,
)
from iceg.slam.companion_config import CompanionConfig
from iceg.slam.joint_config import JointRefinementConfig
from iceg.slam.own_body_config import OwnBodyConfig
from iceg.slam.sweep_config import SweepConfig
from iceg.slam.tracking_config import (
    MountConfig,
    OdometryCheckConfig,
    SightConfig,
    SmoothingConfig,
    SplitHalfConfig,
    StandstillConfig,
    TrackingConfig,
)


@dataclass(frozen=True, kw_only=True)
class KeyScanConfig(SlamSettings, prefix="key_scans: "):
    """When a scan becomes a key scan, and which of them make up the local reference."""

    distance: float = between(0.35, 1e-3, 1000.0)
    """A new key scan after driving this far [m]."""
    angle: Radians = between(0.4, 1e-3, 1000.0)
    """A new key scan after turning this far [rad]."""
    blind_spacing: float = between(3.0, 1.0, 1e6)
    """A scan that sees nothing becomes a key scan after so many times the way, if odometry tells of it: one that sees
    may come before."""
    window: int = between(25, 1, 1000)
    """Key scans in the local reference."""
    rebuild: int = positive(8)
    """The reference is built anew after this many key scans; in between it is only extended."""


@dataclass(frozen=True, kw_only=True)
class FrontEndConfig(SlamSettings):
    """Matching scan after scan against the local reference."""

    key_scans: KeyScanConfig = field(default_factory=KeyScanConfig)
    own_body: OwnBodyConfig = field(default_factory=OwnBodyConfig)
    """Which returns come from the robot itself."""
    companions: CompanionConfig = field(default_factory=CompanionConfig)
    """Who goes along with the robot."""
    sight: SightConfig = field(default_factory=SightConfig)
    """What a scan must see."""
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
    smoothing: SmoothingConfig = field(default_factory=SmoothingConfig)
    """How scans between key scans are smoothed."""
    sweep: SweepConfig = field(default_factory=SweepConfig)
    """What scans tell of the sweep of the laser."""
    split_half: SplitHalfConfig = field(default_factory=SplitHalfConfig)
    """Whether matches are as sure as they say."""
    calibrate_odometry: bool = True
    """Learn bias, time shift and noise of the odometry from the log's own matches."""
    calibration_path: float = 40.0
    """Path by odometry that the first pass takes, which calibrates [m]; it ends once path and turning are enough."""
    calibration_turn: Radians = 25.0
    """Turning by odometry that the first pass takes [rad]."""
    calibration_scans: int = positive(2500)
    """Scans after which the first pass ends in any case."""
    tracking_distance: float = positive(0.02)
    """Standard deviation of the position between two key scans [m]."""
    tracking_angle: Radians = positive(0.01)
    """Standard deviation of the heading between two key scans [rad]."""
    deskew: bool = True
    """Move every beam by the motion within the sweep of the laser: as long as the log says it takes, else as long as
    its scans tell. Off takes all beams of a scan as measured at once."""
    gyro: bool = True
    """In a log without odometry, take the turn rate of a gyro for odometry of the heading if the matches confirm it."""

    @property
    def tracked(self) -> Tolerance:
        """Standard deviations of a pose between two key scans."""
        return Tolerance(self.tracking_distance, self.tracking_angle)

    @property
    def one_optimum(self) -> Tolerance:
        """How far apart two tracked poses of one scan may be that do not contradict each other."""
        return Tolerance(
            self.tracking.same_optimum_distance * self.tracking_distance,
            self.tracking.same_optimum_turn * self.tracking_angle,
        )


@dataclass(frozen=True, kw_only=True)
class LoopClosureConfig(SlamSettings):
    """Finding places again."""

    enabled: bool = True
    """Off leaves odometry and matches to recent key scans only."""
    spacing: float = 1.5
    """Look for earlier passes again after driving this far [m]."""
    spacing_angle: Radians = 2.0
    """Look for earlier passes again after turning this far [rad]."""
    min_path: float = 8.0
    """A pass counts as earlier when the path since is longer than this [m]."""
    radius: float = between(3.0, 0.0, 1000.0)
    """Views of the two key scans may lie this far apart, plus twice the drift [m]."""
    view_distance: float = between(2.0, 0.0, 1000.0)
    """A view is the point this far ahead of the robot [m]."""
    pass_gap: int = 12
    """Key scans between two passes."""
    max_passes: int = between(3, 0, 1000)
    """Most earlier passes tried for one key scan."""
    max_pieces: int = between(8, 0, 1000)
    """Most pieces of passes tried for one key scan after much drift."""
    reference_half: int = between(7, 0, 1000)
    """Key scans of the earlier pass on either side that make up the reference."""
    min_overlap: float = between(0.4, 0.0, 1.0)
    """Least share of the beams of a key scan and its neighbours that fall on the earlier pass."""
    min_fit: float = between(0.8, 0.0, 1.0)
    """Least share of the beams on the earlier pass that agree with it."""
    min_view: float = between(0.8, 0.0, 1.0)
    """Least share of the earlier pass in view that the beams see, instead of looking through it."""
    drift_factor: float = 1.5
    """The path's covariance since the last closure is trusted only after this factor on its standard deviations."""
    odometry_inflation: float = between(2.0, 0.01, 1000.0)
    """Factor on the odometry's standard deviations in a search: a chain of them may do worse than usual."""
    drift_floor: float = 0.1
    """Smallest standard deviation of a search [m]."""
    max_drift: float = between(8.0, 0.0, 200.0)
    """Largest standard deviation of a search [m]."""
    turn_floor: Radians = 0.03
    """Smallest standard deviation of a search in heading [rad]."""
    max_turn: Radians = 0.8
    """Largest standard deviation of a search in heading [rad]."""
    confirmations: int = positive(3)
    """A closure far from the estimate waits until so many say the same."""
    path_probability: float = between(0.999, 0.5, 1.0 - 1e-12)
    """A true closure lies no farther from the path than its covariance explains with this probability; one that does is
    refused, for most likely it is a similar place (perceptual aliasing)."""
    relocalise: bool = True
    """Where no closure joins what follows to what was before, see where its map fits what was before (map merging)."""
    support_offsets: tuple[int, ...] = (-4, -2, 0, 2, 4)
    """Key scans asked to agree, relative to the one matched."""
    verification: VerificationConfig = field(default_factory=VerificationConfig)
    """Which closures agree."""
    votes: PlaceVotesConfig = field(default_factory=PlaceVotesConfig)
    """Whether another place fits as well."""
    failures: TrackingFailureConfig = field(default_factory=TrackingFailureConfig)
    """Where tracking may have failed."""
    relocalisation: RelocalisationConfig = field(default_factory=RelocalisationConfig)
    """What joins parts of a broken path."""
    view: ViewChangeConfig = field(default_factory=ViewChangeConfig)
    """Whether the robot may have been carried."""
    confirmed: ConfirmedAreaConfig = field(default_factory=ConfirmedAreaConfig)
    """Where passes show nothing new."""


@dataclass(frozen=True, kw_only=True)
class FinishConfig(SlamSettings):
    """The offline finish after the log has been read to its end."""

    enabled: bool = True
    """Off leaves the incremental solution."""
    rounds: int = between(1, 0, 1000)
    """Most rounds of matching again and optimising."""
    tolerance: float = 0.002
    """A round that moves no key pose farther than this is the last [m]."""
    spacing: float = 1.5
    """Where no closure ties two passes, match again after this much path [m]."""
    spacing_angle: Radians = 2.0
    """Where no closure ties two passes, match again after this much turning [rad]; in between, the joint refinement
    holds the passes together."""
    max_passes: int = between(4, 0, 1000)
    """Most earlier passes a key scan is matched against."""
    search_distance: float = between(0.08, 0.0, 100.0)
    """Standard deviation in position of the search around the optimum [m]."""
    search_angle: Radians = 0.03
    """Standard deviation in heading of the search around the optimum [rad]."""
    closure_false_alarm: float = between(0.001, *RATES)
    """Of true closures so many lie so far off that dynamic covariance scaling weakens them: its Φ is where χ² of three
    degrees of freedom exceeds that."""
    outlier_weight: float = between(0.1, 0.0, 1.0)
    """A closure whose robust kernel leaves it a smaller weight than this is an outlier, and is taken out."""
    by_hand_sigmas: float = 10.0
    """By so many of its standard deviations the path is bent for a closure by hand that costs no other one: successive
    matches and wheels have a bias, so that a long path is off by several times what it claims."""
    told_sigmas: float = 5.0
    """From so many standard deviations on it is told that the path is bent."""
    uncertain: float = 0.3
    """Where a key pose is known no better than to this standard deviation, the run says that the path is uncertain [m]:
    two passes may show one wall twice. Of 414 simulated runs 6 good ones are warned of by this alone, and no ruined one
    is silent; with half of it 20 and none, with twice 2 and 2."""
    joint: JointRefinementConfig = field(default_factory=JointRefinementConfig)
    """In the end, poses and map together."""
