"""Actuator models of the simulated vehicles: ideal, or with lag, delay and limits.

An actuator model converts the commanded thrusts and torques into the inputs that act on the plant during one tick.
It keeps its own state, which is part of `colift.simulation.world.WorldState`.

See Also:
    colift.models.actuator_lag: lag and rotor limits, which the onboard controller also uses.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol, runtime_checkable

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models.actuator_lag import ActuatorLag, ActuatorLagState
from colift.models.state import AgentInput, ControlClock, TeamInputs

Scalar = Float[Array, ""]


@pytree
class IdealActuators:
    """Ideal actuators: commands act without lag and without limits.

    Subclasses override both methods to model lag, delay or saturation.
    """

    def init(self, command: TeamInputs) -> Any:
        """Return the actuator state after the command has acted for a long time."""
        return ()

    def __call__(self, command: TeamInputs, state: Any, clock: ControlClock) -> tuple[TeamInputs, Any]:
        """Return the inputs that act during the next tick and the next actuator state."""
        return command, state


@runtime_checkable
class InputLimits(Protocol):
    """Limits on thrust and body torque of all agents of a group."""

    def __call__(
        self, u: Float[Array, "agents"], tau: Float[Array, "agents 3"]
    ) -> tuple[Float[Array, "agents"], Float[Array, "agents 3"]]:
        """Return the achievable thrust [N] and body torque [N m, body frame]."""
        ...


@pytree
class BoxLimits:
    """Independent limits on thrust and on each body torque."""

    thrust_max: Float[Array, "agents"]  # N
    torque_max: Float[Array, "agents"]  # N m, about every body axis; inf: no limit

    def __call__(
        self, u: Float[Array, "agents"], tau: Float[Array, "agents 3"]
    ) -> tuple[Float[Array, "agents"], Float[Array, "agents 3"]]:
        """Clip to `0 <= u <= thrust_max` and `|tau_k| <= torque_max`."""
        limit = self.torque_max[:, None]
        return jnp.clip(u, 0.0, self.thrust_max), jnp.clip(tau, -limit, limit)


@pytree
class LaggedMotors(IdealActuators):
    """Actuators with a delay and a first-order lag of thrust and body torque, followed by limits.

    Joint torques act without lag.
    """

    lag: ActuatorLag  # delay and bandwidth
    limits: tuple[InputLimits, ...]  # one per group

    def init(self, command: TeamInputs) -> ActuatorLagState:
        """Return the lag state with a constant command, delay line included."""
        return self.lag.init(command)

    def __call__(
        self, command: TeamInputs, state: ActuatorLagState, clock: ControlClock
    ) -> tuple[TeamInputs, ActuatorLagState]:
        """Return the inputs that act during the next tick and the next lag state."""
        next_state = self.lag.step(state, command, clock.dt)
        acting = []
        for inputs, limit in zip(next_state.output, self.limits, strict=True):
            u, tau = limit(inputs.u, inputs.tau)
            acting.append(AgentInput(u=u, tau=tau, tau_r=inputs.tau_r))
        return tuple(acting), dataclasses.replace(next_state, output=tuple(acting))
