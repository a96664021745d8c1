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
from colift.models.state import Residual

Scalar = Float[Array, ""]


@pytree
class Limits:
    """Beyond any of these a flight ends."""

    grip: Float[Array, "agents"]  # 1/kg, least of `grasp.grip`
    distance: Scalar  # m, of the payload from its reference
    height: Scalar  # m, least of payload and agents; -inf: none
    attitude: Scalar  # rad, of the payload from its reference
    tilt: Scalar  # rad, of an agent's thrust from the vertical
    saturation: Scalar  # s, that a thrust may stay at its limit


class Cause(enum.IntEnum):
    """Why a flight ended; of several at one tick, the first."""

    NONE = 0
    NOT_FINITE = 1
    GRIP = 2
    DISTANCE = 3
    HEIGHT = 4
    ATTITUDE = 5
    TILT = 6
    SATURATION = 7


@pytree
class Watched:
    """What `Limits` are about, at one tick."""

    finite: Bool[Array, ""]
    grip: Float[Array, "agents"]  # 1/kg
    distance: Scalar  # m
    heights: Float[Array, "bodies"]  # m, of the payload, then of each agent
    attitude: Scalar  # rad
    tilt: Float[Array, "agents"]  # rad
    saturated: Float[Array, "agents"]  # s, without a break until now


def exceeded(limits: Limits, now: Watched) -> Int[Array, ""]:
    """The first `Cause` to end a flight, 0 where there is none; what is not a number exceeds `finite` alone."""
    beyond = jnp.stack(
        [
            ~now.finite,
            (now.grip <= limits.grip).any(),
            now.distance > limits.distance,
            (now.heights < limits.height).any(),
            now.attitude > limits.attitude,
            (now.tilt > limits.tilt).any(),
            (now.saturated > limits.saturation).any(),
        ]
    )
    return jnp.where(beyond.any(), 1 + jnp.argmax(beyond), 0)


def sentence(cause: Cause, limits: Limits, now: Watched, t: float, names: Sequence[str]) -> str:
    """How a limit on the motion was exceeded at time t, s: whose, by how much, and what is allowed."""
    low, tilted, held = (int(np.argmax(x)) for x in (-now.heights, now.tilt, now.saturated))
    body = ("the payload", *(f"agent {name}" for name in names))[low]
    attitude, tilt, most_attitude, most_tilt = (
        float(np.rad2deg(x)) for x in (now.attitude, now.tilt[tilted], limits.attitude, limits.tilt)
    )
    what, setting, limit = {
        Cause.DISTANCE: (f"the payload is {now.distance:.3g} m from its reference", "distance_m", limits.distance),
        Cause.HEIGHT: (f"{body} is at a height of {now.heights[low]:.3g} m", "height_m", limits.height),
        Cause.ATTITUDE: (f"the payload is turned {attitude:.3g} deg from its reference", "attitude_deg", most_attitude),
        Cause.TILT: (f"agent {names[tilted]} pushes {tilt:.3g} deg from the vertical", "tilt_deg", most_tilt),
        Cause.SATURATION: (
            f"the thrust of agent {names[held]} is at its limit for {now.saturated[held]:.3g} s",
            "saturation_s",
            limits.saturation,
        ),
    }[cause]
    return f"{what} at t = {t:.3f} s, beyond limits.{setting} = {float(limit):g}"


def hover(team: Team, lam: Float[Array, "contacts 3"], f: Residual) -> Float[Array, "agents"]:
    """Thrust that each agent needs at rest, N: `u_j = |sum_b lam_jb - m_j a_g - f_x,j|`.

    lam: contact forces on the payload, N, world; f: what acts on the agents besides gravity.
    """
    return jnp.concatenate(
        [
            jnp.linalg.norm(force.sum(1) - group.mass.sum(1, keepdims=True) * team.gravity[None] - part.f_x, axis=1)
            for group, force, part in zip(team.groups, grasp.split(team, lam), f.agents, strict=True)
        ]
    )
