"""Tests of the settings of faults: names, times, and what the simulated world receives."""

from __future__ import annotations

import numpy as np
import pytest

from colift import scenario
from colift.scenario import ScenarioError, experiment
from colift.workflows import python_api


def load(*given, **changes):
    return python_api.load_scenario("paper", {"faults": list(given), **changes})


THRUST = {"kind": "thrust", "who": "front", "start_s": 1, "to": 0.6}
CONTACT = {"kind": "contact", "who": "rear/left", "start_s": 2}
SENSOR = {"kind": "sensor", "who": "payload", "start_s": 1, "end_s": 2, "reading": "p"}


def test_settings_reach_the_world():
    world = experiment.make_experiment(load(THRUST, CONTACT, SENSOR), "C1").world
    (loss,) = world.faults.thrust
    np.testing.assert_array_equal(loss.share[0], [0.6, 1.0])
    assert (float(loss.start), float(loss.end)) == (1.0, np.inf)
    np.testing.assert_array_equal(world.faults.release_time[0], [[np.inf, np.inf], [2.0, np.inf]])
    assert world.sensor_models[-1].channel == "payload.p"


def test_faults_are_described_by_kind_part_and_time():
    assert [fault.describe() for fault in load(THRUST, CONTACT, SENSOR).faults] == [
        "rotors of front at 0.6 of their effectiveness from 1 s",
        "contact rear/left open from 2 s",
        "reading p of payload stuck from 1 s to 2 s",
    ]


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({**THRUST, "who": "fornt"}, "faults.*who.*did you mean 'front'"),
        ({**THRUST, "to": 1.2}, "faults.*to: must be from 0 to 0.99"),
        ({**THRUST, "start_s": 5, "end_s": 4}, "end_s.* must exceed start_s = 5, got 4"),
        ({**THRUST, "start_s": 500}, "start_s.* must be less than duration_s = 20, got 500"),
        ({**CONTACT, "who": "rear/lift"}, "faults.*who.*did you mean 'rear/left'"),
        ({**SENSOR, "reading": "lam"}, "faults.*reading.*a reading of payload"),
        ({**SENSOR, "who": "paylod"}, "did you mean 'payload'"),
        ({**THRUST, "kind": "thrst"}, "faults.*kind must be one of thrust, sensor, contact"),
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
