"""What flies: the leader's wrench on SE(3), and how each agent realizes its contact forces."""

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
    """Feedback gains. Rotational ones multiply the inertia, so error dynamics are free of it (errata, row 6)."""

    K_p: Float[Array, "3 3"]  # 1/s^2
    K_v: Float[Array, "3 3"]  # 1/s
    k_R: Float[Array, ""]  # 1/s^2, K_R = k_R J_L
    k_omega: Float[Array, ""]  # 1/s, K_omega = k_omega J_L
    agent_k_R: Float[Array, ""]  # 1/s^2
    agent_k_omega: Float[Array, ""]  # 1/s
    posture_bandwidth: Float[Array, ""]  # 1/s, rate at which joints that contacts leave free return to rest


@pytree
class AccelerationCommand:
    """How the leader wants the payload to accelerate."""

    a: Float[Array, "3"]  # m/s^2, world
    alpha: Float[Array, "3"]  # rad/s^2, payload frame
    jerk: Float[Array, "3"]  # m/s^3, rate of a


def tracking_acceleration(
    gains: Gains, q: PayloadState, a: Float[Array, "3"], setpoint: PayloadSetpoint
) -> AccelerationCommand:
    """Geometric tracking on SE(3), as accelerations.

    `a_cmd = v_d_dot - K_p e_p - K_v e_v`, `alpha_cmd = -k_R e_R - k_w e_w - (w x R^T R_d w_d - R^T R_d w_d_dot)`.
    `a` is the measured payload acceleration; it shapes only `jerk = j_d - K_p e_v - K_v (a - a_d)`.
    """
    e_v = q.v - setpoint.v
    to_body = q.R.T @ setpoint.R
    carried = so3.cross(q.omega, to_body @ setpoint.omega) - to_body @ setpoint.omega_dot
    turn = gains.k_R * so3.e_R(q.R, setpoint.R) + gains.k_omega * so3.e_omega(q.R, q.omega, setpoint.R, setpoint.omega)
    return AccelerationCommand(
        a=setpoint.a - gains.K_p @ (q.p - setpoint.p) - gains.K_v @ e_v,
        alpha=-turn - carried,
        jerk=setpoint.j - gains.K_p @ e_v - gains.K_v @ (a - setpoint.a),
    )


def desired_wrench(
    payload: Payload, gravity: Float[Array, "3"], q: PayloadState, acceleration_cmd: AccelerationCommand, f_hat: Wrench
) -> Wrench:
    """The desired payload wrench (Eq. payload_force_cmd_learning, payload_torque_cmd_learning).

    `F = m_L a_cmd - f_g - f_hat_p`, `tau = J_L alpha_cmd + w x J_L w - f_hat_w`; with `K_R = k_R J_L`,
    `K_omega = k_w J_L` these are the paper's.
    """
    W = inverse_dynamics.payload_inverse_dynamics(
        payload, acceleration_cmd.a - gravity, acceleration_cmd.alpha, q.omega
    )
    return Wrench(F=W.F - f_hat.F, tau=W.tau - f_hat.tau)
