"""Tests of the settings of faults: names, times, and what the simulated world receives."""

from __future__ import annotations

import typing

import numpy as np
import pytest

from colift import scenario
from colift.scenario import ScenarioError, experiment
from colift.scenario.schema.faults import SensorFailure
from colift.simulation import sensor_faults
from colift.workflows import python_api


def load(*given, **changes):
    return python_api.load_scenario("paper", {"faults": list(given), **changes})


THRUST = {"kind": "thrust", "who": "front", "start_s": 1, "to": 0.6}
CONTACT = {"kind": "contact", "who": "rear/left", "start_s": 2}
ROTOR = {"kind": "rotor", "who": "rear/3", "start_s": 1}
LINK = {
    "kind": "link",
    "who": "rear",
    "start_s": 1,
    "end_s": 4,
    "rate_Hz": 50,
    "delay_s": 0.02,
    "dropout_probability": 0.2,
}
MOTORS = {
    "kind": "motors",
    "bandwidth_Hz": 20.0,
    "rotors": {"num_rotors": 4, "radius_m": 0.25, "moment_ratio_m": 0.016},
}
SENSOR = {"kind": "sensor", "who": "payload", "start_s": 1, "end_s": 2, "reading": "p"}


def test_settings_reach_the_world():
    world = experiment.make_experiment(load(THRUST, CONTACT, SENSOR), "C1").world
    (loss,) = world.faults.thrust
    np.testing.assert_array_equal(loss.share[0], [0.6, 1.0])
    assert (float(loss.start), float(loss.end)) == (1.0, np.inf)
    np.testing.assert_array_equal(world.faults.release_time[0], [[np.inf, np.inf], [2.0, np.inf]])
    assert world.faults.regrasp_time is None
    assert world.sensor_models[-1].channel == "payload.p"


@pytest.mark.parametrize("to", typing.get_args(SensorFailure))
def test_a_failure_of_a_reading_reaches_the_world(to):
    """Garbage and wrong readings have 100 standard deviations of the noise, 2 mm."""
    given = {**SENSOR, "to": to, "rate_Hz": 20, "delay_s": 0.02, "dropout_probability": 0.7}
    setup = experiment.make_experiment(load(given), "C1")
    model, dt = setup.world.sensor_models[-1], setup.dt
    assert (model.channel, float(model.start), float(model.end)) == ("payload.p", 1.0, 2.0)
    if isinstance(model, sensor_faults.HeldReading):
        found = [float(x) for x in (model.sample_period, model.dropout_probability, model.reports_age)]
        expected = {
            "stuck": [dt, 1, 0],
            "off": [dt, 1, 1],
            "slow": [0.05, 0, 1],
            "intermittent": [dt, 0.7, 1],
        }[to]
    elif isinstance(model, sensor_faults.DelayedReading):
        found, expected = [model.delay], {"delayed": [round(0.02 / dt)]}[to]
    else:
        found = [float(model.offset), float(model.noise)]
        expected = {"wrong": [0.2, 0], "garbage": [0, 0.2]}[to]
    np.testing.assert_allclose(found, expected)


def test_the_time_of_a_regrasp_reaches_the_world():
    world = experiment.make_experiment(load({**CONTACT, "end_s": 3}), "C1").world
    np.testing.assert_array_equal(world.faults.regrasp_time[0], [[np.inf, np.inf], [3.0, np.inf]])


def test_a_link_fault_reaches_world_and_controller():
    setup = experiment.make_experiment(load(LINK), "C1")
    model, ticks = setup.world.sensor_models[-1], round(0.02 / setup.dt)
    np.testing.assert_array_equal(model.member, [False, True])
    np.testing.assert_allclose([model.period, model.loss_probability, model.delay], [0.02, 0.2, ticks])
    assert setup.controller.command_link.max_delay == ticks
    assert experiment.make_experiment(load(THRUST), "C1").controller.command_link is None


@pytest.mark.parametrize("to", [None, 0.3])
def test_a_rotor_fault_reaches_the_world(to):
    world = experiment.make_experiment(load({**ROTOR, "to": to, "end_s": 2}, actuators=MOTORS), "C1").world
    (fault,), (mixer,) = world.faults.rotors, world.faults.mixers
    np.testing.assert_array_equal(fault.stuck[0], [[False] * 4, [False, False, False, to is None]])
    np.testing.assert_array_equal(fault.share[0], [[1.0] * 4, [1.0, 1.0, 1.0, 1.0 if to is None else to]])
    assert (float(fault.start), float(fault.end)) == (1.0, 2.0)
    np.testing.assert_array_equal(mixer.effectiveness, world.actuators.limits[0].effectiveness)


def test_the_allocation_within_limits_estimates_effectiveness():
    """It also detects open contacts."""
    for allocation, actuators, estimated in (
        ("constrained", {"kind": "ideal"}, True),
        ("constrained", MOTORS, True),
        ("least_squares", {"kind": "ideal"}, False),
    ):
        settings = load(allocation={"kind": allocation}, actuators=actuators)
        found = experiment.make_experiment(settings, "C1").controller
        assert (found.effectiveness_filter is not None) == estimated
        assert (found.contact_monitor is not None) == (allocation == "constrained")


def test_a_rotor_fault_requires_rotors():
    with pytest.raises(ScenarioError, match=r"faults\[0\].kind.*requires actuators.rotors"):
        load(ROTOR)
    with pytest.raises(ScenarioError, match=r"faults\[0\].who.*rear/3"):
        load({**ROTOR, "who": "rear/4"}, actuators=MOTORS)


def test_faults_are_described_by_kind_part_and_time():
    closes = {**CONTACT, "who": "rear/right", "end_s": 4}
    given = load(THRUST, CONTACT, closes, SENSOR, ROTOR, {**ROTOR, "to": 0}, LINK, actuators=MOTORS).faults
    assert [fault.describe() for fault in given] == [
        "rotors of front at 0.6 of their effectiveness from 1 s",
        "contact rear/left open from 2 s",
        "contact rear/right open from 2 s, may close from 4 s",
        "reading p of payload stuck from 1 s to 2 s",
        "rotor rear/3 stuck from 1 s",
        "rotor rear/3 at 0 of its force from 1 s",
        "commands to rear at 50 Hz, 0.02 s late, 0.2 lost from 1 s to 4 s",
    ]


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({**THRUST, "who": "fornt"}, "faults.*who.*did you mean 'front'"),
        ({**THRUST, "to": 1.2}, "faults.*to: must be from 0 to 0.99"),
        ({**THRUST, "start_s": 5, "end_s": 4}, "end_s.* must exceed start_s = 5, got 4"),
        ({**THRUST, "start_s": 500}, "start_s.* must be less than duration_s = 20, got 500"),
        ({**CONTACT, "end_s": 2}, "end_s.* must exceed start_s = 2, got 2"),
        ({**LINK, "who": "raer"}, "did you mean 'rear'"),
        ({**LINK, "delay_s": 0.0201}, "faults.*delay_s.*whole ticks"),
        ({**LINK, "rate_Hz": 1e4}, "faults.*rate_Hz.*control_Hz"),
        ({**CONTACT, "who": "rear/lift"}, "faults.*who.*did you mean 'rear/left'"),
        ({**SENSOR, "to": "delayed", "delay_s": 0}, "faults.*delay_s.*must be from 0.001 to"),
        ({**SENSOR, "reading": "lam"}, "faults.*reading.*a reading of payload"),
        ({**SENSOR, "who": "paylod"}, "did you mean 'payload'"),
        ({**THRUST, "kind": "thrst"}, "faults.*kind must be one of thrust, rotor, sensor, link, contact"),
    ],
)
def test_contradictory_faults_are_refused(fault, message):
    with pytest.raises(ScenarioError, match=message):
        load(fault)


def test_a_contact_opens_once():
    with pytest.raises(ScenarioError, match="'rear/left' is named twice"):
        load(CONTACT, CONTACT)


def test_mujoco_does_not_support_open_contacts():
    with pytest.raises(ScenarioError, match="physics mujoco does not support it; use kind: rigid"):
        load(CONTACT, physics={"kind": "mujoco"})


def test_errors_of_faults_state_file_and_line(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text("schema: 2\nname: own\nextends: paper\nfaults:\n  - {kind: contact, who: rear/lift, start_s: 1}\n")
    with pytest.raises(ScenarioError, match=r"own.yaml:5: faults\[0\].who"):
        scenario.load_scenario(path)
