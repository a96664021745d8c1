"""Termination limits of a simulated flight, and the thrust required to hover.

A flight ends at the first tick at which a limit is exceeded or a value is not finite.
"""

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
    """Limits whose violation ends a flight."""

    min_delassus: Float[Array, "agents"]  # 1/kg, lower limit of `grasp.min_delassus_singular_value`
    max_distance: Scalar  # m, between payload and reference
    min_height: Scalar  # m, of payload and agents; -inf: no limit
    max_attitude_error: Scalar  # rad, of the payload
    max_tilt: Scalar  # rad, between an agent's thrust and the vertical
    max_saturation_time: Scalar  # s, of a thrust at its limit without interruption


class TerminationCause(enum.IntEnum):
    """Causes that end a flight, in the order of precedence at one tick."""

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
    """Values of one tick that `check_termination` compares with `TerminationLimits`."""

    finite: Bool[Array, ""]  # True if state and record are finite
    delassus: Float[Array, "agents"]  # 1/kg, smallest singular value of each agent
    distance: Scalar  # m, between payload and reference
    heights: Float[Array, "bodies"]  # m, payload first, then the agents
    attitude: Scalar  # rad, attitude error of the payload
    tilt: Float[Array, "agents"]  # rad
    saturated: Float[Array, "agents"]  # s, time at the thrust limit until now without interruption


def check_termination(limits: TerminationLimits, values: MonitoredValues) -> Int[Array, ""]:
    """Find the first `TerminationCause` that applies.

    A value that is not a number counts as `NOT_FINITE` alone.

    Args:
        limits: Limits of the flight.
        values: Values of one tick.

    Returns:
        The cause as an integer, 0 if there is none.
    """
    exceeded = jnp.stack(
        [
            ~values.finite,
            (values.delassus <= limits.min_delassus).any(),
            values.distance > limits.max_distance,
            (values.heights < limits.min_height).any(),
            values.attitude > limits.max_attitude_error,
            (values.tilt > limits.max_tilt).any(),
            (values.saturated > limits.max_saturation_time).any(),
        ]
    )
    return jnp.where(exceeded.any(), 1 + jnp.argmax(exceeded), 0)


def format_cause(
    cause: TerminationCause, limits: TerminationLimits, values: MonitoredValues, t: float, names: Sequence[str]
) -> str:
    """Describe a violated limit of the motion.

    Args:
        cause: Cause other than `NONE`, `NOT_FINITE` and `SINGULAR_GRASP`.
        limits: Limits of the flight.
        values: Values of the tick at which the flight ended.
        t: Time of this tick [s].
        names: Agent names in team order.

    Returns:
        A sentence with the body, the value, the time and the limit.
    """
    lowest, tilted, longest = (int(np.argmax(x)) for x in (-values.heights, values.tilt, values.saturated))
    body = ("the payload", *(f"agent {name}" for name in names))[lowest]
    attitude, tilt, max_attitude, max_tilt = (
        float(np.rad2deg(x)) for x in (values.attitude, values.tilt[tilted], limits.max_attitude_error, limits.max_tilt)
    )
    description, setting, limit = {
        TerminationCause.DISTANCE: (
            f"the payload is {values.distance:.3g} m from its reference",
            "max_position_error_m",
            limits.max_distance,
        ),
        TerminationCause.HEIGHT: (
            f"{body} is at a height of {values.heights[lowest]:.3g} m",
            "min_height_m",
            limits.min_height,
        ),
        TerminationCause.ATTITUDE: (
            f"the attitude error of the payload is {attitude:.3g} deg",
            "max_attitude_error_deg",
            max_attitude,
        ),
        TerminationCause.TILT: (
            f"the thrust of agent {names[tilted]} is {tilt:.3g} deg from the vertical",
            "max_tilt_deg",
            max_tilt,
        ),
        TerminationCause.SATURATION: (
            f"the thrust of agent {names[longest]} is at its limit for {values.saturated[longest]:.3g} s",
            "max_saturation_time_s",
            limits.max_saturation_time,
        ),
    }[cause]
    return f"{description} at t = {t:.3f} s, beyond termination.{setting} = {float(limit):g}"


def hover_thrust(team: Team, lam: Float[Array, "contacts 3"], f: ResidualForces) -> Float[Array, "agents"]:
    """Compute the thrust that each agent needs at rest: `u_j = |sum_b lam_jb - m_j a_g - f_x,j|`.

    Args:
        team: Parameters of the team.
        lam: Contact forces on the payload [N, world].
        f: Forces on the agents in addition to gravity.

    Returns:
        Thrust of every agent [N].
    """
    return jnp.concatenate(
        [
            jnp.linalg.norm(force.sum(1) - group.mass.sum(1, keepdims=True) * team.gravity[None] - f_j.f_x, axis=1)
            for group, force, f_j in zip(team.agent_groups, grasp.split_contacts(team, lam), f.agents, strict=True)
        ]
    )
