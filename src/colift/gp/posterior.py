"""Posterior of independent outputs over shared inputs, with a fixed capacity so that new data cause no recompilation.

The posterior stores `W_i = L_i^-1` with `L_i L_i^T = K_i = K_f + noise_variance I` instead of L. Every query and every
`append` is then a matrix product. Rows of W from n on are those of the identity, and alpha is zero there.
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

from colift.gp.fitting import MAX_MAGNITUDE, validate_data
from colift.gp.hyperparameters import Hyperparameters, validate
from colift.gp.likelihood import (
    LOG_2PI,
    conditioning_error_message,
    gram_matrix,
    min_noise_ratio_for_append,
    single_thread_blas,
)
from colift.math.pytree import pytree

# `predict`: points per block, strips of W, and the number of blocks above which strips save time (measured).
BLOCK_SIZE, NUM_STRIPS, MIN_BLOCKS_FOR_STRIPS = 64, 8, 8


@pytree
class GPPosterior:
    """Exact posterior of independent GPs on `num_points` data points; without points it is the prior.

    Attributes:
        hyper: Hyperparameters.
        X: Inputs.
        Y: Labels.
        num_points: Number of rows in use, from the first.
        inverse_cholesky: Inverse Cholesky factors W, lower triangular.
        alpha: `K^-1 (Y - constant_mean)`.
    """

    hyper: Hyperparameters
    X: Float[Array, "*batch capacity dimensions"]
    Y: Float[Array, "*batch capacity outputs"]
    num_points: Int[Array, "*batch"]
    inverse_cholesky: Float[Array, "*batch outputs capacity capacity"]
    alpha: Float[Array, "*batch outputs capacity"]

    @property
    def capacity(self) -> int:
        """Maximum number of points."""
        return self.X.shape[-2]


def prior(hyper: Hyperparameters, capacity: int) -> GPPosterior:
    """Create a posterior without data, with mean `constant_mean` and variance `signal_variance`.

    A ValueError is raised if `validate` rejects the hyperparameters at this capacity.

    Args:
        hyper: Hyperparameters.
        capacity: Maximum number of points.

    Returns:
        Posterior with the shapes of a conditioned one.
    """
    validate(hyper, capacity)
    m, D = hyper.lengthscales.shape
    return GPPosterior(
        hyper=hyper,
        X=jax.device_put(np.zeros((capacity, D))),
        Y=jax.device_put(np.zeros((capacity, m))),
        num_points=jax.device_put(np.zeros((), dtype=int)),
        inverse_cholesky=jax.device_put(np.tile(np.eye(capacity), (m, 1, 1))),
        alpha=jax.device_put(np.zeros((m, capacity))),
    )


def condition(
    X: ArrayLike,
    Y: ArrayLike,
    hyper: Hyperparameters,
    capacity: int | None = None,
    noise_covariance: ArrayLike | None = None,
) -> GPPosterior:
    """Condition a GP on data (host, O(N^3)).

    Args:
        X: Inputs, `(N, dimensions)`.
        Y: Labels, `(N, outputs)`.
        hyper: Hyperparameters.
        capacity: Maximum number of points; default: N.
        noise_covariance: Covariance of correlated noise, `(outputs, N, N)`, in addition to `noise_variance`.

    Returns:
        Posterior.

    Raises:
        ValueError: If data or hyperparameters are not admissible (see `validate_data`, `validate`), shapes disagree
            with `hyper`, or there are more points than `capacity`.
    """
    X, Y = validate_data(X, Y)
    N, (m, D) = len(X), hyper.lengthscales.shape
    capacity = N if capacity is None else capacity
    validate(hyper, capacity)
    if (X.shape[1], Y.shape[1]) != (D, m):
        raise ValueError(f"X {X.shape} and Y {Y.shape}: hyper has {D} dimensions and {m} outputs")
    if capacity < N:
        raise ValueError(f"{N} data points: capacity is {capacity}")
    W, offset = inverse_factors(X, hyper, capacity, noise_covariance), np.asarray(hyper.constant_mean)
    alpha = np.zeros((m, capacity))
    with single_thread_blas(N):
        for i in range(m):
            with np.errstate(over="ignore", invalid="ignore"):
                W_i = np.asfortranarray(W[i, :N, :N])  # as LAPACK returns it: rounding depends on the layout
                w = W_i @ (Y[:, i] - offset[i])
                alpha[i, :N] = W_i.T @ w
                finite = np.isfinite(w @ w) and np.isfinite(alpha[i]).all()
            if not finite:
                raise ValueError(
                    f"output {i}: Y of magnitude {np.abs(Y[:, i]).max():.3g} and constant_mean = {offset[i]:.3g} "
                    f"exceed the range of float64 for noise_variance = {float(hyper.noise_variance[i]):.3g}"
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


def inverse_factors(
    X: np.ndarray,
    hyper: Hyperparameters,
    capacity: int,
    noise_covariance: ArrayLike | None = None,
    outputs: int | None = None,
) -> np.ndarray:
    """Compute the inverse Cholesky factors of a posterior (host, O(N^3)).

    Args:
        X: Inputs, `(N, dimensions)`.
        hyper: Hyperparameters.
        capacity: Maximum number of points.
        noise_covariance: Covariance of correlated noise, `(outputs, N, N)`, in addition to `noise_variance`.
        outputs: Number of outputs, from the first; None: all.

    Returns:
        `(outputs, capacity, capacity)`; rows without a point are those of the identity.

    Raises:
        ValueError: If a Gram matrix is not positive definite to working precision.
    """
    N = len(X)
    s, ls, v = (np.asarray(a)[:outputs] for a in (hyper.signal_variance, hyper.lengthscales, hyper.noise_variance))
    W = np.tile(np.eye(capacity), (len(s), 1, 1))
    with single_thread_blas(N):
        for i in range(len(s) if N else 0):
            K = gram_matrix(X, s[i], ls[i], v[i], hyper.kernel)
            if noise_covariance is not None:
                K += np.asarray(noise_covariance)[i]
            L, info = dpotrf(K.T, lower=1, overwrite_a=1)
            if info:
                raise ValueError(f"output {i}: " + conditioning_error_message(N, s[i], v[i]))
            W[i, :N, :N], _ = dtrtri(L, lower=1, overwrite_c=1)
    return W


def from_expansion(
    hyper: Hyperparameters, centers: ArrayLike, weights: ArrayLike, capacity: int | None = None
) -> GPPosterior:
    """Create a posterior whose mean is `f_i = constant_mean_i + sum_k weights_ik k_i(centers_k, .)`.

    It is the mean on the data `K weights`, which it fits at the centers up to `noise_variance weights`.

    Args:
        hyper: Hyperparameters.
        centers: `(N, dimensions)` [unit of x].
        weights: Kernel weights, `(outputs, N)`.
        capacity: Maximum number of points; default: N.

    Returns:
        Posterior with this mean.

    Raises:
        ValueError: If the weights are not finite or of another shape.
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
    """Compute the RKHS norm of `mu_i - constant_mean_i`, `sqrt(alpha^T K_f alpha)`.

    Args:
        gp: Posterior.

    Returns:
        Norm of each output, without unit.
    """
    K = jax.vmap(lambda x: _kernel(gp, x))(gp.X)
    square = jnp.einsum("ij,jik,ik->i", gp.alpha, K, gp.alpha)
    return jnp.sqrt(jnp.maximum(square, 0.0))


def _kernel(gp: GPPosterior, x: Float[Array, " dimensions"]) -> Float[Array, "outputs capacity"]:
    """Compute `k_i(x, X)` for every output and row, including empty rows."""
    difference = gp.X - x[None, :]
    r2 = (1 / gp.hyper.lengthscales**2) @ (difference * difference).T
    return gp.hyper.signal_variance[:, None] * gp.hyper.kernel(r2)


def _row_mask(gp: GPPosterior) -> Bool[Array, "1 capacity"]:
    """Return which rows are in use."""
    return (jnp.arange(gp.capacity) < gp.num_points)[None, :]


def _masked_kernel(gp: GPPosterior, x: Float[Array, " dimensions"]) -> Float[Array, "outputs capacity"]:
    """Compute `k_i(x, X)`, zero for empty rows."""
    return jnp.where(_row_mask(gp), _kernel(gp, x), 0.0)


def _residual(gp: GPPosterior) -> Float[Array, "outputs capacity"]:
    """Compute `Y - constant_mean`, zero for empty rows."""
    return jnp.where(_row_mask(gp), (gp.Y - gp.hyper.constant_mean[None, :]).T, 0.0)


def check_shape(name: str, value: Array, shape: tuple[int | str, ...], description: str) -> None:
    """Check shape and type of an argument while tracing, at no cost in a loop.

    Args:
        name: Name of the argument.
        value: Argument.
        shape: Required shape.
        description: Explanation of the shape for the message.

    Raises:
        ValueError: If the argument has another shape or is not real.
    """
    found = getattr(value, "shape", None)
    if found != shape:
        has = f"is a {type(value).__name__}" if found is None else f"has shape {found}"
        raise ValueError(
            f"{name} {has}: must be an array of shape {shape}, {description}; use jax.vmap for more than one"
        )
    if not (jnp.issubdtype(value.dtype, jnp.floating) or jnp.issubdtype(value.dtype, jnp.integer)):
        raise ValueError(f"{name} has type {value.dtype}: must be real numbers")


def check_point(X: Array, Y: Array, x: Array, y: Array | None = None) -> None:
    """Check that x and y form one point of a single posterior or data set.

    Args:
        X: Inputs of the data.
        Y: Labels of the data.
        x: Input of the point.
        y: Label of the point.

    Raises:
        ValueError: If the data have batch axes, or a shape is not that of one point.
    """
    if X.ndim != 2:
        raise ValueError(f"the data have batch axes {X.shape[:-2]}: use jax.vmap over stacked models")
    check_shape("x", x, X.shape[1:], "one number per dimension")
    if y is not None:
        check_shape("y", y, Y.shape[1:], "one number per output")


def is_finite_point(x: Array, y: Array) -> Bool[Array, ""]:
    """Return whether a point is finite and at most 1e100 in magnitude, as required by `condition`.

    Args:
        x: Input.
        y: Label.

    Returns:
        True for an admissible point.
    """
    return (jnp.abs(x) <= MAX_MAGNITUDE).all() & (jnp.abs(y) <= MAX_MAGNITUDE).all()


@jax.jit
def mean(gp: GPPosterior, x: Float[Array, " dimensions"]) -> Float[Array, " outputs"]:
    """Compute the posterior mean `mu_i(x) = constant_mean_i + k_i(x, X) alpha_i` (paper, learning section).

    Use `jax.vmap` over x or stacked posteriors. All functions of this module that take a point raise a ValueError for
    another shape.

    Args:
        gp: Posterior.
        x: Input.

    Returns:
        Mean of each output [unit of y].
    """
    check_point(gp.X, gp.Y, x)
    return gp.hyper.constant_mean + jnp.sum(_kernel(gp, x) * gp.alpha, axis=-1)


@jax.jit
def variance(gp: GPPosterior, x: Float[Array, " dimensions"]) -> Float[Array, " outputs"]:
    """Compute the posterior variance of the function without noise, `signal_variance_i - |W_i k_i(X, x)|^2`.

    The exact value is not negative, so negative rounded values are set to zero.

    Args:
        gp: Posterior.
        x: Input.

    Returns:
        Variance of each output [unit of y squared].
    """
    check_point(gp.X, gp.Y, x)
    v = jnp.einsum("ijk,ik->ij", gp.inverse_cholesky, _masked_kernel(gp, x))
    return jnp.maximum(gp.hyper.signal_variance - jnp.sum(v * v, axis=-1), 0.0)


@jax.jit
def predict(
    gp: GPPosterior, x: Float[Array, "points dimensions"]
) -> tuple[Float[Array, "points outputs"], Float[Array, "points outputs"]]:
    """Compute `mean` and `variance` at many points with one evaluation of the kernel.

    Points are processed in blocks, whose kernel values fit into the processor's cache. For many blocks, W is split into
    strips of rows without the zeros to their right.

    Args:
        gp: Posterior.
        x: Inputs.

    Returns:
        Mean [unit of y] and variance [unit of y squared] at each point.

    Raises:
        ValueError: If the posterior has batch axes.
    """
    if gp.X.ndim != 2:
        raise ValueError(f"gp has batch axes {gp.X.shape[:-2]}: use jax.vmap over stacked GPs")
    points = x.shape[0] if getattr(x, "ndim", 0) == 2 else "points"
    check_shape("x", x, (points, gp.X.shape[1]), "one row per point")
    parts = NUM_STRIPS if len(x) > MIN_BLOCKS_FOR_STRIPS * BLOCK_SIZE else 1
    edges = sorted({gp.capacity * i // parts for i in range(parts + 1)})
    # the barrier prevents a copy per block
    strips = jax.lax.optimization_barrier([gp.inverse_cholesky[:, a:b, :b] for a, b in itertools.pairwise(edges)])
    h = gp.hyper

    def block(x: Float[Array, "block dimensions"]) -> tuple[Array, Array]:
        k = jax.vmap(lambda x: _masked_kernel(gp, x), out_axes=2)(x)
        mu = jnp.einsum("ik,ikp->pi", gp.alpha, k)
        v = [jnp.einsum("ijk,ikp->ijp", W, k[:, : W.shape[2]]) for W in strips]
        explained = sum((jnp.sum(u * u, axis=1) for u in v), jnp.zeros(mu.shape[::-1]))
        return h.constant_mean[None] + mu, jnp.maximum(h.signal_variance[None] - explained.T, 0.0)

    if len(x) <= BLOCK_SIZE:
        return block(x)
    blocks = -(-len(x) // BLOCK_SIZE)
    size = -(-len(x) // blocks)
    padded = jnp.pad(x, ((0, blocks * size - len(x)), (0, 0)))
    mu, sigma2 = jax.lax.map(block, padded.reshape(blocks, size, x.shape[1]))
    return mu.reshape(blocks * size, -1)[: len(x)], sigma2.reshape(blocks * size, -1)[: len(x)]


@jax.jit
def append(
    gp: GPPosterior, x: Float[Array, " dimensions"], y: Float[Array, " outputs"]
) -> tuple[GPPosterior, Bool[Array, ""]]:
    """Add one point to the posterior in O(N^2).

    With `c = W k(X, x)` and `lam^2 = k(x, x) + noise_variance - |c|^2`, W gains the row `w = [-c^T W, 1] / lam`, and
    alpha gains `w (w . (Y - constant_mean))`. From about N = 1000 on, most of the time is the copy of W. A compiled
    loop updates in place, as does `jax.jit(append, donate_argnums=0)`, which deletes the arrays of gp including
    `hyper`.

    A point is rejected if

    - the posterior is full;
    - the point, or the resulting alpha, is not finite or above 1e100 in magnitude;
    - the noise variance is below `min_noise_ratio_for_append`;
    - rounding reduces a lam^2 below half of the noise variance (its exact lower bound). `condition` accepts such
      points.

    Args:
        gp: Posterior.
        x: Input.
        y: Label.

    Returns:
        The next posterior, and whether the point was accepted. A rejected point leaves the posterior unchanged.
    """
    check_point(gp.X, gp.Y, x, y)
    valid = (gp.num_points < gp.capacity) & is_finite_point(x, y)
    x, y = jnp.where(valid, x, 0.0), jnp.where(valid, y, 0.0)
    i = jnp.minimum(gp.num_points, gp.capacity - 1)
    h = gp.hyper
    c = jnp.einsum("ijk,ik->ij", gp.inverse_cholesky, _masked_kernel(gp, x))
    lam2 = h.signal_variance + h.noise_variance - jnp.sum(c * c, axis=-1)
    lam = jnp.sqrt(jnp.maximum(lam2, h.noise_variance))
    w = (-jnp.einsum("ijk,ij->ik", gp.inverse_cholesky, c)).at[:, i].set(1.0) / lam[:, None]
    Y = gp.Y.at[i].set(jnp.where(valid, y, gp.Y[i]))
    gain = jnp.sum(w * (Y - h.constant_mean[None, :]).T, axis=-1)
    alpha = gp.alpha + w * gain[:, None]
    finite = jnp.isfinite(gain * gain).all() & jnp.isfinite(alpha).all()
    growing = h.noise_variance >= min_noise_ratio_for_append(gp.capacity) * h.signal_variance
    accepted = valid & finite & (growing & (lam2 >= 0.5 * h.noise_variance)).all()
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
    """Remove point i from the posterior in O(N^2); later points move up one row.

    Row `a = W_i` is rotated with each later row, `(a, W_k) <- (p a + q W_k, p W_k - q a) / r` with
    `p = a_i, q = W_ki, r^2 = p^2 + q^2`. This clears column i in all rows except a, which is then dropped. Rotations
    preserve `W^T W = K^-1`, so the remaining rows are the inverse factor of K without row and column i.

    Args:
        gp: Posterior.
        i: Row of the point.

    Returns:
        The next posterior, and whether a point was removed. An index without a point leaves the posterior unchanged.
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
    """Compute the log marginal likelihood `-1/2 r^T K^-1 r - 1/2 log|K| - n/2 log 2 pi` with `r = Y - constant_mean`.

    Args:
        gp: Posterior.

    Returns:
        Log likelihood of each output [nats].
    """
    r = _residual(gp)
    return (
        -0.5 * jnp.sum(r * gp.alpha, axis=-1)
        + _log_det_inverse_factor(gp)
        - 0.5 * gp.num_points.astype(r.dtype) * LOG_2PI
    )


@jax.jit
def information_gain(gp: GPPosterior) -> Float[Array, " outputs"]:
    """Compute the information gain of the data, `I(y; f) = 1/2 log|I + K_f / noise_variance|`.

    Args:
        gp: Posterior.

    Returns:
        Information gain of each output [nats].
    """
    return -_log_det_inverse_factor(gp) - 0.5 * gp.num_points.astype(gp.inverse_cholesky.dtype) * jnp.log(
        gp.hyper.noise_variance
    )


def _log_det_inverse_factor(gp: GPPosterior) -> Float[Array, " outputs"]:
    """Compute `-1/2 log|K|`; the identity rows do not contribute."""
    return jnp.sum(jnp.log(jnp.diagonal(gp.inverse_cholesky, axis1=1, axis2=2)), axis=-1)


@jax.jit
def leave_one_out(gp: GPPosterior) -> tuple[Float[Array, "outputs capacity"], Float[Array, "outputs capacity"]]:
    """Compute leave-one-out errors `y_k - mu_{-k}(x_k) = alpha_k / P_kk` and variances `1 / P_kk`, with `P = K^-1`.

    Rasmussen and Williams 2006, Eqs. 5.11 and 5.12. The variances include the noise.

    Args:
        gp: Posterior.

    Returns:
        Errors [unit of y] and variances [unit of y squared]; empty rows hold 0 and the prior variance of a label.
    """
    P = jnp.sum(gp.inverse_cholesky * gp.inverse_cholesky, axis=1)
    empty = (gp.hyper.signal_variance + gp.hyper.noise_variance)[:, None]
    return gp.alpha / P, jnp.where(_row_mask(gp), 1 / P, empty)
