"""What a flight may not exceed: the limits beyond which a team counts as lost, and the thrust that hovering takes."""

from __future__ import annotations

import enum
from collections.abc import Sequence

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from colift.math.pytree import pytree
from colift.models import grasp
from colift.models.parameters import Team
from colift.models.state import ResidualForces

Scalar = Float[Array, ""]


@pytree
class TerminationLimits:
    """Beyond any of these a flight ends."""

    min_delassus: Float[Array, "agents"]  # 1/kg, least of `grasp.grip`
    max_distance: Scalar  # m, of the payload from its reference
    min_height: Scalar  # m, least of payload and agents; -inf: none
    max_attitude_error: Scalar  # rad, of the payload from its reference
    max_tilt: Scalar  # rad, of an agent's thrust from the vertical
    max_saturation_time: Scalar  # s, that a thrust may stay at its limit


class TerminationCause(enum.IntEnum):
    """Why a flight ended; of several at one tick, the first."""

    NONE = 0
    NOT_FINITE = 1
    SINGULAR_GRASP = 2
    DISTANCE = 3
    HEIGHT = 4
    ATTITUDE = 5
    TILT = 6
    SATURATION = 7


@pytree
class MonitoredValues:
    """What `Limits` are about, at one tick."""

    finite: Bool[Array, ""]
    delassus: Float[Array, "agents"]  # 1/kg
    distance: Scalar  # m
    heights: Float[Array, "bodies"]  # m, of the payload, then of each agent
    attitude: Scalar  # rad
    tilt: Float[Array, "agents"]  # rad
    saturated: Float[Array, "agents"]  # s, without a break until now


def check_termination(limits: TerminationLimits, context: MonitoredValues) -> Int[Array, ""]:
    """The first `Cause` to end a flight, 0 where there is none; what is not a number exceeds `finite` alone."""
    beyond = jnp.stack(
        [
            ~context.finite,
            (context.delassus <= limits.min_delassus).any(),
            context.distance > limits.max_distance,
            (context.heights < limits.min_height).any(),
            context.attitude > limits.max_attitude_error,
            (context.tilt > limits.max_tilt).any(),
            (context.saturated > limits.max_saturation_time).any(),
        ]
    )
    return jnp.where(beyond.any(), 1 + jnp.argmax(beyond), 0)


def format_cause(
    cause: TerminationCause, limits: TerminationLimits, context: MonitoredValues, t: float, names: Sequence[str]
) -> str:
    """How a limit on the motion was exceeded at time t, s: whose, by how much, and what is allowed."""
    low, tilted, held = (int(np.argmax(x)) for x in (-context.heights, context.tilt, context.saturated))
    body = ("the payload", *(f"agent {name}" for name in names))[low]
    attitude, tilt, most_attitude, most_tilt = (
        float(np.rad2deg(x))
        for x in (context.attitude, context.tilt[tilted], limits.max_attitude_error, limits.max_tilt)
    )
    what, setting, limit = {
        TerminationCause.DISTANCE: (
            f"the payload is {context.distance:.3g} m from its reference",
            "distance_m",
            limits.max_distance,
        ),
        TerminationCause.HEIGHT: (
            f"{body} is at a height of {context.heights[low]:.3g} m",
            "height_m",
            limits.min_height,
        ),
        TerminationCause.ATTITUDE: (
            f"the payload is turned {attitude:.3g} deg from its reference",
            "attitude_deg",
            most_attitude,
        ),
        TerminationCause.TILT: (
            f"agent {names[tilted]} pushes {tilt:.3g} deg from the vertical",
            "tilt_deg",
            most_tilt,
        ),
        TerminationCause.SATURATION: (
            f"the thrust of agent {names[held]} is at its limit for {context.saturated[held]:.3g} s",
            "saturation_s",
            limits.max_saturation_time,
        ),
    }[cause]
    return f"{what} at t = {t:.3f} s, beyond limits.{setting} = {float(limit):g}"


def hover_thrust(team: Team, lam: Float[Array, "contacts 3"], f: ResidualForces) -> Float[Array, "agents"]:
    """Thrust that each agent needs at rest, N: `u_j = |sum_b lam_jb - m_j a_g - f_x,j|`.

    lam: contact forces on the payload, N, world; f: what acts on the agents besides gravity.
    """
    return jnp.concatenate(
        [
            jnp.linalg.norm(force.sum(1) - group.mass.sum(1, keepdims=True) * team.gravity[None] - part.f_x, axis=1)
            for group, force, part in zip(team.agent_groups, grasp.split_contacts(team, lam), f.agents, strict=True)
        ]
    )
