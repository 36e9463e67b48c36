"""Squared norms of errors, and the χ² quantile of the graph's gates."""

import numpy as np
import pytest
from scipy.stats import chi2

from graph.noise import largest_squared_norm, squared_norm


@pytest.mark.parametrize("probability", [1e-6, 0.1, 0.5, 0.95, 0.99, 0.999, 1.0 - 1e-7])
def test_the_gate_is_the_quantile_of_chi_square_with_three_degrees_of_freedom(probability: float) -> None:
    np.testing.assert_allclose(largest_squared_norm(probability), chi2.isf(1.0 - probability, 3), rtol=1e-9)


def test_a_squared_norm_is_what_a_linear_solver_says() -> None:
    rng = np.random.default_rng(0)
    for scale in (1.0, 1e-3, 50.0):
        root, error = rng.normal(size=(3, 3)) * [1.0, scale, 0.1], rng.normal(size=3)
        covariance = root @ root.T + 1e-3 * np.eye(3)
        assert squared_norm(error, covariance) == pytest.approx(error @ np.linalg.solve(covariance, error))
