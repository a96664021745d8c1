"""Rigid grasp: contact constraints, grasp matrix, internal forces, and rank tests.

Contacts are numbered by group, agent and arm. The rank tests run on the host, outside of `jax.jit`.

References:
    Murray, Li, Sastry, *A Mathematical Introduction to Robotic Manipulation*, 1994, ch. 5.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import matmul, matvec, transpose, udu_eliminate
from colift.math.vmap import vmap_agents
from colift.models import aerial_manipulator
from colift.models.parameters import RIGID, AerialManipulator, Team, agent_names
from colift.models.state import AgentState, PayloadState, State, Wrench

# Condition number of an agent's Delassus matrix; beyond it, contact forces have fewer than four accurate digits.
MAX_CONDITION = 1e12
# Condition number of an agent's grasp Jacobian. The reference agent has 13 at rest, and 1e3 if an arm is 0.005 rad from
# pointing straight down.
MAX_JACOBIAN_CONDITION = 1e3

Contacts = Float[Array, "contacts 3"]


def contact_points(team: Team) -> Contacts:
    """Return the attachment points `c` of all contacts.

    Args:
        team: Team.

    Returns:
        Points in the payload frame [m].
    """
    return jnp.concatenate([group.contact_position.reshape(-1, 3) for group in team.agent_groups])


def contact_names(team: Team, names: Sequence[str] = ()) -> tuple[str, ...]:
    """Return one name per contact, `<agent> arm <b>`.

    Args:
        team: Team.
        names: Names of the agents in team order; default: `agent 1`, `agent 2`, ...

    Returns:
        The names in the order of the contacts.
    """
    arms = [group.tree.arms for size, group in zip(team.sizes, team.agent_groups, strict=True) for _ in range(size)]
    return tuple(
        f"{name} arm {b + 1}" for name, n in zip(agent_names(team, names), arms, strict=True) for b in range(n)
    )


def split_contacts(team: Team, lam: Contacts) -> tuple[Float[Array, "_agents _arms 3"], ...]:
    """Split an array with one row per contact into one array per group.

    Args:
        team: Team.
        lam: One row per contact, such as contact forces [N].

    Returns:
        One array per group.
    """
    parts, start = [], 0
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        stop = start + size * group.tree.arms
        parts.append(lam[start:stop].reshape(size, group.tree.arms, 3))
        start = stop
    return tuple(parts)


def stack_contacts(lam: tuple[Float[Array, "_agents _arms 3"], ...]) -> Contacts:
    """Concatenate the arrays of the groups, the inverse of `split_contacts`.

    Args:
        lam: One array per group.

    Returns:
        One row per contact.
    """
    return jnp.concatenate([part.reshape(-1, 3) for part in lam])


def payload_wrench(c: Contacts, R: Float[Array, "3 3"], lam: Contacts) -> Wrench:
    """Compute the payload wrench `W = G lam` of contact forces (docs/errata.md, row 1).

    `F = sum lam_b`, `tau = sum c_b x R^T lam_b`.

    Args:
        c: Attachment points, payload frame [m].
        R: Attitude of the payload.
        lam: Contact forces on the payload, world frame [N].

    Returns:
        Force, world frame [N], and moment, payload frame [N m].
    """
    return Wrench(F=lam.sum(0), tau=so3.cross(c, lam @ R).sum(0))


def grasp_matrix(c: Contacts, R: Float[Array, "3 3"]) -> Float[Array, "6 3*contacts"]:
    """Compute the grasp matrix `G = [I ...; hat(c_b) R^T ...]`, which maps stacked contact forces to the wrench.

    Args:
        c: Attachment points, payload frame [m].
        R: Attitude of the payload.

    Returns:
        The grasp matrix.
    """
    moment = so3.hat(c) @ R.T[None]
    force = so3.identity((c.shape[0],))
    return jnp.concatenate([force, moment], axis=1).transpose(1, 0, 2).reshape(6, -1)


def payload_frame_grasp_matrix(c: np.ndarray) -> np.ndarray:
    """Compute the grasp matrix at `R = I` on the host.

    Args:
        c: Attachment points by row, payload frame [m].

    Returns:
        The grasp matrix.
    """
    return np.asarray(_compiled_grasp_matrix(jax.device_put(c), jax.device_put(np.eye(3))))


_compiled_grasp_matrix = jax.jit(grasp_matrix)


def grasp_nullspace(c: np.ndarray) -> np.ndarray:
    """Compute an orthonormal basis of the null space of the grasp matrix at `R = I` by singular value decomposition.

    The basis with each force rotated by R is a basis at attitude R. The function runs on the host.

    Args:
        c: Attachment points by row, payload frame [m].

    Returns:
        The basis vectors, internal forces, by column.
    """
    _, singular, Vt = np.linalg.svd(payload_frame_grasp_matrix(c))
    rank = int((singular > 1e-10 * singular[0]).sum())
    return Vt[rank:].T


def external_force_projector(c: np.ndarray) -> np.ndarray:
    """Compute the projector `G^+ G` onto external forces, with the grasp matrix at `R = I`.

    `G^+ G lam` is the part of contact forces that applies their wrench with the least norm. The rest is the internal
    force, in the null space of G. In the payload frame the projector does not depend on the attitude. The function runs
    on the host.

    Args:
        c: Attachment points by row, payload frame [m].

    Returns:
        The projector `(3 contacts, 3 contacts)`, for stacked contact forces in the payload frame.
    """
    G = np.asarray(grasp_matrix(jnp.asarray(c), jnp.eye(3)))
    return np.linalg.pinv(G) @ G


def contact_error(
    agent: AerialManipulator, q: aerial_manipulator.CentroidalModel, state: AgentState, payload: PayloadState
) -> Float[Array, "arms 3"]:
    """Compute the position error `R^T phi_b` between the tips of an agent and its contacts (Eq. dae_constraints).

    Args:
        agent: Parameters of the agent.
        q: Model of the agent at its joint positions.
        state: State of the agent.
        payload: State of the payload.

    Returns:
        Position errors, base frame [m].
    """
    c = matvec(payload.R[None], agent.contact_position)
    return q.tip_from_com + matvec(state.R.T[None], (state.x - payload.p)[None] - c)


def contact_error_rate(
    agent: AerialManipulator, q: aerial_manipulator.CentroidalModel, state: AgentState, payload: PayloadState
) -> Float[Array, "arms 3"]:
    """Compute the velocity error between the tips of an agent and its contacts.

    `R^T phi_b_dot = B_b xi + R^T (v - v_L - R_L (omega_L x c_b))`.

    Args:
        agent: Parameters of the agent.
        q: Model of the agent at its joint positions.
        state: State of the agent.
        payload: State of the payload.

    Returns:
        Velocity errors, base frame [m/s].
    """
    xi = jnp.concatenate([state.omega, state.r_dot])
    c_dot = matvec(payload.R[None], so3.cross(payload.omega[None], agent.contact_position))
    return matvec(q.J_tip, xi[None]) + matvec(state.R.T[None], (state.v - payload.v)[None] - c_dot)


def tip_rotation_jacobian(
    agent: AerialManipulator, q: aerial_manipulator.CentroidalModel, to_base: Float[Array, "3 3"]
) -> Float[Array, "moments xi"]:
    """Compute the angular velocity of the tip bodies along the directions in which contacts bear moments, per xi.

    Args:
        agent: Parameters of the agent, with contacts that bear moments.
        q: Model of the agent at its joint positions.
        to_base: Rotation from the payload frame to the base frame.

    Returns:
        The Jacobian; its transpose maps moments on the payload to the opposite of their effect on `(mu, nu)`.
    """
    assert agent.moment_axis is not None  # for the type checker
    directions = matvec(to_base[None], agent.moment_axis)
    bodies = np.array(agent.tree.tip_bodies)[list(agent.tree.moment_arms)]
    return (directions[:, :, None] * q.J_angular[bodies]).sum(1)


def rotation_error(
    agent: AerialManipulator, g: aerial_manipulator.ForwardKinematics, state: AgentState, payload: PayloadState
) -> Float[Array, "moments"]:
    """Compute the rotation of the tip bodies relative to rigid grips, along the directions of the moments.

    `axis . vee(skew(R_L^T R R_tip R_grip^T))`, of first order in the rotation. The constraint of a soft-finger contact
    acts on velocities alone (it is nonholonomic), so its error is zero.

    Args:
        agent: Parameters of the agent, with contacts that bear moments.
        g: Forward kinematics of the agent.
        state: State of the agent.
        payload: State of the payload.

    Returns:
        Rotations [rad].
    """
    tree = agent.tree
    if agent.grip_rotation is None:
        return jnp.zeros(len(tree.moment_arms))
    tip = matmul(matmul(payload.R.T, state.R)[None], g.rotation[np.array(tree.tip_bodies)])
    turned = matmul(tip, transpose(agent.grip_rotation))
    error = so3.vee((turned - transpose(turned)) / 2)
    return _along_moment_axes(agent, error) * np.array(
        [tree.contact_types[b] == RIGID for b in tree.moment_arms], dtype=float
    )


def rotation_error_rate(
    agent: AerialManipulator, g: aerial_manipulator.ForwardKinematics, state: AgentState, payload: PayloadState
) -> Float[Array, "moments"]:
    """Compute the angular velocity of the tip bodies relative to the payload, along the directions of the moments.

    `axis . (R_L^T R omega_tip - omega_L)`.

    Args:
        agent: Parameters of the agent, with contacts that bear moments.
        g: Forward kinematics of the agent.
        state: State of the agent.
        payload: State of the payload.

    Returns:
        Angular velocities [rad/s].
    """
    w, _ = aerial_manipulator.angular_motion_of_tips(agent, g, state.omega, state.r_dot)
    relative = matvec(matmul(payload.R.T, state.R)[None], w) - payload.omega[None]
    return _along_moment_axes(agent, relative)


def rotation_acceleration_bias(
    agent: AerialManipulator, g: aerial_manipulator.ForwardKinematics, state: AgentState, payload: PayloadState
) -> Float[Array, "moments"]:
    """Compute the rate of `rotation_error_rate` at zero accelerations of agent and payload.

    `axis . (R_L^T R alpha_tip - omega_L x R_L^T R omega_tip)`.

    Args:
        agent: Parameters of the agent, with contacts that bear moments.
        g: Forward kinematics of the agent.
        state: State of the agent.
        payload: State of the payload.

    Returns:
        Angular accelerations [rad/s^2].
    """
    w, alpha = aerial_manipulator.angular_motion_of_tips(agent, g, state.omega, state.r_dot)
    to_payload = matmul(payload.R.T, state.R)[None]
    bias = matvec(to_payload, alpha) - so3.cross(payload.omega[None], matvec(to_payload, w))
    return _along_moment_axes(agent, bias)


def _along_moment_axes(agent: AerialManipulator, vectors: Float[Array, "arms 3"]) -> Float[Array, "moments"]:
    """Return the components of one vector per arm, payload frame, in the directions in which contacts bear moments."""
    assert agent.moment_axis is not None  # for the type checker
    return (agent.moment_axis * vectors[np.array(agent.tree.moment_arms)]).sum(1)


ContactFunction = Callable[
    [AerialManipulator, aerial_manipulator.CentroidalModel, AgentState, PayloadState], Float[Array, "arms 3"]
]


def constraint_residual(team: Team, state: State) -> Contacts:
    """Compute the constraint residual `phi_b = x + R rho_b(r) - (p + R_L c_b)` (Eq. dae_constraints).

    Args:
        team: Team.
        state: State of the team.

    Returns:
        Residual of each contact, world frame [m].
    """
    return _all_contacts(contact_error, team, state)


def constraint_rate(team: Team, state: State) -> Contacts:
    """Compute the constraint velocity `v + R B_b xi - (v_L + R_L (omega_L x c_b))`.

    Args:
        team: Team.
        state: State of the team.

    Returns:
        Velocity of each contact, world frame [m/s].
    """
    return _all_contacts(contact_error_rate, team, state)


def _all_contacts(contact_function: ContactFunction, team: Team, team_state: State) -> Contacts:
    """Evaluate a function for every agent, rotate the results to the world frame and concatenate them.

    The result is zero for contacts with a compliance, which are open.
    """

    def one_agent(agent: AerialManipulator, state: AgentState) -> Float[Array, "arms 3"]:
        q = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, state.r))
        error = contact_function(agent, q, state, team_state.payload)
        if agent.contact_compliance is not None:
            error = jnp.where(agent.contact_compliance[:, None] > 0, 0.0, error)
        return matvec(state.R[None], error)

    return stack_contacts(
        tuple(
            vmap_agents(one_agent)(group, state)
            for group, state in zip(team.agent_groups, team_state.agents, strict=True)
        )
    )


def rotation_residuals(team: Team, team_state: State) -> Float[Array, "2 moments"]:
    """Compute rotations and angular velocities of the tip bodies relative to the payload where contacts bear moments.

    The values of open contacts are zero.

    Args:
        team: Team.
        team_state: State of the team.

    Returns:
        `rotation_error` [rad] and `rotation_error_rate` [rad/s], by group, agent and direction.
    """

    def one_agent(agent: AerialManipulator, state: AgentState) -> Float[Array, "2 moments"]:
        g = aerial_manipulator.forward_kinematics(agent, state.r)
        both = [f(agent, g, state, team_state.payload) for f in (rotation_error, rotation_error_rate)]
        if agent.contact_compliance is not None:
            is_open = agent.contact_compliance[np.array(agent.tree.moment_arms)] > 0
            both = [jnp.where(is_open, 0.0, x) for x in both]
        return jnp.stack(both)

    parts = [
        jnp.swapaxes(vmap_agents(one_agent)(group, state), 0, 1).reshape(2, -1)
        for group, state in zip(team.agent_groups, team_state.agents, strict=True)
        if group.moment_axis is not None
    ]
    return jnp.concatenate(parts, axis=1) if parts else jnp.zeros((2, 0))


def moment_names(team: Team, contacts: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the contacts that bear moments, once for each direction.

    Args:
        team: Team.
        contacts: Names of the contacts in team order.

    Returns:
        The names in the order of `rotation_residuals`.
    """
    name, found = iter(contacts), []
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        for _ in range(size):
            own = [next(name) for _ in range(group.tree.arms)]
            found += [own[b] for b in group.tree.moment_arms]
    return tuple(found)


def delassus_matrix(
    agent: AerialManipulator, r: Float[Array, "n_r"], to_base: Float[Array, "3 3"] | None = None
) -> Float[Array, "rows rows"]:
    """Compute the Delassus matrix of an agent, `S = A M^-1 A^T = 1/m + B M_bar^-1 B^T`.

    S maps contact forces to accelerations of the contacts, and their moments to angular accelerations. The matrix of
    the team is invertible if and only if S is invertible for every agent, because each agent has a free base. The
    smallest eigenvalue of the team's matrix is at least the smallest one of the agents.

    Args:
        agent: Parameters of the agent.
        r: Joint positions [rad, m].
        to_base: Rotation from the payload frame to the base frame, for moments; None: the frames are parallel.

    Returns:
        The matrix, forces [1/kg] before moments [1/(kg m^2)], base frame.
    """
    q = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, r))
    n = agent.tree.arms
    B = q.J_tip.reshape(3 * n, -1)
    if agent.moment_axis is not None:
        B = jnp.concatenate([B, tip_rotation_jacobian(agent, q, jnp.eye(3) if to_base is None else to_base)])
    _, d, Y = udu_eliminate(q.M_bar, B.T)
    translation = jnp.tile(jnp.eye(3), (n, n)) / q.mass
    if (moments := len(agent.tree.moment_arms)) > 0:
        translation = jnp.pad(translation, (0, moments))
    return matmul((d[:, None] * Y).T, Y) + translation


def min_delassus_singular_value(team: Team, team_state: State) -> Float[Array, "agents"]:
    """Compute the smallest singular value of each agent's Delassus matrix; zero for a redundant or singular grasp.

    Args:
        team: Team.
        team_state: State of the team.

    Returns:
        Singular values in team order [1/kg].
    """
    return jnp.concatenate(
        [
            jnp.linalg.eigvalsh(_delassus_matrices(group, state, team_state.payload))[:, 0]
            for group, state in zip(team.agent_groups, team_state.agents, strict=True)
        ]
    )


def _delassus_matrices(
    group: AerialManipulator, state: AgentState, payload: PayloadState
) -> Float[Array, "agents rows rows"]:
    """Return the Delassus matrix of each agent of a group."""
    if group.moment_axis is None:
        return jax.vmap(delassus_matrix)(group, state.r)
    return jax.vmap(delassus_matrix)(group, state.r, matmul(transpose(state.R), payload.R[None]))


def describe_redundant_arms(S: np.ndarray, moment_arms: Sequence[int] = ()) -> str:
    """Describe the arms with a share in the contact force that accelerates the contacts least.

    Args:
        S: Delassus matrix of one agent [1/kg].
        moment_arms: Arms of the last rows, those of moments.

    Returns:
        A clause for messages, such as "the constraints of arms 1 and 2 are redundant".
    """
    _, vectors = np.linalg.eigh(S)
    forces = len(S) - len(moment_arms)
    share = np.linalg.norm(vectors[:forces, 0].reshape(-1, 3), axis=1)
    for arm, component in zip(moment_arms, vectors[forces:, 0], strict=True):
        share[arm] = np.hypot(share[arm], component)
    arms = [str(b + 1) for b in range(len(share)) if share[b] > 0.1]
    if len(arms) == 1:
        return f"arm {arms[0]} is singular"
    return f"the constraints of arms {' and '.join(arms)} are redundant"


def check_grasp(team: Team, state: State, names: Sequence[str] = ()) -> None:
    """Test whether contact forces are unique.

    Args:
        team: Team.
        state: State of the team.
        names: Names of the agents in team order, for messages.

    Raises:
        ValueError: If the Delassus matrix of an agent is singular, condition number above `MAX_CONDITION`. The message
            contains agent, rank, condition number, singular values and redundant arms.
    """
    faults = []
    for name, agent, r, R in iter_agents(team, state, names):
        S = np.asarray(_delassus_matrix(agent, r, *_to_base(agent, R, state)))
        values = np.linalg.eigvalsh(S)
        rank = int((values > values[-1] / MAX_CONDITION).sum())
        if rank < len(values):
            faults.append(
                f"{name}: rank {rank} of {len(values)}, condition {values[-1] / max(values[0], 1e-300):.3g}, singular "
                f"values {_format_values(values[::-1])} 1/kg, {describe_redundant_arms(S, agent.tree.moment_arms)}"
                + _describe_missing_joints(agent.tree.arms, agent.tree.joints)
            )
    if faults:
        raise ValueError("redundant or singular grasp, so contact forces are not unique. " + "; ".join(faults))


def grasp_condition(team: Team, state: State) -> float:
    """Compute the condition number of the team's `A M^-1 A^T`.

    Args:
        team: Team.
        state: State of the team.

    Returns:
        The condition number.
    """
    return float(np.linalg.cond(np.asarray(_team_delassus_matrix(team, state))))


def check_controllability(team: Team, state: State, names: Sequence[str] = ()) -> None:
    """Test whether every payload wrench and the attitude of every agent can be commanded.

    The grasp matrix must have rank 6, which requires three contacts that are not collinear. An agent with n arms must
    have `n_r >= 3 n - 3` joints and a grasp Jacobian `[I, d rho / d r]` of rank 3 n with a condition number below
    `MAX_JACOBIAN_CONDITION`. Then the motion of the payload and the attitude of the agent determine its position and
    joints. The grasp matrix of forces may have a lower rank if the team is one rigid body.

    Args:
        team: Team.
        state: State of the team.
        names: Names of the agents in team order, for messages.

    Raises:
        ValueError: If a condition is violated; the message contains rank, condition number and singular values.
    """
    G = grasp_matrix_singular_values(team)
    rank = int((G[0] < 1e6 * G).sum())
    if rank < 6 and not team.is_rigid_assembly:
        raise ValueError(
            f"the grasp matrix of {', '.join(contact_names(team, names))} has rank {rank} of 6, condition "
            f"{G[0] / max(G[-1], 1e-300):.3g}, singular values {_format_values(G)}: "
            "contact forces cannot generate every moment; use three contacts that are not collinear"
        )
    for name, agent, r, _ in iter_agents(team, state, names):
        n, n_r = agent.tree.arms, agent.tree.joints
        if n_r < 3 * n - 3:
            raise ValueError(
                f"{name}: {n_r} joints for {n} arms limit the rank of its grasp Jacobian to {3 + n_r} of {3 * n}; its "
                f"attitude can be commanded only with {3 * n - 3} joints or more"
            )
        J, _ = grasp_jacobian_svd(agent, r)
        if not J[-1] * MAX_JACOBIAN_CONDITION > J[0]:
            raise ValueError(
                f"{name}: grasp Jacobian is nearly singular at joints {_format_values(np.asarray(r))}: singular values "
                f"{_format_values(J)}, condition {J[0] / max(J[-1], 1e-300):.3g}, allowed {MAX_JACOBIAN_CONDITION:g}"
            )


def grasp_matrix_singular_values(team: Team, length: float = 1.0) -> np.ndarray:
    """Compute the six singular values of the grasp matrix at `R = I`, with scaled moments.

    Args:
        team: Team.
        length: Unit of length of the moments [m].

    Returns:
        Singular values in descending order.
    """
    scale = np.repeat([1.0, 1 / length], 3)[:, None]
    return np.linalg.svd(scale * np.asarray(_team_grasp_matrix(team, np.eye(3))), compute_uv=False)


def grasp_jacobian_svd(agent: AerialManipulator, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the singular value decomposition of the grasp Jacobian `[I, d rho / d r]` of an agent.

    Args:
        agent: Parameters of the agent.
        r: Joint positions [rad, m].

    Returns:
        Singular values in descending order, and the share of each joint in the motion that moves the contacts least.
    """
    _, singular, Vt = np.linalg.svd(np.asarray(_grasp_jacobian(agent, r)))
    return singular, np.abs(Vt[len(singular) - 1, 3:])


def iter_agents(
    team: Team, team_state: State, names: Sequence[str]
) -> Iterator[tuple[str, AerialManipulator, np.ndarray, np.ndarray]]:
    """Iterate over the agents in team order.

    Args:
        team: Team.
        team_state: State of the team.
        names: Names of the agents in team order; empty for default names.

    Yields:
        Name, parameters, joint positions [rad, m] and attitude.
    """
    name = iter(agent_names(team, names))
    for group, state in zip(team.agent_groups, team_state.agents, strict=True):
        on_host = jax.tree.map(np.asarray, (group, state))
        for j in range(state.r.shape[0]):
            agent, q = jax.tree.map(lambda leaf, j=j: leaf[j], on_host)
            yield next(name), agent, q.r, q.R


def _describe_missing_joints(arms: int, joints: int) -> str:
    """Describe a lack of joints for the fixed distances between contacts; "" if there are enough."""
    fixed = {1: 0, 2: 1}.get(arms, 3 * arms - 6)
    if joints >= fixed:
        return ""
    return f" (the payload fixes {fixed} distances between its {arms} contacts; {joints} joints are too few)"


def _format_values(values: np.ndarray) -> str:
    """Format numbers with three digits."""
    return ", ".join(f"{value:.3g}" for value in values)


@jax.jit
def _grasp_jacobian(agent: AerialManipulator, r: Float[Array, "n_r"]) -> Float[Array, "forces free"]:
    """Compute the grasp Jacobian `[I, d rho / d r]` of an agent."""
    n = agent.tree.arms
    B = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, r)).J_tip[:, :, 3:]
    return jnp.concatenate([jnp.tile(jnp.eye(3), (n, 1)), B.reshape(3 * n, -1)], axis=1)


_delassus_matrix = jax.jit(delassus_matrix)


def _to_base(agent: AerialManipulator, R: np.ndarray, state: State) -> tuple[np.ndarray, ...]:
    """Return the rotation from the payload frame to the base frame for contacts that bear moments; () without them."""
    return () if agent.moment_axis is None else (R.T @ np.asarray(state.payload.R),)


_team_grasp_matrix = jax.jit(lambda team, R: grasp_matrix(contact_points(team), R))


def _team_delassus_matrix(team: Team, state: State) -> np.ndarray:
    """Compute `A M^-1 A^T` of the team [1/kg]; each contact is expressed in the base frame of its agent."""
    agents = list(iter_agents(team, state, ()))
    blocks = [
        (np.asarray(_delassus_matrix(agent, r, *_to_base(agent, R, state))), np.asarray(R)) for _, agent, r, R in agents
    ]
    arms = [agent.tree.arms for _, agent, _, _ in agents]
    G = np.asarray(_team_grasp_matrix(team, state.payload.R)).reshape(6, -1, 3)
    turn = np.repeat(np.array([R for _, R in blocks]), arms, axis=0)
    forces = np.einsum("gci,cik->gck", G, turn).reshape(6, -1).T
    rows, start = [], 0
    for _, agent, _, _ in agents:
        rows.append(forces[start : start + 3 * agent.tree.arms])
        start += 3 * agent.tree.arms
        if agent.moment_axis is not None:
            rows.append(np.pad(np.asarray(agent.moment_axis), ((0, 0), (3, 0))))
    P = np.concatenate(rows)
    M_L = _block_diagonal([float(team.payload.mass) * np.eye(3), np.asarray(team.payload.inertia)])
    return _block_diagonal([S for S, _ in blocks]) + P @ np.linalg.solve(M_L, P.T)


def _block_diagonal(blocks: Sequence[np.ndarray]) -> np.ndarray:
    """Place square blocks on the diagonal; the import of the SciPy equivalent takes 0.2 s."""
    ends = np.cumsum([len(block) for block in blocks])
    matrix = np.zeros((ends[-1], ends[-1]))
    for block, end in zip(blocks, ends, strict=True):
        matrix[end - len(block) : end, end - len(block) : end] = block
    return matrix
