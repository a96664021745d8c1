"""Attitudes along waypoints: interpolation, invariance, turning, tilt, many turns, derivatives."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from colift.trajectories import minimum_snap, pose_spline, rotation_legs

POINTS = 301  # in each leg
along = jax.jit(jax.vmap(lambda path, t: path.evaluate(t), (None, 0)))
third = jax.jit(jax.vmap(lambda path, t: jax.jvp(lambda t: path.evaluate(t).omega_dot, (t,), (1.0,))[1], (None, 0)))


def sequence(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, attitudes and angles of five legs; the kind of sequence and of times follows from the seed."""
    rng = np.random.default_rng(seed)
    n = 5
    angle, axis = rng.uniform(0, 170, n), rng.normal(size=(n, 3))
    match seed % 4:
        case 0:  # axes of the payload, with repeated attitudes and reversals
            angle = rng.choice([0, 1, 45, 170], n)
            axis = np.eye(3)[rng.integers(0, 3, n)] * rng.choice([-1, 1], (n, 1))
        case 1:  # nearly yaw
            axis = np.eye(3)[2] + rng.choice([0, 0.01, 0.3], (n, 1)) * axis
        case 2:  # angles of all sizes
            angle = 10.0 ** rng.uniform(-5, 2.23, n)
    T = np.exp(rng.uniform(np.log(0.05), np.log(5), n)) if seed % 3 else np.full(n, 2.0)
    angle, axis = np.deg2rad(angle), axis / np.linalg.norm(axis, axis=1, keepdims=True)
    R = [Rotation.from_rotvec(rng.normal(size=3))]
    for theta in angle[:, None] * axis:
        R.append(R[-1] * Rotation.from_rotvec(theta))
    return np.concatenate([[0], np.cumsum(T)]), np.array([r.as_matrix() for r in R]), angle


def path_of(t: np.ndarray, R: np.ndarray) -> pose_spline.PoseSpline:
    return minimum_snap.minimum_snap(t, np.zeros((len(t), 3)), R)


def within_legs(t: np.ndarray) -> np.ndarray:
    """Times of `POINTS` points in each leg."""
    return (t[:-1, None] + np.linspace(0, 1, POINTS) * np.diff(t)[:, None]).ravel()


@given(seed=st.integers(0, 10**6))
@settings(max_examples=20)
def test_attitudes_are_met_and_both_ends_are_at_rest(seed):
    t, R, _ = sequence(seed)
    d = along(path_of(t, R), jnp.asarray(t))
    np.testing.assert_allclose(d.R, R, atol=1e-9)
    for end in (0, -1):
        np.testing.assert_allclose(d.omega[end], 0, atol=1e-8)
        np.testing.assert_allclose(d.omega_dot[end], 0, atol=1e-6)


@given(seed=st.integers(0, 10**6), turn=st.integers(0, 10**6))
@settings(max_examples=20)
def test_body_rates_do_not_depend_on_the_world(seed, turn):
    """Left invariance to 1e-9 of the largest rate: `R_0 R_d(t)` has the same body rates for any R_0."""
    t, R, _ = sequence(seed)
    R_0 = Rotation.from_rotvec(np.random.default_rng(turn).normal(size=3) * 2).as_matrix()
    times = jnp.asarray(within_legs(t))
    one, other = along(path_of(t, R), times), along(path_of(t, R_0 @ R), times)
    for name in ("omega", "omega_dot"):
        size = max(1.0, float(jnp.abs(getattr(one, name)).max()))
        np.testing.assert_allclose(getattr(other, name) / size, getattr(one, name) / size, atol=1e-9)
    np.testing.assert_allclose(other.R, R_0 @ np.asarray(one.R), atol=1e-9)


@given(seed=st.integers(0, 10**6))
@settings(max_examples=20)
def test_no_leg_turns_more_than_1_2_times_its_angle(seed):
    t, R, angle = sequence(seed)
    d = along(path_of(t, R), jnp.asarray(within_legs(t)))
    speed = np.linalg.norm(d.omega, axis=1).reshape(len(angle), POINTS)
    turned = np.trapezoid(speed, axis=1) * np.diff(t) / (POINTS - 1)
    assert (turned <= 1.2 * angle + 1e-7).all()
    assert turned.sum() <= 1.2 * angle.sum() + 1e-7


@given(seed=st.integers(0, 10**6), tilt=st.floats(0, 60))
@settings(max_examples=20)
def test_yaw_legs_tilt_at_most_by_half_more_than_asked(seed, tilt):
    """Legs about the vertical between poses of one tilt, among legs about other axes."""
    rng = np.random.default_rng(seed)
    tilted = Rotation.from_rotvec(np.deg2rad(tilt) * np.array([1.0, 0, 0]))
    yaws = np.cumsum(rng.uniform(-170, 170, 6))
    R = [Rotation.from_euler("z", yaw, degrees=True) * tilted for yaw in yaws]
    R = [Rotation.from_rotvec(rng.normal(size=3)), *R, Rotation.from_rotvec(rng.normal(size=3))]
    t = np.concatenate([[0], np.cumsum(np.exp(rng.uniform(-2, 2, len(R) - 1)))])
    d = along(path_of(t, np.array([r.as_matrix() for r in R])), jnp.asarray(within_legs(t)))
    vertical = np.asarray(d.R)[:, :, 2].reshape(len(R) - 1, POINTS, 3)[1:-1]
    angle = np.rad2deg(np.arctan2(np.hypot(vertical[..., 0], vertical[..., 1]), vertical[..., 2]))
    assert angle.max() <= 1.5 * tilt + 1e-6


def test_two_turns_in_eight_legs_never_turn_back():
    t, yaw = 4.0 * np.arange(9), 90.0 * np.arange(9)
    d = along(path_of(t, Rotation.from_euler("z", yaw[:, None], degrees=True).as_matrix()), jnp.asarray(within_legs(t)))
    rate = np.asarray(d.omega).reshape(8, POINTS, 3)
    assert rate[..., 2].min() >= -1e-9
    np.testing.assert_allclose(rate[..., :2], 0, atol=1e-9)
    np.testing.assert_allclose(rate[1:-1, :, 2], np.pi / 8, atol=1e-9)  # constant except for start and stop
    turned = np.rad2deg(np.trapezoid(rate[..., 2], axis=1) * 4 / (POINTS - 1))
    np.testing.assert_allclose(turned, 90, atol=1e-3)


def test_a_turn_with_constant_roll_keeps_its_tilt():
    t, yaw = 4.0 * np.arange(9), 45.0 * np.arange(9)
    R = Rotation.from_euler("ZYX", np.column_stack([yaw, np.zeros(9), np.full(9, 5.0)]), degrees=True).as_matrix()
    d = along(path_of(t, R), jnp.asarray(within_legs(t)))
    np.testing.assert_allclose(np.asarray(d.R)[:, 2, 2], np.cos(np.deg2rad(5)), atol=1e-12)


@pytest.mark.parametrize("seed", [3, 5, 7, 11])
def test_rates_are_those_of_the_attitude_and_continuous(seed):
    """`R' = R hat(omega)` and `omega' = omega_dot` by differences of order 4, also across the knots."""
    t, R, _ = sequence(seed)
    path, h = path_of(t, R), 1e-4
    times = np.concatenate([within_legs(t)[7::43], t[1:-1]])
    times = times[(times > 3 * h) & (times < t[-1] - 3 * h)]
    near = {k: along(path, jnp.asarray(times + k * h)) for k in (-2, -1, 0, 1, 2)}
    turns = {
        k: (Rotation.from_matrix(near[0].R).inv() * Rotation.from_matrix(d.R)).as_rotvec() for k, d in near.items()
    }
    rate = (turns[-2] - 8 * turns[-1] + 8 * turns[1] - turns[2]) / (12 * h)
    omega = {k: np.asarray(d.omega) for k, d in near.items()}
    omega_dot = (omega[-2] - 8 * omega[-1] + 8 * omega[1] - omega[2]) / (12 * h)
    np.testing.assert_allclose(near[0].omega, rate, atol=1e-6 * max(1.0, np.abs(rate).max()))
    np.testing.assert_allclose(near[0].omega_dot, omega_dot, atol=1e-4 * max(1.0, np.abs(omega_dot).max()))


@given(seed=st.integers(0, 10**6))
@settings(max_examples=20)
def test_a_leg_has_the_rates_that_are_given(seed):
    """The derivatives at the end of a leg follow from the inverse of the right Jacobian: compared with JAX."""
    rng = np.random.default_rng(seed)
    R = Rotation.from_rotvec(rng.normal(size=(3, 3))).as_matrix()
    t, rates = np.array([0.0, 0.7, 1.9]), rng.normal(size=(3, 3, 3))
    legs = rotation_legs.rotation_legs(t, R, rates)
    knots = [0, 1, 1, 2]
    times = jnp.asarray(t[knots] + 1e-12 * np.array([1, -1, 1, -1]))  # from both sides of the inner knot
    path = pose_spline.PoseSpline(position=legs.phi, attitude=legs)
    d = along(path, times)
    np.testing.assert_allclose(d.R, R[knots], atol=1e-9)
    np.testing.assert_allclose(d.omega, rates[knots, 0], atol=1e-8)
    np.testing.assert_allclose(d.omega_dot, rates[knots, 1], atol=1e-8)
    np.testing.assert_allclose(third(path, times), rates[knots, 2], atol=1e-6)


def test_a_direction_can_be_given_for_a_half_turn():
    R = Rotation.from_euler("z", [[0], [180], [360]], degrees=True).as_matrix()
    t = np.array([0.0, 4.0, 8.0])
    for sign in (-1, 1):
        delta = np.array([[0, 0, sign * np.pi]] * 2)
        d = along(minimum_snap.minimum_snap(t, np.zeros((3, 3)), R, delta), jnp.asarray([2.0, 6.0]))
        assert (np.sign(np.asarray(d.omega)[:, 2]) == sign).all()
