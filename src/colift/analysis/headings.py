"""Changes of the headings of agents whose joints move their tips in one plane.

The payload's yaw acts through contact forces along the tangents of a circle about its center of mass. If the axis of a
planar arm is tangential, the agent must rotate to apply them. If the axis is radial, the joints move the tip along the
tangent.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np

from colift.analysis import bound_axes
from colift.models import grasp, tip_mobility
from colift.models.parameters import Team
from colift.models.state import State
from colift.scenario import Scenario, team

MIN_BOUND_SHARE = 0.5
"""Share of the tangent along bound directions above which another heading is proposed."""

ScenarioChange = tuple[str, Scenario]
"""Option to type, for example `--set agents.agent_1.yaw_deg=90`, and the changed scenario."""


def turns_to_tangent(settings: Scenario, truth: Team, state: State) -> dict[str, float]:
    """Compute the turns that make the axes of planar arms radial.

    Args:
        settings: Scenario, which contains the names.
        truth: True parameters.
        state: State at rest.

    Returns:
        Turn of the heading [deg], above -90 and up to 90, for the agents with one bound direction whose tangent is
        bound by more than `MIN_BOUND_SHARE`.
    """
    turns = {}
    for name, agent, r, R in grasp.iter_agents(truth, state, team.agent_names(settings)):
        bound = tip_mobility.tip_mobility(agent, r).bound
        direction = bound_axes.tangent(np.asarray(agent.contact_position))
        if len(bound) != 1 or direction is None:
            continue
        tangent, axis = np.asarray(state.payload.R) @ direction, R @ bound[0]
        if (tangent @ axis) ** 2 > MIN_BOUND_SHARE:
            angle = np.arctan2(axis[1], axis[0])
            turn = np.degrees(np.arctan2(tangent[1], tangent[0]) + np.pi / 2 - angle) % 180
            turns[name] = round(float(turn if turn <= 90.05 else turn - 180), 1)
    return turns


def heading_change(settings: Scenario, turns: Mapping[str, float]) -> ScenarioChange:
    """Return the change of the headings of some agents by angles [deg]."""
    agents = tuple(
        agent.model_copy(update={"yaw_deg": float(f"{agent.yaw_deg + turns.get(agent.name, 0.0):.6g}")})
        for agent in settings.agents
    )
    option = " ".join(f"--set agents.{agent.name}.yaw_deg={agent.yaw_deg:g}" for agent in agents if agent.name in turns)
    return option, settings.model_copy(update={"agents": agents})


def heading_changes(settings: Scenario, truth: Team, state: State) -> Iterator[ScenarioChange]:
    """Yield scenarios in which the agents of `turns_to_tangent` have headings turned by 90 and -90 deg.

    Args:
        settings: Scenario.
        truth: True parameters.
        state: State at rest.

    Yields:
        The changes; none if no agent has a planar arm with a bound tangent.
    """
    names = turns_to_tangent(settings, truth, state)
    for turn in (90.0, -90.0) if names else ():
        yield heading_change(settings, dict.fromkeys(names, turn))
