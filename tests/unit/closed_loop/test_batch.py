"""Flights in the lanes of a vector: equal to single flights, and independent of the other flights of their group."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

import colift
from colift import codegen
from colift.analysis import metrics
from colift.closed_loop import batch, flight
from colift.closed_loop.flight import Experiment, FlightResult
from colift.codegen import build
from colift.scenario import experiment
from tests.support import small_team
from tests.support.paper_flights import paper_experiment, with_world

SEEDS = range(build.lanes() + 1)  # more than one group


def experiments(case: str, **changes: object) -> list[Experiment]:
    """Return experiments with other seeds and scaled disturbances."""
    made = experiment.make_experiment(small_team.settings(), case)
    scaled = (with_world(made, disturbance_scale=jnp.asarray(1 + 0.1 * seed)) for seed in SEEDS)
    return [dataclasses.replace(one, seed=seed, **changes) for seed, one in zip(SEEDS, scaled, strict=True)]


def together(given: list[Experiment]) -> list[FlightResult]:
    """Return the flights of a batch in the order of their experiments."""
    found = dict(batch.run_batch(given))
    return [found[k] for k in range(len(given))]


def difference(first: FlightResult, second: FlightResult) -> float:
    """Return the largest difference of the records of two flights."""
    pairs = zip(jax.tree.leaves(first.records), jax.tree.leaves(second.records), strict=True)
    return max(float(np.abs(np.asarray(a, float) - np.asarray(b, float)).max(initial=0.0)) for a, b in pairs)


def test_flights_equal_single_flights_with_frozen_models():
    """Without fits the difference is rounding; updates at two times keep the hyperparameters."""
    given = experiments("C3", duration=1.6, update_times=(0.7, 1.1), fit_options=None)
    for one, found in zip(given[:3], together(given), strict=False):
        single = flight.run_experiment(one)
        assert [update.t for update in found.updates] == pytest.approx([0.7, 1.1])
        assert np.abs(found.records.f_L_hat).max() > 0.01
        assert difference(found, single) < 1e-12 * 100  # forces are below 100 N
        np.testing.assert_allclose(found.uncertainty.payload_radius, single.uncertainty.payload_radius, rtol=1e-9)


def test_metrics_after_fits_equal_those_of_single_flights():
    given = experiments("C3", duration=1.6, update_times=(0.7, 1.1))[:2]
    for one, found in zip(given, together(given), strict=True):
        single = flight.run_experiment(one)
        both = [metrics.summary(each, one.world.team, one.controller.team) for each in (found, single)]
        for name in ("e_p_rms_m", "e_R_rms", "lam_max_N", "sigma_L_force_mean_N"):
            assert both[0][name] == pytest.approx(both[1][name], rel=1e-2)


def test_a_flight_does_not_depend_on_its_group():
    """Another group, another lane and fewer flights give the same bits, also after a flight that ends early."""
    given = experiments("C3", duration=0.9, update_times=(0.7,))
    limits = dataclasses.replace(given[0].termination_limits, max_distance=jnp.asarray(1e-3))
    given[0] = dataclasses.replace(given[0], termination_limits=limits)
    all_of_them, alone = together(given), together(given[1:2])
    assert all_of_them[0].termination_reason
    assert len(all_of_them[0].records.t) < len(alone[0].records.t)
    assert difference(all_of_them[1], alone[0]) == 0
    assert difference(together(given[2:0:-1])[1], alone[0]) == 0


def test_experiments_of_several_structures_keep_their_order():
    longer = dataclasses.replace(paper_experiment("C1"), duration=0.02)
    short = [dataclasses.replace(one, duration=0.1) for one in experiments("C1")[:2]]
    seen: list[float] = []
    found = dict(batch.run_batch([short[0], longer, short[1]], seen.append))
    assert [found[k].records.r.shape[1] for k in range(3)] == [0, found[1].records.r.shape[1], 0]
    assert difference(found[2], together([short[1]])[0]) == 0
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(0.22)


def test_flights_without_native_code_are_simulated_singly(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(codegen, "read_arguments", lambda *_arguments: None)
    batch.simulator._compiled_batch.cache_clear()
    given = [dataclasses.replace(one, duration=0.1) for one in experiments("C1")[:2]]
    for found, one in zip(together(given), given, strict=True):
        assert difference(found, flight.run_experiment(one)) == 0
    batch.simulator._compiled_batch.cache_clear()


def test_results_keep_models_without_factors():
    """The arrays that a result holds are a tenth of those of its model, and its model is that of the last update."""
    (one,) = experiments("C3", duration=0.9, update_times=(0.7,))[:1]
    models = []
    single = flight.run_experiment(one, on_model=models.append)
    (found,) = together([one])
    assert isinstance(found.interval, flight.CompactInterval)
    for result in (single, found):
        kept = sum(leaf.nbytes for leaf in result.interval.compact_model.arrays if leaf is not None)
        assert kept < 0.1 * sum(leaf.nbytes for leaf in jax.tree.leaves(result.model))
    for restored, original in ((single.model, models[-1].model), (single.bands, models[-1].bands)):
        assert jax.tree.structure(restored) == jax.tree.structure(original)
        assert all(map(np.array_equal, jax.tree.leaves(restored), jax.tree.leaves(original)))


def test_python_api_returns_flights_in_order():
    scenario = small_team.settings()
    given = [
        dataclasses.replace(colift.make_experiment(scenario.model_copy(update={"seed": seed}), "C1"), duration=0.1)
        for seed in (3, 4)
    ]
    found = colift.run_batch(given)
    assert [each.experiment.seed for each in found] == [3, 4]
    assert difference(found[1], colift.run_experiment(given[1])) < 1e-10
