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
from colift.models.actuator_lag import Lag, Lagging
from colift.models.parameters import Team
from colift.models.state import Inputs

Scalar = Float[Array, ""]


@pytree
class Direct:
    """Commands are what is asked, and act at once."""

    def begin(self, command: Inputs) -> Any:
        """Nothing is remembered."""
        return ()

    def command(self, team: Team, memory: Any, asked: Inputs, dt: Scalar) -> tuple[Inputs, Any]:
        """What is asked."""
        return asked, memory

    def acts(self, memory: Any, sent: Inputs) -> Inputs:
        """The last command."""
        return sent


@pytree
class Hastened:
    """Vehicles with a lag that is known, driven so that they follow `haste` times as fast."""

    lag: Lag
    haste: Scalar

    def begin(self, command: Inputs) -> Lagging:
        """The lag's memory."""
        return self.lag.begin(command)

    def command(self, team: Team, memory: Lagging, asked: Inputs, dt: Scalar) -> tuple[Inputs, Lagging]:
        """`lag.hastened`, thrust within what rotors give."""
        commands = self.lag.hastened(memory, asked, self.haste, dt)
        commands = tuple(
            dataclasses.replace(one, u=jnp.clip(one.u, 0.0, group.thrust_max))
            for one, group in zip(commands, team.groups, strict=True)
        )
        return commands, self.lag.follow(memory, commands, dt)

    def acts(self, memory: Lagging, sent: Inputs) -> Inputs:
        """What the lag has made of the commands so far."""
        return memory.acts
