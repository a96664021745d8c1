"""Tests of error bounds: against independent computations, attained where they are tight, and never violated."""

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colift import gp
from colift.gp import error_bounds, optimal_recovery
from colift.gp.error_bounds import REQUIRED_ASSUMPTIONS, BoundAssumption, unsatisfied
from evidence import coverage
from tests.support.gp_problems import arrays, forward, gram, problem

seeds = st.integers(0, 2**31)


def member(seed, N=25, dimensions=2, eps_share=0.1, bias=0.0):
    """Functions of the RKHS with the stated norms, noise at its limit `eps`, and the posterior: (f, B, eps, gp, x)."""
    rng = np.random.default_rng(seed)
    _, _, hyper, _ = problem(seed, N=2, dimensions=dimensions, outputs=2)
    ls = np.asarray(hyper.lengthscales)
    s, offset = np.asarray(hyper.signal_variance), np.asarray(hyper.constant_mean)
    scale = ls.mean(0)
    X, Z, x = (rng.uniform(-1, 1, (n, dimensions)) * 2 * scale for n in (N, 8, 1))
    B, eps = rng.uniform(0.3, 3, 2), eps_share * s**0.5
    a = rng.normal(size=(2, 8))

    def k(i, P, Q):
        return s[i] * np.exp(-0.5 * (((P[:, None] - Q[None]) / ls[i]) ** 2).sum(-1))

    for i in range(2):
        a[i] *= B[i] / np.sqrt(a[i] @ k(i, Z, Z) @ a[i])

    def f(P):
        return offset + np.stack([k(i, P, Z) @ a[i] for i in range(2)], axis=-1)

    sign = np.where(rng.uniform(size=(N, 2)) < 0.5 + 0.5 * bias, 1, -1)
    hyper = dataclasses.replace(hyper, noise_variance=jnp.asarray(eps**2))
    return f, B, eps, gp.condition(X, f(X) + eps * sign, hyper), x


def error(f, p, x):
    return np.abs(f(x)[0] - np.asarray(gp.mean(p, jnp.asarray(x[0]))))


def deviation(p, x):
    return np.sqrt(np.asarray(gp.variance(p, jnp.asarray(x[0]))))


def log_det(p, i, scale=1.0):
    """Return `ln det(scale (I + K_f / v))` by NumPy from the entries."""
    n, v = int(p.num_points), arrays(p.hyper, i)[2]
    return np.linalg.slogdet(scale * gram(np.asarray(p.X)[:n], p.hyper, i) / v)[1]


# -- bounded noise -----------------------------------------------------------------------------------------------


@given(seeds)
@settings(max_examples=15)
def test_energy_bound_is_attained(seed):
    """`g = m + beta k_n(., x) / sigma(x)` uses all of `B^2 + E^2 / v` and has the error `beta sigma` at x.

    So no smaller factor follows from what the bound uses, `||g||^2 + |r - g(X)|^2 / v <= B^2 + E^2 / v`.
    """
    _, B, eps, p, x = member(seed)
    beta = np.asarray(error_bounds.bounded_energy(p, B, eps))
    X, n = np.asarray(p.X), int(p.num_points)
    for i in range(2):
        s, ls, v, offset = arrays(p.hyper, i)
        both = np.vstack([X, x])
        K = s * np.exp(-0.5 * (((both[:, None] - both[None]) / ls) ** 2).sum(-1))
        k = K[:n, n]
        c = np.linalg.solve(K[:n, :n] + v * np.eye(n), np.column_stack([np.asarray(p.Y)[:, i] - offset, k]))
        sigma = np.sqrt(s - k @ c[:, 1])
        of_g = np.append(c[:, 0] - beta[i] / sigma * c[:, 1], beta[i] / sigma)  # coefficients on X and x
        g = K @ of_g
        spent = of_g @ K @ of_g + np.sum((np.asarray(p.Y)[:, i] - offset - g[:n]) ** 2) / v
        np.testing.assert_allclose(spent, B[i] ** 2 + n * eps[i] ** 2 / v, rtol=1e-7)
        reached = g[n] + offset - float(gp.mean(p, jnp.asarray(x[0]))[i])
        np.testing.assert_allclose(reached, beta[i] * sigma, rtol=1e-6)


@given(seeds, st.sampled_from([0.0, 0.5, 1.0]))
@settings(max_examples=25)
def test_bounds_for_bounded_noise_hold_for_any_bias(seed, bias):
    f, B, eps, p, x = member(seed, bias=bias)
    radius = np.asarray(error_bounds.bounded_energy(p, B, eps)) * deviation(p, x)
    assert (error(f, p, x) <= radius).all()
    n, mean = int(p.num_points), np.asarray(gp.mean(p, jnp.asarray(x[0])))
    for i in range(2):
        possible = optimal_recovery.recovery_interval(
            np.asarray(p.X)[:n], np.asarray(p.Y)[:n], p.hyper, i, B[i], eps[i], x
        )
        assert possible.lower <= f(x)[0, i] <= possible.upper
        # Bounded samples have bounded energy, so the optimal interval lies in the other, up to solver tolerance.
        assert possible.radius(mean[i]) <= radius[i] * (1 + 1e-4)


def extreme_posterior(X, y, x, hyper, B, eps):
    """Return posterior mean, standard deviation and beta^2 at x by mpmath; an admissible function attains mean +
    beta std.
    """
    s, ls, v, offset = (mpmath.mpmathify(a) if np.ndim(a) == 0 else a for a in arrays(hyper, 0))

    def k(a, b):
        r2 = sum(((mpmath.mpf(p) - mpmath.mpf(q)) / mpmath.mpf(w)) ** 2 for p, q, w in zip(a, b, ls, strict=True))
        return s * mpmath.exp(-r2 / 2)

    points = X.tolist()
    K = mpmath.matrix([[k(a, b) + (v if i == j else 0) for j, b in enumerate(points)] for i, a in enumerate(points)])
    L = mpmath.cholesky(K)
    e = forward(L, mpmath.matrix([mpmath.mpf(float(t)) - offset for t in y]))
    u = forward(L, mpmath.matrix([k(x.tolist(), a) for a in points]))
    beta2 = mpmath.mpf(B) ** 2 + len(points) * mpmath.mpf(eps) ** 2 / v - mpmath.fdot(e, e)
    return offset + mpmath.fdot(u, e), mpmath.sqrt(s - mpmath.fdot(u, u)), beta2


@pytest.mark.parametrize(("ratio", "slack"), [(1e-2, 1e-8), (1e-6, 1e-4), (1e-9, 1e-2), (1e-11, 1.0), (2e-13, np.inf)])
@pytest.mark.parametrize("seed", range(3))
def test_bound_is_robust_to_rounding_for_small_noise(seed, ratio, slack):
    """The bound is above the value of an admissible function with 60 digits, and close to it."""
    rng, s = np.random.default_rng(seed), 10 ** np.random.default_rng(seed).uniform(-3, 3)
    n, D = 24, 1 + seed % 2
    X, Z, x = (rng.uniform(-1, 1, (m, D)) for m in (n, 5, 3))
    X[1:3], x[0] = X[0], X[3]  # two duplicates, and a query at a datum
    f = gp.from_expansion(gp.make_hyperparameters(s, [0.8] * D, 1e-3 * s), Z, rng.normal(size=(1, 5)) / s**0.5)
    B = float(gp.rkhs_norm(f)[0]) * (1 + 1e-9)
    eps = float(np.sqrt(ratio * s / n)) * B
    y = np.asarray(jax.vmap(gp.mean, (None, 0))(f, jnp.asarray(X))) + eps * rng.choice([-1, 1], (n, 1))
    p = gp.condition(X, y, gp.make_hyperparameters(s, [0.8] * D, ratio * s), n)
    beta = error_bounds.bounded_energy(p, B, eps)
    with mpmath.workdps(60):
        for point in x:
            mean, deviation, beta2 = extreme_posterior(X, y[:, 0], point, p.hyper, B, eps)
            flown = mpmath.mpf(float(gp.mean(p, jnp.asarray(point))[0]))
            reached = float(abs(mean - flown) + mpmath.sqrt(beta2) * deviation)
            radius = float(error_bounds.error_radius(p, jnp.asarray(point), beta)[0])
            assert reached <= radius <= reached * (1 + slack)


def test_energy_bound_without_data_is_the_norm():
    """Without data the bound is the norm; contradictory assumptions give no bound."""
    hyper = gp.make_hyperparameters(4.0, [1.0], 0.01)
    np.testing.assert_allclose(error_bounds.bounded_energy(gp.prior(hyper, 3), 1.5, 0.1), 1.5, rtol=1e-13)
    # |f| <= B sqrt(s) = 0.2, but the label is 5.
    p = gp.condition([[0.0]], [[5.0]], hyper)
    beta = error_bounds.bounded_energy(p, 0.1, 0.1)
    assert jnp.isinf(beta).all()
    assert jnp.isinf(error_bounds.vector_error_radius(p, jnp.zeros(1), beta))
    with pytest.raises(ValueError, match="the data contradict norm and noise_bound"):
        optimal_recovery.recovery_interval([[0.0]], [[5.0]], hyper, 0, 0.1, 0.1, [[0.5]])


def test_energy_under_jit_follows_appended_data():
    _, B, eps, p, _ = member(3)
    n = int(p.num_points)
    X, Y = np.asarray(p.X), np.asarray(p.Y)
    part = gp.condition(X[: n - 1], Y[: n - 1], p.hyper, capacity=n)
    grown, kept = gp.append(part, p.X[n - 1], p.Y[n - 1])
    assert kept
    jitted = jax.jit(lambda q: error_bounds.bounded_energy(q, B, eps))
    np.testing.assert_allclose(jitted(grown), error_bounds.bounded_energy(p, B, eps), rtol=1e-9)


# -- optimal recovery --------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("y", "gap"), [(0.9, 0.3), (-0.4, 0.8), (1.0, 0.05), (0.0, 1.5)])
def test_recovery_from_one_label_is_the_closed_form(y, gap):
    """Maximum of `c u + sqrt(1 - c^2) sqrt(B^2 s - u^2)` over values u at the label, with correlation c."""
    B, s, eps = 1.3, 0.7, 0.2
    hyper = gp.make_hyperparameters(s, [1.0], 1e-3, constant_mean=0.25)
    c = np.exp(-0.5 * gap**2)
    u = np.linspace(max(y - eps, -B * s**0.5), min(y + eps, B * s**0.5), 400_001)
    spread = np.sqrt(1 - c * c) * np.sqrt(np.maximum(B * B * s - u * u, 0))
    found = optimal_recovery.recovery_interval([[0.0]], [[y + 0.25]], hyper, 0, B, eps, [[gap]])
    np.testing.assert_allclose(found.upper, 0.25 + (c * u + spread).max(), atol=1e-5)
    np.testing.assert_allclose(found.lower, 0.25 + (c * u - spread).min(), atol=1e-5)


@given(seeds)
@settings(max_examples=8)
def test_recovery_is_attained_by_an_admissible_function(seed):
    """The dual value equals the primal value, in coordinates of NumPy's Cholesky factor."""
    import clarabel
    from scipy import sparse

    _, B, eps, p, x = member(seed, N=6, eps_share=0.3)
    s, ls, _, offset = arrays(p.hyper, 0)
    both = np.vstack([np.asarray(p.X), x])
    K = s * np.exp(-0.5 * (((both[:, None] - both[None]) / ls) ** 2).sum(-1))
    L = np.linalg.cholesky(K + 1e-9 * s * np.eye(7))
    r = np.asarray(p.Y)[:, 0] - offset
    settings = clarabel.DefaultSettings()
    settings.verbose = False
    rows = np.vstack([L[:6], -L[:6], np.zeros((1, 7)), -np.eye(7)])
    limits = np.concatenate([r + eps[0], eps[0] - r, [B[0]], np.zeros(7)])
    cones = [clarabel.NonnegativeConeT(12), clarabel.SecondOrderConeT(8)]
    solver = clarabel.DefaultSolver(sparse.csc_matrix((7, 7)), -L[6], sparse.csc_matrix(rows), limits, cones, settings)
    reached = offset + L[6] @ np.asarray(solver.solve().x)
    found = optimal_recovery.recovery_interval(p.X, p.Y, p.hyper, 0, B[0], eps[0], x).upper
    np.testing.assert_allclose(found, reached, atol=2e-4 * B[0] * s**0.5)


def test_recovery_of_functional_beats_sum_over_points():
    """The bound of a functional is below the sum over its points and scales linearly."""
    _, B, eps, p, x = member(11)
    Z = np.vstack([x + 0.3 * d * np.asarray(p.hyper.lengthscales)[0] for d in (-1, 0, 1)])
    arguments = (p.X, p.Y, p.hyper, 0, B[0], eps[0])
    a = np.array([0.25, 0.5, 0.25])
    whole = optimal_recovery.recovery_interval(*arguments, Z, a)
    parts = [optimal_recovery.recovery_interval(*arguments, z[None]) for z in Z]
    assert whole.upper <= sum(w * part.upper for w, part in zip(a, parts, strict=True)) + 1e-6
    twice = optimal_recovery.recovery_interval(*arguments, Z, -2 * a)
    np.testing.assert_allclose([twice.lower, twice.upper], [-2 * whole.upper, -2 * whole.lower], rtol=1e-4)


def functional(seed):
    """A functional of three points, the feasible set of output 0, and GP, norm and label error of the data."""
    _, B, eps, p, x = member(seed, N=12, eps_share=0.2)
    rng = np.random.default_rng(seed)
    ls = np.asarray(p.hyper.lengthscales)[0]
    Z, a = x + ls * rng.normal(size=(3, 2)) * 0.5, rng.normal(size=3)
    allowed = optimal_recovery.feasible_set(p.X, p.Y, p.hyper, 0, B[0], eps[0])
    C = np.exp(-0.5 * (((Z[:, None] - Z[None]) / ls) ** 2).sum(-1))
    return Z, a, allowed, allowed.correlations(Z) @ a, float(a @ C @ a), p, B[0], eps[0]


@given(seeds)
@settings(max_examples=10)
def test_maximum_is_attained_by_its_function(seed):
    """`weights` give a function that keeps norm and data within a thousandth and has that value."""
    Z, a, allowed, k, square, p, B, eps = functional(seed)
    mass = float(np.abs(a).sum())
    best = optimal_recovery.maximize_functional(allowed, k, square, mass)
    n = int(p.num_points)
    centers = np.vstack([np.asarray(p.X)[:n], Z])
    w = np.concatenate([best.weights[:n], best.weights[n] * a])
    h = p.hyper
    one = gp.make_hyperparameters(h.signal_variance[:1], h.lengthscales[:1], h.noise_variance[:1], h.constant_mean[:1])
    g = gp.from_expansion(one, centers, w[None])
    assert gp.rkhs_norm(g)[0] <= B * (1 + 1e-3)
    at = lambda P: np.asarray(jax.vmap(gp.mean, (None, 0))(g, jnp.asarray(P)))[:, 0]  # noqa: E731
    assert np.abs(np.asarray(p.Y)[:n, 0] - at(np.asarray(p.X)[:n])).max() <= eps * (1 + 1e-3)
    reached = a @ (at(Z) - float(h.constant_mean[0]))
    size = B * float(h.signal_variance[0]) ** 0.5 * square**0.5
    assert abs(best.value - reached) <= 1e-3 * size
    assert optimal_recovery.recovery_interval(p.X, p.Y, h, 0, B, eps, Z, a).upper == pytest.approx(
        best.value + float(h.constant_mean[0]) * a.sum(), abs=1e-9 * size
    )


@given(seeds)
@settings(max_examples=10)
def test_any_multipliers_give_an_upper_bound(seed):
    """Multipliers of a neighbor, random ones and zero; the optimal ones are those of `maximize_functional`."""
    Z, a, allowed, k, square, p, B, _ = functional(seed)
    f, _, _, _, _ = member(seed, N=12, eps_share=0.2)
    rng, mass = np.random.default_rng(seed), float(np.abs(a).sum())
    best = optimal_recovery.maximize_functional(allowed, k, square, mass)
    perturbed = best.nu[:, None] * (1 + 0.1 * rng.normal(size=(12, 4)))
    nu = np.column_stack([best.nu, perturbed, np.zeros(12), rng.normal(size=(12, 3))])
    found = optimal_recovery.dual_upper_bounds(
        allowed, nu, np.tile(k[:, None], (1, nu.shape[1])), *(np.full(nu.shape[1], x) for x in (square, mass))
    )
    true = a @ (f(Z)[:, 0] - float(p.hyper.constant_mean[0]))
    assert (found >= true).all()
    size = B * float(p.hyper.signal_variance[0]) ** 0.5 * square**0.5
    assert found[0] == pytest.approx(best.value, rel=1e-12, abs=1e-12 * size)
    assert (found >= best.value - 1e-4 * size).all()
    np.testing.assert_allclose(found[5], size, rtol=1e-9)


@given(seeds, st.sampled_from([0.01, 0.2, 0.5]))
@settings(max_examples=10)
def test_batched_bounds_are_nearly_minimal(seed, eps_share):
    """Each is above the value of an admissible function, and all but at most one of twenty are close to it.

    Seed 50191 with `eps_share` 0.5 has one that is 0.27 above; the bound holds but is not minimal.
    """
    _, B, eps, p, _ = member(seed, N=30, eps_share=eps_share)
    rng = np.random.default_rng(seed)
    ls = np.asarray(p.hyper.lengthscales)[0]
    allowed = optimal_recovery.feasible_set(p.X, p.Y, p.hyper, 0, B[0], eps[0])
    Z = np.asarray(p.X)[rng.integers(0, 30, 8)] + ls * rng.normal(size=(8, 2)) * 0.5
    W = rng.normal(size=(8, 20)) * (rng.random((8, 20)) < 0.4)
    W[:, 0] = 0.0  # empty functional
    C = np.exp(-0.5 * (((Z[:, None] - Z[None]) / ls) ** 2).sum(-1))
    k, square = allowed.correlations(Z) @ W, np.sum(W * (C @ W), axis=0)
    mass = np.abs(W).sum(0)
    found = optimal_recovery.minimize_upper_bounds(allowed, k, square, mass)
    best = np.array(
        [optimal_recovery.maximize_functional(allowed, each, square[j], mass[j]).value for j, each in enumerate(k.T)]
    )
    off = (found - best) / (allowed.unit * np.sqrt(np.maximum(square, 1e-3)))
    assert (off >= -1e-5).all()
    # with large label errors, about one of 1 800 bounds exceeds the optimum by 0.1 to 0.35
    assert np.sort(off)[-2] <= 0.05
    assert np.median(off) <= 0.02


@pytest.mark.parametrize("second", [-1.0, 0.76])  # clearly infeasible, and labels 2.4 eps apart at one point
def test_batched_bounds_refuse_contradictory_data(second: float):
    hyper = gp.make_hyperparameters(1.0, [1.0], 1e-3)
    allowed = optimal_recovery.feasible_set([[0.0], [0.0]], [[1.0], [second]], hyper, 0, 2.0, 0.1)
    with pytest.raises(ValueError, match="contradict norm and noise_bound"):
        optimal_recovery.minimize_upper_bounds(
            allowed, allowed.correlations(np.array([[0.0], [1.0]])), np.ones(2), np.ones(2)
        )


def test_nearly_cancelling_functional_is_bounded():
    """`f(z + h) - f(z)`: its square is lost in rounding and may be negative."""
    hyper = gp.make_hyperparameters(1.0, [1.0], 1e-3)
    allowed = optimal_recovery.feasible_set([[0.0], [0.5]], [[0.0], [0.3]], hyper, 0, 1.0, 0.05)
    h, g = 10.0 ** -np.arange(4, 10), np.array([0.7])
    k = np.stack([allowed.correlations(np.array([g + each, g])) @ [1.0, -1.0] for each in h], axis=1)
    square = np.array([2 - 2 * np.exp(-0.5 * ((0.7 + each) - 0.7) ** 2) for each in h])
    found = optimal_recovery.minimize_upper_bounds(allowed, k, square - 1e-16, np.full(len(h), 2.0))
    f = lambda z: 0.6 * z * np.exp(-(z**2) / 2)  # noqa: E731  0.6 times the kernel's slope at 0, of norm 0.6
    assert (found >= f(0.7 + h) - f(0.7)).all()
    one = optimal_recovery.maximize_functional(allowed, k[:, -1], -1e-17, 2.0)
    assert np.isfinite(one.value)


def test_empty_functional_is_zero():
    _, _, allowed, k, _, _, _, _ = functional(1)
    best = optimal_recovery.maximize_functional(allowed, 0 * k, 0.0, 0.0)
    assert 0 <= best.value <= 1e-4 * allowed.unit


def test_recovery_reports_invalid_arguments():
    hyper = gp.make_hyperparameters(1.0, [1.0], 1e-3)
    data = ([[0.0]], [[0.5]], hyper, 0)
    with pytest.raises(ValueError, match="norm = -1"):
        optimal_recovery.recovery_interval(*data, -1.0, 0.1, [[0.0]])
    with pytest.raises(ValueError, match="noise_bound = 0"):
        optimal_recovery.recovery_interval(*data, 1.0, 0.0, [[0.0]])
    with pytest.raises(ValueError, match=r"points \(2, 1\) and weights \(1,\)"):
        optimal_recovery.recovery_interval(*data, 1.0, 0.1, [[0.0], [1.0]])


# -- random noise ------------------------------------------------------------------------------------------------


@given(seeds, st.floats(0.05, 0.999))
@settings(max_examples=10)
def test_factors_equal_their_theorems(seed, confidence):
    _, B, R, p, _ = member(seed)
    n, t, T = int(p.num_points), -np.log1p(-confidence), 40
    gain = np.array([0.7, 31.0])
    for i in range(2):
        v = arrays(p.hyper, i)[2]
        w = max(1.0, v)
        stated = {
            "abbasi_yadkori": B[i] + R[i] / v**0.5 * np.sqrt(2 * t + log_det(p, i)),
            "fiedler": B[i] + R[i] / v**0.5 * np.sqrt(log_det(p, i, w) + 2 * t),
            "chowdhury_gopalan": B[i] + R[i] * np.sqrt((1 + 2 / T) / v * (log_det(p, i) + 2 + 2 * t)),
            "srinivas": np.sqrt(2 * B[i] ** 2 + 300 * gain[i] * np.log((n + 1) / (1 - confidence)) ** 3),
        }
        found = {
            "abbasi_yadkori": error_bounds.abbasi_yadkori(p, B, R, confidence),
            "fiedler": error_bounds.fiedler(p, B, R, confidence),
            "chowdhury_gopalan": error_bounds.chowdhury_gopalan(p, B, R, confidence, T),
            "srinivas": error_bounds.srinivas(p, B, confidence, jnp.asarray(gain)),
        }
        for name, beta in found.items():
            np.testing.assert_allclose(beta[i], stated[name], rtol=1e-8, err_msg=name)
        assert stated["abbasi_yadkori"] <= min(stated["fiedler"], stated["chowdhury_gopalan"])


def test_factor_of_the_paper_equals_its_equation():
    """Eq. beta_payload with m = 6 outputs, with 50 digits."""
    hyper = gp.make_hyperparameters(np.full(6, 1.3), [1.0, 2.0], 0.09)
    p = gp.condition(np.random.default_rng(0).normal(size=(30, 2)), np.zeros((30, 6)), hyper)
    gamma = error_bounds.max_information_gain(hyper, 31)
    beta = error_bounds.srinivas(p, 1.7, error_bounds.product_levels(0.95, 6), gamma)
    with mpmath.workdps(50):
        failure = 1 - mpmath.mpf("0.95") ** (mpmath.mpf(1) / 6)
        g = mpmath.mpf(31) / 2 * mpmath.log(1 + mpmath.mpf(1.3) / mpmath.mpf(0.09))
        exact = mpmath.sqrt(2 * mpmath.mpf(1.7) ** 2 + 300 * g * mpmath.log(31 / failure) ** 3)
    np.testing.assert_allclose(beta, float(exact), rtol=1e-12)


def test_chowdhury_and_gopalan_as_published():
    """At their `v = 1 + 2/T` the factor is `B + R sqrt(2 (gain + 1 + ln 1/delta))`; for more than T points there is
    no bound.
    """
    T, rng = 12, np.random.default_rng(1)
    hyper = gp.make_hyperparameters(1.0, [1.0], 1 + 2 / T)
    p = gp.condition(rng.normal(size=(T, 1)), rng.normal(size=(T, 1)), hyper)
    published = 2.0 + 0.3 * np.sqrt(2 * (0.5 * log_det(p, 0) + 1 + np.log(20)))
    np.testing.assert_allclose(error_bounds.chowdhury_gopalan(p, 2.0, 0.3, 0.95, T)[0], published, rtol=1e-10)
    assert jnp.isinf(error_bounds.chowdhury_gopalan(p, 2.0, 0.3, 0.95, T - 1)).all()


@given(seeds)
@settings(max_examples=8)
def test_bound_for_fixed_inputs_equals_its_formula(seed):
    _, B, R, p, x = member(seed)
    found = error_bounds.fiedler_fixed(p, jnp.asarray(x[0]), B, R, 0.9)
    n, t = int(p.num_points), np.log(10)
    for i in range(2):
        s, ls, *_ = arrays(p.hyper, i)
        k = s * np.exp(-0.5 * (((np.asarray(p.X) - x) / ls) ** 2).sum(-1))
        c = np.linalg.solve(gram(np.asarray(p.X), p.hyper, i), k)
        noise = R[i] * np.linalg.norm(c) * np.sqrt(n + 2 * np.sqrt(n * t) + 2 * t)
        np.testing.assert_allclose(found[i], B[i] * np.sqrt(s - k @ c) + noise, rtol=1e-6)


@given(seeds, st.floats(1e-3, 1e3))
@settings(max_examples=8)
def test_bounds_scale_with_the_unit_of_the_output(seed, unit):
    _, B, eps, p, x = member(seed)
    h = p.hyper
    other = gp.make_hyperparameters(
        h.signal_variance * unit**2, h.lengthscales, h.noise_variance * unit**2, h.constant_mean * unit
    )
    q = gp.condition(p.X, p.Y * unit, other)
    for bound in (
        lambda p, eps: error_bounds.bounded_energy(p, B, eps),
        lambda p, eps: error_bounds.abbasi_yadkori(p, B, eps, 0.9),
        lambda p, eps: error_bounds.chowdhury_gopalan(p, B, eps, 0.9, 50),
        lambda p, eps: error_bounds.srinivas(p, B, 0.9, error_bounds.max_information_gain(p.hyper, p.num_points + 1)),
    ):
        np.testing.assert_allclose(bound(p, eps) * deviation(p, x) * unit, bound(q, eps * unit) * deviation(q, x), 1e-7)


# -- information gain --------------------------------------------------------------------------------------------


@given(seeds)
@settings(max_examples=10)
def test_information_gain_is_at_most_the_maximum(seed):
    X, Y, hyper, _ = problem(seed)
    assert (gp.information_gain(gp.condition(X, Y, hyper)) <= error_bounds.max_information_gain(hyper, len(X))).all()


@given(seeds)
@settings(max_examples=10)
def test_greedy_gain_bounds_all_choices(seed):
    """Greedy selection bounds every selection from the pool, with repetition."""
    rng = np.random.default_rng(seed)
    pool = rng.normal(size=(6, 2))
    hyper = gp.make_hyperparameters([1.0, 3.0], np.exp(rng.normal(size=(2, 2))), [0.5, 0.01])
    bound = error_bounds.max_information_gain_greedy(hyper, pool, 3)
    for i in range(2):
        v = arrays(hyper, i)[2]
        gains = [
            0.5 * np.linalg.slogdet(gram(pool[list(chosen)], hyper, i) / v)[1]
            for chosen in itertools.combinations_with_replacement(range(6), 3)
        ]
        assert max(gains) <= bound[i] * (1 + 1e-12)
        # Greedy itself is one of the choices.
        assert bound[i] * (1 - 1 / np.e) <= max(gains) * (1 + 1e-12)


def test_invalid_pool_is_refused():
    hyper = gp.make_hyperparameters(1.0, [1.0, 1.0], 0.1)
    for pool in (np.zeros((0, 2)), np.zeros((3, 1)), np.full((2, 2), np.nan)):
        with pytest.raises(ValueError, match="must be finite, "):
            error_bounds.max_information_gain_greedy(hyper, pool, 2)


# -- confidence --------------------------------------------------------------------------------------------------


def test_confidence_split_as_in_remark_1():
    """Remark rem1: `1 - (1 - delta) / (N + 1)` for the payload and each of N agents."""
    N, delta = 3, 0.9
    np.testing.assert_allclose(
        error_bounds.union_bound_levels(delta, np.full(N + 1, 1 / (N + 1))), 1 - (1 - delta) / (N + 1)
    )


@given(st.floats(0.01, 0.99), st.lists(st.floats(0.01, 1), min_size=1, max_size=9))
def test_union_bound_levels_sum_to_the_total(confidence, raw):
    parts = error_bounds.union_bound_levels(confidence, np.array(raw) / sum(raw))
    np.testing.assert_allclose((1 - parts).sum(), 1 - confidence, rtol=1e-9)
    assert ((parts >= confidence - 1e-12) & (parts < 1)).all()


def test_product_levels_are_close_to_the_union_bound():
    """The paper's split multiplies probabilities and is only slightly better than the union bound."""
    part = error_bounds.product_levels(0.95, 9)
    np.testing.assert_allclose(part**9, 0.95)
    assert 1 - 0.05 / 9 > part > 1 - 1.03 * 0.05 / 9


def test_confidence_shares_of_updates_sum_to_one():
    total = sum(error_bounds.update_confidence_share(k) for k in range(1, 20_001))
    assert 0.9999 < total < 1


def test_confidences_and_weights_out_of_range_are_refused():
    for confidence in (0.0, 1.0, 1.5, -0.1, np.nan):
        with pytest.raises(ValueError, match="must lie strictly between 0 and 1"):
            error_bounds.union_bound_levels(confidence, [1.0])
        with pytest.raises(ValueError, match="must lie strictly between 0 and 1"):
            error_bounds.abbasi_yadkori(member(0)[3], 1.0, 1.0, confidence)
    for weights in ([0.6, 0.6], [1.0, 0.0], [1.2, -0.2]):
        with pytest.raises(ValueError, match="must be positive, their sum"):
            error_bounds.union_bound_levels(0.9, weights)
    with pytest.raises(ValueError, match="parts = 0"):
        error_bounds.product_levels(0.9, 0)
    with pytest.raises(ValueError, match="k = 0: must be at least 1"):
        error_bounds.update_confidence_share(0)


def test_invalid_norm_or_noise_is_refused():
    p = member(0)[3]
    with pytest.raises(ValueError, match="norm = -1"):
        error_bounds.bounded_energy(p, -1.0, 0.1)
    with pytest.raises(ValueError, match="noise_bound = inf"):
        error_bounds.bounded_energy(p, 1.0, np.inf)
    with pytest.raises(ValueError, match=r"sub_gaussian has shape \(3,\)"):
        error_bounds.abbasi_yadkori(p, 1.0, np.ones(3), 0.9)
    with pytest.raises(ValueError, match="horizon = 0"):
        error_bounds.chowdhury_gopalan(p, 1.0, 1.0, 0.9, 0)


# -- the radius and the assumptions ------------------------------------------------------------------------------


@given(seeds)
@settings(max_examples=10)
def test_rho_bar_bounds_the_norm_of_the_error(seed):
    f, B, eps, p, x = member(seed)
    beta = error_bounds.bounded_energy(p, B, eps)
    radius = float(error_bounds.vector_error_radius(p, jnp.asarray(x[0]), beta))
    plain = np.linalg.norm(np.asarray(beta) * deviation(p, x))
    assert plain <= radius <= plain * (1 + 1e-8)  # rounded outward: (n + D) eps s (1 + |c|)^2 beside sigma^2
    assert np.linalg.norm(error(f, p, x)) <= radius


def test_unsatisfied_assumptions_of_a_bound():
    assert unsatisfied("energy", {BoundAssumption.RKHS_NORM, BoundAssumption.NOISE_WITHIN_STD}) == set()
    # Bounded noise of zero mean is sub-Gaussian; inputs that are fixed are predictable.
    met = {
        BoundAssumption.RKHS_NORM,
        BoundAssumption.BOUNDED_NOISE,
        BoundAssumption.ZERO_MEAN,
        BoundAssumption.FIXED_DESIGN,
        BoundAssumption.FIXED_HYPERPARAMETERS,
    }
    assert unsatisfied("abbasi_yadkori", met) == set()
    assert unsatisfied("chowdhury_gopalan", met) == {BoundAssumption.HORIZON}
    # The paper's noise is Gaussian, but its bound requires bounded noise.
    assert unsatisfied("srinivas", met - {BoundAssumption.BOUNDED_NOISE} | {BoundAssumption.SUB_GAUSSIAN}) == {
        BoundAssumption.NOISE_WITHIN_STD
    }
    # Fitted hyperparameters invalidate the probabilistic bounds, not the deterministic ones.
    assert unsatisfied("fiedler", met - {BoundAssumption.FIXED_HYPERPARAMETERS}) == {
        BoundAssumption.FIXED_HYPERPARAMETERS
    }
    assert unsatisfied("recover", met - {BoundAssumption.FIXED_HYPERPARAMETERS}) == set()
    with pytest.raises(ValueError, match="must be one of energy"):
        unsatisfied("hoeffding", met)


def test_every_bound_name_is_a_function():
    functions = {"energy": error_bounds.bounded_energy, "recover": optimal_recovery.recovery_interval}
    assert all(name in functions or hasattr(error_bounds, name) for name in REQUIRED_ASSUMPTIONS)


# -- a part of the evidence --------------------------------------------------------------------------------------


@pytest.mark.long
@pytest.mark.parametrize("kind", coverage.NOISES)
def test_bounds_hold_on_random_functions(kind, monkeypatch):
    """Ten draws per case; `python -m evidence coverage` uses a thousand."""
    monkeypatch.setattr(coverage, "CHUNK", 10)
    found = coverage.summarize(
        {f"{kind}, adaptive, B = 0.2, 0": coverage.compute_item(f"{kind}, adaptive, B = 0.2, 0")}
    )
    claimed = {name: row for name, row in found.items() if row["assumptions_met"]}
    assert len(claimed) == {"two-point": 10, "Gaussian": 6, "filtered and biased": 2}[kind]
    assert all(row["violation_rate"] <= row["allowed_rate"] for row in claimed.values())
    controls = ["noise_free"] + ["abbasi_yadkori 0.95"] * (kind == "filtered and biased")
    for name in controls:
        row = found[f"{kind}, adaptive, B = 0.2, {name}"]
        assert row["violation_rate"] > row["allowed_rate"]
        assert not row["assumptions_met"]
