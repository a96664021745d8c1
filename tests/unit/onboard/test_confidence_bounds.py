"""Tests of confidence bands: they hold for functions of known norm and equal their formulas."""

from __future__ import annotations

import dataclasses
import math

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colift import gp
from colift.gp.error_bounds import BoundAssumption
from colift.onboard.learning import confidence_bounds, residual_model
from colift.onboard.learning.features import payload_features

OUTPUTS, CAPACITY, INPUTS = 6, 24, 20
VARIANCE, NOISE = 0.49, 1e-4
X_TEST = np.random.default_rng(1).uniform(-2, 2, (200, INPUTS))
along = jax.jit(jax.vmap(confidence_bounds.error_radius, in_axes=(None, None, None, 0)))
means = jax.jit(jax.vmap(gp.mean, in_axes=(None, 0)))


def hyper(outputs: int = OUTPUTS, dimensions: int = INPUTS) -> gp.Hyperparameters:
    return gp.make_hyperparameters(np.full(outputs, VARIANCE), np.full(dimensions, 3.0), np.full(outputs, NOISE))


def drawn(rng: np.random.Generator, norm: float) -> gp.GPPosterior:
    """A function of known norm, as a posterior mean."""
    h, centers = hyper(), rng.uniform(-2, 2, (15, INPUTS))
    weights = rng.normal(size=(OUTPUTS, 15))
    scale = norm / np.asarray(gp.rkhs_norm(gp.from_expansion(h, centers, weights)))
    return gp.from_expansion(h, centers, weights * scale[:, None])


def labelled(
    rng: np.random.Generator, norm: float, eps: np.ndarray, n: int = CAPACITY
) -> tuple[gp.GPPosterior, gp.GPPosterior]:
    """A function, and the posterior for labels with errors of plus or minus eps."""
    f, X = drawn(rng, norm), rng.uniform(-2, 2, (n, INPUTS))
    Y = np.asarray(means(f, jnp.asarray(X))) + eps * rng.choice([-1.0, 1.0], (n, OUTPUTS))
    return f, gp.condition(X, Y, hyper(), CAPACITY)


def stated(
    bound: str = "energy", norm: float = 2.0, eps: float = 0.1, **other: object
) -> confidence_bounds.BoundAssumptions:
    options = {"bound": bound, "confidence": 0.95, "rkhs_norm": norm, "payload": np.full(6, eps)}
    return confidence_bounds.BoundAssumptions(**(options | {"agents": (np.full((2, 9), eps),)} | other))


def model_with(payload: gp.GPPosterior, seed: int = 0, n: int = 10) -> residual_model.ResidualModel:
    """Return a residual model with that payload model, and a group of two agents whose labels are noise."""
    rng = np.random.default_rng(seed)
    agents = [gp.condition(rng.normal(size=(n, 24)), rng.normal(size=(n, 9)), hyper(9, 24), CAPACITY) for _ in range(2)]
    return residual_model.ResidualModel(
        payload=payload, agents=(jax.tree.map(lambda *x: jnp.stack(x), *agents),), inertial_parameters=jnp.zeros(10)
    )


# Validity -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("bound", confidence_bounds.ONLINE_BOUNDS)
def test_model_error_is_within_the_bound(bound):
    """Noise at its assumed limit; the model's own noise variance is much too small."""
    closest = 0.0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        norm, eps = rng.uniform(0.5, 4), rng.uniform(0.02, 0.5, OUTPUTS)
        f, model = labelled(rng, norm, eps)
        other = confidence_bounds.bound_posterior(model, bound, norm, eps)
        beta = confidence_bounds.confidence_factor(other, bound, norm, eps, 0.95)
        radius = along(model, other, beta, jnp.asarray(X_TEST))
        error = np.abs(means(f, jnp.asarray(X_TEST)) - means(model, jnp.asarray(X_TEST)))
        assert (error <= radius).all()
        closest = max(closest, float((error / radius).max()))
    assert closest > {"energy": 0.3, "srinivas": 1e-4}.get(bound, 0.08)  # the errors have the magnitude of the bound


def test_too_small_norm_or_label_error_is_detected():
    """The test above can fail: with a third of the norm and a tenth of the label error no bound holds."""
    wrong = 0
    for seed in range(12):
        rng = np.random.default_rng(seed)
        eps = np.full(OUTPUTS, 0.2)
        f, model = labelled(rng, 3.0, eps)
        other = confidence_bounds.bound_posterior(model, "energy", 1.0, eps / 10)
        beta = confidence_bounds.confidence_factor(other, "energy", 1.0, eps / 10, 0.95)
        radius = along(model, other, beta, jnp.asarray(X_TEST))
        error = np.abs(means(f, jnp.asarray(X_TEST)) - means(model, jnp.asarray(X_TEST)))
        wrong += int((np.isinf(radius) | (error > radius)).any(0).sum())
    assert wrong > 12


def test_companion_posterior_is_tighter():
    """The companion posterior gives a tighter bound than the model with fitted noise."""
    rng = np.random.default_rng(5)
    eps = np.full(OUTPUTS, 0.2)
    _, model = labelled(rng, 2.0, eps)
    x = jnp.asarray(X_TEST)
    other = confidence_bounds.bound_posterior(model, "energy", 2.0, eps)
    tight = along(model, other, confidence_bounds.confidence_factor(other, "energy", 2.0, eps, 0.95), x)
    plain = along(model, model, confidence_bounds.confidence_factor(model, "energy", 2.0, eps, 0.95), x)
    assert np.median(tight) < 0.5 * np.median(plain)


# Formulas -------------------------------------------------------------------------------------------------------------


def posterior(model: gp.GPPosterior, i: int, v: float, x: np.ndarray) -> tuple[float, float, np.ndarray, np.ndarray]:
    """Return mean and standard deviation at x of output i with another noise variance, its Gram matrix and labels."""
    n = int(model.num_points)
    X, y = np.asarray(model.X)[:n] / 3.0, np.asarray(model.Y)[:n, i]
    k = lambda a, b: VARIANCE * np.exp(-0.5 * ((a[:, None] - b[None]) ** 2).sum(-1))  # noqa: E731
    K, k_x = k(X, X), k(X, x[None] / 3.0)[:, 0]
    solved = np.linalg.solve(K + v * np.eye(n), np.stack([y, k_x], axis=1))
    return k_x @ solved[:, 0], math.sqrt(VARIANCE - k_x @ solved[:, 1]), K, y


def test_energy_bound_equals_its_equation():
    """At the noise variance that balances norm and label error."""
    rng = np.random.default_rng(2)
    eps = rng.uniform(0.1, 0.4, OUTPUTS)
    _, model = labelled(rng, 2.0, eps, n=17)
    held = confidence_bounds.confidence_bands(model_with(model), stated(payload=eps), 3)
    radius = along(model, held.bound_posterior.payload, held.payload_beta, jnp.asarray(X_TEST[:5]))
    for i, k in np.ndindex(OUTPUTS, 5):
        v = 17 * eps[i] ** 2 / 2.0**2
        mean, deviation, K, y = posterior(model, i, v, X_TEST[k])
        beta = math.sqrt(2.0**2 + 17 * eps[i] ** 2 / v - y @ np.linalg.solve(K + v * np.eye(17), y))
        flown, _, _, _ = posterior(model, i, NOISE, X_TEST[k])
        assert float(held.payload_beta[i]) == pytest.approx(beta, rel=1e-9)
        assert beta <= math.sqrt(2) * 2.0
        assert float(radius[k, i]) == pytest.approx(abs(flown - mean) + beta * deviation, rel=1e-8)


@pytest.mark.parametrize("k", [1, 2, 5])
def test_confidence_is_split_by_update_body_and_output(k):
    """Each update, body and output has its share of the confidence."""
    rng = np.random.default_rng(3)
    _, model = labelled(rng, 2.0, np.full(OUTPUTS, 0.1), n=15)
    full = model_with(model)
    held = confidence_bounds.confidence_bands(full, stated("abbasi_yadkori"), k)

    def beta(K: np.ndarray, outputs: int) -> float:
        failure = 0.05 * 6 / (math.pi * k) ** 2 / (3 * outputs)  # three bodies
        _, log_det = np.linalg.slogdet(np.eye(len(K)) + K / 0.1**2)
        return 2.0 + 0.1 * math.sqrt((2 * math.log(1 / failure) + log_det) / 0.1**2)

    _, _, K, _ = posterior(model, 0, 0.1**2, X_TEST[0])
    np.testing.assert_allclose(held.payload_beta, beta(K, 6), rtol=1e-9)
    for j in range(2):
        one = jax.tree.map(lambda x, j=j: x[j], full.agents[0])
        _, _, K, _ = posterior(one, 0, 0.1**2, np.zeros(24))
        np.testing.assert_allclose(held.agent_beta[0][j], beta(K, 9), rtol=1e-9)


@given(norm=st.floats(0.1, 10), k=st.integers(1, 4), bound=st.sampled_from(confidence_bounds.ONLINE_BOUNDS))
@settings(max_examples=15)
def test_beta_without_data_is_the_norm(norm, k, bound):
    empty = gp.prior(hyper(), CAPACITY)
    held = confidence_bounds.confidence_bands(model_with(empty), stated(bound, norm=norm), k)
    np.testing.assert_array_equal(held.payload_beta, norm)
    radius = confidence_bounds.error_radius(empty, held.bound_posterior.payload, held.payload_beta, jnp.zeros(INPUTS))
    np.testing.assert_allclose(radius, norm * math.sqrt(VARIANCE), rtol=1e-12)


def test_model_with_data_needs_an_update_index():
    """A model with data belongs to an update; one without data needs none."""
    _, model = labelled(np.random.default_rng(0), 2.0, np.full(OUTPUTS, 0.1))
    with pytest.raises(ValueError, match="k = 0: must be at least 1"):
        confidence_bounds.confidence_bands(model_with(model), stated(), 0)
    empty = model_with(gp.prior(hyper(), CAPACITY))
    none = gp.prior(hyper(9, 24), CAPACITY)
    bare = dataclasses.replace(empty, agents=(jax.tree.map(lambda x: jnp.stack([x, x]), none),))
    held = confidence_bounds.confidence_bands(bare, stated(), 0)
    np.testing.assert_array_equal(held.agent_beta[0], np.full((2, 9), 2.0))
    assert held.bound_posterior.agents[0] is bare.agents[0]


def test_bounds_along_a_path_equal_single_bounds():
    rng = np.random.default_rng(4)
    _, model = labelled(rng, 2.0, np.full(OUTPUTS, 0.1))
    full = model_with(model)
    held = confidence_bounds.confidence_bands(full, stated(norm=9.0, eps=1.5), 1)
    x = rng.normal(size=(3, 24))
    together = confidence_bounds.payload_radius(full, held, jnp.asarray(x))
    features = payload_features(jnp.asarray(x))
    each = [
        confidence_bounds.error_radius(model, held.bound_posterior.payload, held.payload_beta, features[k])
        for k in range(3)
    ]
    np.testing.assert_allclose(together, each, rtol=1e-12)
    path = rng.normal(size=(3, 2, 24))
    group = confidence_bounds.agent_radius(
        full.agents[0], held.bound_posterior.agents[0], held.agent_beta[0], jnp.asarray(path)
    )
    for t, j in np.ndindex(3, 2):
        one, other = (jax.tree.map(lambda x, j=j: x[j], g) for g in (full.agents[0], held.bound_posterior.agents[0]))
        np.testing.assert_allclose(
            group[t, j], confidence_bounds.error_radius(one, other, held.agent_beta[0][j], jnp.asarray(path[t, j]))
        )


# Assumptions ----------------------------------------------------------------------------------------------------------


def test_contradictory_data_have_no_bound():
    rng = np.random.default_rng(6)
    X = rng.uniform(-2, 2, (20, INPUTS))
    model = gp.condition(X, rng.choice([-3.0, 3.0], (20, OUTPUTS)), hyper(), CAPACITY)
    held = confidence_bounds.confidence_bands(model_with(model), stated(norm=0.5, eps=0.01), 1)
    assert np.isinf(held.payload_beta).all()
    at_data = confidence_bounds.error_radius(model, held.bound_posterior.payload, held.payload_beta, jnp.asarray(X[0]))
    assert np.isinf(at_data).all()  # not NaN, also for a vanishing standard deviation


def test_unsatisfied_assumptions_are_named():
    assert stated().assumed == ("rkhs norm", "bounded noise energy")
    assert stated(satisfied=frozenset({BoundAssumption.RKHS_NORM, BoundAssumption.BOUNDED_NOISE})).assumed == ()
    rig = frozenset(
        {
            BoundAssumption.BOUNDED_NOISE,
            BoundAssumption.ZERO_MEAN,
            BoundAssumption.PREDICTABLE_INPUTS,
            BoundAssumption.FIXED_HYPERPARAMETERS,
        }
    )
    assert stated("abbasi_yadkori", satisfied=rig).assumed == ("rkhs norm",)
    assert stated("srinivas", satisfied=rig).assumed == ("rkhs norm", "noise within std")


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ({"bound": "chernoff"}, "bound = 'chernoff': must be one of energy"),
        ({"rkhs_norm": 0.0}, "rkhs_norm = 0.0: must be positive"),
        ({"payload": np.array([0.1] * 5 + [0.0])}, "payload"),
        ({"agents": (np.full((2, 9), np.nan),)}, r"agents\[0\]"),
    ],
)
def test_invalid_bound_arguments_are_refused(wrong, says):
    with pytest.raises(ValueError, match=says):
        dataclasses.replace(stated(), **wrong)
