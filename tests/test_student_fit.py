"""Regression with Student's t, and what it takes for chance."""

import numpy as np

from iceg.slam.odometry.student_fit import chance_of, student_fit


def test_a_fit_among_wrong_values_finds_the_right_coefficients_and_scatter() -> None:
    rng = np.random.default_rng(3)
    rows = rng.standard_normal((400, 2)) * (1.0, 1000.0)
    values = rows[:, 0] * 0.5 - rows[:, 1] * 0.002 + 0.01 * rng.standard_normal(400)
    values[::8] += rng.uniform(-3.0, 3.0, 50)
    fit = student_fit(np.column_stack([rows, np.zeros(400)]), values, 3.0)
    np.testing.assert_allclose(fit.coefficients, [0.5, -0.002, 0.0], rtol=0.01)
    assert 0.007 < fit.scale < 0.014


def test_series_that_have_nothing_to_do_with_each_other_look_related_as_seldom_as_is_said() -> None:
    rng = np.random.default_rng(5)
    chances = []
    for _ in range(100):
        smooth = np.cumsum(rng.standard_normal((2, 130)), axis=1)
        seen, read = smooth[:, 12:] - smooth[:, :-12]  # both go on as they went, for a dozen steps
        ones = np.ones((len(seen), 1))
        fit = student_fit(np.column_stack([ones, read]), seen, 3.0)
        chances.append(chance_of(student_fit(ones, seen, 3.0), fit, freedom=1, tried=1, lags=16))
    assert np.mean(np.array(chances) < 0.01) < 0.05
    assert min(chances) > 1e-4


def test_series_that_follow_each_other_are_no_chance() -> None:
    rng = np.random.default_rng(5)
    read = rng.standard_normal(40)
    seen = 0.3 * read + 0.1 * rng.standard_normal(40)
    ones = np.ones((40, 1))
    fit = student_fit(np.column_stack([ones, read]), seen, 3.0)
    assert chance_of(student_fit(ones, seen, 3.0), fit, freedom=1, tried=20, lags=16) < 1e-6
