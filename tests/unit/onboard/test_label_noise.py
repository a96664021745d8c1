"""Tests of the label noise against simulated readings of a team at rest."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.models.measurement import Measurement
from colift.models.state import ControlClock, zero_residual
from colift.scenario import Scenario, experiment
from tests.support import planar_teams
from tests.support import small_team as light

TICKS, SETTLED = 4000, 500
RNG_SEED = 7


def noisy(rest: Measurement, settings: Scenario, key: jax.Array) -> Measurement:
    """Return readings with the white noise of inertial sensors, velocities and encoders."""
    given, keys = settings.sensors, iter(jax.random.split(key, 16))
    add = lambda x, std: x + std * jax.random.normal(next(keys), x.shape)  # noqa: E731
    stds = {"omega": given.angular_velocity_radps, "a": given.accelerometer_mps2, "v": given.velocity_mps}
    body = lambda m: {name: add(getattr(m, name), std) for name, std in stds.items()}  # noqa: E731
    joints = np.deg2rad(given.joint_position_deg)
    return dataclasses.replace(
        rest,
        payload=dataclasses.replace(rest.payload, **body(rest.payload)),
        agents=tuple(dataclasses.replace(m, r=add(m.r, joints), **body(m)) for m in rest.agents),
    )


@pytest.mark.parametrize("make", [light.settings, pytest.param(planar_teams.bar, marks=pytest.mark.long)])
def test_covariance_is_that_of_simulated_labels(make: Callable[[], Scenario]):
    """Averages `2 s_1 - s_2` of labels without contact forces, of the estimator at rest with closed contacts."""
    settings = make()
    data = settings.model_dump() | {"contact_forces": {"kind": "momentum_observer"}}
    plan = experiment.make_experiment(type(settings).model_validate(data), "C1")
    team, estimator = plan.controller.team, plan.controller.estimator
    rest, clock = plan.world.measure_at_rest(plan.initial_state), ControlClock(t=jnp.zeros(()), dt=jnp.asarray(plan.dt))
    inputs = plan.world.init(plan.initial_state, plan.controller.init(rest, clock)[0]).applied_inputs
    b = 1 - np.exp(-2 * np.pi * settings.learning.label_filter_Hz * plan.dt)

    def step(carry, key):
        state, stages = carry
        _, state = estimator.update(team, state, noisy(rest, settings, key), inputs, zero_residual(team), clock)
        y = [agents.modelled_force for agents in state.agents]
        first = [one + b * (x - one) for x, (one, _) in zip(y, stages, strict=True)]
        second = [two + b * (one - two) for one, (_, two) in zip(first, stages, strict=True)]
        average = [2 * one - two for one, two in zip(first, second, strict=True)]
        return (state, list(zip(first, second, strict=True))), average

    start = [(x := jnp.zeros_like(agents.modelled_force), x) for agents in estimator.init(team, rest).agents]
    keys = jax.random.split(jax.random.key(RNG_SEED), TICKS)
    _, filtered = jax.jit(lambda keys: jax.lax.scan(step, (estimator.init(team, rest), start), keys))(keys)
    for labels, stated in zip(filtered, estimator.contact_forces.noise, strict=True):
        std = np.asarray(labels)[SETTLED:].std(0)
        expected = np.sqrt(np.diagonal(np.asarray(stated), axis1=1, axis2=2))
        np.testing.assert_allclose(expected, std, rtol=0.25, atol=1e-5)
