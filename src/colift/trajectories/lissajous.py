"""Sinusoidal reference trajectory in position and attitude."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.trajectories.base import PayloadSetpoint, differentiate_pose, smooth_step

Scalar = Float[Array, ""]


@pytree
class Lissajous:
    """Lissajous curve in position, and an oscillation of the attitude.

    By axis `p_d = center + ramp(t) amplitude sin(2 pi t / period + phase)`. The attitude is
    `R_d = R exp(ramp(t) rotation_amplitude sin(2 pi t / rotation_period + rotation_phase))`. `ramp` is a smooth step of
    duration `ramp_time` with three derivatives of zero at both ends, so the payload starts at rest.
    """

    center: Float[Array, "3"]  # m, world
    amplitude: Float[Array, "3"]  # m, world
    period: Float[Array, "3"]  # s, by axis
    phase: Float[Array, "3"]  # rad, by axis
    ramp_time: Float[Array, ""]  # s, duration of the rise of both amplitudes
    R: Float[Array, "3 3"]  # mean attitude, payload to world
    rotation_amplitude: Float[Array, "3"]  # rad, rotation vector in the frame of R; zero for a constant attitude
    rotation_period: Float[Array, "3"]  # s, by component of the rotation vector
    rotation_phase: Float[Array, "3"]  # rad, by component of the rotation vector

    def evaluate(self, t: Scalar) -> PayloadSetpoint:
        """Compute the setpoint at time t [s]; see `ReferenceTrajectory`."""
        return differentiate_pose(self.pose, self.R, t)

    def pose(self, t: Scalar) -> Float[Array, "6"]:
        """Compute the pose without derivatives.

        Args:
            t: Time [s].

        Returns:
            Position [m, world] and rotation vector relative to R [rad, frame of R].
        """
        ramp = smooth_step(t / self.ramp_time)
        wave = jnp.sin(2 * jnp.pi * t / self.period + self.phase)
        rotation = jnp.sin(2 * jnp.pi * t / self.rotation_period + self.rotation_phase)
        return jnp.concatenate([self.center + ramp * self.amplitude * wave, ramp * self.rotation_amplitude * rotation])
