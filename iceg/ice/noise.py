"""What the noise of a laser adds to the errors that the settings of ICE allow for."""

from frontends.laser_noise import LaserNoise
from iceg.ice._noise_kernels import RangeNoise

ALLOWED = 0.025
"""Standard deviation of ranges that the settings allow for [m]. The recorded logs on which they were found err by .5 to
2.4 cm, and the widths hold more than that for cells, clutter and walls that are no lines. What a laser errs by beyond
this is independent of all else, so that variances add up; a range that errs less counts as it is. With .017 m
the recorded logs and simulated ones of σ = 3 cm do as well, and a log of 2.4 cm takes a quarter more time."""

PLAIN = RangeNoise(constant=0.0, per_metre2=0.0, allowed=ALLOWED**2, typical=0.0)
"""Of a laser that errs by no more than is allowed for."""


def beyond_allowed(noise: LaserNoise | None) -> RangeNoise:
    """What a laser's noise, None where nobody knows it, is beyond what the settings allow for.

    A laser that is as good as that near by may not be far away: each range counts by itself, and what is typical only
    for what all have in common.
    """
    if noise is None:
        return PLAIN
    return RangeNoise(
        constant=noise.constant**2,
        per_metre2=noise.per_metre**2,
        allowed=ALLOWED**2,
        typical=max(0.0, noise.typical**2 - ALLOWED**2),
    )
