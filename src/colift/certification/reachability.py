"""Bounds of the tracking errors as linear functionals of the residual, from norm and data.

An error at time t is a linear functional of the prediction error, `sum_s h(t, s) f~(q(s))`, where h is the response of
the linearized closed loop. A bound of the functional is smaller than the gain times the largest `|f~|`.

See Also:
    docs/certificate.md: Derivation, "Errors as linear functionals of the residual".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

from colift import gp
from colift.gp import likelihood, optimal_recovery

Matrix = NDArray[np.float64]

RANK_TOLERANCE = 1e-12  # fraction of the largest variance below which columns of a factor are bounded, not computed
NEGLIGIBLE_SHARE = 1e-3  # share of a row's bound below which an output keeps its energy bound


@dataclasses.dataclass(frozen=True)
class BodyModel:
    """Residual outputs of one body along a path, with the quantities that bound them.

    Attributes:
        columns: Input columns of the linearized closed loop.
        model: Posterior whose mean is compensated.
        bound_posterior: Posterior of the error bound; see `colift.onboard.learning.confidence_bounds`.
        beta: Factor of each output, `(outputs,)`.
        norm: RKHS norm bound B.
        label_error: Bound of the label errors of each output, `(outputs,)` [N, N m].
        x: Inputs of the models along the path, `(path, dimensions)`.
    """

    columns: slice
    model: gp.GPPosterior
    bound_posterior: gp.GPPosterior
    beta: Matrix
    norm: float
    label_error: Matrix
    x: Matrix


@dataclasses.dataclass(frozen=True)
class LowRankFactor:
    """Factor of a covariance S with `L S L^T <= |L R|^2 + (|L| e)^2` for every row L.

    Attributes:
        R: Factor with few columns, `(path, rank)`.
        e: Square root of the remaining diagonal, `(path,)`.
    """

    R: Matrix
    e: Matrix

    def squares(self, L: Matrix) -> Matrix:
        """Compute an upper bound of `L S L^T` for each row.

        Args:
            L: Rows, `(..., path)`.

        Returns:
            `(...,)`.
        """
        return np.sum((L @ self.R) ** 2, axis=-1) + (np.abs(L) @ self.e) ** 2

    def products(self, L: Matrix) -> Matrix:
        """Compute an upper bound of the matrix `L S L^T`.

        Args:
            L: `(..., rows, path)`.

        Returns:
            `(..., rows, rows)`.
        """
        spanned = L @ self.R
        # the remainder is at most its trace times the identity
        return spanned @ np.swapaxes(spanned, -1, -2) + (self.e @ self.e) * (L @ np.swapaxes(L, -1, -2))


def low_rank_factor(S: Matrix) -> LowRankFactor:
    """Compute a pivoted Cholesky factor of a covariance along a path; smooth functions need few columns.

    Args:
        S: Covariance, `(path, path)`.

    Returns:
        Factor of low rank with the diagonal of its remainder.
    """
    # dpstrf is missing in the stubs of scipy
    lower, pivots, rank, _ = lapack.dpstrf(  # ty: ignore[missing-attribute]
        S, tol=RANK_TOLERANCE * np.diagonal(S).max(), lower=1
    )
    R = np.empty((len(S), rank))
    R[pivots - 1] = np.tril(lower)[:, :rank]
    return LowRankFactor(R, np.sqrt(np.maximum(np.diagonal(S) - (R * R).sum(1), 0.0)))


def band_bound(body: BodyModel, weights: Matrix) -> tuple[Matrix, Matrix]:
    """Compute `l(m - mu)` and `sigma(l)` of each output's contribution l to a functional, for `functional_bound`.

    Args:
        body: Body along a path.
        weights: Effect of the residual at each point of the path, `(times, rows, path, inputs)`.

    Returns:
        Both quantities, `(times, rows, outputs)`.
    """
    shift, sigma = np.empty((2, *weights.shape[:2], len(body.beta)))
    difference = mean_difference(body)
    for i in range(len(body.beta)):
        L = np.ascontiguousarray(weights[..., body.columns.start + i])
        sigma[..., i] = np.sqrt(low_rank_factor(covariance(body.bound_posterior, i, body.x)).squares(L))
        shift[..., i] = L @ difference[:, i]
    return shift, sigma


def functional_bound(beta: Matrix, shift: Matrix, sigma: Matrix) -> Matrix:
    """Compute upper bounds of `l(f - mu)` and of its negative from `|l(f - m)| <= beta sigma(l)`.

    m and sigma belong to the bound posterior. A bound on `|f - m|` in the posterior's space holds for every functional.
    This is the case for all bounds of `colift.gp.error_bounds` except `fiedler_fixed`.

    Args:
        beta: Factor of each output.
        shift: `l(m - mu)`; see `band_bound`.
        sigma: `sigma(l)`; see `band_bound`.

    Returns:
        `(2, ...)`; infinite where beta is infinite.
    """
    width = np.where(np.isinf(beta), np.inf, beta * sigma)
    return np.stack([width + shift, width - shift])


def recovery_bound(
    body: BodyModel, weights: Matrix, band: Matrix, progress: Callable[[], None] = lambda: None
) -> Matrix:
    """Compute the upper bounds of `functional_bound` more tightly, by optimal recovery of every functional.

    The result does not exceed `band`. Outputs with a negligible contribution keep the value of `band`. Errors are
    raised as by `optimal_recovery.minimize_upper_bounds`.

    Args:
        body: Body along a path.
        weights: Effect of the residual at each point of the path, `(times, rows, path, inputs)`.
        band: Bounds by `functional_bound`, `(2, times, rows, outputs)`.
        progress: Function called after each output.

    Returns:
        `(2, times, rows, outputs)`.
    """
    bound, total = band.copy(), band.sum(-1).max((0, 1))
    mu = mean(body.model, body.x)
    for i in range(len(body.beta)):
        significant = np.flatnonzero(band[..., i].max((0, 1)) > NEGLIGIBLE_SHARE * total)
        if not len(significant):
            continue
        feasible = feasible_set(body, i)
        L = weights[..., body.columns.start + i][:, significant].reshape(-1, len(body.x))
        k, squared_norm = (
            feasible.correlations(body.x) @ L.T,
            low_rank_factor(correlation(body.model, i, body.x, body.x)).squares(L),
        )
        l1_norm, center = np.abs(L).sum(1), L @ (mu[:, i] - prior_mean(body)[i])
        for side, sign in enumerate((1, -1)):
            value = (
                optimal_recovery.minimize_upper_bounds(feasible, sign * k, squared_norm, l1_norm) - sign * center
            ).reshape(-1, len(significant))
            bound[side, ..., i][:, significant] = np.minimum(value, band[side, ..., i][:, significant])
        progress()
    return bound


def feasible_set(body: BodyModel, i: int) -> optimal_recovery.FeasibleSet:
    """Return the functions of one output that norm and data allow.

    Args:
        body: Body along a path.
        i: Index of the output.

    Returns:
        The feasible set; errors are raised as by `optimal_recovery.feasible_set`.
    """
    n = int(body.model.num_points)
    X, Y = np.asarray(body.model.X)[:n], np.asarray(body.model.Y)[:n]
    return optimal_recovery.feasible_set(X, Y, body.model.hyper, i, body.norm, float(body.label_error[i]))


def prior_mean(body: BodyModel) -> Matrix:
    """Return the constant prior mean of each output.

    Args:
        body: Body along a path.

    Returns:
        `(outputs,)` [N, N m].
    """
    return np.asarray(body.model.hyper.constant_mean, dtype=float)


def max_error(body: BodyModel) -> Matrix:
    """Compute `|m - mu| + beta sigma`, a bound of `|f~|` of each output along the path.

    Args:
        body: Body along a path.

    Returns:
        `(path, outputs)` [N, N m].
    """
    difference = np.abs(mean_difference(body))
    diagonal = [np.diagonal(covariance(body.bound_posterior, i, body.x)) for i in range(len(body.beta))]
    return difference + body.beta * np.sqrt(np.maximum(np.stack(diagonal, axis=1), 0.0))


def mean_difference(body: BodyModel) -> Matrix:
    """Compute the difference `m - mu` of the means of bound posterior and model along the path.

    Args:
        body: Body along a path.

    Returns:
        `(path, outputs)` [N, N m].
    """
    return mean(body.bound_posterior, body.x) - mean(body.model, body.x)


def mean(model: gp.GPPosterior, x: Matrix) -> Matrix:
    """Compute the posterior mean along a path (host).

    Args:
        model: Posterior.
        x: Inputs, `(path, dimensions)`.

    Returns:
        `(path, outputs)` [N, N m].
    """
    n, offset = int(model.num_points), np.asarray(model.hyper.constant_mean)
    s, alpha, X = np.asarray(model.hyper.signal_variance), np.asarray(model.alpha), np.asarray(model.X)[:n]
    return np.stack([offset[i] + s[i] * correlation(model, i, x, X) @ alpha[i, :n] for i in range(len(offset))], axis=1)


def covariance(model: gp.GPPosterior, i: int, x: Matrix) -> Matrix:
    """Compute the posterior covariance of one output along a path.

    Args:
        model: Posterior.
        i: Index of the output.
        x: Inputs, `(path, dimensions)`.

    Returns:
        `(path, path)`.
    """
    n, s = int(model.num_points), float(np.asarray(model.hyper.signal_variance)[i])
    V = np.asarray(model.inverse_cholesky)[i, :n, :n] @ (s * correlation(model, i, np.asarray(model.X)[:n], x))
    return s * correlation(model, i, x, x) - V.T @ V


def correlation(model: gp.GPPosterior, i: int, x: Matrix, z: Matrix) -> Matrix:
    """Compute the prior correlations of one output between two sets of inputs.

    Args:
        model: Posterior.
        i: Index of the output.
        x: Inputs, `(N, dimensions)`.
        z: Inputs, `(M, dimensions)`.

    Returns:
        `(N, M)`.
    """
    ls = np.asarray(model.hyper.lengthscales)[i]
    return likelihood.kernel_matrix(model.hyper.kernel, x / ls, z / ls)


def gradient(model: gp.GPPosterior, i: int, x: Matrix) -> Matrix:
    """Compute the gradient of one output's posterior mean.

    Args:
        model: Posterior.
        i: Index of the output.
        x: Inputs, `(times, dimensions)`.

    Returns:
        `(times, dimensions)`.
    """
    n, s = int(model.num_points), float(np.asarray(model.hyper.signal_variance)[i])
    return s * np.einsum("tnd,n->td", kernel_gradient(model, i, x), np.asarray(model.alpha)[i, :n])


def kernel_gradient(model: gp.GPPosterior, i: int, x: Matrix) -> Matrix:
    """Compute `dk(x, X) / dx` for the squared exponential correlation of one output.

    Args:
        model: Posterior with data X.
        i: Index of the output.
        x: Inputs, `(times, dimensions)`.

    Returns:
        `(times, n, dimensions)`.
    """
    X, ls = np.asarray(model.X)[: int(model.num_points)], np.asarray(model.hyper.lengthscales)[i]
    return -correlation(model, i, x, X)[:, :, None] * (x[:, None] - X) / ls**2
