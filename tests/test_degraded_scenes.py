"""Scenes drawn at random whose recordings have a fault: how far off they were before it was understood, and are now."""

import pytest

from iceg.evaluation.regression.cells import Cell
from iceg.evaluation.regression.recordings import recording_of
from iceg.evaluation.regression.runner import outcomes


@pytest.mark.parametrize(
    ("scene", "fault", "most"),
    [
        ("random:12000", "gap", 0.02),  # 5.2 m, taken for carried, as any step longer than others changed the view
        ("random:12003", "odometry noise 50 %", 0.1),  # 0.49 m along its odometry
        ("random:12012", "laser stuck 5", 0.06),  # 0.11 m, most key scans without a return
    ],
)
def test_faults_that_are_understood_cost_little(scene: str, fault: str, most: float) -> None:
    cell = Cell(group="random", source=scene, fault=fault)
    (outcome,) = outcomes(recording_of(cell, None), [cell])
    assert outcome.error_m < most
    assert outcome.nees is not None
    assert outcome.nees < 12.0
