"""Inputs with which one agent applies its commanded contact forces to the payload."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.models import aerial_manipulator, inverse_dynamics
from colift.models.parameters import AerialManipulator
from colift.models.state import AgentInput, AgentState, GeneralizedForce, PayloadState
from colift.onboard.control.redundancy import (
    has_uncontrolled_joints,
    is_redundant,
    motion_with_tip_constraint,
    posture_control,
    uncontrolled_joint_acceleration,
)
from colift.onboard.control.setpoints import AgentSetpoint, AttitudeSetpoint
from colift.onboard.control.tracking import AccelerationCommand, Gains


def agent_inputs(
    agent: AerialManipulator,
    gains: Gains,
    gravity: Float[Array, "3"],
    q: AgentState,
    payload: PayloadState,
    acceleration_cmd: AccelerationCommand,
    setpoint: AgentSetpoint,
    f_hat: GeneralizedForce,
    attitude: AttitudeSetpoint,
) -> AgentInput:
    """Compute thrust and torques that apply the commanded contact forces to the payload.

    The contact forces are exact if the thrust is aligned and the payload accelerates as commanded.

    1. For a redundant agent the posture control tilts the attitude setpoint (`posture_control`).
    2. `omega_dot = -k_R e_R - k_w e_w`, plus the feedforward `R^T R_d omega_d_dot - w x R^T R_d omega_d` if the
       setpoint contains `omega_d_dot`.
    3. `(x_dd, r_dd)` keep the tips on a payload that accelerates by `(a, alpha)`. Uncontrolled joints yield to `f_hat`
       (`uncontrolled_joint_acceleration`).
    4. `u = f_des . R e_3` with `f_des = m (x_dd - a_g) + sum lam - f_hat_x`; torques by inverse dynamics.

    Args:
        agent: Nominal parameters of one agent.
        gains: Feedback gains.
        gravity: Gravitational acceleration [m/s^2, world].
        q: Estimated state of the agent.
        payload: Estimated state of the payload.
        acceleration_cmd: Commanded payload acceleration.
        setpoint: Contact forces, heading and posture.
        f_hat: Predicted residual of the agent.
        attitude: Attitude setpoint.

    Returns:
        Thrust [N], body torque [N m, body frame], joint torques or forces [N m or N]; thrust is not limited here.
    """
    g = aerial_manipulator.forward_kinematics(agent, q.r)
    p = aerial_manipulator.centroidal_model(agent, g)
    h, kappa = aerial_manipulator.bias_forces(agent, g, p, q.omega, q.r_dot)
    free = jnp.zeros(3 + agent.tree.joints)
    if is_redundant(agent):
        attitude, free = posture_control(agent, gains, gravity, q, acceleration_cmd, setpoint, f_hat, p, attitude)
    omega_dot = -gains.agent_k_R * so3.e_R(q.R, attitude.R)
    omega_dot = omega_dot - gains.agent_k_omega * so3.e_omega(q.R, q.omega, attitude.R, attitude.omega)
    if attitude.omega_dot is not None:
        to_body = q.R.T @ attitude.R
        omega_dot = omega_dot + to_body @ attitude.omega_dot - so3.cross(q.omega, to_body @ attitude.omega)
    y = motion_with_tip_constraint(agent, payload, acceleration_cmd, p, kappa, q.R, omega_dot, free)
    if has_uncontrolled_joints(agent):
        y = y.at[3:].add(uncontrolled_joint_acceleration(agent, p, f_hat.f_r))
    f_des, Q, thrust_torque = inverse_dynamics.agent_inverse_dynamics_reduced(
        p, h, q, q.R @ y[:3] - gravity, jnp.concatenate([omega_dot, y[3:]]), setpoint.lam
    )
    u = ((f_des - f_hat.f_x) * q.R[:, 2]).sum()
    Q = Q - u * thrust_torque
    return AgentInput(u=u, tau=Q[:3] - f_hat.f_w, tau_r=Q[3:] - f_hat.f_r)
