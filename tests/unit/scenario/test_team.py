"""Tests of teams from settings: groups, names, frames and order against independent numbers."""

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from colift import scenario
from colift.models import grasp
from colift.scenario import team
from tests.support import random_teams as teams
from tests.support.varied_scenarios import mixed


def test_the_study_has_the_reference_team():
    truth, nominal = team.team(scenario.load_scenario("paper"))
    expected = teams.reference_team()
    order = jnp.array([1, 0])  # the scenario counts from the front
    group = jax.tree.map(lambda leaf: leaf[order], expected.agent_groups[0])
    jax.tree.map(np.testing.assert_allclose, truth.agent_groups[0], group)
    jax.tree.map(np.testing.assert_allclose, truth.payload, expected.payload)
    np.testing.assert_array_equal(truth.gravity, expected.gravity)
    jax.tree.map(np.testing.assert_array_equal, nominal.agent_groups, truth.agent_groups)
    assert float(nominal.payload.mass) == 1.2
    np.testing.assert_array_equal(nominal.payload.inertia, np.diag([0.03, 0.12, 0.15]))


def test_agents_are_grouped_by_structure_and_names_follow():
    truth, nominal = team.team(mixed())
    assert team.agent_names(mixed()) == ("a", "c", "b")
    assert team.contact_names(mixed()) == ("a/a0", "c/a0", "b/a0", "b/a1")
    assert truth.sizes == (2, 1)
    np.testing.assert_array_equal(grasp.contact_points(truth), [[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, 1, 0.1]])
    assert truth.agent_groups[0].tree.prismatic == (True,)
    assert truth.agent_groups[1].tree.tip_bodies == (2, 0)
    np.testing.assert_allclose(truth.agent_groups[1].joint_axis[0], [[0, 0.6, 0.8]] * 2)
    np.testing.assert_allclose(np.concatenate(team.initial_yaw(mixed())), [0, -np.pi / 2, np.pi / 2])
    np.testing.assert_array_equal(team.nominal_posture(mixed())[0], [[0.3], [0]])
    assert nominal.agent_groups[0].mass[1, 1] == 0.2
    assert truth.agent_groups[0].mass[1, 1] == nominal.agent_groups[0].mass[0, 1] == 0.1


def test_roll_pitch_yaw_are_about_fixed_axes():
    expected = Rotation.from_euler("xyz", [10, 20, 30], degrees=True).as_matrix()
    np.testing.assert_allclose(team.team(mixed())[0].agent_groups[0].joint_rotation[1, 0], expected, atol=1e-15)
