"""Tests of parameters: refusals, and what a compilation depends on."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.models import validation
from colift.models.parameters import AerialManipulator, KinematicTree, Team
from tests.support import random_teams as teams


def changed(change: Callable[[AerialManipulator], AerialManipulator]) -> Team:
    team = teams.reference_team()
    return dataclasses.replace(team, agent_groups=(change(team.agent_groups[0]),))


def with_inertia(*moments: float) -> Callable[[AerialManipulator], AerialManipulator]:
    return lambda a: dataclasses.replace(a, inertia=a.inertia.at[1, 2].set(jnp.diag(jnp.array(moments))))


REFUSED = [
    (with_inertia(1e-3, 1e-3, -1e-5), r"right, body 2: inertia is not positive definite: principal moments -1e-05"),
    (with_inertia(1e-3, 1e-3, 2.1e-3), r"right, body 2: inertia violates the triangle inequality.*0\.0021 > 0\.002"),
    (lambda a: dataclasses.replace(a, inertia=a.inertia.at[0, 0, 0, 1].set(0.01)), "left, body 0: .*not symmetric"),
    (lambda a: dataclasses.replace(a, mass=a.mass.at[1, 3].set(0.0)), "right, body 3: mass 0 kg is not positive"),
    (lambda a: dataclasses.replace(a, mass=a.mass.at[1, 3].set(jnp.nan)), "right, body 3: mass nan kg"),
    (
        lambda a: dataclasses.replace(a, inertia=a.inertia.at[1, 2].set(jnp.inf)),
        "right, body 2: .*3 x 3 matrix of finite numbers",
    ),
    (lambda a: dataclasses.replace(a, thrust_max=a.thrust_max.at[1].set(0.0)), "right: thrust_max 0 N is not positive"),
    (
        lambda a: dataclasses.replace(a, tip_position=a.tip_position.at[0, 1, 2].set(jnp.nan)),
        "left: tip_position .* m is not finite",
    ),
    (
        lambda a: dataclasses.replace(a, joint_axis=a.joint_axis.at[0, 1].mul(2.0)),
        "left, joint 1: .* not a unit vector",
    ),
    (
        lambda a: dataclasses.replace(a, joint_rotation=a.joint_rotation.at[0, 1].mul(-1.0)),
        "left, joint 1: .* is not a rotation matrix",
    ),
]


@pytest.mark.parametrize(("change", "message"), REFUSED)
def test_unphysical_parameters_are_refused(
    change: Callable[[AerialManipulator], AerialManipulator], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        validation.validate_team(changed(change), ("left", "right"))


def test_physical_parameters_pass() -> None:
    validation.validate_team(teams.reference_team(3))
    for structure in teams.POOL:
        validation.validate_team(teams.team(np.random.default_rng(0), structure))


def test_payload_is_checked() -> None:
    team = teams.reference_team()
    heavy = dataclasses.replace(team.payload, mass=jnp.array(-1.0))
    with pytest.raises(ValueError, match="the payload: mass -1 kg"):
        validation.validate_team(dataclasses.replace(team, payload=heavy))


def test_only_structure_changes_recompile() -> None:
    traces = 0

    @jax.jit
    def total_mass(team: Team) -> jax.Array:
        nonlocal traces
        traces += 1
        return sum(group.mass.sum() for group in team.agent_groups) + team.payload.mass

    rng = np.random.default_rng(0)
    for _ in range(3):
        total_mass(teams.team(rng, teams.POOL[3]))
    assert traces == 1
    total_mass(teams.team(rng, teams.POOL[5]))
    assert traces == 2


def test_sizes_and_contacts() -> None:
    team = teams.team(np.random.default_rng(0), ((teams.WAIST_TWO_ARMS, 2), (teams.CHAIN, 3)))
    assert team.sizes == (2, 3)
    assert team.contacts == 7
    assert (team.agent_groups[0].tree.joints, team.agent_groups[0].tree.arms) == (3, 2)


def test_ancestors() -> None:
    """Body i is moved by the joints between it and the base."""
    expected = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [1, 0, 1]], bool)
    np.testing.assert_array_equal(teams.WAIST_TWO_ARMS.ancestors, expected)


@pytest.mark.parametrize(
    ("parents", "prismatic", "tips", "message"),
    [
        ((0, 2), (False, False), (1,), r"parents\[1\] is 2, must be one of bodies 0 to 1"),
        ((-1,), (False,), (1,), r"parents\[0\] is -1"),
        ((0,), (False, True), (1,), "1 parents for 2 joints"),
        ((0,), (False,), (), "must contain at least one body"),
        ((0,), (False,), (2,), r"tip_bodies\[0\] is 2, must be one of bodies 0 to 1"),
    ],
)
def test_invalid_tree_is_refused(parents, prismatic, tips, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        KinematicTree(parents=parents, prismatic=prismatic, tip_bodies=tips)
