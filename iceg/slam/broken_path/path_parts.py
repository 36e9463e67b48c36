"""Parts of a path between the steps that do not hold, and which of them loop closures have joined.

Of several parts any two may be the first to be joined: a robot that was carried twice may come back to where it was
between, while how either part lies to the first is not yet known.
"""

from collections.abc import Iterable, Mapping

import numpy as np

from graph.arrays import Bools
from iceg.slam.closures.attempt import Attempt


class PathParts:
    """Parts, and what holds together among them."""

    def __init__(self, n_keys: int, open_steps: Iterable[int], ties: Mapping[int, int]) -> None:
        """Take stock.

        Args:
            n_keys: key poses of the path.
            open_steps: key poses whose step from the one before is not known.
            ties: the same where the step is known not to hold, each with another key pose that closures tie it to.
        """
        self._open, self._ties = sorted(open_steps), ties
        self.starts = sorted({0, *self._open, *ties})
        """The first key pose of every part."""
        part = np.searchsorted(self.starts, np.arange(n_keys), side="right") - 1
        whole = list(range(len(self.starts)))
        for key, other in sorted(ties.items()):
            low, high = sorted((whole[part[key]], whole[part[other]]))
            whole = [low if each == high else each for each in whole]
        self.whole = np.array(self.starts)[np.array(whole)[part]]
        """(n_keys,) the first key pose of all that holds together with each."""

    def is_within(self, closure: Attempt) -> bool:
        """Whether both ends of a closure hold together already."""
        return bool(self.whole[closure.key_old] == self.whole[closure.key_new])

    def end_of(self, key: int) -> int:
        """The key pose after the last of the part that `key` is in."""
        return min((start for start in self.starts if start > key), default=len(self.whole))

    def moved_by(self, closure: Attempt, key: int) -> Bools:
        """(n_keys,) what a closure moves: the part that begins at a key pose, and what holds together with it.

        Parts of which nothing else is known follow the one before.

        Args:
            closure: between two parts; between key poses of one, what is tied to the part at `key` goes with it.
            key: the first key pose of a part.
        """
        moving = np.zeros(len(self.whole), dtype=np.bool_)
        if not self.is_within(closure):
            moving |= self.whole == key
        else:
            moving[key : self.end_of(key)] = True
            for start, other in sorted(self._ties.items()):
                if moving[other] and not moving[start]:
                    moving[start : self.end_of(start)] = True
        for start in self._open:
            if moving[start - 1] and self.whole[start] == start:
                moving |= self.whole == start
        return moving
