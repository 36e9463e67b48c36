"""Covariances fit for a factor, squared norms of errors, and the χ² quantile of the graph's gates."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from scipy.stats import chi2

from graph.errors import GraphError
from graph.noise import (
    MAX_CONDITION,
    chi2_gate,
    chi2_tail,
    conditioned,
    information_of,
    largest_squared_norm,
    squared_norm,
    summed_ratios,
)

COVARIANCE = np.array([[4e-4, 1e-5, 0.0], [1e-5, 3e-4, 2e-5], [0.0, 2e-5, 1e-4]])


@pytest.mark.parametrize("probability", [1e-6, 0.1, 0.5, 0.95, 0.99, 0.999, 1.0 - 1e-7])
def test_the_gate_is_the_quantile_of_chi_square_with_three_degrees_of_freedom(probability: float) -> None:
    np.testing.assert_allclose(largest_squared_norm(probability), chi2.isf(1.0 - probability, 3), rtol=1e-9)


@pytest.mark.parametrize("freedom", [1, 2, 3, 4, 5])
@pytest.mark.parametrize("x", [0.0, 0.3, 2.0, 17.0, 200.0])
def test_the_tail_of_chi_square(freedom: int, x: float) -> None:
    assert chi2_tail(x, freedom) == pytest.approx(chi2.sf(x, freedom), rel=1e-9)


@pytest.mark.parametrize("freedom", [1, 3])
@pytest.mark.parametrize("false_alarm", [1e-9, 1.544e-5, 0.05, 0.5])
def test_a_gate_refuses_as_many_true_errors_as_it_says(freedom: int, false_alarm: float) -> None:
    assert chi2_gate(false_alarm, freedom) == pytest.approx(chi2.isf(false_alarm, freedom), rel=1e-9)


def test_a_squared_norm_is_what_a_linear_solver_says() -> None:
    rng = np.random.default_rng(0)
    for scale in (1.0, 1e-3, 50.0):
        root, error = rng.normal(size=(3, 3)) * [1.0, scale, 0.1], rng.normal(size=3)
        covariance = root @ root.T + 1e-3 * np.eye(3)
        assert squared_norm(error, covariance) == pytest.approx(error @ np.linalg.solve(covariance, error))


def test_summed_ratios_are_the_eigenvalues_of_one_covariance_relative_to_another() -> None:
    rng = np.random.default_rng(2)
    roots = rng.normal(size=(20, 2, 3, 3))
    for covariance, other in roots @ np.swapaxes(roots, -1, -2) + 0.1 * np.eye(3):
        expected = np.linalg.eigvals(np.linalg.solve(other, covariance)).real.sum()
        assert summed_ratios(covariance, other) == pytest.approx(expected)


def test_a_covariance_too_flat_is_widened_never_narrowed() -> None:
    flat = np.diag([1.0, 1e-12, 1e-4])
    widened = conditioned(flat)
    np.testing.assert_allclose(widened, np.diag([1.0, 1 / MAX_CONDITION, 1e-4]))
    assert np.linalg.cond(widened) <= MAX_CONDITION * 1.001
    assert np.linalg.eigvalsh(widened - flat)[0] >= -1e-12


@given(st.floats(0.0, np.pi), st.floats(0.0, np.pi), st.floats(0.5, 2.0), st.floats(-5.0, -4.2))
def test_a_widened_covariance_is_fit_to_the_last_bit(yaw: float, pitch: float, weak: float, sure: float) -> None:
    (c, s), (p, q) = (np.cos(yaw), np.sin(yaw)), (np.cos(pitch), np.sin(pitch))
    axes = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]) @ np.array(
        [[p, 0.0, q], [0.0, 1.0, 0.0], [-q, 0.0, p]]
    )
    widened = conditioned(axes @ np.diag(10.0 ** np.array([2.0 * weak, -4.0, 2.0 * sure])) @ axes.T)
    np.testing.assert_array_equal(conditioned(widened), widened)


def test_a_fit_covariance_passes_unchanged_but_for_rounding() -> None:
    np.testing.assert_array_equal(conditioned(COVARIANCE), COVARIANCE)
    np.testing.assert_allclose(information_of(COVARIANCE) @ COVARIANCE, np.eye(3), atol=1e-12)
    nearly = COVARIANCE.copy()
    nearly[0, 1] *= 1 + 1e-9
    np.testing.assert_array_equal(conditioned(nearly), conditioned(nearly).T)


@pytest.mark.parametrize(
    ("covariance", "message"),
    [
        (np.zeros((3, 3)), "positive definite"),
        (-COVARIANCE, "positive definite"),
        (np.diag([1.0, 1.0, -1e-9]), "positive definite"),
        (np.diag([1.0, np.nan, 1.0]), "finite"),
        (np.eye(2), "3x3"),
        (COVARIANCE + np.triu(COVARIANCE, 1), "symmetric"),
    ],
)
def test_what_is_no_covariance_is_refused(covariance: NDArray[np.float64], message: str) -> None:
    with pytest.raises(GraphError, match=message):
        conditioned(covariance)
