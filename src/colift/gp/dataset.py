"""Data of a fixed budget: which points of a stream to keep, and when to learn from them.

`first_come`, `first_in_first_out` and `Uniform` keep a buffer of pairs and cost O(1); `informative` keeps a GP, whose
posterior tells which point is worth keeping, and costs O(N^2).
"""

from __future__ import annotations

import dataclasses
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, Key

from colift.gp.posterior import (
    GPPosterior,
    append,
    check_point,
    check_shape,
    is_finite_point,
    leave_one_out,
    remove,
    variance,
)
from colift.math.pytree import pytree


@pytree
class Dataset:
    """Pairs kept of a stream; the first n rows are in use (Eq. dataset_*_online)."""

    X: Float[Array, "*batch capacity dimensions"]
    Y: Float[Array, "*batch capacity outputs"]
    t: Float[Array, "*batch capacity"]  # s, when each came
    n: Int[Array, "*batch"]  # rows in use
    num_seen: Int[Array, "*batch"]  # points seen so far, without those that are refused in any case


def empty_dataset(capacity: int, dimensions: int, outputs: int, batch: tuple[int, ...] = ()) -> Dataset:
    """No data yet, in a budget of `capacity` points; `batch` leads every leaf."""
    return Dataset(
        X=jnp.zeros((*batch, capacity, dimensions)),
        Y=jnp.zeros((*batch, capacity, outputs)),
        t=jnp.zeros((*batch, capacity)),
        n=jnp.zeros(batch, dtype=int),
        num_seen=jnp.zeros(batch, dtype=int),
    )


@runtime_checkable
class SelectionPolicy(Protocol):
    """What becomes of a point `(x, y)` that came at time t, s, if it is offered: the data after, and if it was kept."""

    def __call__(
        self,
        data: Dataset,
        x: Float[Array, " dimensions"],
        y: Float[Array, " outputs"],
        t: Float[Array, ""],
        offered: Bool[Array, ""],
    ) -> tuple[Dataset, Bool[Array, ""]]:
        """A point that is not finite or beyond 1e100 in size is refused. Raises ValueError for a shape of no point."""
        ...


@jax.jit
def keep_first(
    data: Dataset,
    x: Float[Array, " dimensions"],
    y: Float[Array, " outputs"],
    t: Float[Array, ""],
    offered: Bool[Array, ""],
) -> tuple[Dataset, Bool[Array, ""]]:
    """Keep the first points: full data stay as they are."""
    check_point(data.X, data.Y, x, y)
    return _put(data, x, y, t, offered, data.num_seen)


@jax.jit
def sliding_window(
    data: Dataset,
    x: Float[Array, " dimensions"],
    y: Float[Array, " outputs"],
    t: Float[Array, ""],
    offered: Bool[Array, ""],
) -> tuple[Dataset, Bool[Array, ""]]:
    """Keep the newest points: a new one takes the place of the oldest."""
    check_point(data.X, data.Y, x, y)
    return _put(data, x, y, t, offered, data.num_seen % len(data.X))


@pytree
class ReservoirSampling:
    """Keep a uniform random sample of all points so far (reservoir sampling: Vitter 1985, Algorithm R)."""

    key: Key[Array, ""]  # fixed for a stream; point k draws from `fold_in(key, k)`

    def __call__(
        self,
        data: Dataset,
        x: Float[Array, " dimensions"],
        y: Float[Array, " outputs"],
        t: Float[Array, ""],
        offered: Bool[Array, ""],
    ) -> tuple[Dataset, Bool[Array, ""]]:
        """The data after a point, and whether it was kept."""
        check_point(data.X, data.Y, x, y)
        k = data.num_seen
        drawn = jax.random.randint(jax.random.fold_in(self.key, k), (), 0, k + 1)
        return _put(data, x, y, t, offered, jnp.where(k < len(data.X), k, drawn))


def _put(data: Dataset, x: Array, y: Array, t: Array, offered: Array, slot: Array) -> tuple[Dataset, Array]:
    """Write to row `slot` when it is within capacity and the point is one that `condition` takes."""
    sound = offered & is_finite_point(x, y)
    kept = sound & (slot < len(data.X))
    slot = jnp.where(kept, slot, 0)
    put = Dataset(
        X=data.X.at[slot].set(jnp.where(kept, x, data.X[slot])),
        Y=data.Y.at[slot].set(jnp.where(kept, y, data.Y[slot])),
        t=data.t.at[slot].set(jnp.where(kept, t, data.t[slot])),
        n=jnp.minimum(data.n + kept.astype(data.n.dtype), len(data.X)),
        num_seen=data.num_seen + sound.astype(data.num_seen.dtype),
    )
    return put, kept


@jax.jit
def max_variance_subset(
    gp: GPPosterior, x: Float[Array, " dimensions"], y: Float[Array, " outputs"], gate: Float[Array, ""]
) -> tuple[GPPosterior, Bool[Array, ""]]:
    """Keep the points the posterior knows least about, and whether this one is kept.

    A point's novelty is its posterior variance over the signal variance, the largest over the outputs; that of a
    kept point is its own with itself left out. A point below `gate` (in (0, 1)) is refused; a full GP gives up its
    most redundant point, the one of least novelty, unless that is more novel than the new one. What `append`
    refuses is refused. A point below the gate costs a `variance`.
    """
    check_point(gp.X, gp.Y, x, y)
    check_shape("gate", gate, (), "a number")
    novelty = jnp.max(variance(gp, x) / gp.hyper.signal_variance)

    def refuse(gp: GPPosterior) -> tuple[GPPosterior, Array]:
        return gp, jnp.zeros((), dtype=bool)

    def exchange(gp: GPPosterior) -> tuple[GPPosterior, Array]:
        held = _novelty_held(gp)
        redundant = jnp.argmin(held)

        def put(gp: GPPosterior) -> tuple[GPPosterior, Array]:
            grown, kept = append(remove(gp, redundant)[0], x, y)
            return jax.tree.map(lambda new, old: jnp.where(kept, new, old), grown, gp), kept

        return jax.lax.cond(novelty > held[redundant], put, refuse, gp)

    def offer(gp: GPPosterior) -> tuple[GPPosterior, Array]:
        return jax.lax.cond(gp.num_points == gp.capacity, exchange, lambda gp: append(gp, x, y), gp)

    return jax.lax.cond(novelty > gate, offer, refuse, gp)


def _novelty_held(gp: GPPosterior) -> Array:
    """Of each point held, the novelty it would have if it came now; `(capacity,)`, infinite past n."""
    s, v = gp.hyper.signal_variance, gp.hyper.noise_variance
    _, left_out = leave_one_out(gp)
    held = jnp.max((left_out - v[:, None]) / s[:, None], axis=0)
    return jnp.where(jnp.arange(gp.capacity) < gp.num_points, held, jnp.inf)


@dataclasses.dataclass(frozen=True)
class ScheduledUpdate:
    """Update at stated times, none after `end` (the paper's T_end: data sets change finitely often)."""

    times: tuple[float, ...]  # s
    end: float  # s

    def due(self, since: float, context: float, gain: float) -> bool:
        """Whether a stated time lies in `(since, now]`, since being the time of the last check; s."""
        del gain
        return any(since < t <= context for t in self.times if t <= self.end)


@dataclasses.dataclass(frozen=True)
class InformationTriggeredUpdate:
    """Update when the data have gained `least` nats of information since the last update, none after `end`."""

    min_gain: float  # nats, summed over outputs
    end: float  # s

    def due(self, since: float, context: float, gain: float) -> bool:
        """Whether `gain`, the information gained since the last update (nats), is enough at time `now` (s)."""
        del since
        return context <= self.end and gain >= self.min_gain
