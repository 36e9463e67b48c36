"""Headings that somebody gave in degrees."""

import math

from frontends.scan import WHOLE_TURN


def not_in_radians(heading: float) -> str | None:
    """What to say of a heading beyond a whole turn [rad], in which nobody states a pose; None within it."""
    if not abs(heading) > WHOLE_TURN:
        return None
    return f"found a heading of {heading:g} rad, expected radians ({heading:g}° is {math.radians(heading):.6g})"
