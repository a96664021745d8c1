"""The reference: exact derivatives, a start at rest, smooth flanks."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colift import reference

at = jax.jit(lambda path, t: path.at(t))
pulse = jax.jit(reference.pulse)


def random_path(seed: int) -> reference.Lissajous:
    """A path with random numbers, ramped up in one to four seconds."""
    rng = np.random.default_rng(seed)
    return reference.Lissajous(
        center=jnp.array(rng.normal(size=3)),
        amplitude=jnp.array(rng.normal(size=3)),
        period=jnp.array(rng.uniform(3, 8, 3)),
        phase=jnp.array(rng.uniform(-3, 3, 3)),
        ramp=jnp.array(rng.uniform(1, 4)),
        R=jnp.eye(3),
    )


def values(path: reference.Lissajous, t: float) -> np.ndarray:
    """Position, velocity, acceleration and jerk by row."""
    d = at(path, jnp.array(t))
    return np.stack([d.p, d.v, d.a, d.j])


@given(seed=st.integers(0, 10**6), t=st.floats(0.01, 12))
def test_each_derivative_is_the_rate_of_the_one_before(seed, t):
    path, h = random_path(seed), 1e-3
    # five points: the error is h^4 / 30 times a fifth derivative of a few hundred at most, and rounding / h
    f = {k: values(path, t + k * h) for k in (-2, -1, 1, 2)}
    rate = (f[-2] - 8 * f[-1] + 8 * f[1] - f[2]) / (12 * h)
    kinks = [abs(t - float(path.ramp)), t]  # at both ends of the ramp the jerk is continuous, its rate is not
    if min(kinks) > 3 * h:
        np.testing.assert_allclose(values(path, t)[1:], rate[:-1], atol=1e-7)


@given(seed=st.integers(0, 10**6))
def test_the_reference_starts_at_rest_in_its_center_at_its_attitude(seed):
    path = random_path(seed)
    np.testing.assert_allclose(values(path, 0.0), [path.center, *np.zeros((3, 3))], atol=1e-12)
    d = at(path, jnp.array(1.7))
    np.testing.assert_array_equal(d.R, path.R)
    assert not np.any(d.omega)
    assert not np.any(d.omega_dot)


def test_after_the_ramp_it_is_the_lissajous_figure():
    path, t = random_path(3), 5.0
    wave = 2 * np.pi * t / np.asarray(path.period) + np.asarray(path.phase)
    rate = 2 * np.pi / np.asarray(path.period)
    size = np.asarray(path.amplitude)
    expected = [path.center + size * np.sin(wave), size * rate * np.cos(wave), -size * rate**2 * np.sin(wave)]
    np.testing.assert_allclose(values(path, t)[:3], expected, atol=1e-12)


def test_the_smooth_step_has_three_vanishing_derivatives_at_both_ends():
    d = reference.smooth_step
    for order in range(4):
        expected = [0.0, 0.0, 1.0, 1.0] if order == 0 else [0.0] * 4
        inside = [jnp.array(s) for s in (-0.3, 1e-12, 1 - 1e-12, 1.4)]
        np.testing.assert_allclose([d(s) for s in inside], expected, atol=1e-7)
        d = jax.grad(d)


@given(a=st.floats(-0.5, 1.5), b=st.floats(-0.5, 1.5))
def test_the_smooth_step_rises_and_is_symmetric(a, b):
    low, high = (float(reference.smooth_step(jnp.array(s))) for s in sorted((a, b)))
    assert low <= high + 1e-15
    mirrored = float(reference.smooth_step(jnp.array(1 - a)))
    assert mirrored + float(reference.smooth_step(jnp.array(a))) == pytest.approx(1, abs=1e-12)


def test_a_pulse_is_zero_outside_one_inside_and_half_in_the_middle_of_its_flanks():
    t = jnp.array([0.0, 7.999, 8.0, 8.25, 8.5, 11.0, 13.5, 13.75, 14.0, 20.0])
    height = pulse(t, jnp.array(8.0), jnp.array(14.0), jnp.array(0.5))
    np.testing.assert_allclose(height, [0, 0, 0, 0.5, 1, 1, 1, 0.5, 0, 0], atol=1e-12)
