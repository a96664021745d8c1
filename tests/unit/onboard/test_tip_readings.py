"""Tests of the detection of stuck tip force sensors."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import scenario
from colift.closed_loop import flight
from colift.models.measurement import AgentReading, Measurement, PayloadReading
from colift.onboard.estimation import tip_readings
from colift.scenario import experiment
from colift.workflows import python_api
from tests.support import paper_flights, small_team

DT = jnp.array(0.002)


def measured(lam: jax.Array) -> Measurement:
    """Return readings with the tip forces of one group of agents."""
    zero, n = jnp.zeros(3), lam.shape[0]
    still = jnp.zeros((n, 3))
    agents = AgentReading(
        R=jnp.broadcast_to(jnp.eye(3), (n, 3, 3)), x=still, v=still, omega=still, a=still, r=jnp.zeros((n, 0)), lam=lam
    )
    payload = PayloadReading(R=jnp.eye(3), p=zero, v=zero, omega=zero, a=zero)
    return Measurement(agents=(agents,), payload=payload)


def test_time_counts_since_the_last_change_of_each_reading():
    lam = np.random.default_rng(0).normal(size=(8, 2, 2, 3))
    lam[3:6, 1, 0] = lam[2, 1, 0]  # one sensor is stuck for three periods
    lam[4, 0, 1, :2] = lam[3, 0, 1, :2]  # two of three components repeat
    state = tip_readings.initial_tip_readings(measured(jnp.asarray(lam[0])))
    found = []
    for row in lam[1:]:
        state = tip_readings.update_tip_readings(state, measured(jnp.asarray(row)), DT)
        found.append(state.unchanged_time[0])
    expected = np.zeros((7, 2, 2))
    expected[2:5, 1, 0] = [0.002, 0.004, 0.006]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


@pytest.mark.parametrize(("noise", "detects"), [(0.1, True), (0.0, False)])
def test_only_readings_with_noise_are_watched(noise, detects):
    given = small_team.settings().model_dump(mode="json", exclude_none=True)
    given["sensors"] = {"tip_force_N": noise}
    setup = experiment.make_experiment(scenario.Scenario.model_validate(given), "C1")
    assert setup.controller.estimator.detects_stuck_tips is detects


def test_late_readings_are_not_stuck():
    """Readings at 100 Hz, late and with dropouts, have the age that their sensor reports."""
    given = small_team.settings().model_dump(mode="json", exclude_none=True)
    late = {"kind": "intermittent", "channels": ["agents.lam"], "rate_Hz": 100, "delay_s": 0.004}
    given["sensors"] = {"tip_force_N": 0.1, "models": [late | {"dropout_probability": 0.3}]}
    with_detection = experiment.make_experiment(scenario.Scenario.model_validate(given), "label_feedback")
    controller = with_detection.controller
    estimator = dataclasses.replace(controller.estimator, detects_stuck_tips=False)
    without = dataclasses.replace(with_detection, controller=dataclasses.replace(controller, estimator=estimator))
    a, b = (paper_flights.simulate(one, 0.5).records for one in (with_detection, without))
    np.testing.assert_array_equal(a.label_valid, b.label_valid)
    np.testing.assert_array_equal(a.p, b.p)
    assert 0 < np.asarray(a.label_valid).mean() < 1


@pytest.mark.long
def test_a_stuck_sensor_does_not_move_the_contact_forces():
    """Feedback of labels from the stuck reading increased the contact force from 3 N to 51 N within 6 s."""
    fault = {"kind": "sensor", "who": "agent_1", "reading": "lam", "start_s": 6}
    overrides = {"seed": 77, "duration_s": 12, "allocation.kind": "constrained", "faults": [fault]}
    rows = flight.run_experiment(experiment.make_experiment(python_api.load_scenario("trio", overrides), "adaptive"))
    late = np.asarray(rows.records.t) > 6.1
    assert not np.asarray(rows.records.label_valid)[late].any()
    assert np.linalg.norm(rows.records.lam, axis=-1)[late].max() < 3.5
