"""Tests of learned models: growing data, frozen models, and the rigid-body regressor against a cloud of points."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh
from scipy.spatial.transform import Rotation
from sklearn.linear_model import Ridge

from colift import gp
from colift.models.parameters import Payload
from colift.models.state import PayloadState
from colift.onboard.learning import (
    identification,
    mean_functions,
    model_update,
    recorder,
    residual_model,
    ridge_regression,
)
from colift.onboard.learning.features import PAYLOAD_FEATURES, agent_feature_names, payload_features

CAPACITY = 48
record = jax.jit(gp.keep_first)
regressor = jax.jit(identification.inertial_regressor)
STATED = {m: gp.make_hyperparameters(np.full(m, 4.0), np.ones((m, d)), np.full(m, 0.01)) for m, d in ((6, 20), (9, 24))}
TRAINING = model_update.FitOptions(
    payload=gp.HyperPrior(STATED[6], scale_factor=10.0),
    agents=(gp.HyperPrior(STATED[9], scale_factor=10.0),),
    restarts=0,
    max_iterations=15,
)


# Data -----------------------------------------------------------------------------------------------------------------


@settings(max_examples=20)
@given(offered=st.lists(st.booleans(), max_size=12))
def test_data_are_appended_until_the_buffer_is_full(offered):
    """Samples are appended in order until the buffer is full."""
    data, kept = gp.empty_dataset(5, 3, 2), []
    for i, now in enumerate(offered):
        x, y, t = np.arange(3.0) + i, np.arange(2.0) - i, 0.1 * i
        data, _ = record(data, jnp.array(x), jnp.array(y), jnp.array(t), jnp.array(now))
        if now and len(kept) < 5:
            kept.append((x, y, t))
        assert int(data.n) == len(kept)
        for row, (x_kept, y_kept, t_kept) in enumerate(kept):
            np.testing.assert_array_equal(data.X[row], x_kept)
            np.testing.assert_array_equal(data.Y[row], y_kept)
            assert data.t[row] == t_kept
        assert not np.any(data.X[len(kept) :])


def test_features_are_those_of_the_paper():
    """In the order of their names."""
    x = np.arange(1.0, 25.0)
    features = dict(zip(PAYLOAD_FEATURES, np.asarray(payload_features(jnp.array(x))), strict=True))
    assert len(features) == 20
    assert [features[k] for k in ("p_x", "v_z", "R_xx", "R_xz", "R_zx", "omega_y")] == [1, 6, 7, 9, 13, 17]
    assert features["|v|"] == pytest.approx(np.linalg.norm(x[3:6]))
    assert features["|omega|"] == pytest.approx(np.linalg.norm(x[15:18]))
    at_rest = jax.jacfwd(payload_features)(jnp.zeros(24))
    assert np.isfinite(at_rest).all()
    assert len(agent_feature_names(3)) == 18 + 2 * 3


# Models ---------------------------------------------------------------------------------------------------------------


def samples(seed: int, n: int, inputs: int, outputs: int, agents: tuple[int, ...] = ()) -> gp.Dataset:
    """Return labelled samples of smooth functions, n of them in use."""
    rng = np.random.default_rng(seed)
    X = rng.normal(size=(*agents, CAPACITY, inputs))
    Y = np.sin(X[..., :outputs]) + 0.5 * X[..., 1 : outputs + 1] + 0.01 * rng.normal(size=(*agents, CAPACITY, outputs))
    used = np.arange(CAPACITY) < n
    return gp.Dataset(
        X=jnp.array(X * used[:, None]),
        Y=jnp.array(Y * used[:, None]),
        t=jnp.array(np.broadcast_to(0.1 * np.arange(CAPACITY), (*agents, CAPACITY))),
        n=jnp.full(agents, n),
        num_seen=jnp.full(agents, n),
    )


def both(payload: gp.Dataset, agents: gp.Dataset) -> recorder.RecorderState:
    """Combine samples of the payload and of a group of two agents."""
    return recorder.RecorderState(payload=payload, agents=(agents,), next_sample_time=jnp.zeros(()))


def prior() -> residual_model.ResidualModel:
    """Return the model before any data: a payload and a group of two agents with three joints."""
    agents = jax.tree.map(lambda x: jnp.stack([x, x]), gp.prior(STATED[9], CAPACITY))
    return residual_model.ResidualModel(
        payload=gp.prior(STATED[6], CAPACITY), agents=(agents,), inertial_parameters=jnp.zeros(10)
    )


@pytest.fixture(scope="module")
def trained() -> tuple[residual_model.ResidualModel, model_update.Fits]:
    """Model of 30 samples of every body."""
    return model_update.fit(prior(), both(samples(0, 30, 24, 6), samples(1, 30, 24, 9, (2,))), TRAINING, {})


def test_model_without_data_predicts_the_prior():
    """Before any data the model predicts zero with the prior standard deviation."""
    x = jnp.array(np.random.default_rng(3).normal(size=(4, 24)))
    W = residual_model.predict_payload(prior(), x[0])
    (f,) = residual_model.predict_agents(prior(), (x[:2],))
    assert not any(np.any(leaf) for leaf in (*jax.tree.leaves(W), *jax.tree.leaves(f)))
    np.testing.assert_allclose(residual_model.payload_std(prior(), x), 2.0)
    np.testing.assert_allclose(residual_model.agent_std(prior().agents[0], jnp.stack([x, x], axis=1)), 2.0)


def test_trained_model_reproduces_its_labels(trained):
    """A trained model reproduces its labels with a smaller standard deviation."""
    model, fits = trained
    load, agents = samples(0, 30, 24, 6), samples(1, 30, 24, 9, (2,))
    assert set(fits) == {"payload", (0, 0), (0, 1)}
    W = jax.vmap(residual_model.predict_payload, in_axes=(None, 0))(model, load.X[:30])
    spread = np.asarray(load.Y)[:30].std(0)
    assert (np.abs(np.concatenate([W.F, W.tau], axis=1) - load.Y[:30]).max(0) < 0.5 * spread).all()
    (f,) = jax.vmap(residual_model.predict_agents, in_axes=(None, 0))(model, (agents.X[:, :30].transpose(1, 0, 2),))
    each = np.concatenate([f.f_x, f.f_w, f.f_r], axis=2).transpose(1, 0, 2)
    assert (np.abs(each - agents.Y[:, :30]).mean() < 0.3 * np.asarray(agents.Y)[:, :30].std(1)).all()
    far = residual_model.payload_std(model, 100 + load.X[:30])
    assert (residual_model.payload_std(model, load.X[:30]).mean(0) < 0.7 * far.mean(0)).all()


def test_second_fit_starts_at_the_first_optimum(trained, monkeypatch):
    """The first fit of a body has restarts and no start; later ones have a start and no restarts."""
    model, fits = trained
    training = dataclasses.replace(TRAINING, restarts=1)
    queries, fit = [], gp.fit

    def recorded_fit(X, Y, **given):
        queries.append((given["start"], given["restarts"]))
        return fit(X, Y, **given | {"max_iterations": 2})

    monkeypatch.setattr(gp, "fit", recorded_fit)
    agents = samples(1, 30, 24, 9, (2,))
    agents = dataclasses.replace(agents, n=jnp.array([30, 0]))
    _, later = model_update.fit(model, both(samples(0, 40, 24, 6), agents), training, fits)
    assert {id(start) for start, _ in queries} == {id(fits[body].hyper) for body in ("payload", (0, 0))}
    assert {restarts for _, restarts in queries} == {0}
    assert later[0, 1] is fits[0, 1]
    assert later["payload"] is not fits["payload"]
    queries.clear()
    model_update.fit(prior(), both(samples(0, 30, 24, 6), agents), training, {})
    assert queries == [(None, 1)] * 2


def test_conditioning_keeps_hyperparameters():
    """Each body is conditioned on its own data with the prior's hyperparameters; one without data keeps its prior."""
    load, agents = samples(0, 30, 24, 6), samples(1, 30, 24, 9, (2,))
    agents = dataclasses.replace(agents, n=jnp.array([30, 0]))
    trained_model, fits = model_update.fit(prior(), both(load, agents), None, {})
    assert fits == {}
    for now, before in zip(jax.tree.leaves((trained_model.payload.hyper, trained_model.agents[0].hyper)),
                           jax.tree.leaves((prior().payload.hyper, prior().agents[0].hyper)), strict=True):  # fmt: skip
        np.testing.assert_array_equal(now, before)
    x = np.random.default_rng(6).normal(size=24)
    features = np.asarray(payload_features(load.X[:30]))
    queries = np.asarray(payload_features(jnp.array(x)))
    for model, X, Y, at in (
        (trained_model.payload, features, load.Y[:30], queries),
        (
            jax.tree.map(lambda leaf: leaf[0], trained_model.agents[0]),
            np.asarray(agents.X)[0, :30],
            agents.Y[0, :30],
            x,
        ),
    ):
        k = lambda P, Q: 4.0 * np.exp(-0.5 * ((P[:, None] - Q[None]) ** 2).sum(-1))  # noqa: E731
        expected = k(at[None], X) @ np.linalg.solve(k(X, X) + 0.01 * np.eye(30), np.asarray(Y))
        np.testing.assert_allclose(gp.mean(model, jnp.array(at)), expected[0], atol=1e-9)
    assert not gp.mean(jax.tree.map(lambda leaf: leaf[1], trained_model.agents[0]), jnp.array(x)).any()
    again, _ = model_update.fit(prior(), both(load, agents), None, {})
    jax.tree.map(np.testing.assert_array_equal, again, trained_model)


def test_model_is_independent_of_later_data(trained):
    model, _ = trained
    x = jnp.array(np.random.default_rng(4).normal(size=24))
    before = [np.array(leaf) for leaf in jax.tree.leaves(model)]
    prediction = residual_model.predict_payload(model, x)
    data = samples(0, 30, 24, 6)
    for _ in range(3):
        data, _ = record(data, x, jnp.full(6, 9.0), jnp.array(1.0), jnp.array(True))
    later, _ = model_update.fit(model, both(data, samples(1, 30, 24, 9, (2,))), TRAINING, {})
    assert np.abs(residual_model.predict_payload(later, x).F - prediction.F).max() > 0.1
    for leaf, kept in zip(jax.tree.leaves(model), before, strict=True):
        np.testing.assert_array_equal(leaf, kept)
    np.testing.assert_array_equal(residual_model.predict_payload(model, x).F, prediction.F)
    with pytest.raises(dataclasses.FrozenInstanceError):
        model.inertial_parameters = jnp.ones(10)


def test_body_without_data_keeps_its_model(trained):
    model, fits = trained
    none = gp.empty_dataset(CAPACITY, 24, 9, (2,))
    one = dataclasses.replace(samples(1, 30, 24, 9, (2,)), n=jnp.array([0, 30]))
    later, now = model_update.fit(model, both(gp.empty_dataset(CAPACITY, 24, 6), none), TRAINING, fits)
    for a, b in zip(jax.tree.leaves(later), jax.tree.leaves(model), strict=True):
        np.testing.assert_array_equal(a, b)
    assert now == fits
    half, now = model_update.fit(prior(), both(gp.empty_dataset(CAPACITY, 24, 6), one), TRAINING, {})
    assert set(now) == {(0, 1)}
    assert list(half.agents[0].num_points) == [0, 30]
    for a, b in zip(jax.tree.leaves(half.agents[0]), jax.tree.leaves(prior().agents[0]), strict=True):
        np.testing.assert_array_equal(a[0], b[0])


def test_constant_mean_is_the_mean_of_the_labels(trained):
    """The constant mean of an output is the mean of its labels."""
    model, _ = trained
    far = jnp.full(24, 1e3)
    W = residual_model.predict_payload(model, far)
    np.testing.assert_allclose([*W.F, *W.tau], np.asarray(samples(0, 30, 24, 6).Y)[:30].mean(0), atol=1e-9)


# Online updates -------------------------------------------------------------------------------------------------------


def test_path_samples_are_kept_within_the_budget(trained):
    """Samples of a path are kept although the team then stays at one point for twice the budget."""
    model, _ = trained
    path, agents = samples(7, CAPACITY // 2, 24, 6), samples(8, 30, 24, 9, (2,))
    nothing = jax.tree.map(jnp.zeros_like, both(path, agents))
    variations = dict.fromkeys(("payload", (0, 0), (0, 1)), model_update.Variation(rate=1 / 8000))

    def select(previous, recorded, last, t):
        merged = model_update.merge_samples(previous, recorded, last)
        return model_update.select_samples(model, merged, previous, t, variations)

    kept = select(nothing, both(path, agents), -1.0, 5.0)
    for body, expected in model_update.samples_by_body(both(path, agents)).items():
        for one, other in zip(model_update.samples_by_body(kept)[body], expected, strict=True):
            np.testing.assert_array_equal(one, other)
    place = samples(9, 1, 24, 6)
    for k in range(3):
        again = [jnp.broadcast_to(x[:1], x.shape) for x in (place.X, place.Y)]
        t = jnp.asarray(10.0 * (k + 1) + 0.1 * np.arange(CAPACITY))
        here = dataclasses.replace(place, X=again[0], Y=again[1], t=t, n=jnp.asarray(CAPACITY))
        kept = select(kept, both(here, agents), 10.0 * (k + 1) - 1, 10.0 * (k + 2))
    _, _, t = model_update.samples_by_body(kept)["payload"]
    assert len(t) == CAPACITY
    assert (t < 5).sum() == CAPACITY // 2
    assert t[-CAPACITY // 2 :].min() > 29  # of equal samples the newest
    assert [len(model_update.samples_by_body(kept)[0, j][2]) for j in range(2)] == [
        30,
        30,
    ]  # no sample is selected twice


def test_noise_of_the_selection_states_the_changes_since(trained, monkeypatch):
    """Noise variance plus the variance of random walk and jumps since a sample, in noise variances."""
    model, _ = trained
    load, agents = samples(7, CAPACITY, 24, 6), samples(8, 30, 24, 9, (2,))
    later = dataclasses.replace(load, t=load.t + 10.0)
    merged = model_update.merge_samples(both(load, agents), both(later, agents), 9.0)
    found, original = [], gp.select_subset
    monkeypatch.setattr(gp, "select_subset", lambda *given: found.append(given[3]) or original(*given))
    variations = {body: model_update.Variation(rate=1e-3, times=(2.0, 9.9)) for body in merged}
    model_update.select_samples(model, {"payload": merged["payload"]}, both(load, agents), 15.0, variations)
    t, ratio = (
        merged["payload"][2],
        float((model.payload.hyper.signal_variance / model.payload.hyper.noise_variance)[0]),
    )
    jumps = (t < 2.0).astype(float) + (t < 9.9)
    np.testing.assert_allclose(found[0], 1 + ratio * (1e-3 * (15.0 - t) + gp.JUMP_SHARE * jumps), rtol=1e-12)


def test_samples_are_sorted_by_time(trained):
    """Rows of an overwritten buffer are out of order."""
    model, _ = trained
    load, agents = samples(7, 40, 24, 6), samples(8, 40, 24, 9, (2,))
    turned = jax.tree.map(lambda x: jnp.roll(x[:40], 13, axis=0), (load.X, load.Y, load.t))
    mixed = dataclasses.replace(load, X=turned[0], Y=turned[1], t=turned[2])
    for one, other in zip(
        model_update.regression_targets(model, both(load, agents))["payload"],
        model_update.regression_targets(model, both(mixed, agents))["payload"],
        strict=True,
    ):
        np.testing.assert_array_equal(one, other)


def test_drag_thrust_mean(trained):
    """Drag and thrust act on forces, and the payload's drag at its lever."""
    model, _ = trained
    drag_thrust = mean_functions.DragThrustMean(
        payload=jnp.array([0.5, 0.1, -0.2, 0.3]), agents=(jnp.array([[0.2, 1.5], [0.0, -1.0]]),)
    )
    with_drag_thrust = dataclasses.replace(model, mean_function=drag_thrust)
    rng = np.random.default_rng(3)
    R = Rotation.from_rotvec(rng.normal(size=(3, 3))).as_matrix()
    x = rng.normal(size=24)
    x[6:15] = R[0].reshape(9)
    W, bare = (
        residual_model.predict_payload(with_drag_thrust, jnp.asarray(x)),
        residual_model.predict_payload(model, jnp.asarray(x)),
    )
    drag = -0.5 * x[3:6]
    np.testing.assert_allclose(W.F - bare.F, drag, atol=1e-12)
    np.testing.assert_allclose(W.tau - bare.tau, np.cross([0.2, -0.4, 0.6], R[0].T @ drag), atol=1e-12)
    X = rng.normal(size=(2, 24))
    X[:, :9] = R[1:].reshape(2, 9)
    (f,), (was,) = (residual_model.predict_agents(of, (jnp.asarray(X),)) for of in (with_drag_thrust, model))
    pushed = np.array([[1.5], [-1.0]]) * R[1:, :, 2] - np.array([[0.2], [0.0]]) * X[:, 18:21]
    np.testing.assert_allclose(f.f_x - was.f_x, pushed, atol=1e-12)
    np.testing.assert_array_equal(f.f_w, was.f_w)
    load, agents = samples(0, 30, 24, 6), samples(1, 30, 24, 9, (2,))
    left = model_update.regression_targets(with_drag_thrust, both(load, agents))
    for k in range(3):
        predictions = drag_thrust.payload_mean(load.X[k])
        np.testing.assert_allclose(left["payload"][1][k], load.Y[k] - predictions, atol=1e-12)
        np.testing.assert_allclose(
            left[0, 1][1][k], (agents.Y[:, k] - drag_thrust.agent_means(0, agents.X[:, k]))[1], atol=1e-12
        )


# Parametric models ----------------------------------------------------------------------------------------------------


def test_regression_has_two_ridge_parameters():
    """Forces and moments have separate ridge parameters."""
    n, group = 40, samples(32, 40, 24, 9, (2,))
    recorded = both(samples(31, n, 18, 6), group)
    mean_function = ridge_regression.fit_ridge(prior(), recorded, (0.3, 3.0)).mean_function
    bodies = [(mean_function.payload, mean_functions.payload_basis_functions(recorded.payload.X), recorded.payload.Y)]
    bodies += zip(mean_function.agents[0], mean_functions.agent_basis_functions(group.X, 3), group.Y, strict=True)
    for weights, functions, Y in bodies:
        for outputs, ridge in ((slice(0, 3), 0.3), (slice(3, None), 3.0)):
            theirs = Ridge(alpha=ridge, fit_intercept=False).fit(np.asarray(functions)[:n], np.asarray(Y)[:n, outputs])
            np.testing.assert_allclose(weights[:, outputs], theirs.coef_.T, atol=1e-9)


def cloud(rng: np.random.Generator, points: int = 7) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Masses and points of a rigid cloud, and its ten parameters about the frame's origin."""
    m, c = rng.uniform(0.1, 1, points), rng.normal(size=(points, 3))
    J = sum(mass * (p @ p * np.eye(3) - np.outer(p, p)) for mass, p in zip(m, c, strict=True))
    return m, c, np.array([m.sum(), *(m @ c), J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]])


@given(seed=st.integers(0, 10**6))
def test_regressor_gives_the_wrench_of_a_point_cloud(seed):
    """The regressor gives the wrench that accelerates a cloud of points."""
    rng = np.random.default_rng(seed)
    m, c, theta = cloud(rng)
    R = Rotation.random(random_state=rng).as_matrix()
    w, alpha, a = rng.normal(size=(3, 3))
    # Newton for every point, no rigid-body formula
    of_points = a + (np.cross(alpha, c) + np.cross(w, np.cross(w, c))) @ R.T
    force = m @ of_points
    moment = sum(np.cross(p, R.T @ (mass * b)) for mass, p, b in zip(m, c, of_points, strict=True))
    q = PayloadState(R=jnp.array(R), p=jnp.zeros(3), omega=jnp.array(w), v=jnp.zeros(3))
    Y = np.asarray(regressor(q, jnp.array(a), jnp.array(alpha)))
    np.testing.assert_allclose(Y @ theta, [*force, *moment], atol=1e-11)


def motions(rng: np.random.Generator, n: int, turning: float) -> np.ndarray:
    """Payload samples `(p, v, vec R, omega, a - g, alpha)` with rotations of a given size."""
    X = rng.normal(size=(n, 24))
    X[:, 6:15] = Rotation.from_rotvec(turning * rng.normal(size=(n, 3))).as_matrix().reshape(n, 9)
    X[:, 15:18] *= turning
    X[:, 18:21] = [0, 0, 9.81] + rng.normal(size=(n, 3))
    X[:, 21:24] *= turning
    return X


def labelled(rng: np.random.Generator, X: np.ndarray, theta: np.ndarray, sigma: np.ndarray) -> np.ndarray:
    """Labels of a rigid body with these parameter errors, and noise."""
    Y = []
    for x in X:
        q = PayloadState(R=jnp.array(x[6:15].reshape(3, 3)), p=jnp.zeros(3), omega=jnp.array(x[15:18]), v=jnp.zeros(3))
        Y.append(np.asarray(regressor(q, jnp.array(x[18:21]), jnp.array(x[21:24]))) @ theta)
    return np.array(Y) + sigma * rng.normal(size=(len(X), 6))


SIGMA = np.array([0.1] * 3 + [0.02] * 3)
NOISE = SIGMA[:, None, None] ** 2 * np.eye(200)
PRIOR = np.array([1.0] + [0.1] * 3 + [0.1] * 6)


def test_identification_of_a_rotating_payload():
    """All parameters of a rotating payload are recovered."""
    rng = np.random.default_rng(7)
    theta = np.array([-0.3, 0.02, -0.05, 0.01, -0.01, 0.03, 0.02, 0.005, -0.004, 0.01])
    X = motions(rng, 200, turning=1.0)
    found, left = identification.identify_parameters(
        identification.inertial_regressors(X), labelled(rng, X, theta, SIGMA), NOISE, PRIOR
    )
    assert (left < 0.2).all()
    assert (np.abs(found - theta) < 5 * left * PRIOR).all()  # five posterior standard deviations
    assert abs(found[0] - theta[0]) < 0.01


def test_identification_at_constant_attitude():
    """At a constant attitude the mass is identified and the inertia keeps its prior."""
    rng = np.random.default_rng(8)
    theta = np.array([-0.3, 0.02, -0.05, 0.0, *[0.05] * 6])
    X = motions(rng, 200, turning=0.0)
    found, left = identification.identify_parameters(
        identification.inertial_regressors(X), labelled(rng, X, theta, SIGMA), NOISE, PRIOR
    )
    assert abs(found[0] - theta[0]) < 0.01
    assert left[0] < 0.01
    np.testing.assert_allclose(found[4:], 0, atol=1e-12)
    np.testing.assert_allclose(left[4:], 1, atol=1e-12)


def test_identification_without_excitation_is_the_prior():
    found, left = identification.identify_parameters(np.zeros((0, 6, 10)), np.zeros((0, 6)), np.zeros((6, 0, 0)), PRIOR)
    np.testing.assert_array_equal(found, 0)
    np.testing.assert_array_equal(left, 1)


@pytest.mark.parametrize("seed", range(30))
def test_physical_consistency_keeps_a_tenth_of_the_inertia(seed):
    """By the inertia matrix from `regressor` at rest: parameters are scaled in order of identifiability, and only
    if needed.
    """
    rng = np.random.default_rng(seed)
    turn = Rotation.random(random_state=seed).as_matrix()
    J = turn @ np.diag(rng.uniform(0.01, 2.0, 3)) @ turn.T
    nominal = Payload(mass=jnp.asarray(rng.uniform(0.5, 5.0)), inertia=jnp.asarray(J))
    theta = rng.normal(size=10) * np.array([1.0, *[0.2] * 3, *[0.3] * 6])
    rest = PayloadState(R=jnp.eye(3), p=jnp.zeros(3), omega=jnp.zeros(3), v=jnp.zeros(3))

    def inertia(theta: np.ndarray) -> np.ndarray:
        of = lambda e: regressor(rest, e[:3], e[3:]) @ theta  # noqa: E731
        return np.asarray(jax.vmap(of, out_axes=1)(jnp.eye(6)))

    whole = inertia(np.array([float(nominal.mass), 0, 0, 0, J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]))
    left = lambda theta: eigh(whole - inertia(theta), whole, eigvals_only=True)[0]  # noqa: E731
    found = identification.enforce_physical_consistency(theta, nominal)
    if left(theta) >= 0.1:
        np.testing.assert_allclose(found, theta, rtol=1e-12)
        return
    np.testing.assert_allclose(left(found), 0.1, rtol=1e-9)
    first = next(k for k in (4, 1, 0) if left(np.where(np.arange(10) < k, theta, 0.0)) > 0.1)
    np.testing.assert_array_equal(found[:first], theta[:first])
    share = found[first:] / theta[first:]
    np.testing.assert_allclose(share, share[0], rtol=1e-9)
    assert 0 <= share[0] < 1
