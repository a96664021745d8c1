"""Tests of the detection of tip force sensors that are stuck or have wrong values."""

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
    state = tip_readings.initial(measured(jnp.asarray(lam[0])))
    found = []
    for row in lam[1:]:
        state = tip_readings.count_unchanged(state, measured(jnp.asarray(row)), DT)
        found.append(state.unchanged_time[0])
    expected = np.zeros((7, 2, 2))
    expected[2:5, 1, 0] = [0.002, 0.004, 0.006]
    np.testing.assert_allclose(found, expected, rtol=1e-12)


def detected(changes: np.ndarray) -> np.ndarray:
    """Return in which control periods a wrong reading has been detected; a row contains payload and agents."""
    state, found = tip_readings.initial(measured(jnp.zeros((1, 1, 3)))), []
    advance = jax.jit(tip_readings.detect_wrong_readings)
    for row in changes:
        state = advance(state, jnp.asarray(row), jnp.asarray(True), DT)
        found.append(bool(state.failed))
    return np.array(found)


@pytest.mark.parametrize(
    ("payload", "agents", "expected"),
    [(-4.0, 4.0, True), (4.0, 0.0, False), (0.0, 10.0, False), (4.0, 4.0, False), (-1.0, 1.0, False)],
)
def test_opposite_changes_of_both_labels_are_wrong_readings(payload, agents, expected):
    """A change of one label, and equal changes, are residuals; changes of four standard deviations are noise."""
    rows = np.random.default_rng(0).normal(scale=0.25, size=(1000, 2, 3))
    rows[800:, 0, 1] += payload
    rows[800:, 1, 1] += agents
    found = detected(rows)
    assert not found[:800].any()
    assert found[-1] == expected
    assert found[800] == expected


def test_changes_in_the_first_second_are_not_detected():
    rows = np.random.default_rng(0).normal(scale=0.25, size=(500, 2, 3))
    rows[300:310] += [[[4.0], [-4.0]]]
    assert not detected(rows).any()


@pytest.mark.parametrize(("noise", "detects"), [(0.1, True), (0.0, False)])
def test_only_readings_with_noise_are_watched(noise, detects):
    given = small_team.settings().model_dump(mode="json", exclude_none=True)
    given["sensors"] = {"tip_force_N": noise}
    setup = experiment.make_experiment(scenario.Scenario.model_validate(given), "C1")
    assert setup.controller.estimator.detects_tip_failures is detects


def test_late_readings_are_not_stuck():
    """Readings at 100 Hz, late and with dropouts, have the age that their sensor reports."""
    given = small_team.settings().model_dump(mode="json", exclude_none=True)
    late = {"kind": "intermittent", "channels": ["agents.lam"], "rate_Hz": 100, "delay_s": 0.004}
    given["sensors"] = {"tip_force_N": 0.1, "models": [late | {"dropout_probability": 0.3}]}
    with_detection = experiment.make_experiment(scenario.Scenario.model_validate(given), "label_feedback")
    controller = with_detection.controller
    estimator = dataclasses.replace(controller.estimator, detects_tip_failures=False)
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
