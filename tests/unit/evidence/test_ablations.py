"""Tests of the variants that ablations compare."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import scenario
from colift.models.state import zero_residual
from colift.onboard.learning.residual_correction import ResidualObservation
from colift.scenario import experiment
from evidence import replay, update_ablation

TICKS = 20


@pytest.fixture(scope="module")
def plan():
    return experiment.make_experiment(scenario.load_scenario("paper"), "adaptive")


def observations(plan):
    """Labels that change with time, a prediction of one newton, and a new model in the middle."""
    team = plan.controller.team
    zero = zero_residual(team)
    one = jax.tree.map(jnp.ones_like, zero)
    each = [
        ResidualObservation(
            label=jax.tree.map(lambda x, k=k: x + 2 + 0.1 * np.sin(k), zero),
            prediction=jax.tree.map(lambda x, k=k: x + 1.0 + float(k >= TICKS // 2), zero),
            update_index=jnp.array(k // (TICKS // 2)),
            label_valid=one,
            interval=jax.tree.map(lambda x: plan.dt * x, one),
        )
        for k in range(TICKS)
    ]
    return jax.tree.map(lambda *x: jnp.stack(x), *each)


def test_each_rule_of_the_corrector_has_an_effect(plan):
    given = plan.controller.residual_corrector
    corrections = {
        name: replay.replay(make(given), plan, observations(plan)) for name, make in replay.CORRECTORS.items()
    }
    assert not np.any(corrections["without rate"].rate.payload.F)
    expected = np.asarray(corrections["filter"].error.payload.F)
    for name in ("without model", "without bumpless transfer", "white label noise", "half the deviations"):
        assert not np.allclose(corrections[name].error.payload.F, expected), name


@pytest.mark.parametrize("name", update_ablation.PATCHES)
def test_a_change_of_the_updates_is_undone(name):
    detect = update_ablation.change_detection.detect_changes
    with update_ablation.PATCHES[name]():
        replaced = update_ablation.change_detection.detect_changes is not detect
    assert replaced == (name == "without change points")
    assert update_ablation.change_detection.detect_changes is detect


def test_each_variant_is_defined():
    names = [name for group in update_ablation.VARIANTS.values() for name in group]
    assert sorted(names) == sorted([*update_ablation.PATCHES, *update_ablation.PLANS])


def test_without_physical_effects_constants_keep_their_prior(plan):
    before = plan.online_updates.mean_prior
    after = update_ablation.without_physical_effects(plan).online_updates.mean_prior
    np.testing.assert_array_equal(after.payload[8:], before.payload[8:])
    np.testing.assert_allclose(after.payload[:8], update_ablation.SMALL * before.payload[:8])
    np.testing.assert_array_equal(after.agents[2:], before.agents[2:])
