"""Parameters of a team as immutable PyTrees.

Agents with the same `KinematicTree` form a group; their parameters are stacked on a leading `agents` axis. A team is a
tuple of groups, so agents of different structure need no padding. A simulation uses two values of `Team`: the true
parameters of the plant and the nominal parameters of the controller.

Quantities are expressed in the world frame unless stated otherwise; body rates and torques are in the body frame.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import pytree, static, transfer

OPEN_COMPLIANCE = 1e12
"""Compliance of an open contact [1/kg], in the unit of `A M^-1 A^T`: no force acts that changes a motion.

Closed contacts have values of about 10 1/kg, so the force of an open contact is about 1e-11 of that of a closed one.
"""


POINT, SOFT_FINGER, RIGID = "point", "soft_finger", "rigid"
"""Types of contacts: forces alone, forces and the moment about the contact normal, forces and all moments.

References:
    Murray, Li, Sastry, *A Mathematical Introduction to Robotic Manipulation*, 1994, ch. 5, sec. 2.1 (soft-finger
    contact); a rigid grip is a soft-finger contact that bears the other two moments as well.
"""
MOMENTS = {POINT: 0, SOFT_FINGER: 1, RIGID: 3}
"""Number of directions in which a contact of each type bears a moment."""


@pytree
class KinematicTree:
    """Kinematic structure of an agent: joint k moves body k + 1, body 0 is the base.

    The structure is hashable and static under `jax.jit`.
    """

    parents: tuple[int, ...] = static()
    """Parent body of body k + 1, at most k."""
    prismatic: tuple[bool, ...] = static()
    """True if joint k translates along its axis; otherwise it rotates about it."""
    tip_bodies: tuple[int, ...] = static()
    """Body that carries the contact point of each arm."""
    contact_types: tuple[str, ...] = static(default=())
    """Type of the contact of each arm, a key of `MOMENTS`; () if all contacts are points."""

    def __post_init__(self) -> None:
        """Validate the structure.

        Raises:
            ValueError: If the lengths differ, a parent has a larger index than its child, a tip is on no body, there
                is no arm, or a type of contact does not exist.
        """
        if len(self.parents) != len(self.prismatic):
            raise ValueError(f"KinematicTree: {len(self.parents)} parents for {len(self.prismatic)} joints (prismatic)")
        for k, parent in enumerate(self.parents):
            if not 0 <= parent <= k:
                raise ValueError(f"KinematicTree: parents[{k}] is {parent}, must be one of bodies 0 to {k}")
        if not self.tip_bodies:
            raise ValueError("KinematicTree: tip_bodies is (), must contain at least one body")
        for i, tip in enumerate(self.tip_bodies):
            if not 0 <= tip <= len(self.parents):
                raise ValueError(
                    f"KinematicTree: tip_bodies[{i}] is {tip}, must be one of bodies 0 to {len(self.parents)}"
                )
        if self.contact_types and len(self.contact_types) != len(self.tip_bodies):
            raise ValueError(
                f"KinematicTree: {len(self.contact_types)} contact_types for {len(self.tip_bodies)} arms (tip_bodies)"
            )
        for i, kind in enumerate(self.contact_types):
            if kind not in MOMENTS:
                raise ValueError(f"KinematicTree: contact_types[{i}] is {kind!r}, must be one of {', '.join(MOMENTS)}")

    @property
    def joints(self) -> int:
        """Number of joints, n_r."""
        return len(self.parents)

    @property
    def arms(self) -> int:
        """Number of arms, n; each has one contact."""
        return len(self.tip_bodies)

    @property
    def moment_arms(self) -> tuple[int, ...]:
        """Arm of each direction in which a contact bears a moment, contact by contact."""
        return tuple(b for b, kind in enumerate(self.contact_types) for _ in range(MOMENTS[kind]))

    @property
    def has_rigid_grips_only(self) -> bool:
        """True if the agent has no joints and is part of one rigid body with the payload."""
        return not self.parents and set(self.contact_types) == {RIGID}

    @property
    def ancestors(self) -> np.ndarray:
        """Boolean matrix with one row per body and one column per joint, true if joint k moves body i."""
        moved = np.zeros((self.joints + 1, self.joints), dtype=bool)
        for k, parent in enumerate(self.parents):
            moved[k + 1] = moved[parent]
            moved[k + 1, k] = True
        return moved


@pytree
class AerialManipulator:
    """Parameters of one aerial manipulator, or of a group with a leading `agents` axis."""

    tree: KinematicTree  # kinematic structure
    mass: Float[Array, "*agents bodies"]  # kg
    com: Float[Array, "*agents bodies 3"]  # m, center of mass in the body frame
    inertia: Float[Array, "*agents bodies 3 3"]  # kg m^2, about the center of mass, body frame
    joint_position: Float[Array, "*agents n_r 3"]  # m, joint origin in the parent frame
    joint_rotation: Float[Array, "*agents n_r 3 3"]  # joint frame at position zero to parent frame
    joint_axis: Float[Array, "*agents n_r 3"]  # unit vector, joint frame
    tip_position: Float[Array, "*agents arms 3"]  # m, contact point in the frame of the tip body
    contact_position: Float[Array, "*agents arms 3"]  # m, attachment c_L in the payload frame
    thrust_max: Float[Array, "*agents"]  # N, maximum thrust
    contact_compliance: Float[Array, "*agents arms"] | None = None  # 1/kg, added to `A M^-1 A^T`; None: closed contacts
    moment_axis: Float[Array, "*agents moments 3"] | None = None  # unit vectors, payload frame, directions of
    # `tree.moment_arms`; None if all contacts are points
    grip_rotation: Float[Array, "*agents arms 3 3"] | None = None  # frame of the tip body to payload frame, of rigid
    # grips; None without one

    @property
    def closed_contacts(self) -> Float[Array, "*agents arms"] | None:
        """1 for closed and 0 for open contacts; None if no contact can open."""
        return None if self.contact_compliance is None else (self.contact_compliance == 0).astype(float)


@pytree
class Payload:
    """Parameters of the rigid payload; the origin of its frame is its center of mass."""

    mass: Float[Array, ""]  # kg
    inertia: Float[Array, "3 3"]  # kg m^2, about the center of mass, payload frame


@pytree
class Team:
    """Parameters of a team: true ones in the plant, nominal ones in the controller."""

    agent_groups: tuple[AerialManipulator, ...]  # agents with equal structure form a group
    payload: Payload  # mass and inertia of the payload
    gravity: Float[Array, "3"]  # m/s^2, gravitational acceleration a_g, world frame

    @property
    def sizes(self) -> tuple[int, ...]:
        """Number of agents in each group."""
        return tuple(group.mass.shape[0] for group in self.agent_groups)

    @property
    def closed_contacts(self) -> Float[Array, "contacts"] | None:
        """1 for closed and 0 for open contacts, in team order; None if no contact can open."""
        if all(group.contact_compliance is None for group in self.agent_groups):
            return None
        closed = [group.closed_contacts for group in self.agent_groups]
        return jnp.concatenate(
            [
                jnp.ones(group.contact_position.shape[:2]).reshape(-1) if part is None else part.reshape(-1)
                for group, part in zip(self.agent_groups, closed, strict=True)
            ]
        )

    @property
    def zero_contact_moments(self) -> tuple[Float[Array, "_agents _arms 3"], ...] | None:
        """Contact moments of zero, by group; None if all contacts are points."""
        if all(group.moment_axis is None for group in self.agent_groups):
            return None
        return tuple(jnp.zeros_like(group.contact_position) for group in self.agent_groups)

    @property
    def is_rigid_assembly(self) -> bool:
        """True if agents and payload are one rigid body: no agent has joints, and all grips are rigid."""
        return all(group.tree.has_rigid_grips_only for group in self.agent_groups)

    @property
    def contacts(self) -> int:
        """Number of contacts of the team."""
        return sum(size * group.tree.arms for size, group in zip(self.sizes, self.agent_groups, strict=True))


def stack_agents(agents: list[AerialManipulator]) -> AerialManipulator:
    """Stack agents with the same kinematic tree to a group.

    Args:
        agents: Parameters of single agents.

    Returns:
        Parameters with a leading `agents` axis.
    """
    return jax.tree.map(lambda *leaves: transfer(np.stack(leaves)), *agents)


def select_agent(group: AerialManipulator, k: int) -> AerialManipulator:
    """Return one agent of a group, on the host; indexing a JAX array would compile a program for each shape.

    Args:
        group: Parameters with a leading `agents` axis.
        k: Index of the agent.

    Returns:
        Parameters of the agent.
    """
    return jax.tree.map(lambda leaf: transfer(np.asarray(leaf)[k]), group)


def agent_names(team: Team, names: Sequence[str] = ()) -> tuple[str, ...]:
    """Return one name per agent, in team order.

    Args:
        team: Team.
        names: Names in team order; default: `agent 1`, `agent 2`, ...

    Returns:
        The names.

    Raises:
        ValueError: If the number of names differs from the number of agents.
    """
    count = sum(team.sizes)
    if names and len(names) != count:
        raise ValueError(f"names: {len(names)} given for {count} agents: {list(names)}")
    return tuple(names) or tuple(f"agent {j + 1}" for j in range(count))
