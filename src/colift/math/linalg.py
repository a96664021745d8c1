"""Matrix products and symmetric positive definite systems of small fixed sizes.

The matrices of an aerial manipulator are about 6 x 6. At this size a call of a general routine costs more than its
arithmetic, and sums of products can be fused with other operations. Leading axes are batch axes. A matrix that is not
positive definite gives NaN; the status of the run reports it.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float


@jax.jit
def matmul(A: Float[Array, "*#batch n k"], B: Float[Array, "*#batch k m"]) -> Float[Array, "*#batch n m"]:
    """Compute the products `A B`; leading axes are broadcast."""
    return (A[..., :, :, None] * B[..., None, :, :]).sum(-2)


@jax.jit
def matvec(A: Float[Array, "*#batch n k"], x: Float[Array, "*#batch k"]) -> Float[Array, "*#batch n"]:
    """Compute the products `A x`; leading axes are broadcast."""
    return (A * x[..., None, :]).sum(-1)


def transpose(A: Float[Array, "*batch n m"]) -> Float[Array, "*batch m n"]:
    """Return `A^T` of every matrix."""
    return jnp.swapaxes(A, -1, -2)


@jax.jit
def udu_eliminate(
    A: Float[Array, "*batch n n"], B: Float[Array, "*batch n m"]
) -> tuple[Float[Array, "*batch n n"], Float[Array, "*batch n"], Float[Array, "*batch n m"]]:
    """Factorize `A = U^T diag(1/d) U` and reduce a right-hand side to `Y = U^-T B` (square-root-free Cholesky).

    With the result `B^T A^-1 B = Y^T diag(d) Y`. The factorization needs one division per row, the most expensive
    operation.

    Args:
        A: Symmetric positive definite matrices; the lower triangles are not read.
        B: Right-hand sides.

    Returns:
        U, unit upper triangular; the inverse pivots d; and Y.
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
    """Solve `U^T X = B` by forward substitution.

    Args:
        U: Unit upper triangular matrices.
        B: Right-hand sides.

    Returns:
        `U^-T B`.
    """
    rows = []
    rest = B
    for k in range(U.shape[-1]):
        rows.append(rest[..., 0, :])
        rest = rest[..., 1:, :] - U[..., k, k + 1 :, None] * rows[-1][..., None, :]
    return jnp.stack(rows, axis=-2)


@jax.jit
def backward(U: Float[Array, "*batch n n"], B: Float[Array, "*batch n m"]) -> Float[Array, "*batch n m"]:
    """Solve `U X = B` by backward substitution.

    Args:
        U: Unit upper triangular matrices.
        B: Right-hand sides.

    Returns:
        `U^-1 B`.
    """
    rows = []
    rest = B
    for k in reversed(range(U.shape[-1])):
        rows.append(rest[..., k, :])
        rest = rest[..., :k, :] - U[..., :k, k, None] * rows[-1][..., None, :]
    return jnp.stack(rows[::-1], axis=-2)


@jax.jit
def solve(A: Float[Array, "*batch n n"], B: Float[Array, "*batch n m"]) -> Float[Array, "*batch n m"]:
    """Solve `A X = B`.

    Args:
        A: Symmetric positive definite matrices; the lower triangles are not read.
        B: Right-hand sides.

    Returns:
        `A^-1 B`; NaN where A is not positive definite.
    """
    U, d, Y = udu_eliminate(A, B)
    return backward(U, d[..., None] * Y)
