"""Rigid-contact dynamics: accelerations, contact forces and a time step on the constraint manifold.

Each agent is coupled to the others only through the payload, so it is eliminated separately. With the contact Jacobian
A and the mass matrix M, `S = A M^-1 A^T` has size 3n x 3n for n arms with point contacts. One 6 x 6 system for the
payload acceleration remains, and back-substitution yields every contact force. The cost is O(N) for N agents.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from colift.math import so3
from colift.math.linalg import backward, forward, matmul, matvec, solve, udu_eliminate
from colift.math.pytree import pytree, static
from colift.math.vmap import vmap_agents
from colift.models import aerial_manipulator, grasp
from colift.models.parameters import AerialManipulator, Payload, Team, agent_names
from colift.models.state import (
    AgentInput,
    AgentState,
    GeneralizedForce,
    PayloadState,
    ResidualForces,
    ResidualFunctionType,
    State,
    TeamInputs,
)

CONSISTENCY_TOLERANCE = 1e-12  # m and m/s, residual of a consistent initial state: rounding for dimensions of meters
NEWTON_ITERATIONS = 50
PAYLOAD_MASS_SCALE = 1e6  # factor on payload mass and inertia in the metric of the initial correction; bases: its root


@pytree
class AgentAcceleration:
    """Accelerations of one agent, or of a group of agents."""

    v_dot: Float[Array, "*agents 3"]  # m/s^2, center of mass, world
    xi_dot: Float[Array, "*agents xi"]  # rad/s^2 (prismatic joints: m/s^2), (omega_dot, r_ddot), base frame


@pytree
class Acceleration:
    """Accelerations of all agents and of the payload, and the moments at the contacts."""

    agents: tuple[AgentAcceleration, ...]  # one entry per group
    payload: Float[Array, "6"]  # m/s^2 and rad/s^2, (v_dot in the world, omega_dot in the payload frame)
    contact_moments: tuple[Float[Array, "_agents _arms 3"], ...] | None = None  # N m, on the payload, payload frame, by
    # group; None if all contacts are points


@pytree
class AgentKKT:
    """Blocks of one agent in the saddle-point system of `solve_kkt`, in its base frame.

    The system has k right-hand sides. The rows are the contact forces, then the moments at the contacts.
    """

    mass: Float[Array, "*agents"]  # kg
    M_bar: Float[Array, "*agents xi xi"]  # reduced mass matrix of `xi = (omega, r_dot)`
    B: Float[Array, "*agents rows xi"]  # A = [X, B]: contact Jacobian of the agent, X = I for forces, 0 for moments
    P: Float[Array, "*agents rows 6"]  # contact Jacobian of the payload
    Q: Float[Array, "*agents motion k"]  # generalized forces on (x, xi)
    contact_bias: Float[Array, "*agents rows k"]  # gap of the contact equation
    compliance: Float[Array, "*agents rows"] | None = None  # 1/kg, added to the diagonal of `A M^-1 A^T`
    arms: int = static(default=0)  # contacts, each with three rows of forces


@pytree
class AgentSchurFactors:
    """Factors of one eliminated agent: `M_bar = U_M^T diag(1/d_M) U_M`, `S = A M^-1 A^T = U_S^T diag(1/d_S) U_S`."""

    U_M: Float[Array, "*agents xi xi"]  # unit upper triangular
    d_M: Float[Array, "*agents xi"]  # inverse pivots
    W: Float[Array, "*agents xi right"]  # U_M^-T [B^T, Q]
    U_S: Float[Array, "*agents rows rows"]  # unit upper triangular
    d_S: Float[Array, "*agents rows"]  # inverse pivots
    Z: Float[Array, "*agents rows right_S"]  # U_S^-T [P, A M^-1 Q + gap]


def _couple(
    agent: AerialManipulator,
    q: aerial_manipulator.CentroidalModel,
    R: Float[Array, "3 3"],
    R_L: Float[Array, "3 3"],
    Q: Float[Array, "motion k"],
    gap: Float[Array, "rows k"],
) -> AgentKKT:
    """Assemble the blocks of one agent with `P = R^T [I, -R_L hat(c)]` for forces and `[0, axis^T]` for moments."""
    n, B = agent.tree.arms, q.J_tip.reshape(3 * agent.tree.arms, -1)
    to_base = matmul(R.T, R_L)
    turn = -matmul(to_base[None], so3.hat(agent.contact_position))
    P = jnp.concatenate([jnp.broadcast_to(R.T, (n, 3, 3)), turn], axis=2).reshape(3 * n, 6)
    compliance = None if agent.contact_compliance is None else jnp.repeat(agent.contact_compliance, 3)
    if agent.moment_axis is not None:
        B = jnp.concatenate([B, grasp.tip_rotation_jacobian(agent, q, to_base)])
        P = jnp.concatenate([P, jnp.pad(agent.moment_axis, ((0, 0), (3, 0)))])
        if agent.contact_compliance is not None and compliance is not None:
            moments = agent.contact_compliance[np.array(agent.tree.moment_arms)]
            compliance = jnp.concatenate([compliance, moments])
    return AgentKKT(
        mass=q.mass, M_bar=q.M_bar, B=B, P=P, Q=Q, contact_bias=gap, compliance=compliance, arms=agent.tree.arms
    )


def _eliminate(s: AgentKKT) -> tuple[AgentSchurFactors, Float[Array, "6 right"]]:
    """Factorize one agent; its contribution to the payload system is `P^T S^-1 [P, A M^-1 Q + gap]`."""
    rows, moments = s.B.shape[0], s.B.shape[0] - 3 * s.arms
    U_M, d_M, W = udu_eliminate(s.M_bar, jnp.concatenate([s.B.T, s.Q[3:]], axis=1))
    X = [jnp.tile(jnp.eye(3), s.arms), *([jnp.zeros((3, moments))] if moments else []), s.Q[:3]]
    along = jnp.tile(jnp.concatenate(X, axis=1) / s.mass, (s.arms, 1))
    if moments:
        along = jnp.pad(along, ((0, moments), (0, 0)))
    T = matmul((d_M[:, None] * W[:, :rows]).T, W) + along
    S = T[:, :rows] if s.compliance is None else T[:, :rows] + jnp.diag(s.compliance)
    U_S, d_S, Z = udu_eliminate(S, jnp.concatenate([s.P, T[:, rows:] + s.contact_bias], axis=1))
    share = matmul((d_S[:, None] * Z[:, :6]).T, Z)
    return AgentSchurFactors(U_M=U_M, d_M=d_M, W=W, U_S=U_S, d_S=d_S, Z=Z), share


def _follow(
    s: AgentKKT, e: AgentSchurFactors, a_L: Float[Array, "6 k"]
) -> tuple[Float[Array, "motion k"], Float[Array, "rows k"]]:
    """Compute motion and multipliers of one agent from those of the payload by back-substitution."""
    rows = s.B.shape[0]
    lam = backward(e.U_S, e.d_S[:, None] * (e.Z[:, 6:] - matmul(e.Z[:, :6], a_L)))
    xi = backward(e.U_M, e.d_M[:, None] * (e.W[:, rows:] - matmul(e.W[:, :rows], lam)))
    x = (s.Q[:3] - lam[: 3 * s.arms].reshape(s.arms, 3, -1).sum(0)) / s.mass
    return jnp.concatenate([x, xi]), lam


def solve_kkt(
    payload: Payload, agents: tuple[AgentKKT, ...], Q_L: Float[Array, "6 k"]
) -> tuple[
    tuple[Float[Array, "_agents _motion k"], ...], Float[Array, "6 k"], tuple[Float[Array, "_agents _forces k"], ...]
]:
    """Solve the saddle-point system of the coupled team.

    The equations are `M a + A^T lam = Q`, `M_L a_L - sum P^T lam = Q_L` and `A a - P a_L + gap = C lam` with the
    compliance C of the contacts. Among all motions that close the gap of contacts without compliance, a is nearest to
    the unconstrained motion in the mass metric (Gauss' principle). A contact with an immense compliance is open.

    Args:
        payload: Mass and inertia of the payload.
        agents: Blocks of the agents, one per group.
        Q_L: Generalized forces on the payload, force in the world frame, moment in the payload frame [N, N m].

    Returns:
        `(a, a_L, lam)`: motions of the agents by group, motion of the payload, multipliers by group. Motions and
        multipliers of an agent are in its base frame.
    """
    eliminated, added = zip(*(vmap_agents(_eliminate)(s) for s in agents), strict=True)
    total = jnp.concatenate([_mass_matrix(payload), Q_L], axis=1) + sum(share.sum(0) for share in added)
    a_L = solve(total[:, :6], total[:, 6:])
    follow = vmap_agents(_follow, in_axes=(0, 0, None))
    a, lam = zip(*(follow(s, e, a_L) for s, e in zip(agents, eliminated, strict=True)), strict=True)
    return a, a_L, lam


def _mass_matrix(payload: Payload) -> Float[Array, "6 6"]:
    """Return the 6 x 6 mass matrix of the payload."""
    return jnp.zeros((6, 6)).at[:3, :3].set(payload.mass * jnp.eye(3)).at[3:, 3:].set(payload.inertia)


def _forced(
    agent: AerialManipulator,
    state: AgentState,
    payload: PayloadState,
    inputs: AgentInput,
    f: GeneralizedForce,
    gravity: Float[Array, "3"],
) -> AgentKKT:
    """Compute the forces on one agent (Eq. dae_agent_x, dae_agent_mom) and the acceleration gap of its contacts."""
    g = aerial_manipulator.forward_kinematics(agent, state.r)
    q = aerial_manipulator.centroidal_model(agent, g)
    h, kappa = aerial_manipulator.bias_forces(agent, g, q, state.omega, state.r_dot)
    force = matvec(state.R.T, q.mass * gravity + f.f_x) + inputs.u * aerial_manipulator.E3
    Q = jnp.concatenate([inputs.tau + f.f_w, inputs.tau_r + f.f_r]) + inputs.u * q.J_base[2] - h
    centripetal = so3.cross(payload.omega[None], so3.cross(payload.omega[None], agent.contact_position))
    gap = (kappa - matvec(matmul(state.R.T, payload.R)[None], centripetal)).reshape(-1, 1)
    if agent.moment_axis is not None:
        gap = jnp.concatenate([gap, grasp.rotation_acceleration_bias(agent, g, state, payload)[:, None]])
    return _couple(agent, q, state.R, payload.R, jnp.concatenate([force, Q])[:, None], gap)


def forward_dynamics(
    team: Team, team_state: State, inputs: TeamInputs, f: ResidualForces
) -> tuple[Acceleration, tuple[Float[Array, "_agents _arms 3"], ...]]:
    """Compute accelerations and contact forces of the coupled DAE by index reduction (Eq. dae_*).

    The multipliers make the second derivative of the constraint Phi vanish. They are unique if and only if
    `A M^-1 A^T` is invertible (docs/errata.md, row 15); `grasp.min_delassus_singular_value` measures this.

    Args:
        team: True parameters.
        team_state: State on the constraint manifold.
        inputs: Thrusts, body torques and joint torques, by group.
        f: Unmodelled forces on agents and payload.

    Returns:
        Accelerations, and contact forces on the payload [N, world] by group.
    """
    payload, m, J = team_state.payload, team.payload.mass, team.payload.inertia
    force = m * team.gravity + f.payload.F
    moment = f.payload.tau - so3.cross(payload.omega, matvec(J, payload.omega))
    agent_forces = vmap_agents(_forced, in_axes=(0, 0, None, 0, 0, None))
    agents = tuple(
        agent_forces(group, state, payload, u, f_j, team.gravity)
        for group, state, u, f_j in zip(team.agent_groups, team_state.agents, inputs, f.agents, strict=True)
    )
    motion, a_L, lam = solve_kkt(team.payload, agents, jnp.concatenate([force, moment])[:, None])
    a = tuple(
        AgentAcceleration(v_dot=matvec(state.R, motion_j[:, :3, 0]), xi_dot=motion_j[:, 3:, 0])
        for state, motion_j in zip(team_state.agents, motion, strict=True)
    )
    forces = tuple(
        matvec(state.R[:, None], _force_rows(group, rows).reshape(*group.contact_position.shape))
        for group, state, rows in zip(team.agent_groups, team_state.agents, lam, strict=True)
    )
    moments = tuple(_contact_moments(group, rows) for group, rows in zip(team.agent_groups, lam, strict=True))
    bears_moments = team.zero_contact_moments is not None
    return Acceleration(agents=a, payload=a_L[:, 0], contact_moments=moments if bears_moments else None), forces


def _force_rows(group: AerialManipulator, lam: Float[Array, "agents rows 1"]) -> Float[Array, "agents forces 1"]:
    """Return the rows of the contact forces."""
    return lam if group.moment_axis is None else lam[:, : 3 * group.tree.arms]


def _contact_moments(group: AerialManipulator, lam: Float[Array, "agents rows 1"]) -> Float[Array, "agents arms 3"]:
    """Return the moments of the contacts on the payload [N m, payload frame]."""
    if group.moment_axis is None:
        return jnp.zeros_like(group.contact_position)
    components = lam[:, 3 * group.tree.arms :] * group.moment_axis
    of_arm = (np.arange(group.tree.arms)[:, None] == np.array(group.tree.moment_arms)).astype(float)
    return (of_arm[None, :, :, None] * components[:, None]).sum(2)


@pytree
class StateTangent:
    """Local coordinates of a state: a change of pose and of velocity, with rotation vectors in the body frame."""

    agents: tuple[Float[Array, "_agents _twice_motion"], ...]  # (theta, x, r, omega, v, r_dot), by group
    payload: Float[Array, "12"]  # (theta, p, omega, v)


def zero_tangent(state: State) -> StateTangent:
    """Return the zero tangent at a state."""
    return StateTangent(
        agents=tuple(jnp.zeros((a.r.shape[0], 12 + 2 * a.r.shape[1])) for a in state.agents), payload=jnp.zeros(12)
    )


def retract(state: State, d: StateTangent) -> State:
    """Compute `z + d`, with rotations by `R exp(theta)` and addition for all other coordinates.

    Args:
        state: Base point z.
        d: Local coordinates at z.

    Returns:
        The state with these local coordinates.
    """
    agents = []
    for a, s in zip(state.agents, d.agents, strict=True):
        n = 6 + a.r.shape[1]
        agents.append(
            AgentState(
                R=matmul(a.R, so3.exp(s[:, :3])),
                x=a.x + s[:, 3:6],
                r=a.r + s[:, 6:n],
                omega=a.omega + s[:, n : n + 3],
                v=a.v + s[:, n + 3 : n + 6],
                r_dot=a.r_dot + s[:, n + 6 :],
            )
        )
    payload, s = state.payload, d.payload
    return State(
        agents=tuple(agents),
        payload=PayloadState(
            R=matmul(payload.R, so3.exp(s[:3])), p=payload.p + s[3:6], omega=payload.omega + s[6:9], v=payload.v + s[9:]
        ),
    )


def _theta_dot(theta: so3.Vector, omega: so3.Vector) -> so3.Vector:
    """Approximate `dexp^-1` to the order of the method: `omega + theta x omega / 2 + theta x (theta x omega) / 12`."""
    cross = so3.cross(theta, omega)
    return omega + cross / 2 + so3.cross(theta, cross) / 12


def tangent_rate(state: State, d: StateTangent, a: Acceleration) -> StateTangent:
    """Compute the time derivative of local coordinates d, where `state = z_0 + d`.

    Args:
        state: State at which the accelerations are evaluated.
        d: Local coordinates of the state relative to z_0.
        a: Accelerations at the state.

    Returns:
        The rate of the local coordinates.
    """
    agents = tuple(
        jnp.concatenate(
            [_theta_dot(s[:, :3], q.omega), q.v, q.r_dot, b.xi_dot[:, :3], b.v_dot, b.xi_dot[:, 3:]], axis=1
        )
        for q, s, b in zip(state.agents, d.agents, a.agents, strict=True)
    )
    q = state.payload
    turn = _theta_dot(d.payload[:3], q.omega)
    return StateTangent(agents=agents, payload=jnp.concatenate([turn, q.v, a.payload[3:], a.payload[:3]]))


def rkmk4_step(
    team: Team, state: State, inputs: TeamInputs, residual: ResidualFunctionType, dt: Float[Array, ""]
) -> State:
    """Perform one Runge-Kutta-Munthe-Kaas step of order 4 with constant inputs.

    The stages run in a scan, so that the model is compiled once instead of four times.

    Args:
        team: True parameters.
        state: State at the start of the step.
        inputs: Inputs, constant over the step.
        residual: Unmodelled forces as a function of the state and of the time since the step began [s].
        dt: Step length [s].

    Returns:
        The state after the step, before projection onto the constraints.

    References:
        Munthe-Kaas, *High order Runge-Kutta methods on manifolds*, Applied Numerical Mathematics 29, 1999.
    """

    def stage(
        carry: tuple[StateTangent, StateTangent], node: Float[Array, "2"]
    ) -> tuple[tuple[StateTangent, StateTangent], None]:
        slope, total = carry
        d = jax.tree.map(lambda k: (dt * node[0]) * k, slope)
        stage_state = retract(state, d)
        a, _ = forward_dynamics(team, stage_state, inputs, residual(stage_state, dt * node[0]))
        slope = tangent_rate(stage_state, d, a)
        return (slope, jax.tree.map(lambda s, k: s + (dt * node[1]) * k, total, slope)), None

    nodes = jnp.array([[0.0, 1 / 6], [0.5, 1 / 3], [0.5, 1 / 3], [1.0, 1 / 6]])
    (_, total), _ = jax.lax.scan(stage, (zero_tangent(state), zero_tangent(state)), nodes)
    return retract(state, total)


def project_to_constraints(team: Team, team_state: State) -> State:
    """Project a state onto the constraint manifold by one mass-weighted Newton step.

    The poses are corrected to `Phi = 0`, then the velocities to the nearest ones with `Phi_dot = 0`. A correction is
    `M^-1 A^T` times multipliers: it performs no work to first order and excites no free motion. Both corrections use
    M and A at the given state, so one factorization serves both. `Phi_dot` is evaluated at the corrected pose. The
    neglected terms are the products of the two corrections.

    Args:
        team: Parameters whose mass matrix defines the metric.
        team_state: State near the manifold.

    Returns:
        The corrected state.
    """

    def eliminate_pose(
        agent: AerialManipulator, state: AgentState
    ) -> tuple[AgentKKT, AgentSchurFactors, Float[Array, "6 right"]]:
        g = aerial_manipulator.forward_kinematics(agent, state.r)
        q = aerial_manipulator.centroidal_model(agent, g)
        contact_gap = grasp.contact_error(agent, q, state, team_state.payload).reshape(-1, 1)
        if agent.moment_axis is not None:
            turned = grasp.rotation_error(agent, g, state, team_state.payload)
            contact_gap = jnp.concatenate([contact_gap, turned[:, None]])
        s = _couple(agent, q, state.R, team_state.payload.R, jnp.zeros((3 + q.M_bar.shape[0], 1)), contact_gap)
        return s, *_eliminate(s)

    def eliminate_velocity(
        agent: AerialManipulator, state: AgentState, payload: PayloadState, e: AgentSchurFactors
    ) -> tuple[AgentSchurFactors, Float[Array, "6 1"]]:
        g = aerial_manipulator.forward_kinematics(agent, state.r)
        q = aerial_manipulator.centroidal_model(agent, g)
        rate = grasp.contact_error_rate(agent, q, state, payload).reshape(-1, 1)
        if agent.moment_axis is not None:
            rate = jnp.concatenate([rate, grasp.rotation_error_rate(agent, g, state, payload)[:, None]])
        Z = forward(e.U_S, rate)
        P = e.Z[:, :6]
        return dataclasses.replace(e, Z=jnp.concatenate([P, Z], axis=1)), matmul((e.d_S[:, None] * P).T, Z)

    agents, eliminated, added = zip(
        *map(vmap_agents(eliminate_pose), team.agent_groups, team_state.agents), strict=True
    )
    total = sum(contribution.sum(0) for contribution in added)
    U_L, d_L, b = udu_eliminate(_mass_matrix(team.payload) + total[:, :6], total[:, 6:])
    pose, payload_motion = _motion(team_state, agents, eliminated, backward(U_L, d_L[:, None] * b))
    zero_motion = [jnp.zeros_like(motion) for motion in pose]
    team_state = retract(team_state, _shift(pose, zero_motion, payload_motion, jnp.zeros(6)))
    eliminated, added = zip(
        *map(
            vmap_agents(eliminate_velocity, in_axes=(0, 0, None, 0)),
            team.agent_groups,
            team_state.agents,
            [team_state.payload] * len(agents),
            eliminated,
        ),
        strict=True,
    )
    b = forward(U_L, sum(contribution.sum(0) for contribution in added))
    velocity, payload_motion = _motion(team_state, agents, eliminated, backward(U_L, d_L[:, None] * b))
    return retract(team_state, _shift(zero_motion, velocity, jnp.zeros(6), payload_motion))


IMPACT_ITERATIONS = 2
"""Newton steps after that of the period; of a gap of 1e-2 m the three steps leave 1e-4 m, 1e-7 m and 1e-13 m."""


def complete_impact(team: Team, state: State, closes: Bool[Array, ""]) -> State:
    """Repeat `project_to_constraints` after the period in which a contact has closed.

    The distance and the relative velocity of a closing contact are not small. One Newton step neglects the product of
    their corrections.

    Args:
        team: Parameters with the closed contact.
        state: State after the period.
        closes: Whether a contact has closed in it.

    Returns:
        The state on the constraint manifold; without an impact the given state.
    """

    def complete(z: State) -> State:
        return jax.lax.fori_loop(0, IMPACT_ITERATIONS, lambda _, found: project_to_constraints(team, found), z)

    return jax.lax.cond(closes, complete, lambda z: z, state)


@pytree
class RigidContactPlant:
    """Plant with rigid contacts: a step of order 4, followed by a projection onto the constraints.

    Implements `colift.simulation.world.Plant`.
    """

    def forward_dynamics(
        self, team: Team, state: State, inputs: TeamInputs, f: ResidualForces
    ) -> tuple[Acceleration, tuple[Float[Array, "_agents _arms 3"], ...]]:
        """Compute accelerations and contact forces; see `forward_dynamics`."""
        return forward_dynamics(team, state, inputs, f)

    def step(
        self, team: Team, state: State, inputs: TeamInputs, residual: ResidualFunctionType, dt: Float[Array, ""]
    ) -> State:
        """Perform `rkmk4_step`, then `project_to_constraints`."""
        return project_to_constraints(team, rkmk4_step(team, state, inputs, residual, dt))


def _motion(
    state: State, agents: tuple[AgentKKT, ...], eliminated: tuple[AgentSchurFactors, ...], a_L: Float[Array, "6 1"]
) -> tuple[list[Float[Array, "_agents _motion"]], Float[Array, "6"]]:
    """Compute the agents' motions that follow the payload motion, with rows as in `StateTangent`."""
    follow = vmap_agents(_follow, in_axes=(0, 0, None))
    motions = [follow(s, e, a_L)[0][:, :, 0] for s, e in zip(agents, eliminated, strict=True)]
    rows = [
        jnp.concatenate([motion[:, 3:6], matvec(a.R, motion[:, :3]), motion[:, 6:]], axis=1)
        for a, motion in zip(state.agents, motions, strict=True)
    ]
    return rows, jnp.concatenate([a_L[3:, 0], a_L[:3, 0]])


def _shift(
    pose: list, velocity: list, payload_pose: Float[Array, "6"], payload_velocity: Float[Array, "6"]
) -> StateTangent:
    """Assemble a tangent from changes of pose and of velocity."""
    agents = tuple(jnp.concatenate([a, b], axis=1) for a, b in zip(pose, velocity, strict=True))
    return StateTangent(agents=agents, payload=jnp.concatenate([payload_pose, payload_velocity]))


def consistent_initial_state(
    team: Team, guess: State, names: Sequence[str] = (), contacts: Sequence[str] = ()
) -> State:
    """Find the state with `Phi = 0` and `Phi_dot = 0` near a guess, by Newton's method on the host.

    The metric of the projection scales the payload and the base attitudes by `PAYLOAD_MASS_SCALE`. They therefore stay
    at the guess unless the grasp requires a change; agent positions and joints follow.

    Args:
        team: Parameters of the team.
        guess: State near the constraint manifold.
        names: Agent names in team order, used in messages.
        contacts: Contact names in team order, used in messages; default: `grasp.contact_names`.

    Returns:
        A state that satisfies the constraints to `CONSISTENCY_TOLERANCE`.

    Raises:
        ValueError: If an attitude is not a rotation matrix, or if no consistent state is found near the guess. The
            message contains the remaining residuals in m and m/s.
    """
    for R, label in _attitudes(guess, agent_names(team, names)):
        if not so3.is_rotation(R, 1e-6):
            raise ValueError(f"initial state: the attitude R of {label} is not a rotation matrix: {R.tolist()}")
    z, *residuals = _newton(team, guess)
    residual, best = map(np.asarray, residuals)
    if residual.max() <= CONSISTENCY_TOLERANCE:
        return z
    labels = contacts or grasp.contact_names(team, names)
    units = ("m",) * len(labels) + ("rad",) * (best.shape[1] - len(labels))
    remaining = ", ".join(
        f"{label}: {gap:.3g} {unit}, {rate:.3g} {unit}/s"
        for label, unit, gap, rate in zip((*labels, *grasp.moment_names(team, labels)), units, *best, strict=True)
        if not max(gap, rate) <= CONSISTENCY_TOLERANCE  # NaN counts as a residual
    )
    outcome = "does not converge" if np.isfinite(residual).all() else "reaches a singular grasp"
    raise ValueError(
        f"initial state: cannot be made consistent with the grasp to {CONSISTENCY_TOLERANCE:g} m and m/s; "
        f"Newton's method {outcome}; smallest residuals: {remaining}"
    )


@jax.jit
def _newton(team: Team, guess: State) -> tuple[State, Array, Array]:
    """Project a state until it is consistent; return it, its residuals and the smallest ones."""
    metric, initial = _scaled_masses(team), _contact_residuals(team, guess)

    def project(carry: tuple[State, Array, Array, Array]) -> tuple[State, Array, Array, Array]:
        z, _, best, i = carry
        z = project_to_constraints(metric, z)
        residual = _contact_residuals(team, z)
        return z, residual, jnp.where(residual.max() < best.max(), residual, best), i + 1

    def unfinished(carry: tuple[State, Array, Array, Array]) -> Array:
        _, residual, _, i = carry
        far = (residual.max() > CONSISTENCY_TOLERANCE) & jnp.isfinite(residual).all()
        return (i == 0) | (far & (i < NEWTON_ITERATIONS))

    return jax.lax.while_loop(unfinished, project, (guess, initial, initial, jnp.zeros((), int)))[:3]


def _scaled_masses(team: Team) -> Team:
    """Scale the payload and the rotational inertia of the bases so that a correction hardly moves them."""
    payload = dataclasses.replace(
        team.payload, mass=PAYLOAD_MASS_SCALE * team.payload.mass, inertia=PAYLOAD_MASS_SCALE * team.payload.inertia
    )
    groups = tuple(
        dataclasses.replace(group, inertia=group.inertia.at[:, 0].mul(PAYLOAD_MASS_SCALE**0.5))
        for group in team.agent_groups
    )
    return dataclasses.replace(team, agent_groups=groups, payload=payload)


def _contact_residuals(team: Team, state: State) -> Float[Array, "2 rows"]:
    """Return distance [m] and relative speed [m/s] of every contact, then rotations [rad] and their rates [rad/s]."""
    parts = grasp.constraint_residual(team, state), grasp.constraint_rate(team, state)
    distances = jnp.stack([jnp.sqrt((part * part).sum(1)) for part in parts])
    rotations = grasp.rotation_residuals(team, state)
    return jnp.concatenate([distances, jnp.abs(rotations)], axis=1) if rotations.size else distances


def _attitudes(state: State, names: Sequence[str]) -> Iterator[tuple[np.ndarray, str]]:
    """Yield every attitude of a state with the name of its body."""
    yield np.asarray(state.payload.R), "the payload"
    yield from zip(np.concatenate([np.asarray(a.R) for a in state.agents]), names, strict=True)
