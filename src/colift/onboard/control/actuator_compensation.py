"""What flies: a pilot made of parts, each of which can be replaced alone. Memory is explicit; nothing sees the truth.

One tick: observe, record, predict, lead, allocate, realize. A part is a PyTree with the one or two methods of its class
here; `docs/change_a_part.md` leads from each wish to the one to replace. `Now` is all that a part may look at.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models.actuator_lag import ActuatorLag, ActuatorLagState
from colift.models.parameters import Team
from colift.models.state import TeamInputs

Scalar = Float[Array, ""]


@pytree
class NoCompensation:
    """Commands are what is asked, and act at once."""

    def init(self, command: TeamInputs) -> Any:
        """Nothing is remembered."""
        return ()

    def command(self, team: Team, state: Any, requested: TeamInputs, dt: Scalar) -> tuple[TeamInputs, Any]:
        """What is asked."""
        return requested, state

    def effective_command(self, state: Any, sent: TeamInputs) -> TeamInputs:
        """The last command."""
        return sent


@pytree
class LagInversion:
    """Vehicles with a lag that is known, driven so that they follow `haste` times as fast."""

    lag: ActuatorLag
    bandwidth_ratio: Scalar

    def init(self, command: TeamInputs) -> ActuatorLagState:
        """The lag's memory."""
        return self.lag.init(command)

    def command(
        self, team: Team, state: ActuatorLagState, requested: TeamInputs, dt: Scalar
    ) -> tuple[TeamInputs, ActuatorLagState]:
        """`lag.hastened`, thrust within what rotors give."""
        commands = self.lag.invert(state, requested, self.bandwidth_ratio, dt)
        commands = tuple(
            dataclasses.replace(one, u=jnp.clip(one.u, 0.0, group.thrust_max))
            for one, group in zip(commands, team.agent_groups, strict=True)
        )
        return commands, self.lag.step(state, commands, dt)

    def effective_command(self, state: ActuatorLagState, sent: TeamInputs) -> TeamInputs:
        """What the lag has made of the commands so far."""
        return state.output
