"""Tests of fitted hyperparameters and parametric means against finite differences, scikit-learn and known values."""

import dataclasses
import warnings

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import block_diag
from scipy.stats import multivariate_normal, norm
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel

from colift import gp
from colift.gp import semiparametric
from colift.gp.likelihood import log_marginal_likelihood, squared_distances
from tests.support.gp_problems import arrays, problem

seeds = st.integers(0, 2**31)


def drawn(seed, N=60, dimensions=5, relevant=2, noise=0.01):
    """Two standardized outputs drawn from a GP in which only the first inputs are relevant."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(N, dimensions))
    U = X[:, :relevant] / 1.2
    K = np.exp(-0.5 * ((U[:, None] - U[None]) ** 2).sum(-1)) + 1e-10 * np.eye(N)
    Y = np.linalg.cholesky(K) @ rng.normal(size=(N, 2)) + noise**0.5 * rng.normal(size=(N, 2))
    return (X - X.mean(0)) / X.std(0), (Y - Y.mean(0)) / Y.std(0)


# -- likelihood --------------------------------------------------------------------------------------------------


@given(seeds, st.integers(1, 3), st.integers(1, 6))
@settings(max_examples=30)
def test_gradient_of_the_likelihood(seed, outputs, dimensions):
    rng = np.random.default_rng(seed)
    X, R = rng.normal(size=(25, dimensions)), rng.normal(size=(25, outputs))
    theta = rng.uniform(-1.5, 1.5, dimensions + 2)
    value, gradient = log_marginal_likelihood(theta, X, R)
    h = 1e-5
    for k in range(len(theta)):
        step = np.zeros_like(theta)
        step[k] = h
        points = [log_marginal_likelihood(theta + j * step, X, R)[0] for j in (-2, -1, 1, 2)]
        numeric = (points[0] - 8 * points[1] + 8 * points[2] - points[3]) / (12 * h)
        assert abs(gradient[k] - numeric) <= 1e-7 * max(1, abs(value))


@given(seeds)
@settings(max_examples=20)
def test_likelihood_equals_the_normal_density(seed):
    X, Y, hyper, _ = problem(seed, N=30)
    for i in range(3):
        s, ls, v, offset = arrays(hyper, i)
        theta = np.log(np.concatenate([[s], ls, [v]]))
        value, _ = log_marginal_likelihood(theta, X - X.mean(0), Y[:, i : i + 1] - offset)
        K = s * np.exp(-0.5 * (((X[:, None] - X[None]) / ls) ** 2).sum(-1)) + v * np.eye(30)
        expected = multivariate_normal(cov=K).logpdf(Y[:, i] - offset)
        assert abs(value - expected) <= 1e-8 * 30


@given(seeds)
@settings(max_examples=20)
def test_likelihood_and_gradient_agree_with_scikit_learn(seed):
    rng = np.random.default_rng(seed)
    X, y = rng.normal(size=(80, 6)), rng.normal(size=80)
    theta = rng.uniform(-1.5, 1.5, 8)
    kernel = ConstantKernel(np.exp(theta[0])) * RBF(np.exp(theta[1:-1])) + WhiteKernel(np.exp(theta[-1]))
    model = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None).fit(X, y)
    expected, expected_gradient = model.log_marginal_likelihood(theta, eval_gradient=True)
    value, gradient = log_marginal_likelihood(theta, X, y[:, None])
    assert abs(value - expected) <= 1e-8 * 80
    np.testing.assert_allclose(gradient, expected_gradient, rtol=1e-9, atol=1e-9)


def test_outputs_that_share_a_kernel_add_their_likelihoods():
    rng = np.random.default_rng(0)
    X, R, theta = rng.normal(size=(20, 3)), rng.normal(size=(20, 4)), np.array([0.1, 0.2, -0.3, 0.4, -2.0])
    value, gradient = log_marginal_likelihood(theta, X, R)
    single = [log_marginal_likelihood(theta, X, R[:, [q]]) for q in range(4)]
    np.testing.assert_allclose(value, sum(v for v, _ in single), rtol=1e-13)
    np.testing.assert_allclose(gradient, sum(g for _, g in single), rtol=1e-10)


def test_correlation_by_products_has_the_stated_error():
    rng = np.random.default_rng(0)
    U = rng.normal(size=(50, 4)) * 30
    exact = np.exp(-0.5 * ((U[:, None] - U[None]) ** 2).sum(-1))
    limit = 20 * np.finfo(float).eps * (U**2).sum(1).max()
    r2 = np.empty((50, 50))
    squared_distances(U, r2)
    assert (r2 >= 0).all()
    E, slope = gp.SquaredExponential().numpy_value_and_slope(r2)
    assert slope is E
    assert np.abs(E - exact).max() <= limit
    assert (np.diagonal(E) == 1).all()


# -- fit ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_optimum_equals_scikit_learn_at_equal_budget(seed):
    """With the same standardized data, bounds, start and number of starts: within 0.05 nats, or better."""
    X, Y = drawn(seed)
    box = gp.HyperparameterBounds()
    found = gp.fit(X, Y, box, restarts=0, constant_mean=np.zeros(2))
    for i in range(2):
        kernel = ConstantKernel(1.0, box.signal_variance) * RBF([5**0.5] * 5, box.lengthscale) + WhiteKernel(
            0.1, box.noise_variance
        )
        model = GaussianProcessRegressor(kernel, alpha=0.0, n_restarts_optimizer=0)
        expected = ignore_bound_warnings(model.fit, X, Y[:, i]).log_marginal_likelihood_value_
        assert found.log_likelihood[i] >= expected - 0.05


def ignore_bound_warnings(f, *arguments):
    """Suppress scikit-learn's warnings about parameters at their bounds, which are intended here."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return f(*arguments)


def test_reported_likelihood_is_that_of_the_posterior():
    """The reported likelihood is that of the posterior in the units of the data."""
    X, Y, _, _ = problem(3, N=50)
    found = gp.fit(X, Y, restarts=0)
    posterior = gp.condition(X, Y, found.hyper)
    np.testing.assert_allclose(found.log_likelihood, gp.log_likelihood(posterior), rtol=1e-8)


def test_irrelevant_inputs_reach_the_upper_bound():
    """Irrelevant inputs reach the upper bound of the length-scale; relevant ones do not."""
    X, Y = drawn(0, N=120, dimensions=6, relevant=2)
    found = gp.fit(X, Y)
    assert found.converged.all()
    assert not found.at_upper[:, :2].any()
    assert found.at_upper[:, 2:].mean() >= 0.75
    assert not found.at_lower.any()
    assert (found.lengthscales[found.at_upper] >= 29.7).all()
    np.testing.assert_allclose(found.lengthscales[:, :2], 1.2, rtol=0.5)


def test_flags_at_the_lower_bound():
    rng = np.random.default_rng(0)
    X = np.linspace(0, 40, 60)[:, None]
    Y = np.sin(5 * X) + 0.01 * rng.normal(size=X.shape)
    found = gp.fit(X, Y, gp.HyperparameterBounds(lengthscale=(0.5, 30.0), noise_variance=(1e-6, 1e-3)))
    assert found.at_lower.all()
    assert not found.at_upper.any()


@given(seeds)
@settings(max_examples=5)
def test_fit_is_invariant_to_units(seed):
    """Affine changes of inputs and outputs change the fitted hyperparameters by the same units only."""
    rng = np.random.default_rng(seed)
    X, Y = drawn(seed % 1000, N=40, dimensions=3)
    a, b = 2.0 ** rng.integers(-8, 8, 3), 2.0 ** rng.integers(-8, 8, 2)
    one, other = gp.fit(X, Y, restarts=0), gp.fit(X * a + 2 * a, Y * b - 3 * b, restarts=0)
    np.testing.assert_allclose(other.hyper.lengthscales, np.asarray(one.hyper.lengthscales) * a, rtol=1e-3)
    np.testing.assert_allclose(other.log_likelihood, one.log_likelihood - 40 * np.log(b), atol=1e-4)
    np.testing.assert_allclose(
        other.hyper.constant_mean, np.asarray(one.hyper.constant_mean) * b - 3 * b, atol=1e-9 * b.max()
    )


def test_warm_start_at_the_optimum_stays_there():
    X, Y = drawn(4, N=100)
    cold = gp.fit(X, Y, restarts=0)
    warm = gp.fit(X, Y, restarts=0, start=cold.hyper)
    assert warm.num_evaluations < cold.num_evaluations / 2
    assert (warm.log_likelihood >= cold.log_likelihood - 1e-4).all()
    outside = gp.make_hyperparameters(1e9, np.full((2, 5), 1e9), 1e-3)
    assert (gp.fit(X, Y, restarts=0, start=outside).lengthscales <= 30 * (1 + 1e-12)).all()


def test_restarts_never_reduce_the_likelihood():
    X, Y = drawn(5, N=40)
    few, many, again = gp.fit(X, Y, restarts=0), gp.fit(X, Y, restarts=4, seed=1), gp.fit(X, Y, restarts=4, seed=1)
    assert (many.log_likelihood >= few.log_likelihood).all()
    np.testing.assert_array_equal(many.hyper.lengthscales, again.hyper.lengthscales)


def test_shared_hyperparameters_in_standardized_units():
    X, Y = drawn(6)
    found = gp.fit_shared(X * 3, Y * [1.0, 10.0])
    np.testing.assert_array_equal(found.hyper.lengthscales[0], found.hyper.lengthscales[1])
    for name in ("signal_variance", "noise_variance"):
        value = np.asarray(getattr(found.hyper, name))
        np.testing.assert_allclose(value[1], 100 * value[0], rtol=1e-12)
    own = gp.fit(X * 3, Y * [1.0, 10.0])
    assert found.log_likelihood.sum() <= own.log_likelihood.sum() + 0.05
    one = gp.fit_shared(X, Y[:, :1])
    np.testing.assert_array_equal(one.hyper.lengthscales, gp.fit(X, Y[:, :1]).hyper.lengthscales)


def test_noise_has_a_lower_bound():
    X = np.linspace(0, 1, 30)[:, None]
    found = gp.fit(X, np.sin(3 * X))
    assert (found.hyper.noise_variance >= 1e-6 * np.sin(3 * X).var() * (1 - 1e-9)).all()


# -- degenerate data ---------------------------------------------------------------------------------------------


def test_constant_output_is_predicted():
    X, Y = drawn(7, N=30)
    Y = np.column_stack([Y[:, 0], np.full(30, 4.2)])
    found = gp.fit(X, Y)
    posterior = gp.condition(X, Y, found.hyper)
    x = jnp.asarray(X.mean(0) + 100)
    assert abs(gp.mean(posterior, x)[1] - 4.2) < 1e-12
    assert np.isfinite(found.log_likelihood).all()


def test_constant_input_changes_nothing():
    X, Y = drawn(8, N=40, dimensions=3)
    wide = np.column_stack([X, np.full(40, 1e3)])
    with_it, without = gp.fit(wide, Y, restarts=0), gp.fit(X, Y, restarts=0)
    np.testing.assert_allclose(with_it.log_likelihood, without.log_likelihood, atol=0.05)
    assert np.isfinite(with_it.hyper.lengthscales).all()


def test_duplicates_and_two_points_are_fitted():
    X, Y = drawn(9, N=20)
    doubled = gp.fit(np.repeat(X, 3, axis=0), np.repeat(Y, 3, axis=0))
    assert np.isfinite(doubled.log_likelihood).all()
    assert np.isfinite(gp.fit(X[:2], Y[:2]).log_likelihood).all()


@pytest.mark.parametrize(
    ("X", "Y", "options", "message"),
    [
        (np.ones((1, 2)), np.ones((1, 1)), {}, "needs at least 2"),
        (np.array([[1.0], [np.nan]]), np.ones((2, 1)), {}, r"X\[1, 0\] = nan"),
        (np.ones((2, 1)), np.array([[1.0], [-np.inf]]), {}, r"Y\[1, 0\] = -inf"),
        (np.ones((2, 1)), np.ones((3, 1)), {}, "one N"),
        (np.ones((2, 1)), np.ones((2, 1)), {"constant_mean": [np.nan]}, "constant_mean"),
        (np.ones((2, 1)), np.ones((2, 1)), {"start": gp.make_hyperparameters(1.0, [1.0, 1.0], 0.1)}, "start has"),
    ],
)
def test_invalid_data_are_refused(X, Y, options, message):
    for fit in (gp.fit, gp.fit_shared):
        with pytest.raises(ValueError, match=message):
            fit(X, Y, **options)


@pytest.mark.parametrize("bounds", [(0.0, 1.0), (2.0, 1.0), (1.0, np.inf), (np.nan, 1.0)])
def test_invalid_bounds_are_refused(bounds):
    with pytest.raises(ValueError, match="lengthscale = "):
        gp.HyperparameterBounds(lengthscale=bounds)


# -- hyperpriors -------------------------------------------------------------------------------------------------


def flight_like_data(seed, N=40):
    """Data as of a flight: two inputs that vary, five nearly dependent on them, and one constant input."""
    rng = np.random.default_rng(seed)
    phase = np.linspace(0, rng.uniform(2, 9), N)[:, None] + rng.uniform(0, 6, 2)
    moving = rng.uniform(0.2, 1, 2) * np.sin(phase)
    hardly = 10.0 ** rng.uniform(-4, -1.5, 5) * (moving @ rng.normal(size=(2, 5)) + 0.3 * rng.normal(size=(N, 5)))
    X = np.column_stack([moving, 1 + hardly, np.full(N, 2.0)])
    F = np.sin(moving @ rng.normal(size=(2, 3)) * 2 + rng.uniform(0, 6, 3))
    return X, [1.0, 0.2, 0.01] * (F + 0.1 * rng.normal(size=F.shape) + rng.normal(size=3))


BELIEF = gp.HyperPrior(gp.make_hyperparameters([1.0, 0.04, 1e-4], np.ones(8), [1e-2, 4e-4, 1e-6]))


@given(seeds)
@settings(max_examples=12)
def test_predictions_are_insensitive_to_rounding(seed):
    """1e-12 in the data changes the mean by at most 1e-4 of the labels' standard deviation, also away from the data.

    A search ends within GTOL = 1e-5 over the optimum's curvature, about 1, of the optimum's logarithms; the slope of
    a mean in them is at most a few label deviations.
    """
    X, Y = flight_like_data(seed)
    rng = np.random.default_rng(seed + 1)
    queries = jnp.asarray(np.concatenate([X, X + 0.5 * X.std(0) * rng.normal(size=X.shape)]))

    def predictions(X, Y):
        found = gp.fit(X, Y, hyperprior=BELIEF, restarts=1, max_iterations=300)
        assert found.converged.all()
        return np.asarray(predict(gp.condition(X, Y, found.hyper), queries))

    expected = predictions(X, Y)
    for _ in range(2):
        other = predictions(*(A * (1 + 1e-12 * rng.uniform(-1, 1, A.shape)) for A in (X, Y)))
        assert np.abs((other - expected) / Y.std(0)).max() <= 1e-4


predict = jax.jit(jax.vmap(gp.mean, in_axes=(None, 0)))


@given(seeds)
@settings(max_examples=10)
def test_fit_with_hyperprior_is_the_posterior_mode(seed):
    """The gradient of likelihood and log-normal density vanishes, except at bounds, where it points outward."""
    X, Y = flight_like_data(seed)
    found = gp.fit(X, Y, hyperprior=BELIEF)
    h = found.hyper
    for i in range(3):
        (s, ls, v, offset), (s0, ls0, v0, _) = arrays(h, i), arrays(BELIEF.median, i)
        theta, median = (np.log([a, *b, c]) for a, b, c in ((s, ls, v), (s0, ls0, v0)))
        kernel = ConstantKernel(s) * RBF(ls) + WhiteKernel(v)
        model = GaussianProcessRegressor(kernel, alpha=0.0, optimizer=None).fit(X, Y[:, i] - offset)
        # both in the units of the data: a change of units shifts logarithms, and no slope
        value, slope = model.log_marginal_likelihood(theta, eval_gradient=True)
        density = norm(median, np.log(3) * np.array([2, *[1] * 8, 2]))
        step = 1e-5
        slope += (density.logpdf(theta + step) - density.logpdf(theta - step)) / (2 * step)
        low = np.log([1e-3 * Y[:, i].var(), *[0.1] * 8, 1e-6 * Y[:, i].var()])
        high = np.log([1e2 * Y[:, i].var(), *[30.0] * 8, Y[:, i].var()])
        slope[(theta < low + 1e-6) & (slope < 0)] = 0
        slope[(theta > high - 1e-6) & (slope > 0)] = 0
        assert np.abs(slope).max() <= 1e-3
        np.testing.assert_allclose(found.log_likelihood[i], value, rtol=1e-7)


@given(seeds)
@settings(max_examples=5)
def test_length_scale_bounds_are_in_input_units(seed):
    """Length-scales keep their bounds in the unit of the input, however small its range."""
    X, Y = flight_like_data(seed)
    ls = np.asarray(
        gp.fit(
            X, Y, hyperprior=dataclasses.replace(BELIEF, min_lengthscale=0.6, max_lengthscale=1.5)
        ).hyper.lengthscales
    )
    assert (ls >= 0.6 * (1 - 1e-12)).all()
    assert (ls <= 1.5 * (1 + 1e-12)).all()


def test_length_scale_at_a_hyperprior_bound_is_marked():
    X = np.linspace(0, 8, 60)[:, None]
    box = gp.HyperparameterBounds(noise_variance=(1e-6, 1e-3))
    belief = gp.HyperPrior(gp.make_hyperparameters([1.0, 1.0], [1.0], 1e-4), min_lengthscale=0.6, max_lengthscale=1.5)
    found = gp.fit(X, np.column_stack([np.sin(8 * X), np.sin(0.1 * X)]), box, hyperprior=belief)
    np.testing.assert_allclose(found.hyper.lengthscales[:, 0], [0.6, 1.5], rtol=1e-12)
    assert found.at_lower.ravel().tolist() == [True, False]
    assert found.at_upper.ravel().tolist() == [False, True]


def test_hyperprior_remains_for_a_constant_input():
    X, Y = flight_like_data(3)
    belief = dataclasses.replace(BELIEF, median=dataclasses.replace(BELIEF.median, lengthscales=jnp.full((3, 8), 0.7)))
    np.testing.assert_allclose(gp.fit(X, Y, hyperprior=belief).hyper.lengthscales[:, 7], 0.7, rtol=1e-4)


def test_narrow_hyperprior_is_kept_and_wide_one_is_not():
    X, Y = drawn(0, N=120, dimensions=6, relevant=2)
    median = gp.make_hyperparameters([1.0, 1.0], np.full(6, 3.0), 0.1)
    firm = gp.fit(X, Y, hyperprior=gp.HyperPrior(median, scale_factor=1.001)).hyper
    for name in ("signal_variance", "lengthscales", "noise_variance"):
        np.testing.assert_allclose(getattr(firm, name), getattr(median, name), rtol=0.01)
    loose = gp.fit(X, Y, hyperprior=gp.HyperPrior(median, scale_factor=100.0))
    np.testing.assert_allclose(loose.log_likelihood, gp.fit(X, Y).log_likelihood, atol=1.0)
    np.testing.assert_allclose(loose.hyper.lengthscales[:, :2], 1.2, rtol=0.5)


def test_shared_hyperprior_counts_once():
    X, Y = drawn(6)
    belief = gp.HyperPrior(gp.make_hyperparameters([1.0, 4.0], np.full(5, 2.0), [0.1, 0.4]))
    alike = gp.HyperPrior(gp.make_hyperparameters(1.0, np.full((2, 5), 2.0), 0.1))
    found, expected = gp.fit_shared(X, Y * [1.0, 2.0], hyperprior=belief), gp.fit_shared(X, Y, hyperprior=alike)
    np.testing.assert_allclose(found.hyper.lengthscales, expected.hyper.lengthscales, rtol=1e-3)
    one = gp.HyperPrior(gp.make_hyperparameters(1.0, np.full((1, 5), 2.0), 0.1))
    alone, own = gp.fit_shared(X, Y[:, :1], hyperprior=one), gp.fit(X, Y[:, :1], hyperprior=one)
    np.testing.assert_array_equal(alone.hyper.lengthscales, own.hyper.lengthscales)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"scale_factor": 1.0}, "scale_factor = 1.0: must exceed 1"),
        ({"scale_factor": np.nan}, "scale_factor = nan"),
        ({"min_lengthscale": 0.0}, "min_lengthscale = 0.0"),
        (
            {"min_lengthscale": 2.0, "max_lengthscale": 1.0},
            "min_lengthscale = 2.0, max_lengthscale = 1.0: must satisfy",
        ),
        ({"max_lengthscale": np.inf}, "max_lengthscale = inf"),
    ],
)
def test_invalid_hyperpriors_are_refused(change, message):
    with pytest.raises(ValueError, match=message):
        dataclasses.replace(BELIEF, **change)


def test_hyperprior_of_other_dimension_is_refused():
    X, Y = drawn(0)
    with pytest.raises(ValueError, match=r"hyperprior has lengthscales \(3, 8\): must be .* = \(2, 5\)"):
        gp.fit(X, Y, hyperprior=BELIEF)
    broken = dataclasses.replace(BELIEF.median, noise_variance=-BELIEF.median.noise_variance)
    with pytest.raises(ValueError, match="noise_variance = "):
        gp.HyperPrior(broken)


# -- parametric means --------------------------------------------------------------------------------------------

PRIOR = np.array([1.0, 0.01, 100.0])
GROUPS = ((0, 1),)


def body(seed, N=80, noise=1e-4):
    """Two outputs that share three parameters of different units, plus a smooth residual for the GP."""
    rng = np.random.default_rng(seed)
    X = rng.uniform(-2, 2, size=(N, 2))
    Phi = rng.normal(size=(N, 2, 3)) * [1.0, 100.0, 0.01]
    theta = np.array([0.3, -2e-3, 40.0])
    rest = 0.2 * np.stack([np.sin(2 * X[:, 0]), np.cos(2 * X[:, 1])], axis=1)
    return X, Phi @ theta + rest + noise**0.5 * rng.normal(size=(N, 2)), Phi, theta, rest


def body_hyperprior(outputs=2, dimensions=2, factor=10.0, lengthscale=1.0):
    ls = np.broadcast_to(np.asarray(lengthscale, float), (outputs, dimensions))
    return gp.HyperPrior(gp.make_hyperparameters(np.full(outputs, 0.1), ls, 1e-3), scale_factor=factor)


def dense_covariance(X, hyper, Phi, prior, outputs):
    """Return the covariance of stacked outputs that share parameters, by dense linear algebra."""
    blocks = []
    for i in outputs:
        s, ls, v, _ = arrays(hyper, i)
        blocks.append(s * np.exp(-0.5 * (((X[:, None] - X[None]) / ls) ** 2).sum(-1)) + v * np.eye(len(X)))
    B = np.concatenate([Phi[:, i] for i in outputs])
    return block_diag(*blocks) + (B * prior**2) @ B.T


@pytest.mark.parametrize("seed", range(3))
def test_parameters_and_residual_are_separated(seed):
    X, Y, Phi, theta, rest = body(seed)
    found = gp.fit_semiparametric(X, Y, Phi, PRIOR, GROUPS, body_hyperprior())
    deviation = np.sqrt(np.diagonal(found.covariance))
    assert found.converged
    assert (np.abs(found.theta - theta) <= 4 * deviation).all()
    assert (deviation <= 0.03 * np.abs(theta)).all()
    posterior = gp.condition(X, Y - Phi @ found.theta, found.hyper)
    predicted = np.stack([np.asarray(gp.mean(posterior, x)) for x in jnp.asarray(X)])
    assert np.abs(predicted - rest).max() < 0.1


@given(seeds)
@settings(max_examples=15)
def test_marginal_likelihood_equals_a_dense_normal(seed):
    """The marginal likelihood equals a dense normal density, and its gradient equals differences."""
    rng = np.random.default_rng(seed)
    X, _, Phi, _, _ = body(seed, N=12)
    Phi, Y = np.concatenate([Phi, Phi[:, ::-1]], axis=1), rng.normal(size=(12, 4))
    belief = body_hyperprior(outputs=4, lengthscale=rng.uniform(0.5, 2, 2))
    parts = [semiparametric._output_group(X, outputs, belief) for outputs in ([0, 1], [2, 3])]
    t, kernel = rng.normal(size=6) - [1, 0, 2, 1, 0, 2], belief.median.kernel
    value, slope, theta, covariance = semiparametric.log_marginal_likelihood(t, parts, Y, Phi, PRIOR, kernel)
    hyper = semiparametric._hyperparameters(t, parts, 2, kernel)
    C = dense_covariance(X, hyper, Phi, PRIOR, range(4))
    y, B = Y.T.reshape(-1), Phi.transpose(1, 0, 2).reshape(-1, 3)
    assert value == pytest.approx(multivariate_normal(cov=C).logpdf(y), rel=1e-9)
    gain = np.linalg.solve(C, B * PRIOR**2).T  # of the posterior of jointly normal parameters and data
    np.testing.assert_allclose(theta, gain @ y, rtol=1e-6)
    np.testing.assert_allclose(covariance, np.diag(PRIOR**2) - gain @ (B * PRIOR**2), rtol=1e-5, atol=1e-9)
    of = lambda t: semiparametric.log_marginal_likelihood(t, parts, Y, Phi, PRIOR, kernel)[0]  # noqa: E731
    by_differences = [(of(t + h) - of(t - h)) / 2e-5 for h in 1e-5 * np.eye(6)]
    np.testing.assert_allclose(slope, by_differences, rtol=1e-5, atol=1e-5)


def variation_of(rng, N):
    """Return random ages and change points; the first parameter does not change."""
    age = np.sort(rng.uniform(0, 30, N))[::-1]
    return gp.TimeVariation(age=age, jumps=np.floor(age / 12), varying=np.array([0.0, 1.0, 1.0]))


def dense_changes(X, hyper, Phi, variation, rate):
    """Return the covariance of the changes of stacked outputs, element by element."""
    N, m = Phi.shape[:2]
    C, P = np.zeros((m * N, m * N)), np.diag((PRIOR * variation.varying) ** 2)
    for i in range(m):
        s, ls, _, _ = arrays(hyper, i)
        for k in range(N):
            for j in range(N):
                age, jumps = (min(x[k], x[j]) for x in (variation.age, variation.jumps))
                f = s * np.exp(-0.5 * (((X[k] - X[j]) / ls) ** 2).sum())
                of_f, of_theta = rate * age + gp.JUMP_SHARE * jumps, rate * age + jumps
                C[i * N + k, i * N + j] = of_f * f + of_theta * (Phi[k, i] @ P @ Phi[j, i])
    return C


@given(seeds)
@settings(max_examples=8)
def test_likelihood_of_changes_equals_a_dense_normal(seed):
    """With random walks and jumps: value, gradient, estimates and posterior equal dense linear algebra."""
    rng = np.random.default_rng(seed)
    X, _, Phi, _, _ = body(seed, N=10)
    Phi, Y = np.concatenate([Phi, Phi[:, ::-1]], axis=1), rng.normal(size=(10, 4))
    belief, variation = body_hyperprior(outputs=4, lengthscale=rng.uniform(0.5, 2, 2)), variation_of(rng, 10)
    parts = [semiparametric._output_group(X, outputs, belief) for outputs in ([0, 1], [2, 3])]
    t, kernel = np.append(rng.normal(size=6) - [1, 0, 2, 1, 0, 2], np.log(0.02)), belief.median.kernel
    of = lambda t: semiparametric.log_marginal_likelihood(t, parts, Y, Phi, PRIOR, kernel, variation)  # noqa: E731
    value, slope, theta, covariance = of(t)
    hyper = semiparametric._hyperparameters(t[:6], parts, 2, kernel)
    changes = dense_changes(X, hyper, Phi, variation, 0.02)
    C = dense_covariance(X, hyper, Phi, PRIOR, range(4)) + changes
    assert value == pytest.approx(multivariate_normal(cov=C).logpdf(Y.T.reshape(-1)), rel=1e-9)
    by_differences = [(of(t + h)[0] - of(t - h)[0]) / 2e-5 for h in 1e-5 * np.eye(7)]
    np.testing.assert_allclose(slope, by_differences, rtol=1e-5, atol=1e-5)
    D = variation.covariance(X, Phi, PRIOR, hyper, 0.02)
    for i in range(4):
        np.testing.assert_allclose(D[i], changes[10 * i : 10 * i + 10, 10 * i : 10 * i + 10], atol=1e-12)
    found = gp.estimate_parameters(X, Y, Phi, PRIOR, hyper, D)
    np.testing.assert_allclose(found[0], theta, rtol=1e-7)
    np.testing.assert_allclose(found[1], covariance, rtol=1e-7, atol=1e-12)
    posterior = gp.condition(X, Y, hyper, noise_covariance=D)
    x = rng.normal(size=2)
    for i in range(4):
        s, ls, v, offset = arrays(hyper, i)
        k = s * np.exp(-0.5 * (((X - x) / ls) ** 2).sum(1))
        K = s * np.exp(-0.5 * (((X[:, None] - X[None]) / ls) ** 2).sum(-1)) + v * np.eye(10) + D[i]
        assert float(gp.mean(posterior, jnp.asarray(x))[i]) == pytest.approx(
            offset + k @ np.linalg.solve(K, Y[:, i] - offset), rel=1e-6, abs=1e-9
        )


@pytest.mark.parametrize("rate", [1e-4, 0.1])
def test_rate_of_changes_is_identified(rate):
    """Over draws from the model, the mean log of the fitted rate is within a factor of three of the true one."""
    rng, found = np.random.default_rng(1), []
    X, _, Phi, _, _ = body(0, N=60)
    belief, variation = body_hyperprior(factor=1.0001), variation_of(rng, 60)
    C = dense_covariance(X, belief.median, Phi, PRIOR, range(2))
    L = np.linalg.cholesky(C + dense_changes(X, belief.median, Phi, variation, rate))
    for _ in range(5):
        Y = (L @ rng.normal(size=120)).reshape(2, 60).T
        fit = gp.fit_semiparametric(X, Y, Phi, PRIOR, GROUPS, belief, variation=variation, median_rate=0.05)
        found.append(fit.rate)
    mean = np.exp(np.mean(np.log(found)))
    assert mean < 3e-3 if rate < 1e-3 else rate / 3 < mean < 3 * rate


def test_estimates_are_unbiased_and_calibrated():
    """Over draws from the model, the whitened error has unit covariance."""
    rng = np.random.default_rng(0)
    X, _, Phi, _, _ = body(0, N=30)
    belief = body_hyperprior(factor=1.0001)  # the true hyperparameters
    K = dense_covariance(X, belief.median, Phi, 0 * PRIOR, range(2))
    L, whitened = np.linalg.cholesky(K), []
    for _ in range(400):
        theta = PRIOR * rng.normal(size=3)
        Y = Phi @ theta + (L @ rng.normal(size=60)).reshape(2, 30).T
        found = gp.fit_semiparametric(X, Y, Phi, PRIOR, GROUPS, belief, max_iterations=1)
        whitened.append(np.linalg.solve(np.linalg.cholesky(found.covariance), found.theta - theta))
    whitened = np.array(whitened)
    assert np.abs(whitened.mean(0)).max() < 4 / 400**0.5
    assert np.abs(np.cov(whitened.T) - np.eye(3)).max() < 4 * (2 / 400) ** 0.5


def test_unexcited_parameters_keep_their_prior():
    """A constant attitude determines the sum of two parameters only, and not the third."""
    X, Y, Phi, theta, _ = body(0, N=25)
    deficient = np.concatenate([Phi[..., :1], 2 * Phi[..., :1], 0 * Phi[..., :1]], axis=-1)
    Y = Y - Phi @ theta + deficient @ [0.5, 0.25, 7.0]
    found = gp.fit_semiparametric(X, Y, deficient, [1.0, 1.0, 3.0], GROUPS, body_hyperprior())
    assert found.theta[2] == 0
    assert found.covariance[2, 2] == pytest.approx(9.0)
    assert abs(found.theta @ [1, 2, 0] - 1.0) < 0.1
    null = np.array([2.0, -1.0, 0.0]) / 5**0.5
    assert null @ found.covariance @ null == pytest.approx(1.0, rel=1e-6)


def test_inactive_input_has_no_effect():
    X, Y, Phi, _, _ = body(1)
    more = np.column_stack([X, np.random.default_rng(2).normal(size=len(X))])
    deficient = body_hyperprior(dimensions=3, lengthscale=[1.0, 1.0, gp.INACTIVE_LENGTHSCALE])
    one, other = (
        gp.fit_semiparametric(Z, Y, Phi, PRIOR, GROUPS, b) for Z, b in ((X, body_hyperprior()), (more, deficient))
    )
    np.testing.assert_allclose(other.theta, one.theta, rtol=1e-9)
    np.testing.assert_array_equal(other.hyper.lengthscales[:, 2], gp.INACTIVE_LENGTHSCALE)
    posterior = gp.condition(more, Y - Phi @ other.theta, other.hyper)
    x = jnp.asarray([0.3, 0.2, 5.0])
    np.testing.assert_array_equal(gp.mean(posterior, x), gp.mean(posterior, x.at[2].set(-1e3)))


def test_invalid_mean_is_refused():
    X, Y, Phi, _, _ = body(0, N=10)
    with pytest.raises(ValueError, match=r"Phi \(10, 1, 3\): must be finite and"):
        gp.fit_semiparametric(X, Y, Phi[:, :1], PRIOR, GROUPS, body_hyperprior())
    with pytest.raises(ValueError, match=r"prior \[1.0, 0.0, 1.0\]: must be positive"):
        gp.fit_semiparametric(X, Y, Phi, [1.0, 0.0, 1.0], GROUPS, body_hyperprior())
