"""A run says where its path is known least."""

import numpy as np
import pytest

from iceg.run_result.path_uncertainty import least_known


def test_the_worst_direction_of_the_worst_pose_counts() -> None:
    turn = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])
    covariances = np.stack([np.zeros((3, 3)), turn @ np.diag([9.0, 0.01, 1e-4]) @ turn.T, np.diag([4.0, 4.0, 1e-4])])
    worst = least_known(np.array([0, 70, 140]), covariances)
    assert worst.scan == 70
    assert worst.deviation == pytest.approx(3.0)
    warning = worst.warning(0.3)
    assert warning is not None
    assert "scan 70" in warning
    assert "±3.0 m" in warning


def test_a_path_that_is_known_well_is_not_talked_about() -> None:
    assert least_known(np.array([0, 9]), np.stack([np.zeros((3, 3)), np.diag([0.01, 0.04, 1e-4])])).warning(0.3) is None
