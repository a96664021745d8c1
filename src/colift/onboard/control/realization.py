"""What flies: the leader's wrench on SE(3), and how each agent realizes its contact forces."""

from __future__ import annotations

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.models import aerial_manipulator, inverse_dynamics
from colift.models.parameters import AerialManipulator
from colift.models.state import AgentInput, AgentState, GeneralizedForce, PayloadState
from colift.onboard.control.redundancy import _beyond_need, _inward, _leaned, _with_tips, _yielding
from colift.onboard.control.setpoints import AgentSetpoint, AttitudeSetpoint
from colift.onboard.control.tracking import AccelerationCommand, Gains


def agent_inputs(
    agent: AerialManipulator,
    gains: Gains,
    gravity: Float[Array, "3"],
    q: AgentState,
    payload: PayloadState,
    acceleration_cmd: AccelerationCommand,
    share: AgentSetpoint,
    f_hat: GeneralizedForce,
    turn: AttitudeSetpoint,
) -> AgentInput:
    """Thrust and torques that put `lam` on the payload if the thrust is aligned and the payload obeys.

    1. the thrust's direction and the heading are the attitude of `turn`, leaned as the posture asks (`_leaned`);
    2. `omega_dot = -k_R e_R - k_w e_w` towards it, and its own `R^T R_d omega_d_dot - w x R^T R_d omega_d` if known;
    3. `(x_dd, r_dd)` that keep the tips on the payload commanded to accelerate by `(a, alpha)`; joints that move
       neither tips nor the centre of mass give way to f_hat (`_yielding`);
    4. `u = f_des . R e_3` with `f_des = m (x_dd - a_g) + sum lam - f_hat_x`, torques by inverse dynamics.

    The command is not limited here: a limit is the vehicle's, and is reported where it acts.
    """
    g = aerial_manipulator.forward_kinematics(agent, q.r)
    p = aerial_manipulator.centroidal_model(agent, g)
    h, kappa = aerial_manipulator.bias_forces(agent, g, p, q.omega, q.r_dot)
    free = jnp.zeros(3 + agent.tree.joints)
    if _beyond_need(agent):
        turn, free = _leaned(agent, gains, gravity, q, acceleration_cmd, share, f_hat, p, turn)
    omega_dot = -gains.agent_k_R * so3.e_R(q.R, turn.R)
    omega_dot = omega_dot - gains.agent_k_omega * so3.e_omega(q.R, q.omega, turn.R, turn.omega)
    if turn.omega_dot is not None:
        to_body = q.R.T @ turn.R
        omega_dot = omega_dot + to_body @ turn.omega_dot - so3.cross(q.omega, to_body @ turn.omega)
    y = _with_tips(agent, payload, acceleration_cmd, p, kappa, q.R, omega_dot, free)
    if _inward(agent):
        y = y.at[3:].add(_yielding(agent, p, f_hat.f_r))
    f_des, Q, thrust = inverse_dynamics.agent_inverse_dynamics_reduced(
        p, h, q, q.R @ y[:3] - gravity, jnp.concatenate([omega_dot, y[3:]]), share.lam
    )
    u = ((f_des - f_hat.f_x) * q.R[:, 2]).sum()
    Q = Q - u * thrust
    return AgentInput(u=u, tau=Q[:3] - f_hat.f_w, tau_r=Q[3:] - f_hat.f_r)
