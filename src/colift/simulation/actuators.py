"""What vehicles make of their commands: at once, or with the lag, the delay and the limits of rotors and joints."""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models.actuator_lag import Lag, Lagging
from colift.models.state import AgentInput, Clock, Inputs

Scalar = Float[Array, ""]


@pytree
class Ideal:
    """Commands act at once and in full."""

    def begin(self, command: Inputs) -> Any:
        """The memory before the flight, after the command has acted for ever."""
        return ()

    def __call__(self, command: Inputs, memory: Any, clock: Clock) -> tuple[Inputs, Any]:
        """What acts during the next tick, and the next memory."""
        return command, memory


@runtime_checkable
class Limit(Protocol):
    """What of a thrust and a body torque the vehicles of a group can give."""

    def __call__(
        self, u: Float[Array, "agents"], tau: Float[Array, "agents 3"]
    ) -> tuple[Float[Array, "agents"], Float[Array, "agents 3"]]:
        """Thrust, N, and torque, N m, body frame."""
        ...


@pytree
class Box:
    """Thrust and each torque are limited alone."""

    thrust_max: Float[Array, "agents"]  # N
    torque_max: Float[Array, "agents"]  # N m, about every body axis; inf: no limit

    def __call__(
        self, u: Float[Array, "agents"], tau: Float[Array, "agents 3"]
    ) -> tuple[Float[Array, "agents"], Float[Array, "agents 3"]]:
        """`0 <= u <= thrust_max`, `|tau_k| <= torque_max`."""
        most = self.torque_max[:, None]
        return jnp.clip(u, 0.0, self.thrust_max), jnp.clip(tau, -most, most)


@pytree
class Rotors:
    """Rotors that push between zero and their limit: what they cannot give is taken from yaw first, then from tilt.

    `(u, tau) = B f`, f the rotors' forces. Of `f = f_u + k f_tilt + s f_yaw` with `0 <= f <= f_max`, u is kept as far
    as they reach, then k in [0, 1] is as large as can be, then s.
    """

    mix: Float[Array, "4 rotors"]  # B: of (u, tau_x, tau_y, tau_z)
    unmix: Float[Array, "rotors 4"]  # its right inverse
    force_max: Float[Array, "agents"]  # N, of each rotor

    def __call__(
        self, u: Float[Array, "agents"], tau: Float[Array, "agents 3"]
    ) -> tuple[Float[Array, "agents"], Float[Array, "agents 3"]]:
        """The nearest that the rotors can give, in that order."""
        f = jax.vmap(self._forces)(u, tau, self.force_max) @ self.mix.T
        return f[:, 0], f[:, 1:]

    def _forces(self, u: Scalar, tau: Float[Array, "3"], most: Scalar) -> Float[Array, "rotors"]:
        f = jnp.clip(self.unmix[:, 0] * u, 0.0, most)
        for share in (self.unmix[:, 1:3] @ tau[:2], self.unmix[:, 3] * tau[2]):
            room = jnp.where(share > 0, most - f, f)
            f = f + share * jnp.clip((room / jnp.maximum(jnp.abs(share), TINY)).min(), 0.0, 1.0)
        return jnp.clip(f, 0.0, most)  # of what was scaled to a limit, rounding


TINY = 1e-300  # N: a rotor that need not change has all the room there is


def rotors(count: int, arm: float, yaw: float, force_max: Float[Array, "agents"]) -> Rotors:
    """Rotors evenly around a ring of radius `arm`, m, that turn in turns; yaw: m, torque over force of each.

    `u = sum f`, `tau = sum (y f, -x f, +-yaw f)`. Raises ValueError for a number that is odd or below four: it cannot
    turn about every axis alone.
    """
    if count < 4 or count % 2:
        raise ValueError(f"rotors: {count}; an even number of four or more is needed")
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    x, y, turn = arm * np.cos(angle), arm * np.sin(angle), yaw * (-1.0) ** np.arange(count)
    mix = np.stack([np.ones(count), y, -x, turn])
    return Rotors(mix=jnp.asarray(mix), unmix=jnp.asarray(np.linalg.pinv(mix)), force_max=force_max)


@pytree
class Motors(Ideal):
    """A delay and a first-order lag of thrust and body torque, then a limit; joints act at once."""

    lag: Lag
    limits: tuple[Limit, ...]  # by group

    def begin(self, command: Inputs) -> Lagging:
        """What acts, and the commands that are under way."""
        return self.lag.begin(command)

    def __call__(self, command: Inputs, memory: Lagging, clock: Clock) -> tuple[Inputs, Lagging]:
        """What acts during the next tick, and the next memory."""
        now = self.lag.follow(memory, command, clock.dt)
        acting = []
        for one, limit in zip(now.acts, self.limits, strict=True):
            u, tau = limit(one.u, one.tau)
            acting.append(AgentInput(u=u, tau=tau, tau_r=one.tau_r))
        return tuple(acting), dataclasses.replace(now, acts=tuple(acting))
