"""Delay margin by characteristic loci against the eigenvalues of the loop with a queue of commands."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from colift.analysis import characteristic_loci, stability

MAX_TICKS = 30


def largest_stable_delay(A, B, K):
    """Largest delay up to which the loop with appended commands is stable."""
    for ticks in range(1, MAX_TICKS + 1):
        if np.abs(np.linalg.eigvals(stability._append_delay(A + B @ K, B, K, ticks))).max() >= 1:
            return ticks - 1
    return MAX_TICKS


def random_loop(seed):
    """Oscillators and integrators in state feedback that decays, sampled, with some more states."""
    rng = np.random.default_rng(seed)
    n, m = int(rng.integers(2, 9)), int(rng.integers(1, 4))
    A = np.eye(n) + 0.05 * rng.normal(size=(n, n)) * rng.uniform(0, 1, (n, 1))
    B = 0.1 * rng.normal(size=(n, m))
    P = np.eye(n)
    for _ in range(300):  # linear quadratic regulator
        gain = np.linalg.solve(10 ** rng.uniform(-1, 1) * np.eye(m) + B.T @ P @ B, B.T @ P @ A)
        P = np.eye(n) + A.T @ P @ (A - B @ gain)
    return A, B, -gain * rng.uniform(0.7, 1.3)


@given(st.integers(0, 2**31))
@settings(max_examples=25)
def test_delay_margin_is_that_of_the_appended_loop(seed):
    A, B, K = random_loop(seed)
    assume(np.abs(np.linalg.eigvals(A + B @ K)).max() < 1)
    nyquist = np.abs(characteristic_loci.characteristic_loci(A, B, K)(np.pi)).max()
    found, expected = characteristic_loci.delay_margin(A, B, K), largest_stable_delay(A, B, K)
    if nyquist >= 1:
        assert found == 0
        return
    assume(abs(found - round(found)) > 1e-6 or found > MAX_TICKS)
    assert min(int(np.ceil(found)) - 1 if np.isfinite(found) else MAX_TICKS, MAX_TICKS) == expected


def test_delay_margin_of_an_integrator():
    """``x+ = x - k u``: a loop of one integrator with gain k has the phase margin of ``k / (z - 1)``."""
    k = 0.1
    angle = 2 * np.arcsin(k / 2)  # |exp(i w) - 1| = k
    phase_margin = np.pi / 2 - angle / 2
    found = characteristic_loci.delay_margin(np.eye(1), np.array([[1.0]]), np.array([[-k]]))
    assert found == pytest.approx(phase_margin / angle, rel=1e-6)


def test_margin_of_a_lightly_damped_mode_between_grid_points():
    """A resonance of damping 1e-4 that the grid without poles misses."""
    dt, omega, damping = 1e-3, 77.7, 1e-4
    s = np.array([[0.0, 1.0], [-(omega**2), -2 * damping * omega]])
    A = np.linalg.inv(np.eye(2) - dt / 2 * s) @ (np.eye(2) + dt / 2 * s)
    B, K = np.array([[0.0], [dt]]), np.array([[0.0, -0.3]])
    ticks = 0
    while np.abs(np.linalg.eigvals(stability._append_delay(A + B @ K, B, K, ticks + 1))).max() < 1:
        ticks += 1
    found = characteristic_loci.delay_margin(A, B, K)
    assert int(np.ceil(found)) - 1 == ticks > 10


def test_loop_without_feedback_has_an_infinite_margin():
    A = np.diag([0.9, 0.5])
    assert characteristic_loci.delay_margin(A, np.zeros((2, 1)), np.ones((1, 2))) == np.inf
