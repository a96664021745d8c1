"""What flies: the leader's wrench on SE(3), and how each agent realizes its contact forces."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math import linalg, so3
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator
from colift.models.state import AgentState, GeneralizedForce, PayloadState
from colift.onboard.control.attitude import attitude_from_thrust
from colift.onboard.control.setpoints import AgentSetpoint, AttitudeSetpoint
from colift.onboard.control.tracking import AccelerationCommand, Gains


def _with_tips(
    agent: AerialManipulator,
    payload: PayloadState,
    acceleration_cmd: AccelerationCommand,
    p: aerial_manipulator.CentroidalModel,
    kappa: Float[Array, "arms 3"],
    R: Float[Array, "3 3"],
    omega_dot: Float[Array, "3"],
    free: Float[Array, "motion"],
) -> Float[Array, "motion"]:
    """`(R^T x_dd, r_dd)` of an agent at attitude R that turns by `omega_dot` while its tips follow the payload.

    `R^T x_dd + B xi_dot + kappa = R^T (a + R_L (alpha x c + w x (w x c)))`; what that leaves open is as in `free`.
    """
    c = agent.contact_position
    carried = so3.cross(acceleration_cmd.alpha[None], c) + so3.cross(
        payload.omega[None], so3.cross(payload.omega[None], c)
    )
    target = (
        (acceleration_cmd.a[None] + carried @ payload.R.T) @ R
        - kappa
        - (p.J_tip[:, :, :3] * omega_dot[None, None]).sum(2)
    )
    return _nearest(p, _yields(agent), free[:, None], target.reshape(-1, 1))[:, 0]


# Joints beyond need ---------------------------------------------------------------------------------------------------

# How readily the centre of mass gives way, by axis of the base, where a joint does by 1 rad^2: 1 cm or 10 m squared.
WEIGHT_TIP_TASK = np.ones(3)  # of no effect where joints are just enough
WEIGHT_THRUST_TASK = np.array(
    [1e-4, 1e-4, 1e2]
)  # the thrust has its size at will, its direction only as the agent turns
WEIGHT_JOINT_TASK = np.full(3, 1e2)


def _beyond_need(agent: AerialManipulator) -> bool:
    """Whether tips and attitude leave joints free, `n_r > 3 n - 3`."""
    return agent.tree.joints > 3 * agent.tree.arms - 3


def _yields(agent: AerialManipulator) -> np.ndarray:
    """How readily an agent's centre of mass gives way as its tips are led."""
    return WEIGHT_THRUST_TASK if _beyond_need(agent) else WEIGHT_TIP_TASK


ROUNDING = 1e-12  # of a tip's mobility, where joints move it no way


def _inward(agent: AerialManipulator) -> bool:
    """Whether joints can move with tips and centre of mass at rest, `n_r > 3 n`."""
    return agent.tree.joints > 3 * agent.tree.arms


def _yielding(
    agent: AerialManipulator, p: aerial_manipulator.CentroidalModel, f_r: Float[Array, "n_r"]
) -> Float[Array, "n_r"]:
    """How joint torques accelerate joints as far as that moves neither tips nor the centre of mass, rad/s^2.

    `z = H^-1 (f_r - B^T (B H^-1 B^T)^-1 B H^-1 f_r)`, so that `B z = 0`, with H the joints' inertia. Links that weigh
    grams, and nothing else, move so; the posture leads them back by `H k^2`, some mN m a radian. An error of what is
    learned would turn them by radians: they give way to it in place of being held against it. Joints about parallel
    axes move a tip in a plane alone; what cannot move it otherwise is none of B's.
    """
    B, H = p.J_tip[:, :, 3:].reshape(3 * agent.tree.arms, -1), p.M_bar[3:, 3:]
    moved = linalg.solve(H, jnp.concatenate([B.T, f_r[:, None]], axis=1))
    by_tips, by_torque = moved[:, :-1], moved[:, -1]
    A = B @ by_tips
    A = A + ROUNDING * jnp.trace(A) * jnp.eye(len(A))  # a planar arm moves its tip in a plane
    return by_torque - by_tips @ linalg.solve(A, (B @ by_torque)[:, None])[:, 0]


def posture_tilt_jacobian(agent: AerialManipulator, p: aerial_manipulator.CentroidalModel) -> Float[Array, "n_r 3"]:
    """How joints move as the agent turns with its tips held, and as little else of it as can be, rad or m a rad."""
    return _nearest(p, _yields(agent), jnp.zeros((3 + agent.tree.joints, 3)), -p.J_tip[:, :, :3].reshape(-1, 3))[3:]


def _nearest(
    p: aerial_manipulator.CentroidalModel,
    yields: np.ndarray,
    free: Float[Array, "motion k"],
    tips: Float[Array, "forces k"],
) -> Float[Array, "motion k"]:
    """`y = free + S J^T (J S J^T)^-1 (tips - J free)`: the motion `(R^T x, r)` nearest to `free` that moves tips so."""
    n, joints = p.J_tip.shape[0], free.shape[0] - 3
    J = jnp.concatenate([jnp.tile(jnp.eye(3), (n, 1)), p.J_tip[:, :, 3:].reshape(3 * n, joints)], axis=1)
    S_JT = np.concatenate([yields, np.ones(joints)])[:, None] * J.T
    return free + S_JT @ linalg.solve(J @ S_JT, tips - J @ free)


POSTURE_DAMPING = (
    0.8  # of the posture; what its loop is late by adds to it, and beyond one a joint returns ever more slowly
)


def _leaned(
    agent: AerialManipulator,
    gains: Gains,
    gravity: Float[Array, "3"],
    q: AgentState,
    acceleration_cmd: AccelerationCommand,
    share: AgentSetpoint,
    f_hat: GeneralizedForce,
    p: aerial_manipulator.CentroidalModel,
    turn: AttitudeSetpoint,
) -> tuple[AttitudeSetpoint, Float[Array, "motion"]]:
    """The turn with the lean that moves the centre of mass over the tips, and the motion that joints and thrust allow.

    `r_dd = -k^2 e - 2 d k e_dot`, `e = r - rest - r_tilt`, d `DAMPING`: `r_tilt` are the joints that hold the centre of
    mass where it is while the agent is off `turn`. It is what tips and posture make of it that leans, `f + m x_dd`, and
    its rate; joints move as the thrust of this moment moves it, so that contact forces need not. (Led by the joints'
    own errors the loop would have the swing about the tips as a zero in the right half plane.)
    """
    k, m = gains.posture_bandwidth, p.mass
    off = jnp.stack([so3.e_R(q.R, turn.R), so3.e_omega(q.R, q.omega, turn.R, turn.omega)], axis=1)
    still = jnp.zeros((3 + agent.tree.joints, 2))
    tilt = posture_tilt_jacobian(agent, p) @ off
    e, e_dot = q.r - share.nominal_posture - tilt[:, 0], q.r_dot - tilt[:, 1]
    r_dd = -(k**2) * e - 2 * POSTURE_DAMPING * k * e_dot
    a = q.R.T @ acceleration_cmd.a
    across = q.R.T @ (gravity + (f_hat.f_x - share.lam.sum(0)) / m)  # what forces but the thrust's give
    x_dd = jnp.concatenate([across[:2], a[2:]])
    fixed = jnp.zeros((3 * agent.tree.arms, 1))
    e_dd = _nearest(p, WEIGHT_THRUST_TASK, jnp.concatenate([x_dd - a, r_dd])[:, None], fixed)[3:, 0]
    requested = still.at[3:].set(jnp.stack([r_dd, -(k**2) * e_dot - 2 * POSTURE_DAMPING * k * e_dd], axis=1))
    lift = m * q.R @ _nearest(p, WEIGHT_JOINT_TASK, requested, jnp.tile(fixed, (1, 2)))[:3]
    size = (m * (acceleration_cmd.a - gravity) + share.lam.sum(0) - f_hat.f_x) @ turn.R[:, 2]
    f, f_dot = size * turn.R[:, 2], size * turn.R @ so3.cross(turn.omega, jnp.asarray(aerial_manipulator.E3))
    R, R_dot = jax.jvp(lambda f: attitude_from_thrust(f, share.yaw), (f + lift[:, 0],), (f_dot + lift[:, 1],))
    return dataclasses.replace(turn, R=R, omega=so3.vee(R.T @ R_dot)), jnp.concatenate([x_dd, r_dd])
