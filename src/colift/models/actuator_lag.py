"""How thrusts and body torques follow their commands: late, then with a first-order lag; joints follow at once."""

from __future__ import annotations

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.filters import blend
from colift.math.pytree import pytree, static
from colift.models.state import AgentInput, Inputs

Scalar = Float[Array, ""]


@pytree
class Lagging:
    """What acts, and the commands that are under way, oldest first."""

    acts: Inputs
    waiting: tuple[Inputs, ...]


@pytree
class Lag:
    """`u+ = u + (1 - exp(-2 pi f dt)) (u_cmd(t - delay) - u)`, and the body torque likewise."""

    bandwidth: Scalar  # Hz
    delay: int = static(default=0)  # ticks

    def begin(self, command: Inputs) -> Lagging:
        """The memory after a command has acted for ever."""
        return Lagging(acts=command, waiting=(command,) * self.delay)

    def follow(self, memory: Lagging, command: Inputs, dt: Scalar) -> Lagging:
        """The memory one tick of dt, s, after a new command."""
        due, *waiting = (*memory.waiting, command)
        acts = self._towards(memory.acts, due, dt)
        acts = tuple(AgentInput(u=a.u, tau=a.tau, tau_r=c.tau_r) for a, c in zip(acts, command, strict=True))
        return Lagging(acts=acts, waiting=tuple(waiting))

    def hastened(self, memory: Lagging, asked: Inputs, haste: Scalar, dt: Scalar) -> Inputs:
        """The command under which what acts goes towards what is asked `haste` times as fast as by itself.

        `u_cmd = u + haste (u_asked - u)`, u what acts when the command arrives: the lag's inverse behind a faster lag,
        which is there in a tick at the soonest.
        """
        haste = jnp.minimum(haste, 1 / blend(self.bandwidth, dt))
        acts = memory.acts
        for due in memory.waiting:
            acts = self._towards(acts, due, dt)

        def beyond(now: Array, then: Array) -> Array:
            return now + haste * (then - now)

        return tuple(
            AgentInput(u=beyond(a.u, c.u), tau=beyond(a.tau, c.tau), tau_r=c.tau_r)
            for a, c in zip(acts, asked, strict=True)
        )

    def _towards(self, acts: Inputs, due: Inputs, dt: Scalar) -> Inputs:
        b = blend(self.bandwidth, dt)
        return jax.tree.map(lambda old, new: old + b * (new - old), acts, due)
