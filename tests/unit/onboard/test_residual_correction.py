"""Tests of the residual correctors: Kalman filter, label filter, and the predictor that adds their correction."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.linalg import expm, solve_discrete_are
from scipy.signal import lfilter
from sklearn.gaussian_process.kernels import Matern

from colift import gp, scenario
from colift.closed_loop import flight
from colift.models.state import ControlClock, PayloadState, ResidualForces, Wrench, zero_residual
from colift.onboard import interfaces
from colift.onboard.control import tracking
from colift.onboard.estimation.effectiveness import LabelChange
from colift.onboard.estimation.nav_filter import FilterBandwidths
from colift.onboard.estimation.state_estimator import StateEstimate, TrainingSample
from colift.onboard.learning import features, residual_correction, residual_model, residual_predictors
from colift.onboard.learning.kalman_correction import KalmanState, ResidualKalmanFilter
from colift.onboard.learning.label_filter import LabelFilter
from colift.onboard.learning.residual_correction import ResidualObservation
from colift.scenario import experiment
from tests.support import small_team as light

DT, TICKS = 0.002, 400
CORNERS = {"complementary": 5.0, "imu_bias": 0.0, "joint": 20.0, "label": 8.0, "tip_force": 50.0}
FILTERS = FilterBandwidths(**{name: jnp.array(hertz) for name, hertz in CORNERS.items()})
DELAY = 2 / (2 * np.pi * CORNERS["label"]) + 1 / (2 * np.pi * CORNERS["tip_force"])
OUTPUTS = 6


@functools.cache
def light_experiment() -> flight.Experiment:
    """Return the experiment of the smallest team, built on first use."""
    return experiment.make_experiment(light.settings(), "adaptive")


def six(W: Wrench) -> np.ndarray:
    return np.concatenate([W.F, W.tau], axis=-1)


# The Kalman filter ----------------------------------------------------------------------------------------------------


def kalman_filter(sigma: float = 1.5, **fields: float) -> ResidualKalmanFilter:
    """Return the filter of a payload without agents."""
    std = ResidualForces(payload=Wrench(F=jnp.full(3, sigma), tau=jnp.full(3, sigma)), agents=())
    made = {name: jnp.array(x) for name, x in ({"sensor_bandwidth": CORNERS["tip_force"]} | fields).items()}
    return ResidualKalmanFilter(std=std, **made)


def constant(like: ResidualForces, value: jax.Array) -> ResidualForces:
    """Return one value for all outputs."""
    return jax.tree.map(lambda x: jnp.full_like(x, value), like)


@jax.jit
def filter_labels(
    corrector: ResidualKalmanFilter, start: KalmanState, y: jax.Array, on: jax.Array, intervals: jax.Array
) -> tuple[KalmanState, jax.Array]:
    """Return the states after each period and the normalized innovations squared, for a model that predicts zero."""

    def step(state: KalmanState, of: tuple) -> tuple:
        y, valid, interval = of
        label = ResidualForces(payload=Wrench(F=y[:3], tau=y[3:]), agents=())
        observation = ResidualObservation(
            label=label,
            prediction=label,
            update_index=jnp.zeros((), int),
            label_valid=constant(label, valid),
            interval=constant(label, interval),
        )
        state, nis = corrector.filter(state, jnp.zeros(OUTPUTS), observation, jnp.array(DT))
        return state, (state, nis)

    return jax.lax.scan(step, start, (y, on, intervals))[1]


def filtered(corrector: ResidualKalmanFilter, y: np.ndarray, on: np.ndarray) -> tuple[KalmanState, np.ndarray]:
    """Filter labels that are held where there is none."""
    held = y[np.maximum.accumulate(np.where(on > 0, np.arange(len(y)), 0))]
    start = corrector.init(light_experiment().controller.team)
    return filter_labels(corrector, start, *map(jnp.asarray, (held, np.asarray(on, float), sample_intervals(on))))


def sample_intervals(on: np.ndarray) -> np.ndarray:
    """Return the time since the previous label in each control period."""
    intervals, since = np.zeros(len(on)), 0.0
    for k, valid in enumerate(on):
        intervals[k] = since = since + DT
        since *= 1 - valid
    return intervals


def noise_variances(corrector: ResidualKalmanFilter, states: KalmanState) -> tuple[np.ndarray, np.ndarray]:
    """Return the variances of white and differenced noise that the filter used in each period."""
    R, Q = jax.vmap(lambda noise: noise.variances())(states.label_noise)
    return np.maximum(R, corrector.min_noise_variance(jnp.array(DT))), np.asarray(Q)


def transition(decay_rate: float, dt: float = DT) -> np.ndarray:
    """Return the transition matrix of error and rate."""
    return expm(dt * np.array([[0.0, 1.0], [-(decay_rate**2), -2 * decay_rate]]))


def simulated(
    rng: np.random.Generator, n: int, sigma: float, R: float, Q: float, decay_rate: float = 1.0
) -> tuple[np.ndarray, np.ndarray]:
    """Return n errors of the filter's model, of six outputs, and their labels."""
    A, P_inf = transition(decay_rate), sigma**2 * np.diag([1.0, decay_rate**2])
    x = np.linalg.cholesky(P_inf) @ rng.normal(size=(2, OUTPUTS))
    root, d = np.linalg.cholesky(P_inf - A @ P_inf @ A.T), np.zeros((n, OUTPUTS))
    for k in range(n):
        x = A @ x + root @ rng.normal(size=(2, OUTPUTS))
        d[k] = x[0]
    noise = np.sqrt(Q) * rng.normal(size=(n + 1, OUTPUTS))
    return d, d + np.diff(noise, axis=0) + np.sqrt(R) * rng.normal(size=(n, OUTPUTS))


def random_labels(seed: int, share: float, n: int = 150) -> tuple[np.ndarray, np.ndarray]:
    """Return labels of a random process with both kinds of noise, and the periods that have a label."""
    rng = np.random.default_rng(seed)
    _, y = simulated(rng, n, 1.5, 0.05, 0.1)
    on = rng.random(n) < share
    on[[0, n - 1]] = True
    return y, on


@pytest.mark.parametrize(("seed", "share"), [(0, 1.0), (1, 0.6), (2, 0.1)])
def test_filter_is_the_augmented_kalman_filter(seed, share):
    """With the states d, v, n of this and n of the last period; mean and covariance agree at every period."""
    decay_rate, (y, on) = 3.0, random_labels(seed, share)
    states, _ = filtered(kalman_filter(decay_rate=decay_rate), y, on)
    R, Q = noise_variances(kalman_filter(decay_rate=decay_rate), states)
    A, P_inf, H = np.zeros((4, 4)), 1.5**2 * np.diag([1.0, decay_rate**2]), np.array([1.0, 0.0, 1.0, -1.0])
    A[:2, :2], A[3, 2] = transition(decay_rate), 1.0
    for i in range(OUTPUTS):
        x, P = np.zeros(4), np.zeros((4, 4))
        P[:2, :2] = P_inf
        for k, valid in enumerate(on):
            process = np.zeros((4, 4))
            process[:2, :2], process[2, 2] = P_inf - A[:2, :2] @ P_inf @ A[:2, :2].T, Q[k, i]
            x, P = A @ x, A @ P @ A.T + process
            if valid:
                K = P @ H / (H @ P @ H + R[k, i])
                x, P = x + K * (y[k, i] - H @ x), P - np.outer(K, H @ P)
            found = [states.d, states.v, *states.P, *states.noise]
            expected = [x[0], x[1], P[0, 0], P[0, 1], P[1, 1], x[2], P[2, 2], P[0, 2], P[1, 2]]
            np.testing.assert_allclose([z[k, i] for z in found], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(("seed", "share"), [(3, 1.0), (4, 0.3)])
def test_filter_is_regression_with_a_matern_kernel(seed, share):
    """Mean and variance at the last label equal those of a Gaussian process with the labels' noise covariance."""
    decay_rate, (y, on) = 2.0, random_labels(seed, share)
    states, _ = filtered(kalman_filter(decay_rate=decay_rate), y, on)
    R, Q = noise_variances(kalman_filter(decay_rate=decay_rate), states)
    t = DT * np.arange(len(y))[:, None]
    kernel = 1.5**2 * Matern(length_scale=np.sqrt(3) / decay_rate, nu=1.5)(t)
    for i in range(OUTPUTS):
        before = np.concatenate([[0.0], np.asarray(Q)[:-1, i]])
        noise = np.diag(np.asarray(R + Q)[:, i] + before) - np.diag(before[1:], 1) - np.diag(before[1:], -1)
        K = (kernel + noise)[np.ix_(on, on)]
        gain = np.linalg.solve(K, kernel[on, -1])
        np.testing.assert_allclose(states.d[-1, i], gain @ y[on, i], rtol=1e-8, atol=1e-9)
        np.testing.assert_allclose(states.P[0][-1, i], kernel[-1, -1] - gain @ kernel[on, -1], rtol=1e-8)


@pytest.mark.parametrize(("seed", "share"), [(5, 1.0), (6, 0.1)])
def test_filter_is_consistent_with_its_model(seed, share):
    """Mean NIS and coverage lie in their 95 % intervals for simulated errors, with all and with a tenth of the labels.

    The errors change little during a block of labels, as the estimate of the label noise assumes.
    """
    rng, sigma, n = np.random.default_rng(seed), 0.2 if share == 1 else 0.03, int(8000 / share)
    d, y = simulated(rng, n, sigma, 0.04, 0.02 * share)
    on = rng.random(n) < share
    states, nis = filtered(kalman_filter(sigma=sigma, noise_averaging_time=50.0), y, on)
    used = np.flatnonzero(on & (np.arange(n) > n // 4))
    count = OUTPUTS * len(used)
    assert np.mean(nis[used]) == pytest.approx(1.0, abs=1.96 * np.sqrt(2 / count) + 0.01)  # 1 %: noise is estimated
    z = np.asarray((d - states.d) / np.sqrt(states.P[0]))[n // 4 :]
    # samples that are one correlation time of the filter error apart are nearly independent
    lag = next(k for k in range(1, n) if np.mean(z[k:] * z[:-k]) < 0.1 * np.mean(z * z))
    coverage, independent = np.mean(np.abs(z) < 1.96), z.size / (2 * lag)
    assert coverage == pytest.approx(0.95, abs=1.96 * np.sqrt(0.95 * 0.05 / independent))


@pytest.mark.parametrize(("R", "Q"), [(0.04, 0.0), (0.04, 0.03), (0.01, 0.2)])
def test_allan_variances_recover_the_label_noise(R, Q):
    """Variances of white and of differenced noise, each relative to the larger share of the label."""
    _, y = simulated(np.random.default_rng(7), 6000, 1e-3, R, Q)
    states, _ = filtered(kalman_filter(noise_averaging_time=50.0), y, np.ones(len(y), bool))
    found = jax.tree.map(lambda x: x[-1], states.label_noise).variances()
    np.testing.assert_allclose(np.mean(found[0]), R, rtol=0.2)
    np.testing.assert_allclose(np.mean(found[1]), Q, atol=0.2 * max(R, Q))
    assert (np.abs(np.asarray(found[1]) / Q - 1) < 0.2).all() if Q else True


def test_sparse_labels_do_not_raise_the_estimated_noise():
    """A change of the error during a block raises the Allan variance over the block; the smaller variance counts."""
    rng = np.random.default_rng(8)
    _, y = simulated(rng, 20000, 2.0, 0.04, 0.0)
    on = rng.random(len(y)) < 0.1
    R, _ = noise_variances(kalman_filter(), filtered(kalman_filter(), y, on)[0])
    np.testing.assert_allclose(np.median(R[5000:]), 0.04, rtol=0.2)


def test_steady_state_has_the_largest_corner_frequency():
    """Without label noise, covariances solve the Riccati equation, and the poles have the frequency `max_bandwidth`."""
    sigma, corrector = 1.5, kalman_filter(max_bandwidth=12.0)
    start, dt = corrector.init(light_experiment().controller.team), jnp.array(DT)
    found, R = corrector.steady_state(start, dt), float(corrector.min_noise_variance(dt)[0])
    A, P_inf, H = transition(1.0), sigma**2 * np.eye(2), np.array([[1.0, 0.0]])
    P = solve_discrete_are(A.T, H.T, P_inf - A @ P_inf @ A.T, np.array([[R]]))
    K = P @ H.T / (P[0, 0] + R)
    for x, expected in zip(found.P, (P - K @ H @ P)[[0, 0, 1], [0, 1, 1]], strict=True):
        np.testing.assert_allclose(x, expected, rtol=1e-6)
    poles = np.log(np.linalg.eigvals((np.eye(2) - K @ H) @ A).astype(complex)) / DT
    np.testing.assert_allclose(np.abs(poles) / (2 * np.pi), 12.0, rtol=0.1)
    assert not np.any(found.d)


# Corrections of whole updates -----------------------------------------------------------------------------------------


def blend(hertz: float) -> float:
    return 1 - np.exp(-2 * np.pi * hertz * DT)


def low_pass(x: np.ndarray, hertz: float) -> np.ndarray:
    """First-order low-pass that starts at its first sample."""
    b = blend(hertz)
    return lfilter([b], [1, b - 1], x, axis=0, zi=(1 - b) * x[:1])[0]


def sensed(x: np.ndarray) -> np.ndarray:
    """Apply the lag of the tip force sensors."""
    return low_pass(x, CORNERS["tip_force"])


def filtered_label(x: np.ndarray) -> np.ndarray:
    """Apply the two stages of the label filter."""
    return low_pass(low_pass(x, CORNERS["label"]), CORNERS["label"])


def estimate_with_label(p: Any, y: Any, on: Any, intervals: Any) -> StateEstimate:
    """Return an estimate with a payload at p and its label y before the label filter; agents have labels of zero."""
    load = PayloadState(p=p, v=jnp.zeros(3), R=jnp.eye(3), omega=jnp.zeros(3))
    team = light_experiment().controller.team
    none = tuple(
        (jnp.zeros((n, 18 + 2 * g.tree.joints)), jnp.zeros((n, 6 + g.tree.joints)))
        for n, g in zip(team.sizes, team.agent_groups, strict=True)
    )
    labelled = TrainingSample(
        payload=(jnp.zeros(24), jnp.zeros(6)),
        agents=none,
        unfiltered=(y, tuple(label for _, label in none)),
        valid=on,
        sample_interval=intervals,
    )
    lam = tuple(jnp.zeros_like(g.contact_position) for g in team.agent_groups)
    return StateEstimate(
        agents=light_experiment().initial_state.agents, payload=load, a_L=jnp.zeros(6), lam=lam, sample=labelled
    )


def corrections(
    corrector: residual_correction.ResidualCorrector, model: Any, p: np.ndarray, labels: np.ndarray, on: np.ndarray
) -> residual_correction.ResidualCorrection:
    """Return the corrections along a payload path; `model(k)` is the model at step k.

    All outputs have labels in the same periods, also those of the payload.
    """

    def step(state: Any, context: tuple) -> tuple:
        k, *inputs = context
        clock = ControlClock(t=k.astype(float) * DT, dt=jnp.array(DT))
        observation = residual_correction.observe(model(k), team, estimate_with_label(*inputs), clock.dt)
        valid, interval = (constant(observation.label, x) for x in inputs[2:])
        observation = dataclasses.replace(observation, label_valid=valid, interval=interval)
        correction, state = corrector.update(state, observation, clock)
        return state, correction

    team = light_experiment().controller.team  # made before anything is traced
    inputs = (np.arange(len(p)), p, labels, np.asarray(on, float), sample_intervals(on))
    steps = tuple(map(jnp.asarray, inputs))
    return jax.jit(lambda: jax.lax.scan(step, corrector.init(team), steps)[1])()


def constant_model(mean: Any, k: Any = 0) -> residual_model.ResidualModel:
    """Return the model of update k that predicts a constant wrench."""
    model = light_experiment().controller.residual_model
    hyper = dataclasses.replace(model.payload.hyper, constant_mean=jnp.full(6, mean))
    return dataclasses.replace(
        model, payload=dataclasses.replace(model.payload, hyper=hyper), update_index=jnp.asarray(k)
    )


def replaced_model(k: jax.Array) -> residual_model.ResidualModel:
    """Return a model that is replaced by another one in control period 200."""
    later = (k >= 200).astype(int)
    return constant_model(0.5 + later.astype(float), later)


def team_filter() -> ResidualKalmanFilter:
    corrector = light_experiment().controller.residual_corrector
    assert isinstance(corrector, ResidualKalmanFilter)
    return corrector


CORRECTORS = {
    "kalman": team_filter,
    "label_filter": lambda: LabelFilter(filters=FILTERS),
}


@pytest.mark.parametrize("kind", CORRECTORS)
def test_model_replacement_is_bumpless(kind):
    """Model and correction together have no step, and stay close to those with a model that is not replaced.

    The mean of the Kalman filter returns to the new model, not to the old one.
    """
    rng = np.random.default_rng(9)
    labels, p = 2.0 + rng.normal(size=(TICKS, 6)).cumsum(axis=0) * 0.02, np.zeros((TICKS, 3))
    found = {}
    for name, model in {"stays": lambda _k: constant_model(0.5), "replaced": replaced_model}.items():
        made = corrections(CORRECTORS[kind](), model, p, labels, np.ones(TICKS))
        found[name] = six(made.prediction.payload) + six(made.error.payload), six(made.rate.payload)
    tolerance = {"kalman": (1e-5, 0.01), "label_filter": (1e-9, 1e-9)}[kind]
    (replaced, rate), (stays, expected) = found["replaced"], found["stays"]
    np.testing.assert_allclose(replaced[200], stays[200], atol=tolerance[0])
    np.testing.assert_allclose(replaced, stays, atol=tolerance[1])
    np.testing.assert_allclose(rate[:201], expected[:201], atol=500 * tolerance[0])


def observed(label: ResidualForces, change: LabelChange | None = None) -> ResidualObservation:
    """Return an observation with labels of all outputs and a model that predicts zero."""
    return ResidualObservation(
        label=label,
        prediction=jax.tree.map(jnp.zeros_like, label),
        update_index=jnp.zeros((), int),
        label_valid=jax.tree.map(jnp.ones_like, label),
        interval=constant(label, jnp.array(DT)),
        next_label_change=change,
    )


def label_change(axes: np.ndarray, thrust: np.ndarray) -> LabelChange:
    """Return changes of the labels along thrust axes, split into groups of agents."""
    ends = np.cumsum(light_experiment().controller.team.sizes)[:-1]
    axes_by_group, by_group = (tuple(map(jnp.asarray, np.split(x, ends))) for x in (axes, thrust))
    return LabelChange(axes=axes_by_group, thrust=by_group)


@pytest.mark.parametrize("seed", range(5))
def test_the_smallest_error_that_a_loss_explains_remains(seed):
    """Along the thrust axis, the smallest of all errors ``d + s`` with s between 0 and the change; others stay.

    The second vector loses the same share as the first.
    """
    rng, team = np.random.default_rng(seed), light_experiment().controller.team
    n, ones = sum(team.sizes), jax.tree.map(jnp.ones_like, zero_residual(team))
    error, axes, change = rng.normal(size=(n, 3)), rng.normal(size=(n, 3)), 2 * rng.normal(size=n)
    axes /= np.linalg.norm(axes, axis=1, keepdims=True)
    if seed == 0:
        change[:] = 0.0
    parts = np.split(error, np.cumsum(team.sizes)[:-1])
    agents = tuple(dataclasses.replace(f, f_x=jnp.asarray(d)) for f, d in zip(ones.agents, parts, strict=True))
    d = residual_correction.flatten(dataclasses.replace(ones, agents=agents))
    given = observed(ones, label_change(axes, change))
    first, second = residual_correction.without_explained_error((d, 3 * d), given)
    np.testing.assert_allclose(second, 3 * first, atol=1e-12)
    after = residual_correction.unflatten(first, ones)
    found = np.concatenate([f.f_x for f in after.agents])
    for d_k, b, c, remaining in zip(error, axes, change, found, strict=True):
        candidates = d_k @ b + c * np.linspace(0, 1, 100001)
        np.testing.assert_allclose(remaining @ b, candidates[np.abs(candidates).argmin()], atol=1e-4)
        np.testing.assert_allclose(remaining - (remaining @ b) * b, d_k - (d_k @ b) * b, atol=1e-12)
    if seed == 0:
        np.testing.assert_array_equal(found, error)
    np.testing.assert_array_equal(after.agents[0].f_w, 1.0)
    np.testing.assert_array_equal(six(after.payload), 1.0)


def test_an_error_of_zero_contains_no_loss():
    team = light_experiment().controller.team
    n, zero = sum(team.sizes), zero_residual(team)
    given = observed(zero, label_change(np.tile([0.0, 0.0, 1.0], (n, 1)), np.full(n, 10.0)))
    (after,) = residual_correction.without_explained_error((residual_correction.flatten(zero),), given)
    assert not np.any(after)


@pytest.mark.parametrize("kind", CORRECTORS)
def test_correctors_drop_the_explained_error_and_its_rate(kind):
    """A label falls by 10 N for 5 periods. After its explanation neither error nor rate remains."""
    team, corrector = light_experiment().controller.team, CORRECTORS[kind]()
    n, up, zero = sum(team.sizes), np.array([0.0, 0.0, 1.0]), zero_residual(team)
    fallen = tuple(dataclasses.replace(f, f_x=f.f_x.at[:, 2].set(-10.0)) for f in zero.agents)
    lost = dataclasses.replace(zero, agents=fallen)
    explained = label_change(np.tile(up, (n, 1)), np.full(n, 10.0))
    state, found = corrector.init(team), []
    observations = [observed(zero)] * 50 + [observed(lost)] * 5 + [observed(lost, explained), observed(zero)]
    for k, observation in enumerate(observations):
        correction, state = corrector.update(state, observation, ControlClock(t=jnp.array(k * DT), dt=jnp.array(DT)))
        found.append([np.concatenate([f.f_x for f in x.agents])[:, 2] for x in (correction.error, correction.rate)])
    size = np.abs(found[-3][0]).max()
    assert (found[-3][0] < -0.05).all()
    np.testing.assert_allclose(found[-2:], 0.0, atol=1e-3 * size)


def test_kalman_filter_without_labels_returns_to_the_model():
    """Correction and weight decay, and the standard deviation tends to the RMS error of the model.

    The weight is the one that minimizes the variance of the sum of model and correction.
    """
    n, stop = 6000, 1000
    t = DT * np.arange(n)
    rng = np.random.default_rng(10)
    labels = np.tile(1.2 * np.sin(2 * np.pi * 2 * t)[:, None], (1, 6)) + 0.02 * rng.normal(size=(n, 6))
    on = np.arange(n) < stop
    labels[stop:] = labels[stop - 1]
    made = corrections(team_filter(), lambda _k: constant_model(0.0), np.zeros((n, 3)), labels, on)
    weight, std, error = (six(x.payload) for x in (made.weight, made.std, made.error))
    np.testing.assert_allclose(weight[:stop], 1.0)
    assert (np.diff(weight[stop:], axis=0) <= 0).all()
    assert np.abs(error[-1]).max() < 5e-3
    P_0, P_inf, E = std[stop - 1] ** 2, six(team_filter().std.payload) ** 2, 1.2**2 / 2
    np.testing.assert_allclose(weight[-1], E / (E + P_inf - P_0), rtol=0.25)
    assert weight[-1, :3].max() < 0.2
    np.testing.assert_allclose(std[-1], np.sqrt(P_0 + (1 - weight[-1]) * E), rtol=0.15)
    np.testing.assert_allclose(std[-1, :3], np.sqrt(E), rtol=0.15)
    assert (np.diff(std[stop - 1 :], axis=0) >= -1e-12).all()


def test_correction_before_the_first_label_is_zero():
    """Before any label, and in a flight without labels, the prediction is that of the model."""
    made = corrections(
        team_filter(), lambda _k: constant_model(0.7), np.zeros((50, 3)), np.ones((50, 6)), np.zeros(50, bool)
    )
    assert not any(np.any(x) for x in jax.tree.leaves((made.error, made.rate, made.nis, made.label_valid)))


@pytest.mark.parametrize("kind", CORRECTORS)
def test_outputs_without_labels_do_not_change_the_others(kind):
    """All other corrections are the same with and without labels of the agents' forces."""
    rng, n = np.random.default_rng(11), 200
    team, corrector = light_experiment().controller.team, CORRECTORS[kind]()
    size = residual_correction.flatten(zero_residual(team)).size
    y, dt = 1 + 0.1 * rng.normal(size=(n, size)).cumsum(axis=0), jnp.array(DT)

    def run(on: np.ndarray) -> residual_correction.ResidualCorrection:
        def step(state: Any, of: tuple) -> tuple:
            y, valid, interval = of
            label = residual_correction.unflatten(y, zero_residual(team))
            observation = ResidualObservation(
                label=label,
                prediction=zero_residual(team),
                update_index=jnp.zeros((), int),
                label_valid=residual_correction.by_output(team, jnp.ones(()), valid),
                interval=residual_correction.by_output(team, dt, interval),
            )
            correction, state = corrector.update(state, observation, ControlClock(t=jnp.zeros(()), dt=dt))
            return state, correction

        inputs = tuple(map(jnp.asarray, (y, on.astype(float), sample_intervals(on))))
        return jax.jit(lambda: jax.lax.scan(step, corrector.init(team), inputs)[1])()

    always, lost = run(np.ones(n, bool)), run(np.arange(n) < n // 2)
    jax.tree.map(np.testing.assert_array_equal, always.error.payload, lost.error.payload)
    jax.tree.map(np.testing.assert_array_equal, always.std.payload, lost.std.payload)
    for a, b in zip(always.error.agents, lost.error.agents, strict=True):
        np.testing.assert_array_equal(a.f_w, b.f_w)
        np.testing.assert_array_equal(a.f_r, b.f_r)
    assert np.abs(always.error.agents[0].f_x - lost.error.agents[0].f_x)[n // 2 :].min(axis=0).max() > 1e-3
    np.testing.assert_array_equal(lost.label_valid, np.arange(n) < n // 2)


def test_only_forces_of_agents_need_tip_readings_for_labels():
    of, dt = light_experiment().controller, jnp.array(DT)
    estimate = estimate_with_label(jnp.zeros(3), jnp.arange(6.0), jnp.zeros(()), jnp.array(0.3))
    found = residual_correction.observe(of.residual_model, of.team, estimate, dt)
    np.testing.assert_array_equal(six(found.label.payload), np.arange(6.0))
    np.testing.assert_array_equal(six(found.label_valid.payload), 1.0)
    np.testing.assert_array_equal(six(found.interval.payload), DT)
    for valid, interval in zip(found.label_valid.agents, found.interval.agents, strict=True):
        assert not np.any(valid.f_x)
        assert np.all(interval.f_x == 0.3)
        for each in (valid.f_w, valid.f_r):
            np.testing.assert_array_equal(each, 1.0)
        for each in (interval.f_w, interval.f_r):
            np.testing.assert_array_equal(each, DT)


def test_labels_need_tip_readings_where_contacts_bear_moments():
    """A contact moment cannot be separated from a moment of the residual."""
    team = experiment.make_experiment(scenario.load_scenario("rigid_beam"), "C1").controller.team
    found = residual_correction.by_output(team, jnp.ones(()), jnp.zeros(()))
    assert not any(np.any(x) for x in jax.tree.leaves(found.agents))
    np.testing.assert_array_equal(found.payload.tau, 0.0)
    np.testing.assert_array_equal(found.payload.F, 1.0)


def test_estimator_without_labels_is_refused():
    of = light_experiment()
    lam = tuple(jnp.zeros_like(g.contact_position) for g in of.controller.team.agent_groups)
    without_labels = StateEstimate(
        agents=of.initial_state.agents, payload=of.initial_state.payload, a_L=jnp.zeros(6), lam=lam
    )
    with pytest.raises(ValueError, match="provides no labels"):
        residual_correction.observe(of.controller.residual_model, of.controller.team, without_labels, jnp.array(DT))


def test_outputs_of_all_bodies_are_one_vector():
    team = light_experiment().controller.team
    size = residual_correction.flatten(zero_residual(team)).size
    x = jnp.arange(float(size))
    np.testing.assert_array_equal(residual_correction.flatten(residual_correction.unflatten(x, zero_residual(team))), x)


def test_standard_deviations_are_multiples_of_the_prior():
    """Every output has the standard deviation of its prior, times the stated factor."""
    from colift.scenario import controllers

    prior, std = light.settings().learning.payload.signal_std, team_filter().std
    np.testing.assert_allclose(std.payload.F, controllers.ERROR_STD_FACTOR * prior.force_N)
    np.testing.assert_allclose(std.payload.tau, controllers.ERROR_STD_FACTOR * prior.moment_Nm)


def test_changed_scenarios_differ_only_as_stated():
    """Shipped scenarios with changes differ from the paper's only in the stated sections."""
    paper = scenario.load_scenario("paper").model_dump()
    for name, differs in {
        "payload_added": {"name", "description", "payload_mass_step"},
        "labels_lost": {"name", "description", "sensors"},
        "jets": {"name", "description", "disturbances"},
        "path_leaves": {"name", "description", "duration_s", "reference"},
        "outdoors": {"name", "description", "actuators", "nominal", "disturbances", "sensors", "control"},
    }.items():
        options = scenario.load_scenario(name).model_dump()
        assert {key for key in paper if paper[key] != options[key]} == differs


# The label filter -----------------------------------------------------------------------------------------------------


def label_corrections(labels: np.ndarray, on: np.ndarray | None = None) -> residual_correction.ResidualCorrection:
    """Return the corrections of a zero model for labels behind the lag of the tip force sensors."""
    on = np.ones(len(labels)) if on is None else on
    held = labels[np.maximum.accumulate(np.where(on > 0, np.arange(len(labels)), 0))]
    make = LabelFilter(filters=FILTERS, averaging_time=jnp.array(0.05))
    return corrections(make, lambda _k: constant_model(0.0), np.zeros((len(labels), 3)), held, on)


def test_label_filter_subtracts_the_filtered_mean():
    """If labels equal the mean behind the sensor lag, the correction is zero; otherwise the filtered difference."""
    rng = np.random.default_rng(0)
    p = np.cumsum(rng.normal(size=(TICKS, 3)), axis=0) * 0.05
    x = np.concatenate([p, np.zeros((TICKS, 3)), np.tile(np.eye(3).ravel(), (TICKS, 1)), np.zeros((TICKS, 9))], axis=1)
    inputs, of = np.asarray(features.payload_features(jnp.asarray(x[::40]))), light_experiment().controller
    prior = of.residual_model.payload
    model = gp.condition(inputs, rng.normal(size=(len(inputs), 6)), prior.hyper, prior.capacity)
    trained = dataclasses.replace(of.residual_model, payload=model)
    f = six(jax.vmap(residual_model.predict_payload, (None, 0))(trained, jnp.asarray(x)))
    more = rng.normal(size=(TICKS, 6)).cumsum(axis=0) * 0.1
    made = corrections(LabelFilter(filters=FILTERS), lambda _k: trained, p, sensed(f) + more, np.ones(TICKS))
    expected = filtered_label(more)
    np.testing.assert_allclose(six(made.error.payload), expected, atol=1e-9)
    rate = six(made.rate.payload)
    np.testing.assert_allclose(rate[1:], np.diff(expected, axis=0) / DT, atol=1e-6)
    assert not rate[0].any()
    assert np.abs(f - f[0]).max() > 0.1


def test_label_filter_holds_the_correction_without_labels():
    """The correction is constant between labels, and its rate is the last change over the time since the label."""
    t, on = DT * np.arange(TICKS), np.arange(TICKS) % 10 == 0
    labels = np.tile((1.0 + 2.0 * t)[:, None], (1, 6))
    made = label_corrections(labels, on)
    error, rate, last = six(made.error.payload), six(made.rate.payload), np.flatnonzero(on)[1:]
    np.testing.assert_allclose(error, error[10 * (np.arange(TICKS) // 10)], atol=1e-12)
    np.testing.assert_allclose(rate[last], np.diff(error[::10], axis=0) / (10 * DT), rtol=1e-9)
    np.testing.assert_allclose(rate[last[-5:]], 2.0, rtol=0.01)
    since = np.arange(1, 10)
    np.testing.assert_allclose(rate[last[0] + since, 0], rate[last[0], 0] * 10 / (10 + since), rtol=1e-9)
    np.testing.assert_allclose(six(made.weight.payload), 1.0)


def test_label_filter_states_the_change_over_delay_and_age():
    """On a ramp the standard deviation is rate times delay and age of the label, at most that of two instants."""
    slope, stop = 3.0, 300
    labels = np.tile(slope * DT * np.arange(2 * TICKS)[:, None], (1, 6))
    made = label_corrections(labels, np.arange(2 * TICKS) < stop)
    std, age = six(made.std.payload)[:, 0], DT * np.arange(2 * TICKS - stop)
    assert std[stop - 1] == pytest.approx(slope * DELAY, rel=1e-4)
    limit = std[-1]
    np.testing.assert_allclose(std[stop:], np.minimum(slope * (DELAY + DT + age), limit), rtol=1e-4)
    b = -np.expm1(-DT / 0.05)
    mean_square = lfilter([b], [1, b - 1], six(made.error.payload)[1:stop, 0] ** 2)[-1]
    assert limit == pytest.approx(np.sqrt(2 * mean_square), rel=1e-9)


@pytest.mark.parametrize("seed", range(3))
def test_correction_error_is_bounded_by_the_label_delay(seed):
    """`|f - d| <= D sup|df/dt| + sup|error|`; with the lead twice the first term."""
    rng = np.random.default_rng(seed)
    f = low_pass(low_pass(rng.normal(size=(TICKS, 6)).cumsum(axis=0), rng.uniform(1, 30)), 5.0)
    rate = np.abs(np.diff(f, axis=0)).max(axis=0) / DT
    off = 0.01 * rng.uniform(-1, 1, size=f.shape)
    d = six(label_corrections(sensed(f + off)).error.payload)
    assert (np.abs(f - d) <= DELAY * rate + 0.01 + 1e-12).all()
    exact = label_corrections(sensed(f))
    ahead = six(exact.error.payload) + DELAY * six(exact.rate.payload)
    assert (np.abs(f - ahead) <= 2 * DELAY * rate + 1e-12).all()


def test_correction_error_on_a_ramp():
    """On a ramp the correction error is the label delay times the rate."""
    slopes = np.linspace(-2, 2, 6)
    ramp = np.outer(np.arange(TICKS) * DT, slopes)
    remaining = (ramp - six(label_corrections(sensed(ramp)).error.payload))[-1]
    np.testing.assert_allclose(remaining, (DELAY - 1.5 * DT) * slopes, rtol=1e-2)


# The corrected prediction ---------------------------------------------------------------------------------------------


class ConstantPredictor(residual_predictors.LearnedResidual):
    """Predictor that predicts seven for all outputs."""

    def predict(
        self,
        state: Any,
        model: residual_model.ResidualModel,
        context: interfaces.ControlContext,
        acceleration_cmd: tracking.AccelerationCommand,
    ) -> ResidualForces:
        """Return seven."""
        return jax.tree.map(lambda x: jnp.full_like(x, 7.0), zero_residual(context.team))


def predicted(
    correction: residual_correction.ResidualCorrection | None, lead_time: float, preview: float, attenuation: float
) -> ResidualForces:
    """Return the corrected prediction a preview time after the control period of the correction."""
    controller, t = light_experiment().controller, jnp.array(0.3)
    context = interfaces.ControlContext(
        team=controller.team,
        clock=ControlClock(t=t + preview, dt=jnp.array(DT)),
        measurement=None,
        estimate=estimate_with_label(jnp.zeros(3), jnp.zeros(6), jnp.ones(()), jnp.array(DT)),
        setpoint=controller.reference.evaluate(t),
        last_wrench=Wrench(F=jnp.zeros(3), tau=jnp.zeros(3)),
        initialized=jnp.ones(()),
        correction=None if correction is None else dataclasses.replace(correction, t=t),
    )
    acceleration_cmd = tracking.AccelerationCommand(a=jnp.zeros(3), alpha=jnp.zeros(3), jerk=jnp.zeros(3))
    predictor = residual_predictors.CorrectedResidual(
        base=ConstantPredictor(),
        lead_time=jnp.array(lead_time),
        rate_attenuation=tuple(jnp.full(size, attenuation) for size in controller.team.sizes),
    )
    return predictor.predict((), constant_model(0.0), context, acceleration_cmd)


def test_prediction_extrapolates_over_lead_and_preview_time():
    """The model plus correction and rate over lead time and preview; agents use a share of the rate."""
    rng, team = np.random.default_rng(12), light_experiment().controller.team
    zero = residual_correction.zero_correction(zero_residual(team), jnp.zeros(()))
    size = residual_correction.flatten(zero.error).size
    d, v = rng.normal(size=(2, size))
    forces = lambda x: residual_correction.unflatten(jnp.asarray(x), zero_residual(team))  # noqa: E731
    correction = dataclasses.replace(zero, error=forces(d), rate=forces(v))
    found = np.asarray(residual_correction.flatten(predicted(correction, 0.02, 0.03, 0.4)))
    attenuation = np.asarray(
        residual_correction.flatten(
            ResidualForces(
                payload=jax.tree.map(jnp.ones_like, zero.error.payload),
                agents=jax.tree.map(lambda x: jnp.full_like(x, 0.4), zero.error.agents),
            )
        )
    )
    np.testing.assert_allclose(found, 7.0 + d + 0.05 * attenuation * v, rtol=1e-9, atol=1e-9)


def test_prediction_without_a_corrector_is_refused():
    with pytest.raises(ValueError, match="residual_corrector"):
        predicted(None, 0.0, 0.0, 1.0)
