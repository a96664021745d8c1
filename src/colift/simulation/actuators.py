"""What vehicles make of their commands: at once, or with the lag, the delay and the limits of rotors and joints."""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models.actuator_lag import ActuatorLag, ActuatorLagState
from colift.models.state import AgentInput, ControlClock, TeamInputs

Scalar = Float[Array, ""]


@pytree
class IdealActuators:
    """Commands act at once and in full."""

    def init(self, command: TeamInputs) -> Any:
        """The memory before the flight, after the command has acted for ever."""
        return ()

    def __call__(self, command: TeamInputs, state: Any, clock: ControlClock) -> tuple[TeamInputs, Any]:
        """What acts during the next tick, and the next memory."""
        return command, state


@runtime_checkable
class InputLimits(Protocol):
    """What of a thrust and a body torque the vehicles of a group can give."""

    def __call__(
        self, u: Float[Array, "agents"], tau: Float[Array, "agents 3"]
    ) -> tuple[Float[Array, "agents"], Float[Array, "agents 3"]]:
        """Thrust, N, and torque, N m, body frame."""
        ...


@pytree
class BoxLimits:
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
class RotorMixer:
    """Rotors that push between zero and their limit: what they cannot give is taken from yaw first, then from tilt.

    `(u, tau) = B f`, f the rotors' forces. Of `f = f_u + k f_tilt + s f_yaw` with `0 <= f <= f_max`, u is kept as far
    as they reach, then k in [0, 1] is as large as can be, then s.
    """

    effectiveness: Float[Array, "4 rotors"]  # B: of (u, tau_x, tau_y, tau_z)
    mixer: Float[Array, "rotors 4"]  # its right inverse
    force_max: Float[Array, "agents"]  # N, of each rotor

    def __call__(
        self, u: Float[Array, "agents"], tau: Float[Array, "agents 3"]
    ) -> tuple[Float[Array, "agents"], Float[Array, "agents 3"]]:
        """The nearest that the rotors can give, in that order."""
        f = jax.vmap(self._forces)(u, tau, self.force_max) @ self.effectiveness.T
        return f[:, 0], f[:, 1:]

    def _forces(self, u: Scalar, tau: Float[Array, "3"], most: Scalar) -> Float[Array, "rotors"]:
        f = jnp.clip(self.mixer[:, 0] * u, 0.0, most)
        for share in (self.mixer[:, 1:3] @ tau[:2], self.mixer[:, 3] * tau[2]):
            room = jnp.where(share > 0, most - f, f)
            f = f + share * jnp.clip((room / jnp.maximum(jnp.abs(share), FORCE_EPS)).min(), 0.0, 1.0)
        return jnp.clip(f, 0.0, most)  # of what was scaled to a limit, rounding


FORCE_EPS = 1e-300  # N: a rotor that need not change has all the room there is


def ring_mixer(count: int, arm: float, yaw: float, force_max: Float[Array, "agents"]) -> RotorMixer:
    """Rotors evenly around a ring of radius `arm`, m, that turn in turns; yaw: m, torque over force of each.

    `u = sum f`, `tau = sum (y f, -x f, +-yaw f)`. Raises ValueError for a number that is odd or below four: it cannot
    turn about every axis alone.
    """
    if count < 4 or count % 2:
        raise ValueError(f"rotors: {count}; an even number of four or more is needed")
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    x, y, turn = arm * np.cos(angle), arm * np.sin(angle), yaw * (-1.0) ** np.arange(count)
    mix = np.stack([np.ones(count), y, -x, turn])
    return RotorMixer(effectiveness=jnp.asarray(mix), mixer=jnp.asarray(np.linalg.pinv(mix)), force_max=force_max)


@pytree
class LaggedMotors(IdealActuators):
    """A delay and a first-order lag of thrust and body torque, then a limit; joints act at once."""

    lag: ActuatorLag
    limits: tuple[InputLimits, ...]  # by group

    def init(self, command: TeamInputs) -> ActuatorLagState:
        """What acts, and the commands that are under way."""
        return self.lag.init(command)

    def __call__(
        self, command: TeamInputs, state: ActuatorLagState, clock: ControlClock
    ) -> tuple[TeamInputs, ActuatorLagState]:
        """What acts during the next tick, and the next memory."""
        context = self.lag.step(state, command, clock.dt)
        acting = []
        for one, limit in zip(context.output, self.limits, strict=True):
            u, tau = limit(one.u, one.tau)
            acting.append(AgentInput(u=u, tau=tau, tau_r=one.tau_r))
        return tuple(acting), dataclasses.replace(context, output=tuple(acting))
