"""Where the payload should be: a smooth pose with the derivatives that the controllers feed forward."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.trajectories.base import Setpoint, along, smooth_step
from colift.trajectories.lissajous import Lissajous

Scalar = Float[Array, ""]


@pytree
class Leaving:
    """Another path that moves off by `shift` from `start` on, and turns as it had not: `swing sin(2 pi s / period)`.

    s is the time since `swing_start`; both rise within `over`.
    """

    path: Lissajous
    shift: Float[Array, "3"]  # m
    start: Float[Array, ""]  # s
    over: Float[Array, ""]  # s
    swing: Float[Array, "3"]  # rad, rotation vector in the frame of the path's R
    swing_start: Float[Array, ""]  # s
    swing_period: Float[Array, ""]  # s

    def at(self, t: Scalar) -> Setpoint:
        """The setpoint at time t, s; derivatives are exact (nested forward differentiation)."""

        def pose(t: Scalar) -> Float[Array, "6"]:
            s = t - self.swing_start
            turn = smooth_step(s / self.over) * jnp.sin(2 * jnp.pi * s / self.swing_period)
            off = smooth_step((t - self.start) / self.over)
            return self.path.pose(t) + jnp.concatenate([off * self.shift, turn * self.swing])

        return along(pose, self.path.R, t)
