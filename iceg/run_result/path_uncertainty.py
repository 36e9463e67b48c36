"""How well the path is known where it is known least."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True, slots=True, kw_only=True)
class LeastKnown:
    """The key pose that is known least.

    Attributes:
        scan: its scan.
        deviation: of its position, along the worst direction and relative to the first key pose [m].
    """

    scan: int
    deviation: float

    def warning(self, uncertain: float) -> str | None:
        """A sentence for a person; None where the standard deviation is below `uncertain` [m]."""
        if self.deviation < uncertain:
            return None
        return (
            f"the path is uncertain: around scan {self.scan} it is known only to ±{self.deviation:.1f} m (one standard "
            "deviation, relative to the first scan)"
        )


def least_known(key_scans: NDArray[np.int64], covariances: NDArray[np.float64]) -> LeastKnown:
    """The key pose whose position is the least certain.

    Args:
        key_scans: (k,) scan of each key pose.
        covariances: (k, 3, 3) of the key poses relative to the first.
    """
    xx, xy, yy = covariances[:, 0, 0], covariances[:, 0, 1], covariances[:, 1, 1]
    largest = 0.5 * (xx + yy) + np.hypot(0.5 * (xx - yy), xy)
    worst = int(np.argmax(largest))
    return LeastKnown(scan=int(key_scans[worst]), deviation=math.sqrt(max(0.0, float(largest[worst]))))
