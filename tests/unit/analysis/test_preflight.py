"""What is said of a scenario before it is flown: the numbers, and what to change where one is bad."""

from __future__ import annotations

import dataclasses
import functools
import json
import re

import jax.numpy as jnp
import numpy as np
import pytest
from typer.testing import CliRunner

from colift import scenario
from colift.analysis import preflight, remedies, stability
from colift.cli.app import app
from colift.scenario import Scenario, experiment, initial_states, team, template, termination
from tests.support import small_team as light

NO_WIND = {"disturbances": ()}


@functools.cache
def found(name: str) -> preflight.PreflightReport:
    """Of the smallest team; with one gain that its sampled loop does not bear."""
    control = light.SAMPLE.control.model_copy(update={"agent_k_omega": 40.0} if name == "wild" else {})
    return preflight.run_preflight(light.settings(control=control))


def finding(of: preflight.PreflightReport, subject: str) -> preflight.Finding:
    (one,) = [each for each in of.findings if each.subject == subject]
    return one


def test_a_team_that_flies_is_sound():
    good = found("good")
    assert good.passed
    assert [each.subject for each in good.findings] == [
        "mass",
        "contacts",
        "thrust",
        "mode",
        "learned",
        "delay",
        "gain",
    ]
    assert good.format_report()[-1] == "sample: passed"
    assert finding(good, "mass").values["total_kg"] == 6
    assert "payload 1.5 kg (nominal 1.2 kg), 3 agents from n0 to n2 of 1.5 kg each" in finding(good, "mass").message
    assert finding(good, "contacts").values["rank"] == 6
    assert 0.002 <= finding(good, "delay").values["margin_s"] <= 0.05
    assert json.loads(json.dumps(good.summary))["mode"]["rad_s"][0] < 0


@pytest.mark.long
def test_a_mode_that_grows_is_bad_and_the_change_that_is_said():
    """A mode that grows is bad and the change that is said steadies it."""
    wild = found("wild")
    assert not wild.passed
    bad, also = [each for each in wild.findings if each.advice]
    assert (bad.subject, also.subject) == ("mode", "learned")
    assert also.values["rad_s"] != bad.values["rad_s"]  # it rests elsewhere
    assert "unstable" in bad.message
    assert re.search(r"moves n\d in (roll|pitch|yaw)", bad.message)
    assert not any(each.subject == "delay" for each in wild.findings)
    (rate,) = re.fullmatch(r"--set control\.agent_k_omega=28\.0 yields ([+-]\S+) rad/s", bad.advice[0]).groups()
    assert float(rate) == pytest.approx(finding(found("good"), "mode").values["rad_s"][0], abs=1e-2)
    assert float(rate) < 0 < finding(wild, "mode").values["rad_s"][0]
    assert wild.format_report()[-1] == "sample: failed: mode, learned"


@pytest.mark.long
def test_too_little_delay_margin_is_bad_with_the_gain_that_gives(monkeypatch: pytest.MonkeyPatch):
    """Too little delay margin is bad with the gain that gives more."""
    every = list(remedies.gain_changes(light.settings()))
    monkeypatch.setattr(preflight, "MIN_DELAY_MARGIN", 0.02)
    monkeypatch.setattr(remedies, "gain_changes", lambda _: [each for each in every if "agent_k_omega" in each[0]])
    late = finding(preflight.run_preflight(light.settings()), "delay")
    margin = re.fullmatch(r"--set control\.agent_k_omega=19\.6 yields (\S+) s", late.advice[0])
    assert margin
    assert float(margin[1]) > late.values["margin_s"]


def test_a_delay_margin_that_is_not_known_is_said_and_not_called(monkeypatch: pytest.MonkeyPatch):
    """A delay margin that is not known is said and not called bad."""

    def unknown(*_: object) -> None:
        raise ValueError("the controller state does not determine every command independently")

    monkeypatch.setattr(stability, "delay_margin", unknown)
    said = preflight._delay(light.settings(), {}, np.eye(1), print)
    assert said.message.endswith("is not known: the controller state does not determine every command independently")
    assert (said.advice, said.values) == ((), {"margin_s": None})


def test_the_thrust_along_a_reference_that_stands_still():
    """The thrust along a reference that stands still is that of hovering."""
    still = light.settings(
        reference=light.SAMPLE.reference.model_copy(update={"amplitude_m": (0.0, 0.0, 0.0)}), **NO_WIND
    )
    plan = experiment.make_experiment(still, "C1")
    truth = plan.world.team
    path = preflight.thrust_profile(plan, initial_states.equilibrium_state(still, truth), np.array([0.0, 7.0]))
    hover = termination.true_hover_thrust(still, truth, plan.controller, plan.world.disturbances)
    np.testing.assert_allclose(path, [hover, hover], rtol=1e-12)


def test_the_thrust_along_a_reference_lifts_all_masses():
    """The thrust along a reference lifts all masses as the payload moves."""
    up = light.SAMPLE.reference.model_copy(
        update={"amplitude_m": (0.0, 0.0, 0.3), "rotation_amplitude_deg": (0.0, 0.0, 0.0)}
    )
    settings = light.settings(reference=up, **NO_WIND)
    plan = experiment.make_experiment(settings, "C1")
    t = np.linspace(0, 10, 7)
    need = preflight.thrust_profile(plan, initial_states.equilibrium_state(settings, plan.world.team), t).sum(1)
    a = np.array([plan.controller.reference.evaluate(jnp.asarray(x)).a[2] for x in t])
    np.testing.assert_allclose(need, 6.0 * (9.81 + a), rtol=1e-9)
    assert np.ptp(a) > 0.1


def heavier(kg: float) -> Scenario:
    load = light.SAMPLE.payload.model_copy(update={"mass_kg": kg})
    return light.settings(payload=load, **NO_WIND)


def test_little_thrust_is_bad_with_how_much_it_should_be(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(stability, "equilibrium_and_jacobian", no_rest)
    seen = preflight.run_preflight(heavier(7.0))
    thrust = finding(seen, "thrust")
    assert [line.split(":")[0] for line in thrust.advice] == ["hover", "reference"]
    need = max(thrust.values["hover_N"].values())
    assert f"agent_types.body.thrust_max_N to {need / 0.9:.3g} or more" in thrust.advice[0]
    assert "no equilibrium" in finding(seen, "rest").message


def test_a_team_that_has_no_thrust_to_spare_is_not_told_to_share(monkeypatch: pytest.MonkeyPatch):
    """Where hover leaves less than is asked of all thrust together no place of contacts helps, and no reference."""
    monkeypatch.setattr(stability, "equilibrium_and_jacobian", no_rest)
    limits = light.SAMPLE.termination.model_copy(update={"hover_thrust_margin": 0.3})
    few = preflight.run_preflight(heavier(7.0).model_copy(update={"termination": limits}))
    hover, reference = finding(few, "thrust").advice
    assert "lower payload.mass_kg, or add an agent" in hover
    assert not any(word in line for word in ("contacts", "slower") for line in (hover, reference))


def test_what_is_alike_in_a_team_is_said_once():
    many = scenario.parse(template.scenario_template("many", 12, 0), "many.yaml")
    said = preflight._mass(many, *team.team(many)).message
    assert "12 agents from agent_1 to agent_12 of 1.5 kg each" in said


def test_arms_that_hang_straight_over_their_contacts_are_told(monkeypatch: pytest.MonkeyPatch):
    """Arms that hang straight over their contacts are told contacts that bend them."""
    monkeypatch.setattr(stability, "equilibrium_and_jacobian", no_rest)
    changes = [f"agent_types.two_arms.joints.{joint}.nominal_position_rad=0" for joint in ("left", "right")]
    changes += [
        f"agents.{name}.contact_positions_m=[[{x}, 0.08, 0.05], [{x}, -0.08, 0.05]]" for name, x in CONTACTS.items()
    ]
    refused = finding(preflight.run_preflight(scenario.load_scenario("paper", changes)), "refused")
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


def test_agents_whose_stated_rest_is_straight_follow_no_rate():
    """Agents whose stated rest is straight follow no rate of labels."""
    changes = [f"agent_types.two_arms.joints.{joint}.nominal_position_rad=0" for joint in ("left", "right")]
    straight = scenario.load_scenario("paper", changes)  # their contacts bend them: the team can be built
    (said,) = preflight._labels(straight, team.team(straight)[1])
    assert "front has straight arms at its nominal joint positions" in said.message
    assert "use none" in said.message
    json.dumps(said.values, allow_nan=False)
    falling = scenario.load_scenario("paper", ["gravity_mps2=[0, 0, 0]"])
    (said,) = preflight._labels(falling, team.team(falling)[1])
    assert "front has no weight" in said.message


def no_rest(*_: object) -> None:
    raise ValueError("the loop has no equilibrium near the start of its reference")


def test_what_cannot_be_built_is_said_with_what_to_change():
    refused = preflight.run_preflight(heavier(20.0))
    assert "cannot hover" in finding(refused, "refused").message
    assert "thrust_max_N" in finding(refused, "refused").advice[0]
    agents = [
        agent.model_copy(update={"contact_positions_m": ((x, 0.02 * (x == 0.0), 0.03),)})
        for agent, x in zip(light.settings().agents, (0.4, 0.0, -0.4), strict=True)
    ]
    line = finding(preflight.run_preflight(light.settings(agents=agents)), "contacts")
    assert line.values["condition"] > preflight.MAX_GRASP_CONDITION
    assert "move n1/hook away from this line" in line.advice[0]


def test_joints_near_a_singular_grasp_are_named(monkeypatch: pytest.MonkeyPatch):
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
    assert joints.values["condition"]["front"] > remedies.MAX_JACOBIAN_CONDITION
    assert re.match(
        r"front: move the nominal position of joint \w+ away from \S+ \(agent_types.two_arms.joints", joints.advice[0]
    )


def test_the_command_prints_the_findings_and_its_status_says(monkeypatch: pytest.MonkeyPatch):
    """The command prints the findings and its status says whether all is sound."""
    monkeypatch.delenv("COLUMNS", raising=False)  # pytest-xdist sets it; lines are then broken
    good = found("good")
    *rest, last = good.findings
    bad = dataclasses.replace(good, findings=(*rest, dataclasses.replace(last, advice=("another gain",))))
    for here, status in [(good, 0), (bad, 1)]:
        monkeypatch.setattr(preflight, "run_preflight", lambda _settings, _say, here=here: here)
        said = CliRunner().invoke(app, ["check", "paper"])
        assert said.exit_code == status
        assert said.stdout.splitlines() == here.format_report()
        data = CliRunner().invoke(app, ["check", "paper", "--json"])
        assert data.exit_code == status
        assert json.loads(data.stdout) == json.loads(json.dumps(here.summary))
    assert CliRunner().invoke(app, ["check", "papr"]).exit_code == 2
    assert CliRunner().invoke(app, ["check", "paper", "--set", "payload.mass_kg=x"]).exit_code == 2


def moving(rate: float, joint: float, load: float) -> stability.Modes:
    """Two modes: the payload's at 2 1/s, and one at a rate that moves a joint of `beam` and the payload so far."""
    joints = np.zeros((2, 12))
    joints[:, 4] = 0.1, joint
    payload = np.zeros((2, 6))
    payload[:, 3] = 1.0, load
    return stability.Modes(
        eigenvalues=np.array([-2.0, -rate + 1j]), payload=payload, attitude=np.zeros((2, 4, 3)), joints=joints
    )


def test_joints_beyond_need_that_return_too_slowly_are_bad(monkeypatch):
    """Joints beyond need that return too slowly are bad and named."""
    beam, say = scenario.load_scenario("beam", ("control.posture_bandwidth=5",)), lambda _what: None
    monkeypatch.setattr(remedies, "posture_changes", lambda _settings, rate, joint, _say: (f"{rate} {joint}",))
    (slow,) = preflight._posture(beam, moving(2.4, 1.0, 0.1), say)
    assert (
        slow.message == "redundant joints converge at 2.4 1/s, slowest agent_2/shoulder; control.posture_bandwidth = 5"
    )
    assert slow.advice == ("2.4 agent_2/shoulder",)
    (fast,) = preflight._posture(beam, moving(2.6, 1.0, 0.1), say)
    assert fast.advice == ()
    assert not list(preflight._posture(beam, moving(0.1, 1.0, 1.0), say))  # the payload's own: its gains are to blame
    assert not list(preflight._posture(scenario.load_scenario("paper"), moving(0.1, 1.0, 0.1), say))
    (held,) = preflight._posture(
        scenario.load_scenario("beam", ("control.posture_bandwidth=0",)), moving(2.6, 1.0, 0.1), say
    )
    assert held.advice


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
        (lambda _c, _r: np.nan, ("start from `colift init`",)),  # no rest
    ],
)
def test_what_lets_joints_return_sooner_is_tried(monkeypatch, rates, advice):
    """First what reaches half of what is stated; else what is sooner than now."""
    beam = scenario.load_scenario(
        "beam", ("control.posture_bandwidth=5", "control.agent_k_R=250", "control.agent_k_omega=28")
    )

    def at_rest(changed: scenario.Scenario) -> stability.Modes:
        rate = rates(changed.control, changed.agent_types != beam.agent_types)
        if np.isnan(rate):
            raise ValueError("no rest")
        return moving(rate, 1.0, 0.1)

    monkeypatch.setattr(remedies, "modes_at_equilibrium", at_rest)
    said = remedies.posture_changes(beam, 1.0, "agent_2/shoulder", lambda _what: None)
    assert len(said) == len(advice)
    assert all(part in line for part, line in zip(advice, said, strict=True))


def test_agents_that_hear_themselves_are_named_and_others():
    """Agents that hear themselves are named and others are not."""
    quiet, loud = scenario.load_scenario("trio"), scenario.load_scenario("seven")
    assert not list(preflight._labels(quiet, team.team(quiet)[1]))
    (said,) = preflight._labels(loud, team.team(loud)[1])
    assert (
        said.message == "agent_1 has a label loop gain of 0.78: cases with label feedback use 43% of its "
        "label rates and respond later to gusts"
    )
    assert not said.advice
    assert set(said.values["gain"]) == {"agent_1", "agent_2", "agent_3"}
