"""The χ² quantile of the graph's gates."""

import numpy as np
import pytest
from scipy.stats import chi2

from graph.noise import largest_squared_norm


@pytest.mark.parametrize("probability", [1e-6, 0.1, 0.5, 0.95, 0.99, 0.999, 1.0 - 1e-7])
def test_the_gate_is_the_quantile_of_chi_square_with_three_degrees_of_freedom(probability: float) -> None:
    np.testing.assert_allclose(largest_squared_norm(probability), chi2.isf(1.0 - probability, 3), rtol=1e-9)
