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
    mean_functions,
    model_update,
    recorder,
    residual_model,
    semiparametric,
)
from tests.unit.onboard.test_residual_model import STATED, TRAINING, both

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


@pytest.fixture(scope="module")
def trained() -> tuple[residual_model.ResidualModel, model_update.Fits, dict]:
    """Model of one flight."""
    return fitted(recorded_flight(0))


def fitted(dataset: recorder.RecorderState) -> tuple[residual_model.ResidualModel, model_update.Fits, dict]:
    """Return model, fits and covariances of the mean parameters for constant residuals."""
    model, fits, variations = semiparametric.fit(untrained_model(), dataset, training(), MEAN, {})
    assert variations == {}
    model, covariances = semiparametric.condition(model, dataset, MEAN, 13.0)
    assert int(model.update_index) == 1
    return model, fits, covariances


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
                ((Y - gp.predict(residual_model.get_model(of, body), jnp.asarray(X))[0])[:, :3] ** 2).mean()
            )
    for body in ("payload", (0, 0)):
        assert errors["place", body] < 0.5 * errors["full", body]
        assert errors["place", body] < 0.15


def test_mean_uncertainty_calibrates_extrapolation():
    """Errors at twice the speed are calibrated only with the uncertainty of the mean; over several environments."""
    squares, bare = [], []
    for seed in range(6):
        dataset, fast = recorded_flight(10 + seed), recorded_flight(50 + seed, times=2.0)
        fitted_model, _, covariances = fitted(dataset)
        uncertainties = semiparametric.mean_uncertainties(fitted_model, dataset, covariances)
        for body in ("payload", (0, 1)):
            (Z, left, _), x = (
                model_update.regression_targets(fitted_model, fast)[body],
                model_update.samples_by_body(fast)[body][0],
            )
            model = residual_model.get_model(fitted_model, body)
            mean, variance = gp.predict(model, jnp.asarray(Z))
            variance = np.asarray(variance) + np.asarray(model.hyper.noise_variance)
            more = semiparametric.mean_variance(
                model, uncertainties[body], Z, semiparametric.mean_regressors(x, isinstance(body, str))
            )
            assert (more >= 0).all()
            squares.append(((left - mean) ** 2 / (variance + more))[:, :3].mean())
            bare.append(((left - mean) ** 2 / variance)[:, :3].mean())
    assert np.mean(squares) < 1.6
    assert np.mean(bare) > np.mean(squares)


@pytest.mark.parametrize("t", [13.0, 20.0])
def test_jump_of_constants_and_mass_keeps_the_field(t):
    """After a jump with few samples, the present model has new constants and mass, and the field of the earlier one."""
    before, after = recorded_flight(0), recorded_flight(3)
    n, mass, force = 20, 0.3, np.array([1.5, -2.0, 0.0])
    load, agents = after.payload, after.agents[0]
    Y = load.Y.at[:, :3].add(jnp.asarray(mass * np.asarray(load.X)[:, 18:21] + force))
    late = lambda data: dataclasses.replace(data, t=data.t + 10.0, n=jnp.full(data.n.shape, n))  # noqa: E731
    new = both(dataclasses.replace(late(load), Y=Y), late(agents))
    merged = model_update.merge_samples(before, new, 9.95)
    variations = {
        body: model_update.Variation(rate=1e-4, times=(10.0,) if body == "payload" else ()) for body in merged
    }
    base, _, _ = fitted(before)
    data = model_update.select_samples(base, merged, before, t, variations)
    model, _ = semiparametric.condition(base, data, MEAN, t, variations)
    assert float(model.inertial_parameters[0]) == pytest.approx(MASS + mass, abs=0.15)
    assert float(base.inertial_parameters[0]) == pytest.approx(MASS, abs=0.1)
    Z, target, _ = model_update.regression_targets(model, both(dataclasses.replace(load, Y=Y), agents))["payload"]
    predicted = gp.predict(model.payload, jnp.asarray(Z[n:]))[0]
    error = np.sqrt(((target[n:] - predicted)[:, :3] ** 2).mean())
    still = gp.predict(base.payload, jnp.asarray(Z[n:]))[0]
    assert error < 0.3  # at places that have no sample since the jump
    assert np.abs((target[n:] - still)[:, :3]).mean() > 0.5


def test_joint_torques_depend_on_attitude_and_joints():
    names = features.agent_feature_names(3)
    found = semiparametric.joint_torque_prior(TRAINING.agents[0], names).median.lengthscales
    inactive = np.asarray(found) == gp.INACTIVE_LENGTHSCALE
    expected = [not name.startswith(("R_", "r_")) for name in names]
    np.testing.assert_array_equal(inactive, [[False] * len(names)] * 6 + [expected] * 3)


def test_custom_features_without_position_are_unchanged():
    belief = TRAINING.payload
    assert semiparametric.position_only_prior(belief, [f"feature_{i}" for i in range(20)], payload=True) is belief
    assert semiparametric.joint_torque_prior(belief, [f"feature_{i}" for i in range(20)]) is belief
