"""First- and second-order low-pass filters, sample by sample."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree

Scalar = Float[Array, ""]


@pytree
class SecondOrderLowPassState:
    """Memory of a critically damped second-order low-pass: two equal first-order ones in a row."""

    stage1: Float[Array, "*shape"]
    stage2: Float[Array, "*shape"]


def steady_state(x: Float[Array, "*shape"]) -> SecondOrderLowPassState:
    """The memory of a filter that has seen x for ever."""
    return SecondOrderLowPassState(stage1=x, stage2=x)


def smoothing_factor(hertz: Float[Array, "*corners"], dt: Scalar) -> Float[Array, "*corners"]:
    """What a first-order low-pass takes of a new sample: `1 - exp(-2 pi hertz dt)`."""
    return -jnp.expm1(-2 * jnp.pi * hertz * dt)


def initial_smoothing_factor(initialized: Scalar, b: Scalar) -> Scalar:
    """The blend b where warm is 1, or 1 on the first tick, where it is 0: a filter starts at its first sample."""
    return 1 + initialized * (b - 1)


def irregular_smoothing_factor(b: Scalar, ticks: Scalar) -> Scalar:
    """The blend for a sample n ticks after the one before, b if n is 1: `b_n^2 / (1 - b_n) = n b^2 / (1 - b)`.

    A Kalman filter's steady gain for a random walk that is sampled every n ticks: a filter that counted samples would
    be n times too slow, one that counted time would take all the noise of a rare sample.
    """
    return 2 / (1 + jnp.sqrt(1 + 4 * (1 - b) / (ticks * b * b)))


def update(state: SecondOrderLowPassState, x: Float[Array, "*shape"], b: Scalar) -> SecondOrderLowPassState:
    """One sample through the low-pass, with the blend b of each of its halves; the value is `outer`."""
    inner = state.stage1 + b * (x - state.stage1)
    return SecondOrderLowPassState(stage1=inner, stage2=state.stage2 + b * (inner - state.stage2))
