"""Tests of the online learner: change points, failed updates and identified parameters."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import multivariate_normal

from colift import gp
from colift.models.parameters import Payload
from colift.onboard.learning import (
    change_detection,
    features,
    identification,
    mean_functions,
    model_update,
    online_learner,
    residual_model,
    semiparametric,
)
from tests.unit.onboard.test_residual_model import CAPACITY, TRAINING, both, prior, samples

NOMINAL = Payload(mass=jnp.ones(()), inertia=jnp.eye(3))
MEAN = semiparametric.MeanPrior(payload=np.ones(14), agents=np.ones(5), nominal_payload=NOMINAL)


def learner() -> online_learner.OnlineLearner:
    """Return a learner with periodic updates that keeps all hyperparameters."""
    return online_learner.OnlineLearner(None, None, online_learner.OnlineUpdateOptions(times=(), mean_prior=MEAN))


def fitted_learner() -> tuple[online_learner.OnlineLearner, residual_model.ResidualModel]:
    """Return a learner and its model after the first update, which fits the hyperparameters."""
    made, (load, agents) = learner(), early_samples()
    made.fit_options = TRAINING
    model, update = made.update(untrained(), both(load, agents), 4.2, fit=True)
    assert update.error_message == ""
    return made, model


def untrained() -> residual_model.ResidualModel:
    """Return a model without data, with a mean function."""
    return dataclasses.replace(prior(), mean_function=mean_functions.zero_drag_thrust([2]))


@pytest.mark.parametrize("offset", [0.0, 5.0])
def test_contradicting_labels_are_a_change_point(offset):
    """Labels with an offset since 6 s are a change point of this body; labels of the same function are none."""
    made, model = fitted_learner()
    load, agents = (delayed(data, 4.0) for data in early_samples())
    Y = jnp.where((load.t >= 6.0)[:, None], load.Y + offset, load.Y)
    model, update = made.update(model, both(dataclasses.replace(load, Y=Y), agents), 8.2, fit=False)
    assert update.error_message == ""
    assert update.change_points == (("payload",) if offset else ())
    if offset:
        (time,) = made.variations["payload"].times
        assert 5.0 < time <= 6.1 + 0.8  # candidates are 0.8 s apart
        shifted = both(dataclasses.replace(load, Y=Y), agents)
        Z, target, _ = model_update.regression_targets(model, shifted)["payload"]
        error = target - gp.predict(model.payload, jnp.asarray(Z))[0]
        assert np.sqrt((error[25:] ** 2).mean()) < 0.5


def early_samples() -> tuple[gp.Dataset, gp.Dataset]:
    """Return 40 samples of a payload and of two agents, from 0.1 s on."""
    each = samples(0, 40, 24, 6), samples(1, 40, 24, 9, (2,))
    load, agents = (dataclasses.replace(data, t=data.t + 0.1) for data in each)
    return first_samples(load, 40), first_samples(agents, 40)


def first_samples(data: gp.Dataset, n: int) -> gp.Dataset:
    """Return the first n samples; unused rows have no time, as in a flight."""
    t = np.where(np.arange(data.t.shape[-1]) < n, data.t, 0.0)
    return dataclasses.replace(data, t=jnp.asarray(t), n=jnp.full(data.n.shape, n))


def delayed(data: gp.Dataset, by: float) -> gp.Dataset:
    """Return the same samples, delayed by some seconds."""
    return first_samples(dataclasses.replace(data, t=data.t + by), int(data.n.max()))


def test_learned_region_is_kept_after_its_samples_are_gone():
    """Three full buffers at different places: the recorder contains only the last one."""
    made, model = fitted_learner()
    load, agents = early_samples()
    made.variations = dict.fromkeys(made.variations, model_update.Variation(rate=1e-5))
    queries = features.payload_features(load.X[:40:4])
    before, num_samples = gp.predict(model.payload, queries), {}
    for k in (1, 2):
        hover = [jnp.broadcast_to(x[k][None], x.shape) for x in (load.X, load.Y)]
        newest = dataclasses.replace(delayed(load, 10.0 * k), X=hover[0], Y=hover[1])
        model, update = made.update(model, both(newest, agents), 10.0 * k + 4, fit=False)
        num_samples = update.num_samples
    assert num_samples["payload"] == CAPACITY
    after = gp.predict(model.payload, queries)
    np.testing.assert_allclose(after[0], before[0], atol=0.2)
    assert float(after[1].max()) < 3 * float(before[1].max())


def test_failed_update_keeps_model_and_samples(monkeypatch):
    """A failed update keeps the model and states the reason; the next update uses the same samples."""
    made, model = fitted_learner()
    load, agents = (delayed(data, 4.0) for data in early_samples())
    other, before = both(dataclasses.replace(load, Y=load.Y + 50.0), agents), made.variations
    with monkeypatch.context() as patch:
        patch.setattr(semiparametric, "condition", lambda *_: (_ for _ in ()).throw(ValueError("no factor")))
        same, update = made.update(model, other, 8.2, fit=False)
    assert same is model
    assert "no factor" in update.error_message
    assert update.change_points == ()
    assert made.variations is before
    _, update = made.update(model, other, 9.0, fit=False)
    assert update.error_message == ""
    assert update.change_points == ("payload",)
    assert update.num_samples["payload"] == CAPACITY


def test_sample_of_the_update_step_counts_for_the_next():
    """A sample recorded in the step of an update is recorded after it."""
    made, (load, agents) = learner(), early_samples()
    model, at = untrained(), float(load.t[39])
    made.update(model, both(first_samples(load, 39), first_samples(agents, 39)), at, fit=False)
    _, update = made.update(model, both(load, agents), at + 1, fit=False)
    assert update.num_samples == {"payload": 40, "agents": 80}


def test_bayes_factor_is_that_of_dense_normals():
    """The log Bayes factor is the log ratio of the densities of all samples with and without the change."""
    made, model = fitted_learner()
    load, agents = (delayed(data, 4.0) for data in early_samples())
    merged = model_update.merge_samples(made.data, both(load, agents), made.last_sample_time)
    times, factors = change_detection.log_bayes_factors(
        model, "payload", merged["payload"], MEAN, made.variations["payload"], made.last_sample_time
    )
    x, Y, t = merged["payload"]
    Z, Phi = features.compute_features(model.features, "payload", x), semiparametric.mean_regressors(x, True)
    hyper = model.payload.hyper

    def log_density(start):
        total, varying = 0.0, np.array([1.0] * 4 + [0.0] * 4 + [1.0] * 6)
        walk = made.variations["payload"].rate * np.minimum(*(t.max() - a for a in np.meshgrid(t, t)))
        after = np.outer(t >= start, t >= start).astype(float)
        for i in range(6):
            K, P = gp.function_covariance(Z, hyper, i), Phi[:, i] * varying
            C = K * (1 + walk + gp.JUMP_SHARE * after) + Phi[:, i] @ Phi[:, i].T + (walk + after) * (P @ P.T)
            C = C + float(hyper.noise_variance[i]) * np.eye(len(t))
            total += multivariate_normal(cov=C).logpdf(Y[:, i])
        return total

    assert len(times) == change_detection.NUM_CANDIDATES
    for time, factor in zip(times[::2], factors[::2], strict=True):
        assert factor == pytest.approx(log_density(time) - log_density(np.inf), rel=1e-5, abs=1e-4)


def test_identified_inertia_stays_physical():
    """Labels for more inertia than the body has: a tenth of the inertia remains, and the mass stays as identified."""
    load, agents = samples(0, 40, 24, 6), samples(1, 40, 24, 9, (2,))
    theta = np.array([0.2, 0, 0, 0, 2.0, 0, 0, 0, 0, 0])
    Y = jnp.asarray(identification.inertial_regressors(np.asarray(load.X)) @ theta)
    options = online_learner.IdentificationOptions(
        label_std=np.full(6, 0.01), prior_std=np.full(10, 1.0), nominal_payload=NOMINAL
    )
    model, _ = online_learner.OnlineLearner(None, options, None).update(
        prior(), both(dataclasses.replace(load, Y=Y), agents), 4.0, True
    )
    np.testing.assert_allclose(model.inertial_parameters[0], 0.2, atol=0.01)
    np.testing.assert_allclose(model.inertial_parameters[4], 0.9, atol=0.01)
