"""Structural checks of a team: properties that no joint position, gain or initial state can repair.

The checks run before any iteration for a consistent state. Their messages contain the names of contacts as
`agent/arm`.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import numpy as np

from colift.models import aerial_manipulator, grasp, parameters
from colift.models.parameters import AerialManipulator, KinematicTree, Team
from colift.scenario import schema, team
from colift.scenario.errors import ScenarioError

NUM_POSTURES = 3  # random joint positions at which the generic rank is evaluated
RANK_TOLERANCE = 1e-7  # smallest singular value of a full rank, over the largest one
REACH_TOLERANCE = 1e-3  # share of the distance of two contacts


@dataclasses.dataclass(frozen=True)
class StructuralError:
    """Structural property that excludes a flight.

    Attributes:
        message: Sentence with names and numbers.
        advice: Change that repairs it.
    """

    message: str
    advice: str


def structural_errors(settings: schema.Scenario, truth: Team) -> tuple[StructuralError, ...]:
    """Find the structural errors of a team: contacts on a line, too few joints, closed rings, unreachable contacts.

    Args:
        settings: Scenario.
        truth: True parameters.

    Returns:
        The errors, in this order; empty if there are none.
    """
    names = iter(team.contact_names(settings))
    agents = iter(team.agent_names(settings))
    found = list(_fixed_attitudes(settings, truth))
    if not truth.is_rigid_assembly:
        found += _contacts_on_a_line(truth, team.contact_names(settings))
    for group, members in zip(truth.agent_groups, team.group_agents(settings), strict=True):
        generic_rank = _generic_rank(group)
        for j, _ in enumerate(members):
            arms = [next(names) for _ in range(group.tree.arms)]
            found += _agent_errors(next(agents), group, j, arms, generic_rank)
    return tuple(found)


def check_structure(settings: schema.Scenario, truth: Team) -> None:
    """Raise an exception if a team has structural errors.

    Args:
        settings: Scenario.
        truth: True parameters.

    Raises:
        ScenarioError: With one sentence per error.
    """
    found = structural_errors(settings, truth)
    if found:
        raise ScenarioError(f"{settings.name}: {'; '.join(error.message for error in found)}")


def _fixed_attitudes(settings: schema.Scenario, truth: Team) -> Iterator[StructuralError]:
    """Find agents whose rigid grips fix their attitude to the payload, in a team that is not one rigid body."""
    if truth.is_rigid_assembly:
        return
    for group, members in zip(truth.agent_groups, team.group_agents(settings), strict=True):
        if group.tree.contact_types.count(parameters.RIGID) > 1:
            yield StructuralError(
                f"{', '.join(agent.name for agent in members)}: more than one rigid grip; their forces and moments are "
                "not unique, or they fix the attitude of the agent",
                "give an agent one rigid grip at most (agent_types: arms: contact)",
            )
        for b, kind in enumerate(group.tree.contact_types):
            if kind == parameters.RIGID and (rank := _rotation_rank(group, b)) < 3:
                yield StructuralError(
                    f"{', '.join(agent.name for agent in members)}: the joints before a rigid grip rotate it about "
                    f"{rank} of 3 axes, which fixes the attitude of the agent to that of the payload; this is possible "
                    "only if no agent of the team has joints and all grips are rigid",
                    "give the arm a wrist with three axes (agent_types: joints), or contact: point",
                )


def _rotation_rank(group: AerialManipulator, arm: int) -> int:
    """Return the number of axes about which joints rotate the tip of an arm, at random joint positions."""
    own = parameters.select_agent(group, 0)
    if not group.tree.joints:
        return 0
    r = np.random.default_rng(0).uniform(-1.0, 1.0, group.tree.joints)
    J = np.asarray(aerial_manipulator.forward_kinematics(own, r).J_omega)[group.tree.tip_bodies[arm]]
    return int(np.linalg.matrix_rank(J, RANK_TOLERANCE))


def _contacts_on_a_line(truth: Team, names: tuple[str, ...]) -> Iterator[StructuralError]:
    """Find a grasp matrix that cannot generate every moment."""
    c = np.asarray(grasp.contact_points(truth))
    length = max(float(np.sqrt((c**2).sum(1).mean())), 1e-9)
    values = grasp.grasp_matrix_singular_values(truth, length)
    rank = int((values[0] < 1e6 * values).sum())
    if rank < 6:
        listed = f"{', '.join(names[:-1])} and {names[-1]}" if len(names) > 1 else names[0]
        kind = "lie on a line" if len(names) > 2 else "are fewer than three"
        verb = f"contacts {listed} {kind}" if len(names) > 1 else f"contact {listed} is the only one"
        yield StructuralError(
            f"{verb}: the grasp matrix has rank {rank} of 6, so that contact forces cannot generate every moment; "
            "three contacts that are not collinear are required",
            "move a contact (agents: contact_positions_m) away from the line through the others, or add an agent",
        )


def _agent_errors(
    name: str, group: AerialManipulator, j: int, arms: list[str], generic_rank: int
) -> Iterator[StructuralError]:
    """Find too few joints, closed rings and contacts out of reach."""
    n, n_r = group.tree.arms, group.tree.joints
    joints_or_arms = "give the agent more joints (agent_types), or fewer arms"
    if n_r < 3 * n - 3:
        yield StructuralError(
            f"{name}: {n_r} joints for {n} arms ({', '.join(arms)}); {3 * n - 3} joints or more are required, so that "
            "its tips follow the payload while it tilts",
            joints_or_arms,
        )
    elif generic_rank < 3 * n:
        yield StructuralError(
            f"{name}: its arms ({', '.join(arms)}) and the payload form a ring in which its tips move in "
            f"{generic_rank} of {3 * n} directions only, at any joint position",
            "give arms joints about other axes (agent_types), or fewer arms",
        )
    c = np.asarray(group.contact_position)[j]
    for a in range(n):
        for b in range(a + 1, n):
            reach, distance = _reach(group, j, a, b), float(np.linalg.norm(c[a] - c[b]))
            if reach is not None and distance > reach * (1 + REACH_TOLERANCE):
                yield StructuralError(
                    f"{name}: contacts {arms[a]} and {arms[b]} are {distance:.3g} m apart, but its tips are at most "
                    f"{reach:.3g} m apart",
                    f"move contacts {arms[a]} and {arms[b]} closer together (agents: contact_positions_m)",
                )


def _generic_rank(group: AerialManipulator) -> int:
    """Return the largest rank of the grasp Jacobian over random joint positions; 3 n for one arm."""
    n = group.tree.arms
    if n == 1 or group.tree.joints < 3 * n - 3:
        return 3 * n
    own = parameters.select_agent(group, 0)
    generator, rank = np.random.default_rng(0), 0
    for _ in range(NUM_POSTURES):
        values, _ = grasp.grasp_jacobian_svd(own, generator.uniform(-1.0, 1.0, group.tree.joints))
        rank = max(rank, int((values > RANK_TOLERANCE * values[0]).sum()))
        if rank == 3 * n:  # no posture has a larger one
            break
    return rank


def _reach(group: AerialManipulator, j: int, a: int, b: int) -> float | None:
    """Bound the distance of two tips by the lengths along the tree [m]; None with a prismatic joint between them."""
    tree = group.tree
    ends = (_chain(tree, tree.tip_bodies[a]), _chain(tree, tree.tip_bodies[b]))
    common = set(ends[0]) & set(ends[1])
    tips = np.asarray(group.tip_position)[j][[a, b]]
    branch_points, total = [], 0.0
    for chain, tip in zip(ends, tips, strict=True):
        own = [body for body in chain if body not in common]
        if any(tree.prismatic[body - 1] for body in own):
            return None
        total += float(np.linalg.norm(tip)) if own else 0.0
        total += sum(float(np.linalg.norm(group.joint_position[j, body - 1])) for body in own[:-1])
        branch_points.append(np.asarray(group.joint_position)[j, own[-1] - 1] if own else tip)
    return total + float(np.linalg.norm(branch_points[0] - branch_points[1]))


def _chain(tree: KinematicTree, body: int) -> list[int]:
    """Return the bodies from a body to the base."""
    chain = [body]
    while chain[-1]:
        chain.append(tree.parents[chain[-1] - 1])
    return chain
