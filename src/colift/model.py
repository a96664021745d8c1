"""The nouns: parameters and states of a team, as immutable PyTrees.

Frames: world unless the name says otherwise; body rates are in the body's own frame. Agents that share a
`Tree` (joints and arms, not numbers) are stacked on a leading `agents` axis in one group; a team is a tuple
of such groups, so unlike agents need no padding. Two values of one type `Team` exist in a run: the truth,
which the plant integrates, and the nominal one, which flies.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, ArrayLike, Float

from colift.pytree import pytree, static


@pytree
class Tree:
    """Structure of an agent: joint k moves body k + 1, body 0 is the base. Hashable, part of the trace."""

    parents: tuple[int, ...] = static()
    """Parent body of body k + 1, at most k."""
    prismatic: tuple[bool, ...] = static()
    """Whether joint k slides along its axis rather than turning about it."""
    tips: tuple[int, ...] = static()
    """Body that carries the contact point of each arm."""

    def __post_init__(self) -> None:
        """Raise `ValueError` for what is no tree: a parent that comes later, a tip on no body, no arm at all."""
        if len(self.parents) != len(self.prismatic):
            raise ValueError(f"Tree: {len(self.parents)} parents for {len(self.prismatic)} joints (prismatic)")
        for k, parent in enumerate(self.parents):
            if not 0 <= parent <= k:
                raise ValueError(
                    f"Tree: parents[{k}] = {parent}: the body of joint {k} hangs on one of bodies 0 to {k}"
                )
        if not self.tips:
            raise ValueError("Tree: tips = (): an agent holds the payload with one arm or more")
        for i, tip in enumerate(self.tips):
            if not 0 <= tip <= len(self.parents):
                raise ValueError(f"Tree: tips[{i}] = {tip}: must be one of bodies 0 to {len(self.parents)}")

    @property
    def joints(self) -> int:
        """Number of joints `n_r`."""
        return len(self.parents)

    @property
    def arms(self) -> int:
        """Number of arms `n`, one contact each."""
        return len(self.tips)

    @property
    def ancestors(self) -> np.ndarray:
        """Boolean `(bodies, n_r)`: whether joint k moves body i."""
        moved = np.zeros((self.joints + 1, self.joints), dtype=bool)
        for k, parent in enumerate(self.parents):
            moved[k + 1] = moved[parent]
            moved[k + 1, k] = True
        return moved


@pytree
class Agent:
    """Parameters of one aerial manipulator; with a leading axis, of a group of alike ones."""

    tree: Tree
    mass: Float[Array, "*agents bodies"]  # kg
    com: Float[Array, "*agents bodies 3"]  # m, centre of mass in the body's frame
    inertia: Float[Array, "*agents bodies 3 3"]  # kg m^2, about the centre of mass, body's frame
    joint_position: Float[Array, "*agents n_r 3"]  # m, joint origin in the parent's frame
    joint_rotation: Float[Array, "*agents n_r 3 3"]  # joint frame at rest, to the parent's frame
    joint_axis: Float[Array, "*agents n_r 3"]  # unit vector, joint frame
    tip: Float[Array, "*agents arms 3"]  # m, contact point in the tip body's frame
    contact: Float[Array, "*agents arms 3"]  # m, attachment c_L in the payload's frame
    thrust_max: Float[Array, "*agents"]  # N


@pytree
class Payload:
    """The rigid payload; its frame sits at its centre of mass."""

    mass: Float[Array, ""]  # kg
    inertia: Float[Array, "3 3"]  # kg m^2, about the centre of mass, payload frame


@pytree
class Team:
    """All parameters of the plant, or of what the controller believes of it."""

    groups: tuple[Agent, ...]
    payload: Payload
    gravity: Float[Array, "3"]  # m/s^2, a_g in the world frame

    @property
    def sizes(self) -> tuple[int, ...]:
        """Agents in each group."""
        return tuple(group.mass.shape[0] for group in self.groups)

    @property
    def contacts(self) -> int:
        """Number of contacts of the whole team."""
        return sum(size * group.tree.arms for size, group in zip(self.sizes, self.groups, strict=True))


@pytree
class AgentState:
    """`q_bar = (R, x, r, omega, v, r_dot)` of one agent, or of a group on a leading axis."""

    R: Float[Array, "*agents 3 3"]  # base attitude, body to world
    x: Float[Array, "*agents 3"]  # m, centre of mass of the whole agent
    r: Float[Array, "*agents n_r"]  # rad or m
    omega: Float[Array, "*agents 3"]  # rad/s, body frame
    v: Float[Array, "*agents 3"]  # m/s, velocity of the centre of mass
    r_dot: Float[Array, "*agents n_r"]  # rad/s or m/s


@pytree
class PayloadState:
    """`q_L = (p, v, R, omega)` of the payload."""

    R: Float[Array, "3 3"]
    p: Float[Array, "3"]  # m
    omega: Float[Array, "3"]  # rad/s, payload frame
    v: Float[Array, "3"]  # m/s


@pytree
class State:
    """The differential state z: 12 (N + 1) + 2 N n_r numbers on the grasp's manifold."""

    agents: tuple[AgentState, ...]
    payload: PayloadState


@pytree
class Clock:
    """The time of a tick, and how long one lasts: one clock for a whole flight."""

    t: Float[Array, ""]  # s
    dt: Float[Array, ""]  # s


@pytree
class AgentInput:
    """What an agent commands: thrust along `R e_3`, body torque, joint torques or forces."""

    u: Float[Array, "*agents"]  # N
    tau: Float[Array, "*agents 3"]  # N m, body frame
    tau_r: Float[Array, "*agents n_r"]  # N m or N


@pytree
class AgentForce:
    """A generalized force on one agent: `f_x` on its centre of mass, `(f_w, f_r)` on `(mu, nu)`."""

    f_x: Float[Array, "*agents 3"]  # N, world
    f_w: Float[Array, "*agents 3"]  # N m, body frame
    f_r: Float[Array, "*agents n_r"]  # N m or N


@pytree
class Wrench:
    """A force in the world frame and a moment in the payload frame, on the payload."""

    F: Float[Array, "3"]  # N, world
    tau: Float[Array, "3"]  # N m, payload frame


@pytree
class Residual:
    """The unknown `f_uk` of agents and payload, or an estimate of it."""

    agents: tuple[AgentForce, ...]
    payload: Wrench


Inputs = tuple[AgentInput, ...]
"""What acts on the agents or is asked of them, by group."""
Unknown = Callable[[State, Float[Array, ""]], Residual]
"""The residual of a state and of the time since a step began, s."""


def flat_agent(q: AgentState) -> Float[Array, "inputs"]:
    """`vec(R), x, r, omega, v, r_dot`: the inputs of an agent's learned map (Eq. dataset_agent_online)."""
    return jnp.concatenate([q.R.reshape(9), q.x, q.r, q.omega, q.v, q.r_dot])


def flat_payload(q: PayloadState, a: Float[Array, "6"]) -> Float[Array, "24"]:
    """`p, v, vec(R), omega`, the payload's state (Eq. dataset_payload_online), then `(v_dot - a_g, w_dot)`."""
    return jnp.concatenate([q.p, q.v, q.R.reshape(9), q.omega, a])


def agent_force(y: Float[Array, "agents outputs"]) -> AgentForce:
    """Agents' forces of their outputs, `(f_x, f_w, f_r)` in a row."""
    return AgentForce(f_x=y[:, :3], f_w=y[:, 3:6], f_r=y[:, 6:])


def with_wrench(f: Residual, W: Float[Array, "6"]) -> Residual:
    """The residual and a wrench on the payload, N and N m."""
    return dataclasses.replace(f, payload=Wrench(F=f.payload.F + W[:3], tau=f.payload.tau + W[3:]))


def no_force(team: Team) -> Residual:
    """The zero residual of a team."""
    return Residual(
        agents=tuple(
            AgentForce(f_x=jnp.zeros((size, 3)), f_w=jnp.zeros((size, 3)), f_r=jnp.zeros((size, group.tree.joints)))
            for size, group in zip(team.sizes, team.groups, strict=True)
        ),
        payload=Wrench(F=jnp.zeros(3), tau=jnp.zeros(3)),
    )


def stack(agents: list[Agent]) -> Agent:
    """Agents with one `Tree` as a group on a leading axis."""
    return jax.tree.map(lambda *leaves: jnp.asarray(np.stack(leaves)), *agents)


def agent_names(team: Team, names: Sequence[str] = ()) -> tuple[str, ...]:
    """One name an agent, in the order of the groups: as given, or `agent 1`, `agent 2`, ..."""
    count = sum(team.sizes)
    if names and len(names) != count:
        raise ValueError(f"names: {len(names)} given for {count} agents: {list(names)}")
    return tuple(names) or tuple(f"agent {j + 1}" for j in range(count))


def check(team: Team, names: Sequence[str] = ()) -> None:
    """Raise `ValueError` with name and numbers unless every body is physical and every joint frame is one; on the host.

    Masses are positive, inertias symmetric, positive definite and within the triangle inequality (no principal moment
    exceeds the sum of the others), joint axes unit vectors, joint frames rotations, thrusts positive, points finite.
    """
    if not np.isfinite(team.gravity).all():
        raise ValueError(f"gravity {np.asarray(team.gravity).tolist()} m/s^2 is not finite")
    check_body("the payload", team.payload.mass, team.payload.inertia)
    groups = [jax.tree.map(np.asarray, group) for group in team.groups]
    agents = [(group, j) for group, size in zip(groups, team.sizes, strict=True) for j in range(size)]
    for name, (group, j) in zip(agent_names(team, names), agents, strict=True):
        for i in range(group.tree.joints + 1):
            check_body(f"{name}, body {i}", group.mass[j, i], group.inertia[j, i])
        if not 0 < group.thrust_max[j] < np.inf:
            raise ValueError(f"{name}: thrust_max {group.thrust_max[j]:g} N is not positive and finite")
        for what in ("com", "joint_position", "tip", "contact"):
            if not np.isfinite(points := np.asarray(getattr(group, what)[j])).all():
                raise ValueError(f"{name}: {what} {points.tolist()} m is not finite")
        for k in range(group.tree.joints):
            axis, R = np.asarray(group.joint_axis[j, k]), np.asarray(group.joint_rotation[j, k])
            if not abs(np.linalg.norm(axis) - 1) <= 1e-9:
                raise ValueError(f"{name}, joint {k}: joint_axis {axis.tolist()} is not a unit vector")
            if not (np.allclose(R.T @ R, np.eye(3), atol=1e-9) and np.linalg.det(R) > 0):
                raise ValueError(f"{name}, joint {k}: joint_rotation {R.tolist()} is not a rotation matrix")


def check_mass(body: str, mass: ArrayLike) -> None:
    """Raise `ValueError`, which begins with `body`, for a mass (kg) that is not positive and finite."""
    m = float(np.asarray(mass))
    if not (np.isfinite(m) and m > 0):
        raise ValueError(f"{body}: mass {m:g} kg is not positive{'' if np.isfinite(m) else ' and finite'}")


def check_body(body: str, mass: ArrayLike, inertia: ArrayLike) -> None:
    """Raise `ValueError`, which begins with `body`, for a mass (kg) and an inertia (kg m^2) that no rigid body has."""
    check_mass(body, mass)
    J = np.asarray(inertia)
    if J.shape != (3, 3) or not np.isfinite(J).all():
        raise ValueError(f"{body}: inertia {J.tolist()} kg m^2 is not three rows of three finite numbers")
    if not np.allclose(J, J.T, rtol=0, atol=1e-9 * np.abs(J).max()):
        raise ValueError(f"{body}: inertia {J.tolist()} kg m^2 is not symmetric")
    a, b, c = np.linalg.eigvalsh(J)
    if not a > 0:
        raise ValueError(
            f"{body}: inertia is not positive definite: principal moments {a:.4g}, {b:.4g}, {c:.4g} kg m^2"
        )
    if c > (a + b) * (1 + 1e-9):
        raise ValueError(
            f"{body}: inertia breaks the triangle inequality: principal moments {a:.4g}, {b:.4g}, {c:.4g} kg m^2, "
            f"and {c:.4g} > {a + b:.4g}"
        )
