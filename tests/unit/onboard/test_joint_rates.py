"""Tests of joint rates from the twists of payload and base, on random moving teams of several tip layouts."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator, KinematicTree
from colift.models.state import PayloadState
from colift.onboard.estimation import contact_forces, nav_filter, state_estimator
from tests.support import random_teams as teams
from tests.support.pinocchio_team import PinocchioTeam, take

LONG_CHAIN = KinematicTree(parents=tuple(range(7)), prismatic=(False,) * 7, tip_bodies=(7,))
TREES = (*teams.TREES, LONG_CHAIN)
TEAM = tuple((tree, 1) for tree in TREES)
LEVER = contact_forces.MIN_LEVER


@jax.jit
def estimate(
    agent: AerialManipulator, r: jax.Array, base: nav_filter.NavState, omega: jax.Array, payload: PayloadState,
    encoder_rate: jax.Array,
) -> jax.Array:  # fmt: skip
    """Return the estimated joint rates."""
    g = aerial_manipulator.forward_kinematics(agent, r)
    return state_estimator.joint_rates(agent, g, base, omega, payload, encoder_rate)


@jax.jit
def tip_jacobian(agent: AerialManipulator, r: jax.Array) -> jax.Array:
    """Return the derivative of the tip positions, by forward differentiation of the kinematics."""
    jacobian = jax.jacfwd(lambda r: aerial_manipulator.forward_kinematics(agent, r).points[-agent.tree.arms :])(r)
    return jacobian.reshape(3 * agent.tree.arms, -1)


@functools.cache
def moving_agents(seed: int) -> list:
    """Return each agent of a consistent moving team with its state, and base velocity and payload by Pinocchio."""
    rng = np.random.default_rng(seed)
    oracle = PinocchioTeam(teams.team(rng, TEAM))
    team, z = oracle.on_grasp(teams.free_state(rng, TEAM))
    agents = []
    for group, states, free in zip(team.agent_groups, z.agents, oracle.free, strict=True):
        agent, q = (jax.tree.map(lambda x: x[0], value) for value in (group, states))
        _, velocity = free.coordinates(take(states, 0))
        base = nav_filter.NavState(R=q.R, x=jnp.zeros(3), v=q.R @ jnp.asarray(velocity[:3]))
        agents.append((agent, q, base, z.payload))
    return agents


CASES = [pytest.param(k, seed, id=f"{k}-{seed}") for k in range(len(TREES)) for seed in (1, 2, 3)]


@pytest.mark.parametrize(("k", "seed"), CASES)
def test_joint_rates_of_consistent_states_are_exact(k, seed):
    """With exact encoder rates the estimate is exact for all agents."""
    agent, q, base, payload = moving_agents(seed)[k]
    found = estimate(agent, q.r, base, q.omega, payload, q.r_dot)
    np.testing.assert_allclose(found, q.r_dot, atol=1e-8)


@pytest.mark.parametrize(("k", "seed"), CASES)
def test_encoder_errors_reach_only_rates_without_tip_motion(k, seed):
    """In the singular directions of the tip Jacobian with values sigma, an error is multiplied by s^2/(sigma^2+s^2)."""
    agent, q, base, payload = moving_agents(seed)[k]
    if not agent.tree.joints:
        return  # no joint
    rng = np.random.default_rng(seed)
    wrong = rng.normal(size=agent.tree.joints)
    found = np.asarray(estimate(agent, q.r, base, q.omega, payload, q.r_dot + jnp.asarray(wrong)) - q.r_dot)
    B = np.asarray(tip_jacobian(agent, q.r))
    _, values, directions = np.linalg.svd(B)
    sigma = np.zeros(len(directions))
    sigma[: len(values)] = values
    np.testing.assert_allclose(directions @ found, directions @ wrong * LEVER**2 / (sigma**2 + LEVER**2), atol=1e-8)
    # motions of the tips are at most half a minimum lever wrong; motions without them are those of the encoders
    assert np.linalg.norm(B @ found) <= LEVER / 2 * np.linalg.norm(wrong) + 1e-9
    free = directions[sigma < 1e-9]
    assert len(free) == (4 if agent.tree == LONG_CHAIN else 0)
    np.testing.assert_allclose(free @ found, free @ wrong, atol=1e-8)


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_encoder_share_is_the_response_to_encoder_rates(seed):
    """The matrix of `encoder_share` is the derivative of the estimated rates with respect to the encoder rates."""
    agent, q, base, payload = moving_agents(seed)[TREES.index(LONG_CHAIN)]
    share = state_estimator.encoder_share(agent, aerial_manipulator.forward_kinematics(agent, q.r))
    zero = estimate(agent, q.r, base, q.omega, payload, jnp.zeros(7))
    columns = [estimate(agent, q.r, base, q.omega, payload, row) - zero for row in jnp.eye(7)]
    np.testing.assert_allclose(share, np.stack(columns, axis=1), atol=1e-9)
    assert 4 < np.trace(share) < 5  # four of seven directions do not move the tip
