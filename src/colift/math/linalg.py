"""Products and symmetric positive definite systems of small fixed sizes, without a library call.

A multirotor's matrices are 6 x 6: at that size a call into a general routine costs more than the arithmetic, and
sums of products fuse with what surrounds them. Leading axes are batch. A matrix that is not positive definite
gives NaN, which the run's status reports.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


@jax.jit
def matmul(A: Float[Array, "*#batch n k"], B: Float[Array, "*#batch k m"]) -> Float[Array, "*#batch n m"]:
    """`A B`, broadcasting the leading axes."""
    return (A[..., :, :, None] * B[..., None, :, :]).sum(-2)


@jax.jit
def matvec(A: Float[Array, "*#batch n k"], x: Float[Array, "*#batch k"]) -> Float[Array, "*#batch n"]:
    """`A x`, broadcasting the leading axes."""
    return (A * x[..., None, :]).sum(-1)


def transpose(A: Float[Array, "*batch n m"]) -> Float[Array, "*batch m n"]:
    """`A^T` of every matrix."""
    return jnp.swapaxes(A, -1, -2)


@jax.jit
def udu_eliminate(
    A: Float[Array, "*batch n n"], B: Float[Array, "*batch n m"]
) -> tuple[Float[Array, "*batch n n"], Float[Array, "*batch n"], Float[Array, "*batch n m"]]:
    """`(U, d, U^-T B)` with U unit upper triangular and `A = U^T diag(1/d) U`, row by row; A's lower part is not read.

    Cholesky without roots: one division a row, which is what costs. `B^T A^-1 B = Y^T diag(d) Y` for `Y = U^-T B`.
    """
    n = A.shape[-1]
    rest = jnp.concatenate([A, B], axis=-1)
    rows, d = [], []
    for k in range(n):
        row = rest[..., 0, :]
        d.append(1 / jnp.where(row[..., :1] > 0, row[..., :1], jnp.nan))
        unit = row[..., 1 : n - k] * d[-1]
        before = [jnp.zeros((*A.shape[:-2], k)), jnp.ones((*A.shape[:-2], 1))]
        rows.append(jnp.concatenate([*before, unit, row[..., n - k :]], axis=-1))
        rest = rest[..., 1:, 1:] - unit[..., None] * row[..., None, 1:]
    reduced = jnp.stack(rows, axis=-2)
    return reduced[..., :n], jnp.concatenate(d, axis=-1), reduced[..., n:]


@jax.jit
def forward(U: Float[Array, "*batch n n"], B: Float[Array, "*batch n m"]) -> Float[Array, "*batch n m"]:
    """`U^-T B` for unit upper triangular U."""
    rows = []
    rest = B
    for k in range(U.shape[-1]):
        rows.append(rest[..., 0, :])
        rest = rest[..., 1:, :] - U[..., k, k + 1 :, None] * rows[-1][..., None, :]
    return jnp.stack(rows, axis=-2)


@jax.jit
def backward(U: Float[Array, "*batch n n"], B: Float[Array, "*batch n m"]) -> Float[Array, "*batch n m"]:
    """`U^-1 B` for unit upper triangular U."""
    rows = []
    rest = B
    for k in reversed(range(U.shape[-1])):
        rows.append(rest[..., k, :])
        rest = rest[..., :k, :] - U[..., :k, k, None] * rows[-1][..., None, :]
    return jnp.stack(rows[::-1], axis=-2)


@jax.jit
def solve(A: Float[Array, "*batch n n"], B: Float[Array, "*batch n m"]) -> Float[Array, "*batch n m"]:
    """`A^-1 B` for symmetric positive definite A."""
    U, d, Y = udu_eliminate(A, B)
    return backward(U, d[..., None] * Y)
