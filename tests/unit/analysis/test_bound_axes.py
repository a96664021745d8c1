"""Tests of bound axes against numbers derived from masses and lengths."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from colift import scenario
from colift.analysis import bound_axes
from colift.onboard.control import bound_tips
from colift.scenario import controllers, initial_states, team
from tests.support import planar_teams

BAR = bound_axes.BoundAxis("agent_1", np.array([0.0, 1.0, 0.0]), 1.77, 0.03165, 23.90, 0.319)


def axes_and_zero(settings) -> tuple[tuple[bound_axes.BoundAxis, ...], float]:
    truth, _ = team.team(settings)
    z, thrust = initial_states.equilibrium_state(settings, truth), planar_teams.hover_thrust(settings)
    axes = bound_axes.bound_axes(truth, z, thrust, team.agent_names(settings))
    return axes, bound_tips.yaw_zero(controllers.agents_in_hover(settings, truth))


def test_bar_has_the_stiffness_of_its_numbers():
    """`u l / I` = 241; the gain 250 leaves 0.29 of 7.91 N m/rad if torques contain the commanded contact force."""
    assert BAR.thrust * BAR.lever / BAR.inertia == pytest.approx(241, abs=0.5)
    assert BAR.attitude_stiffness(250.0) == pytest.approx(7.91, abs=0.01)
    assert BAR.attitude_stiffness(250.0, compensated=False) == pytest.approx(0.29, abs=0.01)
    assert np.degrees(BAR.tilt(0.02, 250.0)) == pytest.approx(0.145, abs=0.001)
    assert np.degrees(BAR.tilt(0.02, 250.0, compensated=False)) == pytest.approx(3.97, abs=0.1)
    assert math.isinf(BAR.tilt(0.02, 200.0, compensated=False))
    assert BAR.bandwidth == pytest.approx(math.sqrt(23.90 / (1.77 * 0.319)))


def test_center_of_mass_below_the_tips_has_no_zero():
    assert math.isinf(dataclasses.replace(BAR, lever=-0.05).bandwidth)


def test_acceleration_feedback_of_a_long_hook_is_one():
    """Six vehicles of 1.5 kg with a hook of 0.15 m on a plate of 2.7 kg: 1.00, at which the loop was unstable."""
    hook = bound_axes.BoundAxis("agent_1", np.array([1.0, 0.0, 0.0]), 1.5, 0.02, 1.95 * 9.81, 0.15)
    assert hook.acceleration_feedback(28.0, 4.2, 2.7, 6) == pytest.approx(1.0, abs=0.02)
    assert hook.acceleration_feedback(14.0, 4.2, 2.7, 6) == pytest.approx(0.5, abs=0.01)


def test_bar_is_bound_along_y_and_limits_yaw():
    axes, zero = axes_and_zero(planar_teams.bar())
    assert [axis.agent for axis in axes] == ["agent_1", "agent_2", "agent_3"]
    for axis in axes:
        np.testing.assert_allclose(axis.direction, [0, 1, 0], atol=1e-9)
        assert axis.thrust * axis.lever / axis.inertia == pytest.approx(241.1, abs=0.1)
        assert axis.bandwidth == pytest.approx(6.504, abs=1e-3)
    assert zero == pytest.approx(6.504, abs=1e-3)
    stiffness, rate = bound_axes.advised_yaw_gains(zero)
    assert (stiffness, rate) == (4.2, 2.6)
    assert bound_axes.yaw_gains_within_limit(zero, stiffness, rate)
    assert not bound_axes.yaw_gains_within_limit(zero, 60.0, rate)
    assert not bound_axes.yaw_gains_within_limit(zero, stiffness, 14.0)


@pytest.mark.parametrize(("turn", "share"), [(90.0, 0.0), (30.0, 0.75), (60.0, 0.25), (-90.0, 0.0)])
def test_heading_scales_the_zero_of_yaw(turn: float, share: float):
    """Only the part of the tangent along the axis of a planar arm is bound."""
    _, zero = axes_and_zero(planar_teams.bar(turn_deg=turn))
    if share:
        assert zero == pytest.approx(6.504 / math.sqrt(share), rel=1e-2)
    else:
        assert zero > 65  # the joints move the tips along the tangent


def test_plate_and_paper_have_the_zeros_of_their_levers():
    """Plate: `sqrt(9.81 * 1.95 / (1.5 * 0.1))`. In roll the joints of the paper's team overcompensate."""
    axes, zero = axes_and_zero(scenario.load_scenario("plate"))
    assert len(axes) == 12
    assert zero == pytest.approx(math.sqrt(9.81 * 1.95 / 0.15), rel=1e-6)
    axes, zero = axes_and_zero(scenario.load_scenario("paper"))
    assert axes[0].bandwidth == pytest.approx(math.sqrt(9.81 * 2.59 / (1.84 * 0.1007)), rel=1e-3)
    assert math.isinf(axes[1].bandwidth)
    assert zero == pytest.approx(axes[0].bandwidth, rel=1e-2)


@pytest.mark.parametrize("seed", [0, 6, 9])
def test_random_teams_with_equal_agents_have_their_own_zero(seed: int):
    """For equal agents with one contact the zero is `sqrt(u / (m l share))`."""
    settings = planar_teams.random_team(seed)
    axes, zero = axes_and_zero(settings)
    turn = np.radians(settings.agents[0].yaw_deg)
    tangent = np.array([-np.sin(-turn), np.cos(-turn), 0.0])  # of the first agent at angle 0, base frame
    delay = sum((axis.direction @ tangent) ** 2 / axis.bandwidth**2 for axis in axes if axis.agent == "agent_1")
    assert zero == pytest.approx(1 / math.sqrt(delay), rel=1e-2)
