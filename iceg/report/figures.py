"""The numbers of a run, each with what it means and whether it is good."""

import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from iceg.report.factors import HeldBy

if TYPE_CHECKING:
    from iceg.run_result.slam_result import SlamResult

Grade = Literal["good", "fair", "poor", "none"]

_KIND_NAMES = {"odometry": "Odometry", "ice": "Matches along the way", "closure": "Loop closures"}


@dataclass(frozen=True, slots=True, kw_only=True)
class Figure:
    """A number for a person.

    Attributes:
        name: what it is called.
        value: the number with its unit.
        meaning: what it says, in a sentence.
        grade: whether it is good; "none" where it is neither good nor bad.
    """

    name: str
    value: str
    meaning: str
    grade: Grade = "none"


def figures_payload(result: "SlamResult", held: HeldBy, shares: NDArray[np.float64]) -> list[dict[str, Any]]:
    """All figures of a run, those that are judged first.

    Args:
        result: of the run.
        held: its factors.
        shares: (k,) of each key scan that the map explains.
    """
    figures = [*_judged(result, held, shares), *_sizes(result)]
    return [asdict(figure) for figure in figures]


def _judged(result: "SlamResult", held: HeldBy, shares: NDArray[np.float64]) -> Iterator[Figure]:
    summary = result.summary
    worst = summary["least_known"]
    yield Figure(
        name="Least known position",
        value=_length(worst["position_std_m"]),
        meaning=f"One standard deviation at scan {worst['scan']}, relative to the first scan. "
        "From half a metre on, walls of two passes would lie apart.",
        grade=_grade(worst["position_std_m"], 0.1, 0.5),
    )
    lost = len(summary["lost_at_scans"])
    yield Figure(
        name="Tracking lost",
        value=f"{lost}×",
        meaning="Places where a scan matched nothing known, so that a new local map was begun."
        if lost
        else "Every part of the path hangs on the one before by a match.",
        grade="good" if lost == 0 else "fair",
    )
    carried = summary["scans_carried_by_odometry"] / len(result.log)
    yield Figure(
        name="Scans without a match",
        value=f"{100 * carried:.1f} %",
        meaning="Only odometry, or the velocity before, tells where these scans were taken.",
        grade=_grade(carried, 0.02, 0.1),
    )
    if np.isfinite(shares).any():
        median = float(np.nanmedian(shares))
        yield Figure(
            name="Scans explained by the map",
            value=f"{100 * median:.0f} %",
            meaning="Of a typical key scan, so many returns end at a wall of the map. People and glass lower it.",
            grade=_grade(1.0 - median, 0.2, 0.4),
        )
    yield from _finish(result)
    for kind, mean in held.mean_squares().items():
        yield Figure(
            name=f"{_KIND_NAMES[kind]}: squared residual",
            value=f"{mean:.2f} σ²",
            meaning="How far the path is from what was measured, in its own variances and by degree of freedom: about "
            "1 is right, more contradicts.",
            grade=_grade(mean, 2.0, 5.0),
        )


def _finish(result: "SlamResult") -> Iterator[Figure]:
    rounds = result.summary["finish"]
    last = rounds[-1] if rounds else None
    if last is None or (residual := last["residual"]) is None or (before := last["residual_before"]) is None:
        return
    yield Figure(
        name="Thickness of the walls",
        value=_length(residual),
        meaning="Root mean square distance of the returns from the walls they share with other scans, "
        f"{_length(before)} before poses and map were refined together.",
        grade=_grade(residual, 0.025, 0.05),
    )
    is_of_walls = last["covariances_from"] == "walls"
    yield Figure(
        name="Covariances rest on",
        value="shared walls" if is_of_walls else "matches alone",
        meaning="The walls that many scans share say how well the poses are known."
        if is_of_walls
        else "The walls do not confirm how well the poses are known: they may be farther off than the page says.",
        grade="good" if is_of_walls else "fair",
    )
    if (factor := last["variance_factor"]) is not None and is_of_walls:
        yield Figure(
            name="Walls against matches",
            value="agree" if factor == 1.0 else f"× {factor:.1f}",
            meaning="How far, squared, the walls moved the poses from where matches and odometry put them, against "
            "what both claim: all variances of the page are larger by it.",
            grade=_grade(factor, 2.0, 4.0),
        )


def _sizes(result: "SlamResult") -> Iterator[Figure]:
    closures = result.summary["closures"]
    steps = np.hypot(*np.diff(result.trajectory[:, :2], axis=0).T)
    yield Figure(
        name="Path", value=f"{float(steps.sum()):.0f} m", meaning=f"{len(result.log)} scans in {_duration(result)}."
    )
    yield Figure(
        name="Key poses",
        value=str(len(result.key_scans)),
        meaning="The unknowns of the graph.",
    )
    yield Figure(
        name="Loop closures",
        value=f"{closures['accepted']} of {closures['tried']}",
        meaning="Places seen again that are in the graph, of those that were tried.",
    )
    x_min, x_max, y_min, y_max = result.grid.extent
    yield Figure(
        name="Map",
        value=f"{x_max - x_min:.1f} × {y_max - y_min:.1f} m",
        meaning=f"Cells of {100 * result.grid.resolution:g} cm, {len(result.landmarks.settled())} landmarks "
        f"({len(result.landmarks)} with those seen rarely, and {int((result.landmarks.expired_at >= 0).sum())} "
        "that were no longer there at the end).",
    )


def _duration(result: "SlamResult") -> str:
    stamps = result.log.stamps
    seconds = float(stamps.max() - stamps.min()) if len(stamps) else 0.0
    if seconds <= 0.0:
        return "no time that the stamps tell"
    minutes, rest = divmod(round(seconds), 60)
    return f"{minutes} min {rest:02d} s" if minutes else f"{rest} s"


def _grade(value: float, fair: float, poor: float) -> Grade:
    """Good below one bound, poor above the other."""
    return "good" if value <= fair else "fair" if value <= poor else "poor"


def _length(metres: float) -> str:
    if not math.isfinite(metres):
        return "–"
    if metres < 0.1:
        return f"{1000 * metres:.1f} mm"
    return f"{100 * metres:.1f} cm" if metres < 1.0 else f"{metres:.2f} m"
