"""Tests of headings that turn planar arms to the tangent."""

from __future__ import annotations

import pytest

from colift import scenario
from colift.analysis import headings
from colift.onboard.control import bound_tips
from colift.scenario import controllers, initial_states, team
from tests.support import planar_teams


def at_rest(settings):
    truth, _ = team.team(settings)
    return settings, truth, initial_states.equilibrium_state(settings, truth)


def test_turned_bar_has_no_low_zero_of_yaw():
    settings, truth, z = at_rest(planar_teams.bar())
    before = bound_tips.yaw_zero(controllers.agents_in_hover(settings, truth))
    turns = headings.turns_to_tangent(settings, truth, z)
    assert {name: abs(turn) for name, turn in turns.items()} == dict.fromkeys(turns, 90.0)
    option, changed = headings.heading_change(settings, turns)
    assert option.startswith("--set agents.agent_1.yaw_deg=")
    assert option.count("--set") == 3
    changed, truth, z = at_rest(changed)
    assert bound_tips.yaw_zero(controllers.agents_in_hover(changed, truth)) > 10 * before
    assert headings.turns_to_tangent(changed, truth, z) == {}


@pytest.mark.parametrize(("turn", "back"), [(20.0, 70.0), (-20.0, -70.0), (0.0, 90.0)])
def test_turn_is_the_smallest_one(turn: float, back: float):
    turns = headings.turns_to_tangent(*at_rest(planar_teams.bar(turn_deg=turn)))
    assert set(turns.values()) <= {back, -back if back == 90 else back}


@pytest.mark.parametrize("name", ["plate", "seven", "paper"])
def test_other_agents_have_no_heading_change(name: str):
    assert not list(headings.heading_changes(*at_rest(scenario.load_scenario(name))))


def test_both_quarter_turns_are_tried():
    changes = [option for option, _ in headings.heading_changes(*at_rest(planar_teams.bar()))]
    assert [option.split()[1] for option in changes] == ["agents.agent_1.yaw_deg=90", "agents.agent_1.yaw_deg=-90"]
