"""Tests of the preflight check: values, and the changes that it advises."""

from __future__ import annotations

import dataclasses
import functools
import json
import re
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

from colift import scenario
from colift.analysis import feasibility, loop_checks, preflight, reference_loads, remedies, stability
from colift.analysis.findings import Level, Verdict
from colift.cli.app import app
from colift.onboard.control import label_feedback
from colift.onboard.estimation import contact_forces
from colift.scenario import (
    Scenario,
    experiment,
    initial_states,
    loading,
    schema,
    team,
    template,
    termination,
    vehicle_import,
)
from tests.support import small_team as light
from tests.support import user_teams
from tests.unit.analysis.test_loop_checks import two_modes

NO_WIND = {"disturbances": ()}


@functools.cache
def found(name: str) -> preflight.PreflightReport:
    """Report of the smallest team as shipped, with a gain that makes the loop unstable, and as advised then."""
    gains = {"wild": {"agent_k_omega": 100.0}, "advised": {"agent_k_omega": 70.0}}
    control = light.SAMPLE.control.model_copy(update=gains.get(name, {}))
    return preflight.run_preflight(light.settings(control=control))


def finding(of: preflight.PreflightReport, subject: str) -> preflight.Finding:
    (one,) = [each for each in of.findings if each.subject == subject]
    return one


def test_shipped_team_passes_all_checks():
    good = found("good")
    assert good.passed
    assert [each.subject for each in good.findings] == [
        "mass",
        "contacts",
        "thrust",
        "thrust loss",
        "bound axes",
        "yaw gain",
        "translation gain",
        "slowest mode",
        "learned mode",
        "delay margin",
        "gain margin",
        "disturbances",
    ]
    assert good.format_report()[-1].startswith(f"sample: {good.verdict.value}")
    assert finding(good, "mass").values["total_kg"] == 6
    assert "payload 1.5 kg (nominal 1.2 kg), 3 agents from n0 to n2 of 1.5 kg each" in finding(good, "mass").message
    assert finding(good, "contacts").values["rank"] == 6
    assert 0.002 <= finding(good, "delay margin").values["delay_margin_s"] <= 0.05
    assert json.loads(json.dumps(good.summary))["checks"]["slowest_mode"]["eigenvalue_radps"][0] < 0


@pytest.mark.long
def test_unstable_mode_fails_and_advice_stabilizes_it():
    """An unstable mode fails the check, and the advised change stabilizes it."""
    unstable = found("wild")
    assert not unstable.passed
    bad, also = [each for each in unstable.findings if each.level is Level.failed]
    assert (bad.subject, also.subject) == ("slowest mode", "learned mode")
    assert also.values["eigenvalue_radps"] != bad.values["eigenvalue_radps"]  # another equilibrium
    assert "unstable" in bad.message
    assert re.search(r"moves the payload in yaw \(1\), n\d in (roll|pitch|yaw)", bad.message)
    assert not any(each.subject == "delay margin" for each in unstable.findings)
    (rate,) = re.fullmatch(r"--set control\.agent_k_omega=70\.0 yields ([+-]\S+) rad/s", bad.advice[0]).groups()
    rates = {name: finding(found(name), "slowest mode").values["eigenvalue_radps"][0] for name in ("advised", "good")}
    assert float(rate) == pytest.approx(rates["advised"], abs=1e-2)
    assert rates["good"] < 0
    assert float(rate) < 0 < finding(unstable, "slowest mode").values["eigenvalue_radps"][0]
    assert (
        unstable.format_report()[-1] == "sample: unsound (failed: slowest mode, learned mode; weak: translation gain)"
    )


@pytest.mark.long
def test_small_delay_margin_fails_with_gain_advice(monkeypatch: pytest.MonkeyPatch):
    """A small delay margin fails the check, and the advice names a gain that increases it."""
    every = list(remedies.gain_changes(light.settings()))
    monkeypatch.setattr(loop_checks, "MIN_DELAY_MARGIN", 0.02)
    monkeypatch.setattr(remedies, "gain_changes", lambda _: [each for each in every if "agent_k_omega" in each[0]])
    monkeypatch.setattr(remedies, "margin_changes", lambda *_: {})
    late = finding(preflight.run_preflight(light.settings()), "delay margin")
    margin = re.fullmatch(r"--set control\.agent_k_omega=19\.6 yields (\S+) s", late.advice[0])
    assert margin
    assert float(margin[1]) > late.values["delay_margin_s"]


def test_thrust_of_constant_reference_is_hover_thrust():
    """The thrust along a constant reference is that of hovering."""
    still = light.settings(
        reference=light.SAMPLE.reference.model_copy(update={"amplitude_m": (0.0, 0.0, 0.0)}), **NO_WIND
    )
    c1 = experiment.make_experiment(still, "C1")
    truth = c1.world.team
    path = reference_loads.thrust_profile(c1, initial_states.equilibrium_state(still, truth), np.array([0.0, 7.0]))
    hover = termination.true_hover_thrust(still, truth, c1.controller, c1.world.disturbances)
    np.testing.assert_allclose(path, [hover, hover], rtol=1e-12)


def test_thrust_along_reference_accelerates_all_masses():
    """The thrust along a reference accelerates all masses like the payload."""
    up = light.SAMPLE.reference.model_copy(
        update={"amplitude_m": (0.0, 0.0, 0.3), "rotation_amplitude_deg": (0.0, 0.0, 0.0)}
    )
    settings = light.settings(reference=up, **NO_WIND)
    c1 = experiment.make_experiment(settings, "C1")
    t = np.linspace(0, 10, 7)
    need = reference_loads.thrust_profile(c1, initial_states.equilibrium_state(settings, c1.world.team), t).sum(1)
    a = np.array([c1.controller.reference.evaluate(jnp.asarray(x)).a[2] for x in t])
    np.testing.assert_allclose(need, 6.0 * (9.81 + a), rtol=1e-9)
    assert np.ptp(a) > 0.1


def heavier_payload(kg: float) -> Scenario:
    load = light.SAMPLE.payload.model_copy(update={"mass_kg": kg})
    return light.settings(payload=load, **NO_WIND)


def test_small_thrust_fails_with_required_value(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(stability, "equilibrium_and_jacobian", no_rest)
    seen = preflight.run_preflight(heavier_payload(7.0))
    thrust = finding(seen, "thrust")
    assert [line.split(":")[0] for line in thrust.advice] == ["hover", "reference"]
    need = max(thrust.values["hover_thrust_N"].values())
    assert f"agent_types.body.thrust_max_N to {need / 0.9:.3g} or more" in thrust.advice[0]
    assert "no equilibrium" in finding(seen, "equilibrium").message


def test_no_contact_advice_without_thrust_reserve(monkeypatch: pytest.MonkeyPatch):
    """If total hover thrust exceeds the limit, neither contact positions nor the reference are advised."""
    monkeypatch.setattr(stability, "equilibrium_and_jacobian", no_rest)
    few = preflight.run_preflight(heavier_payload(7.0), thrust_margin=0.3)
    hover, reference = finding(few, "thrust").advice
    assert "lower payload.mass_kg, or add an agent" in hover
    assert not any(word in line for word in ("contacts", "slower") for line in (hover, reference))


def test_waypoints_that_overshoot_are_a_finding_with_a_remedy(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(stability, "equilibrium_and_jacobian", no_rest)
    times = [0, 4, 4.1, 12]
    poses = [
        {"time_s": t, "position_m": (x, y, 2)} for t, x, y in zip(times, (0, 1, 1.1, 4), (0, 0, 0.1, 1), strict=True)
    ]
    settings = light.settings(reference=schema.Waypoints(kind="waypoints", poses=poses), **NO_WIND)
    seen = finding(preflight.run_preflight(settings), "reference")
    assert seen.message.startswith("4 waypoints; largest acceleration ")
    assert seen.values["overshoot_m"] > 0.2
    assert seen.advice[0].startswith("give leg")
    first = experiment.make_experiment(settings, "C1")
    (_, warning, *_) = feasibility.assess_feasibility(settings, {"C1": first}).warnings
    assert warning.startswith("the reference leaves the box of its poses by ")


def test_findings_are_reported_before_the_loop_is_linearized(monkeypatch: pytest.MonkeyPatch):
    reported, before = [], []
    monkeypatch.setattr(stability, "equilibrium_and_jacobian", lambda *_: before.extend(reported) or no_rest())
    report = preflight.run_preflight(light.settings(), report=lambda finding: reported.append(finding.subject))
    assert before[:3] == ["mass", "contacts", "thrust"]
    assert reported == [finding.subject for finding in report.findings] == [*before, "equilibrium"]


def test_agents_with_very_many_joints_are_not_built(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """The check of an agent with 96 joints reports masses, contacts and thrust without compilation."""
    file = tmp_path / "vehicle.urdf"
    file.write_text(user_teams.VEHICLES["planar"])
    text = vehicle_import.from_urdf_file("team", None, file, tmp_path).text
    file.write_text(user_teams.vehicle(1.5, 1.0, "xy" * 48, [0.003] * 96, [0.003] * 96))
    settings = loading.parse(text, str(tmp_path / "team.yaml"))
    monkeypatch.setattr(experiment, "make_experiment", lambda *_: pytest.fail("the team was built"))
    report = preflight.run_preflight(settings)
    assert [finding.subject for finding in report.findings] == ["mass", "contacts", "thrust", "slowest mode"]
    assert report.verdict is Verdict.weak
    values = finding(report, "thrust").values["hover_thrust_N"]
    masses = finding(report, "mass").values
    weight = 9.81 * masses["total_kg"]
    assert list(values.values()) == pytest.approx([weight / 3] * 3, rel=1e-6)
    short = settings.model_copy(update={"payload": settings.payload.model_copy(update={"mass_kg": 9.0})})
    assert finding(preflight.run_preflight(short), "thrust").level is Level.failed


def test_searches_share_a_number_of_candidates():
    budget = remedies.SearchBudget(3)
    assert list(budget.within([1, 2])) == [1, 2]
    assert list(budget.within([3])) == [3]
    assert not budget.exhausted
    assert list(budget.within([4])) == []
    assert budget.exhausted
    assert "after 3 candidates" in budget.ended


def test_advice_of_an_exhausted_search_names_its_end():
    beam, quiet = scenario.load_scenario("beam"), lambda _what: None
    for search in (
        lambda budget: remedies.posture_changes(beam, 1.0, "agent_2/shoulder", quiet, budget),
        lambda budget: remedies.delay_margin_changes(beam, 0.001, quiet, budget),
    ):
        budget = remedies.SearchBudget(0)
        assert search(budget) == (budget.ended,)


@pytest.mark.parametrize(("agents", "arms", "candidates"), [(3, 0, 480), (4, 2, 40), (12, 2, 13)])
def test_large_teams_have_fewer_candidates(agents: int, arms: int, candidates: int):
    settings = scenario.parse(template.scenario_template("new", agents, arms), "new.yaml")
    assert remedies.SearchBudget.for_team(settings).candidates == candidates


def test_equal_agents_are_summarized():
    many = scenario.parse(template.scenario_template("many", 12, 0), "many.yaml")
    finding_ = preflight._mass(many, *team.team(many)).message
    assert "12 agents from agent_1 to agent_12 of 1.5 kg each" in finding_


def test_straight_arms_are_reported_with_contacts(monkeypatch: pytest.MonkeyPatch):
    """Arms that are straight above their contacts are reported with contact positions that bend them."""
    monkeypatch.setattr(stability, "equilibrium_and_jacobian", no_rest)
    changes = [f"agent_types.two_arms.joints.{joint}.nominal_position_rad=0" for joint in ("left", "right")]
    changes += [
        f"agents.{name}.contact_positions_m=[[{x}, 0.08, 0.05], [{x}, -0.08, 0.05]]" for name, x in CONTACTS.items()
    ]
    refused = finding(preflight.run_preflight(scenario.load_scenario("paper", changes)), "build")
    assert "front: grasp Jacobian is nearly singular" in refused.message
    (advice,) = refused.advice
    better = re.findall(r"--set '([^']*)'", advice)
    assert len(better) == 2
    settings = scenario.load_scenario("paper", [*changes, *better])
    truth, _ = team.team(settings)
    assert (
        max(
            remedies.grasp_jacobian_conditions(
                settings, truth, initial_states.equilibrium_state(settings, truth)
            ).values()
        )
        < remedies.MAX_JACOBIAN_CONDITION
    )


CONTACTS = {"front": 0.5, "rear": -0.5}


def test_straight_nominal_posture_uses_no_label_rate():
    """Agents with a straight nominal posture, or without weight, use no label rates."""
    changes = [f"agent_types.two_arms.joints.{joint}.nominal_position_rad=0" for joint in ("left", "right")]
    straight = scenario.load_scenario("paper", changes)  # the contacts bend the arms, so that the team can be built
    (finding_,) = preflight._labels(straight, team.team(straight)[1])
    assert "front has straight arms at its nominal joint positions" in finding_.message
    assert "use none" in finding_.message
    json.dumps(finding_.values, allow_nan=False)
    falling = scenario.load_scenario("paper", ["gravity_mps2=[0, 0, 0]"])
    (finding_,) = preflight._labels(falling, team.team(falling)[1])
    assert "front has no weight" in finding_.message


def no_rest(*_: object) -> None:
    raise ValueError("the loop has no equilibrium near the start of its reference")


def test_rejected_scenario_is_reported_with_advice():
    refused = preflight.run_preflight(heavier_payload(20.0))
    assert "cannot hover" in finding(refused, "build").message
    assert "thrust_max_N" in finding(refused, "build").advice[0]
    agents = [
        agent.model_copy(update={"contact_positions_m": ((x, 0.02 * (x == 0.0), 0.03),)})
        for agent, x in zip(light.settings().agents, (0.4, 0.0, -0.4), strict=True)
    ]
    line = finding(preflight.run_preflight(light.settings(agents=agents)), "contacts")
    assert line.values["condition_number"] > preflight.MAX_GRASP_CONDITION
    assert "move n1/hook away from this line" in line.advice[0]


def test_joints_near_singular_grasp_are_named(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(stability, "equilibrium_and_jacobian", no_rest)
    change = (
        "agent_types.two_arms.joints.1.nominal_position_rad=0.03",
        "agent_types.two_arms.joints.2.nominal_position_rad=-0.03",
    )
    contacts = [
        f"agents.{i}.contact_positions_m=[[{x}, 0.089, 0.05], [{x}, -0.089, 0.05]]" for i, x in ((0, 0.5), (1, -0.5))
    ]
    settings = scenario.load_scenario("paper", (*change, *contacts))
    joints = finding(preflight.run_preflight(settings), "joints")
    assert joints.values["condition_number"]["front"] > remedies.MAX_JACOBIAN_CONDITION
    assert re.match(
        r"front: move the nominal position of joint \w+ away from \S+ \(agent_types.two_arms.joints", joints.advice[0]
    )


def test_command_prints_findings_and_sets_status(monkeypatch: pytest.MonkeyPatch):
    """The command prints the findings, and its exit status states whether all checks pass."""
    monkeypatch.delenv("COLUMNS", raising=False)  # pytest-xdist sets it; lines are then broken
    good = found("good")
    *rest, last = good.findings
    bad = dataclasses.replace(good, findings=(*rest, dataclasses.replace(last, level=Level.failed)))
    weak = dataclasses.replace(good, findings=(*rest, dataclasses.replace(last, level=Level.weak)))
    for here, status in [(good, 0), (weak, 0), (bad, 1)]:

        def run(_settings, _say, report, here=here):
            for each in here.findings:
                report(each)
            return here

        monkeypatch.setattr(preflight, "run_preflight", run)
        finding_ = CliRunner().invoke(app, ["check", "paper"])
        assert finding_.exit_code == status
        assert finding_.stdout.split() == " ".join(here.format_report()).split()  # lines are wrapped
        data = CliRunner().invoke(app, ["check", "paper", "--json"])
        assert data.exit_code == status
        assert json.loads(data.stdout) == json.loads(json.dumps(here.summary))
    assert CliRunner().invoke(app, ["check", "papr"]).exit_code == 2
    assert CliRunner().invoke(app, ["check", "paper", "--set", "payload.mass_kg=x"]).exit_code == 2


@pytest.mark.parametrize(
    ("rates", "advice"),
    [
        (
            lambda c, _r: 1.5 if c.posture_bandwidth == 2.5 else 2.0 if c.agent_k_omega > 30 else 1.0,
            ("posture_bandwidth=2.5 yields 1.5",),
        ),
        (
            lambda c, r: 1.2 if c.agent_k_R > 300 else 1.1 if r else 0.0,
            ("agent_k_R=350.0 yields 1.2", "nominal_position_rad"),
        ),
        (lambda _c, _r: 0.9, ("start from `colift init`",)),
        (lambda _c, _r: np.nan, ("start from `colift init`",)),  # no equilibrium
    ],
)
def test_posture_advice_lists_changes_that_speed_joints_up(monkeypatch, rates, advice):
    """Changes that reach half of the stated rate come first, then changes that are faster than the present rate."""
    beam = scenario.load_scenario(
        "beam", ("control.posture_bandwidth=5", "control.agent_k_R=250", "control.agent_k_omega=28")
    )

    def at_rest(changed: scenario.Scenario) -> stability.Modes:
        rate = rates(changed.control, changed.agent_types != beam.agent_types)
        if np.isnan(rate):
            raise ValueError("no equilibrium")
        return two_modes(rate, 1.0, 0.1)

    monkeypatch.setattr(remedies, "modes_at_equilibrium", at_rest)
    finding_ = remedies.posture_changes(beam, 1.0, "agent_2/shoulder", lambda _what: None, remedies.SearchBudget(1000))
    assert len(finding_) == len(advice)
    assert all(part in line for part, line in zip(advice, finding_, strict=True))


def test_large_label_loop_gain_is_reported(monkeypatch: pytest.MonkeyPatch):
    """Agents with a large gain are reported, here those whose joint rates follow from the encoders alone."""
    small_gain, large_gain = scenario.load_scenario("trio"), scenario.load_scenario("seven")
    for settings in (small_gain, large_gain):
        assert not list(preflight._labels(settings, team.team(settings)[1]))
    monkeypatch.setattr(contact_forces, "MIN_LEVER", 1e6)
    not_compiled = label_feedback._posture_motion.__wrapped__
    monkeypatch.setattr(label_feedback, "_posture_motion", jax.jit(lambda *of: not_compiled(*of)))
    assert not list(preflight._labels(small_gain, team.team(small_gain)[1]))
    (finding_,) = preflight._labels(large_gain, team.team(large_gain)[1])
    assert (
        finding_.message == "agent_1 has a label loop gain of 0.78: cases with label feedback use 43% of its "
        "label rates and respond later to gusts"
    )
    assert not finding_.advice
    assert set(finding_.values["label_loop_gain"]) == {"agent_1", "agent_2", "agent_3"}
