"""Actuator model: delay and first-order lag of thrust and body torque.

Joint torques follow their commands without lag. The controller contains the same model to compensate the lag.

See Also:
    docs/decisions/0052-stability-limits-of-residual-compensation.md: the limits of the compensation.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
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
