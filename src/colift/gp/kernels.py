"""Kernels of scaled distances: how alike a function's values at two points are."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import pytree


class Kernel:
    """The correlation of a function's values at two points by `r2`, the square of their distance in length-scales.

    It must be 1 at zero and positive definite in every dimension: completely monotone in `r2` (Schoenberg 1938). A
    kernel of one's own is a `pytree` with a `__call__` of its own, and may have parameters, which are not learned.
    """

    def __call__(self, r2: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Of squares of any shape, elementwise; not below zero."""
        raise NotImplementedError

    def numpy_value_and_slope(self, r2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Its values, and `-2` times its slope, which a fit needs, on the host; r2 may be overwritten."""
        values, slopes = _with_slope(self, jnp.asarray(r2.ravel()))
        # a root has no slope at zero, where a fit multiplies it by zero
        slopes = np.where(r2.ravel() == 0, 0.0, np.asarray(slopes))
        return np.asarray(values).reshape(r2.shape), slopes.reshape(r2.shape)


@jax.jit
def _with_slope(kernel: Kernel, r2: Float[Array, " squares"]) -> tuple[Array, Array]:
    values, slopes = jax.vmap(jax.value_and_grad(kernel))(r2)
    return values, -2 * slopes


@pytree
class SquaredExponential(Kernel):
    """`exp(-r2 / 2)`, the kernel of the paper and the default."""

    def __call__(self, r2: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Of squares of any shape."""
        return jnp.exp(-0.5 * r2)

    def numpy_value_and_slope(self, r2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Both are the same; written over r2."""
        np.multiply(r2, -0.5, out=r2)
        return np.exp(r2, out=r2), r2


DEFAULT_KERNEL = SquaredExponential()
