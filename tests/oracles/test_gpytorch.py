"""Tests of the GP core against GPyTorch in exact mode; they run if the extra `peers` is installed."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.optimize import minimize

from colift import gp
from tests.support.gp_problems import EPS, gram, problem

pytest.importorskip("gpytorch", reason="GPyTorch is a peer, not a requirement", exc_type=ImportError)

import gpytorch_exact


@pytest.mark.parametrize("N", [40, 900])  # above 800 its default would be approximate
@pytest.mark.parametrize("seed", [0, 1])
def test_posterior_and_likelihood(seed, N):
    X, Y, hyper, queries = problem(seed, N=N)
    p = gp.condition(X, Y, hyper)
    with gpytorch_exact.exact():
        model = gpytorch_exact.Model(X, Y).set(hyper)
        log_likelihood = model.log_likelihood().detach().numpy()
        mu, var = model.query(queries)
    cond = np.array([np.linalg.cond(gram(X, hyper, i)) for i in range(3)])
    bound = np.where(cond <= 1e6, 1e-9, 100 * EPS * cond)
    assert (np.abs(np.asarray(jax.vmap(gp.mean, (None, 0))(p, queries)) - mu) <= bound * Y.std(0)).all()
    # GPyTorch computes squared distances by a product, with an error of eps |x / l|^2 in its variance.
    loss = EPS * ((X[:, None] / np.asarray(hyper.lengthscales)) ** 2).sum(-1).max(0)
    signal, ours = np.asarray(hyper.signal_variance), np.asarray(jax.vmap(gp.variance, (None, 0))(p, queries))
    assert (np.abs(ours - var) <= 10 * bound * ours + 100 * loss * signal).all()
    assert (np.abs(gp.log_likelihood(p) - log_likelihood) <= 1e-8 * N + N * loss * cond).all()


@pytest.mark.parametrize("seed", [0, 1])
def test_optimum_at_equal_budget(seed):
    """GPyTorch's likelihood and automatic gradient with the same optimizer, bounds, start and tolerance."""
    X, Y, _, _ = problem(seed, N=60)
    X, Y = (X - X.mean(0)) / X.std(0), (Y - Y.mean(0)) / Y.std(0)
    found = gp.fit(X, Y, restarts=0, constant_mean=np.zeros(3))
    box = gp.HyperparameterBounds()
    bounds = np.log([box.signal_variance, *[box.lengthscale] * 4, box.noise_variance])
    start = np.log([1.0, *[2.0] * 4, 0.1])
    for i in range(3):
        model = gpytorch_exact.Model(X, Y[:, i : i + 1])

        def negative(theta, model=model):
            s, ls, v = np.exp(theta[0]), np.exp(theta[1:-1]), np.exp(theta[-1])
            with gpytorch_exact.exact():
                value, gradient = model.set(gp.make_hyperparameters(s, ls, v)).log_likelihood_and_gradient()
            return -value[0], -gradient[0]

        options = {"maxiter": 100, "ftol": 1e-8, "gtol": 1e-4}
        peer = minimize(negative, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        assert found.log_likelihood[i] >= -peer.fun - 0.05


def test_append_equals_gpytorch_fantasy_model():
    X, Y, hyper, queries = problem(2, N=50)
    p, _ = gp.append(gp.condition(X[:-1], Y[:-1], hyper, 60), jnp.asarray(X[-1]), jnp.asarray(Y[-1]))
    with gpytorch_exact.exact():
        model = gpytorch_exact.Model(X[:-1], Y[:-1]).set(hyper)
        model.query(queries)
        mu, _ = model.appended(X[-1], Y[-1]).query(queries)
    assert (np.abs(np.asarray(jax.vmap(gp.mean, (None, 0))(p, queries)) - mu) <= 1e-8 * Y.std(0)).all()
