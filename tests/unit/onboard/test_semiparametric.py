"""Tests of the semiparametric model: a spatial GP with a mean of mass, drag and thrust."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift import gp
from colift.models.parameters import Payload
from colift.onboard.learning import (
    features,
    identification,
    mean_functions,
    model_update,
    recorder,
    residual_model,
    semiparametric,
)
from tests.unit.onboard.test_residual_model import STATED, TRAINING, both, prior, samples

ROOM, N = 128, 100
MASS, C, K = -0.4, 0.3, 0.8
MEAN = semiparametric.MeanPrior(
    payload=np.array([0.5, *[0.05] * 3, 0.5, *[0.2] * 3, *[3.0] * 3, *[0.6] * 3]),
    agents=np.array([0.5, 2.0, 3, 3, 3]),
    nominal_payload=Payload(mass=jnp.asarray(1.2), inertia=jnp.diag(jnp.array([0.03, 0.12, 0.15]))),
)


def field(p: np.ndarray) -> np.ndarray:
    """A force that depends on position [N]."""
    return np.stack([np.sin(2 * p[..., 0]), np.cos(2 * p[..., 1]), 0.5 * np.sin(p[..., 0] + p[..., 1])], axis=-1)


def recorded_flight(seed: int, times: float = 1.0) -> recorder.RecorderState:
    """Samples of a payload and two agents with three joints, with mass, drag and thrust errors and the field.

    Not always equally fast: on one loop at one speed, velocity and acceleration are functions of the place.
    """
    rng = np.random.default_rng(seed)
    speed = times * rng.uniform(0.5, 1.5, (ROOM, 1))
    phase, used = np.sort(rng.uniform(0, 2 * np.pi, ROOM)), np.arange(ROOM) < N
    p = np.stack([np.cos(phase), np.sin(phase), 0.2 * np.sin(2 * phase)], axis=1)
    v = speed * np.stack([-np.sin(phase), np.cos(phase), 0.4 * np.cos(2 * phase)], axis=1)
    R = Rotation.from_rotvec(0.2 * rng.normal(size=(ROOM, 3))).as_matrix()
    a, omega, alpha = -(speed**2) * p + [0, 0, 9.81], 0.1 * rng.normal(size=(ROOM, 3)), 0.1 * rng.normal(size=(ROOM, 3))
    X = np.concatenate([p, v, R.reshape(ROOM, 9), omega, a, alpha], axis=1)
    drag = -C * v
    F = MASS * a + drag + field(p)
    tau = np.cross([0.0, 0.0, 0.1], np.einsum("nji,nj->ni", R, drag))
    payload = X, np.concatenate([F, tau], axis=1) + 0.01 * rng.normal(size=(ROOM, 6)), ()
    x = p + np.array([[[0.5, 0, 0.2]], [[-0.5, 0, 0.2]]])
    R = Rotation.from_rotvec(0.2 * rng.normal(size=(2 * ROOM, 3))).as_matrix().reshape(2, ROOM, 3, 3)
    v_2, rest = np.broadcast_to(v, (2, ROOM, 3)), 0.1 * rng.normal(size=(2, ROOM, 6))
    Z = np.concatenate([R.reshape(2, ROOM, 9), x, rest[..., :3], rest[..., 3:], v_2, 0 * rest[..., :3]], axis=2)
    f = K * R[..., 2] - C * v_2 + field(x)
    joints = 0.1 * np.sin(3 * rest)
    agents = Z, np.concatenate([f, joints], axis=2) + 0.01 * rng.normal(size=(2, ROOM, 9)), (2,)

    def data(X: np.ndarray, Y: np.ndarray, lead: tuple[int, ...]) -> gp.Dataset:
        t = np.broadcast_to(np.arange(ROOM) / 10, (*lead, ROOM))
        many = jnp.full(lead, N)
        return gp.Dataset(
            X=jnp.asarray(X * used[:, None]), Y=jnp.asarray(Y * used[:, None]), t=jnp.asarray(t), n=many, num_seen=many
        )

    return both(data(*payload), data(*agents))


def training() -> model_update.FitOptions:
    """Fit options of models with position inputs."""
    names = (features.PAYLOAD_FEATURES, features.agent_feature_names(3))
    (load, agent), plain = (TRAINING.payload, TRAINING.agents[0]), features.DefaultFeatures()
    assert plain.payload_names() == names[0]
    return dataclasses.replace(
        TRAINING,
        payload=semiparametric.position_only_prior(load, names[0], payload=True),
        agents=(semiparametric.position_only_prior(agent, names[1], payload=False),),
        max_iterations=60,
    )


def untrained_model() -> residual_model.ResidualModel:
    """Model before any data, with free capacity."""
    agents = jax.tree.map(lambda x: jnp.stack([x, x]), gp.prior(STATED[9], ROOM))
    return residual_model.ResidualModel(
        payload=gp.prior(STATED[6], ROOM),
        agents=(agents,),
        inertial_parameters=jnp.zeros(10),
        mean_function=mean_functions.zero_drag_thrust([2]),
    )


BODIES = ("payload", (0, 0), (0, 1))


@pytest.fixture(scope="module")
def trained() -> tuple[residual_model.ResidualModel, model_update.Fits, dict]:
    """Model of one flight."""
    return semiparametric.fit(untrained_model(), recorded_flight(0), training(), MEAN, {}, BODIES)


def test_mass_drag_and_thrust_are_separated_from_the_field(trained):
    """The estimates are within the tolerance that their covariance states."""
    model, fits, covariances = trained
    assert set(fits) == set(covariances) == {"payload", (0, 0), (0, 1)}
    found = [*model.inertial_parameters[:4], *model.mean_function.payload]
    true = [MASS, 0, 0, 0, C, 0, 0, 0.1 * C]
    deviation = np.sqrt(np.diagonal(covariances["payload"]))[:8]
    assert (np.abs(np.array(found) - true) <= 4 * deviation).all()
    assert (deviation[[0, 4]] < [0.05, 0.1]).all()
    for j in range(2):
        deviation = np.sqrt(np.diagonal(covariances[0, j]))[:2]
        assert (np.abs(np.array(model.mean_function.agents[0][j]) - [C, K]) <= 4 * deviation).all()
        assert (deviation < [0.1, 0.1]).all()


def test_forces_depend_on_position_only(trained):
    """Force models use the position only; moments and joints of agents use all features."""
    model, fits, _ = trained
    seen = {
        name
        for name, scale in zip(features.PAYLOAD_FEATURES, model.payload.hyper.lengthscales[0], strict=True)
        if scale < 1e3
    }
    assert seen == {"p_x", "p_y", "p_z"}
    scale = model.agents[0].hyper.lengthscales[0]
    names = np.array(features.agent_feature_names(3))
    assert set(names[np.asarray(scale[0]) < 1e3]) == {"x_x", "x_y", "x_z"}
    assert (np.asarray(scale[3:]) < 1e3).all()
    assert fits[0, 0].lengthscales.shape == (9, 24)
    assert fits[0, 0].converged.shape == (9,)


def test_model_generalizes_to_position_and_speed(trained):
    """Elsewhere in the same field and at twice the speed it predicts better than a model of all features."""
    model, fast = trained[0], recorded_flight(5, times=2.0)
    full, _ = model_update.fit(untrained_model(), recorded_flight(0), TRAINING, {})
    errors = {}
    for name, of in (("place", model), ("full", full)):
        left = model_update.regression_targets(of, fast)
        for body in ("payload", (0, 0)):
            X, Y, _ = left[body]
            errors[name, body] = np.sqrt(
                ((Y - residual_model.predict_padded(residual_model.get_model(of, body), X)[0])[:, :3] ** 2).mean()
            )
    for body in ("payload", (0, 0)):
        assert errors["place", body] < 0.5 * errors["full", body]
        assert errors["place", body] < 0.15


def test_mean_uncertainty_calibrates_extrapolation():
    """Errors at twice the speed are calibrated only with the uncertainty of the mean; over several environments."""
    squares, bare = [], []
    for seed in range(6):
        dataset, fast = recorded_flight(10 + seed), recorded_flight(50 + seed, times=2.0)
        fitted_model, _, covariances = semiparametric.fit(untrained_model(), dataset, training(), MEAN, {}, BODIES)
        uncertainties = semiparametric.mean_uncertainties(fitted_model, dataset, covariances, {})
        for body in ("payload", (0, 1)):
            (Z, left, _), x = (
                model_update.regression_targets(fitted_model, fast)[body],
                model_update.samples_by_body(fast)[body][0],
            )
            model = residual_model.get_model(fitted_model, body)
            mean, variance = residual_model.predict_padded(model, Z)
            variance = variance + np.asarray(model.hyper.noise_variance)
            more = semiparametric.mean_variance(
                model, uncertainties[body], Z, semiparametric.mean_regressors(x, isinstance(body, str))
            )
            assert (more >= 0).all()
            squares.append(((left - mean) ** 2 / (variance + more))[:, :3].mean())
            bare.append(((left - mean) ** 2 / variance)[:, :3].mean())
    assert np.mean(squares) < 1.6
    assert np.mean(bare) > np.mean(squares)


def test_unselected_bodies_are_unchanged(trained):
    """A body that is not selected keeps its mean and hyperparameters."""
    model, fits, _ = trained
    change = {"payload": model_update.make_change_point(model, "payload", 5.0)}
    later, now, covariances = semiparametric.fit(
        model, recorded_flight(1), training(), MEAN, fits, {(0, 0), (0, 1)}, change
    )
    np.testing.assert_array_equal(later.inertial_parameters, model.inertial_parameters)
    np.testing.assert_array_equal(later.mean_function.payload, model.mean_function.payload)
    np.testing.assert_array_equal(later.payload.hyper.lengthscales, model.payload.hyper.lengthscales)
    assert now["payload"] is fits["payload"]
    assert set(covariances) == {(0, 0), (0, 1)}
    assert np.any(later.mean_function.agents[0] != model.mean_function.agents[0])
    assert set(semiparametric.mean_uncertainties(later, recorded_flight(1), covariances, change)) == {(0, 0), (0, 1)}


def test_custom_features_without_position_are_unchanged():
    belief = TRAINING.payload
    assert semiparametric.position_only_prior(belief, [f"feature_{i}" for i in range(20)], payload=True) is belief


def test_nis_is_large_for_other_functions_only():
    """In predictive variances: samples of the same functions near the data, of other functions there, and far away."""
    load, agents = samples(0, 30, 24, 6), samples(1, 30, 24, 9, (2,))
    model, _ = model_update.fit(prior(), both(load, agents), TRAINING, {})
    same = semiparametric.normalized_innovation_squared(model, both(load, agents), {}, 1.0)
    assert set(same) == {"payload", (0, 0), (0, 1)}
    assert max(off.mean() for _, off in same.values()) < 4
    np.testing.assert_allclose(same["payload"][0], load.t[11:30])
    other = dataclasses.replace(load, Y=load.Y.at[20:].add(10.0))
    t, off = semiparametric.normalized_innovation_squared(model, both(other, agents), {}, 1.0)["payload"]
    assert off.mean() > 25
    assert t[np.argmax(off > 25)] == pytest.approx(2.0)
    np.testing.assert_array_equal(
        semiparametric.normalized_innovation_squared(model, both(other, agents), {}, 1.0)[0, 0][1], same[0, 0][1]
    )
    far = dataclasses.replace(load, X=load.X + 1e3)
    assert semiparametric.normalized_innovation_squared(model, both(far, agents), {}, 1.0)["payload"][1].mean() < 4
    assert semiparametric.normalized_innovation_squared(model, both(load, agents), {}, 9.0) == {}  # no newer samples
    assert (
        semiparametric.normalized_innovation_squared(prior(), both(load, agents), {}, 1.0) == {}
    )  # nothing was predicted


def model_and_new_samples(theta: np.ndarray) -> tuple[residual_model.ResidualModel, recorder.RecorderState]:
    """Return a model and new samples: its predictions plus the effect of theta."""
    rng = np.random.default_rng(5)
    load, others = samples(0, 30, 24, 6), samples(1, 30, 24, 9, (2,))
    model, _ = model_update.fit(prior(), both(load, others), None, {})
    turns = Rotation.from_rotvec(0.3 * rng.normal(size=(len(load.X), 3))).as_matrix().reshape(-1, 9)
    X = load.X.at[:, 6:15].set(turns).at[:, 20].add(9.81)
    inertial = identification.inertial_regressors(np.asarray(X)) @ theta
    prediction = gp.predict(model.payload, features.payload_features(X))[0]
    return model, both(dataclasses.replace(load, X=X, Y=prediction + inertial, t=load.t + 10.0), others)


def test_added_mass_is_identified_by_the_mean():
    """Mass added to a payload is identified beyond the model before, and subtracted from its labels."""
    theta = np.array([-0.3, *np.zeros(9)])
    model, dataset = model_and_new_samples(theta)
    change = model_update.make_change_point(model, "payload", 9.0)
    alone = dataclasses.replace(
        MEAN, payload=np.array([5.0, *[1e-6] * 13])
    )  # the prior of 0.5 kg shifts the estimate by two grams
    np.testing.assert_allclose(
        semiparametric.update_inertial_mean(model, change, dataset, alone).inertial_parameters, theta, atol=1e-3
    )
    np.testing.assert_allclose(
        semiparametric.update_inertial_mean(model, change, dataset, MEAN).inertial_parameters, theta, atol=2e-3
    )
    third = dataclasses.replace(
        change, theta=jnp.asarray(theta / 3)
    )  # a third was identified before: the remainder is added
    np.testing.assert_allclose(
        semiparametric.update_inertial_mean(model, third, dataset, alone).inertial_parameters, theta, atol=1e-3
    )
    later = dataclasses.replace(third, time=99.0)  # no samples since
    np.testing.assert_array_equal(
        semiparametric.update_inertial_mean(model, later, dataset, MEAN).inertial_parameters, third.theta
    )
    left = model_update.regression_targets(dataclasses.replace(model, inertial_parameters=jnp.asarray(theta)), dataset)[
        "payload"
    ][1]
    prediction = gp.predict(model.payload, features.payload_features(dataset.payload.X))[0]
    np.testing.assert_allclose(left, prediction[:30], atol=1e-9)


def test_spatial_force_is_not_identified_as_mass():
    """On a loop the vertical acceleration correlates with position; with noise alone it would be identified as mass."""
    dataset = recorded_flight(3)
    load, n = dataset.payload, int(dataset.payload.n)
    X, hyper = np.asarray(load.X), gp.make_hyperparameters(np.ones(6), [0.7] * 3 + [gp.INACTIVE_LENGTHSCALE] * 17, 0.05)
    turned = np.stack([0.7 - 0.5 * X[:, 0], -0.7 - 0.5 * X[:, 1], 3.0 * X[:, 2] + 0.6], axis=1)
    Y = np.concatenate([turned, np.cross([0.1, 0.3, 0.2], turned)], axis=1)  # of a point off the center
    other = dataclasses.replace(dataset, payload=dataclasses.replace(load, Y=jnp.asarray(Y)))
    fitted_model = untrained_model()
    model = gp.condition(
        features.payload_features(load.X[:2] + 50.0), np.zeros((2, 6)), hyper, fitted_model.payload.capacity
    )
    fitted_model = dataclasses.replace(fitted_model, payload=model)
    theta = semiparametric.update_inertial_mean(
        fitted_model, model_update.make_change_point(fitted_model, "payload", 0.0), other, MEAN
    ).inertial_parameters
    noise = np.asarray(hyper.noise_variance)[:, None, None] * np.eye(n)
    alone, _ = identification.identify_parameters(
        identification.inertial_regressors(X[:n])[:, :, :4], Y[:n], noise, MEAN.payload[:4]
    )
    assert abs(theta[0]) < 0.5 * abs(alone[0])
    assert np.abs(theta[1:4]).max() < 0.5 * np.abs(alone[1:4]).max()
    np.testing.assert_array_equal(theta[4:], 0)


def test_identified_mass_keeps_a_tenth():
    """An identified mass that would leave no payload is limited to nine tenths."""
    model, dataset = model_and_new_samples(np.array([1.5, *np.zeros(9)]))
    theta = semiparametric.update_inertial_mean(
        model, model_update.make_change_point(model, "payload", 9.0), dataset, MEAN
    ).inertial_parameters
    np.testing.assert_allclose(theta[0], 0.9 * 1.2, rtol=1e-3)
