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

FORCE_TOLERANCE = 1e-6
"""Excess of a contact force that counts as rounding [N]."""


@pytree
class ContactLimits:
    """Limits of the contact forces on the payload; contacts in team order."""

    normal: Float[Array, "contacts 3"]  # direction of the pressing force, unit vectors, payload frame
    friction: Scalar  # largest tangential over normal force; inf: no limit
    min_force: Scalar  # N, smallest normal force; -inf: no limit
    max_force: Scalar  # N, largest norm; inf: no limit
    torsional_friction: Float[Array, "contacts"] | None = None  # m, largest moment about the normal over the normal
    # force of soft fingers; inf: no limit. None: no contact has one


@pytree
class TerminationLimits:
    """Limits whose violation ends a flight."""

    min_delassus: Float[Array, "agents"]  # 1/kg, lower limit of `grasp.min_delassus_singular_value`
    max_distance: Scalar  # m, between payload and reference
    min_height: Scalar  # m, of payload and agents; -inf: no limit
    max_attitude_error: Scalar  # rad, of the payload
    max_tilt: Scalar  # rad, between an agent's thrust and the vertical
    max_saturation_time: Scalar  # s, of a thrust at its limit without interruption
    contacts: ContactLimits | None = None  # limits of the contact forces; None without limits


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
    SLIP = 8
    CONTACT_OPENS = 9
    CONTACT_FORCE = 10
    TORSIONAL_SLIP = 11


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
    contact_forces: Float[Array, "contacts 3"] | None = None  # N, on the payload, payload frame; None without limits
    contact_moments: Float[Array, "contacts 3"] | None = None  # N m, likewise; None if all contacts are points


def check_termination(limits: TerminationLimits, values: MonitoredValues) -> Int[Array, ""]:
    """Find the first `TerminationCause` that applies.

    A value that is not a number counts as `NOT_FINITE` alone.

    Args:
        limits: Limits of the flight.
        values: Values of one tick.

    Returns:
        The cause as an integer, 0 if there is none.
    """
    causes = [
        ~values.finite,
        (values.delassus <= limits.min_delassus).any(),
        values.distance > limits.max_distance,
        (values.heights < limits.min_height).any(),
        values.attitude > limits.max_attitude_error,
        (values.tilt > limits.max_tilt).any(),
        (values.saturated > limits.max_saturation_time).any(),
    ]
    if limits.contacts is not None and values.contact_forces is not None:
        excesses = contact_excess(limits.contacts, values.contact_forces, values.contact_moments)
        causes += [(excess > FORCE_TOLERANCE).any() for excess in excesses]
    exceeded = jnp.stack(causes)
    return jnp.where(exceeded.any(), 1 + jnp.argmax(exceeded), 0)


def contact_excess(
    limits: ContactLimits, forces: Float[Array, "contacts 3"], moments: Float[Array, "contacts 3"] | None = None
) -> list[Float[Array, "contacts"]]:
    """Compute by how much each contact force exceeds its limits.

    With the normal force ``n . lam``, the tangential force ``lam_t`` and the moment m, the excesses are::

        |lam_t| - friction n . lam,    min_force - n . lam,    |lam| - max_force,
        |n . m| - torsional_friction n . lam

    A contact that presses too little opens instead of slipping, so its first excess is zero. The moment about the
    normal has its own limit (Murray, Li, Sastry 1994, ch. 5, eq. 5.4).

    Args:
        limits: Limits of the contact forces.
        forces: Contact forces on the payload [N, payload frame].
        moments: Contact moments on the payload [N m, payload frame]; None if all contacts are points.

    Returns:
        Excess of friction, of the smallest normal force and of the largest force [N], and of torsional friction [N m]
        where it is limited.
    """
    normal = (limits.normal * forces).sum(-1)
    tangential = forces - normal[:, None] * limits.normal
    tangential, size = (jnp.sqrt((x * x).sum(-1)) for x in (tangential, forces))
    opens = limits.min_force - normal
    slips = jnp.where((opens > 0) | jnp.isinf(limits.friction), 0.0, tangential - limits.friction * normal)
    excesses = [slips, opens, size - limits.max_force]
    if moments is not None and limits.torsional_friction is not None:
        unlimited = jnp.isinf(limits.torsional_friction)
        largest = jnp.where(unlimited, 0.0, limits.torsional_friction) * normal
        moment = jnp.abs((limits.normal * moments).sum(-1))
        excesses.append(jnp.where(unlimited, -jnp.inf, moment - largest))
    return excesses


def format_contact_cause(
    cause: TerminationCause,
    limits: ContactLimits,
    forces: np.ndarray,
    t: float,
    names: Sequence[str],
    moments: np.ndarray | None = None,
) -> str:
    """Describe a violated limit of a contact force.

    Args:
        cause: `SLIP`, `CONTACT_OPENS`, `CONTACT_FORCE` or `TORSIONAL_SLIP`.
        limits: Limits of the contact forces.
        forces: Contact forces of the tick at which the flight ended [N, payload frame].
        t: Time of this tick [s].
        names: Contact names in team order.
        moments: Contact moments of this tick [N m, payload frame]; None if all contacts are points.

    Returns:
        A sentence with the contact, the forces, the time and the limit.
    """
    excess = contact_excess(limits, jnp.asarray(forces), None if moments is None else jnp.asarray(moments))[
        cause - TerminationCause.SLIP
    ]
    worst = int(np.argmax(excess))
    size = float(np.linalg.norm(forces[worst]))
    normal = float(np.asarray(limits.normal)[worst] @ forces[worst])
    tangential = max(size**2 - normal**2, 0.0) ** 0.5
    moment = 0.0 if moments is None else float(np.asarray(limits.normal)[worst] @ moments[worst])
    description, setting, limit = {
        TerminationCause.SLIP: (
            f"slips: tangential force {tangential:.3g} N, normal force {normal:.3g} N",
            "friction",
            limits.friction,
        ),
        TerminationCause.CONTACT_OPENS: (f"opens: normal force {normal:.3g} N", "min_force_N", limits.min_force),
        TerminationCause.CONTACT_FORCE: (f"bears {size:.3g} N", "max_force_N", limits.max_force),
        TerminationCause.TORSIONAL_SLIP: (
            f"slips about its normal: moment {moment:.3g} N m, normal force {normal:.3g} N",
            "torsional_friction_m",
            0.0 if limits.torsional_friction is None else limits.torsional_friction[worst],
        ),
    }[cause]
    return f"contact {names[worst]} {description} at t = {t:.3f} s, beyond physics.contact.{setting} = {float(limit):g}"


def format_cause(
    cause: TerminationCause, limits: TerminationLimits, values: MonitoredValues, t: float, names: Sequence[str]
) -> str:
    """Describe a violated limit of the motion.

    Args:
        cause: Cause from `DISTANCE` to `SATURATION`.
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
