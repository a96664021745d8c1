"""Tests of the grasp: virtual work, internal forces, constraint rates, and refusals."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift.models import grasp
from colift.models.parameters import KinematicTree, Team
from colift.models.state import AgentInput, State, Wrench, zero_residual
from colift.simulation import contact_dynamics
from tests.support import random_teams as teams
from tests.support.pinocchio_team import PinocchioTeam

STRUCTURES = [structure for structure in teams.POOL if len(structure) > 1]
wrench, Phi, Phi_dot, min_singular_value = (
    jax.jit(f)
    for f in (grasp.payload_wrench, grasp.constraint_residual, grasp.constraint_rate, grasp.min_delassus_singular_value)
)


def grasped_team(structure: tuple, seed: int = 0) -> tuple[Team, State]:
    rng = np.random.default_rng(seed)
    return PinocchioTeam(teams.team(rng, structure)).on_grasp(teams.free_state(rng, structure))


def points(contacts: int, seed: int = 0) -> tuple[jax.Array, jax.Array, jax.Array]:
    """Contact points, an attitude and forces."""
    rng = np.random.default_rng(seed)
    c, lam = rng.normal(size=(2, contacts, 3))
    return jnp.array(c), jnp.array(Rotation.random(random_state=seed).as_matrix()), jnp.array(lam)


def stacked(W: Wrench) -> np.ndarray:
    return np.concatenate([W.F, W.tau])


@pytest.mark.parametrize("contacts", [1, 4, 7])
def test_wrench_is_the_grasp_matrix_times_the_forces(contacts: int) -> None:
    c, R, lam = points(contacts)
    np.testing.assert_allclose(stacked(wrench(c, R, lam)), grasp.grasp_matrix(c, R) @ lam.ravel(), atol=1e-14)


def test_wrench_does_the_work_of_the_forces() -> None:
    """`lam . (v + R (omega x c))` summed over contacts is `F . v + tau . omega`: the frames of errata row 1."""
    c, R, lam = (np.asarray(x) for x in points(4))
    v, omega = np.random.default_rng(1).normal(size=(2, 3))
    W = wrench(*(jnp.array(x) for x in (c, R, lam)))
    power = (lam * (v + np.cross(omega, c) @ R.T)).sum()
    np.testing.assert_allclose(np.asarray(W.F) @ v + np.asarray(W.tau) @ omega, power, atol=1e-13)


@pytest.mark.parametrize(("contacts", "rank"), [(1, 3), (2, 5), (3, 6), (4, 6), (8, 6)])
def test_grasp_nullspace(contacts: int, rank: int) -> None:
    """Rank 3, 5, 6, 6 for 1 to 4 contacts (errata row 2); the null space rotates with the payload."""
    c, R, _ = points(contacts)
    Z = grasp.grasp_nullspace(np.asarray(c))
    assert Z.shape == (3 * contacts, 3 * contacts - rank)
    np.testing.assert_allclose(Z.T @ Z, np.eye(Z.shape[1]), atol=1e-14)
    turned = np.einsum("ij,bjk->bik", R, Z.reshape(contacts, 3, -1)).reshape(3 * contacts, -1)
    np.testing.assert_allclose(grasp.grasp_matrix(c, R) @ turned, 0, atol=1e-14)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_split_and_join(structure: tuple) -> None:
    team = teams.team(np.random.default_rng(0), structure)
    lam = jnp.arange(3.0 * team.contacts).reshape(-1, 3)
    parts = grasp.split_contacts(team, lam)
    assert [part.shape for part in parts] == [(size, tree.arms, 3) for tree, size in structure]
    np.testing.assert_array_equal(grasp.stack_contacts(parts), lam)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_constraint_equals_pinocchio_off_the_grasp(structure: tuple) -> None:
    rng = np.random.default_rng(2)
    team, z = teams.team(rng, structure), teams.free_state(rng, structure)
    model = PinocchioTeam(team)
    q, v = model.coordinates(z)
    np.testing.assert_allclose(Phi(team, z), model.constraint_residual(z), atol=1e-14)
    np.testing.assert_allclose(Phi_dot(team, z).ravel(), model.jacobian(q) @ v, atol=1e-13)


@pytest.mark.parametrize("structure", STRUCTURES)
def test_constraint_velocity_is_the_derivative_of_the_constraint(structure: tuple) -> None:
    rng = np.random.default_rng(3)
    team, z = teams.team(rng, structure), teams.free_state(rng, structure)

    @jax.jit
    def rate(team: Team, z: State) -> jax.Array:
        def at(t: jax.Array) -> jax.Array:
            agents = tuple(
                jnp.concatenate(
                    [t * a.omega, t * a.v, t * a.r_dot, *(jnp.zeros_like(x) for x in (a.x, a.x, a.r))], axis=1
                )
                for a in z.agents
            )
            load = jnp.concatenate([t * z.payload.omega, t * z.payload.v, jnp.zeros(6)])
            return grasp.constraint_residual(
                team, contact_dynamics.retract(z, contact_dynamics.StateTangent(agents=agents, payload=load))
            )

        return jax.jvp(at, (jnp.zeros(()),), (jnp.ones(()),))[1]

    np.testing.assert_allclose(rate(team, z), Phi_dot(team, z), atol=1e-13)


@pytest.mark.parametrize("structure", teams.POOL)
def test_condition_is_that_of_the_dense_matrix(structure: tuple) -> None:
    """`grasp_condition` returns cond(A M^-1 A^T), and no singular value is below the smallest one of the agents."""
    team, z = grasped_team(structure)
    inputs = tuple(
        AgentInput(u=jnp.zeros(n), tau=jnp.zeros((n, 3)), tau_r=jnp.zeros((n, t.joints))) for t, n in structure
    )
    expected = PinocchioTeam(team).solve_kkt(z, inputs, zero_residual(team))
    assert grasp.grasp_condition(team, z) == pytest.approx(expected.condition, rel=1e-6)
    assert float(min_singular_value(team, z).min()) <= expected.singular[-1] * (1 + 1e-9)


def crossed(seed: int) -> tuple[Team, State]:
    """Three arms with only two joints, beside a regular agent."""
    tree = KinematicTree(parents=(0, 0), prismatic=(False, False), tip_bodies=(0, 1, 2))
    return grasped_team(((tree, 1), (teams.WAIST_TWO_ARMS, 1)), seed)


@pytest.mark.parametrize("seed", range(3))
def test_rank_deficient_agent_makes_the_team_deficient(seed: int) -> None:
    """The payload cannot move its contacts in a way that the agent cannot."""
    team, z = crossed(seed)
    model = PinocchioTeam(team)
    singular = np.linalg.svd(model.jacobian(model.coordinates(z)[0]), compute_uv=False)
    assert singular[-1] < 1e-14 < 1e-4 < singular[-2]


def test_rank_deficient_grasp_is_refused_with_name() -> None:
    team, z = crossed(0)
    with pytest.raises(
        ValueError, match=r"left: rank 8 of 9, condition .*singular values .*3 distances .* 2 joints"
    ) as e:
        grasp.check_grasp(team, z, ("left", "right"))
    assert "right" not in str(e.value)


def test_singular_pose_is_refused_with_name_and_arms() -> None:
    """Both arms of the reference agent extended sideways cannot change the distance of their tips."""
    team, z = teams.reference_team(), teams.reference_guess()
    r = jnp.array([[0, 1.2, -1.2], [0, np.pi / 2, -np.pi / 2]])
    stretched = dataclasses.replace(z, agents=(dataclasses.replace(z.agents[0], r=r),))
    assert grasp.grasp_condition(team, z) < 1e3
    with pytest.raises(ValueError, match=r"front: rank 5 of 6.*the constraints of arms 1 and 2 are redundant") as e:
        grasp.check_grasp(team, stretched, ("rear", "front"))
    assert "rear" not in str(e.value)


def test_smallest_singular_value_vanishes_in_a_singular_pose() -> None:
    team, z = teams.reference_team(), teams.reference_guess()
    at = lambda a: dataclasses.replace(  # noqa: E731
        z, agents=(dataclasses.replace(z.agents[0], r=jnp.array([[0, 1.2, -1.2], [0, a, -a]])),)
    )
    values = np.array([np.asarray(min_singular_value(team, at(a))) for a in (1.2, 1.4, 1.5, 1.55, np.pi / 2)])
    np.testing.assert_allclose(values[:, 0], values[0, 0], rtol=1e-12)
    assert (np.diff(values[:, 1]) < 0).all()
    assert values[-1, 1] < 1e-14


def test_controllability_requirements() -> None:
    team, z = teams.reference_team(), teams.reference_guess()
    grasp.check_controllability(team, z)
    down = dataclasses.replace(z, agents=(dataclasses.replace(z.agents[0], r=jnp.zeros((2, 3))),))
    with pytest.raises(ValueError, match="rear: grasp Jacobian is nearly singular"):
        grasp.check_controllability(team, down, ("rear", "front"))
    line = dataclasses.replace(
        team.agent_groups[0], contact_position=team.agent_groups[0].contact_position.at[:, :, 0].set(0.0)
    )
    with pytest.raises(ValueError, match=r"rear arm 1, .* has rank 5 of 6, condition .*, singular values"):
        grasp.check_controllability(dataclasses.replace(team, agent_groups=(line,)), z, ("rear", "front"))
    with pytest.raises(ValueError, match=r"2 joints for 2 arms .* 5 of 6; .* only with 3 joints or more"):
        grasp.check_controllability(
            *grasped_team(((KinematicTree(parents=(0, 0), prismatic=(False, False), tip_bodies=(1, 2)), 2),))
        )


def test_names_must_match() -> None:
    with pytest.raises(ValueError, match="1 given for 2 agents"):
        grasp.contact_names(teams.reference_team(), ("only",))
    assert grasp.contact_names(teams.reference_team(), ("a", "b")) == ("a arm 1", "a arm 2", "b arm 1", "b arm 2")
