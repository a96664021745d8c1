"""What vehicles make of their commands: at once, or with the lag, the delay and the limits of rotors and joints."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.lowpass import blend
from colift.model import AgentInput
from colift.pytree import pytree, static

Scalar = Float[Array, ""]
Inputs = tuple[AgentInput, ...]


@pytree
class Ideal:
    """Commands act at once and in full."""

    def begin(self, command: Inputs) -> Any:
        """The memory before the flight, after the command has acted for ever."""
        return ()

    def __call__(self, command: Inputs, memory: Any, dt: Scalar) -> tuple[Inputs, Any]:
        """What acts during the next tick, and the next memory."""
        return command, memory


@pytree
class Motors(Ideal):
    """First-order lag and a delay of thrust and body torque, limits on both; joints act at once.

    `u+ = u + (1 - exp(-2 pi f dt)) (u_cmd(t - delay) - u)`, then `0 <= u <= thrust_max`, `|tau_k| <= torque_max`.
    """

    bandwidth: Scalar  # Hz
    thrust_max: tuple[Float[Array, "agents"], ...]  # N, by group
    torque_max: tuple[Float[Array, "agents"], ...]  # N m, by group, about every body axis; inf: none
    delay: int = static(default=0)  # ticks

    def begin(self, command: Inputs) -> Any:
        """What acts, and the commands that are under way, oldest first."""
        return command, tuple(command for _ in range(self.delay))

    def __call__(self, command: Inputs, memory: Any, dt: Scalar) -> tuple[Inputs, Any]:
        """What acts during the next tick, and the next memory."""
        past, waiting = memory
        due, *waiting = (*waiting, command)
        b = blend(self.bandwidth, dt)
        acting = []
        for old, new, now, most, turn in zip(past, due, command, self.thrust_max, self.torque_max, strict=True):
            u = jnp.clip(old.u + b * (new.u - old.u), 0.0, most)
            tau = jnp.clip(old.tau + b * (new.tau - old.tau), -turn[:, None], turn[:, None])
            acting.append(AgentInput(u=u, tau=tau, tau_r=now.tau_r))
        return tuple(acting), (tuple(acting), tuple(waiting))


def still(command: Inputs) -> Inputs:
    """No thrust and no torque, in the shapes of a command."""
    return jax.tree.map(jnp.zeros_like, command)
