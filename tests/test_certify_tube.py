"""The tube: its fixed point by iteration, features by finite differences, and how fast an unknown can vary."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from jax.flatten_util import ravel_pytree
from scipy.linalg import expm

from colift import band, dynamics, gp, learn, model
from colift.certify import reach, tube
from colift.response import Response
from tests import teams

seeds = st.integers(0, 2**31)
BODIES = (slice(0, 6), slice(6, 10), slice(10, 17))


# The fixed point ------------------------------------------------------------------------------------------------------


def loop(rng: np.random.Generator, contraction: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Random gains, bounds and roughness with that contraction, by the spectral radius of `K Gamma` on inputs."""
    gains, rho, rough = rng.uniform(0, 1, (3, 17)), rng.uniform(0, 1, 17), rng.uniform(0.1, 1, 17)
    wide = np.zeros((17, 17))
    for b, columns in enumerate(BODIES):
        wide[columns] = rough[columns, None] * gains[b]
    return gains, rho, rough * (contraction / np.abs(np.linalg.eigvals(wide)).max())


@given(seeds, st.floats(0.01, 0.97))
@settings(max_examples=20)
def test_distances_are_where_the_iteration_from_nothing_ends(seed, contraction):
    """`nu <- Gamma (rho + K nu)` from zero grows towards the tube and never beyond: the run stays within."""
    gains, rho, rough = loop(np.random.default_rng(seed), contraction)
    found = tube.fixed_point(gains, rho, rough, BODIES)
    assert found.contraction == pytest.approx(contraction, rel=1e-9)
    nu = np.zeros(3)
    for _ in range(int(40 / -np.log(contraction)) + 1):
        apart = np.concatenate([rough[columns] * nu[b] for b, columns in enumerate(BODIES)])
        now = gains @ (rho + apart)
        assert (now >= nu * (1 - 1e-12)).all()
        assert (now <= found.distance * (1 + 1e-9)).all()
        nu = now
    np.testing.assert_allclose(found.distance, nu, rtol=1e-9)
    np.testing.assert_allclose(found.difference, apart, rtol=1e-9)


@given(seeds)
@settings(max_examples=10)
def test_without_contraction_there_is_no_tube_and_the_error_says_so(seed):
    rng = np.random.default_rng(seed)
    gains, rho, rough = loop(rng, 1.0)
    assert (tube.fixed_point(gains, rho, 0.999 * rough, BODIES).distance > 0).all()
    with pytest.raises(ValueError, match=r"no tube holds the run: .* by a factor of 1\.2 \(must be below 1\)"):
        tube.fixed_point(gains, rho, 1.2 * rough, BODIES)


# Features -------------------------------------------------------------------------------------------------------------


STRUCTURE = ((teams.WAIST_TWO_ARMS, 2), (teams.SLIDING_ARM, 1))
moved = jax.jit(dynamics.move)


def seen(z: object) -> list[np.ndarray]:
    """What the learned maps see of a state, body by body."""
    agents = [np.asarray(jax.vmap(model.flat_agent)(q)) for q in z.agents]
    payload = learn.payload_features(model.flat_payload(z.payload, jnp.zeros(6)))
    return [np.asarray(payload), *(row for group in agents for row in group)]


@pytest.mark.parametrize("seed", range(4))
def test_features_are_the_derivative_of_what_the_maps_see_in_lengthscales(seed):
    """Central differences along directions of the loop's state; attitudes any, so that of R the size counts."""
    rng = np.random.default_rng(seed)
    team, z = teams.team(rng, STRUCTURE), teams.free_state(rng, STRUCTURE)
    zero, unravel = ravel_pytree(dynamics.no_shift(z))
    basis = np.linalg.qr(rng.normal(size=(len(zero), 8)))[0]
    # one length-scale for the nine entries of R, as in every prior
    scales = [rng.uniform(0.5, 4, n) for n in (20, 24, 24, 22)]
    for ls, first in zip(scales, (6, 0, 0, 0), strict=True):
        ls[first : first + 9] = ls[first]
    none = np.zeros((0, 0))
    shown = Response(A=none, B=none, C=none, D=none, basis=basis, bodies=())
    found = tube.features(shown, team, scales)
    assert [part.shape for part in found] == [(24, 8), (24, 8), (24, 8), (22, 8)]
    h = 1e-5
    for _ in range(6):
        x = rng.normal(size=8)
        ends = [seen(moved(z, unravel(jnp.asarray(s * basis @ x)))) for s in (h, -h)]
        changes = [(a - b) / (2 * h) / ls for a, b, ls in zip(*ends, scales, strict=True)]
        for b, (change, rows) in enumerate(zip(changes, found, strict=True)):
            R = slice(6, 15) if b == 0 else slice(0, 9)
            linear = rows @ x
            assert np.linalg.norm(linear[R]) == pytest.approx(np.linalg.norm(change[R]), rel=1e-6)
            rest = np.r_[0 : R.start, R.stop : 18 if b == 0 else len(change)]
            np.testing.assert_allclose(linear[rest], change[rest], atol=1e-7)
            assert np.linalg.norm(change) <= np.linalg.norm(linear) * (1 + 1e-7)


# How fast an unknown can vary -----------------------------------------------------------------------------------------


means = jax.jit(jax.vmap(gp.mean, (None, 0)))


@given(seeds)
@settings(max_examples=10)
def test_roughness_bounds_how_what_is_left_varies(seed):
    """Functions of the stated norm with labels that err by eps, at pairs of inputs near and far."""
    rng = np.random.default_rng(seed)
    outputs, dimensions, n = 3, 4, 10
    s = rng.uniform(0.2, 3, outputs)
    # a model whose noise variance is not the companion's: their means differ
    hyper = gp.hyperparameters(s, rng.uniform(0.7, 2, (outputs, dimensions)), rng.choice([1e-4, 0.3]) * s)
    centers, X = rng.uniform(-2, 2, (8, dimensions)), rng.uniform(-2, 2, (n, dimensions))
    norm, eps, w = rng.uniform(0.5, 3), rng.uniform(0.02, 0.2, outputs) * s**0.5, rng.normal(size=(outputs, 8))
    f = gp.expansion(hyper, centers, w * (norm / np.asarray(gp.norm(gp.expansion(hyper, centers, w))))[:, None], n)
    model = gp.condition(
        X, np.asarray(means(f, jnp.asarray(X))) + eps * rng.choice([-1.0, 1.0], (n, outputs)), hyper, n
    )
    companion = band.companion(model, "energy", norm, eps)
    beta = np.asarray(band.factor(companion, "energy", norm, eps, 0.95))
    body = reach.Body(slice(0, outputs), model, companion, beta, norm, eps, X)
    K = tube.roughness(body)
    pairs = 300
    a = rng.uniform(-3, 3, (pairs, dimensions))
    b = a + rng.normal(size=(pairs, dimensions)) * np.exp(rng.uniform(-6, 0.5, (pairs, 1)))
    left = [np.asarray(means(f, jnp.asarray(p))) - np.asarray(means(model, jnp.asarray(p))) for p in (a, b)]
    apart = np.linalg.norm((a - b)[:, None] / np.asarray(hyper.lengthscales), axis=2)
    rate = np.abs(left[0] - left[1]) / apart
    assert (rate <= K).all()
    assert rate.max() > 0.03 * K.max()  # the draws are of the size of what they test


def test_roughness_is_reached_where_there_are_no_data():
    """`f = B k'(., x) / |k'|` has the greatest slope that its norm allows: `B sqrt(signal_variance)` a length-scale."""
    s, norm, ls, h = 1.7, 2.3, np.array([0.8, 1.6]), 1e-3
    hyper = gp.hyperparameters(s, ls, 1e-4)
    prior = gp.prior(hyper, 2)
    ends = h * np.array([[1.0, 0.0], [-1.0, 0.0]]) * ls
    f = gp.expansion(hyper, ends, [[1.0, -1.0]])
    f = gp.expansion(hyper, ends, norm / float(gp.norm(f)[0]) * np.array([[1.0, -1.0]]))
    values = np.asarray(means(f, jnp.asarray(ends)))
    body = reach.Body(slice(0, 1), prior, prior, np.array([norm]), norm, np.array([0.1]), ends)
    slope = float(values[0, 0] - values[1, 0]) / (2 * h)
    K = float(tube.roughness(body)[0])
    assert slope <= K <= slope * (1 + 1e-4)


def test_what_the_companion_differs_by_counts():
    """With a factor of zero what is left is the difference of the two means, and no more."""
    rng = np.random.default_rng(0)
    hyper = gp.hyperparameters(1.0, [1.0, 1.0], 0.2)
    X, Y = rng.normal(size=(6, 2)), rng.normal(size=(6, 1))
    model = gp.condition(X, Y, hyper, 8)
    companion = gp.condition(X, Y, dataclasses.replace(hyper, noise_variance=jnp.array([1e-3])), 8)
    body = reach.Body(slice(0, 1), model, companion, np.zeros(1), 1.0, np.ones(1), X)
    alpha = (np.asarray(companion.alpha) - np.asarray(model.alpha))[0, :6]
    K = np.exp(-0.5 * ((X[:, None] - X[None]) ** 2).sum(-1))
    assert tube.roughness(body)[0] == pytest.approx(np.sqrt(alpha @ K @ alpha), rel=1e-9)


def test_turns_of_an_attitude_are_the_rotation_s_derivative():
    theta = np.array([0.3, -0.5, 0.2])
    h = 1e-6
    hat = np.array([[0, -theta[2], theta[1]], [theta[2], 0, -theta[0]], [-theta[1], theta[0], 0]])
    change = (expm(h * hat) - expm(-h * hat)) / (2 * h)
    np.testing.assert_allclose(tube._turned() @ theta, change.reshape(9), atol=1e-9)
