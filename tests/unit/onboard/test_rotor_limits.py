"""Tests of rotor limits that are known on board: the inputs that acted, and where scenarios use them."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import flight
from colift.models.actuator_lag import ring_mixer
from colift.models.state import AgentInput
from colift.onboard.control import actuator_compensation
from colift.scenario import experiment
from colift.workflows import python_api

MOTORS = {
    "kind": "motors",
    "bandwidth_Hz": 20.0,
    "rotors": {"num_rotors": 4, "radius_m": 0.25, "moment_ratio_m": 0.016},
}


LEVER = 0.25 / 2**0.5  # m, of each rotor about the roll axis


@pytest.mark.parametrize(("u", "tau", "acts"), [(30, 0.2, 30), (50, 0, 40), (39.9, 0.2, 40 - 0.2 / LEVER)])
def test_the_inputs_that_acted_are_those_of_the_mixer(u, tau, acts):
    """A roll torque has priority over thrust."""
    mixer = ring_mixer(4, 0.25, 0.016, jnp.array([10.0]))
    given = (AgentInput(u=jnp.array([float(u)]), tau=jnp.array([[tau, 0.0, 0.0]]), tau_r=jnp.zeros((1, 2))),)
    of = actuator_compensation.KnownRotorLimits(base=actuator_compensation.NoCompensation(), limits=(mixer,))
    (found,) = of.effective_command(of.init(given), given)
    np.testing.assert_allclose(found.u, [acts], rtol=1e-9)
    np.testing.assert_allclose(found.tau, given[0].tau, atol=1e-12)
    assert found.tau_r is given[0].tau_r


@pytest.mark.parametrize("lag", [None, {"bandwidth_Hz": 20.0}])
def test_a_scenario_with_rotors_has_known_limits(lag):
    settings = python_api.load_scenario("paper", {"actuators": MOTORS, "nominal.actuators": lag})
    setup = experiment.make_experiment(settings, "C1")
    found, (true,) = setup.controller.actuator_compensator, setup.world.actuators.limits
    assert isinstance(found, actuator_compensation.KnownRotorLimits)
    assert isinstance(found.base, actuator_compensation.LagInversion) == (lag is not None)
    np.testing.assert_array_equal(found.limits[0].force_max, true.force_max)
    ideal = experiment.make_experiment(python_api.load_scenario("paper"), "C1").controller
    assert isinstance(ideal.actuator_compensator, actuator_compensation.NoCompensation)


@pytest.mark.long
def test_a_team_with_rotors_flies_on_after_a_loss_of_thrust():
    """One vehicle keeps 44 % of its effectiveness, 90 % of its need. Without the estimate the team is lost."""
    losses = [{"kind": "thrust", "who": "agent_1", "to": 0.44, "start_s": 2.0}]
    changes = {"actuators": MOTORS, "nominal.actuators": {"bandwidth_Hz": 20.0}, "faults": losses}
    settings = python_api.load_scenario("trio", changes | {"allocation": {"kind": "constrained"}})
    setup = dataclasses.replace(experiment.make_experiment(settings, "C1"), duration=5.0)
    result = flight.run_experiment(setup)
    assert not result.termination_reason
    np.testing.assert_allclose(result.records.effectiveness[-1], [0.44, 1.0, 1.0], atol=0.05)
    assert np.linalg.norm(result.records.e_p[-1]) < 0.3
    blind = dataclasses.replace(setup.controller, effectiveness_filter=None)
    assert flight.run_experiment(dataclasses.replace(setup, controller=blind)).termination_reason
