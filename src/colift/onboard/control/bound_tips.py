"""Limits of feedback through agents whose tips cannot move across their thrust.

Such an agent applies a horizontal force to the payload by a rotation about its tips. The rotation first accelerates the
tips against the intended direction. From the commanded to the applied force, the transfer function contains the factor
`1 - s^2 / z^2` with `z = sqrt(u / (m l))`: u is the thrust, m the mass, and l the height of the center of mass above
the tips. The zero z in the right half plane limits the bandwidth (Astrom, Murray, *Feedback Systems*, 2021, sec. 14.4).

See Also:
    docs/theory.md: derivation.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import transfer
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator
from colift.onboard.control import redundancy, tracking

BANDWIDTH_RATIO = 0.3
"""Yaw bandwidth relative to the zero.

A zero z in the right half plane and a crossover frequency w cost the phase `2 atan(w / z)`, 33 degrees at this ratio.
The delay of the attitude loop costs about as much.
"""
DAMPING_RATIO = 0.7
"""Damping ratio of the yaw motion with the default gains."""
MAX_LOOP_GAIN = 0.8
"""Largest gain of the loop of `acceleration_loop_gain`, for a gain margin of 1.25."""
MIN_RADIUS_RATIO = 0.01
"""Smallest distance of an agent's mean contact from the yaw axis, relative to the farthest contact."""


class HoverAgent(NamedTuple):
    """One agent in hover, with a level base.

    Attributes:
        agent: Nominal parameters.
        posture: Joint positions [rad or m].
        yaw: Heading [rad].
        thrust: Thrust with its share of the payload [N].
    """

    agent: AerialManipulator
    posture: Float[Array, "n_r"]
    yaw: float
    thrust: float


def right_half_plane_zero(agent: AerialManipulator, posture: Float[Array, "n_r"], yaw: float, thrust: float) -> float:
    """Compute the zero `z = sqrt(u / (m l b))` of an agent's tangential force on the payload.

    `b = t^T D t` is the part of a tangential motion t of the tips that the center of mass has to follow
    (`redundancy.bound_directions`), for a level base and a level payload.

    Args:
        agent: Nominal parameters of one agent.
        posture: Joint positions [rad or m].
        yaw: Heading of the agent [rad].
        thrust: Thrust u in hover [N].

    Returns:
        The zero [rad/s]; infinite if the agent does not limit yaw, and without thrust.
    """
    p, D, _ = motion_about_tips(agent, posture, transfer(rotation_z(yaw)))
    height, c = -float(np.asarray(p.tip_from_com)[:, 2].mean()), np.asarray(agent.contact_position).mean(0)
    tangent = np.array([-c[1], c[0], 0.0]) / max(float(np.hypot(c[0], c[1])), np.finfo(float).tiny)
    lever = float(p.mass) * height * float(tangent @ np.asarray(D) @ tangent)
    return float(np.sqrt(thrust / lever)) if lever > 0 and thrust > 0 else np.inf


@jax.jit
def motion_about_tips(
    agent: AerialManipulator, posture: Float[Array, "n_r"], R: Float[Array, "3 3"]
) -> tuple[aerial_manipulator.CentroidalModel, Float[Array, "3 3"], Float[Array, "motion 3"]]:
    """Compute how an agent with a level base moves while its tips are fixed, as one compiled program.

    Args:
        agent: Nominal parameters of one agent.
        posture: Joint positions [rad or m].
        R: Attitude of the agent, body to world.

    Returns:
        Centroidal model, `redundancy.bound_directions` and `redundancy.rotation_about_tips`.
    """
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, posture))
    return p, redundancy.bound_directions(agent, p, R), redundancy.rotation_about_tips(agent, p)


def yaw_zero(team: Sequence[HoverAgent]) -> float:
    """Compute the smallest `right_half_plane_zero` of the agents whose mean contact is off the yaw axis.

    Args:
        team: Agents in hover.

    Returns:
        The zero [rad/s]; infinite if no agent limits yaw.
    """
    contacts = [np.asarray(each.agent.contact_position)[:, :2] for each in team]
    reach = max(np.linalg.norm(c, axis=1).max() for c in contacts)
    zeros = [
        right_half_plane_zero(*each)
        for each, c in zip(team, contacts, strict=True)
        if np.linalg.norm(c.mean(0)) > MIN_RADIUS_RATIO * reach
    ]
    return min(zeros, default=np.inf)


def acceleration_loop_gain(team: Sequence[HoverAgent], gains: tracking.Gains, payload_mass: float, g: float) -> float:
    """Compute the gain of the loop from the measured payload acceleration through the agents' attitudes back to it.

    `jerk` contains `-K_v a`. The attitude setpoint of each agent then has the angular velocity `-(e_3 x K_v a) / g`,
    and the agent an angular acceleration of k_w times that. With fixed tips its center of mass moves by X per rotation,
    which accelerates the payload. Horizontally, with `D` of `redundancy.bound_directions`,

        gain = norm(k_w / g (m_L I + sum m D)^-1 sum m X L hat(e_3) K_v),    L = I / (I + rho m l^2),

    where I is the inertia of the motion, l the norm of X, and `rho = m_L / (m_L + sum m)`. Equal agents with rigid
    hooks have the gain `k_w K_v m l L / u`. Above about 1 the loop is unstable at 40 to 110 rad/s.

    Args:
        team: Agents in hover.
        gains: Feedback gains.
        payload_mass: Mass of the payload [kg].
        g: Gravitational acceleration [m/s^2].

    Returns:
        The gain. Infinite without gravity, and for a posture with straight arms, where the rotation about the tips is
        not determined.
    """
    ratio = payload_mass / (payload_mass + sum(float(each.agent.mass.sum()) for each in team))
    inertial, rotation = payload_mass * np.eye(2), np.zeros((2, 2))
    for agent, posture, yaw, _ in team:
        R = rotation_z(yaw)
        p, D, motion = motion_about_tips(agent, posture, transfer(R))
        m, motion = float(p.mass), np.asarray(motion)
        xi = np.concatenate([np.eye(3), motion[3:]])
        inertia = np.diagonal(xi.T @ np.asarray(p.M_bar) @ xi)[:2]
        lever = np.linalg.norm(motion[:2, :2], axis=0)
        X = motion[:2, :2] * (inertia / (inertia + ratio * m * lever**2))
        inertial = inertial + m * np.asarray(D)[:2, :2]
        rotation = rotation + m * R[:2, :2] @ X @ R[:2, :2].T
    K_v = np.asarray(gains.K_v)[:2, :2]
    loop = np.linalg.solve(inertial, rotation) @ np.array([[0.0, -1.0], [1.0, 0.0]]) @ K_v
    if g == 0 or not np.isfinite(loop).all():
        return np.inf
    return float(gains.agent_k_omega) / g * float(np.linalg.norm(loop, 2))


def rotation_z(yaw: float) -> np.ndarray:
    """Return the rotation about the third axis.

    Args:
        yaw: Angle [rad].
    """
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


def default_yaw_gains(zero: float, k_R: float, k_omega: float) -> tuple[float, float]:
    """Limit yaw gains to values that a right half-plane zero permits.

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


def yaw_levers(team: Sequence[HoverAgent], R: np.ndarray) -> np.ndarray:
    """Compute the moments of contact forces about the vertical through each base, `e_z . (p x lam)`.

    Args:
        team: Agents.
        R: Payload attitude, payload to world.

    Returns:
        Levers for contact forces in the payload frame, contacts stacked, one row per agent [m].
    """
    levers, first = np.zeros((len(team), sum(at.agent.tree.arms for at in team), 3)), 0
    for row, at in zip(levers, team, strict=True):
        tips = np.asarray(aerial_manipulator.forward_kinematics(at.agent, at.posture).points[-at.agent.tree.arms :])
        row[first : first + len(tips)] = np.cross([0.0, 0.0, 1.0], tips @ rotation_z(at.yaw).T) @ R
        first += len(tips)
    return levers.reshape(len(team), -1)
