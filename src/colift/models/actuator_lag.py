"""How thrusts and body torques follow their commands: late, then with a first-order lag; joints follow at once."""

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
    """What acts, and the commands that are under way, oldest first."""

    output: TeamInputs
    delay_line: tuple[TeamInputs, ...]


@pytree
class ActuatorLag:
    """`u+ = u + (1 - exp(-2 pi f dt)) (u_cmd(t - delay) - u)`, and the body torque likewise."""

    bandwidth: Scalar  # Hz
    delay: int = static(default=0)  # ticks

    def init(self, command: TeamInputs) -> ActuatorLagState:
        """The memory after a command has acted for ever."""
        return ActuatorLagState(output=command, delay_line=(command,) * self.delay)

    def step(self, state: ActuatorLagState, command: TeamInputs, dt: Scalar) -> ActuatorLagState:
        """The memory one tick of dt, s, after a new command."""
        due, *waiting = (*state.delay_line, command)
        acts = self._towards(state.output, due, dt)
        acts = tuple(AgentInput(u=a.u, tau=a.tau, tau_r=c.tau_r) for a, c in zip(acts, command, strict=True))
        return ActuatorLagState(output=acts, delay_line=tuple(waiting))

    def invert(self, state: ActuatorLagState, requested: TeamInputs, bandwidth_ratio: Scalar, dt: Scalar) -> TeamInputs:
        """The command under which what acts goes towards what is asked `haste` times as fast as by itself.

        `u_cmd = u + haste (u_asked - u)`, u what acts when the command arrives: the lag's inverse behind a faster lag,
        which is there in a tick at the soonest.
        """
        bandwidth_ratio = jnp.minimum(bandwidth_ratio, 1 / smoothing_factor(self.bandwidth, dt))
        acts = state.output
        for due in state.delay_line:
            acts = self._towards(acts, due, dt)

        def beyond(context: Array, then: Array) -> Array:
            return context + bandwidth_ratio * (then - context)

        return tuple(
            AgentInput(u=beyond(a.u, c.u), tau=beyond(a.tau, c.tau), tau_r=c.tau_r)
            for a, c in zip(acts, requested, strict=True)
        )

    def _towards(self, acts: TeamInputs, due: TeamInputs, dt: Scalar) -> TeamInputs:
        b = smoothing_factor(self.bandwidth, dt)
        return jax.tree.map(lambda old, new: old + b * (new - old), acts, due)
