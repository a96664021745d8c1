"""Semiparametric residual models: a physical mean function and Gaussian processes of the position.

Far from all data, a Gaussian process (GP) of all features returns its prior mean. The physical effects of mass, drag
and thrust bias extend to other positions, speeds and attitudes. The forces of all bodies and the payload moment are
therefore modelled by ``y = Phi(x) beta + f(p) + noise``. The columns of ``Phi`` are these effects and constants. ``f``
is a GP of the position ``p`` only, as a wind field is a function of position. Moments and joint torques of agents keep
GPs of all features. ``f``, mass, first moments and constants may change with time (`colift.gp.TimeVariation`). All
functions run on the host.

See Also:
    colift.gp.semiparametric: joint estimation of hyperparameters and ``beta``.
    colift.onboard.learning.mean_functions, colift.onboard.learning.identification: the columns of ``Phi``.

References:
    Rasmussen, Williams, *Gaussian Processes for Machine Learning*, 2006, Section 2.7.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import ClassVar

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
        median_rate: Median of the prior of the rate of changes with time [1/s] (`colift.gp.TimeVariation`).

    Mass, first moments and constants change with time: a load is added, or the wind turns. Drag and thrust bias are
    properties of the body.
    """

    payload: np.ndarray
    agents: np.ndarray
    nominal_payload: Payload
    median_rate: float = 1 / 300

    PAYLOAD_VARIES: ClassVar = np.array([1.0] * 4 + [0.0] * 4 + [1.0] * 6)
    AGENT_VARIES: ClassVar = np.array([0.0] * 2 + [1.0] * 3)


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
"""Mean uncertainty of every body with a fitted mean."""

Variations = Mapping[features.BodyKey, model_update.Variation]
"""Changes of the residual with time, by body."""


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
    return _restricted_prior(hyperprior, np.concatenate(OUTPUT_BLOCKS[payload]), inactive)


def joint_torque_prior(hyperprior: gp.HyperPrior, names: Sequence[str]) -> gp.HyperPrior:
    """Restrict the GPs of an agent's joint torques to attitude, joint positions and joint rates.

    Friction depends on joint rates, and the moment of a link of unknown mass on attitude and joint positions.

    Args:
        hyperprior: Hyperprior of an agent over all features.
        names: Names of the features, in order.

    Returns:
        The restricted hyperprior; the same one for a feature map without these features.
    """
    inactive = np.array([not name.startswith(("R_", "r_")) for name in names])
    return _restricted_prior(hyperprior, np.arange(6, len(hyperprior.median.lengthscales)), inactive)


def _restricted_prior(hyperprior: gp.HyperPrior, outputs: np.ndarray, inactive: np.ndarray) -> gp.HyperPrior:
    """Return the hyperprior with inactive features of some outputs; the same one if no feature would be active."""
    if inactive.all():
        return hyperprior
    columns = np.ix_(outputs, np.flatnonzero(inactive))
    scale = hyperprior.median.lengthscales.at[columns].set(gp.INACTIVE_LENGTHSCALE)
    return dataclasses.replace(hyperprior, median=dataclasses.replace(hyperprior.median, lengthscales=scale))


def time_variation(t: np.ndarray, end: float, variation: model_update.Variation, payload: bool) -> gp.TimeVariation:
    """Return the changes of a body between its samples and the time of an update.

    Args:
        t: Times of the samples [s].
        end: Time of the update [s].
        variation: Changes of the residual of the body.
        payload: Whether the body is the payload.

    Returns:
        The changes.
    """
    varying = MeanPrior.PAYLOAD_VARIES if payload else MeanPrior.AGENT_VARIES
    return gp.TimeVariation(age=end - t, jumps=variation.num_since(t), varying=varying)


def fit(
    model: residual_model.ResidualModel,
    recorder_state: recorder.RecorderState,
    fit_options: model_update.FitOptions,
    mean_prior: MeanPrior,
    last_fits: model_update.Fits,
    variations: Variations | None = None,
) -> tuple[residual_model.ResidualModel, model_update.Fits, Variations]:
    """Fit the hyperparameters of all bodies with at least two samples.

    Args:
        model: Residual model before the update, with a `DragThrustMean`.
        recorder_state: Recorded samples.
        fit_options: Options of the fit.
        mean_prior: Prior of the mean parameters.
        last_fits: Last fits by body.
        variations: Changes of the residual with time, by body; None for a constant residual.

    Returns:
        The residual model with new hyperparameters, which is not conditioned yet, the last fits, and the changes with
        new rates.
    """
    samples = _sufficient_samples(recorder_state)

    def fit_body(body: features.BodyKey) -> tuple[gp.FitResult, float | None]:
        of = None if variations is None else variations[body]
        return _fit_body(model, body, samples[body], fit_options, mean_prior, last_fits.get(body), of)

    fitted = model_update.parallel_map(fit_body, samples)
    models = {
        body: dataclasses.replace(residual_model.get_model(model, body), hyper=fit.hyper)
        for body, (fit, _) in fitted.items()
    }
    later = {
        body: dataclasses.replace((variations or {})[body], rate=rate)
        for body, (_, rate) in fitted.items()
        if rate is not None
    }
    index = model.update_index
    model = dataclasses.replace(residual_model.replace_models(model, models), update_index=index)
    return model, {**last_fits, **{body: fit for body, (fit, _) in fitted.items()}}, {**(variations or {}), **later}


def condition(
    model: residual_model.ResidualModel,
    recorder_state: recorder.RecorderState,
    mean_prior: MeanPrior,
    end: float,
    variations: Variations | None = None,
) -> tuple[residual_model.ResidualModel, dict[features.BodyKey, np.ndarray]]:
    """Estimate the present mean parameters of all bodies and condition their GPs.

    Args:
        model: Residual model with the hyperparameters.
        recorder_state: Recorded samples.
        mean_prior: Prior of the mean parameters.
        end: Time of the update [s].
        variations: Changes of the residual with time, by body; None for a constant residual.

    Returns:
        The residual model, and the posterior covariances of the mean parameters by body.
    """
    samples = _sufficient_samples(recorder_state)

    def estimate(body: features.BodyKey) -> _Estimate:
        of = None if variations is None else variations[body]
        return _estimate_body(model, body, samples[body], mean_prior, end, of)

    found = model_update.parallel_map(estimate, samples)
    for body, of_body in found.items():
        model = set_mean_parameters(model, body, of_body.beta, mean_prior.nominal_payload)
    targets = model_update.regression_targets(model, recorder_state)

    def condition_body(body: features.BodyKey) -> gp.GPPosterior:
        current, (Z, Y, _) = residual_model.get_model(model, body), targets[body]
        hyper = dataclasses.replace(current.hyper, constant_mean=jnp.asarray(found[body].constants))
        return gp.condition(Z, Y, hyper, current.capacity, found[body].noise_covariance)

    models = model_update.parallel_map(condition_body, found)
    return residual_model.replace_models(model, models), {body: of.covariance for body, of in found.items()}


def _sufficient_samples(recorder_state: recorder.RecorderState) -> dict[features.BodyKey, model_update.Samples]:
    """Return the samples of all bodies with at least two."""
    return {body: of for body, of in model_update.samples_by_body(recorder_state).items() if len(of[0]) > 1}


@dataclasses.dataclass(frozen=True)
class _Estimate:
    """Present mean parameters of a body and the covariance of the changes since its samples."""

    beta: np.ndarray
    covariance: np.ndarray
    constants: np.ndarray
    noise_covariance: np.ndarray


def _estimate_body(
    model: residual_model.ResidualModel,
    body: features.BodyKey,
    samples: model_update.Samples,
    mean_prior: MeanPrior,
    end: float,
    variation: model_update.Variation | None,
) -> _Estimate:
    """Estimate the present mean parameters and constants of a body."""
    (x, Y, t), payload = samples, isinstance(body, str)
    hyper = residual_model.get_model(model, body).hyper
    prior = mean_prior.payload if payload else mean_prior.agents
    Z, Phi = features.compute_features(model.features, body, x), mean_regressors(x, payload)
    num_joint, num_outputs = Phi.shape[1], Y.shape[1]
    D = np.zeros((num_outputs, len(x), len(x)))
    if variation is not None:
        of_time = time_variation(t, end, variation, payload)
        D[:num_joint] = of_time.covariance(Z, Phi, prior, hyper, variation.rate)
        of_f, of_constant = of_time.weights(variation.rate)
        for i in range(num_joint, num_outputs):  # a constant variation by the standard deviation of its GP
            D[i] = of_f * gp.function_covariance(Z, hyper, i) + of_constant * float(hyper.signal_variance[i])
    beta, covariance = gp.estimate_parameters(Z, Y[:, :num_joint], Phi, prior, hyper, D)
    constants = np.array(hyper.constant_mean)
    constants[:num_joint] = beta[-num_joint:]
    for i in range(num_joint, num_outputs):
        constants[i] = _generalized_mean(Z, Y[:, i], hyper, i, D[i])
    return _Estimate(beta=beta, covariance=covariance, constants=constants, noise_covariance=D)


def _generalized_mean(
    Z: np.ndarray, y: np.ndarray, hyper: gp.Hyperparameters, i: int, noise_covariance: np.ndarray
) -> float:
    """Return the constant of an output by generalized least squares, ``1^T K^-1 y / 1^T K^-1 1``."""
    K = gp.function_covariance(Z, hyper, i) + noise_covariance
    K.flat[:: len(K) + 1] += float(hyper.noise_variance[i])
    weights = np.linalg.solve(K, np.ones(len(y)))
    return float(weights @ y / weights.sum())


def mean_uncertainties(
    model: residual_model.ResidualModel,
    recorder_state: recorder.RecorderState,
    covariances: Mapping[features.BodyKey, np.ndarray],
) -> MeanUncertainties:
    """Compute the mean uncertainties of a residual model.

    Args:
        model: Residual model.
        recorder_state: Samples on which the model was conditioned.
        covariances: Posterior covariances of the mean parameters, by body.

    Returns:
        Mean uncertainties by body.
    """
    uncertainties, samples = {}, model_update.samples_by_body(recorder_state)
    for body, covariance in covariances.items():
        posterior = residual_model.get_model(model, body)
        Phi = mean_regressors(samples[body][0], isinstance(body, str))
        W = np.asarray(posterior.inverse_cholesky)[: Phi.shape[1], : len(Phi), : len(Phi)]
        weighted = np.stack([w.T @ (w @ Phi[:, i]) for i, w in enumerate(W)])
        uncertainties[body] = MeanUncertainty(weighted_regressors=weighted, covariance=covariance)
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


def _fit_body(
    model: residual_model.ResidualModel,
    body: features.BodyKey,
    samples: model_update.Samples,
    fit_options: model_update.FitOptions,
    mean_prior: MeanPrior,
    last_fit: gp.FitResult | None,
    variation: model_update.Variation | None,
) -> tuple[gp.FitResult, float | None]:
    """Fit the hyperparameters of a body; return the fit and the rate of the changes."""
    x, Y, t = samples
    Z, hyperprior = features.compute_features(model.features, body, x), fit_options.prior_for(body)
    payload = isinstance(body, str)
    num_outputs, blocks = Y.shape[1], OUTPUT_BLOCKS[payload]
    num_joint = len(blocks) * 3  # outputs with a mean function
    joint = gp.fit_semiparametric(
        Z,
        Y[:, :num_joint],
        mean_regressors(x, payload),
        mean_prior.payload if payload else mean_prior.agents,
        blocks,
        hyperprior,
        start=None if last_fit is None else last_fit.hyper,
        max_iterations=fit_options.max_iterations,
        variation=None if variation is None else time_variation(t, float(t.max()), variation, payload),
        median_rate=mean_prior.median_rate,
        start_rate=None if variation is None else variation.rate,
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
        return fit, joint.rate
    rest = slice(num_joint, num_outputs)
    rest_fit = gp.fit(
        Z,
        Y[:, rest],
        hyperprior=dataclasses.replace(hyperprior, median=gp.select_outputs(hyperprior.median, rest)),
        start=None if last_fit is None else gp.select_outputs(last_fit.hyper, rest),
        restarts=0 if last_fit else fit_options.restarts,
        max_iterations=fit_options.max_iterations,
    )
    return gp.concatenate_fits(fit, rest_fit), joint.rate


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
