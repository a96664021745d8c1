"""Faults of the simulated team: loss of rotor thrust and contacts that open, each from a stated time.

See Also:
    colift.simulation.sensors: rates, delays, dropouts and failures of sensors.
    docs/scenarios: settings of the faults.
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models.parameters import Team
from colift.models.state import AgentInput, TeamInputs

Scalar = Float[Array, ""]

OPEN_COMPLIANCE = 1e12
"""Compliance of an open contact [1/kg], in the unit of `A M^-1 A^T`: no force acts that changes a motion.

Closed contacts have values of about 10 1/kg, so the force of an open contact is about 1e-11 of that of a closed one.
"""


@pytree
class ThrustLoss:
    """Loss of rotor effectiveness of one agent: thrust and body torque are multiplied by a share in an interval."""

    share: tuple[Float[Array, "agents"], ...]  # remaining share of each agent in the interval, by group
    start: Scalar  # s
    end: Scalar  # s; inf: until the end of the flight


@pytree
class Faults:
    """Faults of a flight, unknown to the controller."""

    thrust: tuple[ThrustLoss, ...] = ()  # losses of rotor thrust; shares of simultaneous losses multiply
    release_time: tuple[Float[Array, "agents arms"], ...] | None = None  # s, by group; inf: never. None: no release

    def limit(self, inputs: TeamInputs, t: Scalar) -> TeamInputs:
        """Return the inputs that act at time t [s], after the loss of thrust."""
        for loss in self.thrust:
            active = (t >= loss.start - 1e-9) & (t < loss.end - 1e-9)
            scales = [jnp.where(active, share, 1.0) for share in loss.share]
            inputs = tuple(
                AgentInput(u=scale * part.u, tau=scale[:, None] * part.tau, tau_r=part.tau_r)
                for scale, part in zip(scales, inputs, strict=True)
            )
        return inputs

    def team_at(self, team: Team, t: Scalar) -> Team:
        """Return the true parameters at time t [s], with the compliance of open contacts."""
        if self.release_time is None:
            return team
        groups = tuple(
            dataclasses.replace(group, contact_compliance=jnp.where(t >= start - 1e-9, OPEN_COMPLIANCE, 0.0))
            for group, start in zip(team.agent_groups, self.release_time, strict=True)
        )
        return dataclasses.replace(team, agent_groups=groups)
