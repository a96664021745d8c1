"""Tests of small dense linear systems against LAPACK."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.math import linalg

solve = jax.jit(linalg.solve)


def spd(rng: np.random.Generator, n: int, condition: float, batch: int = 20) -> np.ndarray:
    """Symmetric positive definite matrices of a given condition number."""
    Q, _ = np.linalg.qr(rng.normal(size=(batch, n, n)))
    return np.einsum("bij,j,bkj->bik", Q, np.geomspace(1, 1 / condition, n), Q)


@pytest.mark.parametrize("n", [1, 3, 6, 9])
@pytest.mark.parametrize("condition", [1.0, 1e4, 1e10])
def test_solve(n: int, condition: float) -> None:
    rng = np.random.default_rng(n)
    A, x = spd(rng, n, condition), rng.normal(size=(20, n, 2))
    solution = solve(jnp.array(A), jnp.array(A @ x))
    np.testing.assert_allclose(solution, x, atol=1e-14 * max(condition, 10))


def test_udu_eliminate_equals_cholesky() -> None:
    rng = np.random.default_rng(0)
    A, B = spd(rng, 6, 100), rng.normal(size=(20, 6, 4))
    U, d, Y = jax.jit(linalg.udu_eliminate)(jnp.array(A), jnp.array(B))
    L = np.linalg.cholesky(A)
    root = np.sqrt(np.asarray(d))[..., None]  # U / root = L^T
    np.testing.assert_array_equal(U, np.triu(U))
    np.testing.assert_array_equal(np.diagonal(U, axis1=1, axis2=2), 1)
    np.testing.assert_allclose(U / root, np.swapaxes(L, 1, 2), atol=1e-14)
    np.testing.assert_allclose(root * Y, np.linalg.solve(L, B), atol=1e-12)
    np.testing.assert_allclose(jax.jit(linalg.forward)(U, jnp.array(B)), Y, atol=1e-13)
    np.testing.assert_allclose(jax.jit(linalg.backward)(U, d[..., None] * Y), np.linalg.solve(A, B), atol=1e-11)


def test_products_broadcast() -> None:
    rng = np.random.default_rng(1)
    A, B, x = rng.normal(size=(4, 1, 3, 5)), rng.normal(size=(1, 2, 5, 2)), rng.normal(size=(4, 2, 5))
    np.testing.assert_allclose(linalg.matmul(jnp.array(A), jnp.array(B)), A @ B, atol=1e-14)
    np.testing.assert_allclose(linalg.matvec(jnp.array(A), jnp.array(x)), (A @ x[..., None])[..., 0], atol=1e-14)
    np.testing.assert_array_equal(linalg.transpose(jnp.array(A)), np.swapaxes(A, -1, -2))


def test_indefinite_matrix_gives_nan() -> None:
    assert np.isnan(solve(jnp.diag(jnp.array([1.0, -1.0])), jnp.ones((2, 1)))).any()


def test_gradient_of_solve() -> None:
    rng = np.random.default_rng(2)
    A, b, w = spd(rng, 5, 50, 1)[0], rng.normal(size=(5, 1)), rng.normal(size=(5, 1))
    symmetric = lambda A: (w * linalg.solve((A + A.T) / 2, jnp.array(b))).sum()  # noqa: E731
    gradient = jax.jit(jax.grad(symmetric))(jnp.array(A))
    x, y = np.linalg.solve(A, b), np.linalg.solve(A, w)
    np.testing.assert_allclose(gradient, -(y @ x.T + x @ y.T) / 2, atol=1e-10)
