"""Where the beams of a laser point, and bringing sweeps of different settings together."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graph.limits import LIMITS

_KNOWN_SCANNERS = {  # number of beams: (first bearing, step) [degrees]
    180: (-90.0, 1.0),  # SICK LMS, the beam at +90° left out
    181: (-90.0, 1.0),
    360: (-90.0, 0.5),
    361: (-90.0, 0.5),
    400: (-50.0, 0.25),  # SICK LMS in its narrow mode
    401: (-50.0, 0.25),
    541: (-135.0, 0.5),  # Hokuyo UTM-30LX, every second beam
    1081: (-135.0, 0.25),
}
_PRINTED_PRECISION = 2e-4  # rad: six decimals of a step, summed over the beams
_MOST_START = 4.0 * math.pi  # rad: a first beam farther round is a number gone wrong
_LEAST_STEP = 1e-6  # rad: beams nearer to each other are one
_WHOLE_TURN = 2.0 * math.pi + 1e-3  # rad: and what printing adds to it


class BeamDescription(NamedTuple):
    """What a message says of its laser's beams [rad, m]."""

    start_angle: float
    field_of_view: float
    resolution: float
    range_max: float


class Setup(NamedTuple):
    """One setting of a laser."""

    n_beams: int
    description: BeamDescription | None

    @property
    def stated_max(self) -> float:
        """The maximum range the messages state [m], infinite where they state none that a laser has."""
        stated = self.description.range_max if self.description else 0.0
        return stated if 0 < stated <= LIMITS.range else math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class Beams:
    """The bearings of one setting.

    Attributes:
        bearings: (n_beams,) increasing [rad].
        reversed_order: whether the readings run from left to right, against the bearings.
        warnings: what a person should know about how they were found.
    """

    bearings: NDArray[np.float64]
    reversed_order: bool = False
    warnings: tuple[str, ...] = ()

    def in_order(self, ranges: NDArray[np.float32]) -> NDArray[np.float32]:
        """The (n_beams,) readings [m] in the order of the bearings."""
        return ranges[::-1] if self.reversed_order else ranges


def usual_setup(setups: Sequence[Setup]) -> Setup | None:
    """The most frequent setting that makes a scan (two beams or more), the first of equals; None without any."""
    counted = Counter(setup for setup in setups if setup.n_beams > 1)
    return counted.most_common(1)[0][0] if counted else None


def find_beams(setup: Setup, parameters: Mapping[str, float]) -> Beams:
    """Find the bearings of a setting.

    In this order: first bearing and step of the message; its first bearing and field of view, where the step
    contradicts them; the scanner known for this number of beams, unless `resolution` and `fov` of the log's
    parameters say another; these; an even spread over 180°. Numbers that no laser can have (a first bearing beyond two
    turns, beams less than 10⁻⁶ rad apart or over more than a whole turn) are passed over with a warning.

    Args:
        setup: number of beams and, where the message has one, the description.
        parameters: `resolution` and `fov` [degrees], where the log states them.
    """
    n_beams, description = setup
    warnings: tuple[str, ...] = ()
    if description is not None:
        start, view, step, _ = description
        sound = abs(start) <= _MOST_START
        if sound and _spans(step, n_beams, view):
            bearings = _evenly(start, step, n_beams)
            return Beams(bearings=bearings[::-1] if step < 0 else bearings, reversed_order=step < 0)
        if sound and n_beams > 1 and _LEAST_STEP * (n_beams - 1) <= view <= _WHOLE_TURN:
            warning = (
                f"the laser's step {step:g} rad does not spread {n_beams} beams over {view:g} rad: the latter is taken"
            )
            return Beams(bearings=start + np.linspace(0.0, view, n_beams), warnings=(warning,))
        if any((start, view, step)):
            said = f"{n_beams} beams {step:g} rad apart over {view:g} rad from {start:g} rad on"
            warnings = (f"the log says {said}, which is no laser's: it is left out",)
    step, view = (math.radians(parameters.get(name, 0.0)) for name in ("resolution", "fov"))
    is_said = step > 0 and _spans(step, n_beams, view)
    known = _known(n_beams)
    if known is not None and not (is_said and _is_of_another(known, view, step)):
        return Beams(bearings=known, warnings=warnings)
    if is_said:
        return Beams(bearings=_evenly(-0.5 * view, step, n_beams), warnings=warnings)
    warning = f"no scanner with {n_beams} beams is known: they are spread evenly from -90° to +90°"
    return Beams(bearings=np.linspace(-0.5 * np.pi, 0.5 * np.pi, n_beams), warnings=(*warnings, warning))


def _is_of_another(known: NDArray[np.float64], view: float, step: float) -> bool:
    """Whether a scanner of a field of view and step is not the one known for its number of beams."""
    return abs(float(known[-1] - known[0]) - view) > 2.0 * step


def place_on_bearings(
    ranges: NDArray[np.float32], bearings: NDArray[np.float64], target: NDArray[np.float64]
) -> NDArray[np.float32]:
    """Put a sweep of another setting on the bearings of the rest.

    Args:
        ranges: (n,) [m].
        bearings: (n,) of these ranges [rad], increasing.
        target: (m,) wanted [rad], increasing.

    Returns:
        (m,) [m]: of each wanted bearing the nearest beam, NaN where none lies within half a step of `target`.
    """
    placed = np.full(len(target), np.nan, dtype=np.float32)
    if len(ranges) == 0:
        return placed
    after = np.minimum(np.searchsorted(bearings, target), len(bearings) - 1)
    before = np.maximum(after - 1, 0)
    nearest = np.where(np.abs(bearings[before] - target) <= np.abs(bearings[after] - target), before, after)
    half_step = 0.5 * float(np.diff(target).min())
    near = np.abs(bearings[nearest] - target) < half_step * (1.0 - 1e-6)
    placed[near] = ranges[nearest[near]]
    return placed


def stack_sweeps(
    sweeps: Sequence[NDArray[np.float32]], setups: Sequence[Setup], usual: Setup, parameters: Mapping[str, float]
) -> tuple[NDArray[np.float32], NDArray[np.float64], list[str]]:
    """Put sweeps of all settings on the bearings of the usual one.

    Args:
        sweeps: readings of each [m], as recorded.
        setups: their settings.
        usual: the one whose bearings all get.
        parameters: as for `find_beams`.

    Returns:
        (n_sweeps, n_beams) readings, (n_beams,) bearings [rad], and warnings.
    """
    found = {setup: find_beams(setup, parameters) for setup in dict.fromkeys(setups)}
    bearings = found[usual].bearings
    rows = [
        found[setup].in_order(ranges)
        if setup is usual or setup == usual
        else place_on_bearings(found[setup].in_order(ranges), found[setup].bearings, bearings)
        for ranges, setup in zip(sweeps, setups, strict=True)
    ]
    stacked = np.concatenate(rows, dtype=np.float32).reshape(len(rows), len(bearings))
    warnings = list(found[usual].warnings)
    others = Counter(setup.n_beams for setup in setups if setup != usual)
    if others:
        listed = ", ".join(f"{count} scans with {n_beams}" for n_beams, count in sorted(others.items()))
        warnings.append(f"the beams change: {listed} are placed on the bearings of the usual {len(bearings)}")
    return stacked, bearings, warnings


def _spans(step: float, n_beams: int, view: float) -> bool:
    """Whether the step fits the field of view, give or take a beam left out at its end, and a laser can have both."""
    spanned = abs(step) * (n_beams - 1)
    possible = abs(step) >= _LEAST_STEP and spanned <= _WHOLE_TURN
    return possible and abs(spanned - abs(view)) <= 1.5 * abs(step)


def _known(n_beams: int) -> NDArray[np.float64] | None:
    if n_beams not in _KNOWN_SCANNERS:
        return None
    first, step = _KNOWN_SCANNERS[n_beams]
    return np.asarray(np.radians(first + step * np.arange(n_beams)), dtype=np.float64)


def _evenly(start: float, step: float, n_beams: int) -> NDArray[np.float64]:
    """(n_beams,) bearings [rad] from a printed first bearing and step, freed of what the printing rounded off."""
    bearings = np.asarray(start + step * np.arange(n_beams), dtype=np.float64)
    known = _known(n_beams)
    if known is not None and np.allclose(bearings, known, rtol=0.0, atol=_PRINTED_PRECISION):
        return known
    return bearings
