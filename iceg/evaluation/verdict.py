"""What a NEES says, in words."""

import math

from iceg.evaluation.consistency import DEGREES_OF_FREEDOM

_RIGHT = 0.1
"""Standard deviations that are off by no more than this share pass for right: errors along one path go together, and
tell it no better."""
_MANY = 100.0


def nees_verdict(mean: float) -> str:
    """How the standard deviations compare with the errors.

    The NEES goes with the square of error over standard deviation, so their ratio is √(3 / mean).

    Args:
        mean: mean NEES of poses, three degrees of freedom each.

    Returns:
        One sentence for a person.
    """
    shown = f"NEES {mean:.2f} ({DEGREES_OF_FREEDOM} would be exact)"
    if mean <= 0.0:
        return f"{shown}: there are no errors to judge the standard deviations by"
    larger = math.sqrt(DEGREES_OF_FREEDOM / mean) - 1.0
    if abs(larger) <= _RIGHT:
        return f"{shown}: the standard deviations are right to within {100 * _RIGHT:.0f} %"
    if larger > 0.0:
        return f"{shown}: the standard deviations are {_times(1.0 + larger)} larger than the errors, on the safe side"
    errors = 1.0 / (1.0 + larger)
    return f"{shown}: the errors are {_times(errors)} larger than the standard deviations say, which are too small"


def _times(ratio: float) -> str:
    if ratio > _MANY:
        return f"more than {_MANY:.0f} times"
    return f"{ratio:.1f} times" if ratio >= 2.0 else f"{100 * (ratio - 1.0):.0f} %"
