"""Tests of the gain limits of translation against the linearized loop of rigid hooks."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from colift import scenario
from colift.analysis import stability
from colift.scenario import Scenario, controllers, experiment, gain_limits, initial_states, team, template
from tests.support import user_teams


def limits_of(settings: Scenario) -> gain_limits.TranslationLimits:
    return gain_limits.translation_limits(settings, team.team(settings)[0])


def hooks(length: float) -> Scenario:
    """Return the team of `init` with three rigid hooks of a length [m]."""
    text = template.scenario_template("hooks", 3, 0).replace("[0, 0, -0.1]", f"[0, 0, -{length}]")
    return scenario.parse(text, "hooks.yaml")


def test_hooks_have_the_zero_and_inertia_ratio_of_their_numbers():
    """`z = sqrt(u / (m l))` and `L = I / (I + rho m l^2)` with 1.5 kg, 1.35 kg of payload and 0.02 kg m^2."""
    limits, length = limits_of(hooks(0.2)), 0.2
    assert limits.zero == pytest.approx(math.sqrt(9.81 * (1.5 + 1.35 / 3) / (1.5 * length)), rel=1e-6)
    rho = 1.35 / (1.35 + 4.5)
    assert limits.inertia_ratio == pytest.approx(0.02 / (0.02 + rho * 1.5 * length**2), rel=1e-6)


def reduced_growth_rate(settings: Scenario) -> float:
    """Return the growth rate of the reduced model of the module [1/s]."""
    limits, control = limits_of(settings), settings.control
    share = float(controllers.gains(settings, team.team(settings)[1]).jerk_feedback)
    K_p, K_v = control.K_p[0], control.K_v[0]
    k_R, k_omega = (limits.inertia_ratio * gain for gain in (control.agent_k_R, control.agent_k_omega))
    forces = [k_omega * share * K_v, k_R * K_v + k_omega * K_p, k_R * K_p]
    roots = np.roots(np.polyadd([1, k_omega, k_R, 0, 0], np.polymul(forces, [-1 / limits.zero**2, 0, 1])))
    return float(roots.real.max())


def test_reduced_model_predicts_the_mode_of_long_hooks():
    """Hooks of 0.35 m are unstable with the gains of the template, and stable with advised gains."""
    settings = hooks(0.35)
    assert limits_of(settings).exceeded(settings.control)
    advised = limits_of(settings).advise(settings.control)
    options = [f"control.K_p=[{advised.K_p},{advised.K_p},5]", f"control.K_v=[{advised.K_v},{advised.K_v},4.2]"]
    changed = user_teams.with_options(settings, [*options, f"control.agent_k_R={advised.agent_k_R}"])
    rates = []
    for each in (settings, changed):
        case = experiment.make_experiment(each, "C1")
        start = initial_states.equilibrium_state(each, case.world.team)
        rates.append(float(stability.modes_at_equilibrium(case, start).eigenvalues[0].real))
    assert rates[0] > 1
    assert rates[1] < -0.5
    assert rates[0] == pytest.approx(reduced_growth_rate(settings), rel=0.3)
    assert rates[1] == pytest.approx(reduced_growth_rate(changed), rel=0.3)
    assert not limits_of(changed).exceeded(changed.control)


@pytest.mark.parametrize("name", scenario.shipped_names())
def test_shipped_scenarios_are_within_the_limits(name: str):
    settings = scenario.load_scenario(name)
    assert not limits_of(settings).exceeded(settings.control)


@pytest.mark.parametrize(("agents", "arms"), [(3, 0), (3, 1), (2, 2)])
def test_gains_of_the_templates_are_within_the_limits(agents: int, arms: int):
    settings = scenario.parse(template.scenario_template("team", agents, arms), "team.yaml")
    assert not limits_of(settings).exceeded(settings.control)


def test_advised_gains_are_at_most_the_present_ones():
    settings = hooks(0.1)
    present = gain_limits.present_gains(settings.control)
    free = gain_limits.TranslationLimits(zero=math.inf, inertia_ratio=1.0).advise(settings.control)
    assert free == present
    assert all(a <= p for a, p in zip(limits_of(hooks(0.3)).advise(settings.control), present, strict=True))


def test_weightless_teams_have_no_limits():
    settings = hooks(0.2).model_copy(update={"gravity_mps2": (0.0, 0.0, 0.0)})
    assert limits_of(settings) == gain_limits.TranslationLimits(math.inf, 1.0)


def test_init_writes_gains_that_bound_tips_permit(tmp_path: Path):
    """Vehicles with planar arms and hooks get lower horizontal gains; arms about two axes keep theirs."""
    for name, limited in (("planar", True), ("hook", True), ("three_joints", False)):
        settings = user_teams.written_by_init(user_teams.VEHICLES[name], tmp_path)
        assert (settings.control.K_v[0] < settings.control.K_v[2]) == limited
        assert not limits_of(settings).exceeded(settings.control)


def test_user_teams_keep_the_limits_with_other_payloads(tmp_path: Path):
    for kind, size in user_teams.PAYLOADS:
        settings = user_teams.user_team("planar", kind, size, tmp_path)
        assert not limits_of(settings).exceeded(settings.control), (kind, size)
