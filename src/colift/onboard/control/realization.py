"""Inputs with which one agent applies its commanded contact forces to the payload."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from colift.math import linalg, so3
from colift.models import aerial_manipulator, grasp, inverse_dynamics
from colift.models.parameters import AerialManipulator, Team
from colift.models.state import AgentInput, AgentState, GeneralizedForce, PayloadState
from colift.onboard.control.redundancy import (
    bound_directions,
    has_uncontrolled_joints,
    is_redundant,
    motion_with_tip_constraint,
    posture_control,
    tip_motion,
    uncontrolled_joint_acceleration,
)
from colift.onboard.control.setpoints import AgentSetpoint, AttitudeSetpoint
from colift.onboard.control.tracking import AccelerationCommand, Gains, point_acceleration


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
    deficit: Float[Array, "3"],
    steering: Float[Array, "3"] | None,
) -> AgentInput:
    """Compute thrust and torques that apply the commanded contact forces to the payload.

    The contact forces are exact if the thrust is aligned and the payload accelerates as commanded. Otherwise the
    contacts carry the commanded forces without `deficit`, and the torques balance these.

    1. For a redundant agent the posture control tilts the attitude setpoint (`posture_control`).
    2. `omega_dot = -k_R e_R - k_w e_w`, plus the feedforward `R^T R_d omega_d_dot - w x R^T R_d omega_d` if the
       setpoint contains `omega_d_dot`.
    3. `(x_dd, r_dd)` keep the tips on a payload that accelerates by `(a, alpha)`. Uncontrolled joints yield to `f_hat`
       (`uncontrolled_joint_acceleration`). Tips of open contacts return to their point (`open_contact_feedback`); the
       closed contacts bear what this motion requires across the thrust. Joints that move no closed contact have no
       compensation of `f_hat`.
    4. `u = f_des . R e_3` with `f_des = m (x_dd - a_g) + sum lam - f_hat_x`; torques by inverse dynamics for
       `lam - deficit / arms`, and for the limited thrust (`with_torques_for_limited_thrust`).

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
        deficit: Part of the sum of the commanded contact forces that the present attitude does not provide, across
            the thrust (`contact_force_deficits`) [N, world].
        steering: Acceleration of an agent without closed contacts in addition to the commanded one
            (`free_flight_acceleration`) [m/s^2, world]; None if no contact can open.

    Returns:
        Thrust [N], body torque [N m, body frame], joint torques or forces [N m or N]; thrust is not limited here, but
        the torques are those for a limited thrust.
    """
    g = aerial_manipulator.forward_kinematics(agent, q.r)
    p = aerial_manipulator.centroidal_model(agent, g)
    h, kappa = aerial_manipulator.bias_forces(agent, g, p, q.omega, q.r_dot)
    free = jnp.zeros(3 + agent.tree.joints)
    if is_redundant(agent):
        a_contact = point_acceleration(payload, acceleration_cmd, agent.contact_position).mean(0)
        attitude, free = posture_control(agent, gains, gravity, q, a_contact, setpoint, f_hat, p, attitude)
    omega_dot = attitude_feedback(gains, q, attitude.R, attitude.omega)
    if attitude.omega_dot is not None:
        to_body = q.R.T @ attitude.R
        omega_dot = omega_dot + to_body @ attitude.omega_dot - so3.cross(q.omega, to_body @ attitude.omega)
    y = motion_with_tip_constraint(agent, payload, acceleration_cmd, p, kappa, q.R, omega_dot, free)
    if has_uncontrolled_joints(agent):
        y = y.at[3:].add(uncontrolled_joint_acceleration(agent, p, f_hat.f_r))
    closed = agent.closed_contacts
    if closed is not None and steering is not None:
        back = tip_motion(agent, p, open_contact_feedback(agent, gains, p, q, payload, steering))
        y, deficit = y + back, deficit + p.mass * bound_directions(agent, p, q.R) @ (q.R @ back[:3])
        contacts = point_acceleration(payload, acceleration_cmd, agent.contact_position).mean(0)
        # In free flight, joints that do not follow must not lift or lower the agent.
        y = y.at[:3].set(jnp.where(closed.max() > 0, y[:3], (contacts + steering) @ q.R))
        moves_tip = agent.tree.ancestors[list(agent.tree.tip_bodies)].astype(float)
        supported = (closed[:, None] * moves_tip).max(0)  # joints that move a closed contact
        f_hat = dataclasses.replace(f_hat, f_r=supported * f_hat.f_r)
    xi_dot = jnp.concatenate([omega_dot, y[3:]])
    missing = deficit[None] / agent.tree.arms
    if closed is not None:
        missing = closed[:, None] * deficit[None] / jnp.maximum(1.0, closed.sum())
    lam = setpoint.lam - missing
    inputs = inputs_for_acceleration(p, h, q, q.R @ y[:3] - gravity, xi_dot, lam, f_hat)
    return with_torques_for_limited_thrust(agent, p, inputs)


def with_torques_for_limited_thrust(
    agent: AerialManipulator, p: aerial_manipulator.CentroidalModel, requested: AgentInput
) -> AgentInput:
    """Return the requested thrust and torques, with torques for a thrust up to the limit of the agent.

    The closed contacts share the thrust s above the limit, so that all accelerations remain those of the request::

        Q = Q_requested + s (J_base - mean_b J_b)^T e_3

    with the Jacobians of base and tips relative to the center of mass. With the torques of the request, the base of an
    agent with redundant joints would fall relative to its tips, and the arms would fold.

    Args:
        agent: Nominal parameters of one agent.
        p: Centroidal model of the agent.
        requested: Inputs without limits.
    """
    missing = requested.u - jnp.minimum(requested.u, agent.thrust_max)
    share = jnp.full(agent.tree.arms, 1 / agent.tree.arms)
    if (closed := agent.closed_contacts) is not None:
        share = closed / jnp.maximum(1.0, closed.sum())
    Q = missing * (p.J_base[2] - (share[:, None] * p.J_tip[:, 2]).sum(0))
    return dataclasses.replace(requested, tau=requested.tau + Q[:3], tau_r=requested.tau_r + Q[3:])


def open_contact_feedback(
    agent: AerialManipulator,
    gains: Gains,
    p: aerial_manipulator.CentroidalModel,
    q: AgentState,
    payload: PayloadState,
    steering: Float[Array, "3"],
) -> Float[Array, "arms 3"]:
    """Return the acceleration `-k_R phi - k_w phi_dot` of the tips of open contacts; zero for closed contacts.

    No contact holds such a tip, so inverse dynamics alone leaves its position without control. The attitude gains give
    the free arm the bandwidth of the base that carries it. The mean position of the tips of an agent without closed
    contacts accelerates by `steering`, since its center of mass must follow by a tilt of the thrust.

    Args:
        agent: Nominal parameters of one agent.
        gains: Feedback gains.
        p: Centroidal model of the agent.
        q: Estimated state of the agent.
        payload: Estimated state of the payload.
        steering: See `free_flight_acceleration` [m/s^2, world].

    Returns:
        Accelerations [m/s^2, body frame].
    """
    assert agent.contact_compliance is not None
    phi, phi_dot = grasp.contact_error(agent, p, q, payload), grasp.contact_error_rate(agent, p, q, payload)
    feedback = -gains.agent_k_R * phi - gains.agent_k_omega * phi_dot
    shared = steering @ q.R - feedback.mean(0)
    feedback = feedback + jnp.where((agent.contact_compliance > 0).all(), shared, 0.0)[None]
    return jnp.where(agent.contact_compliance[:, None] > 0, feedback, 0.0)


def free_flight_acceleration(
    agent: AerialManipulator,
    gains: Gains,
    q: AgentState,
    payload: PayloadState,
    acceleration_cmd: AccelerationCommand,
    reference: AccelerationCommand,
) -> Float[Array, "3"]:
    """Return the acceleration `-K_p phi - K_v phi_dot + d` of an agent without closed contacts; zero for others.

    phi is the mean distance of its tips from their contact points. An agent that flies free is steered as the payload:
    the direction of its thrust follows with the bandwidth of the attitude, and the gains of the payload's position are
    tuned for this bandwidth.

    Args:
        agent: Nominal parameters of one agent.
        gains: Feedback gains.
        q: Estimated state of the agent.
        payload: Estimated state of the payload.
        acceleration_cmd: Commanded payload acceleration.
        reference: Payload acceleration of the reference. d is the difference of both at the contacts: the commanded one
            contains feedback of the payload's error, which the agent must not follow.

    Returns:
        Acceleration in addition to the commanded one [m/s^2, world].
    """
    assert agent.contact_compliance is not None
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, q.r))
    phi, phi_dot = grasp.contact_error(agent, p, q, payload), grasp.contact_error_rate(agent, p, q, payload)
    feedback = -gains.K_p @ (q.R @ phi.mean(0)) - gains.K_v @ (q.R @ phi_dot.mean(0))
    wanted, commanded = (
        point_acceleration(payload, each, agent.contact_position).mean(0) for each in (reference, acceleration_cmd)
    )
    return jnp.where((agent.contact_compliance > 0).all(), feedback + wanted - commanded, 0.0)


def attitude_feedback(
    gains: Gains, q: AgentState, R_d: Float[Array, "3 3"], omega_d: Float[Array, "3"]
) -> Float[Array, "3"]:
    """Return the angular acceleration `-k_R e_R - k_w e_w` of an agent [rad/s^2, body frame].

    Args:
        gains: Feedback gains.
        q: Estimated state of the agent.
        R_d: Desired attitude, body to world.
        omega_d: Desired angular velocity [rad/s, desired body frame].
    """
    omega_dot = -gains.agent_k_R * so3.e_R(q.R, R_d)
    return omega_dot - gains.agent_k_omega * so3.e_omega(q.R, q.omega, R_d, omega_d)


def inputs_for_acceleration(
    p: aerial_manipulator.CentroidalModel,
    h: Float[Array, "xi"],
    q: AgentState,
    specific_force: Float[Array, "3"],
    xi_dot: Float[Array, "xi"],
    lam: Float[Array, "arms 3"],
    f_hat: GeneralizedForce,
) -> AgentInput:
    """Compute thrust and torques for an acceleration by inverse dynamics, with the thrust along the present attitude.

    Args:
        p: Centroidal model of the agent.
        h: Bias forces [N m, N].
        q: Estimated state of the agent.
        specific_force: `x_dd - a_g` of the center of mass [m/s^2, world].
        xi_dot: `(w_dot, r_dd)`, body frame [rad/s^2, m/s^2].
        lam: Contact forces on the payload [N, world].
        f_hat: Predicted residual of the agent.

    Returns:
        Thrust [N], body torque [N m, body frame], joint torques or forces [N m or N]; thrust is not limited here.
    """
    f_des, Q, thrust_torque = inverse_dynamics.agent_inverse_dynamics_reduced(p, h, q, specific_force, xi_dot, lam)
    u = ((f_des - f_hat.f_x) * q.R[:, 2]).sum()
    Q = Q - u * thrust_torque
    return AgentInput(u=u, tau=Q[:3] - f_hat.f_w, tau_r=Q[3:] - f_hat.f_r)


def limit_thrust(group: AerialManipulator, requested: AgentInput) -> tuple[AgentInput, Bool[Array, "agents"]]:
    """Limit the thrusts of a group to the range of the rotors, and return the agents whose thrust was limited.

    Args:
        group: Nominal parameters of the group.
        requested: Requested inputs.
    """
    u = jnp.clip(requested.u, 0.0, group.thrust_max)
    return AgentInput(u=u, tau=requested.tau, tau_r=requested.tau_r), u != requested.u


def contact_force_deficits(
    team: Team,
    agents: tuple[AgentState, ...],
    payload: PayloadState,
    thrust: tuple[Float[Array, "agents 3"], ...],
) -> tuple[Float[Array, "agents 3"], ...]:
    """Compute the parts of the commanded contact forces that the agents' present attitudes do not provide.

    Along a bound direction (`redundancy.bound_directions`, matrix `D`) the center of mass follows the tips. An agent
    whose thrust is not aligned with the desired thrust f then lacks the force `D f`. The acceleration of the payload
    differs by d from the commanded one. With `P = [I, -R_L hat(c)]` for the mean contact c of an agent:

        deficit = D (f + m P d),    (M_L + sum m P^T (D + b_3 b_3^T) P) d = -sum P^T D f,    M_L = diag(m_L I, J_L).

    Along the thrust the center of mass also follows the tips, which adds `b_3 b_3^T` to the inertia.

    Inertial forces of rotations by which the agents correct their attitudes are not included: they would act on the
    payload against the intended direction.

    Args:
        team: Nominal parameters.
        agents: Estimated states of the agents.
        payload: Estimated state of the payload.
        thrust: Desired thrust vectors of the agents [N, world].

    Returns:
        Deficits of the sum of each agent's contact forces [N, world].

    See Also:
        docs/theory.md: derivation, and the limit of the bandwidth along bound directions.
    """
    A = jnp.zeros((6, 6)).at[:3, :3].set(team.payload.mass * jnp.eye(3)).at[3:, 3:].set(team.payload.inertia)
    B = jnp.zeros(6)

    def terms(
        agent: AerialManipulator, q: AgentState, f: Float[Array, "3"]
    ) -> tuple[Float[Array, "3"], Float[Array, "3 6"], Float[Array, "6 6"], Float[Array, "3 6"]]:
        p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, q.r))
        D = bound_directions(agent, p, q.R)
        P = jnp.concatenate([jnp.eye(3), -payload.R @ so3.hat(agent.contact_position.mean(0))], axis=1)
        inertia = p.mass * P.T @ (D + q.R[:, 2, None] * q.R[None, :, 2]) @ P
        if agent.closed_contacts is not None:  # an agent without closed contacts does not act on the payload
            inertia, D = agent.closed_contacts.max() * inertia, agent.closed_contacts.max() * D
        return D @ f, p.mass * D @ P, inertia, P

    groups = [jax.vmap(terms)(*each) for each in zip(team.agent_groups, agents, thrust, strict=True)]
    for misaligned, _, inertia, P in groups:
        A = A + inertia.sum(0)
        B = B - jnp.einsum("aki,ak->i", P, misaligned)
    d = linalg.solve(A, B[:, None])[:, 0]
    return tuple(misaligned + inertial @ d for misaligned, inertial, _, _ in groups)
