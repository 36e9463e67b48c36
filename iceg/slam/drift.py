"""How uncertain the path has become since the last loop closure: how wide a search for the next must be."""

import numpy as np
from numpy.typing import NDArray


class Drift:
    """How uncertain the path between two key poses is, by chaining the steps since the last closure."""

    def __init__(self, n_keys: int) -> None:
        self._position = np.zeros(n_keys)
        self._heading = np.zeros(n_keys)
        self._last_closure = 0

    def add(self, key: int, covariance: NDArray[np.float64]) -> None:
        """Add the (3, 3) covariance of the step that leads to `key`."""
        self._position[key] = max(covariance[0, 0], covariance[1, 1])
        self._heading[key] = covariance[2, 2]

    def close(self, key: int) -> None:
        """A closure at `key` ends the drift of everything before it."""
        self._last_closure = key

    def between(self, key_old: int, key_new: int, poses: NDArray[np.float64]) -> NDArray[np.float64]:
        """(2,) standard deviations of position [m] and heading [rad] of the later pose relative to the earlier."""
        steps = slice(max(key_old, self._last_closure) + 1, key_new + 1)
        lever2 = np.sum((poses[steps, :2] - poses[key_new, :2]) ** 2, axis=1)
        heading = self._heading[steps]
        variances = np.array([np.sum(self._position[steps] + heading * lever2), np.sum(heading)])
        return np.asarray(np.sqrt(variances), dtype=np.float64)
