"""Tests of the tube: gradient bounds against functions that norm and data allow, and the inequality in time."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colift import gp
from colift.certification import reachability, tube
from colift.onboard.learning import confidence_bounds, features

seeds = st.integers(0, 2**31)
means = jax.jit(jax.vmap(gp.mean, (None, 0)))


# Features of the models -----------------------------------------------------------------------------------------------


@given(seeds)
@settings(max_examples=10)
def test_payload_features_change_by_their_derivative(seed):
    """The features of the payload's models change with the state as their derivative states."""
    rng = np.random.default_rng(seed)
    x, L = rng.normal(size=(3, 18)), rng.normal(size=(3, 18, 2, 4))
    found = tube.feature_jacobian(x, L)
    assert found.shape == (3, 20, 2, 4)
    for t in range(3):
        J = jax.jacfwd(features.payload_features)(jnp.asarray(x[t]))
        np.testing.assert_allclose(found[t], np.einsum("fd,dki->fki", J, L[t]), atol=1e-9)


def test_features_at_zero_speed_have_zero_gradient():
    assert (tube.feature_jacobian(np.zeros((1, 18)), np.ones((1, 18, 1, 1)))[0, 18:] == 0).all()


# Gradients of the residual --------------------------------------------------------------------------------------------


def body(seed: int) -> tuple[reachability.BodyModel, gp.GPPosterior, np.random.Generator]:
    """Functions of the stated norm with label errors eps; the model's noise variance is not that of the companion."""
    rng = np.random.default_rng(seed)
    outputs, dimensions, n = 3, 4, 10
    s = rng.uniform(0.2, 3, outputs)
    hyper = gp.make_hyperparameters(s, rng.uniform(0.7, 2, (outputs, dimensions)), rng.choice([1e-4, 0.3]) * s)
    centers, X = rng.uniform(-2, 2, (8, dimensions)), rng.uniform(-2, 2, (n, dimensions))
    norm, eps, w = rng.uniform(0.5, 3), rng.uniform(0.02, 0.2, outputs) * s**0.5, rng.normal(size=(outputs, 8))
    f = gp.from_expansion(
        hyper, centers, w * (norm / np.asarray(gp.rkhs_norm(gp.from_expansion(hyper, centers, w))))[:, None], n
    )
    Y = np.asarray(means(f, jnp.asarray(X))) + eps * rng.choice([-1.0, 1.0], (n, outputs))
    model = gp.condition(X, Y, hyper, n)
    companion = confidence_bounds.bound_posterior(model, "energy", norm, eps)
    beta = np.asarray(confidence_bounds.confidence_factor(companion, "energy", norm, eps, 0.95))
    return reachability.BodyModel(slice(0, outputs), model, companion, beta, norm, eps, X), f, rng


def displacement_covariances(rng: np.random.Generator, times: int) -> np.ndarray:
    """Covariances of displacements, some singular."""
    A = rng.normal(size=(times, 4, 4)) * rng.choice([0.0, 1.0], (times, 1, 4), p=[0.3, 0.7])
    return A @ np.swapaxes(A, 1, 2)


@given(seeds)
@settings(max_examples=10)
def test_residual_gradients_stay_within_their_bound(seed):
    """Gradients of the residual stay within their bound in every direction."""
    of, f, rng = body(seed)
    x, d = rng.uniform(-3, 3, (60, 4)), rng.normal(size=(60, 4))
    slope = jax.vmap(jax.jacfwd(gp.mean, argnums=1), (None, 0))
    left = np.asarray(slope(f, jnp.asarray(x)) - slope(of.model, jnp.asarray(x)))
    for i in range(3):
        S, g = tube.gradient_bounds(of, i, x, displacement_covariances(rng, len(x)))
        bound = np.linalg.norm(np.einsum("tfd,td->tf", S, d), axis=1) + np.abs((g * d).sum(1))
        found = np.abs((left[:, i] * d).sum(1))
        assert (found <= bound * (1 + 1e-9)).all()
        assert (found / bound).max() > 0.03  # the samples have the magnitude of the bound


@given(seeds)
@settings(max_examples=10)
def test_ellipsoids_are_no_larger_than_the_energy_bound(seed):
    """Compared with one weight for all labels by the trace, which is minimized."""
    of, _, rng = body(seed)
    path = np.cumsum(rng.normal(size=(9, 4)) * 0.3, axis=0)
    along = reachability.BodyModel(slice(0, 3), of.model, of.bound_posterior, of.beta, of.norm, of.label_error, path)
    L, x = rng.normal(size=(5, 4, 9, 3)), rng.normal(size=(5, 4))
    ((P, _),) = tube.ellipsoids([along], [L])
    for i in range(3):
        K = of.beta[i] ** 2 * reachability.covariance(of.bound_posterior, i, path)
        wide = np.einsum("tfk,kl,tel->tfe", L[..., i], K, L[..., i])
        taken = (np.asarray(of.model.hyper.lengthscales) ** -2.0).mean(0)
        trace, widest = (np.einsum("tff,f->t", each, taken) for each in (P[i], wide))
        assert (trace <= widest * (1 + 1e-6)).all()
    M = displacement_covariances(rng, 5)
    S, _ = tube.gradient_bounds(of, 0, x, M)
    for t in range(5):
        if not (M[t] > 0).any():
            continue
        h = 1e-4
        ends = x[t] + h * np.concatenate([np.eye(4), -np.eye(4)])
        C = reachability.covariance(of.bound_posterior, 0, ends)
        D = np.concatenate([np.eye(4), -np.eye(4)], axis=1) / (2 * h)
        wide = of.beta[0] ** 2 * D @ C @ D.T
        assert np.trace(S[t] @ M[t] @ S[t].T) <= np.trace(wide @ M[t]) * (1 + 1e-4)


def test_gradient_bound_is_attained_without_data():
    """`f = B k'(., x) / |k'|` has the largest gradient of its norm: `B sqrt(signal_variance)` per length-scale."""
    s, norm, ls, h = 1.7, 2.3, np.array([0.8, 1.6]), 1e-3
    hyper = gp.make_hyperparameters(s, ls, 1e-4)
    prior = gp.prior(hyper, 2)
    ends = h * np.array([[1.0, 0.0], [-1.0, 0.0]]) * ls
    f = gp.from_expansion(hyper, ends, [[1.0, -1.0]])
    f = gp.from_expansion(hyper, ends, norm / float(gp.rkhs_norm(f)[0]) * np.array([[1.0, -1.0]]))
    values = np.asarray(means(f, jnp.asarray(ends)))
    of = reachability.BodyModel(slice(0, 1), prior, prior, np.array([norm]), norm, np.array([0.1]), ends)
    slope = float(values[0, 0] - values[1, 0]) / (2 * h)
    S, g = tube.gradient_bounds(of, 0, np.zeros((1, 2)), np.eye(2)[None])
    assert slope == pytest.approx(np.linalg.norm(S[0] @ np.array([ls[0], 0.0])), rel=1e-4)
    assert (g == 0).all()


@given(seeds)
@settings(max_examples=5)
def test_feedback_matrix_is_the_gain_of_single_samples(seed):
    of, _, rng = body(seed)
    x, L = rng.normal(size=(3, 4)), rng.normal(size=(3, 4, 7, 5))
    S, g = tube.gradient_bounds(of, 1, x, displacement_covariances(rng, len(x)))
    expected = np.linalg.norm(np.einsum("tdf,tfkj->tdkj", S, L), axis=1) + np.abs(np.einsum("tf,tfkj->tkj", g, L))
    np.testing.assert_allclose(tube.feedback_matrix(S, g, L), expected, rtol=1e-9)


@given(seeds)
@settings(max_examples=10)
def test_path_residuals_stay_within_the_ellipsoids(seed):
    """In every direction and through every gradient; the bound exceeds that of the largest eigenvalues by at most a
    third.
    """
    of, f, rng = body(seed)
    path = np.cumsum(rng.normal(size=(9, 4)) * 0.3, axis=0)
    along = reachability.BodyModel(slice(0, 3), of.model, of.bound_posterior, of.beta, of.norm, of.label_error, path)
    x, L = rng.normal(size=(5, 4)), rng.normal(size=(5, 4, 9, 3))
    ((P, c),) = tube.ellipsoids([along], [L])
    left = np.asarray(means(f, jnp.asarray(path)) - means(of.model, jnp.asarray(path)))
    moved = np.einsum("tfkj,kj->tf", L, left)
    n = rng.normal(size=(5, 4))
    most = np.abs((n * c).sum(1)) + np.sqrt(np.einsum("tf,jtfe,te->jt", n, P, n)).sum(0)
    assert (np.abs((n * moved).sum(1)) <= most * (1 + 1e-9)).all()
    for i in range(3):
        S, g = tube.gradient_bounds(of, i, x, P.sum(0))
        through = np.linalg.norm(np.einsum("tdf,tf->td", S, moved), axis=1) + np.abs((g * moved).sum(1))
        bound = tube.direct_term(S, g, P, c)
        assert (through <= bound * (1 + 1e-9)).all()
        greatest = np.sqrt(np.linalg.eigvalsh(S @ P @ np.swapaxes(S, 1, 2))[..., -1]).sum(0)
        exact = np.linalg.norm(np.einsum("tdf,tf->td", S, c), axis=1) + np.abs((g * c).sum(1)) + greatest
        exact += np.sqrt(np.einsum("tf,jtfe,te->jt", g, P, g)).sum(0)
        assert (bound >= exact * (1 - 1e-9)).all()
        assert (bound <= 1.34 * exact).all()


def test_deviation_is_bounded_by_weights_and_size():
    """The effect of a difference is at most its size times the absolute weights."""
    rng = np.random.default_rng(0)
    L, d = rng.normal(size=(2, 3, 20, 2)), rng.uniform(size=(20, 2))
    expected = np.abs(L.reshape(2, 3, 40)) @ d.ravel()
    np.testing.assert_allclose(tube.Tube(d, 0.5).deviation(L), expected, rtol=1e-12)


# The inequality in time -----------------------------------------------------------------------------------------------


def causal_gains(rng: np.random.Generator, times: int, size: float) -> tuple[np.ndarray, np.ndarray]:
    """Random gains from intervals to the times at their ends, and bounds."""
    M = (
        size
        * rng.uniform(size=(times, 3, times, 3))
        * (np.arange(times)[:, None] >= np.arange(times))[:, None, :, None]
    )
    return M, rng.uniform(0.1, 1, (times, 3))


@given(seeds, st.floats(0.001, 0.1))
@settings(max_examples=20)
def test_signals_with_bounded_feedback_stay_in_the_tube(seed, size):
    """A signal of any sign that attains the inequality in every interval."""
    rng = np.random.default_rng(seed)
    M, own = causal_gains(rng, 8, size)
    found, _ = tube.solve_tube(M, own)
    d = np.zeros((9, 3))  # at the ends of cells
    for t in range(8):
        between = [np.maximum(d[s], d[s + 1]) for s in range(t)]
        for _ in range(200):
            now = [*between, np.maximum(d[t], d[t + 1])]
            d[t + 1] = own[t] + sum(M[t, :, s] @ now[s] for s in range(t + 1))
        assert (d[t + 1] <= found[t] * (1 + 1e-7)).all()
        np.testing.assert_allclose(found[t], np.maximum(d[t], d[t + 1]), rtol=1e-7)


def test_divergent_feedback_has_no_tube():
    """Divergent feedback has no tube, and the error states so."""
    M, own = causal_gains(np.random.default_rng(0), 8, 5.0)
    with pytest.raises(ValueError, match=r"no tube exists: .* by a factor of \d+"):
        tube.solve_tube(M, own)


@pytest.mark.parametrize("by", [0.99, 1.0, 1.02])
def test_unit_feedback_within_an_interval_has_no_tube(by):
    with pytest.raises(ValueError, match="no tube exists"):
        tube.solve_tube(np.full((1, 1, 1, 1), by), np.ones((1, 1)))
    found, contraction = tube.solve_tube(np.full((1, 1, 1, 1), 0.5), np.ones((1, 1)))
    np.testing.assert_allclose(found, 2.0, rtol=1e-8)
    assert contraction == 0.5
