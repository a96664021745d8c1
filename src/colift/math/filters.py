"""First- and second-order low-pass filters in discrete time, one sample per call.

A first-order filter is `y + b (x - y)` with the smoothing factor b. The second-order filter is critically damped: two
equal first-order stages in series.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree

Scalar = Float[Array, ""]


@pytree
class SecondOrderLowPassState:
    """State of a critically damped second-order low-pass filter, in the unit of its input."""

    stage1: Float[Array, "*shape"]  # output of the first stage
    stage2: Float[Array, "*shape"]  # output of the second stage and of the filter


def steady_state(x: Float[Array, "*shape"]) -> SecondOrderLowPassState:
    """Return the steady state of the second-order filter for a constant input.

    Args:
        x: Input.
    """
    return SecondOrderLowPassState(stage1=x, stage2=x)


def smoothing_factor(hertz: Float[Array, "*corners"], dt: Scalar) -> Float[Array, "*corners"]:
    """Compute the smoothing factor `1 - exp(-2 pi hertz dt)` of a first-order low-pass filter.

    Args:
        hertz: Corner frequency [Hz].
        dt: Sample period [s].

    Returns:
        Share of the difference between input and output that one sample adds to the output, in [0, 1].
    """
    return -jnp.expm1(-2 * jnp.pi * hertz * dt)


def initial_smoothing_factor(initialized: Scalar, b: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Return the smoothing factor b, or 1 for the first sample, so that a filter starts at its first sample.

    Args:
        initialized: 0 for the first sample, 1 afterwards.
        b: Smoothing factor.
    """
    return 1 + initialized * (b - 1)


def irregular_smoothing_factor(b: Scalar, ticks: Float[Array, "*shape"]) -> Float[Array, "*shape"]:
    """Compute the smoothing factor for a sample n periods after the previous one.

    `b_n^2 / (1 - b_n) = n b^2 / (1 - b)`: the steady-state Kalman gain for a random walk sampled every n periods. The
    factor b itself would make the filter n times too slow, and `1 - (1 - b)^n` would pass the noise of a rare sample.

    Args:
        b: Smoothing factor for consecutive samples.
        ticks: Number of periods n since the previous sample.

    Returns:
        Smoothing factor `b_n`, equal to b for n = 1.
    """
    return 2 / (1 + jnp.sqrt(1 + 4 * (1 - b) / (ticks * b * b)))


def update(state: SecondOrderLowPassState, x: Float[Array, "*shape"], b: Scalar) -> SecondOrderLowPassState:
    """Advance the second-order filter by one sample.

    Args:
        state: State after the previous sample.
        x: Input.
        b: Smoothing factor of each stage.

    Returns:
        Next state; its `stage2` is the output.
    """
    stage1 = state.stage1 + b * (x - state.stage1)
    return SecondOrderLowPassState(stage1=stage1, stage2=state.stage2 + b * (stage1 - state.stage2))
