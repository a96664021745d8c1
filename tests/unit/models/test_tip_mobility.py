"""Tests of bound directions against hand-derived teams and the motion of random agents."""

from __future__ import annotations

import numpy as np
import pytest

from colift import scenario
from colift.models import aerial_manipulator, grasp, tip_mobility
from colift.scenario import initial_states, team
from tests.support import planar_teams


def mobility(settings, name: str) -> tip_mobility.TipMobility:
    truth, _ = team.team(settings)
    z = initial_states.equilibrium_state(settings, truth)
    agents = {each: (agent, r) for each, agent, r, _ in grasp.iter_agents(truth, z, team.agent_names(settings))}
    return tip_mobility.tip_mobility(*agents[name])


def test_a_planar_arm_is_bound_along_its_axis():
    """Height and inertia of the bar's vehicle: 0.319 m and 0.03165 kg m^2."""
    found = mobility(planar_teams.bar(), "agent_1")
    np.testing.assert_allclose(np.abs(found.bound), [[0, 1, 0]], atol=1e-9)
    y = np.array([0.0, 1.0, 0.0])
    assert found.mass == pytest.approx(1.77)
    assert found.lever(y) == pytest.approx(0.3192, abs=1e-4)
    assert found.rotational_inertia(y) == pytest.approx(0.03165, abs=1e-5)
    assert found.lever(np.array([1.0, 0.0, 0.0])) == pytest.approx(0.0, abs=1e-3)  # joints move the tip along x
    diagonal = np.array([1.0, 1.0, 0.0]) / np.sqrt(2)
    assert found.bound_share(diagonal) == pytest.approx(0.5)


def test_a_hook_is_bound_in_both_directions():
    """The plate's vehicles: 0.1 m below a base with 0.02 kg m^2."""
    found = mobility(scenario.load_scenario("plate"), "agent_1")
    assert len(found.bound) == 2
    for direction in found.bound:
        assert found.lever(direction) == pytest.approx(0.1)
        assert found.rotational_inertia(direction) == pytest.approx(0.02)


def test_joints_that_must_follow_reduce_the_lever():
    """The paper's team: 0.1007 m in pitch, -0.029 m in roll (docs/errata.md: less where joints yield)."""
    found = mobility(scenario.load_scenario("paper"), "front")
    assert len(found.bound) == 2
    assert found.lever(np.array([1.0, 0.0, 0.0])) == pytest.approx(0.1007, abs=1e-4)
    assert found.lever(np.array([0.0, 1.0, 0.0])) == pytest.approx(-0.0288, abs=1e-4)
    assert found.rotational_inertia(np.array([1.0, 0.0, 0.0])) == pytest.approx(0.02095, abs=1e-5)


def test_joints_about_two_axes_leave_no_bound_direction():
    assert len(mobility(scenario.load_scenario("seven"), "agent_1").bound) == 0
    assert len(mobility(scenario.load_scenario("beam"), "agent_1").bound) == 0


def test_a_short_arm_counts_as_rigid():
    """A joint that moves the tip by less than the tolerance leaves the direction bound."""
    settings = planar_teams.bar()
    truth, _ = team.team(settings)
    z = initial_states.equilibrium_state(settings, truth)
    _, agent, r, _ = next(iter(grasp.iter_agents(truth, z, ())))
    assert len(tip_mobility.tip_mobility(agent, r, min_motion=0.5).bound) == 2
    assert len(tip_mobility.tip_mobility(agent, r, min_motion=0.2).bound) == 1


@pytest.mark.parametrize("seed", range(6))
def test_joint_motion_moves_no_bound_direction(seed: int):
    """Any joint motion with tips at rest: its motion of the center of mass is across the bound directions, and the
    lever is that of every solution with tips at rest.
    """
    settings = planar_teams.random_team(seed)
    truth, _ = team.team(settings)
    z, rng = initial_states.equilibrium_state(settings, truth), np.random.default_rng(seed)
    _, agent, r, _ = next(iter(grasp.iter_agents(truth, z, ())))
    found = tip_mobility.tip_mobility(agent, r)
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, r))
    B = np.asarray(p.J_tip)
    J = np.hstack([np.tile(np.eye(3), (len(B), 1)), B[:, :, 3:].reshape(3 * len(B), -1)])
    _, singular, Vt = np.linalg.svd(J)
    null = Vt[int((singular > 1e-9 * singular[0]).sum()) :].T
    for direction in found.bound:
        np.testing.assert_allclose(direction @ null[:3], 0, atol=tip_mobility.MIN_TIP_MOTION)
        axis = tip_mobility.rotation_axis(direction)
        y = np.linalg.lstsq(J, -B[:, :, :3].reshape(-1, 3) @ axis)[0] + null @ rng.normal(size=null.shape[1])
        np.testing.assert_allclose(J @ y, -B[:, :, :3].reshape(-1, 3) @ axis, atol=1e-9)
        tolerance = 1e-6 + 2 * tip_mobility.MIN_TIP_MOTION * np.linalg.norm(y[3:])
        assert direction @ y[:3] == pytest.approx(found.lever(direction), abs=tolerance)
