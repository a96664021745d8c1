"""Tests of rotations: group axioms, comparison with SciPy, derivatives against finite differences."""

from __future__ import annotations

import functools
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.linalg
from scipy.spatial.transform import Rotation

from colift.math import so3

ANGLES = (0.0, 1e-12, 1e-7, 1e-3, 0.00999, 0.01001, 0.5, 2.0, 3.0, np.pi - 1e-4, np.pi - 1e-8)


def directions(count: int, seed: int = 0) -> np.ndarray:
    axis = np.random.default_rng(seed).normal(size=(count, 3))
    axis[:3] = np.eye(3)  # along an axis two entries of the quaternion vanish
    return axis / np.linalg.norm(axis, axis=1, keepdims=True)


def vectors() -> np.ndarray:
    """Rotation vectors over all directions and the angles at which formulas change."""
    return np.concatenate([angle * directions(20, seed) for seed, angle in enumerate(ANGLES)])


exp, log = jax.jit(so3.exp), jax.jit(so3.log)
THETA = jnp.array(vectors())
R = exp(THETA)


def test_exp_is_the_matrix_exponential() -> None:
    expected = [scipy.linalg.expm(np.asarray(K)) for K in so3.hat(THETA)]
    np.testing.assert_allclose(R, expected, atol=2e-15)


def test_exp_gives_rotations() -> None:
    np.testing.assert_allclose(R @ jnp.swapaxes(R, 1, 2), so3.identity((len(R),)), atol=2e-15)
    np.testing.assert_allclose(np.linalg.det(np.asarray(R)), 1, atol=2e-15)
    np.testing.assert_allclose(exp(-THETA), jnp.swapaxes(R, 1, 2), atol=2e-15)


def test_one_parameter_subgroups() -> None:
    s, t = 0.3, 0.45
    np.testing.assert_allclose(exp(s * THETA) @ exp(t * THETA), exp((s + t) * THETA), atol=5e-15)


def test_from_axis_angle_is_exp_of_a_unit_axis() -> None:
    axis = directions(20)
    for angle in (-5.0, 0.0, 1e-9, 0.3, np.pi):
        about = jax.jit(so3.from_axis_angle)(jnp.array(axis), jnp.full(20, angle))
        np.testing.assert_allclose(about, Rotation.from_rotvec(angle * axis).as_matrix(), atol=2e-15)


def test_log_inverts_exp() -> None:
    # at pi - d the matrix fixes the axis to eps but not its sign beyond d
    np.testing.assert_allclose(log(R), THETA, atol=2e-15, rtol=1e-14)


def test_exp_inverts_log_on_random_rotations() -> None:
    random = Rotation.random(200, random_state=1).as_matrix()
    back = jax.jit(lambda A: so3.exp(so3.log(A)))(jnp.array(random))
    np.testing.assert_allclose(back, random, atol=3e-15)


def test_log_at_angle_pi() -> None:
    axis = directions(20)
    half = jnp.array(2 * axis[:, :, None] * axis[:, None, :] - np.eye(3))
    theta = np.asarray(log(half))
    np.testing.assert_allclose(np.linalg.norm(theta, axis=1), np.pi, atol=1e-14)
    np.testing.assert_allclose(np.abs((theta * axis).sum(1)), np.pi, atol=1e-14)


def test_quaternion_equals_scipy() -> None:
    random = Rotation.random(200, random_state=2)
    expected = random.as_quat(scalar_first=True, canonical=True)
    np.testing.assert_allclose(jax.jit(so3.quaternion)(jnp.array(random.as_matrix())), expected, atol=1e-15)


def test_hat_and_vee() -> None:
    a, b = jnp.array(np.random.default_rng(3).normal(size=(2, 50, 3)))
    np.testing.assert_array_equal(so3.vee(so3.hat(a)), a)
    with jax.disable_jit():  # a compiler may fuse a product with the difference
        np.testing.assert_array_equal(so3.cross(a, b), np.cross(a, b))
    np.testing.assert_allclose(so3.cross(a, b), np.cross(a, b), atol=1e-15)
    np.testing.assert_allclose((so3.hat(a) @ b[:, :, None])[:, :, 0], np.cross(a, b), atol=1e-15)
    turned = jnp.array(Rotation.random(50, random_state=4).as_matrix())
    np.testing.assert_allclose(
        turned @ so3.hat(a) @ jnp.swapaxes(turned, 1, 2), so3.hat((turned @ a[:, :, None])[:, :, 0]), atol=1e-14
    )


def test_functions_broadcast_over_leading_axes() -> None:
    theta = jnp.array(np.random.default_rng(5).normal(size=(2, 1, 4, 3)))
    assert exp(theta).shape == (2, 1, 4, 3, 3)
    assert log(exp(theta)).shape == theta.shape
    np.testing.assert_allclose(exp(theta)[1, 0, 2], exp(theta[1, 0, 2]), atol=1e-15)
    assert so3.cross(theta, jnp.ones((1, 5, 1, 3))).shape == (2, 5, 4, 3)


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_derivative_of_exp(mode: Callable) -> None:
    step = 1e-5
    jacobian = jax.jit(jax.vmap(mode(so3.exp)))(THETA)
    offset = step * jnp.eye(3)
    ahead, behind = (exp(THETA[:, None] + sign * offset[None]) for sign in (1, -1))
    central = jnp.moveaxis((ahead - behind) / (2 * step), 1, -1)
    np.testing.assert_allclose(jacobian, central, atol=3e-10)


@pytest.mark.parametrize("mode", [jax.jacfwd, jax.jacrev])
def test_derivative_of_log(mode: Callable) -> None:
    """Along the group; log is smooth below pi, and its differential at pi is that of its inverse."""
    step = 1e-6
    near_half_turn = np.linalg.norm(THETA, axis=1) > np.pi - 1e-3
    at, theta = R[~near_half_turn], np.asarray(THETA)[~near_half_turn]

    def moved(d: jax.Array, A: jax.Array) -> jax.Array:
        return so3.log(A @ so3.exp(d))

    jacobian = jax.jit(jax.vmap(functools.partial(mode(moved), jnp.zeros(3))))(at)
    offset = exp(step * jnp.concatenate([jnp.eye(3), -jnp.eye(3)]))
    ends = log(at[:, None] @ offset[None])
    central = jnp.swapaxes((ends[:, :3] - ends[:, 3:]) / (2 * step), 1, 2)
    np.testing.assert_allclose(jacobian, central, atol=2e-8)
    left = np.einsum("nij,nj->ni", np.asarray(jacobian), theta)  # a rotation about the same axis adds to the angle
    np.testing.assert_allclose(left, theta, atol=1e-12)


def test_second_derivative_of_exp_is_finite_at_zero() -> None:
    hessian = jax.jit(jax.jacfwd(jax.jacrev(so3.exp)))(jnp.zeros(3))
    generators = np.asarray(so3.hat(jnp.eye(3)))
    expected = (
        np.einsum("aij,bjk->ikab", generators, generators) + np.einsum("bij,ajk->ikab", generators, generators)
    ) / 2
    np.testing.assert_allclose(hessian, expected, atol=1e-15)


def test_orthonormalize_squares_the_error() -> None:
    for error in (1e-3, 1e-5):
        bent = R + error * jnp.array(np.random.default_rng(6).normal(size=R.shape))
        U, _, Vt = np.linalg.svd(np.asarray(bent))
        assert np.abs(so3.orthonormalize(bent) - U @ Vt).max() < 50 * error**2


def attitudes() -> tuple[jax.Array, ...]:
    A, B = (jnp.array(Rotation.random(40, random_state=k).as_matrix()) for k in (7, 8))
    omega, omega_d = jnp.array(np.random.default_rng(9).normal(size=(2, 40, 3)))
    return A, omega, B, omega_d


def test_error_kinematics() -> None:
    """`d/dt e_R = E e_omega` and `d/dt Psi = e_R . e_omega`, from the motion of both rotations (Eq. pl_cl_eR)."""
    A, omega, B, omega_d = attitudes()

    def at(t: jax.Array) -> tuple[jax.Array, jax.Array]:
        a, b = A @ so3.exp(t * omega), B @ so3.exp(t * omega_d)
        return so3.e_R(a, b), so3.attitude_error_function(a, b)

    (e_R, _), (e_R_dot, Psi_dot) = jax.jit(functools.partial(jax.jvp, at))((jnp.zeros(()),), (jnp.ones(()),))
    e_omega = jax.jit(so3.e_omega)(A, omega, B, omega_d)
    np.testing.assert_allclose(e_R_dot, (so3.attitude_error_jacobian(A, B) @ e_omega[:, :, None])[:, :, 0], atol=1e-14)
    np.testing.assert_allclose(Psi_dot, (e_R * e_omega).sum(1), atol=1e-14)


def test_attitude_error_function() -> None:
    """`Psi = 1 - cos(angle)` and `|e_R| = sin(angle)` of the relative rotation."""
    A, _, B, _ = attitudes()
    angle = (Rotation.from_matrix(B).inv() * Rotation.from_matrix(A)).magnitude()
    np.testing.assert_allclose(so3.attitude_error_function(A, B), 1 - np.cos(angle), atol=1e-14)
    np.testing.assert_allclose(np.linalg.norm(so3.e_R(A, B), axis=1), np.sin(angle), atol=1e-14)
