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
from colift.onboard.learning.features import Body, features
from colift.onboard.learning.identification import regressor, state_of
from colift.onboard.learning.mean_functions import Air, Linear
from colift.onboard.learning.recorder import Recorded
from colift.onboard.learning.residual_model import Oracle, of_body, told, with_bodies
from colift.runtime import signals

T = TypeVar("T")


@dataclasses.dataclass(frozen=True)
class Training:
    """How hyperparameters are fitted at an update; where there is no `Training`, those of the prior stay."""

    payload: gp.Belief
    agents: tuple[gp.Belief, ...]  # by group
    restarts: int
    max_iterations: int

    def of(self, body: Body) -> gp.Belief:
        """What is believed of a body's hyperparameters before any data."""
        return self.payload if isinstance(body, str) else self.agents[body[0]]


Samples = tuple[np.ndarray, np.ndarray, np.ndarray]

Fits = Mapping[Body, gp.Fit]
"""The last fit of each body that has one."""


@dataclasses.dataclass(frozen=True)
class Change:
    """The world of a body has changed: since when, and what was known of it until then."""

    since: float  # s
    model: gp.GP
    theta: Float[Array, "10"]  # of the oracle


Changes = Mapping[Body, Change]
"""The last change of each body that has seen one."""


def raw(recorded: Recorded) -> dict[Body, Samples]:
    """`(X, Y, t)` of every body in the order of time, as recorded: inputs and labels."""
    found: dict[Body, gp.Data] = {"payload": recorded.payload}
    for i, data in enumerate(recorded.agents):
        found |= {(i, j): jax.tree.map(lambda x, j=j: x[j], data) for j in range(len(data.n))}
    out = {}
    for body, data in found.items():
        t = np.asarray(data.t)[: int(data.n)]
        order = np.argsort(t, kind="stable")
        out[body] = np.asarray(data.X)[order], np.asarray(data.Y)[order], t[order]
    return out


def kept(
    oracle: Oracle, before: Recorded, recorded: Recorded, after: float, now: float, span: float, changes: Changes
) -> Recorded:
    """The data sets with what was recorded since `after`, s; of too many samples those that tell most (host).

    As `gp.thinned` has it, with noise that counts as `1 + age / span` times what it is, so that of two samples that
    tell the same the newer one stays. Where a body's world has changed those before it go first.
    """
    held, new = raw(before), raw(recorded)

    def of(body: Body) -> Samples:
        model, fresh = of_body(oracle, body), new[body][2] > after + 1e-9
        x, Y, t = (np.concatenate([old, more[fresh]]) for old, more in zip(held[body], new[body], strict=True))
        since = changes[body].since if body in changes else -np.inf
        Z = features(oracle.features, body, x)
        stays = gp.thinned(Z, model.hyper, model.capacity, 1 + (now - t) / span, first=t < since)
        return x[stays], Y[stays], t[stays]

    return _recorded(before, side_by_side(of, held))


def since(recorded: Recorded, start: Mapping[Body, float]) -> Recorded:
    """The data sets without what bodies recorded before a time of their own, s (host)."""
    left = {}
    for body, of in raw(recorded).items():
        late = of[2] >= start.get(body, -np.inf)
        left[body] = of[0][late], of[1][late], of[2][late]
    return _recorded(recorded, left)


def _recorded(like: Recorded, samples: Mapping[Body, Samples]) -> Recorded:
    """Data sets of these samples."""

    def data(like: gp.Data, of: Samples) -> gp.Data:
        n = len(of[2])
        X, Y, t = (jnp.asarray(np.pad(x, ((0, like.t.shape[-1] - n), *[(0, 0)] * (x.ndim - 1)))) for x in of)
        return dataclasses.replace(like, X=X, Y=Y, t=t, n=jnp.asarray(n))

    groups = []
    for i, group in enumerate(like.agents):
        each = [data(jax.tree.map(lambda x, j=j: x[j], group), samples[i, j]) for j in range(len(group.n))]
        groups.append(jax.tree.map(lambda *x: jnp.stack(x), *each))
    return dataclasses.replace(like, payload=data(like.payload, samples["payload"]), agents=tuple(groups))


def samples(oracle: Oracle, recorded: Recorded, changes: Changes = MappingProxyType({})) -> dict[Body, Samples]:
    """`(X, Y, t)` of every body in the order of time, X features, Y what the GPs are to explain: labels less `beside`.

    Of a body whose world has changed, those since then.
    """
    payload, agents = _beside(oracle.theta, oracle.known, recorded)
    left = dataclasses.replace(
        recorded,
        payload=dataclasses.replace(recorded.payload, Y=recorded.payload.Y - payload),
        agents=tuple(
            data if y is None else dataclasses.replace(data, Y=data.Y - y)
            for data, y in zip(recorded.agents, agents, strict=True)
        ),
    )
    out = {}
    for body, (x, Y, t) in raw(left).items():
        keep = t >= (changes[body].since if body in changes else -np.inf)
        out[body] = features(oracle.features, body, x[keep]), Y[keep], t[keep]
    return out


@jax.jit
def _beside(
    theta: Float[Array, "10"], known: Linear | Air | None, recorded: Recorded
) -> tuple[Float[Array, "rows 6"], tuple[Float[Array, "_agents _rows _outputs"] | None, ...]]:
    """What an oracle says beside its GPs at all samples: `Y theta`, and what is known."""
    payload = jax.vmap(_inertial, (0, None))(recorded.payload.X, theta)
    if known is None:
        return payload, (None,) * len(recorded.agents)
    payload = payload + jax.vmap(known.on_payload)(recorded.payload.X)
    of = lambda i, X: jax.vmap(lambda x: known.on_agents(i, x), 1, 1)(X)  # noqa: E731
    return payload, tuple(of(i, data.X) for i, data in enumerate(recorded.agents))


def _inertial(x: Float[Array, "24"], theta: Float[Array, "10"]) -> Float[Array, "6"]:
    """`Y theta` at a payload sample."""
    return regressor(state_of(x), x[18:21], x[21:24]) @ theta


def shifted(change: Change, X: np.ndarray, Y: np.ndarray) -> gp.GP:
    """The model before a change, moved by what samples since say beyond it on average, `f + mean(y - f(x))` (host)."""
    old = change.model
    more = jnp.asarray((Y - told(old, X)[0]).mean(0))
    moved = jnp.where((jnp.arange(old.capacity) < old.n)[:, None], old.Y + jnp.tile(more, (old.capacity, 1)), old.Y)
    return dataclasses.replace(old, Y=moved, hyper=dataclasses.replace(old.hyper, offset=old.hyper.offset + more))


def amended(old: gp.GP, X: np.ndarray, Y: np.ndarray) -> gp.GP:
    """A model of samples since a change, and of those before it that tell most, as the budget has room (host).

    old: as `shifted`. Where the team has not been again the map keeps its shape.
    """
    n = int(old.n)
    Z, both = (np.concatenate([np.asarray(before)[:n], new]) for before, new in ((old.X, X), (old.Y, Y)))
    stays = gp.thinned(Z, old.hyper, old.capacity, np.ones(len(Z)), first=np.arange(len(Z)) < n)
    return gp.condition(Z[stays], both[stays], old.hyper, old.capacity)


def teach(oracle: Oracle, recorded: Recorded, training: Training | None, last: Fits) -> tuple[Oracle, Fits]:
    """The oracle frozen on the data so far: fit from the last hyperparameters, then condition (host).

    A body without data keeps its predictor. The constant part of each output's prior mean is the mean of its labels
    (the remark on mean functions); the rest is the GP's. Bodies are fitted side by side. Without `training` the
    hyperparameters and the prior mean stay as they are, as error bounds ask for.
    """
    found = {body: (X, Y) for body, (X, Y, _) in samples(oracle, recorded).items() if len(X) > 1}

    def study(body: Body) -> tuple[gp.Fit | None, gp.GP]:
        (X, Y), frozen = found[body], of_body(oracle, body)
        if training is None:
            return None, gp.condition(X, Y, frozen.hyper, frozen.capacity)
        before = last.get(body)
        fit = gp.fit(
            X,
            Y,
            belief=training.of(body),
            start=before.hyper if before else None,
            restarts=0 if before else training.restarts,
            max_iterations=training.max_iterations,
        )
        return fit, gp.condition(X, Y, fit.hyper, frozen.capacity)

    learned = side_by_side(study, found)
    fits = {**last, **{body: fit for body, (fit, _) in learned.items() if fit is not None}}
    return with_bodies(oracle, {body: model for body, (_, model) in learned.items()}), fits


def left_out(model: gp.GP, newest: int) -> float:
    """Mean of `(y - f)^2` over its predicted variance of a model's newest samples, each left out; 1 if it fits (host).

    Rasmussen and Williams 2006, Eqs. 5.11 and 5.12.
    """
    off, variance = (np.asarray(x) for x in gp.leave_one_out(model))
    n = int(model.n)
    return float((off**2 / variance)[:, max(0, n - newest) : n].mean())


def side_by_side(study: Callable[[Body], T], bodies: Collection[Body]) -> dict[Body, T]:
    """What a study of each body gives; with one BLAS thread each: at these sizes more only wait for each other."""

    def one(body: Body) -> T:
        signals.check()
        return study(body)

    with threadpool_limits(1), ThreadPoolExecutor(os.cpu_count()) as pool:
        return dict(zip(bodies, pool.map(one, bodies), strict=True))


def renew(
    oracle: Oracle, recorded: Recorded, changes: Changes = MappingProxyType({}), waiting: Collection[Body] = ()
) -> Oracle:
    """The oracle on the data so far with the hyperparameters and prior means that it has (host).

    A body whose world has changed learns from what is `amended`; while it is in `waiting` its model from before the
    change flies on, `shifted`. A body without data keeps its predictor.
    """
    models = {}
    for body, (X, Y, _) in samples(oracle, recorded, changes).items():
        frozen = of_body(oracle, body)
        if body in changes and len(X):
            moved = shifted(changes[body], X, Y)
            models[body] = moved if body in waiting else amended(moved, X, Y)
        elif body not in changes and len(X) > 1:
            models[body] = gp.condition(X, Y, frozen.hyper, frozen.capacity)
    return with_bodies(oracle, models)


def changed(oracle: Oracle, body: Body, since: float) -> Change:
    """A change of a body's world: what the oracle knows of it is what was known until then."""
    return Change(since=since, model=of_body(oracle, body), theta=oracle.theta)
