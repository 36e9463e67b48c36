"""Where the path from scan to scan may be broken, and what became of the failure there."""

from dataclasses import dataclass, replace
from enum import IntEnum, StrEnum
from math import exp, log

from iceg.slam.closure_config import ViewChangeConfig
from iceg.slam.run_warning import Kind, RunWarning
from iceg.slam.track import Track


class Outcome(StrEnum):
    """What became of a break of the path."""

    JOINED = "joined"
    """Loop closures join both sides."""
    APART = "apart"
    """Nothing joins what follows to what was before, and odometry alone says where it is."""
    DRIFTED = "drifted"
    """Maps contradict each other as the path has them, its errors explain that, and the map follows closures."""
    CONFLICT = "conflict"
    """Match and odometry contradict each other, closures do not settle it, and the map follows the match."""
    DOUBTFUL = "doubtful"
    """The robot may have been carried, or the path be wrong, nothing settles it, and the map follows the path."""


class FailureKind(IntEnum):
    """What speaks against a step of the path, the worst last."""

    LOW_INLIER_RATIO = 0
    """The match explains little of its scan."""
    INCONSISTENT = 1
    """Match and odometry contradict each other."""
    NO_MATCH = 2
    """The scan matched nothing, or odometry made a step that no robot can make."""
    TRACKING_LOSS = 3
    """Nothing that was known matched any more, and what the robot went on by may be wrong, too."""
    UNKNOWN_MOTION = 4
    """The same, and not even odometry told the way."""


def probability(log_odds: float) -> float:
    """Of what is so many times as probable as that it is not, the logarithm."""
    return 1.0 / (1.0 + exp(min(-log_odds, 700.0)))


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingFailure:
    """Why the path may be broken just before a key pose.

    Attributes:
        kind: what speaks against it.
        reason: what was noticed there, for a person.
        unexplained: share of the scan that the match does not explain.
        distance2: squared Mahalanobis distance of an inconsistent match from odometry.
        log_odds_carried: how many times as probable it is that the robot was carried there as that it was not, the
            logarithm; None where what the laser sees does not tell.
        scan: of the log, the first that sees something else; None where the view goes on.
    """

    kind: FailureKind
    reason: str
    unexplained: float = 0.0
    distance2: float = 0.0
    log_odds_carried: float | None = None
    scan: int | None = None

    @property
    def is_carried(self) -> bool:
        """Whether it is more probable than not that the robot was carried: what the laser sees changed at once."""
        return self.log_odds_carried is not None and self.log_odds_carried > 0.0

    @property
    def probability_carried(self) -> float:
        """That the robot was carried there; 0 where what the laser sees does not tell."""
        return 0.0 if self.log_odds_carried is None else probability(self.log_odds_carried)

    def log_odds(self, config: ViewChangeConfig) -> float:
        """How many times as probable it is that the robot was carried there as that it was not, the logarithm.

        Where nothing is known of the view, robots are seldom carried.
        """
        return log(config.carried_prior) if self.log_odds_carried is None else self.log_odds_carried

    def by_odometry(self) -> "TrackingFailure":
        """The same where odometry told the way: who was not carried knows where he is, whatever matches."""
        if self.kind is not FailureKind.TRACKING_LOSS or self.is_carried:
            return self
        return replace(self, kind=FailureKind.NO_MATCH)

    def log_prior_of_path(self, config: ViewChangeConfig) -> float:
        """How many times as probable the path is as a robot that was carried, the logarithm.

        Nothing is said where nothing told the way.
        """
        return 0.0 if self.kind is FailureKind.UNKNOWN_MOTION else -self.log_odds(config)

    def contradiction(self, gate: float, config: ViewChangeConfig) -> float:
        """How many times as probable it is that match and odometry differ so much if the robot was carried.

        Whoever is carried to a place like the one he left matches anywhere in it: the squared distance may have any
        order of magnitude. By chance one beyond the gate gets rarer as it grows; wheels that slip may put it anywhere,
        too.

        Args:
            gate: squared distance from which on they contradict each other.
            config: how often it is a slip, and how far contradictions go.
        """
        if self.kind is not FailureKind.INCONSISTENT:
            return 1.0
        by_chance = config.magnitudes * gate / max(self.distance2, gate)
        return 1.0 / ((1.0 - config.slip) * by_chance + config.slip)

    @property
    def is_lost(self) -> bool:
        """Whether nothing was known when the robot went on."""
        return self.kind >= FailureKind.TRACKING_LOSS

    @property
    def rank(self) -> float:
        """Orders failures: the highest is where a break is put."""
        if self.kind is FailureKind.LOW_INLIER_RATIO:
            return self.unexplained
        if self.kind is FailureKind.INCONSISTENT:
            return FailureKind.NO_MATCH - 1.0 / (1.0 + self.distance2)
        return float(self.kind)


@dataclass(frozen=True, slots=True, kw_only=True)
class Break:
    """Where the path from scan to scan does not hold.

    Attributes:
        key: the first key pose after it.
        outcome: what became of it.
        reason: what was noticed there.
        closures: how many agree about it.
        moved: how far they say that the robot is from where the path puts it [m].
        across: how many closures span one that is apart, too few or too uncertain to join it.
        scan: of the log, the first that sees something else; None where the view goes on.
        probability: that what follows is displaced: the robot was carried there though the map goes on as if it was
            not, or found again at a place that only looks alike; 0 where that is an idle doubt, or settled.
    """

    key: int
    outcome: Outcome
    reason: str
    closures: int = 0
    moved: float = 0.0
    across: int = 0
    scan: int | None = None
    probability: float = 0.0

    @property
    def is_sudden(self) -> bool:
        """Whether what the laser sees changed at once there."""
        return self.scan is not None


def describe_break(found: Break, track: Track) -> RunWarning:
    """A break in a sentence for a person."""
    scan = track.keys[found.key].index
    kind, sentence = _told(found, f"before scan {scan} ({found.reason})")
    return RunWarning(kind=kind, sentence=sentence, scan=scan)


def _told(found: Break, where: str) -> tuple[Kind, str]:
    elsewhere = f"{found.closures} scans that agree put the robot {found.moved:.1f} m from where the path does"
    sure = f" (right with a probability of {1.0 - found.probability:.0%})" if found.probability > 0.0 else ""
    if found.outcome is Outcome.JOINED:
        return "found again", (
            f"tracking was lost {where}, and the robot found again: {elsewhere}; the map follows them{sure}"
        )
    if found.outcome is Outcome.APART:
        ties = (
            f"the loop closures across ({found.across}) do not agree well enough to tie"
            if found.across
            else ("no loop closure ties")
        )
        return "cut off", f"tracking was lost {where}: {ties} the rest to what was before, it may be displaced"
    if found.outcome is Outcome.DRIFTED:
        return "drifted", (
            f"the path drifted {where}, so that maps of it contradict each other: {elsewhere}; the map follows "
            f"them{sure}"
        )
    if found.outcome is Outcome.CONFLICT:
        carried = f", which is {found.probability:.0%} probable" if found.probability > 0.0 else ""
        return "conflict", (
            f"match and odometry contradict each other {where}, and loop closures do not settle it: the map follows "
            f"the match; if the odometry is right, or the robot was carried (kidnapped{carried}), what follows is "
            "displaced"
        )
    return "doubtful", (
        f"the robot may have been carried {where}, or the path be wrong: by what the laser sees this is "
        f"{found.probability:.0%} probable, and loop closures do not settle it; the map goes on as if nothing was, and "
        "what follows may be displaced"
    )
