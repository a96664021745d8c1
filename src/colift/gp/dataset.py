"""Data sets of a fixed budget: selection of points from a stream, and update schedules.

`keep_first`, `sliding_window` and `ReservoirSampling` maintain a buffer of pairs at a cost of O(1) per point.
`max_variance_subset` maintains a posterior, whose variance ranks the points, at a cost of O(N^2) per point.
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
    """Pairs selected from a stream; the first `n` rows are in use (Eq. dataset_*_online).

    Attributes:
        X: Inputs.
        Y: Labels.
        t: Time of each pair [s].
        n: Number of rows in use.
        num_seen: Number of valid points offered so far.
    """

    X: Float[Array, "*batch capacity dimensions"]
    Y: Float[Array, "*batch capacity outputs"]
    t: Float[Array, "*batch capacity"]  # s
    n: Int[Array, "*batch"]
    num_seen: Int[Array, "*batch"]


def empty_dataset(capacity: int, dimensions: int, outputs: int, batch: tuple[int, ...] = ()) -> Dataset:
    """Return an empty data set.

    Args:
        capacity: Maximum number of points.
        dimensions: Number of inputs.
        outputs: Number of outputs.
        batch: Leading batch axes of every leaf.

    Returns:
        A data set without points.
    """
    return Dataset(
        X=jnp.zeros((*batch, capacity, dimensions)),
        Y=jnp.zeros((*batch, capacity, outputs)),
        t=jnp.zeros((*batch, capacity)),
        n=jnp.zeros(batch, dtype=int),
        num_seen=jnp.zeros(batch, dtype=int),
    )


@runtime_checkable
class SelectionPolicy(Protocol):
    """Protocol of a policy that decides whether an offered point is kept, and which point it replaces."""

    def __call__(
        self,
        data: Dataset,
        x: Float[Array, " dimensions"],
        y: Float[Array, " outputs"],
        t: Float[Array, ""],
        offered: Bool[Array, ""],
    ) -> tuple[Dataset, Bool[Array, ""]]:
        """Offer a point to the data set.

        A point that is not finite, or has an entry above 1e100 in magnitude, is rejected.

        Args:
            data: Current data set.
            x: Input.
            y: Label.
            t: Time of the point [s].
            offered: False to leave the data set unchanged.

        Returns:
            The next data set, and whether the point was kept.

        Raises:
            ValueError: If `x` or `y` does not have the shape of one point.
        """
        ...


@jax.jit
def keep_first(
    data: Dataset,
    x: Float[Array, " dimensions"],
    y: Float[Array, " outputs"],
    t: Float[Array, ""],
    offered: Bool[Array, ""],
) -> tuple[Dataset, Bool[Array, ""]]:
    """Keep the first points of a stream; a full data set does not change. See `SelectionPolicy`."""
    check_point(data.X, data.Y, x, y)
    return _write_row(data, x, y, t, offered, data.num_seen)


@jax.jit
def sliding_window(
    data: Dataset,
    x: Float[Array, " dimensions"],
    y: Float[Array, " outputs"],
    t: Float[Array, ""],
    offered: Bool[Array, ""],
) -> tuple[Dataset, Bool[Array, ""]]:
    """Keep the newest points of a stream: a new point replaces the oldest. See `SelectionPolicy`."""
    check_point(data.X, data.Y, x, y)
    return _write_row(data, x, y, t, offered, data.num_seen % len(data.X))


@pytree
class ReservoirSampling:
    """Keep a uniform random sample of all points so far (Vitter 1985, Algorithm R).

    Attributes:
        key: Random key of the stream; point k uses `fold_in(key, k)`.
    """

    key: Key[Array, ""]

    def __call__(
        self,
        data: Dataset,
        x: Float[Array, " dimensions"],
        y: Float[Array, " outputs"],
        t: Float[Array, ""],
        offered: Bool[Array, ""],
    ) -> tuple[Dataset, Bool[Array, ""]]:
        """Offer a point to the data set; see `SelectionPolicy`."""
        check_point(data.X, data.Y, x, y)
        k = data.num_seen
        drawn = jax.random.randint(jax.random.fold_in(self.key, k), (), 0, k + 1)
        return _write_row(data, x, y, t, offered, jnp.where(k < len(data.X), k, drawn))


def _write_row(data: Dataset, x: Array, y: Array, t: Array, offered: Array, slot: Array) -> tuple[Dataset, Array]:
    """Write a point to row `slot` if the row exists and the point is valid."""
    valid = offered & is_finite_point(x, y)
    kept = valid & (slot < len(data.X))
    slot = jnp.where(kept, slot, 0)
    written = Dataset(
        X=data.X.at[slot].set(jnp.where(kept, x, data.X[slot])),
        Y=data.Y.at[slot].set(jnp.where(kept, y, data.Y[slot])),
        t=data.t.at[slot].set(jnp.where(kept, t, data.t[slot])),
        n=jnp.minimum(data.n + kept.astype(data.n.dtype), len(data.X)),
        num_seen=data.num_seen + valid.astype(data.num_seen.dtype),
    )
    return written, kept


@jax.jit
def max_variance_subset(
    gp: GPPosterior, x: Float[Array, " dimensions"], y: Float[Array, " outputs"], gate: Float[Array, ""]
) -> tuple[GPPosterior, Bool[Array, ""]]:
    """Keep the points of largest posterior variance.

    The novelty of a point is the ratio of posterior variance and signal variance, maximized over the outputs. The
    novelty of a kept point is computed by leave-one-out. If the posterior is full, a point of larger novelty replaces
    the point of least novelty. A point below the gate costs one evaluation of `variance`.

    Args:
        gp: Posterior on the kept points.
        x: Input of the new point.
        y: Label of the new point.
        gate: Novelty below which a point is rejected, in (0, 1).

    Returns:
        The next posterior, and whether the point was kept. Points that `append` rejects are not kept.
    """
    check_point(gp.X, gp.Y, x, y)
    check_shape("gate", gate, (), "a number")
    novelty = jnp.max(variance(gp, x) / gp.hyper.signal_variance)

    def refuse(gp: GPPosterior) -> tuple[GPPosterior, Array]:
        return gp, jnp.zeros((), dtype=bool)

    def exchange(gp: GPPosterior) -> tuple[GPPosterior, Array]:
        novelties = _leave_one_out_novelty(gp)
        redundant = jnp.argmin(novelties)

        def put(gp: GPPosterior) -> tuple[GPPosterior, Array]:
            grown, kept = append(remove(gp, redundant)[0], x, y)
            return jax.tree.map(lambda new, old: jnp.where(kept, new, old), grown, gp), kept

        return jax.lax.cond(novelty > novelties[redundant], put, refuse, gp)

    def offer(gp: GPPosterior) -> tuple[GPPosterior, Array]:
        return jax.lax.cond(gp.num_points == gp.capacity, exchange, lambda gp: append(gp, x, y), gp)

    return jax.lax.cond(novelty > gate, offer, refuse, gp)


def _leave_one_out_novelty(gp: GPPosterior) -> Array:
    """Compute the leave-one-out novelty of each kept point, `(capacity,)`; infinite for empty rows."""
    s, v = gp.hyper.signal_variance, gp.hyper.noise_variance
    _, loo_variance = leave_one_out(gp)
    novelty = jnp.max((loo_variance - v[:, None]) / s[:, None], axis=0)
    return jnp.where(jnp.arange(gp.capacity) < gp.num_points, novelty, jnp.inf)


@dataclasses.dataclass(frozen=True)
class ScheduledUpdate:
    """Update schedule of fixed times, none of them after an end time (T_end of the paper).

    Attributes:
        times: Update times [s].
        end: Last time at which an update is allowed [s].
    """

    times: tuple[float, ...]  # s
    end: float  # s

    def due(self, last_check: float, time: float, gain: float) -> bool:
        """Return whether an update time lies in `(last_check, time]`.

        Args:
            last_check: Time of the previous check [s].
            time: Current time [s].
            gain: Not used.

        Returns:
            True if an update is due.
        """
        del gain
        return any(last_check < t <= time for t in self.times if t <= self.end)


@dataclasses.dataclass(frozen=True)
class InformationTriggeredUpdate:
    """Update schedule triggered by the information gain of new data, with an end time.

    Attributes:
        min_gain: Information gain that triggers an update, summed over outputs [nats].
        end: Last time at which an update is allowed [s].
    """

    min_gain: float  # nats, summed over outputs
    end: float  # s

    def due(self, last_check: float, time: float, gain: float) -> bool:
        """Return whether the information gain suffices for an update.

        Args:
            last_check: Not used.
            time: Current time [s].
            gain: Information gained since the last update [nats].

        Returns:
            True if an update is due.
        """
        del last_check
        return time <= self.end and gain >= self.min_gain
