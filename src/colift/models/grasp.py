"""The rigid grasp: constraints, grasp matrix, internal forces."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import matmul, matvec, udu_eliminate
from colift.math.vmap import vmap_agents
from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator, Team, agent_names
from colift.models.state import AgentState, PayloadState, State, Wrench

MAX_CONDITION = 1e12  # of an agent's contact admittance: beyond, contact forces have fewer than four digits
# of an agent's grasp Jacobian; the reference agent has 13 at rest, 1e3 at 0.005 rad from straight down
MAX_JACOBIAN_CONDITION = 1e3

Contacts = Float[Array, "contacts 3"]


def contact_points(team: Team) -> Contacts:
    """Attachment points `c` of all contacts, payload frame, m, in the order groups, agents, arms."""
    return jnp.concatenate([group.contact_position.reshape(-1, 3) for group in team.agent_groups])


def contact_names(team: Team, names: Sequence[str] = ()) -> tuple[str, ...]:
    """One label a contact, `<agent> arm <b>`, in the order of `contacts`."""
    arms = [group.tree.arms for size, group in zip(team.sizes, team.agent_groups, strict=True) for _ in range(size)]
    return tuple(
        f"{name} arm {b + 1}" for name, n in zip(agent_names(team, names), arms, strict=True) for b in range(n)
    )


def split_contacts(team: Team, lam: Contacts) -> tuple[Float[Array, "_agents _arms 3"], ...]:
    """One row a contact, cut into the groups' `(agents, arms, 3)`."""
    parts, start = [], 0
    for size, group in zip(team.sizes, team.agent_groups, strict=True):
        stop = start + size * group.tree.arms
        parts.append(lam[start:stop].reshape(size, group.tree.arms, 3))
        start = stop
    return tuple(parts)


def stack_contacts(lam: tuple[Float[Array, "_agents _arms 3"], ...]) -> Contacts:
    """The inverse of `split`."""
    return jnp.concatenate([part.reshape(-1, 3) for part in lam])


def payload_wrench(c: Contacts, R: Float[Array, "3 3"], lam: Contacts) -> Wrench:
    """`W = G lam`: `F = sum lam` in the world, `tau = sum c x R^T lam` in the payload frame (docs/errata.md, row 1)."""
    return Wrench(F=lam.sum(0), tau=so3.cross(c, lam @ R).sum(0))


def grasp_matrix(c: Contacts, R: Float[Array, "3 3"]) -> Float[Array, "6 3*contacts"]:
    """The grasp matrix `G = [I ...; hat(c) R^T ...]` with `W = G lam` (lam stacked)."""
    moment = so3.hat(c) @ R.T[None]
    force = so3.identity((c.shape[0],))
    return jnp.concatenate([force, moment], axis=1).transpose(1, 0, 2).reshape(6, -1)


def grasp_nullspace(c: np.ndarray) -> np.ndarray:
    """An orthonormal basis of `ker G`, columns, at `R = I`: turned by R it is one at every attitude.

    `c` holds the contacts by row. The basis comes from the singular value decomposition on the host.
    """
    G = np.asarray(grasp_matrix(jnp.asarray(c), jnp.eye(3)))
    _, singular, Vt = np.linalg.svd(G)
    rank = int((singular > 1e-10 * singular[0]).sum())
    return Vt[rank:].T


def contact_error(
    agent: AerialManipulator, q: aerial_manipulator.CentroidalModel, state: AgentState, payload: PayloadState
) -> Float[Array, "arms 3"]:
    """`R^T phi_b`: how far one agent's tips are from the payload's contacts, base frame, m (Eq. dae_constraints)."""
    c = matvec(payload.R[None], agent.contact_position)
    return q.tip_from_com + matvec(state.R.T[None], (state.x - payload.p)[None] - c)


def contact_error_rate(
    agent: AerialManipulator, q: aerial_manipulator.CentroidalModel, state: AgentState, payload: PayloadState
) -> Float[Array, "arms 3"]:
    """`R^T phi_b_dot = B_b xi + R^T (v - v_L - R_L (omega_L x c_b))`, base frame, m/s."""
    xi = jnp.concatenate([state.omega, state.r_dot])
    c_dot = matvec(payload.R[None], so3.cross(payload.omega[None], agent.contact_position))
    return matvec(q.J_tip, xi[None]) + matvec(state.R.T[None], (state.v - payload.v)[None] - c_dot)


Gap = Callable[
    [AerialManipulator, aerial_manipulator.CentroidalModel, AgentState, PayloadState], Float[Array, "arms 3"]
]


def constraint_residual(team: Team, state: State) -> Contacts:
    """Constraint `phi_b = x + R rho_b(r) - (p + R_L c_b)` of every contact, world, m (Eq. dae_constraints)."""
    return _of_team(contact_error, team, state)


def constraint_rate(team: Team, state: State) -> Contacts:
    """Constraint velocity `v + R B_b xi - (v_L + R_L (omega_L x c_b))` of every contact, world, m/s."""
    return _of_team(contact_error_rate, team, state)


def _of_team(gap: Gap, team: Team, team_state: State) -> Contacts:
    def of_one(agent: AerialManipulator, state: AgentState) -> Float[Array, "arms 3"]:
        q = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, state.r))
        return matvec(state.R[None], gap(agent, q, state, team_state.payload))

    return stack_contacts(
        tuple(
            vmap_agents(of_one)(group, state) for group, state in zip(team.agent_groups, team_state.agents, strict=True)
        )
    )


def delassus_matrix(agent: AerialManipulator, r: Float[Array, "n_r"]) -> Float[Array, "forces forces"]:
    """`S = A M^-1 A^T = 1/m + B M_bar^-1 B^T`, 1/kg: how contacts yield to contact forces; base frame, a function of r.

    An agent flies freely, so whatever the payload can do to its contacts the agent can do as well: `ker S` lies in
    `ker P^T`, and the team's `A M^-1 A^T` is invertible if and only if every agent's S is. Its smallest eigenvalue
    is at least the smallest of theirs.
    """
    q = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, r))
    n = agent.tree.arms
    B = q.J_tip.reshape(3 * n, -1)
    _, d, Y = udu_eliminate(q.M_bar, B.T)
    return matmul((d[:, None] * Y).T, Y) + jnp.tile(jnp.eye(3), (n, n)) / q.mass


def min_delassus_singular_value(team: Team, team_state: State) -> Float[Array, "agents"]:
    """Smallest singular value of each agent's `admittance`, 1/kg: zero where its arms grasp redundantly or lock up."""
    return jnp.concatenate(
        [
            jnp.linalg.eigvalsh(jax.vmap(delassus_matrix)(group, state.r))[:, 0]
            for group, state in zip(team.agent_groups, team_state.agents, strict=True)
        ]
    )


def describe_redundant_arms(S: np.ndarray) -> str:
    """`arms 1 and 2 work against each other`: those that share in the force to which an `admittance` S yields least."""
    _, vectors = np.linalg.eigh(S)
    share = np.linalg.norm(vectors[:, 0].reshape(-1, 3), axis=1)
    arms = [str(b + 1) for b in range(len(share)) if share[b] > 0.1]
    return f"arm {arms[0]} locks up" if len(arms) == 1 else f"arms {' and '.join(arms)} work against each other"


def check_grasp(team: Team, state: State, names: Sequence[str] = ()) -> float:
    """Condition number of the team's `A M^-1 A^T` at z; on the host.

    Raises `ValueError` where that exceeds `CONDITION_MAX`, which leaves contact forces undefined, with rank, condition
    number and singular values, the agents at fault and the arms that work against each other.
    """
    faults = []
    for name, agent, r, _ in iter_agents(team, state, names):
        S = np.asarray(_admittance(agent, r))
        values = np.linalg.eigvalsh(S)
        rank = int((values > values[-1] / MAX_CONDITION).sum())
        if rank < len(values):
            faults.append(
                f"{name}: rank {rank} of {len(values)}, condition {values[-1] / max(values[0], 1e-300):.3g}, singular "
                f"values {_listed(values[::-1])} 1/kg, {describe_redundant_arms(S)}"
                + _too_few_joints(agent.tree.arms, agent.tree.joints)
            )
    if faults:
        raise ValueError("redundant or singular grasp, so contact forces are not unique. " + "; ".join(faults))
    return float(np.linalg.cond(np.asarray(_team_admittance(team, state))))


def check_controllability(team: Team, state: State, names: Sequence[str] = ()) -> None:
    """Raise `ValueError` unless every payload wrench and every agent's attitude can be commanded at z; on the host.

    The grasp matrix needs rank 6: three contacts that are not collinear. An agent needs `n_r >= 3 n - 3` joints and a
    grasp Jacobian `[I, d rho / d r]` of rank 3 n, better conditioned than `JACOBIAN_CONDITION_MAX`, so that the
    payload's motion and its attitude fix position and joints.
    """
    G = singular_values(team)
    rank = int((G[0] < 1e6 * G).sum())
    if rank < 6:
        raise ValueError(
            f"the grasp matrix of {', '.join(contact_names(team, names))} has rank {rank} of 6, condition "
            f"{G[0] / max(G[-1], 1e-300):.3g}, singular values {_listed(G)}: "
            "no force can turn the payload about every axis; use three contacts that are not collinear"
        )
    for name, agent, r, _ in iter_agents(team, state, names):
        n, n_r = agent.tree.arms, agent.tree.joints
        if n_r < 3 * n - 3:
            raise ValueError(
                f"{name}: {n_r} joints for {n} arms, so its grasp Jacobian has rank {3 + n_r} of {3 * n} at most; its "
                f"attitude is free only with {3 * n - 3} joints or more"
            )
        J, _ = grasp_jacobian_svd(agent, r)
        if not J[-1] * MAX_JACOBIAN_CONDITION > J[0]:
            raise ValueError(
                f"{name}: grasp Jacobian is nearly singular at joints {_listed(np.asarray(r))}: singular values "
                f"{_listed(J)}, condition {J[0] / max(J[-1], 1e-300):.3g}, allowed {MAX_JACOBIAN_CONDITION:g}"
            )


def singular_values(team: Team, length: float = 1.0) -> np.ndarray:
    """`(6,)` of the grasp matrix at `R = I`, largest first; moments in units of `length`, m, times 1 N; on the host."""
    scale = np.repeat([1.0, 1 / length], 3)[:, None]
    return np.linalg.svd(scale * np.asarray(_matrix(team, np.eye(3))), compute_uv=False)


def grasp_jacobian_svd(agent: AerialManipulator, r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Singular values of the grasp Jacobian `[I, d rho / d r]`, largest first, and the `(n_r,)` share of every joint.

    The share is of the motion that moves the contacts least; on the host.
    """
    _, singular, Vt = np.linalg.svd(np.asarray(_jacobian(agent, r)))
    return singular, np.abs(Vt[len(singular) - 1, 3:])


def iter_agents(
    team: Team, team_state: State, names: Sequence[str]
) -> Iterator[tuple[str, AerialManipulator, np.ndarray, np.ndarray]]:
    """Name, parameters, joints and attitude of every agent, in team order."""
    name = iter(agent_names(team, names))
    for group, state in zip(team.agent_groups, team_state.agents, strict=True):
        for j in range(state.r.shape[0]):
            own, q = jax.tree.map(lambda leaf, j=j: np.asarray(leaf)[j], (group, state))
            yield next(name), own, q.r, q.R


def _too_few_joints(arms: int, joints: int) -> str:
    fixed = {1: 0, 2: 1}.get(arms, 3 * arms - 6)
    if joints >= fixed:
        return ""
    return f" (the payload fixes {fixed} distances between its {arms} contacts; its {joints} joints cannot follow)"


def _listed(values: np.ndarray) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


@jax.jit
def _jacobian(agent: AerialManipulator, r: Float[Array, "n_r"]) -> Float[Array, "forces free"]:
    """`[I, d rho / d r]` of an agent's contacts."""
    n = agent.tree.arms
    B = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, r)).J_tip[:, :, 3:]
    return jnp.concatenate([jnp.tile(jnp.eye(3), (n, 1)), B.reshape(3 * n, -1)], axis=1)


_admittance = jax.jit(delassus_matrix)
_matrix = jax.jit(lambda team, R: grasp_matrix(contact_points(team), R))


def _team_admittance(team: Team, state: State) -> np.ndarray:
    """`A M^-1 A^T` of the whole team, 1/kg, in the frame of each contact's base."""
    blocks = [(np.asarray(_admittance(agent, r)), np.asarray(R)) for _, agent, r, R in iter_agents(team, state, ())]
    arms = [len(S) // 3 for S, _ in blocks]
    G = np.asarray(_matrix(team, state.payload.R)).reshape(6, -1, 3)
    turn = np.repeat(np.array([R for _, R in blocks]), arms, axis=0)
    P = np.einsum("gci,cik->gck", G, turn).reshape(6, -1).T
    M_L = _block_diagonal([float(team.payload.mass) * np.eye(3), np.asarray(team.payload.inertia)])
    return _block_diagonal([S for S, _ in blocks]) + P @ np.linalg.solve(M_L, P.T)


def _block_diagonal(blocks: Sequence[np.ndarray]) -> np.ndarray:
    """Square blocks along the diagonal (SciPy has it too, and takes 0.2 s to import)."""
    ends = np.cumsum([len(block) for block in blocks])
    whole = np.zeros((ends[-1], ends[-1]))
    for block, end in zip(blocks, ends, strict=True):
        whole[end - len(block) : end, end - len(block) : end] = block
    return whole
