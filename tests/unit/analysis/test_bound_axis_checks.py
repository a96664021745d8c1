"""Tests of the findings on bound axes and yaw gains."""

from __future__ import annotations

import json
import re

import numpy as np
import pytest

from colift import scenario
from colift.analysis import bound_axes, bound_axis_checks, headings
from colift.analysis.findings import Level
from colift.onboard.control import bound_tips
from colift.scenario import Scenario, controllers, gain_limits, initial_states, team
from tests.support import planar_teams, user_teams

TORQUES = np.array([[0.02, -0.02, 0.01]] * 3)


def findings(settings: Scenario, compensated: bool = True) -> dict[str, bound_axis_checks.Finding]:
    truth, _ = team.team(settings)
    z, thrust = initial_states.equilibrium_state(settings, truth), planar_teams.hover_thrust(settings)
    axes = bound_axes.bound_axes(truth, z, thrust, team.agent_names(settings))
    zero = bound_tips.yaw_zero(controllers.agents_in_hover(settings, truth))
    found = [
        *bound_axis_checks.check_bound_axes(settings, axes, TORQUES[: len(thrust)], compensated),
        *bound_axis_checks.check_yaw_gains(settings, truth, z, axes, zero),
    ]
    return {finding.subject: finding for finding in found}


def test_bar_states_stiffness_tilt_and_bandwidth():
    found = findings(planar_teams.bar())["bound axes"]
    assert found.message == (
        "no joint moves the tips of vehicle along y: stiffness 7.91 N m/rad, 0.02 N m tilt it by 0.145 deg, bandwidth "
        "6.5 rad/s"
    )
    assert (found.level, found.advice) == (Level.passed, ())
    json.dumps(found.values, allow_nan=False)


def test_commanded_contact_force_leaves_too_little_stiffness():
    """With `compensated=False` the finding fails, and its advice keeps half of the stiffness."""
    found = findings(planar_teams.bar(), compensated=False)["bound axes"]
    assert found.level is Level.failed
    assert "7.91 N m/rad, of which 0.282 remain" in found.message
    assert found.advice[0] == "--set control.agent_k_R=482"
    assert "joint that moves the tips along y (agent_types.vehicle.joints)" in found.advice[1]
    good = findings(planar_teams.bar(agent_k_R=490.0), compensated=False)["bound axes"]
    assert good.level is Level.passed
    unstable = findings(planar_teams.bar(agent_k_R=200.0), compensated=False)["bound axes"]
    assert unstable.values["axes"]["vehicle/y"]["tilt_deg"] is None


EQUAL_GAINS = {"k_R": (60.0, 60.0, 60.0), "k_omega": (14.0, 14.0, 14.0)}
"""Gains by axis, so that those of yaw are not reduced."""


def test_default_yaw_gains_are_within_the_limit():
    assert findings(planar_teams.bar())["yaw gain"].level is Level.passed


def test_yaw_gains_above_the_limit_are_weak_with_typed_advice():
    found = findings(planar_teams.bar(**EQUAL_GAINS))["yaw gain"]
    assert found.level is bound_axis_checks.YAW_GAIN_LEVEL is Level.weak
    assert "zero at 6.5 rad/s: control.k_R = 60 1/s^2 about z (limit 5.29)" in found.message
    gains, turned = found.advice
    assert gains == "--set 'control.k_R=[60,60,4.2]' --set 'control.k_omega=[14,14,2.6]'"
    assert re.match(r"--set agents\.agent_1\.yaw_deg=-?90 --set agents\.agent_2\.yaw_deg=\S+ --set", turned)


def yaw_finding(k_R: tuple[float, ...], k_omega: tuple[float, ...]) -> bound_axis_checks.Finding:
    """Return the finding of the bar with three gains, at function level."""
    settings = planar_teams.bar()
    truth, _ = team.team(settings)
    z, thrust = initial_states.equilibrium_state(settings, truth), planar_teams.hover_thrust(settings)
    axes = bound_axes.bound_axes(truth, z, thrust, team.agent_names(settings))
    control = type(settings.control).model_construct(**vars(settings.control) | {"k_R": k_R, "k_omega": k_omega})
    settings = type(settings).model_construct(**vars(settings) | {"control": control})
    zero = bound_tips.yaw_zero(controllers.agents_in_hover(settings, truth))
    (found,) = bound_axis_checks.check_yaw_gains(settings, truth, z, axes, zero)
    return found


def test_three_yaw_gains_are_read_per_axis(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(headings, "turns_to_tangent", lambda *_: {})  # a changed scenario would be validated
    good = yaw_finding((60.0, 60.0, 4.2), (14.0, 14.0, 2.6))
    assert (good.level, good.advice) == (Level.passed, ())
    bad = yaw_finding((60.0, 60.0, 4.2), (14.0, 14.0, 14.0))
    assert bad.advice[0] == "--set 'control.k_omega=[14,14,2.6]'"  # k_R is not above its limit


def test_turned_arms_have_no_yaw_finding():
    assert set(findings(planar_teams.bar(turn_deg=90.0))) == {"bound axes"}


def test_stiff_hook_is_advised_another_joint():
    hooks = planar_teams.random_team(0)
    found = findings(hooks.model_copy(update={"control": hooks.control.model_copy(update=EQUAL_GAINS)}))
    assert " along x and y: " in found["bound axes"].message
    assert found["yaw gain"].advice[-1].startswith("or add a joint that moves the tips along")


def test_agents_without_bound_axes_have_no_finding():
    assert findings(scenario.load_scenario("seven")) == {}


def translation_finding(settings: Scenario) -> bound_axis_checks.Finding:
    limits = gain_limits.translation_limits(settings, team.team(settings)[0])
    (found,) = bound_axis_checks.check_translation_gains(settings, limits)
    return found


def test_translation_gains_above_the_limit_are_weak():
    """The advice is a typed option, and the gains that it sets have no finding above the limit."""
    settings = planar_teams.bar(turn_deg=90.0)
    found = translation_finding(settings)
    assert found.level is bound_axis_checks.TRANSLATION_GAIN_LEVEL is Level.weak
    assert found.message.startswith("agents rotate to apply horizontal forces, so translation has a right half-plane")
    assert "control.K_v = 4.2 1/s across the vertical (limit 3.67)" in found.message
    (advice,) = found.advice
    assert re.fullmatch(
        r"--set 'control\.K_p=\[\S+,\S+,5\]' --set 'control\.K_v=\[\S+,\S+,4\.2\]' --set control\.agent_k_R=\S+", advice
    )
    changed = user_teams.with_options(settings, user_teams.options_in(advice))
    assert changed.control.K_v[0] < 3 < changed.control.K_v[2] == 4.2
    good = translation_finding(changed)
    assert (good.level, good.advice) == (Level.passed, ())


def test_free_arms_have_no_translation_finding():
    limits = gain_limits.TranslationLimits(zero=np.inf, inertia_ratio=1.0)
    assert list(bound_axis_checks.check_translation_gains(planar_teams.bar(), limits)) == []
