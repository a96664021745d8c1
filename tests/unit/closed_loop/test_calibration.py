"""Tests of the calibration flight, and of flights whose contact forces rest on it."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import flight, simulator
from colift.models.state import flatten_agent_force
from colift.onboard.learning import residual_model
from colift.scenario import ScenarioError, experiment, initial_states
from colift.workflows import python_api
from tests.support import small_team as light

CALIBRATED = {"kind": "least_squares", "calibration_s": 4.0}


def calibrated(case: str, **changes: object) -> flight.Experiment:
    """Return an experiment of the small team with a calibration flight."""
    settings = light.settings()
    bias = {"name": "rotors", "kind": "rotor_bias", "acts_on": "n0", "thrust_N": -1.0, "torque_Nm": [0.02, 0.0, 0.0]}
    data = settings.model_dump() | {"contact_forces": CALIBRATED} | changes
    data["disturbances"] = [*data["disturbances"], bias]
    return experiment.make_experiment(type(settings).model_validate(data), case)


@functools.cache
def flown(case: str) -> flight.FlightResult:
    return flight.run_experiment(dataclasses.replace(calibrated(case), duration=3.0))


def test_no_contact_force_acts_in_the_calibration_flight():
    """The payload rests on the ground, the agents move along the path and have no contact forces."""
    free = calibrated("C1").calibration.experiment  # type: ignore[union-attr]
    setup = dataclasses.replace(free.loop_config)
    loop = simulator.reset(setup, free.initial_state)
    noise = flight.draw_noise(free.world, jax.random.key(0), 500)
    _, rows = simulator.rollout(setup, loop, noise, jnp.asarray(500))
    assert np.abs(rows.lam).max() < 1e-6
    np.testing.assert_allclose(rows.p, np.broadcast_to(rows.p[0], rows.p.shape), atol=1e-9)
    moved = np.asarray(rows.x[-1]) - np.asarray(rows.x[0])
    assert np.abs(moved).max() > 0.01


def test_the_calibration_flight_covers_the_flight_with_payload():
    """The agents end near the path without initial errors, and the joints oscillate with the stated amplitude."""
    settings = python_api.load_scenario("paper", {"contact_forces": CALIBRATED})
    planned = experiment.make_experiment(settings, "C1")
    assert planned.calibration is not None
    free = planned.calibration.experiment  # type: ignore[attr-defined]
    (group,) = free.controller.agent_controller.offset
    at_rest = initial_states.state_at_rest(settings, free.controller.team)
    np.testing.assert_allclose(group, np.asarray(at_rest.agents[0].x) - np.asarray(at_rest.payload.p), atol=1e-9)
    loop = simulator.reset(free.loop_config, free.initial_state)
    noise = flight.draw_noise(free.world, jax.random.key(0), 1500)
    _, rows = simulator.rollout(free.loop_config, loop, noise, jnp.asarray(1500))
    late = np.asarray(rows.r)[500:, 2].reshape(-1)  # 2 s, more than a period of the third joint
    assert np.ptp(late) == pytest.approx(0.3, rel=0.3)
    assert late.mean() == pytest.approx(float(at_rest.agents[0].r[0, 2]), abs=0.1)


def test_calibration_identifies_the_residuals_of_the_agents():
    """Without payload the labels of the agents are their residuals, whatever the contact forces would be."""
    planned = calibrated("C1")
    assert planned.calibration is not None
    found, rows = planned.calibration.result, flown("C1").records  # type: ignore[attr-defined]
    _, inputs = flight.model_inputs(planned.world.team, jax.tree.map(lambda x: np.asarray(x)[-1:], rows))
    predicted = residual_model.predict_agents(found.prior, tuple(jnp.asarray(x[0]) for x in inputs))
    f = np.concatenate([np.asarray(flatten_agent_force(part))[:, :3] for part in predicted])
    np.testing.assert_allclose(f, rows.f_x[-1], atol=0.25)
    assert np.abs(rows.f_x[-1]).max() > 0.5


def test_contact_forces_without_tip_sensors():
    rows = flown("C1").records
    late = np.asarray(rows.t) > 1
    error = (np.asarray(rows.lam_hat) - rows.lam)[late]
    assert rows.lam_std is not None
    assert np.abs(error.mean(0)).max() < 0.1
    assert np.sqrt((error**2).mean()) == pytest.approx(np.sqrt((rows.lam_std[late] ** 2).mean()), rel=0.5)
    assert rows.delta_W_hat is not None
    assert rows.delta_W_std is not None
    mismatch = (np.asarray(rows.delta_W_hat) - rows.delta_W)[late]
    share = np.abs(mismatch) < 3 * np.asarray(rows.delta_W_std)[late]
    assert share.mean() > 0.95
    bias = flown("C1").uncertainty.payload_label_bias
    np.testing.assert_allclose(bias, rows.delta_W_std[:: len(rows.t) // len(bias)][: len(bias)])


@pytest.mark.long
def test_a_wrong_prior_does_not_confirm_itself():
    """Labels that follow from a wrong prior are learned by the controller, and the contact forces do not change.

    With a prior whose force is wrong by 1 N, the estimates of an agent's forces are wrong by 1 N before and after the
    updates of case `adaptive`.
    """
    planned = calibrated("adaptive")
    assert planned.calibration is not None
    controller = planned.calibration.calibrated(planned.controller)
    forces = controller.estimator.contact_forces  # type: ignore[attr-defined]
    mean = forces.prior.mean_function
    wrong = dataclasses.replace(mean, agents=tuple(x + jnp.array([[0.0, 1.0]]) for x in mean.agents))
    forces = dataclasses.replace(forces, prior=dataclasses.replace(forces.prior, mean_function=wrong))
    estimator = dataclasses.replace(controller.estimator, contact_forces=forces)  # type: ignore[type-var]
    controller = dataclasses.replace(controller, estimator=estimator)
    result = flight.run_experiment(
        dataclasses.replace(planned, controller=controller, calibration=None, duration=planned.duration)
    )
    rows, updates = result.records, [update.t for update in result.updates]
    error = (np.asarray(rows.lam_hat) - rows.lam)[:, :, 2].sum(1)
    before, after = error[(rows.t > 0.3) & (rows.t < updates[0])].mean(), error[rows.t > updates[-1]].mean()
    assert len(updates) >= 3
    assert abs(before) > 0.5
    assert after == pytest.approx(before, rel=0.25)


def test_a_calibration_needs_samples_and_the_built_in_estimator():
    with pytest.raises(ValueError, match=r"contact_forces.calibration_s|must be 0, or at least"):
        calibrated("C1", contact_forces=CALIBRATED | {"calibration_s": 1.0})
    own = {"estimator": {"class": "colift.onboard.estimation.state_estimator:ComplementaryFilter"}}
    with pytest.raises((ScenarioError, ValueError)):
        calibrated("C1", plugins=own)
