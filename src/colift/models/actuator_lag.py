"""Actuator models: delay and first-order lag of thrust and body torque, and limits of single rotors.

Joint torques follow their commands without lag. The controller contains the same models.

See Also:
    docs/decisions/0052-stability-limits-of-residual-compensation.md: the limits of the compensation.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.filters import smoothing_factor
from colift.math.pytree import pytree, static
from colift.models.state import AgentInput, TeamInputs

Scalar = Float[Array, ""]


@pytree
class ActuatorLagState:
    """State of the actuators.

    Attributes:
        output: Effective inputs, by group [N, N m].
        delay_line: Delayed commands, oldest first.
    """

    output: TeamInputs
    delay_line: tuple[TeamInputs, ...]


@pytree
class ActuatorLag:
    """First-order lag with delay: `u+ = u + (1 - exp(-2 pi f dt)) (u_cmd(t - delay) - u)`; the body torque likewise.

    Attributes:
        bandwidth: Corner frequency f [Hz].
        delay: Delay [control periods].
    """

    bandwidth: Scalar
    delay: int = static(default=0)

    def init(self, command: TeamInputs) -> ActuatorLagState:
        """Return the steady state of a constant command.

        Args:
            command: Inputs of all agents [N, N m].

        Returns:
            The state whose output and delayed commands equal the command.
        """
        return ActuatorLagState(output=command, delay_line=(command,) * self.delay)

    def step(self, state: ActuatorLagState, command: TeamInputs, dt: Scalar) -> ActuatorLagState:
        """Advance the actuators by one control period.

        Args:
            state: Present state.
            command: New command [N, N m].
            dt: Control period [s].

        Returns:
            The next state; its joint torques are those of `command`.
        """
        due, *pending = (*state.delay_line, command)
        output = self._apply_lag(state.output, due, dt)
        output = tuple(AgentInput(u=a.u, tau=a.tau, tau_r=c.tau_r) for a, c in zip(output, command, strict=True))
        return ActuatorLagState(output=output, delay_line=tuple(pending))

    def invert(self, state: ActuatorLagState, requested: TeamInputs, bandwidth_ratio: Scalar, dt: Scalar) -> TeamInputs:
        """Compute the command that increases the bandwidth of the lag (lag inversion).

        The command is `u_cmd = u + ratio (u_requested - u)`, with the output u predicted at the time at which the
        command takes effect. The ratio is limited so that the requested input is reached in one control period at the
        earliest.

        Args:
            state: Present state.
            requested: Inputs that the controller requires [N, N m].
            bandwidth_ratio: Ratio of the resulting bandwidth to that of the actuators.
            dt: Control period [s].

        Returns:
            The command; joint torques are passed unchanged.
        """
        bandwidth_ratio = jnp.minimum(bandwidth_ratio, 1 / smoothing_factor(self.bandwidth, dt))
        output = state.output
        for due in state.delay_line:
            output = self._apply_lag(output, due, dt)

        def amplify(current: Array, target: Array) -> Array:
            return current + bandwidth_ratio * (target - current)

        return tuple(
            AgentInput(u=amplify(a.u, c.u), tau=amplify(a.tau, c.tau), tau_r=c.tau_r)
            for a, c in zip(output, requested, strict=True)
        )

    def _apply_lag(self, output: TeamInputs, due: TeamInputs, dt: Scalar) -> TeamInputs:
        """Advance the output by one control period towards the command that takes effect."""
        b = smoothing_factor(self.bandwidth, dt)
        return jax.tree.map(lambda old, new: old + b * (new - old), output, due)


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


YAW_MARGIN = 0.02
"""Yaw torque before thrust: its rotor forces relative to the largest force; PX4 uses 0.15.

Without it a vehicle at its limit turns about the vertical, and its arms tilt the payload. The value is chosen by
flights with limits from 28 N to 32 N (docs/decisions/0005-general-force-allocation.md).
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
