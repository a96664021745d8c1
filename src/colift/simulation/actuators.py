"""Actuator models of the simulated vehicles: ideal, or with lag, delay and limits.

An actuator model converts the commanded thrusts and torques into the inputs that act on the plant during one tick.
It keeps its own state, which is part of `colift.simulation.world.WorldState`.

See Also:
    colift.models.actuator_lag: the lag model, which the onboard controller also uses.
"""

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
class RotorMixer:
    """Rotor force limits with priority thrust, then roll and pitch, then yaw.

    The map from rotor forces f to thrust and torque is `(u, tau) = B f`, with `0 <= f <= force_max`. The rotor forces
    are `f = f_u + k f_tilt + s f_yaw`. The thrust part is clipped first; then k in [0, 1] is maximized, then s.
    """

    effectiveness: Float[Array, "4 rotors"]  # B, rows (u, tau_x, tau_y, tau_z)
    mixer: Float[Array, "rotors 4"]  # right inverse of B
    force_max: Float[Array, "agents"]  # N, maximum force of each rotor

    def __call__(
        self, u: Float[Array, "agents"], tau: Float[Array, "agents 3"]
    ) -> tuple[Float[Array, "agents"], Float[Array, "agents 3"]]:
        """Return the achievable thrust and torque under these priorities."""
        f = jax.vmap(self._forces)(u, tau, self.force_max) @ self.effectiveness.T
        return f[:, 0], f[:, 1:]

    def _forces(self, u: Scalar, tau: Float[Array, "3"], force_max: Scalar) -> Float[Array, "rotors"]:
        """Return the rotor forces of one agent [N]."""
        f = jnp.clip(self.mixer[:, 0] * u, 0.0, force_max)
        for part in (self.mixer[:, 1:3] @ tau[:2], self.mixer[:, 3] * tau[2]):
            margin = jnp.where(part > 0, force_max - f, f)
            f = f + part * jnp.clip((margin / jnp.maximum(jnp.abs(part), FORCE_EPS)).min(), 0.0, 1.0)
        return jnp.clip(f, 0.0, force_max)  # removes rounding errors of the forces that were scaled to a limit


FORCE_EPS = 1e-300  # N, avoids division by zero for a rotor whose force does not change


def ring_mixer(count: int, arm: float, yaw: float, force_max: Float[Array, "agents"]) -> RotorMixer:
    """Create a mixer for rotors spaced evenly on a circle, with alternating spin directions.

    The map is `u = sum f`, `tau = sum (y f, -x f, +-yaw f)` over rotors at positions `(x, y)`.

    Args:
        count: Number of rotors.
        arm: Radius of the circle [m].
        yaw: Ratio of reaction torque to force of each rotor [m].
        force_max: Maximum force of each rotor [N], per agent.

    Returns:
        The mixer of a group of agents.

    Raises:
        ValueError: If the number of rotors is odd or below four. Such a vehicle cannot control all axes independently.
    """
    if count < 4 or count % 2:
        raise ValueError(f"number of rotors is {count}, must be even and at least 4")
    angle = 2 * np.pi * (np.arange(count) + 0.5) / count
    x, y, spin = arm * np.cos(angle), arm * np.sin(angle), yaw * (-1.0) ** np.arange(count)
    mix = np.stack([np.ones(count), y, -x, spin])
    return RotorMixer(effectiveness=jnp.asarray(mix), mixer=jnp.asarray(np.linalg.pinv(mix)), force_max=force_max)


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
