"""How much of a log is kept in memory while it is read."""

from dataclasses import dataclass
from pathlib import Path

from frontends.logs.errors import LogError
from graph.limits import LIMITS, at_most


@dataclass(slots=True)
class Budget:
    """Scans and readings taken in so far.

    Attributes:
        path: the log, for the message.
        scans: so far.
        readings: of all of them.
    """

    path: Path
    scans: int = 0
    readings: int = 0

    def take(self, n_beams: int, scans: int = 1) -> None:
        """Take in more scans of so many beams each, one unless told otherwise.

        Raises:
            LogError: there are more of them, or more readings, than allowed.
        """
        self.scans += scans
        self.readings += scans * n_beams
        if self.scans > LIMITS.scans or self.readings > LIMITS.readings:
            name = "scans" if self.scans > LIMITS.scans else "readings"
            raise LogError(f"{self.path}: found more {name}, expected {at_most(name)}")


def check_stack(path: Path, n_scans: int, n_beams: int) -> None:
    """Refuse scans that would take too much room once all have the same beams.

    Raises:
        LogError: naming the file, what was found and what was expected.
    """
    if n_scans * n_beams > LIMITS.readings:
        raise LogError(
            f"{path}: found {n_scans} scans that would all have the usual {n_beams} beams, expected "
            f"{at_most('readings')} readings"
        )
