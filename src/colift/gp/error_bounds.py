"""How far the posterior mean may be from the function: `|f_i(x) - mu_i(x)| <= beta_i sigma_i(x)` for every x.

Each bound says in `ASSUMES` what it needs; `unmet` tells a scenario which of that it does not meet, and a result
that rests on something unmet is assumed, not certified. `docs/bounds.md` has statements, sources and proofs.

In all of them f is the function less the constant prior mean `offset`, v is `noise_variance` (a number of the model:
what is assumed of the noise is said apart), `K = K_f + v I` and `r = Y - offset`. Noise is `Y - f(x)` at the input as
recorded, so an error of the input counts as noise. `|f(x)| <= B sqrt(signal_variance)`: B has no unit.
"""

from __future__ import annotations

import enum
from collections.abc import Collection

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int
from numpy.typing import ArrayLike

from colift.gp.hyperparameters import Hyperparameters
from colift.gp.kernels import Kernel
from colift.gp.likelihood import kernel_matrix
from colift.gp.posterior import GPPosterior, _kernel, _kernel_in_use, _residual, check_point, information_gain, variance

BoundStatement = ArrayLike | float
"""A number a person states, or one for each output."""


class BoundAssumption(enum.Enum):
    """What a bound needs to be true of the world."""

    RKHS_NORM = "the function less `offset` lies in the RKHS of the kernel in use, with norm at most B"
    BOUNDED_NOISE_ENERGY = "the mean square of the noise in the data is at most eps^2"
    BOUNDED_NOISE = "every sample of the noise is at most eps in size"
    WITHIN_MODEL = "every sample of the noise is at most the square root of `noise_variance` in size"
    ZERO_MEAN = "the noise has zero mean given all before it"
    SUB_GAUSSIAN = "the noise is R-sub-Gaussian given all before it, hence has zero mean"
    INDEPENDENT = "the samples of the noise are independent of each other"
    PREDICTABLE_INPUTS = "an input, and whether its point is kept, is settled before its noise is drawn"
    FIXED_DESIGN = "inputs and their number do not depend on the noise"
    FIXED_HYPERPARAMETERS = "hyperparameters and `offset` do not depend on the noise in the data"
    HORIZON = "the number of points there will ever be is at most the stated one"
    FINITE_CANDIDATES = "every input is one of a stated finite set"
    INDEPENDENT_OUTPUTS = "the noise of one output is independent of that of every other"


_MARTINGALE = frozenset(
    {
        BoundAssumption.RKHS_NORM,
        BoundAssumption.SUB_GAUSSIAN,
        BoundAssumption.PREDICTABLE_INPUTS,
        BoundAssumption.FIXED_HYPERPARAMETERS,
    }
)

REQUIRED_ASSUMPTIONS = {
    "energy": frozenset({BoundAssumption.RKHS_NORM, BoundAssumption.BOUNDED_NOISE_ENERGY}),
    "recover": frozenset({BoundAssumption.RKHS_NORM, BoundAssumption.BOUNDED_NOISE}),
    "srinivas": frozenset(
        {
            BoundAssumption.RKHS_NORM,
            BoundAssumption.WITHIN_MODEL,
            BoundAssumption.ZERO_MEAN,
            BoundAssumption.PREDICTABLE_INPUTS,
            BoundAssumption.FIXED_HYPERPARAMETERS,
        }
    ),
    "abbasi_yadkori": _MARTINGALE,
    "chowdhury_gopalan": _MARTINGALE | {BoundAssumption.HORIZON},
    "fiedler": _MARTINGALE,
    "fiedler_fixed": frozenset(
        {
            BoundAssumption.RKHS_NORM,
            BoundAssumption.SUB_GAUSSIAN,
            BoundAssumption.INDEPENDENT,
            BoundAssumption.FIXED_DESIGN,
            BoundAssumption.FIXED_HYPERPARAMETERS,
        }
    ),
    "greatest_gain_on_pool": frozenset({BoundAssumption.FINITE_CANDIDATES}),
    "split_product": frozenset({BoundAssumption.INDEPENDENT_OUTPUTS}),
}
"""Needs of each bound by its name; those of `recover` are of `colift.gp.optimal_recovery`."""

_IMPLIED = (
    ({BoundAssumption.WITHIN_MODEL}, BoundAssumption.BOUNDED_NOISE),
    ({BoundAssumption.BOUNDED_NOISE}, BoundAssumption.BOUNDED_NOISE_ENERGY),
    (
        {BoundAssumption.BOUNDED_NOISE, BoundAssumption.ZERO_MEAN},
        BoundAssumption.SUB_GAUSSIAN,
    ),  # R = eps: Hoeffding's lemma
    ({BoundAssumption.SUB_GAUSSIAN}, BoundAssumption.ZERO_MEAN),
    ({BoundAssumption.FIXED_DESIGN}, BoundAssumption.PREDICTABLE_INPUTS),
)


def unsatisfied(bound: str, met: Collection[BoundAssumption]) -> frozenset[BoundAssumption]:
    """What the bound of that name needs beyond what is met, and what follows from what is met.

    Raises ValueError for a name that is not in `ASSUMES`.
    """
    if bound not in REQUIRED_ASSUMPTIONS:
        raise ValueError(f"bound = {bound!r}: must be one of {', '.join(REQUIRED_ASSUMPTIONS)}")
    known = set(met)
    for _ in _IMPLIED:  # as often as there are rules: chains end
        known |= {then for needs, then in _IMPLIED if needs <= known}
    return REQUIRED_ASSUMPTIONS[bound] - known


# -- bounded noise -----------------------------------------------------------------------------------------------


def bounded_energy(gp: GPPosterior, norm: BoundStatement, noise_bound: BoundStatement) -> Float[Array, " outputs"]:
    """The bound for noise of bounded energy: for certain, whatever the noise's distribution, bias or correlation.

    `beta^2 = B^2 + E^2 / v - r^T K^-1 r`, `E^2 = n eps^2` (Lahr, Koehler, Scampicchio and Zeilinger 2025, Lemma 1;
    Fogel 1979 for finitely many parameters). Proof: `J(g) = ||g||^2 + sum_k (r_k - g(x_k))^2 / v` has its minimum
    `r^T K^-1 r` at `m = mu - offset`, and `J(g) - J(m) = ||g - m||_n^2`, the norm in the RKHS of the posterior
    covariance, where Cauchy-Schwarz gives `|g(x) - m(x)| <= sigma(x) ||g - m||_n`; J of the truth is at most
    `B^2 + E^2 / v`.

    It holds for the alpha that gp holds, whatever rounding made of it: `r^T K^-1 r >= alpha^T (2 r - K alpha)` for any
    alpha, and the mean of that alpha lies within `||q|| / sqrt(v)`, `q = r - K alpha`, of m in the posterior's space, a
    distance that is added. Both are rounded outward, see `docs/bounds.md`.

    norm: B; noise_bound: eps, unit of y, of every sample or of their root mean square. Numbers, or `(outputs,)`.
    Infinite where `beta^2 < 0`: the data contradict B and eps, so that nothing is known.
    """
    return _energy(gp, _stated(gp, "norm", norm), _stated(gp, "noise_bound", noise_bound))


@jax.jit
def _energy(gp: GPPosterior, B: Float[Array, " outputs"], eps: Float[Array, " outputs"]) -> Float[Array, " outputs"]:
    r, a, s, v = _residual(gp), jnp.abs(gp.alpha), gp.hyper.signal_variance, gp.hyper.noise_variance
    rounded = jnp.abs(r) + (s * jnp.sum(a, axis=-1))[:, None] + v[:, None] * a
    off = jnp.abs(r - _times_gram(gp, gp.alpha)) + _rounding(gp) * rounded
    off = jnp.where(jnp.arange(gp.capacity)[None] < gp.num_points, off, 0.0)
    most = B * B + gp.num_points.astype(v.dtype) * eps * eps / v
    beta2 = most * (1 + _rounding(gp)) - _least(gp, r, gp.alpha, jnp.abs(r))
    beta = jnp.sqrt(jnp.maximum(beta2, 0.0)) + jnp.sqrt(jnp.sum(off * off, axis=-1) / v)
    return jnp.where(beta2 >= 0, beta * (1 + _rounding(gp)), jnp.inf)


def _least(gp: GPPosterior, b: Array, c: Array, size: Array) -> Float[Array, " outputs"]:
    """At most `b^T K^-1 b`, whatever c: `c^T (2 b - K c)` is greatest at `c = K^-1 b`. All `(outputs, capacity)`.

    size: at least `|b|`, of whose rounding `_rounding` is the relative bound.
    """
    a, s, v = jnp.abs(c), gp.hyper.signal_variance, gp.hyper.noise_variance
    value = jnp.sum(c * (2 * b - _times_gram(gp, c)), axis=-1)
    total = jnp.sum(a, axis=-1)
    return value - _rounding(gp) * (2 * jnp.sum(a * size, axis=-1) + s * total * total + v * jnp.sum(a * a, axis=-1))


def _times_gram(gp: GPPosterior, c: Float[Array, "outputs capacity"]) -> Float[Array, "outputs capacity"]:
    """`K c`, for c that are zero past n."""
    K = jax.vmap(lambda x: _kernel(gp, x))(gp.X)
    return jnp.einsum("jik,ik->ij", K, c) + gp.hyper.noise_variance[:, None] * c


def _rounding(gp: GPPosterior) -> float:
    """Of a sum over the data of kernel values times numbers, the error over the sum of sizes, at most.

    With unit roundoff u: a kernel value errs by `(D + 8) u s`, twice a sum of n terms by `2 (n + 2) u`; this is twice
    as much, for what is of order `u^2` and for its own rounding. `docs/bounds.md` has the count.
    """
    capacity, D = gp.X.shape[-2:]
    return (2 * capacity + D + 16) * float(np.finfo(float).eps)


# -- random noise ------------------------------------------------------------------------------------------------


def srinivas(
    gp: GPPosterior, norm: BoundStatement, confidence: BoundStatement, gain: Float[Array, " outputs"]
) -> Float[Array, " outputs"]:
    """The paper's bound, `beta^2 = 2 B^2 + 300 gamma ln^3((n + 1) / (1 - confidence))`, for all n at once.

    Srinivas, Krause, Kakade and Seeger 2012, Theorem 6; Eqs. beta_agents and beta_payload of the paper with
    `confidence = split_product(c, m)`. The theorem is for noise of zero mean given the past and at most `sqrt(v)`
    in size. The paper states it for Gaussian noise, which no number bounds: its lemma does not follow.

    gain: gamma, the maximum information gain of n + 1 points, nats: `greatest_gain` or `greatest_gain_on_pool`.
    """
    B = _stated(gp, "norm", norm)
    logarithm = jnp.log(gp.num_points.astype(B.dtype) + 1) + _log_failure(gp, confidence)
    return jnp.sqrt(2 * B * B + 300 * gain * logarithm**3)


def abbasi_yadkori(
    gp: GPPosterior, norm: BoundStatement, sub_gaussian: BoundStatement, confidence: BoundStatement
) -> Float[Array, " outputs"]:
    """`beta = B + R sqrt((2 ln(1 / (1 - confidence)) + ln det(I + K_f / v)) / v)`, for all n at once.

    Abbasi-Yadkori 2012 (thesis), Theorem 3.11. sub_gaussian: R, unit of y.
    """
    B, R = _stated(gp, "norm", norm), _stated(gp, "sub_gaussian", sub_gaussian)
    nats = _log_failure(gp, confidence) + information_gain(gp)
    return B + R * jnp.sqrt(2 * nats / gp.hyper.noise_variance)


def chowdhury_gopalan(
    gp: GPPosterior, norm: BoundStatement, sub_gaussian: BoundStatement, confidence: BoundStatement, horizon: int
) -> Float[Array, " outputs"]:
    """`beta = B + R sqrt((1 + 2/T) / v) sqrt(2 (gain + 1 + ln(1 / (1 - confidence))))` for all n <= T = `horizon`.

    Chowdhury and Gopalan 2017, Theorem 2, which has `v = 1 + 2/T`: any other v is theirs with the kernel times
    `(1 + 2/T) / v`, which leaves the mean alone. gain: of the data held, which their proof uses before it is
    replaced by its maximum. Always above `abbasi_yadkori`.
    Raises ValueError for a horizon below 1.
    """
    if horizon < 1:
        raise ValueError(f"horizon = {horizon} points: must be at least 1")
    B, R = _stated(gp, "norm", norm), _stated(gp, "sub_gaussian", sub_gaussian)
    nats = information_gain(gp) + 1 + _log_failure(gp, confidence)
    beta = B + R * jnp.sqrt((1 + 2 / horizon) * 2 * nats / gp.hyper.noise_variance)
    return jnp.where(gp.num_points <= horizon, beta, jnp.inf)


def fiedler(
    gp: GPPosterior, norm: BoundStatement, sub_gaussian: BoundStatement, confidence: BoundStatement
) -> Float[Array, " outputs"]:
    """`beta = B + R sqrt((ln det((w/v) K_f + w I) + 2 ln(1 / (1 - confidence))) / v)`, `w = max(1, v)`, for all n.

    Fiedler, Scherer and Trimpe 2021, Theorem 1, as their successors quote it (their own text was not at hand; it is
    right in any case, being `abbasi_yadkori` for v <= 1 and above it otherwise). It changes with the unit of y.
    """
    B, R, v = _stated(gp, "norm", norm), _stated(gp, "sub_gaussian", sub_gaussian), gp.hyper.noise_variance
    log_det = 2 * information_gain(gp) + gp.num_points.astype(v.dtype) * jnp.log(jnp.maximum(1.0, v))
    return B + R * jnp.sqrt((log_det + 2 * _log_failure(gp, confidence)) / v)


def fiedler_fixed(
    gp: GPPosterior,
    x: Float[Array, " dimensions"],
    norm: BoundStatement,
    sub_gaussian: BoundStatement,
    confidence: BoundStatement,
) -> Float[Array, " outputs"]:
    """Radius at x, unit of y: `B sigma(x) + R |c| sqrt(n + 2 sqrt(n t) + 2 t)`, `t = ln(1 / (1 - confidence))`.

    `c = K^-1 k(X, x)`; for one n stated in advance, all x. Fiedler, Scherer and Trimpe 2021, Proposition 2 (their
    own text was not at hand). Proof: `mu(x) - f(x)` is what the mean of noiseless labels misses, at most
    `B sigma(x)`, plus `c^T noise`, and `|noise|^2 <= R^2 (n + 2 sqrt(n t) + 2 t)` with probability `confidence`
    (Hsu, Kakade and Zhang 2012, Theorem 2.1).
    """
    B, R, t = _stated(gp, "norm", norm), _stated(gp, "sub_gaussian", sub_gaussian), _log_failure(gp, confidence)
    c = jnp.einsum(
        "ikj,ik->ij", gp.inverse_cholesky, jnp.einsum("ijk,ik->ij", gp.inverse_cholesky, _kernel_in_use(gp, x))
    )
    n = gp.num_points.astype(B.dtype)
    noise = R * jnp.sqrt(n + 2 * jnp.sqrt(n * t) + 2 * t)
    return B * jnp.sqrt(variance(gp, x)) + noise * jnp.sqrt(jnp.sum(c * c, axis=-1))


# -- the maximum information gain --------------------------------------------------------------------------------


def max_information_gain(hyper: Hyperparameters, points: int | Int[Array, ""]) -> Float[Array, " outputs"]:
    """`gamma <= N/2 ln(1 + signal_variance / v)` of any N points, nats: Hadamard's inequality for `I + K_f / v`."""
    return 0.5 * jnp.asarray(points, dtype=float) * jnp.log1p(hyper.signal_variance / hyper.noise_variance)


def max_information_gain_greedy(hyper: Hyperparameters, pool: ArrayLike, points: int) -> Float[Array, " outputs"]:
    """`gamma <= e/(e - 1)` times the gain of N points picked greedily from a pool, with repetition; nats (host).

    Nemhauser, Wolsey and Fisher 1978 (information gain is submodular: Krause and Guestrin 2005), on N copies of
    the pool, so that it covers data that repeat points. It holds for data in the pool and says nothing of others.
    Never above `greatest_gain`.

    pool: `(P, dimensions)`, unit of x. Raises ValueError where it is empty, not finite or of other dimensions.
    """
    pool = np.asarray(pool, dtype=float)
    if pool.ndim != 2 or not len(pool) or pool.shape[1] != hyper.lengthscales.shape[1] or not np.isfinite(pool).all():
        raise ValueError(
            f"pool {pool.shape}: must be finite, (points, dimensions) with {hyper.lengthscales.shape[1]} dimensions"
        )
    greedy = [
        _greedy_gain(hyper.kernel, pool / np.asarray(ls), float(s), float(v), points)
        for s, ls, v in zip(hyper.signal_variance, hyper.lengthscales, hyper.noise_variance, strict=True)
    ]
    return jnp.minimum(np.e / (np.e - 1) * jnp.asarray(greedy), max_information_gain(hyper, points))


def _greedy_gain(kernel: Kernel, U: np.ndarray, s: float, v: float, points: int) -> float:
    """Sum of `1/2 ln(1 + sigma_t^2(x_t) / v)`, x_t the point of largest posterior variance so far."""
    deviation2, columns, gain = np.full(len(U), s), np.empty((points, len(U))), 0.0
    for t in range(points):
        j = int(np.argmax(deviation2))
        gain += 0.5 * np.log1p(deviation2[j] / v)
        covariance = s * kernel_matrix(kernel, U, U[j : j + 1])[:, 0] - columns[:t, j] @ columns[:t]
        columns[t] = covariance / np.sqrt(deviation2[j] + v)
        deviation2 = np.maximum(deviation2 - columns[t] ** 2, 0.0)  # exact arithmetic leaves it at or above zero
    return gain


# -- confidence --------------------------------------------------------------------------------------------------


def union_bound_levels(confidence: float, weights: ArrayLike) -> np.ndarray:
    """Confidences `1 - w_i (1 - confidence)` of parts that then hold together: the union bound, rem1 of the paper.

    Any positive weights of sum at most 1 will do; `1 / (bodies)` each is the paper's choice. Weights of outputs,
    bodies and updates multiply: `np.multiply.outer(bodies, outputs)`; `update_weight` serves updates without end.
    Raises ValueError for a confidence outside (0, 1) or other weights.
    """
    w = np.asarray(weights, dtype=float)
    _check_confidence(np.asarray(confidence))
    if not (w > 0).all() or not w.sum() <= 1 + 1e-12:
        raise ValueError(f"weights = {w.tolist()}: must be positive, their sum ({w.sum():.6g}) at most 1")
    return 1 - w * (1 - confidence)


def product_levels(confidence: float, parts: int) -> float:
    """`confidence^(1/parts)` for each of several parts, as the paper has it: for independent parts only."""
    _check_confidence(np.asarray(confidence))
    if parts < 1:
        raise ValueError(f"parts = {parts}: must be at least 1")
    return confidence ** (1 / parts)


def update_confidence_share(k: int) -> float:
    """`6 / (pi^2 k^2)`, k = 1, 2, ...: weights of updates whose number nobody knows; their sum is 1."""
    if k < 1:
        raise ValueError(f"k = {k}: updates count from 1")
    return 6 / (np.pi * k) ** 2


# -- the radius --------------------------------------------------------------------------------------------------


@jax.jit
def error_radius(
    gp: GPPosterior, x: Float[Array, " dimensions"], beta: Float[Array, " outputs"]
) -> Float[Array, " outputs"]:
    """`rho_i(x) = beta_i sigma_i(x)`, unit of y: bounds `|f_i(x) - mu_i(x)|`, mu as `mean` computes it.

    `sigma^2 = s - k^T K^-1 k <= s - c^T (2 k - K c)` for any c, here what W makes of k; rounded outward, and with what
    `mean` rounds. So it is above `beta sqrt(variance)`, and about `beta sqrt(n eps s)` where rounding has eaten
    that. Infinite where beta is.
    """
    check_point(gp.X, gp.Y, x)
    s, k = gp.hyper.signal_variance, _kernel_in_use(gp, x)
    c = jnp.einsum("ikj,ik->ij", gp.inverse_cholesky, jnp.einsum("ijk,ik->ij", gp.inverse_cholesky, k))
    variance = s * (1 + _rounding(gp)) - _least(gp, k, c, jnp.broadcast_to(s[:, None], k.shape))
    rounded = _rounding(gp) * (s * jnp.sum(jnp.abs(gp.alpha), axis=-1) + jnp.abs(gp.hyper.constant_mean))
    deviation = jnp.sqrt(jnp.maximum(variance, 0.0))
    return jnp.where(jnp.isinf(beta), jnp.inf, (beta * deviation + rounded) * (1 + _rounding(gp)))


@jax.jit
def vector_error_radius(
    gp: GPPosterior, x: Float[Array, " dimensions"], beta: Float[Array, " outputs"]
) -> Float[Array, ""]:
    """`rho_bar(x) = sqrt(sum_i rho_i(x)^2)`, unit of y: bounds `|f - mu|` at x (ass:oracle_bound).

    Each output by its own bound, `radius`, then the 2-norm (the paper's `||beta^T Sigma^1/2||` read as this one).
    """
    rho = error_radius(gp, x, beta)
    return jnp.sqrt(jnp.sum(rho * rho))


def _stated(gp: GPPosterior, name: str, value: BoundStatement) -> Float[Array, " outputs"]:
    """A number a person states, or one for each output; ValueError where it is negative or not finite."""
    stated, shape = np.asarray(value, dtype=float), gp.hyper.noise_variance.shape
    if stated.shape not in ((), shape):
        raise ValueError(f"{name} has shape {stated.shape}: must be a number or {shape}, one for each output")
    if not (np.isfinite(stated).all() and (stated >= 0).all()):
        raise ValueError(f"{name} = {stated.tolist()}: must be finite and at least 0")
    return jnp.asarray(np.broadcast_to(stated, shape))


def _log_failure(gp: GPPosterior, confidence: BoundStatement) -> Float[Array, " outputs"]:
    """`ln(1 / (1 - confidence))`."""
    _check_confidence(np.asarray(confidence, dtype=float))
    return -jnp.log1p(-_stated(gp, "confidence", confidence))


def _check_confidence(confidence: np.ndarray) -> None:
    if not ((confidence > 0) & (confidence < 1)).all():
        raise ValueError(f"confidence = {confidence.tolist()}: must lie strictly between 0 and 1")
