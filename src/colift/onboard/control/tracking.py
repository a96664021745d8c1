"""Geometric tracking of the payload on SE(3), and the desired payload wrench.

References:
    Lee, Leok, McClamroch, *Geometric tracking control of a quadrotor UAV on SE(3)*, CDC 2010.
"""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.pytree import pytree
from colift.models import inverse_dynamics
from colift.models.parameters import Payload
from colift.models.state import PayloadState, Wrench
from colift.trajectories.base import PayloadSetpoint


@pytree
class Gains:
    """Feedback gains of payload and agents.

    Rotational gains multiply the inertia, so that the error dynamics do not depend on it (docs/errata, row 6). The
    payload has one rotational gain per axis, because the bandwidth of yaw is limited by agents whose tips cannot move
    across the thrust (docs/theory, "Bound directions").
    """

    K_p: Float[Array, "3 3"]  # 1/s^2, payload position error, world
    K_v: Float[Array, "3 3"]  # 1/s, payload velocity error, world
    k_R: Float[Array, "3"]  # 1/s^2, payload attitude error by axis of the payload, K_R = k_R J_L
    k_omega: Float[Array, "3"]  # 1/s, payload angular velocity error by axis of the payload, K_omega = k_omega J_L
    jerk_feedback: Float[Array, ""]  # share of the measured acceleration in the jerk, 0 to 1 (`bound_tips`)
    agent_k_R: Float[Array, ""]  # 1/s^2, attitude error of an agent
    agent_k_omega: Float[Array, ""]  # 1/s, angular velocity error of an agent
    posture_bandwidth: Float[Array, ""]  # 1/s, rate at which redundant joints return to the nominal posture


@pytree
class AccelerationCommand:
    """Commanded acceleration of the payload."""

    a: Float[Array, "3"]  # m/s^2, world
    alpha: Float[Array, "3"]  # rad/s^2, payload frame
    jerk: Float[Array, "3"]  # m/s^3, rate of a, world
    alpha_dot: Float[Array, "3"] | None = None  # rad/s^3, rate of alpha, payload frame; None where it is neglected


def point_acceleration(
    q: PayloadState, acceleration_cmd: AccelerationCommand, c: Float[Array, "points 3"]
) -> Float[Array, "points 3"]:
    """Compute the accelerations of points of a payload that accelerates as commanded.

    `a + R_L (alpha x c + w x (w x c))`.

    Args:
        q: Estimated payload state.
        acceleration_cmd: Commanded payload acceleration.
        c: Points, relative to the center of mass [m, payload frame].

    Returns:
        Accelerations [m/s^2, world].
    """
    rotational = so3.cross(acceleration_cmd.alpha[None], c) + so3.cross(q.omega[None], so3.cross(q.omega[None], c))
    return acceleration_cmd.a[None] + rotational @ q.R.T


def point_jerk(
    q: PayloadState, acceleration_cmd: AccelerationCommand, c: Float[Array, "points 3"]
) -> Float[Array, "points 3"]:
    """Compute the rates of `point_acceleration`.

    `jerk + R_L (alpha_dot x c + alpha x (w x c) + w x (2 alpha x c + w x (w x c)))`; the rotational part is zero if
    `alpha_dot` is neglected.

    Args:
        q: Estimated payload state.
        acceleration_cmd: Commanded payload acceleration.
        c: Points, relative to the center of mass [m, payload frame].

    Returns:
        Jerks [m/s^3, world].
    """
    if acceleration_cmd.alpha_dot is None:
        return jnp.broadcast_to(acceleration_cmd.jerk, c.shape)
    w, alpha = q.omega[None], acceleration_cmd.alpha[None]
    velocity = so3.cross(w, c)
    rotational = (
        so3.cross(acceleration_cmd.alpha_dot[None], c)
        + so3.cross(alpha, velocity)
        + so3.cross(w, 2 * so3.cross(alpha, c) + so3.cross(w, velocity))
    )
    return acceleration_cmd.jerk[None] + rotational @ q.R.T


def tracking_acceleration(
    gains: Gains, q: PayloadState, a: Float[Array, "3"], setpoint: PayloadSetpoint
) -> AccelerationCommand:
    """Compute the payload acceleration of the geometric tracking law.

    `a_cmd = v_d_dot - K_p e_p - K_v e_v`, `alpha_cmd = -k_R e_R - k_w e_w - (w x R^T R_d w_d - R^T R_d w_d_dot)`,
    and `jerk = j_d - K_p e_v - s K_v (a - a_d)`: the paper's wrench law (Eq. payload_force_cmd_learning,
    payload_torque_cmd_learning) as accelerations. The share s is below 1 if agents that rotate move the payload so much
    that feedback of its acceleration would be unstable. `alpha_dot` is the rate of the reference's part only.

    Args:
        gains: Feedback gains.
        q: Estimated payload state.
        a: Estimated payload acceleration [m/s^2, world]; used for `jerk` only.
        setpoint: Desired payload pose with its derivatives.

    Returns:
        The acceleration command.
    """
    e_v = q.v - setpoint.v
    to_body = q.R.T @ setpoint.R
    feedforward = so3.cross(q.omega, to_body @ setpoint.omega) - to_body @ setpoint.omega_dot
    feedback = gains.k_R * so3.e_R(q.R, setpoint.R) + gains.k_omega * so3.e_omega(
        q.R, q.omega, setpoint.R, setpoint.omega
    )
    return AccelerationCommand(
        a=setpoint.a - gains.K_p @ (q.p - setpoint.p) - gains.K_v @ e_v,
        alpha=-feedback - feedforward,
        jerk=setpoint.j - gains.K_p @ e_v - gains.jerk_feedback * (gains.K_v @ (a - setpoint.a)),
        alpha_dot=None if setpoint.omega_ddot is None else to_body @ setpoint.omega_ddot,
    )


def desired_wrench(
    payload: Payload, gravity: Float[Array, "3"], q: PayloadState, acceleration_cmd: AccelerationCommand, f_hat: Wrench
) -> Wrench:
    """Compute the desired payload wrench by inverse dynamics.

    `F = m_L a_cmd - f_g - f_hat_p`, `tau = J_L alpha_cmd + w x J_L w - f_hat_w`. With `K_R = k_R J_L` and
    `K_omega = k_w J_L` these are Eq. payload_force_cmd_learning and payload_torque_cmd_learning.

    Args:
        payload: Nominal parameters of the payload.
        gravity: Gravitational acceleration [m/s^2, world].
        q: Estimated payload state.
        acceleration_cmd: Commanded payload acceleration.
        f_hat: Predicted residual of the payload [N world, N m payload frame].

    Returns:
        Desired wrench of the contact forces: force [N, world] and moment [N m, payload frame].
    """
    W = inverse_dynamics.payload_inverse_dynamics(
        payload, acceleration_cmd.a - gravity, acceleration_cmd.alpha, q.omega
    )
    return Wrench(F=W.F - f_hat.F, tau=W.tau - f_hat.tau)


def desired_wrench_rate(payload: Payload, q: PayloadState, acceleration_cmd: AccelerationCommand) -> Wrench:
    """Compute the rate of the desired payload wrench, without the rate of the predicted residual.

    `F_dot = m_L jerk`, `tau_dot = J_L alpha_dot + alpha x J_L w + w x J_L alpha`; the moment's rate is zero if
    `alpha_dot` is neglected.

    Args:
        payload: Nominal parameters of the payload.
        q: Estimated payload state.
        acceleration_cmd: Commanded payload acceleration.

    Returns:
        Rates of force [N/s, world] and moment [N m/s, payload frame].
    """
    F_dot = payload.mass * acceleration_cmd.jerk
    if acceleration_cmd.alpha_dot is None:
        return Wrench(F=F_dot, tau=jnp.zeros(3))
    J, alpha = payload.inertia, acceleration_cmd.alpha
    gyroscopic = so3.cross(alpha, J @ q.omega) + so3.cross(q.omega, J @ alpha)
    return Wrench(F=F_dot, tau=J @ acceleration_cmd.alpha_dot + gyroscopic)
