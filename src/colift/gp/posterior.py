"""The posterior of independent outputs over shared inputs, at a fixed capacity so that data never recompile.

`W_i = L_i^-1` with `L_i L_i^T = K_i = K_f + noise_variance I` is stored rather than L: every query, and every
`append`, is then a product. Rows of W at and past n are those of the identity, and alpha is zero there.
"""

from __future__ import annotations

import dataclasses
import itertools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int
from numpy.typing import ArrayLike
from scipy.linalg.lapack import dpotrf, dtrtri

from colift.gp.fitting import LARGEST, validate_data
from colift.gp.hyperparameters import Hyperparameters, validate
from colift.gp.likelihood import (
    LOG_2PI,
    conditioning_error_message,
    gram_matrix,
    min_noise_ratio_for_append,
    single_thread_blas,
)
from colift.math.pytree import pytree

# Of `predict`: most points in a block, strips of W, and the blocks from which strips repay their copying; measured.
BLOCK, STRIPS, MANY = 64, 8, 8


@pytree
class GPPosterior:
    """Exact posterior of `outputs` GPs on n data points; on none, the prior."""

    hyper: Hyperparameters
    X: Float[Array, "*batch capacity dimensions"]
    Y: Float[Array, "*batch capacity outputs"]
    num_points: Int[Array, "*batch"]  # points in use, the first n rows
    inverse_cholesky: Float[Array, "*batch outputs capacity capacity"]  # inverse Cholesky factors, lower triangular
    alpha: Float[Array, "*batch outputs capacity"]  # K^-1 (Y - offset)

    @property
    def capacity(self) -> int:
        """Points it can hold."""
        return self.X.shape[-2]


def prior(hyper: Hyperparameters, capacity: int) -> GPPosterior:
    """The posterior on no data: mean `offset`, variance `signal_variance`; the shapes of a conditioned one.

    Raises ValueError where `hyper` is not what `check` allows at this capacity.
    """
    validate(hyper, capacity)
    m, D = hyper.lengthscales.shape
    return GPPosterior(
        hyper=hyper,
        X=jnp.zeros((capacity, D)),
        Y=jnp.zeros((capacity, m)),
        num_points=jnp.zeros((), dtype=int),
        inverse_cholesky=jnp.asarray(np.tile(np.eye(capacity), (m, 1, 1))),
        alpha=jnp.zeros((m, capacity)),
    )


def condition(X: ArrayLike, Y: ArrayLike, hyper: Hyperparameters, capacity: int | None = None) -> GPPosterior:
    """The posterior on data X `(N, dimensions)`, Y `(N, outputs)` (host, O(N^3)).

    Raises ValueError for data that are not finite or beyond 1e100 in size, shapes that disagree with `hyper`, more
    points than `capacity`, or `hyper` that `check` does not allow at this capacity.
    """
    X, Y = validate_data(X, Y)
    N, (m, D) = len(X), hyper.lengthscales.shape
    capacity = N if capacity is None else capacity
    validate(hyper, capacity)
    if (X.shape[1], Y.shape[1]) != (D, m):
        raise ValueError(f"X {X.shape} and Y {Y.shape}: hyper has {D} dimensions and {m} outputs")
    if capacity < N:
        raise ValueError(f"{N} data points: capacity is {capacity}")
    s, ls, v, offset = (
        np.asarray(a) for a in (hyper.signal_variance, hyper.lengthscales, hyper.noise_variance, hyper.constant_mean)
    )
    W = np.tile(np.eye(capacity), (m, 1, 1))
    alpha = np.zeros((m, capacity))
    with single_thread_blas(N):
        for i in range(m):
            L, info = dpotrf(gram_matrix(X, s[i], ls[i], v[i], hyper.kernel).T, lower=1, overwrite_a=1)
            if info:
                raise ValueError(f"output {i}: " + conditioning_error_message(N, s[i], v[i]))
            W_i, _ = dtrtri(L, lower=1, overwrite_c=1)
            W[i, :N, :N] = W_i
            with np.errstate(over="ignore", invalid="ignore"):
                w = W_i @ (Y[:, i] - offset[i])
                alpha[i, :N] = W_i.T @ w
                finite = np.isfinite(w @ w) and np.isfinite(alpha[i]).all()
            if not finite:
                raise ValueError(
                    f"output {i}: Y of size {np.abs(Y[:, i]).max():.3g} and offset = {offset[i]:.3g} are beyond "
                    f"float64 beside noise_variance = {v[i]:.3g}"
                )
    pad = ((0, capacity - N), (0, 0))
    return GPPosterior(
        hyper=hyper,
        X=jnp.asarray(np.pad(X, pad)),
        Y=jnp.asarray(np.pad(Y, pad)),
        num_points=jnp.asarray(N, dtype=int),
        inverse_cholesky=jnp.asarray(W),
        alpha=jnp.asarray(alpha),
    )


def from_expansion(
    hyper: Hyperparameters, centers: ArrayLike, weights: ArrayLike, capacity: int | None = None
) -> GPPosterior:
    """The function `f_i = offset_i + sum_k weights_ik k_i(centers_k, .)` as a posterior mean: `mean` evaluates it.

    It is the mean on data `K weights`, which it passes at the centres up to `noise_variance weights`.
    Raises ValueError for what `condition` does not allow, or weights that are not `(outputs, centers)`.
    """
    X, weights = np.asarray(centers, dtype=float), np.asarray(weights, dtype=float)
    if X.ndim != 2 or weights.shape != (len(hyper.signal_variance), len(X)) or not np.isfinite(weights).all():
        raise ValueError(f"weights {weights.shape}: must be finite, ({len(hyper.signal_variance)}, {len(X)})")
    s, ls, v, offset = (
        np.asarray(a) for a in (hyper.signal_variance, hyper.lengthscales, hyper.noise_variance, hyper.constant_mean)
    )
    K = [gram_matrix(X, s[i], ls[i], v[i], hyper.kernel) for i in range(len(s))]
    Y = np.stack([(offset[i] + K[i] @ weights[i]) for i in range(len(s))], axis=1)
    model = condition(X, Y, hyper, capacity)
    return dataclasses.replace(model, alpha=jnp.asarray(np.pad(weights, ((0, 0), (0, model.capacity - len(X))))))


@jax.jit
def rkhs_norm(gp: GPPosterior) -> Float[Array, " outputs"]:
    """Norm of `mu_i - offset_i` in the RKHS of its kernel, `sqrt(alpha^T K_f alpha)`; no unit."""
    K = jax.vmap(lambda x: _kernel(gp, x))(gp.X)
    square = jnp.einsum("ij,jik,ik->i", gp.alpha, K, gp.alpha)
    return jnp.sqrt(jnp.maximum(square, 0.0))


def _kernel(gp: GPPosterior, x: Float[Array, " dimensions"]) -> Float[Array, "outputs capacity"]:
    """`k_i(x, X)` for every output and row, rows past n included."""
    difference = gp.X - x[None, :]
    r2 = (1 / gp.hyper.lengthscales**2) @ (difference * difference).T
    return gp.hyper.signal_variance[:, None] * gp.hyper.kernel(r2)


def _in_use(gp: GPPosterior) -> Bool[Array, "1 capacity"]:
    return (jnp.arange(gp.capacity) < gp.num_points)[None, :]


def _kernel_in_use(gp: GPPosterior, x: Float[Array, " dimensions"]) -> Float[Array, "outputs capacity"]:
    return jnp.where(_in_use(gp), _kernel(gp, x), 0.0)


def _residual(gp: GPPosterior) -> Float[Array, "outputs capacity"]:
    """`Y - offset`, zero past n."""
    return jnp.where(_in_use(gp), (gp.Y - gp.hyper.constant_mean[None, :]).T, 0.0)


def check_shape(name: str, value: Array, shape: tuple[int | str, ...], meaning: str) -> None:
    """Raise ValueError where an argument is of another shape or not real; while tracing, so at no cost in a loop."""
    found = getattr(value, "shape", None)
    if found != shape:
        has = f"is a {type(value).__name__}" if found is None else f"has shape {found}"
        raise ValueError(f"{name} {has}: must be an array of shape {shape}, {meaning}; use jax.vmap for more than one")
    if not (jnp.issubdtype(value.dtype, jnp.floating) or jnp.issubdtype(value.dtype, jnp.integer)):
        raise ValueError(f"{name} has type {value.dtype}: must be real numbers")


def check_point(X: Array, Y: Array, x: Array, y: Array | None = None) -> None:
    """Raise ValueError where x, y are no point for inputs X and outputs Y, or X and Y those of more than one model."""
    if X.ndim != 2:
        raise ValueError(f"the data have batch axes {X.shape[:-2]}: use jax.vmap over stacked models")
    check_shape("x", x, X.shape[1:], "a number a dimension")
    if y is not None:
        check_shape("y", y, Y.shape[1:], "a number an output")


def is_finite_point(x: Array, y: Array) -> Bool[Array, ""]:
    """Whether a point is finite and within 1e100 in size, as `condition` demands."""
    return (jnp.abs(x) <= LARGEST).all() & (jnp.abs(y) <= LARGEST).all()


@jax.jit
def mean(gp: GPPosterior, x: Float[Array, " dimensions"]) -> Float[Array, " outputs"]:
    """`mu_i(x) = offset_i + k_i(x, X) alpha_i` (paper, learning section); unit of y. Vmap over x or stacked GPs.

    Raises ValueError, as all here that take a point do, for a shape that is not one point's.
    """
    check_point(gp.X, gp.Y, x)
    return gp.hyper.constant_mean + jnp.sum(_kernel(gp, x) * gp.alpha, axis=-1)


@jax.jit
def variance(gp: GPPosterior, x: Float[Array, " dimensions"]) -> Float[Array, " outputs"]:
    """`sigma_i^2(x) = signal_variance_i - |W_i k_i(X, x)|^2`, of the function, without noise; (unit of y)^2.

    Exact arithmetic gives at least zero, so a rounded value below it is set to zero.
    """
    check_point(gp.X, gp.Y, x)
    v = jnp.einsum("ijk,ik->ij", gp.inverse_cholesky, _kernel_in_use(gp, x))
    return jnp.maximum(gp.hyper.signal_variance - jnp.sum(v * v, axis=-1), 0.0)


@jax.jit
def predict(
    gp: GPPosterior, x: Float[Array, "points dimensions"]
) -> tuple[Float[Array, "points outputs"], Float[Array, "points outputs"]]:
    """`mean` and `variance` at many points at once, from one evaluation of the kernel.

    Points go through in blocks, whose kernel values stay in the processor's cache; for many of them W goes in strips
    of rows, each without the zeros right of it.
    """
    if gp.X.ndim != 2:
        raise ValueError(f"gp has batch axes {gp.X.shape[:-2]}: use jax.vmap over stacked GPs")
    points = x.shape[0] if getattr(x, "ndim", 0) == 2 else "points"
    check_shape("x", x, (points, gp.X.shape[1]), "a row a point")
    parts = STRIPS if len(x) > MANY * BLOCK else 1
    edges = sorted({gp.capacity * i // parts for i in range(parts + 1)})
    strips = jax.lax.optimization_barrier(
        [gp.inverse_cholesky[:, a:b, :b] for a, b in itertools.pairwise(edges)]
    )  # once, not a block
    h = gp.hyper

    def block(x: Float[Array, "block dimensions"]) -> tuple[Array, Array]:
        k = jax.vmap(lambda x: _kernel_in_use(gp, x), out_axes=2)(x)
        mu = jnp.einsum("ik,ikp->pi", gp.alpha, k)
        v = [jnp.einsum("ijk,ikp->ijp", W, k[:, : W.shape[2]]) for W in strips]
        explained = sum((jnp.sum(u * u, axis=1) for u in v), jnp.zeros(mu.shape[::-1]))
        return h.constant_mean[None] + mu, jnp.maximum(h.signal_variance[None] - explained.T, 0.0)

    if len(x) <= BLOCK:
        return block(x)
    blocks = -(-len(x) // BLOCK)
    size = -(-len(x) // blocks)
    padded = jnp.pad(x, ((0, blocks * size - len(x)), (0, 0)))
    mu, sigma2 = jax.lax.map(block, padded.reshape(blocks, size, x.shape[1]))
    return mu.reshape(blocks * size, -1)[: len(x)], sigma2.reshape(blocks * size, -1)[: len(x)]


@jax.jit
def append(
    gp: GPPosterior, x: Float[Array, " dimensions"], y: Float[Array, " outputs"]
) -> tuple[GPPosterior, Bool[Array, ""]]:
    """The posterior with one more point, in O(N^2), and whether it was accepted.

    With `c = W k(X, x)` and `lam^2 = k(x, x) + noise_variance - |c|^2`, W gains the row
    `w = [-c^T W, 1] / lam`, and alpha gains `w (w . (Y - offset))`.

    The result holds a copy of W, most of the time from N = 1000 on. A compiled loop writes in place, and so does
    `jax.jit(append, donate_argnums=0)`, which deletes the arrays of gp, `hyper` among them.
    The GP is returned as it was, with False, when it is full, the point is not finite or beyond 1e100 in size, alpha
    would be, the noise is below `least_noise_to_grow`, or rounding has eaten more than half of the noise variance in a
    lam^2 (exact arithmetic gives lam^2 >= noise_variance): there W would lose its meaning; `condition` goes further.
    """
    check_point(gp.X, gp.Y, x, y)
    sound = (gp.num_points < gp.capacity) & is_finite_point(x, y)
    x, y = jnp.where(sound, x, 0.0), jnp.where(sound, y, 0.0)
    i = jnp.minimum(gp.num_points, gp.capacity - 1)
    h = gp.hyper
    c = jnp.einsum("ijk,ik->ij", gp.inverse_cholesky, _kernel_in_use(gp, x))
    lam2 = h.signal_variance + h.noise_variance - jnp.sum(c * c, axis=-1)
    lam = jnp.sqrt(jnp.maximum(lam2, h.noise_variance))
    w = (-jnp.einsum("ijk,ij->ik", gp.inverse_cholesky, c)).at[:, i].set(1.0) / lam[:, None]
    Y = gp.Y.at[i].set(jnp.where(sound, y, gp.Y[i]))
    gain = jnp.sum(w * (Y - h.constant_mean[None, :]).T, axis=-1)
    alpha = gp.alpha + w * gain[:, None]
    finite = jnp.isfinite(gain * gain).all() & jnp.isfinite(alpha).all()
    growing = h.noise_variance >= min_noise_ratio_for_append(gp.capacity) * h.signal_variance
    accepted = sound & finite & (growing & (lam2 >= 0.5 * h.noise_variance)).all()
    grown = GPPosterior(
        hyper=h,
        X=gp.X.at[i].set(jnp.where(accepted, x, gp.X[i])),
        Y=gp.Y.at[i].set(jnp.where(accepted, y, gp.Y[i])),
        num_points=gp.num_points + accepted.astype(gp.num_points.dtype),
        inverse_cholesky=gp.inverse_cholesky.at[:, i].set(jnp.where(accepted, w, gp.inverse_cholesky[:, i])),
        alpha=jnp.where(accepted, alpha, gp.alpha),
    )
    return grown, accepted


@jax.jit
def remove(gp: GPPosterior, i: Int[Array, ""]) -> tuple[GPPosterior, Bool[Array, ""]]:
    """The posterior without point i (later points move up one row), in O(N^2), and whether there was one to remove.

    Row `a = W_i` is rotated with each later row in turn, `(a, W_k) <- (p a + q W_k, p W_k - q a) / r` with
    `p = a_i, q = W_ki, r^2 = p^2 + q^2`, which clears column i in all rows but a; a is then dropped. Rotations
    keep `W^T W = K^-1`, so what is left is the inverse factor of K without row and column i.
    An index without a point returns the GP as it was, with False.
    """
    check_shape("i", i, (), "a row")
    rows = jnp.arange(gp.capacity)
    accepted = (i >= 0) & (i < gp.num_points)
    i = jnp.where(accepted, i, 0)

    def drop(A: Float[Array, "*rest capacity"]) -> Float[Array, "*rest capacity"]:
        moved = jnp.concatenate([A[..., 1:], jnp.zeros_like(A[..., :1])], axis=-1)
        return jnp.where(accepted & (rows >= i), moved, A)

    def rotate(a: Array, row: tuple[Array, Array]) -> tuple[Array, Array]:
        k, w = row
        p, q = jnp.take(a, i, axis=1)[:, None], jnp.take(w, i, axis=1)[:, None]
        active = accepted & (k > i) & (k < gp.num_points)
        r = jnp.where(active, jnp.sqrt(p * p + q * q), 1.0)
        return jnp.where(active, (p * a + q * w) / r, a), drop((p * w - q * a) / r)

    _, rotated = jax.lax.scan(
        rotate, jnp.take(gp.inverse_cholesky, i, axis=1), (rows, jnp.swapaxes(gp.inverse_cholesky, 0, 1))
    )
    moved = accepted & (rows >= i) & (rows < gp.num_points - 1)
    W = jnp.where(moved[None, :, None], jnp.roll(jnp.swapaxes(rotated, 0, 1), -1, axis=1), gp.inverse_cholesky)
    emptied = accepted & (rows == gp.num_points - 1)
    W = jnp.where(emptied[None, :, None], jnp.eye(gp.capacity)[None], W)
    shrunk = dataclasses.replace(
        gp,
        num_points=gp.num_points - accepted.astype(gp.num_points.dtype),
        X=drop(gp.X.T).T,
        Y=drop(gp.Y.T).T,
        inverse_cholesky=W,
        alpha=drop(gp.alpha),
    )
    r = _residual(shrunk)
    alpha = jnp.einsum("ijk,ij->ik", W, jnp.einsum("ijk,ik->ij", W, r))
    return dataclasses.replace(shrunk, alpha=jnp.where(accepted, alpha, gp.alpha)), accepted


@jax.jit
def log_likelihood(gp: GPPosterior) -> Float[Array, " outputs"]:
    """`-1/2 r^T K^-1 r - 1/2 log|K| - n/2 log 2 pi`, `r = Y - offset`, of each output; nats."""
    r = _residual(gp)
    return -0.5 * jnp.sum(r * gp.alpha, axis=-1) + _log_pivots(gp) - 0.5 * gp.num_points.astype(r.dtype) * LOG_2PI


@jax.jit
def information_gain(gp: GPPosterior) -> Float[Array, " outputs"]:
    """`I(y; f) = 1/2 log|I + K_f / noise_variance|` of the data it holds, for each output; nats."""
    return -_log_pivots(gp) - 0.5 * gp.num_points.astype(gp.inverse_cholesky.dtype) * jnp.log(gp.hyper.noise_variance)


def _log_pivots(gp: GPPosterior) -> Float[Array, " outputs"]:
    """`-1/2 log|K|`; the identity rows past n add nothing."""
    return jnp.sum(jnp.log(jnp.diagonal(gp.inverse_cholesky, axis1=1, axis2=2)), axis=-1)


@jax.jit
def leave_one_out(gp: GPPosterior) -> tuple[Float[Array, "outputs capacity"], Float[Array, "outputs capacity"]]:
    """`y_k - mu_{-k}(x_k) = alpha_k / P_kk` and its predicted variance `1 / P_kk` (noise included), `P = K^-1`.

    Rasmussen and Williams 2006, Eqs. 5.11 and 5.12; rows past n hold 0 and the prior's variance.
    """
    P = jnp.sum(gp.inverse_cholesky * gp.inverse_cholesky, axis=1)
    empty = (gp.hyper.signal_variance + gp.hyper.noise_variance)[:, None]
    return gp.alpha / P, jnp.where(_in_use(gp), 1 / P, empty)
