"""Tests of the stated label bias against random biases in the label equations."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colift import scenario
from colift.models import aerial_manipulator, grasp
from colift.models.parameters import Team
from colift.models.state import State, flatten_agent_state
from colift.onboard.learning import prediction_uncertainty
from colift.onboard.learning.prediction_uncertainty import BiasModel, LabelBiasModel
from colift.scenario import assumptions
from tests.support import random_teams as teams

DRAWS = 4000


def team_and_state(rng: np.random.Generator, case: int) -> tuple[Team, State]:
    """A team on its grasp at any state."""
    free = teams.team(rng, teams.POOL[case])
    held = [
        dataclasses.replace(g, contact_position=jnp.asarray(rng.normal(size=g.contact_position.shape)))
        for g in free.agent_groups
    ]
    return dataclasses.replace(free, agent_groups=tuple(held)), teams.free_state(rng, teams.POOL[case])


@given(seed=st.integers(0, 10**6), case=st.integers(0, len(teams.POOL) - 1))
def test_payload_label_std_equals_random_biases(seed, case):
    """The standard deviation of a payload label equals that of random biases."""
    rng = np.random.default_rng(seed)
    team, z = team_and_state(rng, case)
    c, R, m = np.asarray(grasp.contact_points(team)), np.asarray(z.payload.R), float(team.payload.mass)
    b = rng.normal(size=(DRAWS, len(c), 3))  # isotropic errors are independent of the frames of the tips
    a = 0.2 * rng.normal(size=(DRAWS, 3))
    F = m * a - b.sum(1)
    tau = -np.cross(c, b @ R).sum(1)
    found = prediction_uncertainty.payload_label_bias_std(
        team, LabelBiasModel(tips=BiasModel(1.0), payload=BiasModel(0.2)), np.zeros(1)
    )[0]
    np.testing.assert_allclose(np.concatenate([F, tau], axis=1).std(0), found, rtol=0.1)


@given(seed=st.integers(0, 10**6), case=st.integers(0, len(teams.POOL) - 1))
def test_force_errors_enter_payload_wrench_by_grasp(seed, case):
    """The maps equal the payload wrench of force errors that are divided equally among the arms of an agent."""
    rng = np.random.default_rng(seed)
    team, z = team_and_state(rng, case)
    errors = [rng.normal(size=(size, 3)) for size in team.sizes]
    arms = [group.tree.arms for group in team.agent_groups]
    lam = [jnp.asarray(np.repeat(e[:, None] / n, n, axis=1)) for e, n in zip(errors, arms, strict=True)]
    W = grasp.payload_wrench(grasp.contact_points(team), z.payload.R, grasp.stack_contacts(tuple(lam)))
    maps = prediction_uncertainty.force_errors_to_payload(team, np.asarray(z.payload.R)[None])[0]
    found = np.einsum("iak,ak->i", maps, np.concatenate(errors))
    np.testing.assert_allclose(found, np.concatenate([W.F, W.tau]), atol=1e-12)


@pytest.mark.long
@given(seed=st.integers(0, 10**6), case=st.integers(0, len(teams.POOL) - 1))
def test_agent_label_std_equals_random_biases(seed, case):
    """The standard deviation of an agent label equals that of random biases."""
    rng = np.random.default_rng(seed)
    team, z = team_and_state(rng, case)
    for group, q in zip(team.agent_groups, z.agents, strict=True):
        x = jax.vmap(flatten_agent_state)(q)[None]
        levers = [np.asarray(each) for each in prediction_uncertainty._arm_levers(group, x)]
        found = prediction_uncertainty.agent_label_bias_std(
            LabelBiasModel(tips=BiasModel(0.1), agents=BiasModel(0.2)), np.zeros(1), *levers
        )[0]
        for j in range(len(q.r)):
            one = jax.tree.map(lambda leaf, j=j: leaf[j], group)
            p = aerial_manipulator.centroidal_model(one, aerial_manipulator.forward_kinematics(one, q.r[j]))
            b = 0.1 * rng.normal(size=(DRAWS, one.tree.arms, 3))
            moment = np.einsum("aik,nai->nk", np.asarray(p.J_tip), b)
            force = b.sum(1) + 0.2 * float(p.mass) * rng.normal(size=(DRAWS, 3))
            drawn = np.concatenate([force, moment], axis=1).std(0)
            np.testing.assert_allclose(drawn, found[j], rtol=0.1, atol=1e-12)


def test_bias_walk_grows_and_independent_biases_add():
    """A bias walk grows with time, and variances of independent biases add."""
    both = BiasModel(initial_std=0.3, random_walk_density=0.2) + BiasModel(initial_std=0.4, random_walk_density=0.0)
    np.testing.assert_allclose(both.std_at(np.array([0.0, 4.0])), [0.5, np.sqrt(0.25 + 0.16)])


@pytest.mark.parametrize("name", ["paper", "outdoors"])
def test_scenario_states_the_label_bias(name):
    """The label bias follows from the sensor settings of a scenario."""
    settings = scenario.load_scenario(name)
    found = assumptions.label_bias_model(settings)
    starts, rates = {"agents.lam": settings.sensors.tip_force_bias_N**2}, {}
    for each in settings.sensors.models:
        if each.kind == "bias_random_walk":
            for reading in each.channels:
                starts[reading] = starts.get(reading, 0.0) + each.initial_bias_std**2
                rates[reading] = rates.get(reading, 0.0) + each.random_walk_density**2
    for walk, reading in ((found.tips, "agents.lam"), (found.payload, "payload.a"), (found.agents, "agents.a")):
        assert walk.initial_std == pytest.approx(np.sqrt(starts.get(reading, 0.0)))
        assert walk.random_walk_density == pytest.approx(np.sqrt(rates.get(reading, 0.0)))
    if name == "outdoors":
        assert found.tips.random_walk_density > 0 or found.agents.initial_std > 0, "outdoor sensors have a bias walk"
