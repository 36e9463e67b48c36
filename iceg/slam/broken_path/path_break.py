"""Where the path from scan to scan may be broken, and what became of the failure there."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import IntEnum, StrEnum

from graph.factors import Factor
from graph.measurement import NoMatch
from iceg.slam.closure_config import TrackingFailureConfig
from iceg.slam.run_warning import Kind, RunWarning
from iceg.slam.track import UNKNOWN_STEP, Track


class Outcome(StrEnum):
    """What became of a break of the path."""

    JOINED = "joined"
    """Loop closures join both sides."""
    APART = "apart"
    """Nothing joins what follows to what was before, and odometry alone says where it is."""
    CONTRADICTED = "contradicted"
    """Closures disagree with the path, but nothing else speaks against it or they are few; the map follows the path."""
    CREDIBLE = "credible"
    """Closures agree with dead reckoning, though not so many that chance is out of the question."""
    DRIFTED = "drifted"
    """Closures put it where only a systematic error of every step would explain, and the map follows them."""


class FailureKind(IntEnum):
    """What speaks against a step of the path, the worst last."""

    LOW_INLIER_RATIO = 0
    """The match explains little of its scan."""
    INCONSISTENT = 1
    """Match and odometry contradict each other."""
    NO_MATCH = 2
    """The scan matched nothing, or odometry made a step that no robot can make."""
    TRACKING_LOSS = 3
    """Nothing that was known matched any more, and the robot went on by dead reckoning."""
    UNKNOWN_MOTION = 4
    """The same, and not even odometry told the way."""


@dataclass(frozen=True, slots=True, kw_only=True)
class TrackingFailure:
    """Why the path may be broken just before a key pose.

    Attributes:
        kind: what speaks against it.
        reason: what was noticed there, for a person.
        unexplained: share of the scan that the match does not explain.
        distance2: squared Mahalanobis distance of an inconsistent match from odometry.
        is_dead_reckoned: whether the laser saw nothing it knew at the key pose before either, and odometry told the
            way: on ground where little is in reach that is what losing it looks like. Who is carried is lost at once,
            for odometry does not drive on meanwhile.
    """

    kind: FailureKind
    reason: str
    unexplained: float = 0.0
    distance2: float = 0.0
    is_dead_reckoned: bool = False

    @property
    def is_lost(self) -> bool:
        """Whether nothing was known when the robot went on."""
        return self.kind >= FailureKind.TRACKING_LOSS

    def is_beyond_chance(self, config: TrackingFailureConfig) -> bool:
        """Whether nothing matched, or match and odometry contradict each other by more than chance explains."""
        if self.kind is FailureKind.INCONSISTENT:
            return self.distance2 >= config.beyond_chance_distance2
        return self.kind > FailureKind.INCONSISTENT

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
        closures: how many agree about it; of one that is apart, how many agree with dead reckoning.
        moved: how far they say that the robot is from where the path puts it [m].
        across: how many closures span one that is apart, too few or too uncertain to join it.
    """

    key: int
    outcome: Outcome
    reason: str
    closures: int = 0
    moved: float = 0.0
    across: int = 0


def without_lost_odometry(
    factors: Sequence[Factor], breaks: Sequence[Break], track: Track, min_credible: int
) -> list[Factor]:
    """The factors of a graph, odometry telling nothing where it alone holds what a sudden loss has torn apart.

    Where the laser knew its way until the key scan before, and nothing fits the next one, the robot may have been
    carried anywhere. Where it saw little before, too, the robot went by dead reckoning: on logs made worse on purpose
    odometry told the truth in each of thirty such places, but not in four of fifteen sudden losses. It did, too, where
    the loss came before there was anything but the first scan to know, and where scans agreed with what odometry says,
    if not enough of them to hold the path together.

    Args:
        factors: of the graph.
        breaks: of the path; those that are apart matter.
        track: key scans and their matches.
        min_credible: so many scans that agree with odometry make it credible that the robot was not carried, even where
            as many do not.
    """
    torn = {
        found.key
        for found in breaks
        if found.outcome is Outcome.APART and found.closures < min_credible and _is_sudden(track, found.key)
    }
    return [
        replace(factor, covariance=UNKNOWN_STEP)
        if factor.kind == "odometry" and factor.j in torn and factor.i == factor.j - 1
        else factor
        for factor in factors
    ]


def _is_sudden(track: Track, key: int) -> bool:
    """Whether the scan of a key pose matches nothing, and that before it was well matched."""
    before, here = track.keys[key - 1].match, track.keys[key].match
    return isinstance(here, NoMatch) and not isinstance(before, NoMatch) and before.is_fully_observed


def describe_break(found: Break, track: Track) -> RunWarning:
    """A break in a sentence for a person."""
    scan = track.keys[found.key].index
    kind, sentence = _told(found, f"before scan {scan} ({found.reason})")
    return RunWarning(kind=kind, sentence=sentence, scan=scan)


def _told(found: Break, where: str) -> tuple[Kind, str]:
    elsewhere = f"{found.closures} scans that agree put the robot {found.moved:.1f} m from where the path does"
    if found.outcome is Outcome.JOINED:
        return "found again", f"tracking was lost {where}, and the robot found again: {elsewhere}; the map follows them"
    if found.outcome is Outcome.APART:
        ties = (
            f"the loop closures across ({found.across}) do not agree well enough to tie"
            if found.across
            else ("no loop closure ties")
        )
        return "cut off", f"tracking was lost {where}: {ties} the rest to what was before, it may be displaced"
    if found.outcome is Outcome.CREDIBLE:
        return "dead reckoning", (
            f"tracking may have been lost {where}: {found.closures} scans agree with dead reckoning by odometry there, "
            "but not all; the map follows it"
        )
    if found.outcome is Outcome.DRIFTED:
        return "drifted", (
            f"the path may have drifted {where}: {elsewhere}, more than chance explains; the map follows them"
        )
    return "contradicted", (
        f"the path may be wrong {where}: {elsewhere}; the robot was carried (kidnapped), or two places are "
        "ambiguous (perceptual aliasing); the map follows the path"
    )
