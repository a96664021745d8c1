"""The nouns: parameters and states of a team, as immutable PyTrees.

Frames: world unless the name says otherwise; body rates are in the body's own frame. Agents that share a
`Tree` (joints and arms, not numbers) are stacked on a leading `agents` axis in one group; a team is a tuple
of such groups, so unlike agents need no padding. Two values of one type `Team` exist in a run: the truth,
which the plant integrates, and the nominal one, which flies.
"""

from __future__ import annotations

from collections.abc import Sequence

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import pytree, static


@pytree
class KinematicTree:
    """Structure of an agent: joint k moves body k + 1, body 0 is the base. Hashable, part of the trace."""

    parents: tuple[int, ...] = static()
    """Parent body of body k + 1, at most k."""
    prismatic: tuple[bool, ...] = static()
    """Whether joint k slides along its axis rather than turning about it."""
    tip_bodies: tuple[int, ...] = static()
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
        if not self.tip_bodies:
            raise ValueError("Tree: tips = (): an agent holds the payload with one arm or more")
        for i, tip in enumerate(self.tip_bodies):
            if not 0 <= tip <= len(self.parents):
                raise ValueError(f"Tree: tips[{i}] = {tip}: must be one of bodies 0 to {len(self.parents)}")

    @property
    def joints(self) -> int:
        """Number of joints `n_r`."""
        return len(self.parents)

    @property
    def arms(self) -> int:
        """Number of arms `n`, one contact each."""
        return len(self.tip_bodies)

    @property
    def ancestors(self) -> np.ndarray:
        """Boolean `(bodies, n_r)`: whether joint k moves body i."""
        moved = np.zeros((self.joints + 1, self.joints), dtype=bool)
        for k, parent in enumerate(self.parents):
            moved[k + 1] = moved[parent]
            moved[k + 1, k] = True
        return moved


@pytree
class AerialManipulator:
    """Parameters of one aerial manipulator; with a leading axis, of a group of alike ones."""

    tree: KinematicTree
    mass: Float[Array, "*agents bodies"]  # kg
    com: Float[Array, "*agents bodies 3"]  # m, centre of mass in the body's frame
    inertia: Float[Array, "*agents bodies 3 3"]  # kg m^2, about the centre of mass, body's frame
    joint_position: Float[Array, "*agents n_r 3"]  # m, joint origin in the parent's frame
    joint_rotation: Float[Array, "*agents n_r 3 3"]  # joint frame at rest, to the parent's frame
    joint_axis: Float[Array, "*agents n_r 3"]  # unit vector, joint frame
    tip_position: Float[Array, "*agents arms 3"]  # m, contact point in the tip body's frame
    contact_position: Float[Array, "*agents arms 3"]  # m, attachment c_L in the payload's frame
    thrust_max: Float[Array, "*agents"]  # N


@pytree
class Payload:
    """The rigid payload; its frame sits at its centre of mass."""

    mass: Float[Array, ""]  # kg
    inertia: Float[Array, "3 3"]  # kg m^2, about the centre of mass, payload frame


@pytree
class Team:
    """All parameters of the plant, or of what the controller believes of it."""

    agent_groups: tuple[AerialManipulator, ...]
    payload: Payload
    gravity: Float[Array, "3"]  # m/s^2, a_g in the world frame

    @property
    def sizes(self) -> tuple[int, ...]:
        """Agents in each group."""
        return tuple(group.mass.shape[0] for group in self.agent_groups)

    @property
    def contacts(self) -> int:
        """Number of contacts of the whole team."""
        return sum(size * group.tree.arms for size, group in zip(self.sizes, self.agent_groups, strict=True))


def stack_agents(agents: list[AerialManipulator]) -> AerialManipulator:
    """Agents with one `Tree` as a group on a leading axis."""
    return jax.tree.map(lambda *leaves: jnp.asarray(np.stack(leaves)), *agents)


def agent_names(team: Team, names: Sequence[str] = ()) -> tuple[str, ...]:
    """One name an agent, in the order of the groups: as given, or `agent 1`, `agent 2`, ..."""
    count = sum(team.sizes)
    if names and len(names) != count:
        raise ValueError(f"names: {len(names)} given for {count} agents: {list(names)}")
    return tuple(names) or tuple(f"agent {j + 1}" for j in range(count))
