"""What the noise of a laser adds to the errors that the settings of ICE allow for."""

from frontends.laser_noise import LaserNoise
from iceg.ice._point_kernels import RangeNoise

ALLOWED = 1.0 / 60.0
"""Standard deviation of ranges that the settings allow for [m]. They were found on lasers that err by about a
centimetre and hold as much again for cells, clutter and walls that are no lines: the Cauchy weight, .04 m wide, is 95 %
efficient for Gaussian errors of 1/2.4 of that. What a laser errs by beyond this is independent of all else, so that
variances add up; one that errs less leaves everything as it is."""

PLAIN = RangeNoise(constant=0.0, per_metre2=0.0, allowed=ALLOWED**2, typical=0.0)
"""Of a laser that errs by no more than is allowed for."""


def beyond_allowed(noise: LaserNoise | None) -> RangeNoise:
    """What a laser's noise, None where nobody knows it, is beyond what the settings allow for at its typical range."""
    if noise is None or noise.typical <= ALLOWED:
        return PLAIN
    return RangeNoise(
        constant=noise.constant**2,
        per_metre2=noise.per_metre**2,
        allowed=ALLOWED**2,
        typical=noise.typical**2 - ALLOWED**2,
    )
