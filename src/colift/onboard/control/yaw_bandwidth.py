"""Limit of the payload's yaw bandwidth by agents whose tips cannot move across their thrust.

Such an agent applies a horizontal force to the payload by a rotation about its tips. The rotation first accelerates the
tips against the intended direction. From the commanded to the applied force, the transfer function contains the factor
`1 - s^2 / z^2` with `z = sqrt(u / (m l))`: u is the thrust, m the mass, and l the height of the center of mass above
the tips. The zero z in the right half plane limits the bandwidth (Astrom, Murray, *Feedback Systems*, 2021, sec. 14.4).

See Also:
    docs/theory.md: derivation.
"""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator
from colift.onboard.control import redundancy

BANDWIDTH_RATIO = 0.3
"""Yaw bandwidth relative to the zero.

A zero z in the right half plane and a crossover frequency w cost the phase `2 atan(w / z)`, 33 degrees at this ratio.
The delay of the attitude loop costs about as much.
"""
DAMPING_RATIO = 0.7
"""Damping ratio of the yaw motion with the default gains."""
MIN_RADIUS_RATIO = 0.01
"""Smallest distance of an agent's mean contact from the yaw axis, relative to the farthest contact."""


def right_half_plane_zero(
    agent: AerialManipulator, nominal_posture: Float[Array, "n_r"], yaw: float, thrust: float
) -> float:
    """Compute the zero `z = sqrt(u / (m l b))` of an agent's tangential force on the payload.

    `b = t^T D t` is the part of a tangential motion t of the tips that the center of mass has to follow
    (`redundancy.bound_directions`), for a level base and a level payload.

    Args:
        agent: Nominal parameters of one agent.
        nominal_posture: Joint positions [rad or m].
        yaw: Heading of the agent [rad].
        thrust: Thrust u in hover [N].

    Returns:
        The zero [rad/s]; infinite if the agent does not limit yaw.
    """
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, nominal_posture))
    height, c = -float(np.asarray(p.tip_from_com)[:, 2].mean()), np.asarray(agent.contact_position).mean(0)
    cos, sin = np.cos(yaw), np.sin(yaw)
    D = np.asarray(redundancy.bound_directions(agent, p, jnp.asarray([[cos, -sin, 0.0], [sin, cos, 0.0], [0, 0, 1]])))
    tangent = np.array([-c[1], c[0], 0.0]) / max(float(np.hypot(c[0], c[1])), np.finfo(float).tiny)
    lever = float(p.mass) * height * float(tangent @ D @ tangent)
    return float(np.sqrt(thrust / lever)) if lever > 0 else np.inf


def default_yaw_gains(zero: float, k_R: float, k_omega: float) -> tuple[float, float]:
    """Compute yaw gains that a right half-plane zero permits, at most the given ones.

    `k_R,z = min(k_R, (r z)^2)`, `k_omega,z = min(k_omega, 2 d sqrt(k_R,z))` with `BANDWIDTH_RATIO` r and
    `DAMPING_RATIO` d. Gains without a limit are returned unchanged.

    Args:
        zero: Smallest zero of the team [rad/s].
        k_R: Attitude gain of roll and pitch [1/s^2].
        k_omega: Angular velocity gain of roll and pitch [1/s].

    Returns:
        Attitude gain [1/s^2] and angular velocity gain [1/s] of yaw.
    """
    limit = (BANDWIDTH_RATIO * zero) ** 2
    if k_R <= limit:
        return k_R, k_omega
    return limit, min(k_omega, 2 * DAMPING_RATIO * float(np.sqrt(limit)))
