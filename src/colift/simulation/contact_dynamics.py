"""The plant: accelerations and contact forces of the grasped team, and a step that stays on the grasp.

An agent meets the others only through the payload. Each is therefore eliminated on its own: with its contact
Jacobian A and mass matrix M, `S = A M^-1 A^T` is 3n x 3n; what remains is one 6 x 6 system for the payload's
acceleration, and back-substitution gives every contact force. Cost O(N), never a 3Nn x 3Nn matrix.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import backward, forward, matmul, matvec, solve, udu_eliminate
from colift.math.pytree import pytree
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

CONSISTENCY_TOLERANCE = (
    1e-12  # m and m/s, what a consistent start state may still be off: rounding, for a team of metres
)
NEWTON_ITERATIONS = 50
PAYLOAD_MASS_SCALE = (
    1e6  # how much heavier a correction of the start state takes the payload to be; bases: its square root
)


grip = grasp.min_delassus_singular_value


@pytree
class AgentAcceleration:
    """How the velocities of one agent, or of a group, change."""

    v_dot: Float[Array, "*agents 3"]  # m/s^2, centre of mass, world
    xi_dot: Float[Array, "*agents xi"]  # (omega_dot, r_ddot), base frame


@pytree
class Acceleration:
    """How the velocities of the team change."""

    agents: tuple[AgentAcceleration, ...]
    payload: Float[Array, "6"]  # (v_dot world, omega_dot payload frame)


@pytree
class AgentKKT:
    """One agent's share of the saddle-point system of `constrain`: `k` right-hand sides, base frame."""

    mass: Float[Array, "*agents"]
    M_bar: Float[Array, "*agents xi xi"]
    B: Float[Array, "*agents forces xi"]  # A = [I ..., B]: contact motion of the agent
    P: Float[Array, "*agents forces 6"]  # contact motion of the payload
    Q: Float[Array, "*agents motion k"]  # forces on (x, xi)
    contact_bias: Float[Array, "*agents forces k"]


@pytree
class AgentSchurFactors:
    """One agent, eliminated: `M_bar = U_M^T diag(1/d_M) U_M` and `S = A M^-1 A^T = U_S^T diag(1/d_S) U_S`."""

    U_M: Float[Array, "*agents xi xi"]
    d_M: Float[Array, "*agents xi"]
    W: Float[Array, "*agents xi right"]  # U_M^-T [B^T, Q]
    U_S: Float[Array, "*agents forces forces"]
    d_S: Float[Array, "*agents forces"]
    Z: Float[Array, "*agents forces right_S"]  # U_S^-T [P, A M^-1 Q + gap]


def _couple(
    agent: AerialManipulator,
    q: aerial_manipulator.CentroidalModel,
    R: Float[Array, "3 3"],
    R_L: Float[Array, "3 3"],
    Q: Float[Array, "motion k"],
    gap: Float[Array, "forces k"],
) -> AgentKKT:
    """`P = R^T [I, -R_L hat(c)]`, and the rest by name."""
    n = agent.tree.arms
    turn = -matmul(matmul(R.T, R_L)[None], so3.hat(agent.contact_position))
    P = jnp.concatenate([jnp.broadcast_to(R.T, (n, 3, 3)), turn], axis=2)
    return AgentKKT(
        mass=q.mass, M_bar=q.M_bar, B=q.J_tip.reshape(3 * n, -1), P=P.reshape(3 * n, 6), Q=Q, contact_bias=gap
    )


def _eliminate(s: AgentKKT) -> tuple[AgentSchurFactors, Float[Array, "6 right"]]:
    """Factor one agent's share; what it adds to the payload's system is `P^T S^-1 [P, A M^-1 Q + gap]`."""
    forces = s.B.shape[0]
    U_M, d_M, W = udu_eliminate(s.M_bar, jnp.concatenate([s.B.T, s.Q[3:]], axis=1))
    along = jnp.concatenate([jnp.tile(jnp.eye(3), forces // 3), s.Q[:3]], axis=1) / s.mass
    T = matmul((d_M[:, None] * W[:, :forces]).T, W) + jnp.tile(along, (forces // 3, 1))
    U_S, d_S, Z = udu_eliminate(T[:, :forces], jnp.concatenate([s.P, T[:, forces:] + s.contact_bias], axis=1))
    share = matmul((d_S[:, None] * Z[:, :6]).T, Z)
    return AgentSchurFactors(U_M=U_M, d_M=d_M, W=W, U_S=U_S, d_S=d_S, Z=Z), share


def _follow(
    s: AgentKKT, e: AgentSchurFactors, a_L: Float[Array, "6 k"]
) -> tuple[Float[Array, "motion k"], Float[Array, "forces k"]]:
    """Back-substitution: the agent's motion and multipliers, given the payload's."""
    forces = s.B.shape[0]
    lam = backward(e.U_S, e.d_S[:, None] * (e.Z[:, 6:] - matmul(e.Z[:, :6], a_L)))
    xi = backward(e.U_M, e.d_M[:, None] * (e.W[:, forces:] - matmul(e.W[:, :forces], lam)))
    x = (s.Q[:3] - lam.reshape(forces // 3, 3, -1).sum(0)) / s.mass
    return jnp.concatenate([x, xi]), lam


def solve_kkt(
    payload: Payload, agents: tuple[AgentKKT, ...], Q_L: Float[Array, "6 k"]
) -> tuple[
    tuple[Float[Array, "_agents _motion k"], ...], Float[Array, "6 k"], tuple[Float[Array, "_agents _forces k"], ...]
]:
    """Solve `M a + A^T lam = Q`, `M_L a_L - sum P^T lam = Q_L`, `A a - P a_L + gap = 0` for `(a, a_L, lam)`.

    Of all motions that close the gap, a is the nearest to the free one in the mass metric (Gauss' principle).
    """
    eliminated, added = zip(*(vmap_agents(_eliminate)(s) for s in agents), strict=True)
    total = jnp.concatenate([_mass_matrix(payload), Q_L], axis=1) + sum(share.sum(0) for share in added)
    a_L = solve(total[:, :6], total[:, 6:])
    follow = vmap_agents(_follow, in_axes=(0, 0, None))
    a, lam = zip(*(follow(s, e, a_L) for s, e in zip(agents, eliminated, strict=True)), strict=True)
    return a, a_L, lam


def _mass_matrix(payload: Payload) -> Float[Array, "6 6"]:
    return jnp.zeros((6, 6)).at[:3, :3].set(payload.mass * jnp.eye(3)).at[3:, 3:].set(payload.inertia)


def _forced(
    agent: AerialManipulator,
    state: AgentState,
    payload: PayloadState,
    inputs: AgentInput,
    f: GeneralizedForce,
    gravity: Float[Array, "3"],
) -> AgentKKT:
    """Forces on one agent (Eq. dae_agent_x, dae_agent_mom) and the acceleration gap its contacts must close."""
    g = aerial_manipulator.forward_kinematics(agent, state.r)
    q = aerial_manipulator.centroidal_model(agent, g)
    h, kappa = aerial_manipulator.bias_forces(agent, g, q, state.omega, state.r_dot)
    force = matvec(state.R.T, q.mass * gravity + f.f_x) + inputs.u * aerial_manipulator.E3
    Q = jnp.concatenate([inputs.tau + f.f_w, inputs.tau_r + f.f_r]) + inputs.u * q.J_base[2] - h
    centripetal = so3.cross(payload.omega[None], so3.cross(payload.omega[None], agent.contact_position))
    gap = kappa - matvec(matmul(state.R.T, payload.R)[None], centripetal)
    return _couple(agent, q, state.R, payload.R, jnp.concatenate([force, Q])[:, None], gap.reshape(-1, 1))


def forward_dynamics(
    team: Team, team_state: State, inputs: TeamInputs, f: ResidualForces
) -> tuple[Acceleration, tuple[Float[Array, "_agents _arms 3"], ...]]:
    """Accelerations and contact forces of the coupled DAE (Eq. dae_*), by index reduction.

    The multipliers are those for which the second derivative of Phi vanishes: unique if and only if
    `A M^-1 A^T` is invertible (docs/errata.md, row 15), which `grasp.grip` measures.
    """
    load, m, J = team_state.payload, team.payload.mass, team.payload.inertia
    force = m * team.gravity + f.payload.F
    moment = f.payload.tau - so3.cross(load.omega, matvec(J, load.omega))
    forced = vmap_agents(_forced, in_axes=(0, 0, None, 0, 0, None))
    agents = tuple(
        forced(group, state, load, u, f_j, team.gravity)
        for group, state, u, f_j in zip(team.agent_groups, team_state.agents, inputs, f.agents, strict=True)
    )
    motion, a_L, lam = solve_kkt(team.payload, agents, jnp.concatenate([force, moment])[:, None])
    a = tuple(
        AgentAcceleration(v_dot=matvec(state.R, move[:, :3, 0]), xi_dot=move[:, 3:, 0])
        for state, move in zip(team_state.agents, motion, strict=True)
    )
    lam = tuple(
        matvec(state.R[:, None], part.reshape(*group.contact_position.shape))
        for group, state, part in zip(team.agent_groups, team_state.agents, lam, strict=True)
    )
    return Acceleration(agents=a, payload=a_L[:, 0]), lam


@pytree
class StateTangent:
    """Local coordinates around a state: a change of pose, then of velocity; rotation vectors in the body's frame."""

    agents: tuple[Float[Array, "_agents _twice_motion"], ...]  # (theta, x, r, omega, v, r_dot)
    payload: Float[Array, "12"]  # (theta, p, omega, v)


def zero_tangent(state: State) -> StateTangent:
    """The zero motion."""
    return StateTangent(
        agents=tuple(jnp.zeros((a.r.shape[0], 12 + 2 * a.r.shape[1])) for a in state.agents), payload=jnp.zeros(12)
    )


def retract(state: State, d: StateTangent) -> State:
    """`z + d`: rotations by `R exp(theta)`, everything else by addition."""
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
    load, s = state.payload, d.payload
    return State(
        agents=tuple(agents),
        payload=PayloadState(
            R=matmul(load.R, so3.exp(s[:3])), p=load.p + s[3:6], omega=load.omega + s[6:9], v=load.v + s[9:]
        ),
    )


def _theta_dot(theta: so3.Vector, omega: so3.Vector) -> so3.Vector:
    """`dexp^-1` as a fourth-order method needs it: `omega + theta x omega / 2 + theta x (theta x omega) / 12`."""
    turned = so3.cross(theta, omega)
    return omega + turned / 2 + so3.cross(theta, turned) / 12


def tangent_rate(state: State, d: StateTangent, a: Acceleration) -> StateTangent:
    """The time derivative of local coordinates at `z = z_0 + d`, given the accelerations."""
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
    """One classical Runge-Kutta step of order 4 in local coordinates (Munthe-Kaas), inputs held.

    residual: of a state and of the time since the step began, s. The stages run in a scan, so the model is compiled
    once and not four times.
    """

    def stage(
        carry: tuple[StateTangent, StateTangent], node: Float[Array, "2"]
    ) -> tuple[tuple[StateTangent, StateTangent], None]:
        slope, total = carry
        d = jax.tree.map(lambda k: (dt * node[0]) * k, slope)
        at = retract(state, d)
        a, _ = forward_dynamics(team, at, inputs, residual(at, dt * node[0]))
        slope = tangent_rate(at, d, a)
        return (slope, jax.tree.map(lambda s, k: s + (dt * node[1]) * k, total, slope)), None

    nodes = jnp.array([[0.0, 1 / 6], [0.5, 1 / 3], [0.5, 1 / 3], [1.0, 1 / 6]])
    (_, total), _ = jax.lax.scan(stage, (zero_tangent(state), zero_tangent(state)), nodes)
    return retract(state, total)


def project_to_constraints(team: Team, team_state: State) -> State:
    """One mass-weighted Newton step onto `Phi = 0`, then the nearest velocities with `Phi_dot = 0` there.

    A correction is `M^-1 A^T` times multipliers: it does no work to first order and excites no free motion. Both take
    M and A at z, so one elimination serves them, and Phi_dot at the corrected pose: what that neglects is the product
    of the two corrections.
    """

    def strayed(
        agent: AerialManipulator, state: AgentState
    ) -> tuple[AgentKKT, AgentSchurFactors, Float[Array, "6 right"]]:
        q = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, state.r))
        apart = grasp.contact_error(agent, q, state, team_state.payload).reshape(-1, 1)
        s = _couple(agent, q, state.R, team_state.payload.R, jnp.zeros((3 + q.M_bar.shape[0], 1)), apart)
        return s, *_eliminate(s)

    def drifting(
        agent: AerialManipulator, state: AgentState, payload: PayloadState, e: AgentSchurFactors
    ) -> tuple[AgentSchurFactors, Float[Array, "6 1"]]:
        q = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, state.r))
        Z = forward(e.U_S, grasp.contact_error_rate(agent, q, state, payload).reshape(-1, 1))
        P = e.Z[:, :6]
        return dataclasses.replace(e, Z=jnp.concatenate([P, Z], axis=1)), matmul((e.d_S[:, None] * P).T, Z)

    agents, eliminated, added = zip(*map(vmap_agents(strayed), team.agent_groups, team_state.agents), strict=True)
    total = sum(share.sum(0) for share in added)
    U_L, d_L, b = udu_eliminate(_mass_matrix(team.payload) + total[:, :6], total[:, 6:])
    pose, load = _motion(team_state, agents, eliminated, backward(U_L, d_L[:, None] * b))
    still = [jnp.zeros_like(by) for by in pose]
    team_state = retract(team_state, _shift(pose, still, load, jnp.zeros(6)))
    eliminated, added = zip(
        *map(
            vmap_agents(drifting, in_axes=(0, 0, None, 0)),
            team.agent_groups,
            team_state.agents,
            [team_state.payload] * len(agents),
            eliminated,
        ),
        strict=True,
    )
    b = forward(U_L, sum(share.sum(0) for share in added))
    velocity, load = _motion(team_state, agents, eliminated, backward(U_L, d_L[:, None] * b))
    return retract(team_state, _shift(still, velocity, jnp.zeros(6), load))


@pytree
class RigidContactPlant:
    """Our plant: contacts that do not give, one step of order 4 and back onto the grasp."""

    def forward_dynamics(
        self, team: Team, state: State, inputs: TeamInputs, f: ResidualForces
    ) -> tuple[Acceleration, tuple[Float[Array, "_agents _arms 3"], ...]]:
        """`accelerate`."""
        return forward_dynamics(team, state, inputs, f)

    def step(
        self, team: Team, state: State, inputs: TeamInputs, residual: ResidualFunctionType, dt: Float[Array, ""]
    ) -> State:
        """`integrate`, then `project`."""
        return project_to_constraints(team, rkmk4_step(team, state, inputs, residual, dt))


def _motion(
    state: State, agents: tuple[AgentKKT, ...], eliminated: tuple[AgentSchurFactors, ...], a_L: Float[Array, "6 1"]
) -> tuple[list[Float[Array, "_agents _motion"]], Float[Array, "6"]]:
    """The motion that follows the payload's, rows as in Shift."""
    follow = vmap_agents(_follow, in_axes=(0, 0, None))
    moved = [follow(s, e, a_L)[0][:, :, 0] for s, e in zip(agents, eliminated, strict=True)]
    by = [
        jnp.concatenate([part[:, 3:6], matvec(a.R, part[:, :3]), part[:, 6:]], axis=1)
        for a, part in zip(state.agents, moved, strict=True)
    ]
    return by, jnp.concatenate([a_L[3:, 0], a_L[:3, 0]])


def _shift(pose: list, velocity: list, load_pose: Float[Array, "6"], load_velocity: Float[Array, "6"]) -> StateTangent:
    agents = tuple(jnp.concatenate([a, b], axis=1) for a, b in zip(pose, velocity, strict=True))
    return StateTangent(agents=agents, payload=jnp.concatenate([load_pose, load_velocity]))


_project = jax.jit(project_to_constraints)
_residuals = jax.jit(lambda team, z: (grasp.constraint_residual(team, z), grasp.constraint_rate(team, z)))


def consistent_initial_state(team: Team, guess: State, names: Sequence[str] = ()) -> State:
    """The state with `Phi = 0` and `Phi_dot = 0` that Newton's method reaches from a guess; on the host.

    Positions and joints of the agents follow; the payload's motion and the attitudes stay as guessed unless the
    grasp leaves no other way (they count `HELD` times as heavy in the metric of `project`). `names` are the agents',
    in the order of the groups, for messages. Raises `ValueError` with the residuals that remain, in m and m/s, when
    there is no such state near the guess (out of reach, or a singular grasp on the way).
    """
    for R, label in _attitudes(guess, agent_names(team, names)):
        if not np.allclose(R.T @ R, np.eye(3), atol=1e-6) or np.linalg.det(R) < 0:
            raise ValueError(f"start state: the attitude R of {label} is not a rotation matrix: {R.tolist()}")
    metric, z = _held(team), guess
    best = residual = _contact_residuals(team, z)
    for _ in range(NEWTON_ITERATIONS):
        z = _project(metric, z)
        residual = _contact_residuals(team, z)
        if residual.max() <= CONSISTENCY_TOLERANCE:
            return z
        if not np.isfinite(residual).all():
            break
        best = min(best, residual, key=np.max)
    left = ", ".join(
        f"{label}: {gap:.3g} m, {rate:.3g} m/s"
        for label, gap, rate in zip(grasp.contact_names(team, names), *best, strict=True)
        if max(gap, rate) > CONSISTENCY_TOLERANCE
    )
    why = "does not converge" if np.isfinite(residual).all() else "meets a singular grasp"
    raise ValueError(
        f"start state: cannot be made consistent with the grasp to {CONSISTENCY_TOLERANCE:g} m and m/s; "
        f"Newton's method {why}, and comes no closer than {left}"
    )


@jax.jit
def _held(team: Team) -> Team:
    """The team with its payload and the rotation of its bases too heavy to be moved by a correction."""
    load = dataclasses.replace(
        team.payload, mass=PAYLOAD_MASS_SCALE * team.payload.mass, inertia=PAYLOAD_MASS_SCALE * team.payload.inertia
    )
    groups = tuple(
        dataclasses.replace(group, inertia=group.inertia.at[:, 0].mul(PAYLOAD_MASS_SCALE**0.5))
        for group in team.agent_groups
    )
    return dataclasses.replace(team, agent_groups=groups, payload=load)


def _contact_residuals(team: Team, state: State) -> np.ndarray:
    """`(2, contacts)`: how far apart, m, and how fast apart, m/s, each contact is."""
    return np.stack([np.linalg.norm(part, axis=1) for part in _residuals(team, state)])


def _attitudes(state: State, names: Sequence[str]) -> Iterator[tuple[np.ndarray, str]]:
    """Every attitude of a state with the name of whose it is."""
    yield np.asarray(state.payload.R), "the payload"
    yield from zip(np.concatenate([np.asarray(a.R) for a in state.agents]), names, strict=True)
