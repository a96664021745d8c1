"""Geometric tracking of the payload on SE(3), and the desired payload wrench.

References:
    Lee, Leok, McClamroch, *Geometric tracking control of a quadrotor UAV on SE(3)*, CDC 2010.
"""

from __future__ import annotations

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

    Rotational gains multiply the inertia, so that the error dynamics do not depend on it (docs/errata, row 6).
    """

    K_p: Float[Array, "3 3"]  # 1/s^2, payload position error, world
    K_v: Float[Array, "3 3"]  # 1/s, payload velocity error, world
    k_R: Float[Array, ""]  # 1/s^2, payload attitude error, K_R = k_R J_L
    k_omega: Float[Array, ""]  # 1/s, payload angular velocity error, K_omega = k_omega J_L
    agent_k_R: Float[Array, ""]  # 1/s^2, attitude error of an agent
    agent_k_omega: Float[Array, ""]  # 1/s, angular velocity error of an agent
    posture_bandwidth: Float[Array, ""]  # 1/s, rate at which redundant joints return to the nominal posture


@pytree
class AccelerationCommand:
    """Commanded acceleration of the payload."""

    a: Float[Array, "3"]  # m/s^2, world
    alpha: Float[Array, "3"]  # rad/s^2, payload frame
    jerk: Float[Array, "3"]  # m/s^3, rate of a, world


def tracking_acceleration(
    gains: Gains, q: PayloadState, a: Float[Array, "3"], setpoint: PayloadSetpoint
) -> AccelerationCommand:
    """Compute the payload acceleration of the geometric tracking law.

    `a_cmd = v_d_dot - K_p e_p - K_v e_v`, `alpha_cmd = -k_R e_R - k_w e_w - (w x R^T R_d w_d - R^T R_d w_d_dot)`,
    and `jerk = j_d - K_p e_v - K_v (a - a_d)`: the paper's wrench law (Eq. payload_force_cmd_learning,
    payload_torque_cmd_learning) as accelerations.

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
        jerk=setpoint.j - gains.K_p @ e_v - gains.K_v @ (a - setpoint.a),
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
