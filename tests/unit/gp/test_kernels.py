"""Tests of user-defined kernels against scikit-learn, finite differences and their documented properties."""

from __future__ import annotations

import dataclasses
import re

import jax.numpy as jnp
import numpy as np
import pytest
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, Matern, RationalQuadratic, WhiteKernel

from colift import gp
from colift.gp.likelihood import log_marginal_likelihood
from colift.math.pytree import pytree
from tests.support.gp_problems import problem


@pytree
class Matern52(gp.Kernel):
    """Matern kernel with 5/2: `(1 + d + d^2 / 3) exp(-d)`, `d = sqrt(5 r2)`; a root has no slope at zero."""

    def __call__(self, r2):
        d = jnp.sqrt(5 * r2)
        return (1 + d + d * d / 3) * jnp.exp(-d)


@pytree
class HeavyTailed(gp.Kernel):
    """The rational quadratic kernel, `(1 + r2 / (2 a))^-a`."""

    a: jnp.ndarray

    def __call__(self, r2):
        return (1 + r2 / (2 * self.a)) ** -self.a


@pytree
class ScaledKernel(gp.Kernel):
    """Kernel with the value `by` at zero; a correlation requires 1."""

    by: float

    def __call__(self, r2):
        return self.by * jnp.exp(-r2)


OWN = {
    "Matern": (Matern52(), Matern(nu=2.5)),
    "rational quadratic": (HeavyTailed(a=jnp.array(0.7)), RationalQuadratic(alpha=0.7)),
}


def scikit_learn_gp(hyper: gp.Hyperparameters, i: int, theirs: object) -> GaussianProcessRegressor:
    """Return scikit-learn's GP on inputs in units of the length-scales."""
    kernel = ConstantKernel(float(hyper.signal_variance[i])) * theirs + WhiteKernel(float(hyper.noise_variance[i]))
    return GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None)


@pytest.mark.parametrize("name", OWN)
def test_mean_and_std_equal_scikit_learn(name):
    ours, theirs = OWN[name]
    X, Y, hyper, queries = problem(3)
    hyper = dataclasses.replace(hyper, kernel=ours)
    model = gp.condition(X, Y, hyper, capacity=60)
    mu, variance = gp.predict(model, queries)
    for i in range(Y.shape[1]):
        ls = np.asarray(hyper.lengthscales[i])
        fitted = scikit_learn_gp(hyper, i, theirs).fit(X / ls, Y[:, i] - float(hyper.constant_mean[i]))
        mean, deviation = fitted.predict(np.asarray(queries) / ls, return_std=True)
        scale = float(hyper.signal_variance[i]) ** 0.5
        np.testing.assert_allclose(mu[:, i] - hyper.constant_mean[i], mean, atol=1e-8 * scale)
        noise = float(hyper.noise_variance[i])  # which scikit-learn adds
        np.testing.assert_allclose(variance[:, i], deviation**2 - noise, atol=1e-8 * scale**2)
        np.testing.assert_allclose(gp.mean(model, queries[0])[i], mu[0, i], rtol=1e-12)


@pytest.mark.parametrize("name", OWN)
def test_appended_points_equal_a_batch(name):
    X, Y, hyper, queries = problem(4)
    hyper = dataclasses.replace(hyper, kernel=OWN[name][0])
    grown, whole = gp.condition(X[:20], Y[:20], hyper, capacity=40), gp.condition(X, Y, hyper)
    for x, y in zip(X[20:], Y[20:], strict=True):
        grown, taken = gp.append(grown, jnp.asarray(x), jnp.asarray(y))
        assert taken
    for x in queries:
        np.testing.assert_allclose(gp.mean(grown, x), gp.mean(whole, x), rtol=1e-8)


@pytest.mark.parametrize("name", OWN)
def test_gradient_of_the_likelihood(name):
    rng = np.random.default_rng(0)
    X, R, theta = rng.normal(size=(25, 3)), rng.normal(size=(25, 2)), np.array([0.3, 0.1, -0.4, 0.5, -2.0])
    value, gradient = log_marginal_likelihood(theta, X, R, kernel=OWN[name][0])
    for k in range(len(theta)):
        step = 1e-5 * np.eye(len(theta))[k]
        points = [log_marginal_likelihood(theta + j * step, X, R, kernel=OWN[name][0])[0] for j in (-2, -1, 1, 2)]
        numeric = (points[0] - 8 * points[1] + 8 * points[2] - points[3]) / 12e-5
        assert abs(gradient[k] - numeric) <= 1e-7 * max(1, abs(value))


def test_fit_uses_the_kernel_of_the_hyperprior():
    """The fit uses the hyperprior's kernel and is at least as good as scikit-learn's."""
    X, Y, hyper, _ = problem(5, N=60, dimensions=2, outputs=1)
    median = dataclasses.replace(hyper, kernel=Matern52())
    fit = gp.fit(
        X, Y, hyperprior=gp.HyperPrior(median, scale_factor=1e3, min_lengthscale=1e-4, max_lengthscale=1e4), restarts=3
    )
    assert type(fit.hyper.kernel) is Matern52
    Z, t = (X - X.mean(0)) / X.std(0), (Y[:, 0] - Y[:, 0].mean()) / Y[:, 0].std()
    kernel = ConstantKernel(1.0) * Matern([1.0, 1.0], nu=2.5) + WhiteKernel(0.01)
    found = GaussianProcessRegressor(kernel, alpha=0.0, n_restarts_optimizer=3, random_state=0).fit(Z, t)
    assert fit.log_likelihood[0] >= found.log_marginal_likelihood_value_ - len(Y) * np.log(Y[:, 0].std()) - 0.05


def test_kernels_of_hyperprior_and_start_must_agree():
    X, Y, hyper, _ = problem(5, outputs=1)
    with pytest.raises(
        ValueError, match=r"kernels of hyperprior \(Matern52\) and start \(SquaredExponential\): must be equal"
    ):
        gp.fit(X, Y, hyperprior=gp.HyperPrior(dataclasses.replace(hyper, kernel=Matern52())), start=hyper)
    one, other = (dataclasses.replace(hyper, kernel=HeavyTailed(a=jnp.array(a))) for a in (1.0, 30.0))
    with pytest.raises(
        ValueError,
        match=re.escape("kernels of hyperprior (HeavyTailed [1.0]) and start (HeavyTailed [30.0]): must be equal"),
    ):
        gp.fit(X, Y, hyperprior=gp.HyperPrior(one), start=other)


def test_optimal_recovery_holds_for_a_function_of_the_kernel():
    """A function of the Matern kernel is in its interval at every point, and its norm is exact."""
    rng = np.random.default_rng(1)
    hyper = gp.make_hyperparameters(1.0, [0.5, 0.5], 0.01, kernel=Matern52())
    Z, X, x = rng.uniform(-1, 1, (6, 2)), rng.uniform(-1, 1, (30, 2)), rng.uniform(-1, 1, (5, 2))
    truth = gp.from_expansion(hyper, Z, rng.normal(size=(1, 6)))
    at = lambda points: np.asarray(gp.predict(truth, jnp.asarray(points))[0])  # noqa: E731
    Y = at(X) + 0.05 * rng.choice([-1.0, 1.0], size=(30, 1))
    for point in x:
        found = gp.optimal_recovery.recovery_interval(X, Y, hyper, 0, float(gp.rkhs_norm(truth)[0]), 0.05, point[None])
        assert found.lower - 1e-9 <= at(point[None])[0, 0] <= found.upper + 1e-9


@pytest.mark.parametrize("by", [2.0, np.nan])
def test_invalid_correlation_is_refused(by):
    with pytest.raises(ValueError, match=f"the kernel ScaledKernel has the value {by:g} at distance zero: must be 1"):
        gp.make_hyperparameters(1.0, [1.0], 0.1, kernel=ScaledKernel(by=by))


def test_user_defined_kernels_are_not_saved(tmp_path):
    X, Y, hyper, _ = problem(0)
    model = gp.condition(X, Y, dataclasses.replace(hyper, kernel=Matern52()))
    with pytest.raises(ValueError, match="the kernel is Matern52: only SquaredExponential can be stored"):
        gp.save_gp(model, tmp_path / "model.npz")
    assert not list(tmp_path.iterdir())


def test_function_covariance_equals_scikit_learn():
    """For every output."""
    rng = np.random.default_rng(3)
    X = rng.normal(size=(12, 2))
    hyper = gp.make_hyperparameters([2.0, 0.5], [[0.4, 1.5], [2.0, 0.7]], [0.1, 0.3])
    for i, (s, scale) in enumerate(zip((2.0, 0.5), ([0.4, 1.5], [2.0, 0.7]), strict=True)):
        K = gp.function_covariance(X, hyper, i)
        np.testing.assert_allclose(K, (ConstantKernel(s) * RBF(scale))(X), rtol=1e-12)
