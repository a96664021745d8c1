"""Smooth departure of the payload from a Lissajous trajectory, for trajectories not used in training."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.trajectories.base import PayloadSetpoint, differentiate_pose, smooth_step
from colift.trajectories.lissajous import Lissajous

Scalar = Float[Array, ""]


@pytree
class PathDeparture:
    """Lissajous trajectory with an offset and an added oscillation of the attitude from given times on.

    The position is shifted by `offset` from `start` on. The rotation vector is increased by
    `rotation_amplitude sin(2 pi s / rotation_period)`, with s the time since `rotation_start`. Both changes rise within
    `ramp_time`.
    """

    base: Lissajous  # trajectory before the departure
    offset: Float[Array, "3"]  # m, world
    start: Float[Array, ""]  # s, start of the offset
    ramp_time: Float[Array, ""]  # s, duration of the rise
    rotation_amplitude: Float[Array, "3"]  # rad, rotation vector in the frame of `base.R`
    rotation_start: Float[Array, ""]  # s, start of the oscillation
    rotation_period: Float[Array, ""]  # s

    def evaluate(self, t: Scalar) -> PayloadSetpoint:
        """Compute the setpoint at time t [s]; see `ReferenceTrajectory`."""

        def pose(t: Scalar) -> Float[Array, "6"]:
            s = t - self.rotation_start
            rotation = smooth_step(s / self.ramp_time) * jnp.sin(2 * jnp.pi * s / self.rotation_period)
            shift = smooth_step((t - self.start) / self.ramp_time)
            return self.base.pose(t) + jnp.concatenate([shift * self.offset, rotation * self.rotation_amplitude])

        return differentiate_pose(pose, self.base.R, t)
