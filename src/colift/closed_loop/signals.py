"""Signals of one tick for the log: true state, inputs, errors, contact forces and residuals.

See Also:
    colift.closed_loop.log_signals: names, units and frames of the signals in the log.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from colift.math import so3
from colift.math.pytree import pytree
from colift.models import aerial_manipulator, grasp, inverse_dynamics
from colift.models.parameters import AerialManipulator, Team
from colift.models.state import AgentInput, AgentState, GeneralizedForce, ResidualForces, State, TeamInputs, Wrench
from colift.onboard import interfaces
from colift.onboard.learning import residual_correction
from colift.simulation import contact_dynamics
from colift.simulation.world import GroundTruth

Scalar = Float[Array, ""]


@pytree
class StepRecord:
    """Logged signals of one tick; agents, joints and contacts of all groups are concatenated.

    `colift.closed_loop.log_signals` defines unit, frame and meaning of each field. A wrench, and the payload
    acceleration `a_L`, are one field of six numbers; the log splits them. Fields that only some controllers provide are
    None otherwise.
    """

    t: Float[Array, "*time"]  # s, time of the tick
    p: Float[Array, "*time 3"]  # m, payload position, world
    v: Float[Array, "*time 3"]  # m/s, payload velocity, world
    R_L: Float[Array, "*time 3 3"]  # payload attitude, payload to world
    omega_L: Float[Array, "*time 3"]  # rad/s, payload angular velocity, payload frame
    a_L: Float[Array, "*time 6"]  # m/s^2 and rad/s^2, payload acceleration, world and payload frame
    p_d: Float[Array, "*time 3"]  # m, desired payload position, world
    e_p: Float[Array, "*time 3"]  # m, position error, world
    e_v: Float[Array, "*time 3"]  # m/s, velocity error, world
    e_R: Float[Array, "*time 3"]  # attitude error, payload frame
    e_omega: Float[Array, "*time 3"]  # rad/s, angular velocity error, payload frame
    Psi: Float[Array, "*time"]  # attitude error function
    R: Float[Array, "*time agents 3 3"]  # base attitudes, base to world
    x: Float[Array, "*time agents 3"]  # m, centers of mass of the agents, world
    omega: Float[Array, "*time agents 3"]  # rad/s, base angular velocities, base frame
    v_agent: Float[Array, "*time agents 3"]  # m/s, velocities of the centers of mass, world
    r: Float[Array, "*time joints"]  # rad or m, joint positions
    r_dot: Float[Array, "*time joints"]  # rad/s or m/s, joint rates
    u: Float[Array, "*time agents"]  # N, applied thrusts
    tau: Float[Array, "*time agents 3"]  # N m, applied body torques, base frame
    tau_r: Float[Array, "*time joints"]  # N m or N, applied joint torques
    thrust_saturated: Bool[Array, "*time agents"]  # True if the thrust is at its limit
    lam: Float[Array, "*time contacts 3"]  # N, contact forces on the payload, world
    lam_cmd: Float[Array, "*time contacts 3"]  # N, commanded contact forces, world
    lam_hat: Float[Array, "*time contacts 3"]  # N, contact forces as measured or reconstructed, world
    R_L_hat: Float[Array, "*time 3 3"]  # estimated payload attitude, payload to world
    W_d: Float[Array, "*time 6"]  # N world and N m payload frame, desired wrench
    delta_W: Float[Array, "*time 6"]  # N world and N m payload frame, wrench mismatch
    eta: Float[Array, "*time eta"]  # N, coordinates of the commanded internal forces
    f_L: Float[Array, "*time 6"]  # N world and N m payload frame, true payload residual
    f_L_hat: Float[Array, "*time 6"]  # its prediction
    f_x: Float[Array, "*time agents 3"]  # N, true residual forces on the agents, world
    f_w: Float[Array, "*time agents 3"]  # N m, true residual moments, base frame
    f_r: Float[Array, "*time joints"]  # N m or N, true residual joint torques
    f_x_hat: Float[Array, "*time agents 3"]  # their prediction
    f_w_hat: Float[Array, "*time agents 3"]  # their prediction
    f_r_hat: Float[Array, "*time joints"]  # their prediction
    Phi: Float[Array, "*time"]  # m, largest constraint violation
    Phi_dot: Float[Array, "*time"]  # m/s, largest constraint rate
    min_delassus_singular_value: Float[Array, "*time agents"]  # 1/kg, smallest singular value of `A M^-1 A^T` by agent
    # Only for estimates of the contact forces without tip force sensors
    lam_std: Float[Array, "*time contacts 3"] | None = None  # N, standard deviation of lam_hat, world
    delta_W_hat: Float[Array, "*time 6"] | None = None  # N world and N m payload frame, estimated wrench mismatch
    delta_W_std: Float[Array, "*time 6"] | None = None  # N and N m, its standard deviation
    # Only for controllers with a residual corrector
    correction_L: Float[Array, "*time 6"] | None = None  # N, N m, correction of the payload, as applied
    correction_x: Float[Array, "*time agents 3"] | None = None  # N, correction of the agents, as applied
    correction_std_L: Float[Array, "*time 6"] | None = None  # N, N m, standard deviation with correction
    correction_std_x: Float[Array, "*time agents 3"] | None = None  # N, standard deviation of the agents
    correction_weight_L: Float[Array, "*time 6"] | None = None  # applied share of the estimated model error
    correction_weight_x: Float[Array, "*time agents 3"] | None = None  # applied share of the agents
    label_L: Float[Array, "*time 6"] | None = None  # N, N m, payload label before the label filter
    label_x: Float[Array, "*time agents 3"] | None = None  # N, labels of the agents before the label filter
    model_prediction_L: Float[Array, "*time 6"] | None = None  # N, N m, prediction without correction
    model_prediction_x: Float[Array, "*time agents 3"] | None = None  # N, prediction of the agents
    label_valid: Float[Array, "*time"] | None = None  # 1 in periods with recent tip readings, otherwise 0
    correction_nis: Float[Array, "*time"] | None = (
        None  # normalized innovation squared, mean of the outputs with a label
    )
    # Only for allocators with limits
    slack_roll_pitch: Float[Array, "*time"] | None = None  # N, moment over its lever
    slack_z: Float[Array, "*time"] | None = None  # N
    slack_xy: Float[Array, "*time"] | None = None  # N
    slack_yaw: Float[Array, "*time"] | None = None  # N, moment over its lever
    allocation_primal: Float[Array, "*time"] | None = None  # N, primal residual of the allocation
    allocation_dual: Float[Array, "*time"] | None = None  # N, dual residual of the allocation
    tilt_limited: Bool[Array, "*time agents"] | None = None  # True if the thrust direction is at its limit
    thrust_limited: Bool[Array, "*time agents"] | None = None  # True if the allocated thrust is at its limit
    friction_limited: Bool[Array, "*time contacts"] | None = None  # True if the force is at the friction cone
    force_limited: Bool[Array, "*time contacts"] | None = None  # True if the force is at its limit
    effectiveness: Float[Array, "*time agents"] | None = None  # rotor effectiveness that the controller compensates
    # Only for contacts that bear moments
    contact_moment: Float[Array, "*time contacts 3"] | None = None  # N m, on the payload, payload frame


def true_residual(
    nominal: Team, team_state: State, a: contact_dynamics.Acceleration, lam: tuple, inputs: TeamInputs
) -> ResidualForces:
    """Compute the residual of the nominal equations of motion for true accelerations: the labels without any error.

    The result equals `f_uk` if the nominal parameters are correct. Otherwise it includes the mismatch of mass and
    inertia.

    Args:
        nominal: Nominal parameters.
        team_state: True state.
        a: True accelerations.
        lam: True contact forces on the payload [N, world], by group.
        inputs: Applied inputs, by group.

    Returns:
        Residual forces on agents and payload.
    """
    q, g = team_state.payload, nominal.gravity
    W = grasp.payload_wrench(grasp.contact_points(nominal), q.R, grasp.stack_contacts(lam))
    required = inverse_dynamics.payload_inverse_dynamics(nominal.payload, a.payload[:3] - g, a.payload[3:], q.omega)
    agents = tuple(
        jax.vmap(_agent_residual, in_axes=(0, 0, 0, 0, 0, None))(group, state, a_j, lam_j, u, g)
        for group, state, a_j, lam_j, u in zip(
            nominal.agent_groups, team_state.agents, a.agents, lam, inputs, strict=True
        )
    )
    tau = required.tau - W.tau
    if a.contact_moments is not None:
        tau = tau - grasp.stack_contacts(a.contact_moments).sum(0)
        agents = tuple(
            _with_contact_moments(group, state, f, m, q.R)
            for group, state, f, m in zip(
                nominal.agent_groups, team_state.agents, agents, a.contact_moments, strict=True
            )
        )
    return ResidualForces(agents=agents, payload=Wrench(F=required.F - W.F, tau=tau))


def _with_contact_moments(
    group: AerialManipulator,
    states: AgentState,
    f: GeneralizedForce,
    moments: Float[Array, "agents arms 3"],
    R_L: Float[Array, "3 3"],
) -> GeneralizedForce:
    """Add the effect of contact moments on the payload [N m, payload frame] to the forces that a group must apply."""

    def one_agent(
        agent: AerialManipulator, q: AgentState, m: Float[Array, "arms 3"]
    ) -> tuple[Float[Array, "3"], Float[Array, "n_r"]]:
        p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, q.r))
        load = inverse_dynamics.contact_moment_load(agent, p, m @ (R_L.T @ q.R))
        return load[:3], load[3:]

    w, r = jax.vmap(one_agent)(group, states, moments)
    return GeneralizedForce(f_x=f.f_x, f_w=f.f_w + w, f_r=f.f_r + r)


def _applied_wrench(nominal: Team, truth: GroundTruth, telemetry: interfaces.Telemetry) -> Wrench:
    """Return the wrench of the true contact forces at the attitude that the allocator used.

    `delta_W = G e_lam` then holds exactly for point contacts. Moments of contacts are added.
    """
    R, lam = telemetry.estimate.payload.R, grasp.stack_contacts(truth.lam)
    W, moments = grasp.payload_wrench(grasp.contact_points(nominal), R, lam), truth.acceleration.contact_moments
    return W if moments is None else Wrench(F=W.F, tau=W.tau + grasp.stack_contacts(moments).sum(0))


def _agent_residual(
    agent: AerialManipulator,
    q: AgentState,
    a: contact_dynamics.AgentAcceleration,
    lam: Float[Array, "arms 3"],
    u: AgentInput,
    gravity: Float[Array, "3"],
) -> GeneralizedForce:
    """Compute the residual of the nominal equations of motion of one agent."""
    force, Q, thrust = inverse_dynamics.agent_inverse_dynamics(agent, q, a.v_dot - gravity, a.xi_dot, lam)
    Q = Q - jnp.concatenate([u.tau, u.tau_r]) - u.u * thrust
    return GeneralizedForce(f_x=force - u.u * q.R[:, 2], f_w=Q[:3], f_r=Q[3:])


def make_record(
    team: Team, nominal: Team, t: Scalar, truth: GroundTruth, telemetry: interfaces.Telemetry
) -> StepRecord:
    """Assemble the record of one tick.

    Args:
        team: True parameters; those of the ground truth apply if it has some.
        nominal: Nominal parameters of the controller.
        t: Time of the tick [s].
        truth: True quantities at the start of the tick.
        telemetry: Intermediate results of the controller.

    Returns:
        The record.
    """
    team = team if truth.team is None else truth.team
    z, a, inputs = truth.state, truth.acceleration, truth.inputs
    q, d = z.payload, telemetry.setpoint
    force = grasp.stack_contacts(truth.lam)
    W = _applied_wrench(nominal, truth, telemetry)
    f = true_residual(nominal, z, a, truth.lam, inputs)
    f_hat = telemetry.f_hat
    vec = lambda W: jnp.concatenate([W.F, W.tau])  # noqa: E731
    agents = lambda parts: jnp.concatenate(list(parts))  # noqa: E731
    joints = lambda parts: jnp.concatenate([x.reshape(-1) for x in parts])  # noqa: E731
    return StepRecord(
        t=t,
        p=q.p,
        v=q.v,
        R_L=q.R,
        omega_L=q.omega,
        a_L=a.payload,
        p_d=d.p,
        e_p=q.p - d.p,
        e_v=q.v - d.v,
        e_R=so3.e_R(q.R, d.R),
        e_omega=so3.e_omega(q.R, q.omega, d.R, d.omega),
        Psi=so3.attitude_error_function(q.R, d.R),
        R=agents(s.R for s in z.agents),
        x=agents(s.x for s in z.agents),
        omega=agents(s.omega for s in z.agents),
        v_agent=agents(s.v for s in z.agents),
        r=joints(s.r for s in z.agents),
        r_dot=joints(s.r_dot for s in z.agents),
        u=agents(u.u for u in inputs),
        tau=agents(u.tau for u in inputs),
        tau_r=joints(u.tau_r for u in inputs),
        thrust_saturated=agents(telemetry.saturated),
        lam=force,
        lam_cmd=telemetry.lam_cmd,
        lam_hat=grasp.stack_contacts(telemetry.estimate.lam),
        R_L_hat=telemetry.estimate.payload.R,
        W_d=vec(telemetry.W_d),
        delta_W=vec(W) - vec(telemetry.W_d),
        eta=telemetry.eta,
        f_L=vec(f.payload),
        f_L_hat=vec(f_hat.payload),
        f_x=agents(x.f_x for x in f.agents),
        f_w=agents(x.f_w for x in f.agents),
        f_r=joints(x.f_r for x in f.agents),
        f_x_hat=agents(x.f_x for x in f_hat.agents),
        f_w_hat=agents(x.f_w for x in f_hat.agents),
        f_r_hat=joints(x.f_r for x in f_hat.agents),
        Phi=jnp.abs(grasp.constraint_residual(team, z)).max(),
        Phi_dot=jnp.abs(grasp.constraint_rate(team, z)).max(),
        min_delassus_singular_value=grasp.min_delassus_singular_value(team, z),
        **({} if telemetry.estimate.lam_covariance is None else _contact_force_signals(nominal, telemetry)),
        **({} if (correction := telemetry.correction) is None else _correction_signals(correction)),
        **({} if (allocation := telemetry.allocation) is None else _allocation_signals(allocation)),
        effectiveness=telemetry.effectiveness,
        contact_moment=None if a.contact_moments is None else grasp.stack_contacts(a.contact_moments),
    )


def _contact_force_signals(nominal: Team, telemetry: interfaces.Telemetry) -> dict[str, Array]:
    """Return the record fields of estimated contact forces, and of the wrench mismatch that follows from them."""
    estimate = telemetry.estimate
    P = estimate.lam_covariance
    assert P is not None
    lam = grasp.stack_contacts(estimate.lam)
    G = grasp.grasp_matrix(grasp.contact_points(nominal), estimate.payload.R)
    return {
        "lam_std": jnp.sqrt(jnp.diagonal(P)).reshape(-1, 3),
        "delta_W_hat": G @ lam.reshape(-1) - jnp.concatenate([telemetry.W_d.F, telemetry.W_d.tau]),
        "delta_W_std": jnp.sqrt(jnp.diagonal(G @ P @ G.T)),
    }


def _allocation_signals(report: interfaces.AllocationReport) -> dict[str, Array]:
    """Return the record fields of an allocation with limits."""
    levels = ("slack_roll_pitch", "slack_z", "slack_xy", "slack_yaw", "allocation_primal", "allocation_dual")
    return dict(zip(levels, (*report.slack, *report.residuals), strict=True)) | {
        "tilt_limited": report.tilt,
        "thrust_limited": report.thrust,
        "friction_limited": report.friction,
        "force_limited": report.force,
    }


def _correction_signals(correction: residual_correction.ResidualCorrection) -> dict[str, Array]:
    """Return the record fields of the correction."""

    def parts(forces: ResidualForces) -> tuple[Array, Array]:
        return jnp.concatenate([forces.payload.F, forces.payload.tau]), jnp.concatenate(
            [agent.f_x for agent in forces.agents]
        )

    signals = {
        "correction": correction.error,
        "correction_std": correction.std,
        "correction_weight": correction.weight,
        "label": correction.label,
        "model_prediction": correction.prediction,
    }
    split = {
        f"{name}_{body}": x for name, forces in signals.items() for body, x in zip("Lx", parts(forces), strict=True)
    }
    return split | {"label_valid": correction.label_valid, "correction_nis": correction.nis}


def model_inputs(team: Team, rows: StepRecord) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
    """Return the inputs of the learned models at the true states of a flight.

    Args:
        team: Team that determines the layout of the records.
        rows: Records of the flight.

    Returns:
        Payload inputs `(time, 18)`, and agent inputs `(time, agents, inputs)` by group.
    """
    time = len(rows.t)
    agents, first, joint = [], 0, 0
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        agent_slice, joint_slice = slice(first, first + size), slice(joint, joint + size * group.tree.joints)
        r, r_dot = (a[:, joint_slice].reshape(time, size, group.tree.joints) for a in (rows.r, rows.r_dot))
        R, x, omega, v = (a[:, agent_slice] for a in (rows.R, rows.x, rows.omega, rows.v_agent))
        agents.append(np.concatenate([R.reshape(time, size, 9), x, r, omega, v, r_dot], axis=2))
        first, joint = agent_slice.stop, joint_slice.stop
    payload = np.concatenate([rows.p, rows.v, rows.R_L.reshape(time, 9), rows.omega_L], axis=1)
    return payload, tuple(agents)


DERIVED_SIGNALS = ("a_L", "lam", "delta_W", "f_L", "f_x", "f_w", "f_r")
"""Signals that depend on all other signals of a tick, so that they are not finite if one of those is not."""


def delassus_matrix(team: Team, r: np.ndarray, agent: int) -> np.ndarray:
    """Return the rows of the contact forces in the Delassus matrix `A M^-1 A^T` of one agent.

    Args:
        team: Parameters of the team.
        r: Joint positions of all agents in team order.
        agent: Index of the agent in team order.

    Returns:
        The matrix [1/kg].

    Raises:
        IndexError: If the team has fewer agents.
    """
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        joints = group.tree.joints
        if agent < size:
            joint_positions = jnp.asarray(r[agent * joints : (agent + 1) * joints])
            S = grasp.delassus_matrix(jax.tree.map(lambda x, j=agent: x[j], group), joint_positions)
            return np.asarray(S)[: 3 * group.tree.arms, : 3 * group.tree.arms]
        agent, r = agent - size, r[size * joints :]
    raise IndexError(f"agent {agent}: index exceeds the number of agents")
