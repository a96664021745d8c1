"""What is learned: features, samples that are recorded in flight, frozen oracles.

On `[t_k, t_{k+1})` the oracle is an immutable value. Data sets keep the raw, filtered inputs; a feature map turns
them into what a GP sees, so another map needs no new data.
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
from colift.onboard.learning.mean_functions import BasisMean, DragThrustMean
from colift.onboard.learning.recorder import RecorderState
from colift.onboard.learning.residual_model import ResidualModel, get_model, predict_padded, replace_models
from colift.runtime import signals

T = TypeVar("T")


@dataclasses.dataclass(frozen=True)
class FitOptions:
    """How hyperparameters are fitted at an update; where there is no `Training`, those of the prior stay."""

    payload: gp.HyperPrior
    agents: tuple[gp.HyperPrior, ...]  # by group
    restarts: int
    max_iterations: int

    def prior_for(self, body: BodyKey) -> gp.HyperPrior:
        """What is believed of a body's hyperparameters before any data."""
        return self.payload if isinstance(body, str) else self.agents[body[0]]


Samples = tuple[np.ndarray, np.ndarray, np.ndarray]

Fits = Mapping[BodyKey, gp.FitResult]
"""The last fit of each body that has one."""


@dataclasses.dataclass(frozen=True)
class ChangePoint:
    """The world of a body has changed: since when, and what was known of it until then."""

    time: float  # s
    model: gp.GPPosterior
    theta: Float[Array, "10"]  # of the oracle


ChangePoints = Mapping[BodyKey, ChangePoint]
"""The last change of each body that has seen one."""


def samples_by_body(recorder_state: RecorderState) -> dict[BodyKey, Samples]:
    """`(X, Y, t)` of every body in the order of time, as recorded: inputs and labels."""
    found: dict[BodyKey, gp.Dataset] = {"payload": recorder_state.payload}
    for i, data in enumerate(recorder_state.agents):
        found |= {(i, j): jax.tree.map(lambda x, j=j: x[j], data) for j in range(len(data.n))}
    out = {}
    for body, data in found.items():
        t = np.asarray(data.t)[: int(data.n)]
        order = np.argsort(t, kind="stable")
        out[body] = np.asarray(data.X)[order], np.asarray(data.Y)[order], t[order]
    return out


def select_samples(
    residual_model: ResidualModel,
    before: RecorderState,
    recorder_state: RecorderState,
    after: float,
    context: float,
    span: float,
    changes: ChangePoints,
) -> RecorderState:
    """The data sets with what was recorded since `after`, s; of too many samples those that tell most (host).

    As `gp.thinned` has it, with noise that counts as `1 + age / span` times what it is, so that of two samples that
    tell the same the newer one stays. Where a body's world has changed those before it go first.
    """
    held, new = samples_by_body(before), samples_by_body(recorder_state)

    def of(body: BodyKey) -> Samples:
        model, fresh = get_model(residual_model, body), new[body][2] > after + 1e-9
        x, Y, t = (np.concatenate([old, more[fresh]]) for old, more in zip(held[body], new[body], strict=True))
        since = changes[body].time if body in changes else -np.inf
        Z = compute_features(residual_model.features, body, x)
        stays = gp.select_subset(Z, model.hyper, model.capacity, 1 + (context - t) / span, first=t < since)
        return x[stays], Y[stays], t[stays]

    return _recorded(before, parallel_map(of, held))


def drop_before(recorder_state: RecorderState, start: Mapping[BodyKey, float]) -> RecorderState:
    """The data sets without what bodies recorded before a time of their own, s (host)."""
    left = {}
    for body, of in samples_by_body(recorder_state).items():
        late = of[2] >= start.get(body, -np.inf)
        left[body] = of[0][late], of[1][late], of[2][late]
    return _recorded(recorder_state, left)


def _recorded(like: RecorderState, samples: Mapping[BodyKey, Samples]) -> RecorderState:
    """Data sets of these samples."""

    def data(like: gp.Dataset, of: Samples) -> gp.Dataset:
        n = len(of[2])
        X, Y, t = (jnp.asarray(np.pad(x, ((0, like.t.shape[-1] - n), *[(0, 0)] * (x.ndim - 1)))) for x in of)
        return dataclasses.replace(like, X=X, Y=Y, t=t, n=jnp.asarray(n))

    groups = []
    for i, group in enumerate(like.agents):
        each = [data(jax.tree.map(lambda x, j=j: x[j], group), samples[i, j]) for j in range(len(group.n))]
        groups.append(jax.tree.map(lambda *x: jnp.stack(x), *each))
    return dataclasses.replace(like, payload=data(like.payload, samples["payload"]), agents=tuple(groups))


def regression_targets(
    model: ResidualModel, recorder_state: RecorderState, changes: ChangePoints = MappingProxyType({})
) -> dict[BodyKey, Samples]:
    """`(X, Y, t)` of every body in the order of time, X features, Y what the GPs are to explain: labels less `beside`.

    Of a body whose world has changed, those since then.
    """
    payload, agents = _beside(model.inertial_parameters, model.mean_function, recorder_state)
    left = dataclasses.replace(
        recorder_state,
        payload=dataclasses.replace(recorder_state.payload, Y=recorder_state.payload.Y - payload),
        agents=tuple(
            data if y is None else dataclasses.replace(data, Y=data.Y - y)
            for data, y in zip(recorder_state.agents, agents, strict=True)
        ),
    )
    out = {}
    for body, (x, Y, t) in samples_by_body(left).items():
        keep = t >= (changes[body].time if body in changes else -np.inf)
        out[body] = compute_features(model.features, body, x[keep]), Y[keep], t[keep]
    return out


@jax.jit
def _beside(
    theta: Float[Array, "10"], known: BasisMean | DragThrustMean | None, recorder_state: RecorderState
) -> tuple[Float[Array, "rows 6"], tuple[Float[Array, "_agents _rows _outputs"] | None, ...]]:
    """What an oracle says beside its GPs at all samples: `Y theta`, and what is known."""
    payload = jax.vmap(_inertial, (0, None))(recorder_state.payload.X, theta)
    if known is None:
        return payload, (None,) * len(recorder_state.agents)
    payload = payload + jax.vmap(known.payload_mean)(recorder_state.payload.X)
    of = lambda i, X: jax.vmap(lambda x: known.agent_means(i, x), 1, 1)(X)  # noqa: E731
    return payload, tuple(of(i, data.X) for i, data in enumerate(recorder_state.agents))


def _inertial(x: Float[Array, "24"], theta: Float[Array, "10"]) -> Float[Array, "6"]:
    """`Y theta` at a payload sample."""
    return inertial_regressor(payload_state_from_input(x), x[18:21], x[21:24]) @ theta


def offset_model(change: ChangePoint, X: np.ndarray, Y: np.ndarray) -> gp.GPPosterior:
    """The model before a change, moved by what samples since say beyond it on average, `f + mean(y - f(x))` (host)."""
    old = change.model
    more = jnp.asarray((Y - predict_padded(old, X)[0]).mean(0))
    moved = jnp.where(
        (jnp.arange(old.capacity) < old.num_points)[:, None], old.Y + jnp.tile(more, (old.capacity, 1)), old.Y
    )
    return dataclasses.replace(
        old, Y=moved, hyper=dataclasses.replace(old.hyper, constant_mean=old.hyper.constant_mean + more)
    )


def merge_with_previous(old: gp.GPPosterior, X: np.ndarray, Y: np.ndarray) -> gp.GPPosterior:
    """A model of samples since a change, and of those before it that tell most, as the budget has room (host).

    old: as `shifted`. Where the team has not been again the map keeps its shape.
    """
    n = int(old.num_points)
    Z, both = (np.concatenate([np.asarray(before)[:n], new]) for before, new in ((old.X, X), (old.Y, Y)))
    stays = gp.select_subset(Z, old.hyper, old.capacity, np.ones(len(Z)), first=np.arange(len(Z)) < n)
    return gp.condition(Z[stays], both[stays], old.hyper, old.capacity)


def fit(
    residual_model: ResidualModel, recorder_state: RecorderState, training: FitOptions | None, last: Fits
) -> tuple[ResidualModel, Fits]:
    """The oracle frozen on the data so far: fit from the last hyperparameters, then condition (host).

    A body without data keeps its predictor. The constant part of each output's prior mean is the mean of its labels
    (the remark on mean functions); the rest is the GP's. Bodies are fitted side by side. Without `training` the
    hyperparameters and the prior mean stay as they are, as error bounds ask for.
    """
    found = {
        body: (X, Y) for body, (X, Y, _) in regression_targets(residual_model, recorder_state).items() if len(X) > 1
    }

    def study(body: BodyKey) -> tuple[gp.FitResult | None, gp.GPPosterior]:
        (X, Y), frozen = found[body], get_model(residual_model, body)
        if training is None:
            return None, gp.condition(X, Y, frozen.hyper, frozen.capacity)
        before = last.get(body)
        fit = gp.fit(
            X,
            Y,
            hyperprior=training.prior_for(body),
            start=before.hyper if before else None,
            restarts=0 if before else training.restarts,
            max_iterations=training.max_iterations,
        )
        return fit, gp.condition(X, Y, fit.hyper, frozen.capacity)

    learned = parallel_map(study, found)
    fits = {**last, **{body: fit for body, (fit, _) in learned.items() if fit is not None}}
    return replace_models(residual_model, {body: model for body, (_, model) in learned.items()}), fits


def loo_normalized_error(model: gp.GPPosterior, newest: int) -> float:
    """Mean of `(y - f)^2` over its predicted variance of a model's newest samples, each left out; 1 if it fits (host).

    Rasmussen and Williams 2006, Eqs. 5.11 and 5.12.
    """
    off, variance = (np.asarray(x) for x in gp.leave_one_out(model))
    n = int(model.num_points)
    return float((off**2 / variance)[:, max(0, n - newest) : n].mean())


def parallel_map(study: Callable[[BodyKey], T], bodies: Collection[BodyKey]) -> dict[BodyKey, T]:
    """What a study of each body gives; with one BLAS thread each: at these sizes more only wait for each other."""

    def one(body: BodyKey) -> T:
        signals.raise_if_interrupted()
        return study(body)

    with threadpool_limits(1), ThreadPoolExecutor(os.cpu_count()) as pool:
        return dict(zip(bodies, pool.map(one, bodies), strict=True))


def condition(
    model: ResidualModel,
    recorder_state: RecorderState,
    changes: ChangePoints = MappingProxyType({}),
    waiting: Collection[BodyKey] = (),
) -> ResidualModel:
    """The oracle on the data so far with the hyperparameters and prior means that it has (host).

    A body whose world has changed learns from what is `amended`; while it is in `waiting` its model from before the
    change flies on, `shifted`. A body without data keeps its predictor.
    """
    models = {}
    for body, (X, Y, _) in regression_targets(model, recorder_state, changes).items():
        frozen = get_model(model, body)
        if body in changes and len(X):
            moved = offset_model(changes[body], X, Y)
            models[body] = moved if body in waiting else merge_with_previous(moved, X, Y)
        elif body not in changes and len(X) > 1:
            models[body] = gp.condition(X, Y, frozen.hyper, frozen.capacity)
    return replace_models(model, models)


def make_change_point(model: ResidualModel, body: BodyKey, since: float) -> ChangePoint:
    """A change of a body's world: what the oracle knows of it is what was known until then."""
    return ChangePoint(time=since, model=get_model(model, body), theta=model.inertial_parameters)
