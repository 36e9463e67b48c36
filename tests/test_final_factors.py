"""The factors at the end of a run, in two versions."""

import numpy as np
import pytest

from graph.factors import Factor
from graph.se2 import compose
from iceg.slam.broken_path.path_break import Break, Outcome
from iceg.slam.final_factors import FinalFactors
from iceg.slam.track import UNKNOWN_STEP

_STEP = np.array([0.5, 0.0, 0.1])
_MOVED = np.array([[0.0, 0.0, 0.0], [0.01, -0.02, 0.003], [-0.03, 0.01, -0.01]])


@pytest.fixture
def factors() -> FinalFactors:
    """Three poses in a row, closed in a triangle, whose second step is a sudden loss."""
    small = 1e-4 * np.eye(3)
    solved = [
        Factor(kind="prior", i=None, j=0, T_i_j=np.zeros(3), covariance=1e-6 * np.eye(3)),
        Factor(kind="odometry", i=0, j=1, T_i_j=_STEP, covariance=small),
        Factor(kind="odometry", i=1, j=2, T_i_j=_STEP, covariance=small),
        Factor(kind="closure", i=0, j=2, T_i_j=compose([0.03, 0.0, 0.0], compose(_STEP, _STEP)), covariance=small),
    ]
    return FinalFactors.of(solved, [Break(key=2, outcome=Outcome.APART, reason="", scan=2)], 3)


def test_odometry_that_is_no_longer_believed_still_has_its_say_in_what_was_solved(factors: FinalFactors) -> None:
    assert not factors.are_all_believed
    changed = [k for k, (a, b) in enumerate(zip(factors.solved, factors.measured, strict=True)) if a is not b]
    assert changed == [2]
    np.testing.assert_allclose(factors.measured[2].covariance, UNKNOWN_STEP)
    np.testing.assert_array_equal(factors.measured[2].T_i_j, factors.solved[2].T_i_j)
