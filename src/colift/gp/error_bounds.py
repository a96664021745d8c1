"""Error bounds of the posterior mean: `|f_i(x) - mu_i(x)| <= beta_i sigma_i(x)` for every x.

`REQUIRED_ASSUMPTIONS` lists the assumptions of each bound, and `unsatisfied` returns those that a scenario does not
satisfy. A result with an unsatisfied assumption is reported as assumed, not certified.

In all bounds, f is the function minus the constant prior mean, v is `noise_variance`, `K = K_f + v I` and
`r = Y - constant_mean`. The noise is `Y - f(x)` at the recorded input, so an input error is part of the noise. The
assumption on the noise is independent of v. The norm bound B has no unit: `|f(x)| <= B sqrt(signal_variance)`.

See Also:
    docs/bounds.md: Statements, sources and proofs.
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
from colift.gp.posterior import GPPosterior, _kernel, _masked_kernel, _residual, check_point, information_gain, variance

BoundStatement = ArrayLike | float
"""Number stated by the user, or one number for each output."""


class BoundAssumption(enum.Enum):
    """Assumption of an error bound on the residual function, the noise or the data."""

    RKHS_NORM = "the function minus `constant_mean` lies in the RKHS of the kernel in use, with norm at most B"
    BOUNDED_NOISE_ENERGY = "the mean square of the noise in the data is at most eps^2"
    BOUNDED_NOISE = "every sample of the noise is at most eps in magnitude"
    NOISE_WITHIN_STD = "every sample of the noise is at most the square root of `noise_variance` in magnitude"
    ZERO_MEAN = "the noise has zero mean given all previous data"
    SUB_GAUSSIAN = "the noise is R-sub-Gaussian given all previous data, hence of zero mean"
    INDEPENDENT = "the samples of the noise are independent of each other"
    PREDICTABLE_INPUTS = "an input, and the decision to keep it, do not depend on its noise"
    FIXED_DESIGN = "inputs and their number do not depend on the noise"
    FIXED_HYPERPARAMETERS = "hyperparameters and `constant_mean` do not depend on the noise in the data"
    HORIZON = "the number of points never exceeds the stated horizon"
    FINITE_CANDIDATES = "every input belongs to a stated finite set"
    INDEPENDENT_OUTPUTS = "the noise of one output is independent of that of every other"


_MARTINGALE_ASSUMPTIONS = frozenset(
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
            BoundAssumption.NOISE_WITHIN_STD,
            BoundAssumption.ZERO_MEAN,
            BoundAssumption.PREDICTABLE_INPUTS,
            BoundAssumption.FIXED_HYPERPARAMETERS,
        }
    ),
    "abbasi_yadkori": _MARTINGALE_ASSUMPTIONS,
    "chowdhury_gopalan": _MARTINGALE_ASSUMPTIONS | {BoundAssumption.HORIZON},
    "fiedler": _MARTINGALE_ASSUMPTIONS,
    "fiedler_fixed": frozenset(
        {
            BoundAssumption.RKHS_NORM,
            BoundAssumption.SUB_GAUSSIAN,
            BoundAssumption.INDEPENDENT,
            BoundAssumption.FIXED_DESIGN,
            BoundAssumption.FIXED_HYPERPARAMETERS,
        }
    ),
    "max_information_gain_greedy": frozenset({BoundAssumption.FINITE_CANDIDATES}),
    "product_levels": frozenset({BoundAssumption.INDEPENDENT_OUTPUTS}),
}
"""Assumptions of each bound by its name; `recover` is the bound of `colift.gp.optimal_recovery`."""

_IMPLIED = (
    ({BoundAssumption.NOISE_WITHIN_STD}, BoundAssumption.BOUNDED_NOISE),
    ({BoundAssumption.BOUNDED_NOISE}, BoundAssumption.BOUNDED_NOISE_ENERGY),
    (
        {BoundAssumption.BOUNDED_NOISE, BoundAssumption.ZERO_MEAN},
        BoundAssumption.SUB_GAUSSIAN,
    ),  # R = eps: Hoeffding's lemma
    ({BoundAssumption.SUB_GAUSSIAN}, BoundAssumption.ZERO_MEAN),
    ({BoundAssumption.FIXED_DESIGN}, BoundAssumption.PREDICTABLE_INPUTS),
)


def unsatisfied(bound: str, satisfied: Collection[BoundAssumption]) -> frozenset[BoundAssumption]:
    """Return the assumptions of a bound that do not follow from the satisfied ones.

    Args:
        bound: Name in `REQUIRED_ASSUMPTIONS`.
        satisfied: Assumptions that hold.

    Returns:
        The remaining assumptions.

    Raises:
        ValueError: If the bound is not in `REQUIRED_ASSUMPTIONS`.
    """
    if bound not in REQUIRED_ASSUMPTIONS:
        raise ValueError(f"bound = {bound!r}: must be one of {', '.join(REQUIRED_ASSUMPTIONS)}")
    implied = set(satisfied)
    for _ in _IMPLIED:  # one pass per rule resolves all chains of implications
        implied |= {conclusion for premises, conclusion in _IMPLIED if premises <= implied}
    return REQUIRED_ASSUMPTIONS[bound] - implied


# Bounds for bounded noise ---------------------------------------------------------------------------------------


def bounded_energy(gp: GPPosterior, norm: BoundStatement, noise_bound: BoundStatement) -> Float[Array, " outputs"]:
    """Compute beta of the deterministic bound for noise of bounded energy.

    `beta^2 = B^2 + E^2 / v - r^T K^-1 r`, `E^2 = n eps^2` (Lahr, Koehler, Scampicchio and Zeilinger 2025, Lemma 1;
    Fogel 1979 for finitely many parameters). The bound holds for any distribution, bias or correlation of the noise.

    Proof: `J(g) = ||g||^2 + sum_k (r_k - g(x_k))^2 / v` has the minimum `r^T K^-1 r` at the posterior mean m.
    `J(g) - J(m) = ||g - m||_n^2` is the norm in the RKHS of the posterior covariance, so
    `|g(x) - m(x)| <= sigma(x) ||g - m||_n` by Cauchy-Schwarz. The true function has `J(f) <= B^2 + E^2 / v`.

    The result holds for the stored alpha including its rounding errors: `r^T K^-1 r >= alpha^T (2 r - K alpha)` for any
    alpha. The mean of the stored alpha differs from m by at most `||q|| / sqrt(v)`, `q = r - K alpha`, and this
    distance is added. Both terms are rounded outward; see `docs/bounds.md`.

    Args:
        gp: Posterior.
        norm: RKHS norm bound B.
        noise_bound: Bound eps of every noise sample or of the root mean square [unit of y].

    Returns:
        Factor beta of each output; infinite where `beta^2 < 0`, that is, where the data contradict B and eps.
    """
    return _energy(gp, _per_output(gp, "norm", norm), _per_output(gp, "noise_bound", noise_bound))


@jax.jit
def _energy(gp: GPPosterior, B: Float[Array, " outputs"], eps: Float[Array, " outputs"]) -> Float[Array, " outputs"]:
    """Compute `bounded_energy` for one bound per output."""
    r, a, s, v = _residual(gp), jnp.abs(gp.alpha), gp.hyper.signal_variance, gp.hyper.noise_variance
    rounding = jnp.abs(r) + (s * jnp.sum(a, axis=-1))[:, None] + v[:, None] * a
    mean_error = jnp.abs(r - _gram_product(gp, gp.alpha)) + _rounding_error(gp) * rounding
    mean_error = jnp.where(jnp.arange(gp.capacity)[None] < gp.num_points, mean_error, 0.0)
    limit = B * B + gp.num_points.astype(v.dtype) * eps * eps / v
    beta2 = limit * (1 + _rounding_error(gp)) - _quadratic_form_lower_bound(gp, r, gp.alpha, jnp.abs(r))
    beta = jnp.sqrt(jnp.maximum(beta2, 0.0)) + jnp.sqrt(jnp.sum(mean_error * mean_error, axis=-1) / v)
    return jnp.where(beta2 >= 0, beta * (1 + _rounding_error(gp)), jnp.inf)


def _quadratic_form_lower_bound(gp: GPPosterior, b: Array, c: Array, magnitude: Array) -> Float[Array, " outputs"]:
    """Return a lower bound of `b^T K^-1 b` for any c; the maximum of `c^T (2 b - K c)` is at `c = K^-1 b`.

    All arrays are `(outputs, capacity)`; `magnitude` is at least `|b|` and scales the rounding error of b.
    """
    a, s, v = jnp.abs(c), gp.hyper.signal_variance, gp.hyper.noise_variance
    value = jnp.sum(c * (2 * b - _gram_product(gp, c)), axis=-1)
    total = jnp.sum(a, axis=-1)
    return value - _rounding_error(gp) * (
        2 * jnp.sum(a * magnitude, axis=-1) + s * total * total + v * jnp.sum(a * a, axis=-1)
    )


def _gram_product(gp: GPPosterior, c: Float[Array, "outputs capacity"]) -> Float[Array, "outputs capacity"]:
    """Compute `K c` for vectors c that are zero in empty rows."""
    K = jax.vmap(lambda x: _kernel(gp, x))(gp.X)
    return jnp.einsum("jik,ik->ij", K, c) + gp.hyper.noise_variance[:, None] * c


def _rounding_error(gp: GPPosterior) -> float:
    """Bound the relative rounding error of a sum over the data of kernel values times numbers.

    With unit roundoff u, a kernel value has the error `(D + 8) u s`, and twice a sum of n terms has `2 (n + 2) u`. The
    returned value is twice their sum, which covers terms of order `u^2` and its own rounding.

    Args:
        gp: Posterior.

    Returns:
        Relative error; see `docs/bounds.md` for the derivation.
    """
    capacity, D = gp.X.shape[-2:]
    return (2 * capacity + D + 16) * float(np.finfo(float).eps)


# Bounds for random noise ----------------------------------------------------------------------------------------


def srinivas(
    gp: GPPosterior, norm: BoundStatement, confidence: BoundStatement, gain: Float[Array, " outputs"]
) -> Float[Array, " outputs"]:
    """Compute the paper's factor, `beta^2 = 2 B^2 + 300 gamma ln^3((n + 1) / (1 - confidence))`, for all n at once.

    Srinivas, Krause, Kakade and Seeger 2012, Theorem 6; Eqs. beta_agents and beta_payload of the paper with
    `confidence = product_levels(c, m)`. The theorem assumes noise of zero conditional mean, bounded by `sqrt(v)`. The
    paper states it for Gaussian noise, which is unbounded, so its lemma does not follow.

    Args:
        gp: Posterior.
        norm: RKHS norm bound B.
        confidence: Probability with which the bound holds, in (0, 1).
        gain: Maximum information gain gamma of n + 1 points [nats]; see `max_information_gain`.

    Returns:
        Factor beta of each output.
    """
    B = _per_output(gp, "norm", norm)
    logarithm = jnp.log(gp.num_points.astype(B.dtype) + 1) + _log_failure(gp, confidence)
    return jnp.sqrt(2 * B * B + 300 * gain * logarithm**3)


def abbasi_yadkori(
    gp: GPPosterior, norm: BoundStatement, sub_gaussian: BoundStatement, confidence: BoundStatement
) -> Float[Array, " outputs"]:
    """Compute `beta = B + R sqrt((2 ln(1 / (1 - confidence)) + ln det(I + K_f / v)) / v)`, valid for all n at once.

    Abbasi-Yadkori 2012 (thesis), Theorem 3.11.

    Args:
        gp: Posterior.
        norm: RKHS norm bound B.
        sub_gaussian: Sub-Gaussian constant R of the noise [unit of y].
        confidence: Probability with which the bound holds, in (0, 1).

    Returns:
        Factor beta of each output.
    """
    B, R = _per_output(gp, "norm", norm), _per_output(gp, "sub_gaussian", sub_gaussian)
    nats = _log_failure(gp, confidence) + information_gain(gp)
    return B + R * jnp.sqrt(2 * nats / gp.hyper.noise_variance)


def chowdhury_gopalan(
    gp: GPPosterior, norm: BoundStatement, sub_gaussian: BoundStatement, confidence: BoundStatement, horizon: int
) -> Float[Array, " outputs"]:
    """Compute `beta = B + R sqrt((1 + 2/T) / v) sqrt(2 (gain + 1 + ln(1 / (1 - confidence))))` for all n <= T.

    Chowdhury and Gopalan 2017, Theorem 2, stated for `v = 1 + 2/T`. Another v is equivalent to the kernel times
    `(1 + 2/T) / v`, which does not change the mean. The bound uses the information gain of the data instead of the
    larger maximum information gain of the theorem; the proof holds for both. The result is always above
    `abbasi_yadkori`.

    Args:
        gp: Posterior.
        norm: RKHS norm bound B.
        sub_gaussian: Sub-Gaussian constant R of the noise [unit of y].
        confidence: Probability with which the bound holds, in (0, 1).
        horizon: Maximum number T of points.

    Returns:
        Factor beta of each output; infinite for more than T points.

    Raises:
        ValueError: If the horizon is below 1.
    """
    if horizon < 1:
        raise ValueError(f"horizon = {horizon} points: must be at least 1")
    B, R = _per_output(gp, "norm", norm), _per_output(gp, "sub_gaussian", sub_gaussian)
    nats = information_gain(gp) + 1 + _log_failure(gp, confidence)
    beta = B + R * jnp.sqrt((1 + 2 / horizon) * 2 * nats / gp.hyper.noise_variance)
    return jnp.where(gp.num_points <= horizon, beta, jnp.inf)


def fiedler(
    gp: GPPosterior, norm: BoundStatement, sub_gaussian: BoundStatement, confidence: BoundStatement
) -> Float[Array, " outputs"]:
    """Compute `beta = B + R sqrt((ln det((w/v) K_f + w I) + 2 ln(1 / (1 - confidence))) / v)` with `w = max(1, v)`.

    Fiedler, Scherer and Trimpe 2021, Theorem 1, as quoted by later work of the same group; the original text was not
    available. The bound holds in any case: it equals `abbasi_yadkori` for v <= 1 and is larger otherwise. It depends on
    the unit of y.

    Args:
        gp: Posterior.
        norm: RKHS norm bound B.
        sub_gaussian: Sub-Gaussian constant R of the noise [unit of y].
        confidence: Probability with which the bound holds, in (0, 1).

    Returns:
        Factor beta of each output, valid for all n at once.
    """
    B, R, v = _per_output(gp, "norm", norm), _per_output(gp, "sub_gaussian", sub_gaussian), gp.hyper.noise_variance
    log_det = 2 * information_gain(gp) + gp.num_points.astype(v.dtype) * jnp.log(jnp.maximum(1.0, v))
    return B + R * jnp.sqrt((log_det + 2 * _log_failure(gp, confidence)) / v)


def fiedler_fixed(
    gp: GPPosterior,
    x: Float[Array, " dimensions"],
    norm: BoundStatement,
    sub_gaussian: BoundStatement,
    confidence: BoundStatement,
) -> Float[Array, " outputs"]:
    """Compute the error radius `B sigma(x) + R |c| sqrt(n + 2 sqrt(n t) + 2 t)` with `t = ln(1 / (1 - confidence))`.

    `c = K^-1 k(X, x)`; the radius holds for all x and one n fixed in advance. Fiedler, Scherer and Trimpe 2021,
    Proposition 2; the original text was not available. Proof: the error of the mean of noiseless labels is at most
    `B sigma(x)`. The noise adds `c^T noise`, and `|noise|^2 <= R^2 (n + 2 sqrt(n t) + 2 t)` with probability
    `confidence` (Hsu, Kakade and Zhang 2012, Theorem 2.1).

    Args:
        gp: Posterior.
        x: Input.
        norm: RKHS norm bound B.
        sub_gaussian: Sub-Gaussian constant R of the noise [unit of y].
        confidence: Probability with which the bound holds, in (0, 1).

    Returns:
        Error radius of each output [unit of y].
    """
    B, R, t = _per_output(gp, "norm", norm), _per_output(gp, "sub_gaussian", sub_gaussian), _log_failure(gp, confidence)
    c = jnp.einsum(
        "ikj,ik->ij", gp.inverse_cholesky, jnp.einsum("ijk,ik->ij", gp.inverse_cholesky, _masked_kernel(gp, x))
    )
    n = gp.num_points.astype(B.dtype)
    noise = R * jnp.sqrt(n + 2 * jnp.sqrt(n * t) + 2 * t)
    return B * jnp.sqrt(variance(gp, x)) + noise * jnp.sqrt(jnp.sum(c * c, axis=-1))


# Maximum information gain ---------------------------------------------------------------------------------------


def max_information_gain(hyper: Hyperparameters, points: int | Int[Array, ""]) -> Float[Array, " outputs"]:
    """Bound the information gain of any N points by `N/2 ln(1 + signal_variance / v)` (Hadamard's inequality).

    Args:
        hyper: Hyperparameters.
        points: Number N of points.

    Returns:
        Upper bound of the maximum information gain of each output [nats].
    """
    return 0.5 * jnp.asarray(points, dtype=float) * jnp.log1p(hyper.signal_variance / hyper.noise_variance)


def max_information_gain_greedy(hyper: Hyperparameters, pool: ArrayLike, points: int) -> Float[Array, " outputs"]:
    """Bound the information gain of N points from a finite candidate set by greedy selection with repetition (host).

    The result is `e/(e - 1)` times the greedy gain (Nemhauser, Wolsey and Fisher 1978), since information gain is
    submodular (Krause and Guestrin 2005). Repetition covers data that contain a point several times. The bound does not
    hold for data outside the candidate set. It is never above `max_information_gain`.

    Args:
        hyper: Hyperparameters.
        pool: Candidate inputs, `(P, dimensions)` [unit of x].
        points: Number N of points.

    Returns:
        Upper bound of the maximum information gain of each output [nats].

    Raises:
        ValueError: If the candidate set is empty, not finite or of other dimensions.
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
    """Return the sum of `1/2 ln(1 + sigma_t^2(x_t) / v)`, with x_t the candidate of largest posterior variance."""
    deviation2, columns, gain = np.full(len(U), s), np.empty((points, len(U))), 0.0
    for t in range(points):
        j = int(np.argmax(deviation2))
        gain += 0.5 * np.log1p(deviation2[j] / v)
        covariance = s * kernel_matrix(kernel, U, U[j : j + 1])[:, 0] - columns[:t, j] @ columns[:t]
        columns[t] = covariance / np.sqrt(deviation2[j] + v)
        deviation2 = np.maximum(deviation2 - columns[t] ** 2, 0.0)  # not negative in exact arithmetic
    return gain


# Splitting the confidence ---------------------------------------------------------------------------------------


def union_bound_levels(confidence: float, weights: ArrayLike) -> np.ndarray:
    """Split a confidence over parts by the union bound, `1 - w_i (1 - confidence)` (rem1 of the paper).

    Weights of outputs, bodies and updates multiply: `np.multiply.outer(bodies, outputs)`. The paper uses equal weights.
    `update_confidence_share` provides weights of an unlimited number of updates.

    Args:
        confidence: Probability with which all parts hold together, in (0, 1).
        weights: Positive weights with a sum of at most 1.

    Returns:
        Confidence of each part.

    Raises:
        ValueError: If the weights are not positive or their sum exceeds 1.
    """
    w = np.asarray(weights, dtype=float)
    _check_confidence(np.asarray(confidence))
    if not (w > 0).all() or not w.sum() <= 1 + 1e-12:
        raise ValueError(f"weights = {w.tolist()}: must be positive, their sum ({w.sum():.6g}) at most 1")
    return 1 - w * (1 - confidence)


def product_levels(confidence: float, parts: int) -> float:
    """Split a confidence over independent parts, `confidence^(1/parts)`, as in the paper.

    Args:
        confidence: Probability with which all parts hold together, in (0, 1).
        parts: Number of independent parts.

    Returns:
        Confidence of each part.

    Raises:
        ValueError: If the number of parts is below 1.
    """
    _check_confidence(np.asarray(confidence))
    if parts < 1:
        raise ValueError(f"parts = {parts}: must be at least 1")
    return confidence ** (1 / parts)


def update_confidence_share(k: int) -> float:
    """Return `6 / (pi^2 k^2)`, the weight of update k; the weights of all updates sum to 1.

    Args:
        k: Number of the update, from 1.

    Returns:
        Weight of the update.

    Raises:
        ValueError: If `k` is below 1.
    """
    if k < 1:
        raise ValueError(f"k = {k}: must be at least 1")
    return 6 / (np.pi * k) ** 2


# Error radii ----------------------------------------------------------------------------------------------------


@jax.jit
def error_radius(
    gp: GPPosterior, x: Float[Array, " dimensions"], beta: Float[Array, " outputs"]
) -> Float[Array, " outputs"]:
    """Compute `rho_i(x) = beta_i sigma_i(x)`, which bounds `|f_i(x) - mu_i(x)|` for mu as computed by `mean`.

    `sigma^2 = s - k^T K^-1 k <= s - c^T (2 k - K c)` holds for any c; here c is the product of the stored inverse
    factors with k. The result is rounded outward and includes the rounding of `mean`. It is above
    `beta sqrt(variance)`, and about `beta sqrt(n eps s)` where the variance is below the rounding error.

    Args:
        gp: Posterior.
        x: Input.
        beta: Factor of each output.

    Returns:
        Radius of each output [unit of y]; infinite where beta is infinite.
    """
    check_point(gp.X, gp.Y, x)
    s, k = gp.hyper.signal_variance, _masked_kernel(gp, x)
    c = jnp.einsum("ikj,ik->ij", gp.inverse_cholesky, jnp.einsum("ijk,ik->ij", gp.inverse_cholesky, k))
    variance = s * (1 + _rounding_error(gp)) - _quadratic_form_lower_bound(
        gp, k, c, jnp.broadcast_to(s[:, None], k.shape)
    )
    rounding = _rounding_error(gp) * (s * jnp.sum(jnp.abs(gp.alpha), axis=-1) + jnp.abs(gp.hyper.constant_mean))
    deviation = jnp.sqrt(jnp.maximum(variance, 0.0))
    return jnp.where(jnp.isinf(beta), jnp.inf, (beta * deviation + rounding) * (1 + _rounding_error(gp)))


@jax.jit
def vector_error_radius(
    gp: GPPosterior, x: Float[Array, " dimensions"], beta: Float[Array, " outputs"]
) -> Float[Array, ""]:
    """Compute `rho_bar(x) = sqrt(sum_i rho_i(x)^2)`, which bounds `|f - mu|_2` at x (ass:oracle_bound).

    Each output has its own `error_radius`. The paper's `||beta^T Sigma^1/2||` is read as their 2-norm.

    Args:
        gp: Posterior.
        x: Input.
        beta: Factor of each output.

    Returns:
        Radius of the vector of outputs [unit of y].
    """
    rho = error_radius(gp, x, beta)
    return jnp.sqrt(jnp.sum(rho * rho))


def _per_output(gp: GPPosterior, name: str, value: BoundStatement) -> Float[Array, " outputs"]:
    """Broadcast a stated number to all outputs; raise ValueError if it is negative or not finite."""
    stated, shape = np.asarray(value, dtype=float), gp.hyper.noise_variance.shape
    if stated.shape not in ((), shape):
        raise ValueError(f"{name} has shape {stated.shape}: must be a number or {shape}, one for each output")
    if not (np.isfinite(stated).all() and (stated >= 0).all()):
        raise ValueError(f"{name} = {stated.tolist()}: must be finite and at least 0")
    return jnp.asarray(np.broadcast_to(stated, shape))


def _log_failure(gp: GPPosterior, confidence: BoundStatement) -> Float[Array, " outputs"]:
    """Compute `ln(1 / (1 - confidence))`."""
    _check_confidence(np.asarray(confidence, dtype=float))
    return -jnp.log1p(-_per_output(gp, "confidence", confidence))


def _check_confidence(confidence: np.ndarray) -> None:
    """Raise ValueError if a confidence is not strictly between 0 and 1."""
    if not ((confidence > 0) & (confidence < 1)).all():
        raise ValueError(f"confidence = {confidence.tolist()}: must lie strictly between 0 and 1")
