"""First- and second-order low-pass filters, sample by sample."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree

Scalar = Float[Array, ""]


@pytree
class LowPass:
    """Memory of a critically damped second-order low-pass: two equal first-order ones in a row."""

    inner: Float[Array, "*shape"]
    outer: Float[Array, "*shape"]


def settle(x: Float[Array, "*shape"]) -> LowPass:
    """The memory of a filter that has seen x for ever."""
    return LowPass(inner=x, outer=x)


def blend(hertz: Float[Array, "*corners"], dt: Scalar) -> Float[Array, "*corners"]:
    """What a first-order low-pass takes of a new sample: `1 - exp(-2 pi hertz dt)`."""
    return -jnp.expm1(-2 * jnp.pi * hertz * dt)


def from_the_first(warm: Scalar, b: Scalar) -> Scalar:
    """The blend b where warm is 1, or 1 on the first tick, where it is 0: a filter starts at its first sample."""
    return 1 + warm * (b - 1)


def after(b: Scalar, ticks: Scalar) -> Scalar:
    """The blend for a sample n ticks after the one before, b if n is 1: `b_n^2 / (1 - b_n) = n b^2 / (1 - b)`.

    A Kalman filter's steady gain for a random walk that is sampled every n ticks: a filter that counted samples would
    be n times too slow, one that counted time would take all the noise of a rare sample.
    """
    return 2 / (1 + jnp.sqrt(1 + 4 * (1 - b) / (ticks * b * b)))


def smooth(memory: LowPass, x: Float[Array, "*shape"], b: Scalar) -> LowPass:
    """One sample through the low-pass, with the blend b of each of its halves; the value is `outer`."""
    inner = memory.inner + b * (x - memory.inner)
    return LowPass(inner=inner, outer=memory.outer + b * (inner - memory.outer))
