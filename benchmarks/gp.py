"""The GP core compared with GPyTorch (exact mode), scikit-learn, and its theoretical minimum.

The problem has 6 outputs and 20 inputs. All libraries use one thread, since threads of several libraries on shared
cores wait for each other. The minimum is the number of floating-point operations over the rate of a 1500 x 1500 matrix
product, measured in the same run. It does not include memory traffic, which limits `append` and the means.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF, ConstantKernel, WhiteKernel
from threadpoolctl import threadpool_limits

from benchmarks import Outcome, ratios, rounds
from colift import gp
from colift.gp.likelihood import log_marginal_likelihood, single_thread_blas

OUTPUTS, INPUTS = 6, 20
SIZES = (200, 500, 1000, 2000)
TICKS = 1000
QUERIES = tuple((N, points) for N in (100, 500, 2000) for points in (1, 100, 1000, 10_000))
SKLEARN_LARGEST = 1000  # its gradient holds N x N x 22 numbers: 0.7 GB at 2000


def dgemm_rate() -> float:
    """Return floating-point operations per second of a matrix product, best of ten."""
    A = np.random.default_rng(0).normal(size=(1500, 1500))
    return 2 * 1500**3 / rounds({"dgemm": (lambda: A @ A, 1)}, 0.5)["dgemm"].min()


def data(N: int) -> tuple[np.ndarray, np.ndarray, gp.Hyperparameters]:
    rng = np.random.default_rng(N)
    X = rng.normal(size=(N, INPUTS))
    Y = np.sin(X[:, :OUTPUTS]) + 0.3 * X[:, OUTPUTS : 2 * OUTPUTS] + 0.1 * rng.normal(size=(N, OUTPUTS))
    return X, Y, gp.make_hyperparameters(np.ones(OUTPUTS), rng.uniform(2, 8, (OUTPUTS, INPUTS)), 0.01)


def likelihood(N: int, peer: object, seconds: float) -> tuple[dict[str, np.ndarray], float]:
    """Measure log likelihood and gradient of all outputs; the contenders must agree."""
    X, Y, hyper = data(N)
    thetas = [
        np.log([hyper.signal_variance[i], *hyper.lengthscales[i], hyper.noise_variance[i]]) for i in range(OUTPUTS)
    ]
    columns = [np.asfortranarray(Y[:, [i]]) for i in range(OUTPUTS)]

    def ours() -> list[tuple[float, np.ndarray]]:
        with single_thread_blas(N):
            return [log_marginal_likelihood(theta, X, y, scratch) for theta, y in zip(thetas, columns, strict=True)]

    scratch = np.empty((2, N, N))
    contenders, expected = {"colift": ours}, ours()
    if peer is not None:
        model = peer.Model(X, Y).set(hyper)
        value, gradient = model.log_likelihood_and_gradient()
        np.testing.assert_allclose(value, [v for v, _ in expected], rtol=1e-7)
        np.testing.assert_allclose(gradient, [g for _, g in expected], rtol=1e-5, atol=1e-5)
        contenders["GPyTorch"] = model.log_likelihood_and_gradient
    if N <= SKLEARN_LARGEST:
        kernels = [ConstantKernel(1.0) * RBF(np.exp(t[1:-1])) + WhiteKernel(0.01) for t in thetas]
        models = [GaussianProcessRegressor(k, alpha=0.0, optimizer=None).fit(X, Y[:, i]) for i, k in enumerate(kernels)]

        def scikit_learn() -> list:
            return [m.log_marginal_likelihood(t, eval_gradient=True) for m, t in zip(models, thetas, strict=True)]

        np.testing.assert_allclose([v for v, _ in scikit_learn()], [v for v, _ in expected], rtol=1e-7)
        contenders["scikit-learn"] = scikit_learn
    operations = OUTPUTS * (N**3 + 3 * N**2 * INPUTS)  # potrf and potri; one syrk and one symm of INPUTS columns
    return rounds({name: (run, 1) for name, run in contenders.items()}, seconds), operations


def append(N: int, peer: object, seconds: float) -> tuple[dict[str, np.ndarray], float]:
    """Measure one more point at N until the next mean: in place as in a stream or compiled loop, or with a copy of
    W.
    """
    X, Y, hyper = data(N)
    x, y = jnp.asarray(X[-1]), jnp.asarray(Y[-1])
    posterior = gp.condition(X[:-1], Y[:-1], hyper, N)
    in_place = jax.jit(gp.append, donate_argnums=0)
    start = gp.condition(X[: N // 2], Y[: N // 2], hyper, N)
    stream = [
        jax.tree.map(jnp.copy, start)
    ]  # a copy, since donation takes hyper too; the cost is that of the capacity, at any n

    def streaming() -> None:
        stream.append(in_place(stream.pop(), x, y)[0])
        jax.block_until_ready(stream[0])

    contenders = {"colift": streaming, "colift copying": lambda: jax.block_until_ready(gp.append(posterior, x, y))}
    if peer is not None:
        model = peer.Model(X[:-1], Y[:-1]).set(hyper)
        model.query(X[-1:])
        contenders["GPyTorch fantasy"] = lambda: model.appended(X[-1], Y[-1])
        contenders["GPyTorch refit"] = lambda: peer.Model(X, Y).set(hyper).query(X[-1:])
    contenders["colift refit"] = lambda: jax.block_until_ready(gp.condition(X, Y, hyper, N))
    return rounds({name: (run, 1) for name, run in contenders.items()}, seconds), OUTPUTS * 2 * N**2


def tick_of_24_means(N: int, seconds: float) -> tuple[dict[str, np.ndarray], float]:
    """Measure seconds per step: a payload with 6 outputs and two agents with 9, each on its own 20 inputs, 1000
    steps.
    """
    rng = np.random.default_rng(0)

    def posterior(outputs: int) -> gp.GPPosterior:
        hyper = gp.make_hyperparameters(np.ones(outputs), rng.uniform(2, 8, (outputs, INPUTS)), 0.01)
        return gp.condition(rng.normal(size=(N, INPUTS)), rng.normal(size=(N, outputs)), hyper)

    payload = posterior(6)
    agents = jax.tree.map(lambda *leaves: jnp.stack(leaves), posterior(9), posterior(9))

    @jax.jit
    def run(payload: gp.GPPosterior, agents: gp.GPPosterior) -> jax.Array:
        """Measure every size on one thread."""

        def tick(x: jax.Array, _: None) -> tuple[jax.Array, None]:
            total = gp.mean(payload, x[0]).sum() + jax.vmap(gp.mean)(agents, x[1:]).sum()
            return x + 1e-6 * total, None  # the next tick needs this one

        return jax.lax.scan(tick, jnp.ones((3, INPUTS)), None, length=TICKS)[0]

    times = rounds({"colift": (lambda: run(payload, agents).block_until_ready(), TICKS)}, seconds)
    return times, N * (3 * 2 * INPUTS + 24 * (2 * INPUTS + 3))


def queries(N: int, points: int, seconds: float) -> tuple[dict[str, np.ndarray], float]:
    """Measure mean and variance of all outputs at many points; scikit-learn has one model and kernel per output."""
    X, Y, hyper = data(N)
    posterior = gp.condition(X, Y, hyper)
    x = np.random.default_rng(1).normal(size=(points, INPUTS))
    given = jnp.asarray(x)
    models = [
        GaussianProcessRegressor(RBF(np.asarray(hyper.lengthscales[i])), alpha=0.01, optimizer=None).fit(X, Y[:, i])
        for i in range(OUTPUTS)
    ]

    def scikit_learn() -> list:
        return [model.predict(x, return_std=True) for model in models]

    @jax.jit
    def apart(posterior: gp.GPPosterior, x: jax.Array) -> tuple[jax.Array, jax.Array]:
        return jax.vmap(gp.mean, (None, 0))(posterior, x), jax.vmap(gp.variance, (None, 0))(posterior, x)

    mean, variance = gp.predict(posterior, given)
    np.testing.assert_allclose(mean.T, [m for m, _ in scikit_learn()], rtol=1e-7, atol=1e-9)
    np.testing.assert_allclose(variance.T, [std**2 for _, std in scikit_learn()], rtol=1e-6, atol=1e-9)
    contenders = {
        "colift": lambda: jax.block_until_ready(gp.predict(posterior, given)),
        "scikit-learn": scikit_learn,
    }
    if points * N <= 10**6:  # beyond, its differences need gigabytes
        contenders["colift, vmap"] = lambda: jax.block_until_ready(apart(posterior, given))
    times = rounds({name: (run, 1) for name, run in contenders.items()}, seconds, time.process_time)
    return times, points * OUTPUTS * N * (N + 3 * INPUTS)


def refused(N: int, seconds: float) -> tuple[dict[str, np.ndarray], float]:
    """Measure seconds per point for a refused point of `informative`, and for one variance, in scans of 100 points."""
    X, Y, hyper = data(N)
    posterior = gp.condition(X, Y, hyper)
    near, y = jnp.asarray(X[:100] + 1e-3), jnp.asarray(Y[:100])

    def offered(posterior: gp.GPPosterior, xy: tuple[jax.Array, jax.Array]) -> tuple[gp.GPPosterior, jax.Array]:
        return gp.max_variance_subset(posterior, *xy, jnp.asarray(0.9))

    def variance(carry: jax.Array, x: jax.Array) -> tuple[jax.Array, None]:
        return carry + gp.variance(posterior, x + 1e-9 * carry)[0], None

    # donated, as in a control loop: otherwise a copy of W is part of the call
    stream = jax.jit(lambda posterior: jax.lax.scan(offered, posterior, (near, y)), donate_argnums=0)
    alone = jax.jit(lambda start: jax.lax.scan(variance, start, near)[0])
    held = [jax.tree.map(jnp.copy, posterior)]

    def streaming() -> jax.Array:
        after, kept = jax.block_until_ready(stream(held.pop()))
        held.append(after)
        return kept

    assert not streaming().any()
    contenders = {"colift": (streaming, 100), "variance": (lambda: alone(jnp.zeros(())).block_until_ready(), 100)}
    return rounds(contenders, seconds, time.process_time), OUTPUTS * 2 * N**2


def report(what: str, N: int, times: dict[str, np.ndarray], operations: float, rate: float) -> dict[str, object]:
    """Print one line per contender; milliseconds, ratios to colift and multiples of the minimum."""
    bound, found = operations / rate, ratios(times, "colift")
    for name, t in times.items():
        print(
            f"{what:<22} {N:>5} {name:<17} {t.min() * 1e3:>10.3f} {np.median(t) * 1e3:>10.3f} {found[name]:>8.2f}x "
            f"{t.min() / bound:>9.1f}",
            flush=True,  # at 2000 the next row takes a minute
        )
    return {
        "median_ms": {name: float(np.median(t)) * 1e3 for name, t in times.items()},
        "ratio_to_colift": found,
        "time_over_roofline": {name: float(t.min() / bound) for name, t in times.items()},
    }


def peer() -> object:
    """Return GPyTorch in exact mode as in the tests, or None if it is not installed."""
    try:
        from tests.support import gpytorch_exact
    except ImportError:
        return None
    return gpytorch_exact


def run(seconds: float) -> Outcome:
    """Every size, one thread."""
    other = peer()
    with threadpool_limits(1), other.exact() if other else contextlib.nullcontext():
        rate = dgemm_rate()
        print(f"matrix product: {rate / 1e9:.1f} GFLOP/s; {OUTPUTS} outputs, {INPUTS} inputs")
        print(f"{'':<22} {'N':>5} {'':<17} {'min ms':>10} {'median ms':>10} {'ratio':>9} {'/ bound':>9}")
        grown, appended = {}, {}
        for N in SIZES:
            grown[N] = report("likelihood + gradient", N, *likelihood(N, other, seconds), rate)
            appended[N] = report("append", N, *append(N, other, seconds), rate)
        requested = {
            f"{points} at {N}": report(f"{points} queries", N, *queries(N, points, seconds), rate)
            for N, points in QUERIES
        }
        below = {N: report("refused point", N, *refused(N, seconds), rate) for N in SIZES[:3]}
        tick = report("24 means in a scan", 500, *tick_of_24_means(500, seconds), rate)
    return Outcome(
        {
            "gflop_per_second": rate / 1e9,
            "likelihood and gradient": {str(N): found for N, found in grown.items()},
            "append": {str(N): found for N, found in appended.items()},
            "queries, CPU time": requested,
            "refused point, CPU time": {str(N): found for N, found in below.items()},
            "tick with 24 means at 500": tick,
        },
        dict(targets(grown, appended, below, tick)),
        () if other else ("GPyTorch is not installed (`./dev peers` installs it): its rows and targets",),
    )


def targets(grown: dict, appended: dict, below: dict, tick: dict) -> Iterator[tuple[str, bool]]:
    """Return the targets of the figures."""
    at_500 = grown[500]["ratio_to_colift"]
    for name, least in (("GPyTorch", 2), ("scikit-learn", 6)):
        if name in at_500:
            yield f"likelihood + gradient at 500, {name}: {at_500[name]:.1f}x, at least {least}x", at_500[name] >= least
    for N in (N for N in SIZES if N >= 500):
        found = appended[N]["ratio_to_colift"]
        if "GPyTorch refit" in found:
            best = min(found["GPyTorch fantasy"], found["GPyTorch refit"])
            yield f"append at {N}, the faster GPyTorch way: {best:.1f}x, at least 30x", best >= 30
    for N, found in below.items():
        times = 1 / found["ratio_to_colift"]["variance"]
        yield f"refused point at {N}: {times:.2f} variances, at most 1.5", times <= 1.5
    ms = tick["median_ms"]["colift"]
    yield f"tick with 24 means at 500: {ms:.3f} ms, under 0.35 ms", ms < 0.35
