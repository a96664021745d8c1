"""Tests of the held-out trajectories and of simulations on them with a frozen model."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import flight
from colift.scenario import Scenario, ScenarioError, experiment, trajectories
from colift.scenario.schema import Lissajous
from colift.workflows import generalization
from tests.support import small_team as light


def test_heldout_paths_are_reversed_scaled_and_shifted():
    settings = light.settings()
    own = trajectories.make_reference(settings)
    other = {
        name: trajectories.make_reference(heldout)
        for name, heldout in generalization.held_out_scenarios(settings).items()
    }
    assert list(other) == list(generalization.TRAJECTORY_VARIANTS)
    lissajous = settings.reference
    assert isinstance(lissajous, Lissajous)
    center, amplitude, period, phase = map(
        np.array, (lissajous.center_m, lissajous.amplitude_m, lissajous.period_s, lissajous.phase_deg)
    )
    for t in lissajous.ramp_time_s + np.linspace(0, 7, 23):
        at = own.evaluate(jnp.asarray(t))
        found = {name: each.evaluate(jnp.asarray(t)) for name, each in other.items()}
        back = center + amplitude * np.sin(-2 * np.pi * t / period + np.deg2rad(phase))
        np.testing.assert_allclose(found["backwards"].p, back, atol=1e-9)
        np.testing.assert_allclose(found["larger"].p - center, 1.2 * (at.p - center), atol=1e-12)
        np.testing.assert_allclose(found["moved"].p, at.p + np.array([0.3, 0, 0]), atol=1e-12)


def test_other_reference_kinds_are_refused():
    poses = [{"time_s": 0.0, "position_m": [0.0, 0.0, 1.0]}, {"time_s": 4.0, "position_m": [1.0, 0.0, 1.0]}]
    data = light.settings().model_dump() | {"reference": {"kind": "waypoints", "poses": poses}}
    with pytest.raises(ScenarioError, match=r"reference\.kind = waypoints: .* lissajous"):
        generalization.held_out_scenarios(Scenario.model_validate(data))


@pytest.mark.long
def test_frozen_model_is_used_without_updates():
    settings = light.settings()
    first_experiment = experiment.make_experiment(settings, "C3")
    first = flight.run_experiment(first_experiment)
    heldout = generalization.freeze_model(
        generalization.held_out_experiments(settings, ("C3",))["moved"]["C3"], first.model
    )
    second = flight.run_experiment(heldout)
    assert not second.updates
    assert not second.termination_reason
    pairs = zip(jax.tree.leaves(second.model), jax.tree.leaves(first.model), strict=True)
    assert all(np.array_equal(a, b) for a, b in pairs)
    error = np.abs(second.records.f_L_hat).max()
    assert error > 0, "the frozen model predicts from the first step"
    assert np.abs(first.records.f_L_hat[:2]).max() == 0
