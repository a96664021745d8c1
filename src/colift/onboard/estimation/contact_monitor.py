"""Detection of contacts that have opened.

A contact counts as open if two conditions hold in one control period:

- the distance between its tip and its point on the payload exceeds six standard deviations,
- the tip force reading is below three standard deviations.

Encoder readings are not filtered here: until the detection, their filter assumes that the tip follows the payload.
A stuck pose does not change the force of a closed contact, and a small force does not change its distance.

An open contact stays open until its gripper reports that it has closed again (`Measurement.regrasped`). A tip that is
held at its contact point bears almost no force, so distance and force do not show that a contact has closed.

Grippers also report contacts that are open from the start (`Measurement.ungrasped`).

See Also:
    docs/decisions/0005-general-force-allocation: measured delays, and flights with an open contact.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from colift.math.filters import smoothing_factor
from colift.math.pytree import pytree
from colift.models import aerial_manipulator, grasp
from colift.models.measurement import Measurement
from colift.models.parameters import OPEN_COMPLIANCE, AerialManipulator, Team
from colift.models.state import State
from colift.onboard.estimation.state_estimator import StateEstimate

Scalar = Float[Array, ""]

DISTANCE_FACTOR = 6.0
"""Distance above which a contact may be open, in standard deviations.

Normal noise in one direction exceeds it in 2e-9 of the periods, with a closed contact that bears no force.
"""
FORCE_FACTOR = 3.0
"""Force below which a contact may be open, in standard deviations of the norm of a reading."""

OpenContacts = tuple[Bool[Array, "agents arms"], ...]
"""Contacts that have opened, by group."""


@pytree
class ContactMonitor:
    """Detection of open contacts from tip positions and tip force readings.

    Attributes:
        distance_std: Standard deviations of the distances between tips and payload [m], by group.
        force_std: Standard deviation of the norm of a tip force reading [N].
        start: Time before which no contact counts as open, while the state estimate settles [s].
    """

    distance_std: tuple[Float[Array, "agents arms"], ...]
    force_std: Scalar
    start: Scalar

    def init(self, team: Team, measurement: Measurement) -> OpenContacts:
        """Return the contacts that are open at the start, as their grippers report.

        Args:
            team: Nominal parameters.
            measurement: Readings of the team at rest.
        """
        if measurement.ungrasped is not None:
            return measurement.ungrasped
        return tuple(jnp.zeros(group.contact_position.shape[:2], bool) for group in team.agent_groups)

    def update(
        self, state: OpenContacts, team: Team, estimate: StateEstimate, measurement: Measurement, t: Scalar
    ) -> OpenContacts:
        """Return the contacts that are open in this control period.

        Args:
            state: Open contacts of the previous control period.
            team: Nominal parameters.
            estimate: State estimate of this control period.
            measurement: Readings of this control period.
            t: Time [s].
        """
        found = []
        agents = tuple(dataclasses.replace(q, r=m.r) for q, m in zip(estimate.agents, measurement.agents, strict=True))
        residual = grasp.constraint_residual(team, State(agents=agents, payload=estimate.payload))
        for was_open, gap, lam, std in zip(
            state, grasp.split_contacts(team, residual), estimate.lam, self.distance_std, strict=True
        ):
            away = (gap * gap).sum(-1) > (DISTANCE_FACTOR * std) ** 2
            unloaded = (lam * lam).sum(-1) < (FORCE_FACTOR * self.force_std) ** 2
            found.append(was_open | (away & unloaded & (t >= self.start)))
        if measurement.regrasped is not None:
            found = [is_open & ~closed for is_open, closed in zip(found, measurement.regrasped, strict=True)]
        return tuple(found)

    def acting(self, state: OpenContacts, team: Team) -> Team:
        """Return the team with the compliance of open contacts."""
        groups = tuple(
            dataclasses.replace(group, contact_compliance=jnp.where(is_open, OPEN_COMPLIANCE, 0.0))
            for group, is_open in zip(team.agent_groups, state, strict=True)
        )
        return dataclasses.replace(team, agent_groups=groups)


@dataclasses.dataclass(frozen=True)
class ReadingNoise:
    """Standard deviations of the readings, by axis.

    Attributes:
        position: Position [m].
        attitude: Attitude [rad].
        joint: Joint position [rad or m].
        tip_force: Tip force, with its bias [N].
    """

    position: float
    attitude: float
    joint: float
    tip_force: float


def contact_monitor(
    team: Team, posture: Sequence[Float[Array, "_agents _n_r"]], noise: ReadingNoise, bandwidth: float, dt: float
) -> ContactMonitor:
    """Build the detection of open contacts from the noise of the readings.

    The distance contains two positions with the standard deviation s, two attitudes with a and the joints with b. With
    the contact c, the tip t in the base frame and its Jacobian B::

        std^2 = k (6 s^2 + 2 a^2 (|c|^2 + |t|^2)) + b^2 trace(B B^T)

    The first-order filter of poses with the smoothing factor w reduces variances by ``k = w / (2 - w)``. It settles
    within three time constants.

    Args:
        team: Nominal parameters.
        posture: Nominal joint positions by group [rad or m].
        noise: Noise of the readings.
        bandwidth: Bandwidth of the filter of positions and attitudes [Hz].
        dt: Control period [s].

    Returns:
        The monitor.
    """
    w = smoothing_factor(jnp.asarray(bandwidth), jnp.asarray(dt))
    k = w / (2 - w)

    def distance_std(agent: AerialManipulator, r: Float[Array, "n_r"]) -> Float[Array, "arms"]:
        g = aerial_manipulator.forward_kinematics(agent, r)
        c, t, B = agent.contact_position, g.points[-agent.tree.arms :], g.J_point[-agent.tree.arms :]
        levers = (c * c).sum(-1) + (t * t).sum(-1)
        poses = 6 * noise.position**2 + 2 * noise.attitude**2 * levers
        return jnp.sqrt(k * poses + noise.joint**2 * (B * B).sum((1, 2)))

    stds = tuple(jax.vmap(distance_std)(group, r) for group, r in zip(team.agent_groups, posture, strict=True))
    return ContactMonitor(
        distance_std=stds,
        force_std=jnp.asarray(3**0.5 * noise.tip_force),
        start=jnp.asarray(3 / (2 * np.pi * bandwidth)),
    )
