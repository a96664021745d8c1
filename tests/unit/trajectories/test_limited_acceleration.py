"""Splines with limited acceleration: limits, optimality, second differences."""

import numpy as np
import pytest
from scipy import interpolate

from colift.trajectories import limited_acceleration as limited

T = np.linspace(0, 2, 41)
DEGREE = 5
KNOTS = np.concatenate([np.zeros(DEGREE), np.linspace(0, 2, 21), np.full(DEGREE, 2.0)])
STEP = np.where(T < 1, 0.0, (T - 1) ** 2)[:, None]  # 2 m/s^2 from 1 s on


def coefficients(p: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the coefficients without and with limits."""
    B = interpolate.BSpline.design_matrix(T, KNOTS, DEGREE)
    free = np.linalg.lstsq(B.toarray(), p, rcond=None)[0]
    differences = limited.second_differences(T, p, 0.0, 2.0)
    return free, limited.limited_coefficients(B, KNOTS, DEGREE, p, differences)


def acceleration(c: np.ndarray) -> np.ndarray:
    return interpolate.BSpline(KNOTS, c, DEGREE)(np.linspace(0, 2, 2001), 2)


def test_a_step_is_kept_within_its_limits():
    free, found = coefficients(STEP)
    assert np.abs(acceleration(free)).max() > 2 * (1 + limited.SLACK)
    assert acceleration(found).max() <= 2 * (1 + limited.SLACK) + 1e-3
    assert acceleration(found).min() >= -2 * limited.SLACK - 1e-3
    assert np.abs(interpolate.BSpline(KNOTS, found, DEGREE)(T) - STEP).max() < 2e-3


def test_a_parabola_is_not_changed():
    free, found = coefficients((T**2)[:, None])
    np.testing.assert_allclose(found, free, atol=1e-6)


def test_no_other_spline_within_the_limits_is_closer():
    """The residual of a mixture with any admissible spline is not smaller."""
    _, found = coefficients(STEP)
    B = interpolate.BSpline.design_matrix(T, KNOTS, DEGREE)
    centers = np.array([KNOTS[k + 1 : k + 1 + DEGREE].mean() for k in range(len(found))])
    for start in (0.95, 1.0, 1.05):  # control points of a step have second differences within its range
        other = np.where(centers < start, 0.0, (centers - start) ** 2)[:, None]
        mixed = found + 1e-3 * (other - found)
        assert ((B @ mixed - STEP) ** 2).sum() >= ((B @ found - STEP) ** 2).sum() - 1e-9


def test_second_differences_are_averages_of_the_acceleration():
    rng = np.random.default_rng(0)
    t = np.sort(rng.uniform(0, 2, 60))
    found = limited.second_differences(t, (t**2)[:, None] * [1.0, 0.0, -2.0], 0.0, 4.0)
    np.testing.assert_allclose(found.a, np.tile([2.0, 0.0, -4.0], (len(found.t), 1)), atol=1e-6)
    assert found.largest == pytest.approx(20**0.5)


def test_noise_extends_over_more_rows():
    rng, t = np.random.default_rng(0), 0.01 * np.arange(400)
    noisy = np.stack([t**2 + 1e-4 * rng.normal(size=len(t))], axis=1)
    assert limited.second_differences(t, noisy, 1e-4, 2.0).largest == pytest.approx(2, rel=0.1)
    assert limited.second_differences(t, noisy, 0.0, 2.0).largest > 4
