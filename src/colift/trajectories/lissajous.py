"""Where the payload should be: a smooth pose with the derivatives that the controllers feed forward."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.trajectories.base import PayloadSetpoint, differentiate_pose, smooth_step

Scalar = Float[Array, ""]


@pytree
class Lissajous:
    """`p_d = center + ramp(t) amplitude sin(2 pi t / period + phase)`, axis by axis, and the same of the attitude.

    `R_d = R exp(ramp(t) swing sin(2 pi t / swing_period + swing_phase))`: with a swing of zero it is constant. `ramp`
    rises from 0 to 1 in `ramp_s` with three vanishing derivatives at both ends, so the payload starts at rest.
    """

    center: Float[Array, "3"]  # m
    amplitude: Float[Array, "3"]  # m
    period: Float[Array, "3"]  # s
    phase: Float[Array, "3"]  # rad
    ramp_time: Float[Array, ""]  # s
    R: Float[Array, "3 3"]  # attitude about which it swings, payload to world
    rotation_amplitude: Float[Array, "3"]  # rad, rotation vector in the frame of R
    rotation_period: Float[Array, "3"]  # s
    rotation_phase: Float[Array, "3"]  # rad

    def evaluate(self, t: Scalar) -> PayloadSetpoint:
        """The setpoint at time t, s; derivatives are exact (nested forward differentiation)."""
        return differentiate_pose(self.pose, self.R, t)

    def pose(self, t: Scalar) -> Float[Array, "6"]:
        """Position, m, and rotation vector off R, rad, at time t, s."""
        on = smooth_step(t / self.ramp_time)
        wave = jnp.sin(2 * jnp.pi * t / self.period + self.phase)
        turn = jnp.sin(2 * jnp.pi * t / self.rotation_period + self.rotation_phase)
        return jnp.concatenate([self.center + on * self.amplitude * wave, on * self.rotation_amplitude * turn])
