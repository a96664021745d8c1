"""Which errors of the payload the unknown forces can bring about, given what norm and data allow of them.

An error at time t is one linear functional of the unknown, `sum_s h(t, s) f~(q(s))`, with h the response of the
loop along the flight (`certify.variation`): bounded as a whole it is smaller than the gain times the greatest `|f~|`.
Derivation: `docs/certificate.md`, "The team's loop and the unknown as one functional".
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

RANK_TOLERANCE = (
    1e-12  # of the greatest variance along a path, beyond which columns of its factor are bounded, not taken
)
NEGLIGIBLE_SHARE = 1e-3  # share of a row's bound below which an output keeps its band


@dataclasses.dataclass(frozen=True)
class BodyModel:
    """One body's unknown outputs along the path, and what bounds them."""

    columns: slice  # of the response's inputs
    model: gp.GPPosterior  # whose mean is compensated
    bound_posterior: (
        gp.GPPosterior
    )  # the posterior in which its band is stated, see `colift.onboard.learning.confidence_bounds`
    beta: Matrix  # (outputs,)
    norm: float  # B
    label_error: Matrix  # (outputs,), unit of y
    x: Matrix  # (path, dimensions), what the models see along the path


@dataclasses.dataclass(frozen=True)
class LowRankFactor:
    """`L S L^T <= |L R|^2 + (|L| e)^2` for every row L: R of few columns, e the root of the diagonal that it leaves."""

    R: Matrix  # (path, rank)
    e: Matrix  # (path,)

    def squares(self, L: Matrix) -> Matrix:
        """`L S L^T` of rows, at most; L: (..., path)."""
        return np.sum((L @ self.R) ** 2, axis=-1) + (np.abs(L) @ self.e) ** 2

    def products(self, L: Matrix) -> Matrix:
        """`L S L^T`, at most; L: (..., rows, path)."""
        spanned = L @ self.R
        # what is left is no more than its trace times the identity
        return spanned @ np.swapaxes(spanned, -1, -2) + (self.e @ self.e) * (L @ np.swapaxes(L, -1, -2))


def low_rank_factor(S: Matrix) -> LowRankFactor:
    """Cholesky's, with pivots, of a covariance along a path: of smooth functions few columns are more than rounding."""
    # scipy's stubs do not have it
    lower, pivots, rank, _ = lapack.dpstrf(  # ty: ignore[missing-attribute]
        S, tol=RANK_TOLERANCE * np.diagonal(S).max(), lower=1
    )
    R = np.empty((len(S), rank))
    R[pivots - 1] = np.tril(lower)[:, :rank]
    return LowRankFactor(R, np.sqrt(np.maximum(np.diagonal(S) - (R * R).sum(1), 0.0)))


def band_bound(body: BodyModel, weights: Matrix) -> tuple[Matrix, Matrix]:
    """`(l(m - mu), sigma(l))` of each output's contribution l, both `(times, rows, outputs)`, for `bound`.

    weights: (times, rows, path, inputs), what f~ at a sample of the path adds to a row.
    """
    moved, sigma = np.empty((2, *weights.shape[:2], len(body.beta)))
    off = mean_difference(body)
    for i in range(len(body.beta)):
        L = np.ascontiguousarray(weights[..., body.columns.start + i])
        sigma[..., i] = np.sqrt(low_rank_factor(covariance(body.bound_posterior, i, body.x)).squares(L))
        moved[..., i] = L @ off[:, i]
    return moved, sigma


def functional_bound(beta: Matrix, moved: Matrix, sigma: Matrix) -> Matrix:
    """`(2, ...)`: upper bounds of `l(f - mu)` and of its negative, `|l(f - m)| <= beta sigma(l)`.

    m and sigma are the companion's. A bound on `|f - m|` in the posterior's space, as all of `colift.gp.error_bounds` but
    `fiedler_fixed` are, holds for every functional. Infinite where beta is.
    """
    width = np.where(np.isinf(beta), np.inf, beta * sigma)
    return np.stack([width + moved, width - moved])


def recovery_bound(
    body: BodyModel, weights: Matrix, band: Matrix, progress: Callable[[], None] = lambda: None
) -> Matrix:
    """`(2, times, rows, outputs)` as `by_band`, by optimal recovery of every functional (`gp.recovery.least`).

    Never above `band`, that of `by_band`, which stays where an output contributes next to nothing. Raises as that.
    """
    found, total = band.copy(), band.sum(-1).max((0, 1))
    mu = mean(body.model, body.x)
    for i in range(len(body.beta)):
        matters = np.flatnonzero(band[..., i].max((0, 1)) > NEGLIGIBLE_SHARE * total)
        if not len(matters):
            continue
        of = feasible_set(body, i)
        L = weights[..., body.columns.start + i][:, matters].reshape(-1, len(body.x))
        k, square = (
            of.correlations(body.x) @ L.T,
            low_rank_factor(correlation(body.model, i, body.x, body.x)).squares(L),
        )
        mass, centre = np.abs(L).sum(1), L @ (mu[:, i] - prior_mean(body)[i])
        for side, sign in enumerate((1, -1)):
            value = (optimal_recovery.minimize_upper_bounds(of, sign * k, square, mass) - sign * centre).reshape(
                -1, len(matters)
            )
            found[side, ..., i][:, matters] = np.minimum(value, band[side, ..., i][:, matters])
        progress()
    return found


def feasible_set(body: BodyModel, i: int) -> optimal_recovery.FeasibleSet:
    """What norm and data allow of output i. Raises ValueError as `recovery.consistent`."""
    n = int(body.model.num_points)
    X, Y = np.asarray(body.model.X)[:n], np.asarray(body.model.Y)[:n]
    return optimal_recovery.feasible_set(X, Y, body.model.hyper, i, body.norm, float(body.label_error[i]))


def prior_mean(body: BodyModel) -> Matrix:
    """The prior's mean of each output, (outputs,)."""
    return np.asarray(body.model.hyper.constant_mean, dtype=float)


def max_error(body: BodyModel) -> Matrix:
    """`|m - mu| + beta sigma` of each output along the path, (path, outputs): bounds `|f~|` there."""
    off = np.abs(mean_difference(body))
    diagonal = [np.diagonal(covariance(body.bound_posterior, i, body.x)) for i in range(len(body.beta))]
    return off + body.beta * np.sqrt(np.maximum(np.stack(diagonal, axis=1), 0.0))


def mean_difference(body: BodyModel) -> Matrix:
    """`m - mu` of each output along the path, (path, outputs)."""
    return mean(body.bound_posterior, body.x) - mean(body.model, body.x)


def mean(model: gp.GPPosterior, x: Matrix) -> Matrix:
    """`(path, outputs)`, as the model has it."""
    n, offset = int(model.num_points), np.asarray(model.hyper.constant_mean)
    s, alpha, X = np.asarray(model.hyper.signal_variance), np.asarray(model.alpha), np.asarray(model.X)[:n]
    return np.stack([offset[i] + s[i] * correlation(model, i, x, X) @ alpha[i, :n] for i in range(len(offset))], axis=1)


def covariance(model: gp.GPPosterior, i: int, x: Matrix) -> Matrix:
    """Posterior covariance of output i along the path."""
    n, s = int(model.num_points), float(np.asarray(model.hyper.signal_variance)[i])
    V = np.asarray(model.inverse_cholesky)[i, :n, :n] @ (s * correlation(model, i, np.asarray(model.X)[:n], x))
    return s * correlation(model, i, x, x) - V.T @ V


def correlation(model: gp.GPPosterior, i: int, x: Matrix, z: Matrix) -> Matrix:
    """Correlations of output i between samples x and z, (x, z)."""
    ls = np.asarray(model.hyper.lengthscales)[i]
    return likelihood.kernel_matrix(model.hyper.kernel, x / ls, z / ls)


def gradient(model: gp.GPPosterior, i: int, x: Matrix) -> Matrix:
    """`(times, dimensions)`, of output i's mean at points x."""
    n, s = int(model.num_points), float(np.asarray(model.hyper.signal_variance)[i])
    return s * np.einsum("tnd,n->td", kernel_gradient(model, i, x), np.asarray(model.alpha)[i, :n])


def kernel_gradient(model: gp.GPPosterior, i: int, x: Matrix) -> Matrix:
    """`dk(x, X) / dx`, k the squared exponential correlation of output i; (times, n, dimensions)."""
    X, ls = np.asarray(model.X)[: int(model.num_points)], np.asarray(model.hyper.lengthscales)[i]
    return -correlation(model, i, x, X)[:, :, None] * (x[:, None] - X) / ls**2
