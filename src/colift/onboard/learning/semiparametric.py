"""Semiparametric residual models: a physical mean function and Gaussian processes of the position.

Far from all data, a Gaussian process (GP) of all features returns its prior mean. The physical effects of mass, drag
and thrust bias extend to other positions, speeds and attitudes. The forces of all bodies and the payload moment are
therefore modelled by ``y = Phi(x) beta + f(p) + noise``. The columns of ``Phi`` are these effects and constants. ``f``
is a GP of the position ``p`` only, as a wind field is a function of position. Moments and joint torques of agents keep
GPs of all features. All functions run on the host.

See Also:
    colift.gp.semiparametric: joint estimation of hyperparameters and ``beta``.
    colift.onboard.learning.mean_functions, colift.onboard.learning.identification: the columns of ``Phi``.

References:
    Rasmussen, Williams, *Gaussian Processes for Machine Learning*, 2006, Section 2.7.
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

OUTPUT_BLOCKS = {True: ((0, 1, 2), (3, 4, 5)), False: ((0, 1, 2),)}
"""Outputs with common hyperparameters, of the payload (True) and of an agent (False)."""

POSITION_FEATURES = {"p_x", "p_y", "p_z", "x_x", "x_y", "x_z"}
"""Names of the features that are position coordinates of payload or agent."""


@dataclasses.dataclass(frozen=True)
class MeanPrior:
    """Prior standard deviations of the parameters of the mean functions.

    Attributes:
        payload: Standard deviations (14,) of the payload parameters: mass [kg], first moments [kg m], drag coefficient
            [N s/m], drag coefficient times lever [N s], constant force [N] and constant moment [N m].
        agents: Standard deviations (5,) of the agent parameters: drag coefficient [N s/m], thrust bias [N] and
            constant force [N].
        nominal_payload: Nominal payload, which limits the identified inertial parameters.
    """

    payload: np.ndarray
    agents: np.ndarray
    nominal_payload: Payload


@dataclasses.dataclass(frozen=True)
class MeanUncertainty:
    """Contribution of the mean parameters of a body to the predictive variance.

    Attributes:
        weighted_regressors: ``K_i^-1 Phi_i`` at the samples of the model, of shape (outputs, samples, parameters).
        covariance: Posterior covariance of the parameters.
    """

    weighted_regressors: np.ndarray
    covariance: np.ndarray


MeanUncertainties = Mapping[features.BodyKey, MeanUncertainty]
"""Mean uncertainty of every body with a fitted mean; the mean of a body with a change point counts as exact."""


def position_only_prior(hyperprior: gp.HyperPrior, names: Sequence[str], payload: bool) -> gp.HyperPrior:
    """Restrict the GPs of forces, and of the payload moment, to position features.

    The length-scales of all other features become inactive. A feature map without position features keeps its prior.

    Args:
        hyperprior: Hyperprior over all features.
        names: Names of the features, in order.
        payload: Whether the body is the payload.

    Returns:
        The restricted hyperprior.
    """
    inactive = np.array([name not in POSITION_FEATURES for name in names])
    if inactive.all():
        return hyperprior
    rows, columns = np.concatenate(OUTPUT_BLOCKS[payload]), np.flatnonzero(inactive)
    scale = hyperprior.median.lengthscales.at[np.ix_(rows, columns)].set(gp.INACTIVE_LENGTHSCALE)
    return dataclasses.replace(hyperprior, median=dataclasses.replace(hyperprior.median, lengthscales=scale))


def fit(
    model: residual_model.ResidualModel,
    recorder_state: recorder.RecorderState,
    fit_options: model_update.FitOptions,
    mean_prior: MeanPrior,
    last_fits: model_update.Fits,
    bodies: Collection[features.BodyKey],
    change_points: model_update.ChangePoints = MappingProxyType({}),
    pending: Collection[features.BodyKey] = (),
) -> tuple[residual_model.ResidualModel, model_update.Fits, dict[features.BodyKey, np.ndarray]]:
    """Fit mean parameters and hyperparameters of some bodies and condition the GPs of all bodies.

    Args:
        model: Residual model before the update, with a `DragThrustMean`.
        recorder_state: Recorded samples.
        fit_options: Options of the fit.
        mean_prior: Prior of the mean parameters.
        last_fits: Last fits by body.
        bodies: Bodies to fit. None of them may have a change point: offset samples are no data for a mean.
        change_points: Change points of the other bodies.
        pending: Bodies with too few samples since their change point for a new model.

    Returns:
        The residual model, the last fits by body, and the posterior covariances of the fitted mean parameters.
    """
    samples = {
        body: (x, Y)
        for body, (x, Y, _) in model_update.samples_by_body(recorder_state).items()
        if len(x) > 1 and body in bodies
    }
    fitted = model_update.parallel_map(
        lambda body: _fit_body(model, body, *samples[body], fit_options, mean_prior, last_fits.get(body)), samples
    )
    models = {}
    for body, (fit, beta, _) in fitted.items():
        model = set_mean_parameters(model, body, beta, mean_prior.nominal_payload)
        models[body] = dataclasses.replace(residual_model.get_model(model, body), hyper=fit.hyper)
    fits = {**last_fits, **{body: fit for body, (fit, _, _) in fitted.items()}}
    updated = model_update.condition(
        residual_model.replace_models(model, models), recorder_state, change_points, pending
    )
    updated = dataclasses.replace(updated, update_index=model.update_index + 1)  # both steps are one update
    return updated, fits, {body: covariance for body, (_, _, covariance) in fitted.items()}


def mean_uncertainties(
    model: residual_model.ResidualModel,
    recorder_state: recorder.RecorderState,
    covariances: Mapping[features.BodyKey, np.ndarray],
    change_points: model_update.ChangePoints,
) -> MeanUncertainties:
    """Compute the mean uncertainties of a residual model.

    Args:
        model: Residual model.
        recorder_state: Samples on which the model was conditioned.
        covariances: Posterior covariances of the mean parameters, by body.
        change_points: Change points; bodies with a change point are left out.

    Returns:
        Mean uncertainties by body.
    """
    uncertainties, samples = {}, model_update.samples_by_body(recorder_state)
    for body in covariances.keys() - change_points.keys():
        posterior = residual_model.get_model(model, body)
        Phi = mean_regressors(samples[body][0], isinstance(body, str))
        W = np.asarray(posterior.inverse_cholesky)[: Phi.shape[1], : len(Phi), : len(Phi)]
        weighted = np.stack([w.T @ (w @ Phi[:, i]) for i, w in enumerate(W)])
        uncertainties[body] = MeanUncertainty(weighted_regressors=weighted, covariance=covariances[body])
    return uncertainties


def mean_variance(
    model: gp.GPPosterior, mean_uncertainty: MeanUncertainty, Z: np.ndarray, Phi: np.ndarray
) -> np.ndarray:
    """Compute the predictive variance due to the uncertainty of the mean parameters.

    The variance of output ``i`` is ``g_i^T C g_i`` with ``g_i = phi_i - Phi_i^T K_i^-1 k_i`` and the covariance ``C``
    of the parameters (Rasmussen and Williams 2006, Eq. 2.42).

    Args:
        model: GP of the body.
        mean_uncertainty: Mean uncertainty of the body.
        Z: Features of the inputs.
        Phi: Regressors of `mean_regressors` at the inputs.

    Returns:
        Variances of shape (samples, outputs); zero for outputs without a fitted mean.
    """
    h, n = model.hyper, mean_uncertainty.weighted_regressors.shape[1]
    out = np.zeros((len(Z), len(h.signal_variance)))
    for i, weighted in enumerate(mean_uncertainty.weighted_regressors):
        r2 = cdist(
            Z / np.asarray(h.lengthscales)[i], np.asarray(model.X)[:n] / np.asarray(h.lengthscales)[i], "sqeuclidean"
        )
        k = float(h.signal_variance[i]) * h.kernel.numpy_value_and_slope(r2)[0]
        g = Phi[:, i] - k @ weighted
        out[:, i] = np.einsum("np,pq,nq->n", g, mean_uncertainty.covariance, g, optimize=True)
    return out


def update_inertial_mean(
    model: residual_model.ResidualModel,
    change_point: model_update.ChangePoint,
    recorder_state: recorder.RecorderState,
    mean_prior: MeanPrior,
) -> residual_model.ResidualModel:
    """Identify the change of the payload's mass and first moments since its change point.

    The inertial wrench depends on the acceleration, so a GP does not extend it to new positions. All other changes
    since the change point are treated as a function with the covariance of the previous model, plus noise.

    Args:
        model: Residual model before the update.
        change_point: Change point of the payload.
        recorder_state: Recorded samples.
        mean_prior: Prior of the mean parameters.

    Returns:
        The residual model with updated inertial parameters.
    """
    before = dataclasses.replace(model, inertial_parameters=change_point.theta)
    x, _, t = model_update.samples_by_body(recorder_state)["payload"]
    Z, Y, _ = model_update.regression_targets(before, recorder_state, {"payload": change_point})["payload"]
    theta = np.array(change_point.theta)
    if len(Y):
        Phi = mean_regressors(x[t >= change_point.time], payload=True)[:, :, :4]
        K = gp.gram_matrices(Z, change_point.model.hyper)
        change, _ = identification.identify_parameters(
            Phi, Y - residual_model.predict_padded(change_point.model, Z)[0], K, mean_prior.payload[:4]
        )
        theta[:4] += change
    theta = identification.enforce_physical_consistency(theta, mean_prior.nominal_payload)
    return dataclasses.replace(model, inertial_parameters=jnp.asarray(theta))


def normalized_innovation_squared(
    model: residual_model.ResidualModel,
    recorder_state: recorder.RecorderState,
    uncertainties: MeanUncertainties,
    last_sample_time: float,
) -> dict[features.BodyKey, tuple[np.ndarray, np.ndarray]]:
    """Compute the normalized innovation squared (NIS) of new samples.

    The NIS of a sample is the mean over outputs of ``(y - mean)^2 / (variance + noise_variance)``. Its expected value
    is 1 for a correct model. Far from all data the variance is large, and the NIS is small.

    Args:
        model: Residual model before the update.
        recorder_state: Recorded samples.
        uncertainties: Mean uncertainties by body.
        last_sample_time: Time of the last sample of the previous update [s]; later samples are new.

    Returns:
        Times [s] and NIS of the new samples, for every body that has data and new samples.
    """
    out, raw = {}, model_update.samples_by_body(recorder_state)
    for body, (Z, Y, t) in model_update.regression_targets(model, recorder_state).items():
        posterior, new = residual_model.get_model(model, body), t > last_sample_time + 1e-9
        if int(posterior.num_points) and new.any():
            mean, variance = residual_model.predict_padded(posterior, Z[new])
            if body in uncertainties:
                Phi = mean_regressors(raw[body][0][new], isinstance(body, str))
                variance = variance + mean_variance(posterior, uncertainties[body], Z[new], Phi)
            nis = (Y[new] - mean) ** 2 / (variance + np.asarray(posterior.hyper.noise_variance))
            out[body] = t[new], nis.mean(1)
    return out


def _fit_body(
    model: residual_model.ResidualModel,
    body: features.BodyKey,
    x: np.ndarray,
    Y: np.ndarray,
    fit_options: model_update.FitOptions,
    mean_prior: MeanPrior,
    last_fit: gp.FitResult | None,
) -> tuple[gp.FitResult, np.ndarray, np.ndarray]:
    """Fit a body; return the fit, the mean parameters and their posterior covariance."""
    Z, hyperprior = features.compute_features(model.features, body, x), fit_options.prior_for(body)
    payload = isinstance(body, str)
    num_outputs, blocks = Y.shape[1], OUTPUT_BLOCKS[payload]
    num_joint = len(blocks) * 3  # outputs with a mean function
    Phi = mean_regressors(x, payload)
    joint = gp.fit_semiparametric(
        Z,
        Y[:, :num_joint],
        Phi,
        mean_prior.payload if payload else mean_prior.agents,
        blocks,
        hyperprior,
        start=None if last_fit is None else last_fit.hyper,
        max_iterations=fit_options.max_iterations,
    )
    hyper = dataclasses.replace(joint.hyper, constant_mean=jnp.asarray(joint.theta[-num_joint:]))
    scale = np.asarray(joint.hyper.lengthscales) / gp.column_std(Z)
    fit = gp.FitResult(
        hyper=hyper,
        log_likelihood=joint.log_likelihood,
        lengthscales=scale,
        at_lower=np.zeros(scale.shape, bool),
        at_upper=np.zeros(scale.shape, bool),
        num_evaluations=joint.num_evaluations,
        converged=np.full(num_joint, joint.converged),
    )
    if num_outputs == num_joint:
        return fit, joint.theta, joint.covariance
    rest = slice(num_joint, num_outputs)
    rest_fit = gp.fit(
        Z,
        Y[:, rest],
        hyperprior=dataclasses.replace(hyperprior, median=gp.select_outputs(hyperprior.median, rest)),
        start=None if last_fit is None else gp.select_outputs(last_fit.hyper, rest),
        restarts=0 if last_fit else fit_options.restarts,
        max_iterations=fit_options.max_iterations,
    )
    return gp.concatenate_fits(fit, rest_fit), joint.theta, joint.covariance


def mean_regressors(x: np.ndarray, payload: bool) -> np.ndarray:
    """Compute the regressors ``Phi`` of the mean parameters.

    Args:
        x: Inputs of a body, samples first.
        payload: Whether the body is the payload.

    Returns:
        Regressors of shape (samples, 6 or 3, parameters).
    """
    padded = jnp.asarray(features.pad_rows(x))
    return np.asarray((_payload_regressors if payload else _agent_regressors)(padded))[: len(x)]


@jax.jit
def _payload_regressors(x: Float[Array, "samples 24"]) -> Float[Array, "samples 6 14"]:
    """Return inertial, drag and constant columns of the payload."""

    def one(x: Float[Array, "24"]) -> Float[Array, "6 14"]:
        inertial = identification.inertial_regressor(identification.payload_state_from_input(x), x[18:21], x[21:24])[
            :, :4
        ]
        drag = jax.jacfwd(lambda b: mean_functions.DragThrustMean(payload=b, agents=()).payload_mean(x))(jnp.zeros(4))
        return jnp.concatenate([inertial, drag, jnp.eye(6)], axis=1)

    return jax.vmap(one)(x)


@jax.jit
def _agent_regressors(x: Float[Array, "samples inputs"]) -> Float[Array, "samples 3 5"]:
    """Return drag, thrust and constant columns of an agent."""

    def one(x: Float[Array, "inputs"]) -> Float[Array, "3 5"]:
        def force(b: Float[Array, "2"]) -> Float[Array, "3"]:
            mean_function = mean_functions.DragThrustMean(payload=jnp.zeros(4), agents=(b[None],))
            return mean_function.agent_means(0, x[None])[0, :3]

        return jnp.concatenate([jax.jacfwd(force)(jnp.zeros(2)), jnp.eye(3)], axis=1)

    return jax.vmap(one)(x)


def set_mean_parameters(
    model: residual_model.ResidualModel, body: features.BodyKey, beta: np.ndarray, nominal: Payload
) -> residual_model.ResidualModel:
    """Replace the mean parameters of a body.

    The constants are not set: they are the constant prior mean of the GPs.

    Args:
        model: Residual model with a `DragThrustMean`.
        body: Key of the body.
        beta: Mean parameters in the order of `MeanPrior`.
        nominal: Nominal payload, which limits the inertial parameters.

    Returns:
        The residual model with the new parameters.
    """
    mean_function = model.mean_function
    assert isinstance(mean_function, mean_functions.DragThrustMean)
    if isinstance(body, str):
        theta = jnp.asarray(
            identification.enforce_physical_consistency(np.concatenate([beta[:4], np.zeros(6)]), nominal)
        )
        return dataclasses.replace(
            model,
            inertial_parameters=theta,
            mean_function=dataclasses.replace(mean_function, payload=jnp.asarray(beta[4:8])),
        )
    i, j = body
    agents = (
        *mean_function.agents[:i],
        mean_function.agents[i].at[j].set(beta[:2]),
        *mean_function.agents[i + 1 :],
    )
    return dataclasses.replace(model, mean_function=dataclasses.replace(mean_function, agents=agents))
