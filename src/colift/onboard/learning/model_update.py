"""Update of residual models from recorded samples.

The functions select samples for a fixed budget, fit hyperparameters, and condition the Gaussian processes (GPs) of all
bodies. After a change point of a body, its previous model is offset and merged with the samples since the change. All
functions run on the host.

See Also:
    colift.onboard.learning.semiparametric: joint estimation of mean functions and GPs.
    docs/learning: equations of sample selection and change points.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from types import MappingProxyType
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float
from threadpoolctl import threadpool_limits

from colift import gp
from colift.onboard.learning.features import BodyKey, compute_features
from colift.onboard.learning.identification import inertial_regressor, payload_state_from_input
from colift.onboard.learning.mean_functions import MeanFunction
from colift.onboard.learning.recorder import RecorderState
from colift.onboard.learning.residual_model import ResidualModel, get_model, predict_padded, replace_models
from colift.runtime import signals

T = TypeVar("T")


@dataclasses.dataclass(frozen=True)
class FitOptions:
    """Options of the hyperparameter fit at an update.

    Without these options an update keeps all hyperparameters.

    Attributes:
        payload: Hyperprior of the payload.
        agents: Hyperpriors of the agents, by group.
        restarts: Number of additional random starts of the first fit of a body.
        max_iterations: Largest number of iterations of the optimizer.
    """

    payload: gp.HyperPrior
    agents: tuple[gp.HyperPrior, ...]
    restarts: int = 1
    max_iterations: int = 300

    def prior_for(self, body: BodyKey) -> gp.HyperPrior:
        """Return the hyperprior of a body.

        Args:
            body: Key of the body.

        Returns:
            The hyperprior; all agents of a group have the same one.
        """
        return self.payload if isinstance(body, str) else self.agents[body[0]]


Samples = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Inputs, labels and times [s] of the samples of a body, in the order of time."""

Fits = Mapping[BodyKey, gp.FitResult]
"""Last hyperparameter fit of each body that has one."""


@dataclasses.dataclass(frozen=True)
class ChangePoint:
    """Change of the residual of a body, with the model before the change.

    Attributes:
        time: Time of the change [s].
        model: GP of the body before the change.
        theta: Inertial parameters of the residual model before the change.
    """

    time: float
    model: gp.GPPosterior
    theta: Float[Array, "10"]


ChangePoints = Mapping[BodyKey, ChangePoint]
"""Last change point of each body that has one."""


def samples_by_body(recorder_state: RecorderState) -> dict[BodyKey, Samples]:
    """Return the recorded samples of every body in the order of time.

    Args:
        recorder_state: Recorded samples.

    Returns:
        Inputs, labels and times by body.
    """
    datasets: dict[BodyKey, gp.Dataset] = {"payload": recorder_state.payload}
    for i, data in enumerate(recorder_state.agents):
        datasets |= {(i, j): jax.tree.map(lambda x, j=j: x[j], data) for j in range(len(data.n))}
    out = {}
    for body, data in datasets.items():
        t = np.asarray(data.t)[: int(data.n)]
        order = np.argsort(t, kind="stable")
        out[body] = np.asarray(data.X)[order], np.asarray(data.Y)[order], t[order]
    return out


def select_samples(
    model: ResidualModel,
    previous: RecorderState,
    recorder_state: RecorderState,
    last_sample_time: float,
    t: float,
    forgetting_time: float,
    change_points: ChangePoints,
) -> RecorderState:
    """Add new samples to the selected ones and keep the most informative within the budget.

    The selection is `gp.select_subset` with the noise variance multiplied by ``1 + age / forgetting_time``. Of two
    equally informative samples the newer one is kept. Samples before a change point of their body are removed first.

    Args:
        model: Residual model with the hyperparameters for the selection; its capacity is the budget.
        previous: Samples selected at the previous update.
        recorder_state: Samples of the recorder.
        last_sample_time: Time of the last sample of the previous update [s]; later samples are new.
        t: Time of the update [s].
        forgetting_time: Age at which the noise variance of a sample is doubled [s].
        change_points: Change points of the bodies.

    Returns:
        The selected samples.
    """
    selected, recorded = samples_by_body(previous), samples_by_body(recorder_state)

    def select(body: BodyKey) -> Samples:
        posterior, new = get_model(model, body), recorded[body][2] > last_sample_time + 1e-9
        x, Y, times = (
            np.concatenate([old, samples[new]]) for old, samples in zip(selected[body], recorded[body], strict=True)
        )
        change_time = change_points[body].time if body in change_points else -np.inf
        Z = compute_features(model.features, body, x)
        noise = 1 + (t - times) / forgetting_time
        keep = gp.select_subset(Z, posterior.hyper, posterior.capacity, noise, first=times < change_time)
        return x[keep], Y[keep], times[keep]

    return _replace_samples(previous, parallel_map(select, selected))


def drop_before(recorder_state: RecorderState, start: Mapping[BodyKey, float]) -> RecorderState:
    """Remove the samples of some bodies before a time.

    Args:
        recorder_state: Recorded samples.
        start: Time of the first sample to keep, by body [s].

    Returns:
        The remaining samples.
    """
    remaining = {}
    for body, samples in samples_by_body(recorder_state).items():
        keep = samples[2] >= start.get(body, -np.inf)
        remaining[body] = samples[0][keep], samples[1][keep], samples[2][keep]
    return _replace_samples(recorder_state, remaining)


def _replace_samples(like: RecorderState, samples: Mapping[BodyKey, Samples]) -> RecorderState:
    """Return the recorder state with the given samples, in data sets of the same capacity."""

    def padded(like: gp.Dataset, body_samples: Samples) -> gp.Dataset:
        n = len(body_samples[2])
        X, Y, t = (jnp.asarray(np.pad(x, ((0, like.t.shape[-1] - n), *[(0, 0)] * (x.ndim - 1)))) for x in body_samples)
        return dataclasses.replace(like, X=X, Y=Y, t=t, n=jnp.asarray(n))

    groups = []
    for i, group in enumerate(like.agents):
        each = [padded(jax.tree.map(lambda x, j=j: x[j], group), samples[i, j]) for j in range(len(group.n))]
        groups.append(jax.tree.map(lambda *x: jnp.stack(x), *each))
    return dataclasses.replace(like, payload=padded(like.payload, samples["payload"]), agents=tuple(groups))


def regression_targets(
    model: ResidualModel, recorder_state: RecorderState, change_points: ChangePoints = MappingProxyType({})
) -> dict[BodyKey, Samples]:
    """Return the training data of the GPs: features, and labels minus the parametric prediction.

    Args:
        model: Residual model with features, inertial parameters and mean function.
        recorder_state: Recorded samples.
        change_points: Change points; samples of a body before its change point are left out.

    Returns:
        Features, targets and times by body, in the order of time.
    """
    payload, agents = _parametric_prediction(model.inertial_parameters, model.mean_function, recorder_state)
    targets = dataclasses.replace(
        recorder_state,
        payload=dataclasses.replace(recorder_state.payload, Y=recorder_state.payload.Y - payload),
        agents=tuple(
            data if y is None else dataclasses.replace(data, Y=data.Y - y)
            for data, y in zip(recorder_state.agents, agents, strict=True)
        ),
    )
    out = {}
    for body, (x, Y, t) in samples_by_body(targets).items():
        keep = t >= (change_points[body].time if body in change_points else -np.inf)
        out[body] = compute_features(model.features, body, x[keep]), Y[keep], t[keep]
    return out


@jax.jit
def _parametric_prediction(
    theta: Float[Array, "10"], mean_function: MeanFunction | None, recorder_state: RecorderState
) -> tuple[Float[Array, "rows 6"], tuple[Float[Array, "_agents _rows _outputs"] | None, ...]]:
    """Predict the labels of all samples without the GPs: inertial wrench plus mean function."""
    payload = jax.vmap(_inertial_wrench, (0, None))(recorder_state.payload.X, theta)
    if mean_function is None:
        return payload, (None,) * len(recorder_state.agents)
    payload = payload + jax.vmap(mean_function.payload_mean)(recorder_state.payload.X)
    means = lambda i, X: jax.vmap(lambda x: mean_function.agent_means(i, x), 1, 1)(X)  # noqa: E731
    return payload, tuple(means(i, data.X) for i, data in enumerate(recorder_state.agents))


def _inertial_wrench(x: Float[Array, "24"], theta: Float[Array, "10"]) -> Float[Array, "6"]:
    """Return ``Y theta`` at a payload input."""
    return inertial_regressor(payload_state_from_input(x), x[18:21], x[21:24]) @ theta


def offset_model(change_point: ChangePoint, X: np.ndarray, Y: np.ndarray) -> gp.GPPosterior:
    """Offset the model before a change by the mean error at the samples since: ``mu_0 + mean_k(y_k - mu_0(x_k))``.

    Args:
        change_point: Change point of a body.
        X: Features of the samples since the change.
        Y: Targets of these samples.

    Returns:
        The offset model.
    """
    old = change_point.model
    offset = jnp.asarray((Y - predict_padded(old, X)[0]).mean(0))
    targets = jnp.where(
        (jnp.arange(old.capacity) < old.num_points)[:, None], old.Y + jnp.tile(offset, (old.capacity, 1)), old.Y
    )
    return dataclasses.replace(
        old, Y=targets, hyper=dataclasses.replace(old.hyper, constant_mean=old.hyper.constant_mean + offset)
    )


def merge_with_previous(old: gp.GPPosterior, X: np.ndarray, Y: np.ndarray) -> gp.GPPosterior:
    """Condition a GP on the samples since a change and on the most informative samples before it.

    Where the team has not been since the change, the model keeps its previous shape.

    Args:
        old: Offset model of `offset_model`.
        X: Features of the samples since the change.
        Y: Targets of these samples.

    Returns:
        The model within the budget of samples.
    """
    n = int(old.num_points)
    Z, targets = (np.concatenate([np.asarray(before)[:n], new]) for before, new in ((old.X, X), (old.Y, Y)))
    keep = gp.select_subset(Z, old.hyper, old.capacity, np.ones(len(Z)), first=np.arange(len(Z)) < n)
    return gp.condition(Z[keep], targets[keep], old.hyper, old.capacity)


def fit(
    model: ResidualModel, recorder_state: RecorderState, fit_options: FitOptions | None, last_fits: Fits
) -> tuple[ResidualModel, Fits]:
    """Fit hyperparameters and condition the GPs of all bodies on the recorded samples.

    The fit starts from the last hyperparameters. The constant prior mean of each output is the mean of its labels.
    Bodies are fitted in parallel. A body with fewer than two samples keeps its model.

    Args:
        model: Residual model before the update.
        recorder_state: Recorded samples.
        fit_options: Options of the fit; None keeps hyperparameters and prior means, as error bounds require.
        last_fits: Last fits by body.

    Returns:
        The residual model and the last fits by body.
    """
    targets = {body: (X, Y) for body, (X, Y, _) in regression_targets(model, recorder_state).items() if len(X) > 1}

    def fit_body(body: BodyKey) -> tuple[gp.FitResult | None, gp.GPPosterior]:
        (X, Y), current = targets[body], get_model(model, body)
        if fit_options is None:
            return None, gp.condition(X, Y, current.hyper, current.capacity)
        before = last_fits.get(body)
        fit = gp.fit(
            X,
            Y,
            hyperprior=fit_options.prior_for(body),
            start=before.hyper if before else None,
            restarts=0 if before else fit_options.restarts,
            max_iterations=fit_options.max_iterations,
        )
        return fit, gp.condition(X, Y, fit.hyper, current.capacity)

    fitted = parallel_map(fit_body, targets)
    fits = {**last_fits, **{body: fit for body, (fit, _) in fitted.items() if fit is not None}}
    return replace_models(model, {body: posterior for body, (_, posterior) in fitted.items()}), fits


def loo_normalized_error(model: gp.GPPosterior, newest: int) -> float:
    """Compute the mean normalized squared leave-one-out error of the newest samples of a model.

    The error of a sample is divided by its predicted variance (Rasmussen and Williams 2006, Eqs. 5.11 and 5.12). The
    expected value is 1 for a correct model.

    Args:
        model: GP of a body.
        newest: Number of samples, the latest of the model.

    Returns:
        Mean over samples and outputs.
    """
    error, variance = (np.asarray(x) for x in gp.leave_one_out(model))
    n = int(model.num_points)
    return float((error**2 / variance)[:, max(0, n - newest) : n].mean())


def parallel_map(function: Callable[[BodyKey], T], bodies: Collection[BodyKey]) -> dict[BodyKey, T]:
    """Evaluate a function for every body in parallel threads.

    Each thread uses one BLAS thread: for matrices of this size, more threads increase the computation time.

    Args:
        function: Function of the key of a body.
        bodies: Keys of the bodies.

    Returns:
        Values of the function by body.
    """

    def call(body: BodyKey) -> T:
        signals.raise_if_interrupted()
        return function(body)

    with threadpool_limits(1), ThreadPoolExecutor(os.cpu_count()) as pool:
        return dict(zip(bodies, pool.map(call, bodies), strict=True))


def condition(
    model: ResidualModel,
    recorder_state: RecorderState,
    change_points: ChangePoints = MappingProxyType({}),
    pending: Collection[BodyKey] = (),
) -> ResidualModel:
    """Condition the GPs of all bodies on the recorded samples with the present hyperparameters and prior means.

    A body with a change point obtains `merge_with_previous`; while it is pending, its previous model is offset by
    `offset_model`. A body without data keeps its model.

    Args:
        model: Residual model before the update.
        recorder_state: Recorded samples.
        change_points: Change points of the bodies.
        pending: Bodies with too few samples since their change point for a new model.

    Returns:
        The residual model.
    """
    models = {}
    for body, (X, Y, _) in regression_targets(model, recorder_state, change_points).items():
        current = get_model(model, body)
        if body in change_points and len(X):
            offset = offset_model(change_points[body], X, Y)
            models[body] = offset if body in pending else merge_with_previous(offset, X, Y)
        elif body not in change_points and len(X) > 1:
            models[body] = gp.condition(X, Y, current.hyper, current.capacity)
    return replace_models(model, models)


def make_change_point(model: ResidualModel, body: BodyKey, time: float) -> ChangePoint:
    """Create the change point of a body with the present model as the model before the change.

    Args:
        model: Residual model before the change.
        body: Key of the body.
        time: Time of the change [s].

    Returns:
        The change point.
    """
    return ChangePoint(time=time, model=get_model(model, body), theta=model.inertial_parameters)
