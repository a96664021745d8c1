"""Kernels: correlation of function values at two points, as a function of their scaled distance."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import pytree


class Kernel:
    """Base class of a stationary correlation function of `r2`, the squared distance in length-scales.

    A kernel must be 1 at zero and positive definite in every dimension, that is, completely monotone in `r2`
    (Schoenberg 1938). A custom kernel is a `pytree` that overrides `__call__`. Its parameters are not fitted.
    """

    def __call__(self, r2: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Evaluate the kernel elementwise.

        Args:
            r2: Squared scaled distances, not negative.

        Returns:
            Correlations.

        Raises:
            NotImplementedError: If a subclass does not override this method.
        """
        raise NotImplementedError

    def numpy_value_and_slope(self, r2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate the kernel and `-2` times its derivative on the host, for fits.

        Args:
            r2: Squared scaled distances; may be overwritten.

        Returns:
            Correlations, and `-2` times their derivative with respect to `r2`.
        """
        values, slopes = _values_and_slopes(self, jnp.asarray(r2.ravel()))
        # a square root has no derivative at zero; a fit multiplies the slope by zero there
        slopes = np.where(r2.ravel() == 0, 0.0, np.asarray(slopes))
        return np.asarray(values).reshape(r2.shape), slopes.reshape(r2.shape)


@jax.jit
def _values_and_slopes(kernel: Kernel, r2: Float[Array, " squares"]) -> tuple[Array, Array]:
    """Evaluate a kernel and `-2` times its derivative."""
    values, slopes = jax.vmap(jax.value_and_grad(kernel))(r2)
    return values, -2 * slopes


@pytree
class SquaredExponential(Kernel):
    """Squared exponential kernel `exp(-r2 / 2)`, used in the paper and by default."""

    def __call__(self, r2: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
        """Evaluate the kernel elementwise."""
        return jnp.exp(-0.5 * r2)

    def numpy_value_and_slope(self, r2: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Evaluate the kernel in the memory of `r2`; value and `-2` times the derivative are the same array."""
        np.multiply(r2, -0.5, out=r2)
        return np.exp(r2, out=r2), r2


DEFAULT_KERNEL = SquaredExponential()
