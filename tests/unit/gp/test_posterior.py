"""Tests of the posterior: axioms, independent implementations, and effects of rounding."""

import dataclasses
import logging
import os
import re
import stat

import jax
import jax.numpy as jnp
import jaxtyping
import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel

from colift import gp
from colift.gp import posterior, serialization
from colift.gp.likelihood import min_noise_ratio_for_append
from tests.support.gp_problems import EPS, arrays, exact, gram, problem

seeds = st.integers(0, 2**31)


def means(posterior, queries):
    return np.asarray(jax.vmap(gp.mean, (None, 0))(posterior, queries))


def variances(posterior, queries):
    return np.asarray(jax.vmap(gp.variance, (None, 0))(posterior, queries))


def tolerance(condition, below):
    """Return `below` up to a condition number of 1e6, and 100 eps cond above."""
    return below if condition <= 1e6 else 100 * EPS * condition


def assert_same_posterior(a, b, queries, cond, tol):
    assert int(a.num_points) == int(b.num_points)
    std = np.sqrt(np.asarray(a.hyper.signal_variance))
    bound = np.array([tolerance(c, tol) for c in cond])
    assert (np.abs(means(a, queries) - means(b, queries)) <= bound * std).all()
    va, vb = variances(a, queries), variances(b, queries)
    assert (np.abs(va - vb) <= bound * np.asarray(a.hyper.signal_variance)).all()
    n = int(a.num_points)
    assert (np.abs(gp.log_likelihood(a) - gp.log_likelihood(b)) <= max(n, 1) * bound * 100).all()


# -- functions of known norm -------------------------------------------------------------------------------------


def combination(seed, centers=6, outputs=3):
    """Kernels at random centers with random weights: the function as a GP, and its parts."""
    rng = np.random.default_rng(seed)
    _, _, hyper, queries = problem(seed, outputs=outputs)
    Z = np.asarray(queries).mean(0) + rng.normal(size=(centers, 4)) * np.asarray(hyper.lengthscales).mean(0)
    w = rng.normal(size=(outputs, centers)) / np.sqrt(np.asarray(hyper.signal_variance))[:, None]
    return hyper, Z, w, queries


@given(seeds, st.sampled_from([None, 11]))
@settings(max_examples=10)
def test_expansion_is_the_sum_of_its_kernels(seed, capacity):
    hyper, Z, w, queries = combination(seed)
    f = gp.from_expansion(hyper, Z, w, capacity)
    assert f.capacity == (capacity or 6)
    for i in range(3):
        s, ls, _, offset = arrays(hyper, i)
        for x, found in zip(np.asarray(queries), means(f, queries)[:, i], strict=True):
            terms = [w[i, k] * s * np.exp(-0.5 * sum(((x - z) / ls) ** 2)) for k, z in enumerate(Z)]
            np.testing.assert_allclose(found, offset + sum(terms), rtol=1e-10, atol=1e-10 * s**0.5)


@given(seeds)
@settings(max_examples=10)
def test_rkhs_norm_of_an_expansion(seed):
    """With 50 digits; every value is at most norm times prior standard deviation (reproducing property)."""
    hyper, Z, w, queries = combination(seed)
    f = gp.from_expansion(hyper, Z, w, 9)
    found = np.asarray(gp.rkhs_norm(f))
    for i in range(3):
        s, ls, _, offset = arrays(hyper, i)
        with mpmath.workdps(50):
            energy = mpmath.mpf(0)
            for p, a in zip(Z, w[i], strict=True):
                for q, b in zip(Z, w[i], strict=True):
                    r2 = sum(
                        ((mpmath.mpf(u) - mpmath.mpf(v)) / mpmath.mpf(e)) ** 2 for u, v, e in zip(p, q, ls, strict=True)
                    )
                    energy += mpmath.mpf(a) * mpmath.mpf(b) * s * mpmath.exp(-r2 / 2)
            expected = float(mpmath.sqrt(energy))
        np.testing.assert_allclose(found[i], expected, rtol=1e-9)
        assert (np.abs(means(f, queries)[:, i] - offset) <= expected * s**0.5 * (1 + 1e-12)).all()
    one = gp.from_expansion(hyper, Z[:1], w[:, :1])
    np.testing.assert_allclose(gp.rkhs_norm(one), np.abs(w[:, 0]) * np.sqrt(hyper.signal_variance), rtol=1e-12)


def test_conditioning_on_an_expansion_returns_its_weights():
    """Conditioning on values of an expansion at its centers returns its weights."""
    hyper, Z, w, queries = combination(4)
    f = gp.from_expansion(hyper, Z, w)
    again = gp.condition(f.X, f.Y, hyper)
    np.testing.assert_allclose(again.alpha, w, rtol=1e-8, atol=1e-8 * np.abs(w).max())
    np.testing.assert_allclose(means(again, queries), means(f, queries), rtol=1e-9)
    noise = np.asarray(hyper.noise_variance)
    np.testing.assert_allclose(np.asarray(f.Y) - means(f, f.X), (noise[:, None] * w).T, rtol=1e-6, atol=1e-12)


def test_norm_without_weights_or_data_is_zero():
    hyper, Z, w, _ = combination(5)
    assert (gp.rkhs_norm(gp.prior(hyper, 4)) == 0).all()
    assert (gp.rkhs_norm(gp.from_expansion(hyper, Z, 0 * w)) == 0).all()


@pytest.mark.parametrize("change", ["short", "nan", "flat"])
def test_invalid_weights_are_refused(change):
    hyper, Z, w, _ = combination(6)
    bad = {"short": w[:, :-1], "nan": np.where(w == w[0, 0], np.nan, w), "flat": w[0]}[change]
    with pytest.raises(ValueError, match=r"weights \(.*\): must be finite, \(3, 6\)"):
        gp.from_expansion(hyper, Z, bad)


# -- axioms ------------------------------------------------------------------------------------------------------


@given(seeds)
@settings(max_examples=10)
def test_prior_has_mean_offset_and_signal_variance(seed):
    _, _, hyper, queries = problem(seed)
    p = gp.prior(hyper, 8)
    assert (means(p, queries) == np.asarray(hyper.constant_mean)).all()
    assert (variances(p, queries) == np.asarray(hyper.signal_variance)).all()
    assert (gp.information_gain(p) == 0).all()
    assert (gp.log_likelihood(p) == 0).all()


def test_prior_and_conditioned_share_structure_shapes_and_types():
    X, Y, hyper, _ = problem(0)
    a, b = gp.prior(hyper, 50), gp.condition(X, Y, hyper, 50)
    assert jax.tree.structure(a) == jax.tree.structure(b)
    c, _ = gp.append(a, jnp.asarray(X[0]), jnp.asarray(Y[0]))
    d, _ = gp.remove(b, jnp.asarray(0))
    expected = [(x.aval, x.aval.weak_type) for x in jax.tree.leaves(a)]
    for other in (b, c, d):
        assert [(x.aval, x.aval.weak_type) for x in jax.tree.leaves(other)] == expected


@given(seeds)
@settings(max_examples=10)
def test_spare_capacity_has_no_effect(seed):
    X, Y, hyper, queries = problem(seed)
    tight, loose = gp.condition(X, Y, hyper), gp.condition(X, Y, hyper, 64)
    assert_same_posterior(tight, loose, queries, [1.0] * 3, 1e-11)  # the same numbers, summed in another order
    np.testing.assert_allclose(gp.information_gain(tight), gp.information_gain(loose), rtol=1e-12)


@given(seeds, st.permutations(range(25)))
@settings(max_examples=10)
def test_order_of_data_has_no_effect(seed, order):
    X, Y, hyper, queries = problem(seed, N=25)
    order = list(order)
    a, b = gp.condition(X, Y, hyper), gp.condition(X[order], Y[order], hyper)
    cond = [np.linalg.cond(gram(X, hyper, i)) for i in range(3)]
    assert_same_posterior(a, b, queries, cond, 1e-10)


@given(seeds)
@settings(max_examples=10)
def test_data_reduce_variance_and_gain_information(seed):
    """Data never increase the variance, and every point adds information."""
    X, Y, hyper, queries = problem(seed, N=15)
    p, before, gained = gp.prior(hyper, 15), None, np.zeros(3)
    for x, y in zip(jnp.asarray(X), jnp.asarray(Y), strict=True):
        step = 0.5 * np.log1p(np.asarray(gp.variance(p, x) / hyper.noise_variance))  # I(y; f) of one more point
        before = variances(p, queries)
        p, accepted = gp.append(p, x, y)
        assert bool(accepted)
        assert (variances(p, queries) <= before * (1 + 1e-9)).all()
        gain = np.asarray(gp.information_gain(p))
        np.testing.assert_allclose(gain - gained, step, rtol=1e-8, atol=1e-12)
        gained = gain


def test_stacked_posteriors_are_vmapped():
    problems = [problem(seed) for seed in range(3)]
    single = [gp.condition(X, Y, hyper, 45) for X, Y, hyper, _ in problems]
    queries = jnp.stack([q[1] for *_, q in problems])
    stacked = jax.tree.map(lambda *leaves: jnp.stack(leaves), *single)
    for query in (gp.mean, gp.variance):
        expected = np.stack([query(p, q) for p, q in zip(single, queries, strict=True)])
        np.testing.assert_allclose(jax.vmap(query)(stacked, queries), expected, rtol=1e-10)
    grown, accepted = jax.vmap(gp.append)(stacked, queries, jnp.ones((3, 3)))
    assert accepted.all()
    assert (grown.num_points == 41).all()
    shrunk, removed = jax.vmap(gp.remove)(grown, jnp.asarray([40, 40, 40]))
    assert removed.all()
    np.testing.assert_allclose(
        jax.vmap(gp.mean)(shrunk, queries), jax.vmap(gp.mean)(stacked, queries), rtol=1e-8, atol=1e-10
    )


def test_mean_is_differentiable_by_jax():
    X, Y, hyper, queries = problem(1)
    p = gp.condition(X, Y, hyper)
    x, h = queries[2], np.asarray(hyper.lengthscales).min(0) * 1e-5
    jacobian = jax.jacfwd(gp.mean, argnums=1)(p, x)
    for d in range(len(x)):
        step = jnp.zeros_like(x).at[d].set(h[d])
        numeric = (gp.mean(p, x + step) - gp.mean(p, x - step)) / (2 * h[d])
        scale = np.sqrt(np.asarray(hyper.signal_variance)) / np.asarray(hyper.lengthscales)[:, d]
        assert (np.abs(jacobian[:, d] - numeric) <= 1e-7 * scale).all()


# -- independent implementations ---------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [1e-1, 1e-3, 1e-6, 1e-9, 1e-11])
@pytest.mark.parametrize("seed", [0, 1])
def test_posterior_equals_mpmath(seed, noise):
    X, Y, hyper, queries = problem(seed, N=30, dimensions=2, outputs=2, noise=noise)
    p = gp.condition(X, Y, hyper, 35)
    mu, var = means(p, queries), variances(p, queries)
    assert (var >= 0).all()
    for i in range(2):
        cond = np.linalg.cond(gram(X, hyper, i))
        mu_i, var_i, log_likelihood, gain = exact(X, Y[:, i], queries, hyper, i)
        assert (np.abs(mu[:, i] - mu_i) <= tolerance(cond, 1e-9) * Y[:, i].std()).all()
        assert (np.abs(var[:, i] - var_i) <= tolerance(cond, 1e-8) * var_i).all()
        assert abs(gp.log_likelihood(p)[i] - log_likelihood) <= tolerance(cond, 1e-8) * len(X)
        assert abs(gp.information_gain(p)[i] - gain) <= tolerance(cond, 1e-8) * len(X)


def scikit_learn(X, y, hyper, i):
    s, ls, v, offset = arrays(hyper, i)
    kernel = ConstantKernel(s, "fixed") * RBF(ls, "fixed")
    return GaussianProcessRegressor(kernel, alpha=v, optimizer=None).fit(X, y - offset)


@given(seeds)
@settings(max_examples=10)
def test_agrees_with_scikit_learn(seed):
    X, Y, hyper, queries = problem(seed, N=80)
    p = gp.condition(X, Y, hyper, 100)
    for i in range(3):
        model = scikit_learn(X, Y[:, i], hyper, i)
        mu, std = model.predict(np.asarray(queries), return_std=True)
        cond = np.linalg.cond(gram(X, hyper, i))
        assert (
            np.abs(means(p, queries)[:, i] - mu - arrays(hyper, i)[3]) <= tolerance(cond, 1e-9) * Y[:, i].std()
        ).all()
        # scikit-learn subtracts in the same way, so its own rounding may be as large: twice the tolerance.
        assert (np.abs(variances(p, queries)[:, i] - std**2) <= 2 * tolerance(cond, 1e-8) * std**2).all()
        assert abs(gp.log_likelihood(p)[i] - model.log_marginal_likelihood_value_) <= 1e-8 * len(X)


@given(seeds)
@settings(max_examples=10)
def test_leave_one_out_equals_conditioning_without(seed):
    X, Y, hyper, _ = problem(seed, N=20)
    residual, variance = gp.leave_one_out(gp.condition(X, Y, hyper, 24))
    for k in range(20):
        rest = gp.condition(np.delete(X, k, 0), np.delete(Y, k, 0), hyper)
        x = jnp.asarray(X[k])
        std = np.sqrt(np.asarray(hyper.signal_variance))
        assert (np.abs(Y[k] - gp.mean(rest, x) - residual[:, k]) <= 1e-9 * std).all()
        np.testing.assert_allclose(variance[:, k], gp.variance(rest, x) + hyper.noise_variance, rtol=1e-8)
    assert (residual[:, 20:] == 0).all()


# -- append and remove -------------------------------------------------------------------------------------------


@pytest.mark.parametrize("noise", [1e-1, 1e-4, 1e-8])
@pytest.mark.parametrize("seed", range(3))
def test_append_equals_conditioning(seed, noise):
    X, Y, hyper, queries = problem(seed, N=60, noise=noise)
    p = gp.condition(X[:20], Y[:20], hyper, 64)
    for x, y in zip(jnp.asarray(X[20:]), jnp.asarray(Y[20:]), strict=True):
        p, _ = gp.append(p, x, y)
    cond = [np.linalg.cond(gram(X, hyper, i)) for i in range(3)]
    assert_same_posterior(gp.condition(X, Y, hyper, 64), p, queries, cond, 1e-10)


@given(seeds, st.integers(0, 29), st.sampled_from([30, 37]))
@settings(max_examples=20)
def test_remove_equals_conditioning_without(seed, k, capacity):
    X, Y, hyper, queries = problem(seed, N=30)
    p, removed = gp.remove(gp.condition(X, Y, hyper, capacity), jnp.asarray(k))
    fresh = gp.condition(np.delete(X, k, 0), np.delete(Y, k, 0), hyper, capacity)
    assert bool(removed)
    cond = [np.linalg.cond(gram(X, hyper, i)) for i in range(3)]
    assert_same_posterior(fresh, p, queries, cond, 1e-10)
    assert (p.X == fresh.X).all()
    assert (p.Y == fresh.Y).all()
    np.testing.assert_allclose(
        p.inverse_cholesky, fresh.inverse_cholesky, rtol=1e-8, atol=1e-9 * float(jnp.abs(fresh.inverse_cholesky).max())
    )


def test_hundred_append_remove_cycles_stay_accurate():
    X, Y, hyper, queries = problem(5, N=200, noise=1e-3)
    p, kept, rng = gp.condition(X[:100], Y[:100], hyper, 100), list(range(100)), np.random.default_rng(0)
    for new in range(100, 200):
        k = int(rng.integers(100))
        p, _ = gp.remove(p, jnp.asarray(k))
        p, _ = gp.append(p, jnp.asarray(X[new]), jnp.asarray(Y[new]))
        del kept[k]
        kept.append(new)
    fresh = gp.condition(X[kept], Y[kept], hyper)
    cond = [np.linalg.cond(gram(X[kept], hyper, i)) for i in range(3)]
    assert (p.X == fresh.X).all()
    assert_same_posterior(fresh, p, queries, cond, 1e-8)
    scale = np.abs(fresh.inverse_cholesky).max(axis=(1, 2), keepdims=True)
    assert (np.abs(p.inverse_cholesky - fresh.inverse_cholesky) <= 1e-8 * scale).all()


def test_removing_all_points_leaves_the_prior():
    X, Y, hyper, queries = problem(2, N=5)
    p = gp.condition(X, Y, hyper, 6)
    for _ in range(5):
        p, _ = gp.remove(p, jnp.asarray(0))
    for a, b in zip(jax.tree.leaves(p), jax.tree.leaves(gp.prior(hyper, 6)), strict=True):
        np.testing.assert_array_equal(a, b)
    assert not bool(gp.remove(p, jnp.asarray(0))[1])
    assert (means(p, queries) == np.asarray(hyper.constant_mean)).all()


def test_invalid_append_and_remove_change_nothing():
    """Points that cannot be appended or removed are refused, and nothing changes."""
    X, Y, hyper, _ = problem(3, N=5)
    p = gp.condition(X, Y, hyper, 6)
    x, y = jnp.asarray(X[0]), jnp.asarray(Y[0])
    full, accepted = gp.append(p, x, y)
    assert bool(accepted)
    refused = [
        gp.append(full, x, y),
        gp.append(p, x.at[1].set(jnp.nan), y),
        gp.append(p, x, y.at[0].set(jnp.inf)),
        gp.remove(p, jnp.asarray(5)),
        gp.remove(p, jnp.asarray(-1)),
    ]
    for (after, accepted), before in zip(refused, [full, p, p, p, p], strict=True):
        assert not bool(accepted)
        for a, b in zip(jax.tree.leaves(after), jax.tree.leaves(before), strict=True):
            np.testing.assert_array_equal(a, b)


def compilations(caplog, work):
    """Return the number of programs that XLA compiled during `work()`."""
    caplog.clear()
    with jax.log_compiles(), caplog.at_level(logging.WARNING):
        work()
    return sum("Finished XLA compilation" in record.getMessage() for record in caplog.records)


@pytest.mark.filterwarnings("ignore")
def test_appends_do_not_recompile(caplog):
    X, Y, hyper, _ = problem(4, N=101)
    points = list(zip(jnp.asarray(X), jnp.asarray(Y), strict=True))
    p, _ = gp.append(gp.prior(hyper, 101), *points[0])
    gp.mean(p, points[0][0]), gp.variance(p, points[0][0])

    def hundred():
        q = p
        for x, y in points[1:]:
            q, _ = gp.append(q, x, y)
            gp.mean(q, x), gp.variance(q, x)
        assert int(q.num_points) == 101

    assert compilations(caplog, hundred) == 0
    other = gp.prior(hyper, 99)
    assert compilations(caplog, lambda: gp.append(other, *points[0])) > 0  # the counter works


# -- invalid data ------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda X, Y: (np.where(np.arange(4) == 2, np.nan, X), Y), r"X\[0, 2\] = nan"),
        (lambda X, Y: (X, np.where(np.arange(3) == 1, np.inf, Y)), r"Y\[0, 1\] = inf"),
        (lambda X, Y: (X * 1e200, Y), r"at most 1e\+100"),
        (lambda X, Y: (X[:-1], Y), "one N"),
        (lambda X, Y: (X[:, 0], Y), "one N"),
        (lambda X, Y: (X[:, :3], Y), "4 dimensions and 3 outputs"),
        (lambda X, Y: (np.tile(X, (2, 1)), np.tile(Y, (2, 1))), "capacity is 50"),
    ],
)
def test_invalid_data_are_refused(change, message):
    X, Y, hyper, _ = problem(0)
    with pytest.raises(ValueError, match=message):
        gp.condition(*change(X, Y), hyper, 50)


def test_singular_gram_matrix_is_refused():
    X, Y, _, _ = problem(0)
    hyper = gp.make_hyperparameters(np.ones(3), np.full(4, 1e6), 5e-14)
    with pytest.raises(ValueError, match=r"output 0: .*not be positive definite.* use noise_variance >="):
        gp.condition(X, Y, hyper)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((-1.0, [1.0], 0.1), "signal_variance"),
        ((1.0, [1.0, np.nan], 0.1), "lengthscales"),
        ((1.0, [1.0], 0.0), "noise_variance"),
        ((1.0, [1.0], 0.1, np.inf), "constant_mean"),
        (([1.0, 2.0], [1.0], [0.1, 0.1, 0.1]), "signal_variance has shape"),
        (([1.0, 2.0], np.ones((3, 4)), 0.1), "signal_variance has shape"),
    ],
)
def test_invalid_hyperparameters_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        gp.make_hyperparameters(*arguments)


@pytest.mark.parametrize("copies", [2, 20])
def test_duplicates_are_averaged(copies):
    """Equal inputs with noise v act as one input with the mean label and noise v / m."""
    X, Y, hyper, queries = problem(6, N=10)
    rng = np.random.default_rng(0)
    many = np.repeat(Y, copies, axis=0) + 0.1 * rng.normal(size=(10 * copies, 3))
    p = gp.condition(np.repeat(X, copies, axis=0), many, hyper)
    fewer = gp.make_hyperparameters(
        hyper.signal_variance, hyper.lengthscales, hyper.noise_variance / copies, hyper.constant_mean
    )
    q = gp.condition(X, many.reshape(10, copies, 3).mean(1), fewer)
    std = np.sqrt(np.asarray(hyper.signal_variance))
    assert (np.abs(means(p, queries) - means(q, queries)) <= 1e-9 * std).all()
    np.testing.assert_allclose(variances(p, queries), variances(q, queries), rtol=1e-8)


def test_one_point_equals_the_closed_form():
    hyper = gp.make_hyperparameters(2.0, [3.0], 0.5, 1.0)
    p = gp.condition([[0.0]], [[4.0]], hyper, 3)
    k = 2 * np.exp(-0.5 * (1.5 / 3) ** 2)
    np.testing.assert_allclose(gp.mean(p, jnp.asarray([1.5])), [1 + k * 3 / 2.5], rtol=1e-14)
    np.testing.assert_allclose(gp.variance(p, jnp.asarray([1.5])), [2 - k * k / 2.5], rtol=1e-14)


@jax.jit
def append_all(p, X, Y):
    """Append points in their order and return which were accepted."""

    def step(p, point):
        return gp.append(p, *point)

    return jax.lax.scan(step, p, (X, Y))


@pytest.mark.parametrize("lengthscale", [0.05, 0.5, 2.0, 10.0])
@pytest.mark.parametrize("ordered", [True, False])
def test_dense_points_at_minimal_noise_are_accurate(lengthscale, ordered):
    """With minimal admissible noise `E = W K W^T - I` stays small, and the prediction error is that implied by E.

    `K^-1 = W^T (I + E)^-1 W` exactly, so a mean is off by at most `|E| / (1 - |E|) |W k| |W y|`, and the last two are
    at most the kernel's and the function's norm, here 1.
    """
    N = 200
    rng = np.random.default_rng(0)
    X = np.linspace(0, 1, N) if ordered else rng.permutation(np.linspace(0, 1, N))
    centers, weights = rng.uniform(0, 1, 3), rng.normal(size=3)

    def kernel(a, b, kind=float):
        return np.exp(-kind(0.5) * (np.subtract.outer(a.astype(kind), b.astype(kind)) / kind(lengthscale)) ** 2)

    weights /= np.sqrt(weights @ kernel(centers, centers) @ weights)  # norm 1
    y, queries = kernel(X, centers) @ weights, np.linspace(0, 1, 300)
    noise = min_noise_ratio_for_append(N)
    p = gp.prior(gp.make_hyperparameters(1.0, [lengthscale], noise), N)
    p, kept = append_all(p, jnp.asarray(X)[:, None], jnp.asarray(y)[:, None])
    assert kept.all()
    W = np.asarray(p.inverse_cholesky[0]).astype(np.longdouble)
    E = (W @ (kernel(X, X, np.longdouble) + noise * np.eye(N)) @ W.T - np.eye(N)).astype(float)
    loss = np.linalg.norm(E, 2)
    assert loss < 0.25
    Wk, Wy = (W @ kernel(X, queries, np.longdouble)).astype(float), (W @ y).astype(float)
    expected = Wk.T @ np.linalg.solve(np.eye(N) + E, Wy)
    found = means(p, jnp.asarray(queries)[:, None])[:, 0]
    assert np.abs(found - expected).max() <= loss / (1 - loss) * np.linalg.norm(Wk, axis=0).max() * np.linalg.norm(Wy)
    assert (variances(p, jnp.asarray(queries)[:, None]) >= 0).all()


def test_noise_beyond_working_precision_is_refused():
    hyper = gp.make_hyperparameters(1.0, [10.0], 1e-14)
    for refused in (lambda: gp.prior(hyper, 200), lambda: gp.condition(np.ones((2, 1)), np.ones((2, 1)), hyper, 200)):
        with pytest.raises(ValueError, match=r"output 0: .*200 points.*use noise_variance >= 4.4e-13"):
            refused()


@pytest.mark.parametrize("noise", [0.5, 1e-3, 1e-7])
def test_append_refuses_too_small_noise(noise):
    """With less noise `append` must refuse rather than divide by rounding errors, and the factor stays unchanged."""
    N = 200
    valid = gp.prior(gp.make_hyperparameters(1.0, [10.0], 1.0), N)
    too_small = dataclasses.replace(valid.hyper, noise_variance=jnp.asarray([noise * min_noise_ratio_for_append(N)]))
    X = jnp.linspace(0, 1, N)[:, None]
    p, kept = append_all(dataclasses.replace(valid, hyper=too_small), X, jnp.sin(X))
    assert not kept.any()
    assert int(p.num_points) == 0
    assert (variances(p, X) == 1).all()


# -- arguments ---------------------------------------------------------------------------------------------------


@pytest.fixture
def unchecked():
    """Reload the module as shipped, without the import hook that checks shapes."""
    jaxtyping.config.update("jaxtyping_disable", True)
    jax.clear_caches()
    yield
    jaxtyping.config.update("jaxtyping_disable", False)
    jax.clear_caches()


T, NOW = jnp.zeros(()), jnp.array(True)


@pytest.mark.parametrize("shape", [(), (1,), (3,), (5,), (1, 4), (4, 1), (2, 4)])
def test_input_of_another_shape_is_refused(shape, unchecked):
    X, Y, hyper, _ = problem(0, N=5)
    p, x, y = gp.condition(X, Y, hyper, 6), jnp.ones(shape), jnp.asarray(Y[0])
    data, key, gate = gp.empty_dataset(4, 4, 3), jax.random.key(0), jnp.asarray(0.1)
    calls = [
        lambda: gp.mean(p, x),
        lambda: gp.variance(p, x),
        lambda: gp.append(p, x, y),
        lambda: gp.max_variance_subset(p, x, y, gate),
        lambda: gp.sliding_window(data, x, y, T, NOW),
        lambda: gp.ReservoirSampling(key=key)(data, x, y, T, NOW),
        lambda: gp.error_bounds.error_radius(p, x, jnp.ones(3)),
    ]
    for call in calls:
        with pytest.raises(ValueError, match=rf"x has shape {re.escape(str(shape))}: must be an array of shape \(4,\)"):
            call()


@pytest.mark.parametrize("shape", [(), (1,), (4,), (1, 3), (2, 3)])
def test_output_of_another_shape_is_refused(shape, unchecked):
    X, Y, hyper, _ = problem(0, N=5)
    p, x, y = gp.condition(X, Y, hyper, 6), jnp.asarray(X[0]), jnp.ones(shape)
    data = gp.empty_dataset(4, 4, 3)
    for call in (
        lambda: gp.append(p, x, y),
        lambda: gp.max_variance_subset(p, x, y, jnp.asarray(0.1)),
        lambda: gp.sliding_window(data, x, y, T, NOW),
        lambda: gp.ReservoirSampling(key=jax.random.key(0))(data, x, y, T, NOW),
    ):
        with pytest.raises(ValueError, match=rf"y has shape {re.escape(str(shape))}: must be an array of shape \(3,\)"):
            call()


def test_other_invalid_arguments_are_refused(unchecked):
    X, Y, hyper, _ = problem(0, N=5)
    p, x, y = gp.condition(X, Y, hyper, 6), jnp.asarray(X[0]), jnp.asarray(Y[0])
    stacked = jax.tree.map(lambda a: jnp.stack([a, a]), p)
    for call, message in (
        (lambda: gp.mean(p, list(X[0])), r"x is a list: must be an array of shape \(4,\)"),
        (lambda: gp.mean(p, x.astype(complex)), "x has type complex128: must be real"),
        (lambda: gp.mean(stacked, x), r"batch axes \(2,\): use jax.vmap"),
        (lambda: gp.predict(stacked, x[None]), r"batch axes \(2,\): use jax.vmap"),
        (lambda: gp.predict(p, x), r"x has shape \(4,\): must be an array of shape \('points', 4\), one row"),
        (lambda: gp.predict(p, jnp.ones((7, 3))), r"x has shape \(7, 3\): must be an array of shape \(7, 4\)"),
        (lambda: gp.max_variance_subset(p, x, y, jnp.ones(2)), r"gate has shape \(2,\)"),
        (lambda: gp.remove(p, jnp.asarray([1, 2])), r"i has shape \(2,\)"),
    ):
        with pytest.raises(ValueError, match=message):
            call()
    assert jax.vmap(gp.mean)(stacked, jnp.stack([x, x])).shape == (2, 3)


@pytest.mark.parametrize("huge", [1e308, -1e308, 1.0000001e100, np.inf, np.nan])
def test_values_out_of_range_are_refused(huge):
    """Values out of range are refused, and nothing changes."""
    X, Y, hyper, queries = problem(3, N=5)
    p, x, y = gp.condition(X, Y, hyper, 6), jnp.asarray(X[0]), jnp.asarray(Y[0])
    for bad in ((x.at[1].set(huge), y), (x, y.at[2].set(huge))):
        for after, accepted in (gp.append(p, *bad), gp.max_variance_subset(p, *bad, jnp.asarray(1e-300))):
            assert not bool(accepted)
            for a, b in zip(jax.tree.leaves(after), jax.tree.leaves(p), strict=True):
                np.testing.assert_array_equal(a, b)
        with pytest.raises(ValueError, match=r"must be finite, at most 1e\+100"):
            gp.condition(np.asarray(bad[0])[None], np.asarray(bad[1])[None], hyper)
    large, accepted = gp.append(p, x, y.at[2].set(1e100))
    assert bool(accepted)
    assert np.isfinite(means(large, queries)).all()
    assert np.isfinite(gp.log_likelihood(large)).all()


def test_outputs_too_large_for_the_noise_are_refused():
    hyper = gp.make_hyperparameters(1e-190, [1.0], 1e-195)
    with pytest.raises(ValueError, match=r"output 0: Y of magnitude 1e\+90 .* noise_variance = 1e-195"):
        gp.condition([[0.0]], [[1e90]], hyper)
    p = gp.prior(hyper, 2)
    after, accepted = gp.append(p, jnp.zeros(1), jnp.asarray([1e90]))
    assert not bool(accepted)
    assert (after.alpha == 0).all()


@pytest.mark.parametrize(("points", "N"), [(0, 12), (1, 0), (130, 12), (130, 7)])
def test_predict_returns_mean_and_variance(points, N):
    X, Y, hyper, _ = problem(N, N=12)
    p = gp.condition(X[:N], Y[:N], hyper, 12)
    x = jnp.asarray(np.random.default_rng(N).normal(size=(points, 4)) * X.std(0) + X[:1])
    mu, sigma2 = gp.predict(p, x)
    assert mu.shape == sigma2.shape == (points, 3)
    if points:
        np.testing.assert_allclose(mu, means(p, x), rtol=1e-9, atol=1e-9 * float(jnp.abs(p.Y).max()))
        s = np.asarray(hyper.signal_variance)
        assert (np.abs(sigma2 - variances(p, x)) <= 1e-9 * s).all()


def test_predict_in_batches_returns_mean_and_variance(monkeypatch):
    X, Y, hyper, _ = problem(1, N=30)
    p, x = gp.condition(X, Y, hyper, 37), jnp.asarray(np.tile(X, (5, 1)))
    whole = gp.predict(p, x)
    monkeypatch.setattr(posterior, "MIN_BLOCKS_FOR_STRIPS", 0)
    jax.clear_caches()
    for a, b in zip(gp.predict(p, x), whole, strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * float(jnp.abs(b).max()))


# -- files -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("N", [0, 20, 30])
def test_saved_data_and_hyperparameters_are_bit_exact(tmp_path, N):
    """A loaded GP has the same data and hyperparameters bit by bit."""
    X, Y, hyper, queries = problem(7, N=30)
    p = gp.condition(X[:N], Y[:N], hyper, 30)
    gp.save_gp(p, tmp_path / "a.npz")
    q = gp.load_gp(tmp_path / "a.npz")
    assert jax.tree.structure(p) == jax.tree.structure(q)
    for a, b in zip(
        jax.tree.leaves((p.hyper, p.X, p.Y, p.num_points)),
        jax.tree.leaves((q.hyper, q.X, q.Y, q.num_points)),
        strict=True,
    ):
        assert a.dtype == b.dtype
        np.testing.assert_array_equal(a, b)
    cond = [np.linalg.cond(gram(X, hyper, i)) for i in range(3)]
    assert_same_posterior(p, q, queries, cond, 1e-10)
    assert [f.name for f in tmp_path.iterdir()] == ["a.npz"]


@given(seeds)
@settings(max_examples=5)
def test_saved_gp_after_append_and_remove(tmp_path_factory, seed):
    """A GP after append and remove is loaded equal to rounding."""
    X, Y, hyper, queries = problem(seed, N=20)
    p, _ = gp.append(gp.condition(X[:19], Y[:19], hyper, 30), jnp.asarray(X[19]), jnp.asarray(Y[19]))
    p, _ = gp.remove(p, jnp.asarray(3))
    path = tmp_path_factory.mktemp("gp") / "a.npz"
    gp.save_gp(p, path)
    cond = [np.linalg.cond(gram(X, hyper, i)) for i in range(3)]
    assert_same_posterior(p, gp.load_gp(path), queries, cond, 1e-10)


@pytest.mark.parametrize("umask", [0o022, 0o077, 0o027])
def test_saved_file_respects_the_umask(tmp_path, umask):
    before = os.umask(umask)
    try:
        gp.save_gp(gp.prior(gp.make_hyperparameters(1.0, [1.0], 0.1), 3), tmp_path / "a.npz")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "a.npz").stat().st_mode) == 0o666 & ~umask


def test_damaged_file_is_refused_or_read_exactly(tmp_path):
    """Thousands of flipped, cut, inserted and zeroed bytes: ValueError with the path, or every bit as saved."""
    X, Y, hyper, _ = problem(7, N=6)
    p = gp.condition(X, Y, hyper, 8)
    path = tmp_path / "a.npz"
    gp.save_gp(p, path)
    whole, rng = path.read_bytes(), np.random.default_rng(0)

    def damaged(k):
        content = bytearray(whole)
        at, end = sorted(rng.integers(0, len(whole), 2))
        match k % 5:
            case 0:
                content[at] ^= 1 << int(rng.integers(8))
            case 1:
                del content[at:]
            case 2:
                for i in rng.integers(0, len(whole), 4):
                    content[i] = int(rng.integers(256))
            case 3:
                content[at:end] = bytes(int(end - at))
            case 4:
                content[at:at] = rng.bytes(int(rng.integers(1, 9)))
        return bytes(content)

    arrays = serialization._read_arrays(whole)
    refused = 0
    for k in range(3000):
        try:
            read = serialization._read_arrays(damaged(k))
            serialization._validate_arrays(read)
        except ValueError as error:
            assert str(error)
            refused += 1
        else:
            for name, array in arrays.items():
                np.testing.assert_array_equal(read[name], array)
    assert refused > 1500
    for k in range(40):  # the entry point, which adds the path
        path.write_bytes(damaged(k))
        try:
            gp.load_gp(path)
        except ValueError as error:
            assert str(error).startswith(f"{path}: ")


WRONG = {
    "nan input": ({"X": lambda a: np.where(a == a[0, 0], np.nan, a)}, r"X\[0, 0\] = nan"),
    "huge output": ({"Y": lambda a: a + 1e308}, "Y.*at most"),
    "missing rows": ({"Y": lambda a: a[:-1]}, "one N"),
    "missing column": ({"Y": lambda a: a[:, :-1]}, "signal_variance has shape"),
    "flat": ({"X": lambda a: a.ravel()}, r"X \(24,\)"),
    "no outputs": ({"Y": lambda a: a[:, :0]}, "at least one"),
    "negative noise": ({"noise_variance": lambda a: -a}, "noise_variance"),
    "nan noise": ({"noise_variance": lambda a: np.nan * a}, "noise_variance"),
    "no noise": ({"noise_variance": lambda a: 1e-30 * a}, "noise_variance"),
    "zero length": ({"lengthscales": lambda a: 0 * a}, "lengthscales"),
    "turned lengths": ({"lengthscales": lambda a: a.T}, "lengthscales has shape"),
    "infinite constant mean": ({"constant_mean": lambda a: a + np.inf}, "constant_mean"),
    "scalar signal": ({"signal_variance": lambda a: a[0]}, "signal_variance has shape"),
    "single precision": ({"X": lambda a: a.astype(np.float32)}, "X has type float32: must be float64"),
    "complex": ({"Y": lambda a: a + 1j}, "Y has type complex128"),
    "text": ({"constant_mean": lambda a: np.asarray(["a", "b", "c"])}, "constant_mean has type"),
    "capacity of 5": ({"capacity": lambda a: a - 3}, "capacity = 5: must be at least 6"),
    "negative capacity": ({"capacity": lambda a: -a}, "capacity = -8"),
    "endless capacity": ({"capacity": lambda a: a + 2**61}, "and at most 18918 for 3 outputs"),
    "broken capacity": ({"capacity": lambda a: a + 0.5}, "capacity has type float64"),
    "two capacities": ({"capacity": lambda a: np.stack([a, a])}, "capacity has shape"),
    "format 1": ({"format": lambda a: np.asarray("colift gp 1")}, "format is colift gp 1"),
    "formats": ({"format": lambda a: np.stack([a, a])}, "format is"),
    "no format": ({"format": None}, "format is not stated"),
    "no X": ({"X": None}, "contains .*: must contain"),
    "more": ({"alpha": lambda a: np.ones(3)}, "contains .*alpha.*: must contain"),
    "objects": ({"X": lambda a: a.astype(object)}, "not a GP file"),
}


@pytest.mark.parametrize("case", WRONG)
def test_invalid_stored_values_are_refused(tmp_path, case):
    changes, message = WRONG[case]
    X, Y, hyper, _ = problem(7, N=6)
    gp.save_gp(gp.condition(X, Y, hyper, 8), tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as file:
        arrays = dict(file)
    for name, change in changes.items():
        before = arrays.pop(name, None)
        if change is not None:
            arrays[name] = change(before)
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(ValueError, match=rf"a\.npz: .*{message}"):
        gp.load_gp(tmp_path / "a.npz")


def test_files_of_other_origin_are_refused(tmp_path):
    path = tmp_path / "a.npz"
    gp.save_gp(gp.prior(gp.make_hyperparameters(1.0, [1.0], 0.1), 3), path)
    with np.load(path) as file:
        arrays = dict(file)
    np.savez_compressed(path, **arrays)
    with pytest.raises(ValueError, match=r"a\.npz: not a GP file .*compressed"):
        gp.load_gp(path)
    with pytest.raises(FileNotFoundError):
        gp.load_gp(tmp_path / "b.npz")
    with pytest.raises(IsADirectoryError):
        gp.load_gp(tmp_path)


def test_unloadable_gp_is_not_saved(tmp_path):
    X, Y, hyper, _ = problem(7, N=6)
    p = gp.condition(X, Y, hyper, 8)
    for bad in (
        dataclasses.replace(p, X=p.X.at[2, 1].set(jnp.nan)),
        dataclasses.replace(p, hyper=dataclasses.replace(hyper, noise_variance=-hyper.noise_variance)),
    ):
        with pytest.raises(ValueError, match="must be finite"):
            gp.save_gp(bad, tmp_path / "a.npz")
    assert not list(tmp_path.iterdir())


def test_failed_save_keeps_the_old_file(tmp_path, monkeypatch):
    X, Y, hyper, _ = problem(7, N=20)
    p = gp.condition(X, Y, hyper)
    gp.save_gp(p, tmp_path / "a.npz")
    before = (tmp_path / "a.npz").read_bytes()

    def full_disk(descriptor):
        raise OSError(28, "no space left on device")

    monkeypatch.setattr(os, "fsync", full_disk)
    with pytest.raises(OSError, match="no space"):
        gp.save_gp(gp.prior(hyper, 3), tmp_path / "a.npz")
    assert (tmp_path / "a.npz").read_bytes() == before
    assert [f.name for f in tmp_path.iterdir()] == ["a.npz"]


@pytest.mark.parametrize("content", [b"", b"nonsense", b"PK\x03\x04 torn"])
def test_other_file_is_refused(tmp_path, content):
    (tmp_path / "a.npz").write_bytes(content)
    with pytest.raises(ValueError, match=r"a\.npz: not a GP file"):
        gp.load_gp(tmp_path / "a.npz")


def test_other_npz_is_refused(tmp_path):
    np.savez(tmp_path / "a.npz", x=np.ones(3))
    with pytest.raises(ValueError, match="format is not stated"):
        gp.load_gp(tmp_path / "a.npz")
    np.savez(tmp_path / "b.npz", x=np.array([{}], dtype=object))
    with pytest.raises(ValueError, match="not a GP file"):
        gp.load_gp(tmp_path / "b.npz")


def test_batch_is_not_saved(tmp_path):
    _, _, hyper, _ = problem(7)
    p = gp.prior(hyper, 3)
    with pytest.raises(ValueError, match="batch axes"):
        gp.save_gp(jax.tree.map(lambda a: a[None], p), tmp_path / "a.npz")
