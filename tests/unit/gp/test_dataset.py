"""Tests of data policies, which keep their budget, and of update schedules."""

import itertools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import gp
from tests.support.gp_problems import problem


def stream(count, dimensions=2, outputs=3):
    t = jnp.arange(count, dtype=float)
    return t[:, None] * jnp.ones(dimensions)[None], 10 * t[:, None] + jnp.arange(outputs, dtype=float)[None]


def feed(policy, data, X, Y):
    """Return the data after a stream and which points were kept, in one compiled loop."""
    return jax.lax.scan(lambda d, xy: policy(d, *xy), data, (X, Y))


def offered(policy):
    """Adapt a data policy to the interface with a flag and times."""
    return lambda data, x, y: policy(data, x, y, jnp.zeros(()), jnp.array(True))


def test_first_in_first_out_keeps_the_newest():
    X, Y = stream(23)
    data, kept = feed(offered(gp.sliding_window), gp.empty_dataset(5, 2, 3), X, Y)
    assert kept.all()
    assert (int(data.n), int(data.num_seen)) == (5, 23)
    assert set(np.asarray(data.X[:, 0])) == {18.0, 19.0, 20.0, 21.0, 22.0}
    np.testing.assert_array_equal(data.Y[:, 2], 10 * data.X[:, 0] + 2)
    part, _ = feed(offered(gp.sliding_window), gp.empty_dataset(5, 2, 3), X[:3], Y[:3])
    assert int(part.n) == 3
    np.testing.assert_array_equal(part.X[:3], X[:3])


def test_reservoir_keeps_each_point_equally_often():
    X, Y = stream(40)
    runs = jax.vmap(lambda key: feed(offered(gp.ReservoirSampling(key=key)), gp.empty_dataset(8, 2, 3), X, Y)[0])
    data = runs(jax.random.split(jax.random.key(0), 3000))
    assert (data.n == 8).all()
    counts = np.bincount(np.asarray(data.X[..., 0], dtype=int).ravel(), minlength=40)
    assert all(len(set(row)) == 8 for row in np.asarray(data.X[..., 0]))
    expected = 3000 * 8 / 40
    chi_squared = ((counts - expected) ** 2).sum() / (expected * (1 - 8 / 40))
    assert chi_squared < 80  # 39 degrees of freedom: one in 10 000
    np.testing.assert_array_equal(data.Y[..., 2], 10 * data.X[..., 0] + 2)


@pytest.mark.parametrize("bad", [jnp.nan, jnp.inf])
def test_points_that_are_not_finite_are_refused(bad):
    X, Y = stream(3)
    Y = Y.at[1, 1].set(bad)
    policies = [offered(gp.sliding_window), offered(gp.ReservoirSampling(key=jax.random.key(0)))]
    for policy in policies:
        data, kept = feed(policy, gp.empty_dataset(5, 2, 3), X, Y)
        assert kept.tolist() == [True, False, True]
        assert (int(data.n), int(data.num_seen)) == (2, 2)
        assert jnp.isfinite(data.Y).all()


def gated_policy(gate):
    return lambda p, x, y: gp.max_variance_subset(p, x, y, jnp.asarray(gate))


def test_informative_policy_refuses_known_points():
    X, Y, hyper, _ = problem(0, N=10, noise=1e-4)
    X, Y = jnp.asarray(np.tile(X, (3, 1))), jnp.asarray(np.tile(Y, (3, 1)))
    p, kept = feed(gated_policy(0.01), gp.prior(hyper, 30), X, Y)
    assert kept[:10].all()  # new
    assert not kept[10:].any()  # seen
    _, kept = feed(gated_policy(0.01), gp.prior(hyper, 30), X, Y.at[0, 0].set(jnp.nan))
    assert kept.tolist() == [False] + [True] * 9 + [True] + [False] * 19
    assert int(p.num_points) == 10


def test_informative_policy_drops_its_most_redundant_point():
    hyper = gp.make_hyperparameters(1.0, [1.0], 1e-4)
    X = jnp.asarray([0.0, 3.0, 6.0, 3.2, 9.0])[:, None]
    p, kept = feed(gated_policy(1e-3), gp.prior(hyper, 4), X, jnp.sin(X))
    assert kept.all()
    left = set(np.asarray(p.X[:, 0]).tolist())
    assert left in ({0.0, 3.0, 6.0, 9.0}, {0.0, 3.2, 6.0, 9.0})
    fresh = gp.condition(p.X, p.Y, hyper)
    np.testing.assert_allclose(p.alpha, fresh.alpha, rtol=1e-8)
    again, kept = gp.max_variance_subset(p, jnp.asarray([8.9]), jnp.asarray([0.1]), jnp.asarray(1e-3))
    assert not bool(kept)  # smaller variance than any stored point
    for a, b in zip(jax.tree.leaves(again), jax.tree.leaves(p), strict=True):
        np.testing.assert_array_equal(a, b)


def test_informative_policy_covers_a_clustered_stream():
    """A robot that hovers 90 % of the time must keep samples of the rest of its path."""
    rng = np.random.default_rng(0)
    x = np.where(rng.random(600) < 0.9, rng.normal(0, 0.05, 600), rng.uniform(-3, 3, 600))
    x[-100:] = rng.normal(0, 0.05, 100)
    X = jnp.asarray(x[:, None])
    Y = jnp.asarray(np.sin(2 * x[:, None]) + 0.02 * rng.normal(size=(600, 1)))
    hyper = gp.make_hyperparameters(1.0, [0.7], 4e-4)
    queries = jnp.linspace(-3, 3, 100)[:, None]

    def error(p):
        return float(jnp.sqrt(jnp.mean((jax.vmap(gp.mean, (None, 0))(p, queries) - jnp.sin(2 * queries)) ** 2)))

    kept, _ = feed(gated_policy(0.01), gp.prior(hyper, 20), X, Y)
    newest, _ = feed(offered(gp.sliding_window), gp.empty_dataset(20, 1, 1), X, Y)
    assert int(kept.num_points) <= 20
    assert error(kept) < 0.1
    assert error(gp.condition(newest.X, newest.Y, hyper)) > 0.4


def test_scheduled_updates_end():
    schedule = gp.ScheduledUpdate(times=(1.0, 2.0, 3.0, 9.0), end=3.0)
    ticks = np.arange(0, 12, 0.25)
    due = [now for since, now in itertools.pairwise(ticks) if schedule.due(since, now, 0.0)]
    assert due == [1.0, 2.0, 3.0]
    assert schedule.due(0.9, 1.1, 0.0)  # between ticks


def test_information_triggered_updates_end():
    schedule = gp.InformationTriggeredUpdate(min_gain=2.0, end=3.0)
    assert schedule.due(0.0, 1.0, 2.0)
    assert not schedule.due(0.0, 1.0, 1.99)
    assert not schedule.due(0.0, 3.01, 50.0)


def test_skipped_points_change_nothing_and_times_are_kept():
    """Points that are not offered change nothing, and kept points have their times."""
    data = gp.empty_dataset(3, 1, 1)
    for k, offer in enumerate([True, False, True]):
        data, kept = gp.keep_first(data, jnp.ones(1), jnp.ones(1), jnp.array(0.1 * k), jnp.array(offer))
        assert bool(kept) == offer
    assert (int(data.n), int(data.num_seen)) == (2, 2)
    np.testing.assert_allclose(data.t, [0.0, 0.2, 0.0])
