"""Structural checks of a team, with contacts by their names and before any iteration."""

from __future__ import annotations

import pytest

from colift import scenario
from colift.analysis import preflight
from colift.scenario import Scenario, ScenarioError, initial_states, structure, team, template
from tests.support import small_team as light

LEAST_SQUARES = {"kind": "least_squares"}


def paper(*changes: str) -> Scenario:
    return scenario.load_scenario("paper", changes)


def found(settings: Scenario) -> tuple[structure.StructuralError, ...]:
    return structure.structural_errors(settings, team.team(settings)[0])


def test_teams_that_fly_have_no_structural_errors() -> None:
    assert found(paper()) == ()
    assert found(light.settings()) == ()


def test_contacts_on_a_line_are_named() -> None:
    bar = [f"agents.agent_{k + 1}.contact_positions_m=[[{x}, 0, 0.05]]" for k, x in enumerate((0.5, 0.0, -0.5))]
    settings = scenario.parse(template.scenario_template("t", 3, 0), "t.yaml", bar)
    (error,) = found(settings)
    assert error.message.startswith("contacts agent_1/hook, agent_2/hook and agent_3/hook lie on a line")
    assert "lie on a line: the grasp matrix has rank 5 of 6" in error.message
    with pytest.raises(ScenarioError, match="lie on a line"):
        initial_states.equilibrium_state(settings, team.team(settings)[0])
    report = preflight.run_preflight(settings)
    assert [each.subject for each in report.findings] == ["mass", "build"]
    assert "contact_positions_m" in report.findings[-1].advice[0]


def test_too_few_joints_name_the_contacts() -> None:
    kind = paper().agent_types["two_arms"]
    fixed = kind.model_copy(
        update={
            "joints": kind.joints[:1],
            "arms": tuple(arm.model_copy(update={"joint": "waist"}) for arm in kind.arms),
        }
    )
    errors = found(paper().model_copy(update={"agent_types": {"two_arms": fixed}, "allocation": LEAST_SQUARES}))
    assert errors[0].message.startswith("front: 1 joints for 2 arms (front/left, front/right); 3 joints or more")


def test_a_ring_of_parallel_axes_is_named() -> None:
    """All joints turn about one axis, so that the tips cannot follow sideways."""
    kind = paper().agent_types["two_arms"]
    parallel = kind.model_copy(
        update={"joints": tuple(joint.model_copy(update={"axis": (1.0, 0.0, 0.0)}) for joint in kind.joints)}
    )
    errors = found(paper().model_copy(update={"agent_types": {"two_arms": parallel}}))
    assert "front: its arms (front/left, front/right) and the payload form a ring" in errors[0].message
    assert "in 5 of 6 directions only" in errors[0].message


def test_contacts_out_of_reach_are_named() -> None:
    settings = paper("agents.front.contact_positions_m=[[0.5, 0.6, 0.05], [0.5, -0.6, 0.05]]")
    (error,) = found(settings)
    assert (
        error.message
        == "front: contacts front/left and front/right are 1.2 m apart, but its tips are at most 0.76 m apart"
    )
