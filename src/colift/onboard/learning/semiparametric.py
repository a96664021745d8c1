"""Maps that know what a body is: a mean of mass, drag and rotors' thrust, and GPs of the place for the rest (host).

A GP of all that is measured says what its prior says as soon as the team is somewhere else, faster or otherwise turned.
Here the forces of all bodies and the payload's moment are `y = Phi(x) beta + f(p) + noise`: Phi `beside` the GPs what a
body's mass, its first moments, drag and thrust do (`learn.regressor`, `learn.Air`), f a GP of the place p alone, as a
field of wind is. An agent's moments and joints keep GPs of all its features.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Collection, Mapping, Sequence
from types import MappingProxyType

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from scipy.spatial.distance import cdist

from colift import gp
from colift.models.parameters import Payload
from colift.onboard.learning import features, identification, mean_functions, model_update, recorder, residual_model

OUTPUT_BLOCKS = {
    True: ((0, 1, 2), (3, 4, 5)),
    False: ((0, 1, 2),),
}  # outputs that share hyperparameters: payload's, agent's
BATCH_ROWS = 128  # samples whose regressors are computed at once, or twice as many, ..: few shapes, few programs
POSITION_FEATURES = {"p_x", "p_y", "p_z", "x_x", "x_y", "x_z"}  # features


@dataclasses.dataclass(frozen=True)
class MeanPrior:
    """Prior deviations of what a mean holds, and the payload as it is believed to be, of which a tenth is left."""

    payload: np.ndarray  # (14,) mass, kg, first moments, kg m, drag, N s/m, its lever's, N s, constants, N and N m
    agents: np.ndarray  # (5,) drag, N s/m, thrust, N, constants, N
    nominal_payload: Payload


@dataclasses.dataclass(frozen=True)
class MeanUncertainty:
    """Of a body's mean, what its error does to predictions."""

    weighted_regressors: np.ndarray  # (outputs, points, parameters), `K_i^-1 Phi_i` of the model's points
    covariance: np.ndarray  # of the parameters


MeanUncertainties = Mapping[features.BodyKey, MeanUncertainty]
"""Of every body with a mean of its own; one whose world has changed keeps its mean as if it were known."""


def position_only_prior(hyperprior: gp.HyperPrior, names: Sequence[str], payload: bool) -> gp.HyperPrior:
    """A belief in which forces, and a payload's moment, look at the place alone.

    Features of one's own without a place among their names stay as they are.
    """
    elsewhere = np.array([name not in POSITION_FEATURES for name in names])
    if elsewhere.all():
        return hyperprior
    rows, columns = np.concatenate(OUTPUT_BLOCKS[payload]), np.flatnonzero(elsewhere)
    scale = hyperprior.median.lengthscales.at[np.ix_(rows, columns)].set(gp.INACTIVE_LENGTHSCALE)
    return dataclasses.replace(hyperprior, median=dataclasses.replace(hyperprior.median, lengthscales=scale))


def fit(
    model: residual_model.ResidualModel,
    recorder_state: recorder.RecorderState,
    training: model_update.FitOptions,
    mean: MeanPrior,
    last: model_update.Fits,
    bodies: Collection[features.BodyKey],
    changes: model_update.ChangePoints = MappingProxyType({}),
    waiting: Collection[features.BodyKey] = (),
) -> tuple[residual_model.ResidualModel, model_update.Fits, dict[features.BodyKey, np.ndarray]]:
    """The oracle on the data so far, means and hyperparameters of bodies fitted anew, with the means' covariances.

    None of those is to be one whose world has changed, as what is left of before is no data for a mean. All others are
    renewed. Host.
    """
    found = {
        body: (x, Y)
        for body, (x, Y, _) in model_update.samples_by_body(recorder_state).items()
        if len(x) > 1 and body in bodies
    }
    learned = model_update.parallel_map(
        lambda body: _fit(model, body, *found[body], training, mean, last.get(body)), found
    )
    models = {}
    for body, (fit, beta, _) in learned.items():
        model = set_mean_parameters(model, body, beta, mean.nominal_payload)
        models[body] = dataclasses.replace(residual_model.get_model(model, body), hyper=fit.hyper)
    fits = {**last, **{body: fit for body, (fit, _, _) in learned.items()}}
    taught = model_update.condition(residual_model.replace_models(model, models), recorder_state, changes, waiting)
    taught = dataclasses.replace(taught, update_index=model.update_index + 1)  # one update
    return taught, fits, {body: covariance for body, (_, _, covariance) in learned.items()}


def mean_uncertainties(
    oracle: residual_model.ResidualModel,
    recorder_state: recorder.RecorderState,
    covariances: Mapping[features.BodyKey, np.ndarray],
    changes: model_update.ChangePoints,
) -> MeanUncertainties:
    """What errors of means do to predictions of an oracle that was renewed on these data (host)."""
    found, samples = {}, model_update.samples_by_body(recorder_state)
    for body in covariances.keys() - changes.keys():
        model, Phi = residual_model.get_model(oracle, body), mean_regressors(samples[body][0], isinstance(body, str))
        W = np.asarray(model.inverse_cholesky)[: Phi.shape[1], : len(Phi), : len(Phi)]
        told = np.stack([w.T @ (w @ Phi[:, i]) for i, w in enumerate(W)])
        found[body] = MeanUncertainty(weighted_regressors=told, covariance=covariances[body])
    return found


def mean_variance(model: gp.GPPosterior, unsure: MeanUncertainty, Z: np.ndarray, Phi: np.ndarray) -> np.ndarray:
    """Variance that the mean's error adds, (samples, outputs): `g C g^T`, `g_i = phi_i - k_i^T K_i^-1 Phi_i` (host).

    Rasmussen and Williams 2006, Eq. 2.42.
    """
    h, n = model.hyper, unsure.weighted_regressors.shape[1]
    out = np.zeros((len(Z), len(h.signal_variance)))
    for i, told in enumerate(unsure.weighted_regressors):
        r2 = cdist(
            Z / np.asarray(h.lengthscales)[i], np.asarray(model.X)[:n] / np.asarray(h.lengthscales)[i], "sqeuclidean"
        )
        k = float(h.signal_variance[i]) * h.kernel.numpy_value_and_slope(r2)[0]
        g = Phi[:, i] - k @ told
        out[:, i] = np.einsum("np,pq,nq->n", g, unsure.covariance, g, optimize=True)
    return out


def update_inertial_mean(
    model: residual_model.ResidualModel,
    change: model_update.ChangePoint,
    recorder_state: recorder.RecorderState,
    mean: MeanPrior,
) -> residual_model.ResidualModel:
    """The oracle with what a payload whose world has changed has more of mass and first moments than before (host).

    A GP cannot hold that where the team has not been: it goes with the acceleration. What else labels since then say
    beyond the model from before is a function of what that one looks at, and noise.
    """
    before = dataclasses.replace(model, inertial_parameters=change.theta)
    x, _, t = model_update.samples_by_body(recorder_state)["payload"]
    Z, Y, _ = model_update.regression_targets(before, recorder_state, {"payload": change})["payload"]
    theta = np.array(change.theta)
    if len(Y):
        Phi, K = mean_regressors(x[t >= change.time], payload=True)[:, :, :4], gp.gram_matrices(Z, change.model.hyper)
        more, _ = identification.identify_parameters(
            Phi, Y - residual_model.predict_padded(change.model, Z)[0], K, mean.payload[:4]
        )
        theta[:4] += more
    return dataclasses.replace(
        model, inertial_parameters=jnp.asarray(identification.enforce_physical_consistency(theta, mean.nominal_payload))
    )


def normalized_innovation_squared(
    oracle: residual_model.ResidualModel,
    recorder_state: recorder.RecorderState,
    doubts: MeanUncertainties,
    after: float,
) -> dict[features.BodyKey, tuple[np.ndarray, np.ndarray]]:
    """Of every body that has been taught, times of its samples since `after`, s, and how far each lies off (host).

    The mean over outputs of `(y - mean)^2 / (variance + noise_variance)`: about 1 where the model holds. Where no data
    were near, the variance is large, and nothing surprises.
    """
    found, raw = {}, model_update.samples_by_body(recorder_state)
    for body, (Z, Y, t) in model_update.regression_targets(oracle, recorder_state).items():
        model, new = residual_model.get_model(oracle, body), t > after + 1e-9
        if int(model.num_points) and new.any():
            mean, variance = residual_model.predict_padded(model, Z[new])
            if body in doubts:
                Phi = mean_regressors(raw[body][0][new], isinstance(body, str))
                variance = variance + mean_variance(model, doubts[body], Z[new], Phi)
            off = (Y[new] - mean) ** 2 / (variance + np.asarray(model.hyper.noise_variance))
            found[body] = t[new], off.mean(1)
    return found


def _fit(
    model: residual_model.ResidualModel,
    body: features.BodyKey,
    x: np.ndarray,
    Y: np.ndarray,
    training: model_update.FitOptions,
    mean: MeanPrior,
    before: gp.FitResult | None,
) -> tuple[gp.FitResult, np.ndarray, np.ndarray]:
    """A body's hyperparameters, what its mean holds, and the covariance of that."""
    Z, hyperprior, payload = (
        features.compute_features(model.features, body, x),
        training.prior_for(body),
        isinstance(body, str),
    )
    m, blocks = Y.shape[1], OUTPUT_BLOCKS[payload]
    held = len(blocks) * 3
    Phi = mean_regressors(x, payload)
    found = gp.fit_semiparametric(
        Z,
        Y[:, :held],
        Phi,
        mean.payload if payload else mean.agents,
        blocks,
        hyperprior,
        start=None if before is None else before.hyper,
        max_iterations=training.max_iterations,
    )
    hyper = dataclasses.replace(found.hyper, constant_mean=jnp.asarray(found.theta[-held:]))
    scale = np.asarray(found.hyper.lengthscales) / gp.column_std(Z)
    fit = gp.FitResult(
        hyper=hyper,
        log_likelihood=found.log_likelihood,
        lengthscales=scale,
        at_lower=np.zeros(scale.shape, bool),
        at_upper=np.zeros(scale.shape, bool),
        num_evaluations=found.evaluations,
        converged=np.full(held, found.converged),
    )
    if m == held:
        return fit, found.theta, found.covariance
    rest = slice(held, m)
    more = gp.fit(
        Z,
        Y[:, rest],
        hyperprior=dataclasses.replace(hyperprior, median=gp.select_outputs(hyperprior.median, rest)),
        start=None if before is None else gp.select_outputs(before.hyper, rest),
        restarts=0 if before else training.restarts,
        max_iterations=training.max_iterations,
    )
    return gp.concatenate_fits(fit, more), found.theta, found.covariance


def mean_regressors(x: np.ndarray, payload: bool) -> np.ndarray:
    """`Phi(x)`, (samples, 6 or 3, parameters): what each parameter of a mean does at a body's samples."""
    full = np.pad(x, ((0, -len(x) % BATCH_ROWS), (0, 0)))
    return np.asarray((_of_payload if payload else _of_agent)(jnp.asarray(full)))[: len(x)]


@jax.jit
def _of_payload(x: Float[Array, "samples 24"]) -> Float[Array, "samples 6 14"]:
    def one(x: Float[Array, "24"]) -> Float[Array, "6 14"]:
        inertial = identification.inertial_regressor(identification.payload_state_from_input(x), x[18:21], x[21:24])[
            :, :4
        ]
        air = jax.jacfwd(lambda b: mean_functions.DragThrustMean(payload=b, agents=()).payload_mean(x))(jnp.zeros(4))
        return jnp.concatenate([inertial, air, jnp.eye(6)], axis=1)

    return jax.vmap(one)(x)


@jax.jit
def _of_agent(x: Float[Array, "samples inputs"]) -> Float[Array, "samples 3 5"]:
    def one(x: Float[Array, "inputs"]) -> Float[Array, "3 5"]:
        air = lambda b: mean_functions.DragThrustMean(payload=jnp.zeros(4), agents=(b[None],)).agent_means(0, x[None])[
            0, :3
        ]  # noqa: E731
        return jnp.concatenate([jax.jacfwd(air)(jnp.zeros(2)), jnp.eye(3)], axis=1)

    return jax.vmap(one)(x)


def set_mean_parameters(
    model: residual_model.ResidualModel, body: features.BodyKey, beta: np.ndarray, nominal: Payload
) -> residual_model.ResidualModel:
    """The oracle with what a body's mean holds, but for its constants, which are the GP's offset."""
    air = model.mean_function
    assert isinstance(air, mean_functions.DragThrustMean)
    if isinstance(body, str):
        theta = jnp.asarray(
            identification.enforce_physical_consistency(np.concatenate([beta[:4], np.zeros(6)]), nominal)
        )
        return dataclasses.replace(
            model, inertial_parameters=theta, mean_function=dataclasses.replace(air, payload=jnp.asarray(beta[4:8]))
        )
    i, j = body
    agents = (*air.agents[:i], air.agents[i].at[j].set(beta[:2]), *air.agents[i + 1 :])
    return dataclasses.replace(model, mean_function=dataclasses.replace(air, agents=agents))
