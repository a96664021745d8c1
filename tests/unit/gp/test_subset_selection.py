"""Tests of subset selection: within a budget the most informative points are kept."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colift import gp
from tests.support.gp_problems import problem

LINE = gp.make_hyperparameters(1.0, [1.0], 1e-2)


@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), noisier=st.booleans())
def test_each_dropped_point_is_the_least_informative(seed, noisier):
    """Each dropped point is the one without which most information remains."""
    X, Y, hyper, _ = problem(seed, N=9)
    noise = np.random.default_rng(seed).uniform(1, 4, 9) if noisier else np.ones(9)
    left = list(range(9))
    while len(left) > 6:
        gains = [information([j for j in left if j != k], X, Y, hyper, noise) for k in left]
        left.remove(left[int(np.argmax(gains))])
    stays = gp.select_subset(X, hyper, 6, noise)
    assert list(np.flatnonzero(stays)) == left


def information(these, X, Y, hyper, noise):
    """Return the information of these points in nats, summed over outputs; with noise one that of
    `gp.information_gain`.
    """
    total = 0.0
    for i in range(len(hyper.signal_variance)):
        one = gp.select_outputs(hyper, slice(i, i + 1))
        U = X[these] / np.asarray(one.lengthscales)[0]
        r2 = ((U[:, None] - U[None]) ** 2).sum(-1)
        K = float(one.signal_variance[0]) * one.kernel.numpy_value_and_slope(r2)[0]
        v = float(one.noise_variance[0]) * noise[these]
        total += 0.5 * np.linalg.slogdet(np.eye(len(these)) + K / v[None])[1]
    if (noise == 1).all():
        found = gp.condition(X[these], Y[these], hyper)
        np.testing.assert_allclose(total, float(gp.information_gain(found).sum()), rtol=1e-6)
    return total


def test_oldest_of_equal_points_are_dropped():
    X = np.array([0.0, 0.0, 0.0, 5.0])[:, None]
    assert list(gp.select_subset(X, LINE, 2, np.array([3.0, 1.0, 2.0, 9.0]))) == [False, True, False, True]


def test_all_points_within_the_budget_are_kept():
    X = np.zeros((5, 1))
    assert gp.select_subset(X, LINE, 5, np.ones(5)).all()
    assert gp.select_subset(X, LINE, 9, np.ones(5)).all()


def test_path_samples_survive_a_long_hover():
    """Samples of a long path are kept although the robot hovers at one point afterwards."""
    rng = np.random.default_rng(0)
    x = np.concatenate([np.linspace(0, 20, 60), np.full(400, 20.0) + 0.01 * rng.normal(size=400)])
    older = 1 + np.arange(460)[::-1] / 100
    stays = gp.select_subset(x[:, None], LINE, 64, older)
    gaps = np.diff(np.sort(x[stays]))
    assert stays.sum() == 64
    assert gaps.max() < 1.0  # a length-scale
    assert stays[60:].sum() < 20


def test_too_small_noise_is_refused():
    hyper = dataclasses.replace(LINE, noise_variance=LINE.noise_variance * 1e-16)
    with pytest.raises(ValueError, match=r"the Gram matrix of 30 points may not be positive definite"):
        gp.select_subset(np.zeros((30, 1)), hyper, 20, np.ones(30))
