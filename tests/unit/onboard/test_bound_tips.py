"""Tests of the limits of feedback through agents whose tips cannot move across their thrust."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from colift import scenario
from colift.onboard.control import bound_tips, tracking
from colift.scenario import controllers, team
from tests.support import planar_teams, small_team

G = 9.81
gain_values = st.floats(0.1, 1e3)


@given(zero=gain_values, k_R=gain_values, k_omega=gain_values)
def test_default_yaw_gains_keep_the_bandwidth_below_the_zero(zero, k_R, k_omega):
    """Gains within the bandwidth are kept; larger ones are reduced to it, with a damping ratio of at most 0.7."""
    limit = (bound_tips.BANDWIDTH_RATIO * zero) ** 2
    yaw_R, yaw_omega = bound_tips.default_yaw_gains(zero, k_R, k_omega)
    if k_R <= limit:
        assert (yaw_R, yaw_omega) == (k_R, k_omega)
    else:
        assert yaw_R == pytest.approx(limit)
        assert yaw_omega == pytest.approx(min(k_omega, 1.4 * np.sqrt(limit)))
    assert bound_tips.default_yaw_gains(np.inf, k_R, k_omega) == (k_R, k_omega)


def rigid_hooks(height: float, agents: int = 3) -> tuple[list[bound_tips.HoverAgent], tracking.Gains, float]:
    """Return equal agents with rigid hooks in hover, their gains and the mass of the payload."""
    settings = small_team.settings()
    _, nominal = team.team(settings)
    one = jax.tree.map(lambda x: x[0], nominal.agent_groups[0])
    one = dataclasses.replace(one, tip_position=jnp.array([[0.0, 0.0, -height]]))
    m_L = float(nominal.payload.mass)
    thrust = G * (float(one.mass.sum()) + m_L / agents)
    hover = [bound_tips.HoverAgent(one, jnp.zeros(0), yaw, thrust) for yaw in np.linspace(0, 2, agents)]
    return hover, controllers.gains(settings, nominal), m_L


@pytest.mark.parametrize(("height", "agents"), [(0.1, 3), (0.03, 3), (0.3, 5), (0.1, 1)])
def test_loop_gain_of_equal_rigid_hooks(height, agents):
    """`gain = k_w K_v m l L / u` with `L = I / (I + rho m l^2)` and `rho = m_L / (m_L + N m)`."""
    hover, gains, m_L = rigid_hooks(height, agents)
    m, I = float(hover[0].agent.mass.sum()), float(hover[0].agent.inertia[0, 0, 0])  # noqa: E741
    rho = m_L / (m_L + agents * m)
    lag = I / (I + rho * m * height**2)
    k_v = float(np.max(np.diag(gains.K_v)[:2]))
    expected = float(gains.agent_k_omega) * k_v * m * height * lag / hover[0].thrust
    assert bound_tips.acceleration_loop_gain(hover, gains, m_L, G) == pytest.approx(expected, rel=1e-9)


def test_loop_gain_of_tips_at_the_center_of_mass_is_zero():
    hover, gains, m_L = rigid_hooks(0.0)
    assert bound_tips.acceleration_loop_gain(hover, gains, m_L, G) == pytest.approx(0, abs=1e-12)


def test_loop_gain_is_infinite_where_it_is_not_determined():
    """Straight arms of the paper's team, and a team without weight."""
    hover, gains, m_L = rigid_hooks(0.1)
    assert bound_tips.acceleration_loop_gain(hover, gains, m_L, 0.0) == np.inf
    settings = scenario.load_scenario("paper")
    _, nominal = team.team(settings)
    agent = jax.tree.map(lambda x: x[0], nominal.agent_groups[0])
    straight = [bound_tips.HoverAgent(agent, jnp.zeros(3), 0.0, 20.0)]
    assert bound_tips.acceleration_loop_gain(straight, gains, m_L, G) == np.inf


@pytest.mark.parametrize("height", [0.02, 0.1, 0.4])
def test_zero_of_rigid_hooks_is_that_of_a_pendulum(height):
    """`z = sqrt(u / (m l))`, by the height of the center of mass above the tip."""
    hover, _, _ = rigid_hooks(height)
    agent, posture, yaw, thrust = hover[1]
    m = float(agent.mass.sum())
    zero = bound_tips.right_half_plane_zero(agent, posture, yaw, thrust)
    assert zero == pytest.approx(np.sqrt(thrust / (m * height)), rel=1e-9)
    raised = dataclasses.replace(agent, tip_position=-agent.tip_position)
    assert bound_tips.right_half_plane_zero(raised, posture, yaw, thrust) == np.inf


def test_arms_that_move_tangentially_do_not_limit_yaw():
    """Planar arms limit yaw with radial joint motion, and hardly with tangential one."""
    zeros = []
    for turn_deg in (0.0, 90.0):
        settings = planar_teams.bar(turn_deg)
        zeros.append(bound_tips.yaw_zero(controllers.agents_in_hover(settings, team.team(settings)[1])))
    assert zeros[1] > 10 * zeros[0]
