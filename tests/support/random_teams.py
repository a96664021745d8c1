"""Random teams and states for tests, evidence and benchmarks, and the reference team of the study as numbers.

Structures come from small pools, so that compilations are shared; all numbers are random. Contact points are
read off a random pose, so that every state is on the grasp; velocities are projected by dense linear algebra.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from colift.models.parameters import MOMENTS, AerialManipulator, KinematicTree, Payload, Team
from colift.models.state import AgentState, PayloadState, State

WAIST_TWO_ARMS = KinematicTree(parents=(0, 1, 1), prismatic=(False, False, False), tip_bodies=(2, 3))
CHAIN = KinematicTree(parents=(0, 1, 2), prismatic=(False, False, False), tip_bodies=(3,))
SLIDING_ARM = KinematicTree(parents=(0, 1), prismatic=(False, True), tip_bodies=(2,))
SLIDING_ARMS = KinematicTree(parents=(0, 0, 1, 2), prismatic=(False, True, True, False), tip_bodies=(3, 4))
THREE_ARMS = KinematicTree(parents=(0, 0, 0), prismatic=(False, True, False), tip_bodies=(1, 2, 3))
SEVEN = KinematicTree(
    parents=(0, 1, 1, 2, 3, 0, 6), prismatic=(False,) * 3 + (True,) + (False,) * 3, tip_bodies=(4, 5, 7)
)
RIGID = KinematicTree(parents=(), prismatic=(), tip_bodies=(0,))
TREES = (WAIST_TWO_ARMS, CHAIN, SLIDING_ARM, SLIDING_ARMS, THREE_ARMS, SEVEN, RIGID)

SOFT_CHAIN = dataclasses.replace(CHAIN, contact_types=("soft_finger",))
RIGID_GRIP = dataclasses.replace(RIGID, contact_types=("rigid",))
SEVEN_MIXED = dataclasses.replace(SEVEN, contact_types=("point", "soft_finger", "rigid"))

WITH_MOMENTS: tuple[tuple[tuple[KinematicTree, int], ...], ...] = (  # contacts that bear moments
    ((RIGID_GRIP, 2),),
    ((SOFT_CHAIN, 3),),
    ((SEVEN_MIXED, 1), (RIGID_GRIP, 1), (WAIST_TWO_ARMS, 1)),
)

POOL: tuple[tuple[tuple[KinematicTree, int], ...], ...] = (  # (tree, agents) of each group
    ((CHAIN, 1),),
    ((SEVEN, 1),),
    ((WAIST_TWO_ARMS, 2),),
    ((SLIDING_ARM, 2), (SLIDING_ARMS, 1), (RIGID, 1)),
    ((THREE_ARMS, 4),),
    ((WAIST_TWO_ARMS, 1), (CHAIN, 1), (SEVEN, 1)),
    ((WAIST_TWO_ARMS, 2), (CHAIN, 3)),
)


def stack(values: list) -> object:
    """Stack values of one structure on a leading axis in NumPy, without compilation."""
    return jax.tree.map(lambda *leaves: jnp.array(np.stack(leaves)), *values)


def rotation(rng: np.random.Generator) -> np.ndarray:
    """Return a uniformly random rotation matrix."""
    from scipy.spatial.transform import Rotation  # saves half a second at the start of the reference team

    return Rotation.random(random_state=rng).as_matrix()


def inertia(rng: np.random.Generator, mass: float, size: float) -> np.ndarray:
    """Return the inertia of a random cloud of point masses about its center, which is always physical."""
    points = size * rng.normal(size=(6, 3))
    points -= points.mean(0)
    second = points.T @ points * mass / 6
    return np.trace(second) * np.eye(3) - second


def agent(rng: np.random.Generator, tree: KinematicTree) -> AerialManipulator:
    """Return an aerial manipulator with random numbers; the contacts are set by `team_and_state`."""
    mass = np.concatenate([[rng.uniform(1, 2)], rng.uniform(0.05, 0.3, tree.joints)])
    axis = rng.normal(size=(tree.joints, 3))
    return AerialManipulator(
        tree=tree,
        mass=jnp.array(mass),
        com=jnp.array(0.05 * rng.normal(size=(tree.joints + 1, 3))),
        inertia=jnp.array([inertia(rng, m, 0.15 if i == 0 else 0.06) for i, m in enumerate(mass)]),
        joint_position=jnp.array(0.15 * rng.normal(size=(tree.joints, 3))),
        joint_rotation=jnp.array(np.reshape([rotation(rng) for _ in range(tree.joints)], (-1, 3, 3))),
        joint_axis=jnp.array(axis / np.linalg.norm(axis, axis=1, keepdims=True)),
        tip_position=jnp.array(0.2 * rng.normal(size=(tree.arms, 3))),
        contact_position=jnp.zeros((tree.arms, 3)),
        thrust_max=jnp.array(50.0),
        moment_axis=jnp.array(_moment_axes(rng, tree)) if tree.moment_arms else None,
    )


def _moment_axes(rng: np.random.Generator, tree: KinematicTree) -> np.ndarray:
    """Return a random direction for each soft finger, and the axes of a random frame for each rigid grip."""
    frames = [rotation(rng)[: MOMENTS[kind]] for kind in tree.contact_types]
    return np.concatenate(frames)


def agent_state(rng: np.random.Generator, tree: KinematicTree, speed: float = 1.0) -> AgentState:
    """Return a random state of one free agent, about a meter from the origin."""
    return AgentState(
        R=jnp.array(rotation(rng)),
        x=jnp.array(rng.normal(size=3)),
        r=jnp.array(rng.uniform(-1, 1, tree.joints)),
        omega=jnp.array(speed * rng.normal(size=3)),
        v=jnp.array(speed * rng.normal(size=3)),
        r_dot=jnp.array(speed * rng.normal(size=tree.joints)),
    )


def payload_state(rng: np.random.Generator, speed: float = 1.0) -> PayloadState:
    """Return a random state of a free payload near the origin."""
    return PayloadState(
        R=jnp.array(rotation(rng)),
        p=jnp.array(0.3 * rng.normal(size=3)),
        omega=jnp.array(speed * rng.normal(size=3)),
        v=jnp.array(speed * rng.normal(size=3)),
    )


def team(rng: np.random.Generator, structure: tuple[tuple[KinematicTree, int], ...]) -> Team:
    """Return a random team without contacts."""
    mass = rng.uniform(1, 3)
    return Team(
        agent_groups=tuple(stack([agent(rng, tree) for _ in range(size)]) for tree, size in structure),
        payload=Payload(mass=jnp.array(mass), inertia=jnp.array(inertia(rng, mass, 0.3))),
        gravity=jnp.array(rng.normal(size=3) + [0, 0, -9.81]),
    )


def free_state(rng: np.random.Generator, structure: tuple[tuple[KinematicTree, int], ...]) -> State:
    """Return a random state of bodies without contact."""
    return State(
        agents=tuple(stack([agent_state(rng, tree) for _ in range(size)]) for tree, size in structure),
        payload=payload_state(rng),
    )


def reference_agent(contact: list[list[float]]) -> AerialManipulator:
    """Return an agent of the reference team: a waist joint about body z, two arms that rotate about x."""
    rod = np.diag([0.12 * 0.3**2 / 12, 0.12 * 0.3**2 / 12, 1e-5])
    return AerialManipulator(
        tree=WAIST_TWO_ARMS,
        mass=jnp.array([1.5, 0.1, 0.12, 0.12]),
        com=jnp.array([[0.0, 0, 0], [0, 0, 0], [0, 0, -0.15], [0, 0, -0.15]]),
        inertia=jnp.array([np.diag([0.02, 0.02, 0.035]), 1e-4 * np.eye(3), rod, rod]),
        joint_position=jnp.array([[0, 0, 0], [0, 0.08, 0], [0, -0.08, 0]]),
        joint_rotation=jnp.array([np.eye(3)] * 3),
        joint_axis=jnp.array([[0.0, 0, 1], [1, 0, 0], [1, 0, 0]]),
        tip_position=jnp.array([[0, 0, -0.3], [0, 0, -0.3]]),
        contact_position=jnp.array(contact),
        thrust_max=jnp.array(50.0),
    )


def reference_team(agents: int = 2) -> Team:
    """Return equal agents in a row along x, each of which holds the payload on both sides."""
    return Team(
        agent_groups=(stack([reference_agent([[x, 0.36, 0.05], [x, -0.36, 0.05]]) for x in _row(agents)]),),
        payload=Payload(mass=jnp.array(1.5), inertia=jnp.diag(jnp.array([0.04, 0.15, 0.18]))),
        gravity=jnp.array([0.0, 0, -9.81]),
    )


def reference_guess(agents: int = 2) -> State:
    """Return a level state at rest with arms 1.2 rad from vertical, one centimeter off the grasp."""
    height = 0.05 + 0.3 * np.cos(1.2) - 0.03
    return State(
        agents=(
            AgentState(
                R=jnp.array([np.eye(3)] * agents),
                x=jnp.array([[x, 0, height] for x in _row(agents)]),
                r=jnp.array([[0, 1.2, -1.2]] * agents),
                omega=jnp.zeros((agents, 3)),
                v=jnp.zeros((agents, 3)),
                r_dot=jnp.zeros((agents, 3)),
            ),
        ),
        payload=PayloadState(R=jnp.eye(3), p=jnp.zeros(3), omega=jnp.zeros(3), v=jnp.zeros(3)),
    )


def _row(agents: int) -> list[float]:
    return [0.0] if agents == 1 else [float(x) for x in np.linspace(-0.5, 0.5, agents)]
