"""Tests of references: exact derivatives, a start at rest, smooth ramps."""

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from colift.math import so3
from colift.trajectories import base, departure, lissajous, minimum_snap, pose_spline

at = jax.jit(lambda path, t: path.evaluate(t))
pulse = jax.jit(base.smooth_pulse)


def random_path(seed: int) -> lissajous.Lissajous:
    """Path with random numbers, with a ramp of one to four seconds."""
    rng = np.random.default_rng(seed)
    return lissajous.Lissajous(
        center=jnp.array(rng.normal(size=3)),
        amplitude=jnp.array(rng.normal(size=3)),
        period=jnp.array(rng.uniform(3, 8, 3)),
        phase=jnp.array(rng.uniform(-3, 3, 3)),
        ramp_time=jnp.array(rng.uniform(1, 4)),
        R=jnp.eye(3),
        rotation_amplitude=jnp.zeros(3),
        rotation_period=jnp.array(rng.uniform(3, 8, 3)),
        rotation_phase=jnp.array(rng.uniform(-3, 3, 3)),
    )


def rotating_path(seed: int) -> lissajous.Lissajous:
    """The same path with a rotating attitude."""
    rng = np.random.default_rng(seed)
    turned = so3.exp(jnp.array(rng.normal(size=3)))
    return dataclasses.replace(random_path(seed), R=turned, rotation_amplitude=jnp.array(rng.uniform(-1, 1, 3)))


def random_waypoints(seed: int) -> tuple[pose_spline.PoseSpline, np.ndarray, np.ndarray, np.ndarray]:
    """A path through random poses, with times, the positions and the attitudes."""
    rng = np.random.default_rng(seed)
    t = np.cumsum(rng.uniform(0.3, 2, rng.integers(2, 6)))
    p, R = rng.normal(size=(len(t), 3)), Rotation.from_rotvec(0.5 * rng.normal(size=(len(t), 3))).as_matrix()
    return minimum_snap.minimum_snap(t, p, R), t, p, R


def values(path: lissajous.Lissajous, t: float) -> np.ndarray:
    """Return position, velocity, acceleration and jerk as rows."""
    d = at(path, jnp.array(t))
    return np.stack([d.p, d.v, d.a, d.j])


@given(seed=st.integers(0, 10**6), t=st.floats(0.01, 12))
def test_derivatives_are_consistent(seed, t):
    path, h = random_path(seed), 1e-3
    # five points: the error is h^4 / 30 times a fifth derivative of a few hundred at most, and rounding / h
    f = {k: values(path, t + k * h) for k in (-2, -1, 1, 2)}
    rate = (f[-2] - 8 * f[-1] + 8 * f[1] - f[2]) / (12 * h)
    kinks = [abs(t - float(path.ramp_time)), t]  # at both ends of the ramp the jerk is continuous, its rate is not
    if min(kinks) > 3 * h:
        np.testing.assert_allclose(values(path, t)[1:], rate[:-1], atol=1e-7)


@pytest.mark.parametrize("path", [rotating_path(1), rotating_path(2), random_waypoints(3)[0], random_waypoints(4)[0]])
def test_attitude_rate_is_the_stated_body_rate(path):
    """`R' = R hat(omega)`, `omega' = omega_dot`, `omega'' = omega_ddot` by differences of order 4; SciPy rotations."""
    h = 1e-3
    for t in np.linspace(0.6, 1.4, 5):
        near = {k: at(path, jnp.array(t + k * h)) for k in (-2, -1, 0, 1, 2)}
        turns = {k: Rotation.from_matrix(near[0].R.T @ d.R).as_rotvec() for k, d in near.items()}
        now = near[0]
        rate = (turns[-2] - 8 * turns[-1] + 8 * turns[1] - turns[2]) / (12 * h)
        np.testing.assert_allclose(now.omega, rate, atol=1e-7)
        for name, derivative in (("omega", "omega_dot"), ("omega_dot", "omega_ddot")):
            y = {k: np.asarray(getattr(d, name)) for k, d in near.items()}
            rate = (y[-2] - 8 * y[-1] + 8 * y[1] - y[2]) / (12 * h)
            np.testing.assert_allclose(getattr(now, derivative), rate, atol=1e-6, err_msg=derivative)
        np.testing.assert_allclose(now.R.T @ now.R, np.eye(3), atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_waypoints_are_reached_at_their_times(seed):
    path, t, p, R = random_waypoints(seed)
    for k, when in enumerate(t):
        d = at(path, jnp.array(when))
        np.testing.assert_allclose(d.p, p[k], atol=1e-9)
        np.testing.assert_allclose(d.R, R[k], atol=1e-9)
        if k in (0, len(t) - 1):
            for still in (d.v, d.a, d.j, d.omega, d.omega_dot):
                np.testing.assert_allclose(still, 0, atol=1e-6)
    for outside, k in ((t[0] - 1, 0), (t[-1] + 1, -1)):
        d = at(path, jnp.array(outside))
        np.testing.assert_allclose(d.p, p[k], atol=1e-9)
        np.testing.assert_allclose(d.R, R[k], atol=1e-9)
        np.testing.assert_allclose(d.v, 0, atol=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_snap_is_minimal(seed):
    """The snap is orthogonal to that of every curve that is zero at the poses and at rest at both ends: Gauss' rule."""
    path, t, *_ = random_waypoints(seed)
    rng = np.random.default_rng(seed)
    knots, c = np.asarray(path.position.knots), np.asarray(path.position.coefficients)
    nodes, weights = np.polynomial.legendre.leggauss(12)
    roots = np.repeat(t, np.where(np.isin(t, t[[0, -1]]), 4, 1))  # four times at the ends: three derivatives vanish
    bump = np.polynomial.Polynomial.fromroots(roots) * np.polynomial.Polynomial(rng.normal(size=3))
    product, sizes = np.zeros(3), np.zeros(3)
    for i in range(len(c)):
        s = (nodes + 1) / 2 * (knots[i + 1] - knots[i])
        snap = np.stack([np.polynomial.Polynomial(column).deriv(4)(s) for column in c[i].T])
        other = bump.deriv(4)(knots[i] + s)
        each = (snap * other) * weights * (knots[i + 1] - knots[i]) / 2
        product, sizes = product + each.sum(1), sizes + np.abs(each).sum(1)
    np.testing.assert_allclose(product / sizes, 0, atol=1e-8)


@pytest.mark.parametrize(
    ("t", "message"), [([1.0], "at least two"), ([0.0, 2.0, 1.0], "must ascend"), ([0.0, 1.0, 1.0], "must ascend")]
)
def test_invalid_times_are_refused(t, message):
    with pytest.raises(ValueError, match=message):
        minimum_snap.minimum_snap(np.array(t), np.zeros((len(t), 3)), np.tile(np.eye(3), (len(t), 1, 1)))


@given(seed=st.integers(0, 10**6))
def test_reference_starts_at_rest_in_its_center(seed):
    """The reference starts at rest in its center with its attitude."""
    path = random_path(seed)
    np.testing.assert_allclose(values(path, 0.0), [path.center, *np.zeros((3, 3))], atol=1e-12)
    d = at(path, jnp.array(1.7))
    np.testing.assert_array_equal(d.R, path.R)
    assert not np.any(d.omega)
    assert not np.any(d.omega_dot)


def test_path_departure_is_smooth_and_starts_later():
    path = dataclasses.replace(rotating_path(3), ramp_time=jnp.array(1.0))
    shift, swing = jnp.array([1.0, -2.0, 0.5]), jnp.array([0.1, 0.2, -0.1])
    numbers = {"start": 2.0, "ramp_time": 1.5, "rotation_start": 5.0, "rotation_period": 3.0}
    off = departure.PathDeparture(
        base=path, offset=shift, rotation_amplitude=swing, **{k: jnp.array(x) for k, x in numbers.items()}
    )
    for t in (0.5, 2.0):
        jax.tree.map(
            lambda a, b: np.testing.assert_allclose(a, b, atol=1e-12), at(off, jnp.array(t)), at(path, jnp.array(t))
        )
    left, was = at(off, jnp.array(4.0)), at(path, jnp.array(4.0))
    np.testing.assert_allclose(left.p - was.p, shift, atol=1e-12)
    np.testing.assert_allclose(left.v, was.v, atol=1e-9)
    h = 1e-4
    for t in (2.7, 6.1):
        before, now, after = (at(off, jnp.array(t + k * h)) for k in (-1, 0, 1))
        np.testing.assert_allclose((after.p - before.p) / (2 * h), now.v, atol=1e-5)
        np.testing.assert_allclose((after.omega - before.omega) / (2 * h), now.omega_dot, atol=1e-5)
        rate = Rotation.from_matrix(np.asarray(before.R).T @ np.asarray(after.R)).as_rotvec() / (2 * h)
        np.testing.assert_allclose(rate, now.omega, atol=1e-5)


def test_after_the_ramp_it_is_the_lissajous_figure():
    path, t = random_path(3), 5.0
    wave = 2 * np.pi * t / np.asarray(path.period) + np.asarray(path.phase)
    rate = 2 * np.pi / np.asarray(path.period)
    size = np.asarray(path.amplitude)
    expected = [path.center + size * np.sin(wave), size * rate * np.cos(wave), -size * rate**2 * np.sin(wave)]
    np.testing.assert_allclose(values(path, t)[:3], expected, atol=1e-12)


def test_smooth_step_has_three_vanishing_derivatives():
    """The smooth step has three vanishing derivatives at both ends."""
    d = base.smooth_step
    for order in range(4):
        expected = [0.0, 0.0, 1.0, 1.0] if order == 0 else [0.0] * 4
        inside = [jnp.array(s) for s in (-0.3, 1e-12, 1 - 1e-12, 1.4)]
        np.testing.assert_allclose([d(s) for s in inside], expected, atol=1e-7)
        d = jax.grad(d)


@given(a=st.floats(-0.5, 1.5), b=st.floats(-0.5, 1.5))
def test_the_smooth_step_rises_and_is_symmetric(a, b):
    low, high = (float(base.smooth_step(jnp.array(s))) for s in sorted((a, b)))
    assert low <= high + 1e-15
    mirrored = float(base.smooth_step(jnp.array(1 - a)))
    assert mirrored + float(base.smooth_step(jnp.array(a))) == pytest.approx(1, abs=1e-12)


def test_pulse_values():
    """A pulse is zero outside, one inside and one half in the middle of its ramps."""
    t = jnp.array([0.0, 7.999, 8.0, 8.25, 8.5, 11.0, 13.5, 13.75, 14.0, 20.0])
    height = pulse(t, jnp.array(8.0), jnp.array(14.0), jnp.array(0.5))
    np.testing.assert_allclose(height, [0, 0, 0, 0.5, 1, 1, 1, 0.5, 0, 0], atol=1e-12)
