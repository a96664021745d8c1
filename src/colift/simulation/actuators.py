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
    """Rotor force limits with priority roll and pitch, then a small yaw torque, then thrust, then the rest of the yaw.

    The map from rotor forces f to thrust and torque is `(u, tau) = B f`, with `0 <= f <= force_max`. The rotor forces
    are `f = k f_tilt + s f_yaw + f_u + r f_yaw`. The steps are those of the mixers of flight controllers:

    1. k in [0, 1] is maximized for any thrust.
    2. s is maximized for any thrust, while `s |f_yaw|` is at most `YAW_MARGIN force_max`.
    3. The thrust is limited to the range that these torques leave.
    4. r in [0, 1 - s] is maximized.

    A team that lacks thrust then sinks, but stays level and keeps its heading.

    References:
        Faessler, Falanga, Scaramuzza, *Thrust Mixing, Saturation, and Body-Rate Control for Accurate Aggressive
        Quadrotor Flight*, 2017.
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
        tilt, share, yaw = self.mixer[:, 1:3] @ tau[:2], self.mixer[:, 0], self.mixer[:, 3] * tau[2]
        f = tilt * jnp.minimum(1.0, force_max / jnp.maximum(tilt.max() - tilt.min(), FORCE_EPS))
        difference, rise = f[:, None] - f[None], yaw[:, None] - yaw[None]  # of each pair of rotors
        size = jnp.maximum(jnp.abs(yaw).max(), FORCE_EPS)
        first = jnp.where(rise > 1e-9 * size, (force_max - difference) / jnp.maximum(rise, FORCE_EPS), jnp.inf).min()
        first = jnp.minimum(first, YAW_MARGIN * force_max / size)
        first = jnp.clip(first, 0.0, 1.0)
        f = f + first * yaw
        f = f + share * jnp.clip(u, (-f / share).max(), ((force_max - f) / share).min())
        margin = jnp.where(yaw > 0, force_max - f, f)
        f = f + yaw * jnp.clip((margin / jnp.maximum(jnp.abs(yaw), FORCE_EPS)).min(), 0.0, 1.0 - first)
        return jnp.clip(f, 0.0, force_max)  # removes rounding errors of the forces that were scaled to a limit


YAW_MARGIN = 0.05
"""Yaw torque before thrust: its rotor forces relative to the largest force; PX4 uses 0.15.

Without it a vehicle at its limit turns about the vertical, and its arms tilt the payload. The value is chosen by
flights with limits from 29 N to 34 N (docs/decisions/0005-general-force-allocation.md).
"""
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
