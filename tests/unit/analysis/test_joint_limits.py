"""Joint limits in the nominal posture and in flights."""

from __future__ import annotations

import re

import numpy as np

from colift import scenario
from colift.analysis import joint_limits
from colift.scenario import team


def limited(*changes: str) -> scenario.Scenario:
    return scenario.load_scenario("paper", ["agent_types.two_arms.joints.left.position_limits=[0.5, 1.0]", *changes])


def at(settings: scenario.Scenario) -> np.ndarray:
    return np.concatenate([np.asarray(r).ravel() for r in team.nominal_posture(settings)])


def test_a_nominal_position_outside_of_limits_is_reported() -> None:
    settings = limited()
    sentences, advice = joint_limits.position_violations(settings, at(settings))
    assert sentences[0] == "front/left has the nominal position 1.2 rad, outside of its limits 0.5 to 1 rad"
    assert advice == ("--set agent_types.two_arms.joints.left.nominal_position_rad=0.75",)
    better = re.fullmatch(r"--set (\S+)", advice[0])[1]
    repaired = limited(better)
    assert joint_limits.position_violations(repaired, at(repaired)) == ((), ())


def test_a_position_on_a_limit_may_differ_by_rounding() -> None:
    settings = limited("agent_types.two_arms.joints.left.nominal_position_rad=0.5")
    r = at(settings)
    r[np.isclose(r, 0.5)] -= 1e-12
    assert joint_limits.position_violations(settings, r) == ((), ())


def test_the_largest_violation_of_a_flight_is_reported() -> None:
    settings = limited(
        "agent_types.two_arms.joints.waist.max_speed_radps=2", "agent_types.two_arms.joints.right.max_torque_Nm=3"
    )
    joints = len(team.joint_names(settings))
    r, r_dot, tau = np.full((5, joints), 0.7), np.zeros((5, joints)), np.zeros((5, joints))
    r[3, 1], r_dot[2, 0], tau[4, 2] = 1.1, -2.5, 3.5
    assert list(joint_limits.flight_violations(settings, 0.1 * np.arange(5), r, r_dot, tau)) == [
        "front/waist exceeds its speed limit of 2 rad/s: -2.5 at 0.2 s",
        "front/left leaves its position limits 0.5 to 1 rad: 1.1 at 0.3 s",
        "front/right exceeds its torque limit of 3 N m: 3.5 at 0.4 s",
    ]
