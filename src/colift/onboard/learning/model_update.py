"""Update of residual models from recorded samples.

The functions select samples for a fixed budget, fit hyperparameters, and condition the Gaussian processes (GPs) of all
bodies. All functions run on the host.

See Also:
    colift.onboard.learning.semiparametric: joint estimation of mean functions and GPs.
    docs/learning: equations of sample selection.
"""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Callable, Collection, Mapping
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift import gp
from colift.gp.likelihood import BLAS
from colift.onboard.learning.features import BodyKey, compute_features
from colift.onboard.learning.identification import inertial_regressor, payload_state_from_input
from colift.onboard.learning.mean_functions import MeanFunction
from colift.onboard.learning.recorder import RecorderState
from colift.onboard.learning.residual_model import ResidualModel, get_model, replace_models
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


SamplesByBody = Mapping[BodyKey, Samples]
"""Samples of every body."""


@dataclasses.dataclass(frozen=True)
class Variation:
    """Changes of the residual of a body with time (`colift.gp.TimeVariation`).

    Attributes:
        rate: Rate of the random walks [1/s].
        times: Times of the change points [s].
    """

    rate: float
    times: tuple[float, ...] = ()

    def num_since(self, t: np.ndarray) -> np.ndarray:
        """Return the number of change points after each time.

        Args:
            t: Times of samples [s].
        """
        return sum(((t < time).astype(float) for time in self.times), np.zeros(len(t)))


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


def merge_samples(previous: RecorderState, recorder_state: RecorderState, last_sample_time: float) -> SamplesByBody:
    """Return the selected samples together with the new ones.

    Args:
        previous: Samples selected at the previous update.
        recorder_state: Samples of the recorder.
        last_sample_time: Time of the last sample of the previous update [s]; later samples are new.

    Returns:
        Samples by body.
    """
    out, recorded = {}, samples_by_body(recorder_state)
    for body, selected in samples_by_body(previous).items():
        new = recorded[body][2] > last_sample_time + 1e-9
        X, Y, t = (np.concatenate([old, x[new]]) for old, x in zip(selected, recorded[body], strict=True))
        out[body] = X, Y, t
    return out


def select_samples(
    model: ResidualModel, samples: SamplesByBody, like: RecorderState, t: float, variations: Mapping[BodyKey, Variation]
) -> RecorderState:
    """Keep the most informative samples within the budget.

    The selection is `gp.select_subset` with the noise variance of each sample plus the variance of the change of the
    force GP since then. Of two equally informative samples the newer one is kept.

    Args:
        model: Residual model with the hyperparameters for the selection; its capacity is the budget.
        samples: Samples by body.
        like: Data sets of the capacity of the result.
        t: Time of the update [s].
        variations: Changes of the residual with time, by body.

    Returns:
        The selected samples.
    """

    def select(body: BodyKey) -> Samples:
        posterior, (x, Y, times) = get_model(model, body), samples[body]
        ratio = float(posterior.hyper.signal_variance[0] / posterior.hyper.noise_variance[0])
        changed = variations[body].rate * (t - times) + gp.JUMP_SHARE * variations[body].num_since(times)
        Z = compute_features(model.features, body, x)
        keep = gp.select_subset(Z, posterior.hyper, posterior.capacity, 1 + ratio * changed)
        return x[keep], Y[keep], times[keep]

    return replace_samples(like, {**samples_by_body(like), **parallel_map(select, samples)})


def replace_samples(like: RecorderState, samples: Mapping[BodyKey, Samples]) -> RecorderState:
    """Return the recorder state with the given samples, in data sets of the same capacity.

    Args:
        like: Data sets that are replaced.
        samples: Samples of all bodies.
    """

    def padded(like: gp.Dataset, body_samples: Samples) -> gp.Dataset:
        n = len(body_samples[2])
        X, Y, t = (jnp.asarray(np.pad(x, ((0, like.t.shape[-1] - n), *[(0, 0)] * (x.ndim - 1)))) for x in body_samples)
        return dataclasses.replace(like, X=X, Y=Y, t=t, n=jnp.asarray(n))

    groups = []
    for i, group in enumerate(like.agents):
        each = [padded(jax.tree.map(lambda x, j=j: x[j], group), samples[i, j]) for j in range(len(group.n))]
        groups.append(jax.tree.map(lambda *x: jnp.stack(x), *each))
    return dataclasses.replace(like, payload=padded(like.payload, samples["payload"]), agents=tuple(groups))


def regression_targets(model: ResidualModel, recorder_state: RecorderState) -> dict[BodyKey, Samples]:
    """Return the training data of the GPs: features, and labels minus the parametric prediction.

    Args:
        model: Residual model with features, inertial parameters and mean function.
        recorder_state: Recorded samples.

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
    return {
        body: (compute_features(model.features, body, x), Y, t) for body, (x, Y, t) in samples_by_body(targets).items()
    }


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

    with BLAS.limit(limits=1), ThreadPoolExecutor(os.cpu_count()) as pool:
        return dict(zip(bodies, pool.map(call, bodies), strict=True))
