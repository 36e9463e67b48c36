"""Headings that somebody gave in degrees."""

import math

_WHOLE_TURN = 2.0 * math.pi * (1.0 + 1e-6)


def not_in_radians(heading: float) -> str | None:
    """What to say of a heading beyond a whole turn [rad], in which nobody states a pose; None within it."""
    if not abs(heading) > _WHOLE_TURN:
        return None
    return f"found a heading of {heading:g} rad, expected radians ({heading:g}° is {math.radians(heading):.6g})"
