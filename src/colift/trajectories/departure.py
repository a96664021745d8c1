"""Where the payload should be: a smooth pose with the derivatives that the controllers feed forward."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.trajectories.base import PayloadSetpoint, differentiate_pose, smooth_step
from colift.trajectories.lissajous import Lissajous

Scalar = Float[Array, ""]


@pytree
class PathDeparture:
    """Another path that moves off by `shift` from `start` on, and turns as it had not: `swing sin(2 pi s / period)`.

    s is the time since `swing_start`; both rise within `over`.
    """

    base: Lissajous
    offset: Float[Array, "3"]  # m
    start: Float[Array, ""]  # s
    ramp_time: Float[Array, ""]  # s
    rotation_amplitude: Float[Array, "3"]  # rad, rotation vector in the frame of the path's R
    rotation_start: Float[Array, ""]  # s
    rotation_period: Float[Array, ""]  # s

    def evaluate(self, t: Scalar) -> PayloadSetpoint:
        """The setpoint at time t, s; derivatives are exact (nested forward differentiation)."""

        def pose(t: Scalar) -> Float[Array, "6"]:
            s = t - self.rotation_start
            turn = smooth_step(s / self.ramp_time) * jnp.sin(2 * jnp.pi * s / self.rotation_period)
            off = smooth_step((t - self.start) / self.ramp_time)
            return self.base.pose(t) + jnp.concatenate([off * self.offset, turn * self.rotation_amplitude])

        return differentiate_pose(pose, self.base.R, t)
