"""Tests of bounds of linear functionals of the residual against functions that norm and data allow.

Labels have errors of plus or minus eps; every drawn function has the stated norm.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from colift import gp
from colift.certification import reachability
from colift.gp import optimal_recovery
from colift.onboard.learning import confidence_bounds

seeds = st.integers(0, 2**31)
DIMENSIONS, OUTPUTS, DATA, PATH, ROWS, FIRST = 3, 2, 9, 14, 2, 1  # FIRST: the body's first column of the loop's inputs
AT = [3, 5, 7, 9, 11, 13]


def convolution_weights(H: np.ndarray) -> np.ndarray:
    """Return `L[t, row, k] = H[t - k, row]` at `AT`, zero for later samples; (times, rows, path, inputs)."""
    lag = np.asarray(AT)[:, None] - np.arange(PATH)[None]
    L = np.where((lag >= 0)[:, :, None, None], H[np.clip(lag, 0, len(H) - 1)], 0.0)
    return np.swapaxes(L, 1, 2)


# Bounds of a functional -----------------------------------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Problem:
    """A body's residual, its model and the weights of the loop."""

    body: reachability.BodyModel
    f: gp.GPPosterior
    L: np.ndarray  # (times, rows, path, inputs)
    eps: np.ndarray

    def contributions(self, along: np.ndarray) -> np.ndarray:
        """Return each output's contribution `(times, rows, outputs)` for values `along` the path, `(path, outputs)`."""
        return np.stack([self.L[..., FIRST + i] @ along[:, i] for i in range(OUTPUTS)], axis=-1)

    def true(self) -> np.ndarray:
        """Return the effect of the function on the loop's outputs beyond the compensation."""
        x = jnp.asarray(self.body.x)
        return self.contributions(np.asarray(means(self.f, x)) - np.asarray(means(self.body.model, x)))


means = jax.jit(jax.vmap(gp.mean, (None, 0)))


def problem(seed: int, bound: str = "energy", bias: float = 0.0) -> Problem:
    """Random kernels, function, data, path and loop."""
    rng = np.random.default_rng(seed)
    s, offset = rng.uniform(0.2, 3, OUTPUTS), rng.normal(size=OUTPUTS)
    hyper = gp.make_hyperparameters(s, rng.uniform(0.7, 2, (OUTPUTS, DIMENSIONS)), 0.01 * s, offset)
    centers, X = rng.uniform(-2, 2, (7, DIMENSIONS)), rng.uniform(-2, 2, (DATA, DIMENSIONS))
    x = np.cumsum(rng.normal(size=(PATH, DIMENSIONS)) * 0.3, axis=0)
    norm, eps, w = rng.uniform(0.5, 3), rng.uniform(0.02, 0.3, OUTPUTS) * s**0.5, rng.normal(size=(OUTPUTS, 7))
    f = gp.from_expansion(hyper, centers, w)
    f = gp.from_expansion(hyper, centers, w * (norm / np.asarray(gp.rkhs_norm(f)))[:, None], DATA + 2)
    sign = np.where(rng.uniform(size=(DATA, OUTPUTS)) < 0.5 + 0.5 * bias, 1.0, -1.0)
    model = gp.condition(X, np.asarray(means(f, jnp.asarray(X))) + eps * sign, hyper, DATA + 2)
    companion = confidence_bounds.bound_posterior(model, bound, norm, eps)
    beta = np.asarray(confidence_bounds.confidence_factor(companion, bound, norm, eps, 0.95))
    body = reachability.BodyModel(slice(FIRST, FIRST + OUTPUTS), model, companion, beta, norm, eps, x)
    H = np.exp(-0.2 * np.arange(PATH))[:, None, None] * rng.normal(size=(PATH, ROWS, FIRST + OUTPUTS + 1))
    return Problem(body, f, convolution_weights(H), eps)


@given(seeds, st.sampled_from(["energy", "abbasi_yadkori"]), st.sampled_from([0.0, 1.0]))
@settings(max_examples=15)
def test_functional_bound_holds(seed, bound, bias):
    if bound != "energy":
        bias = 0.0  # its noise has no mean
    p = problem(seed, bound, bias)
    upper, lower = reachability.functional_bound(p.body.beta, *reachability.band_bound(p.body, p.L))
    assert upper.shape == (len(AT), ROWS, OUTPUTS)
    true = p.true()
    assert (true <= upper).all()
    assert (-true <= lower).all()


def test_functional_bound_depends_on_norm_and_label_error():
    """With a third of the norm and a tenth of the label error the true value is sometimes outside."""
    outside = 0
    for seed in range(12):
        p = problem(seed)
        norm, eps = p.body.norm / 3, p.eps / 10
        companion = confidence_bounds.bound_posterior(p.body.model, "energy", norm, eps)
        beta = np.asarray(confidence_bounds.confidence_factor(companion, "energy", norm, eps, 0.95))
        wrong = dataclasses.replace(p.body, bound_posterior=companion, beta=np.where(np.isinf(beta), norm, beta))
        upper, lower = reachability.functional_bound(wrong.beta, *reachability.band_bound(wrong, p.L))
        outside += ((p.true() > upper) | (-p.true() > lower)).any()
    assert outside >= 4


@given(seeds)
@settings(max_examples=8)
def test_functional_bound_is_attained(seed):
    """`g = m + beta k_n(., l) / sigma(l)` has `|g|^2 + |Y - g(X)|^2 / v = B^2 + n eps^2 / v`, the largest admissible
    value.
    """
    p = problem(seed)
    moved, sigma = reachability.band_bound(p.body, p.L)
    upper, _ = reachability.functional_bound(p.body.beta, moved, sigma)
    X, Y, h = (
        np.asarray(p.body.bound_posterior.X)[:DATA],
        np.asarray(p.body.bound_posterior.Y)[:DATA],
        p.body.bound_posterior.hyper,
    )
    time, row = 2, 1
    mu = np.asarray(means(p.body.model, jnp.asarray(p.body.x)))
    for i in range(OUTPUTS):
        s, v, ls, offset = (
            np.asarray(a)[i] for a in (h.signal_variance, h.noise_variance, h.lengthscales, h.constant_mean)
        )
        both = np.vstack([X, p.body.x]) / ls
        K = s * np.exp(-0.5 * cdist(both, both, "sqeuclidean"))
        weights = p.L[time, row, :, FIRST + i]
        r, k = Y[:, i] - offset, K[:DATA, DATA:] @ weights
        c = np.linalg.solve(K[:DATA, :DATA] + v * np.eye(DATA), np.column_stack([r, k]))
        size = p.body.beta[i] / sigma[time, row, i]
        of_g = np.concatenate([c[:, 0] - size * c[:, 1], size * weights])
        g = K @ of_g
        spent = of_g @ g + np.sum((r - g[:DATA]) ** 2) / v
        np.testing.assert_allclose(spent, p.body.norm**2 + DATA * p.eps[i] ** 2 / v, rtol=1e-7)
        np.testing.assert_allclose(weights @ (offset + g[DATA:] - mu[:, i]), upper[time, row, i], rtol=1e-6)


def test_contradictory_data_have_no_bound():
    p = problem(3)
    spans = reachability.band_bound(p.body, p.L)
    found = reachability.functional_bound(np.array([np.inf, p.body.beta[1]]), *spans)
    assert np.isinf(found[..., 0]).all()
    assert np.isfinite(found[..., 1]).all()


# Optimal recovery -----------------------------------------------------------------------------------------------------


def recovered(p: Problem) -> tuple[np.ndarray, np.ndarray]:
    """Return the bound, and the bound by optimal recovery."""
    limit = reachability.functional_bound(p.body.beta, *reachability.band_bound(p.body, p.L))
    return limit, reachability.recovery_bound(p.body, p.L, limit)


@given(seeds, st.sampled_from([0.0, 1.0]))
@settings(max_examples=8)
def test_recovery_bound_is_tighter_and_holds(seed, bias):
    p = problem(seed, bias=bias)
    limit, found = recovered(p)
    assert (found <= limit).all()
    true = p.true()
    assert (true <= found[0]).all()
    assert (-true <= found[1]).all()
    assert (found[0] + found[1] < 0.98 * (limit[0] + limit[1])).any()  # it is tighter than the band


def test_recovery_equals_one_program_for_all_samples():
    """One conic program for `sum_k L_k f(x_k)` by `gp.optimal_recovery`, minus the compensation; never below it."""
    p = problem(5)
    limit, found = recovered(p)
    x = p.body.x
    mu = np.asarray(means(p.body.model, jnp.asarray(x)))
    X, Y, hyper = np.asarray(p.body.model.X)[:DATA], np.asarray(p.body.model.Y)[:DATA], p.body.model.hyper
    for a in range(len(AT)):
        for row in range(ROWS):
            for i in range(OUTPUTS):
                weights = p.L[a, row, :, FIRST + i]
                best = optimal_recovery.recovery_interval(X, Y, hyper, i, p.body.norm, float(p.eps[i]), x, weights)
                expected = np.array([best.upper - weights @ mu[:, i], weights @ mu[:, i] - best.lower])
                size = limit[:, a, row, i].sum()
                assert (found[:, a, row, i] >= np.minimum(expected, limit[:, a, row, i]) - 1e-5 * size).all()
                assert (found[:, a, row, i] <= np.minimum(expected, limit[:, a, row, i]) + 0.01 * size).all()


def test_negligible_output_keeps_its_band():
    """An output with a negligible contribution keeps its band."""
    p, bounds = problem(7), []
    p.L[..., FIRST] *= 1e-7
    limit = reachability.functional_bound(p.body.beta, *reachability.band_bound(p.body, p.L))
    found = reachability.recovery_bound(p.body, p.L, limit, lambda: bounds.append(1))
    np.testing.assert_array_equal(found[..., 0], limit[..., 0])
    assert (found[..., 1] < limit[..., 1]).any()
    assert len(bounds) == 1


# Along the path -------------------------------------------------------------------------------------------------------


@given(seeds)
@settings(max_examples=12)
def test_path_maximum_equals_single_samples(seed):
    """A functional of one sample with weight one; the bound holds."""
    p = problem(seed)
    found = reachability.max_error(p.body)
    assert found.shape == (PATH, OUTPUTS)
    single = np.repeat(np.eye(PATH)[:, None, :, None], FIRST + OUTPUTS, axis=3)
    moved, sigma = reachability.band_bound(p.body, single)
    both = reachability.functional_bound(p.body.beta, moved, sigma)[:, :, 0]
    np.testing.assert_allclose(found, both.max(0), rtol=1e-9)
    x = jnp.asarray(p.body.x)
    assert (np.abs(np.asarray(means(p.f, x)) - np.asarray(means(p.body.model, x))) <= found).all()


@pytest.mark.parametrize("output", range(OUTPUTS))
def test_std_of_single_samples_is_the_posterior_std(output):
    p = problem(1)
    x = jnp.asarray(p.body.x)
    variance = np.asarray(jax.vmap(gp.variance, (None, 0))(p.body.bound_posterior, x))[:, output]
    S = reachability.covariance(p.body.bound_posterior, output, p.body.x)
    np.testing.assert_allclose(np.diagonal(S), variance, atol=1e-10)
    assert np.linalg.eigvalsh(S).min() > -1e-10


@pytest.mark.parametrize("output", range(OUTPUTS))
def test_gradient_covariances_equal_kernel_derivatives(output):
    """By automatic differentiation."""
    p = problem(2)
    model, x = p.body.bound_posterior, p.body.x[:4]
    slope = jax.vmap(jax.jacfwd(gp.mean, argnums=1), (None, 0))(model, jnp.asarray(x))
    np.testing.assert_allclose(reachability.gradient(model, output, x), slope[:, output], atol=1e-9)
    ls = np.asarray(model.hyper.lengthscales)[output]
    X = jnp.asarray(np.asarray(model.X)[:DATA])
    k = jax.jacfwd(lambda a: jnp.exp(-0.5 * (((a[None] - X) / ls[None]) ** 2).sum(1)))
    np.testing.assert_allclose(reachability.kernel_gradient(model, output, x), jax.vmap(k)(jnp.asarray(x)), atol=1e-12)


def test_low_rank_squares_and_products_are_upper_bounds():
    """Along a path of many close points, whose covariance has few columns above rounding."""
    rng = np.random.default_rng(3)
    x = np.stack([np.sin(np.linspace(0, 6, 120) + phase) for phase in (0.0, 1.0, 2.5)], axis=1)
    S = 2.0 * np.exp(-0.5 * cdist(x, x, "sqeuclidean"))
    of, L = reachability.low_rank_factor(S), rng.normal(size=(4, 7, 120)) * rng.choice([1e-3, 1.0], size=(4, 7, 1))
    assert of.R.shape[1] < 40
    squares, products = np.sum((L @ S) * L, axis=-1), L @ S @ np.swapaxes(L, 1, 2)
    rounding = 1e-12 * np.abs(L).sum(-1) ** 2
    assert (of.squares(L) >= squares - rounding).all()
    np.testing.assert_allclose(of.squares(L), squares, rtol=1e-6, atol=1e-10)
    assert np.linalg.eigvalsh(of.products(L) - products).min() >= -rounding.max()
    np.testing.assert_allclose(of.products(L), products, rtol=1e-6, atol=1e-7)


def test_truncated_low_rank_factor_is_an_upper_bound(monkeypatch):
    """With columns only until a tenth of the largest variance remains."""
    monkeypatch.setattr(reachability, "RANK_TOLERANCE", 0.1)
    rng = np.random.default_rng(4)
    x = rng.uniform(-3, 3, (60, 2))
    S = np.exp(-0.5 * cdist(x, x, "sqeuclidean"))
    of, L = reachability.low_rank_factor(S), rng.normal(size=(5, 6, 60))
    assert of.R.shape[1] < 40
    squares, products = np.sum((L @ S) * L, axis=-1), L @ S @ np.swapaxes(L, 1, 2)
    assert (of.squares(L) >= squares).all()
    assert (of.squares(L) > 1.01 * squares).any()
    assert np.linalg.eigvalsh(of.products(L) - products).min() >= 0
