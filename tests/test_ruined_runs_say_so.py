"""What must never be: a map that may not be used for anything, and not a word about it."""

import pytest

from iceg.evaluation.regression.cells import Cell
from iceg.evaluation.regression.recordings import recording_of
from iceg.evaluation.regression.runner import outcomes


@pytest.mark.parametrize("seed", [4, 82, 152, 196, 236])
def test_a_ruined_run_says_so(seed: int) -> None:
    """Markets, corridors and rings in which the path slides along, most of them without odometry."""
    cell = Cell(group="random", source=f"random:{seed}")
    (outcome,) = outcomes(recording_of(cell, None), [cell])
    assert not outcome.verdict.is_ruined_in_silence, (outcome.error_m, outcome.nees)
