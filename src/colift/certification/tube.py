"""Tube around the nominal trajectory: deviation of a run's residual from that along the nominal path, and its effect.

The residual is bounded along the nominal path, and a run takes another path because of the residual. To first order,
`f~_i(run) - f~_i(nominal) = grad f~_i . dphi`, with the displacement dphi of the model inputs due to earlier f~. Norm
and data bound the gradient. The effect of f~ on the nominal path is one functional and lies in an ellipsoid. The rest
follows from the differences themselves: `d(t) <= direct(t) + sum_(s <= t) M(t, s) d(s)`, solved forward in time.

See Also:
    docs/certificate.md: Derivation, section "The tube".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from colift.certification import reachability
from colift.certification.reachability import BodyModel
from colift.gp import ellipsoid

Matrix = NDArray[np.float64]


MAX_CELL_ITERATIONS = 100  # fixed-point iterations of the implicit part of a cell
MAX_DEVIATION_RATIO = 1e3  # ratio of deviation and direct term above which the tube counts as unbounded


@dataclasses.dataclass(frozen=True)
class Tube:
    """Bound of the residual's deviation between any run in the tube and the nominal path.

    Attributes:
        residual_deviation: Bound of the deviation at each point of the path, `(path, inputs)` [N, N m].
        contraction: Spectral radius of `sup_t sum_s M(t, s)`, the gain of the feedback through the residual.
    """

    residual_deviation: Matrix
    contraction: float

    def deviation(self, L: Matrix) -> Matrix:
        """Return the largest effect of the deviation on some outputs, `sum_k |L_k| d_k`.

        Args:
            L: Weights, `(times, rows, path, inputs)`.

        Returns:
            `(times, rows)`.
        """
        return np.einsum("trki,ki->tr", np.abs(L), self.residual_deviation)


def feature_jacobian(x: Matrix, L: Matrix) -> Matrix:
    """Map displacements of p, v, R and omega of the payload to displacements of its model inputs.

    The two speeds among the inputs are linearized, `d|v| = v . dv / |v|`.

    Args:
        x: Model inputs along the path, `(times, features)`.
        L: Displacements of the payload state, `(times, 18, ...)`.

    Returns:
        `(times, features, ...)`.
    """
    speeds = []
    for part in (slice(3, 6), slice(15, 18)):
        v = x[:, part]
        along = v / np.maximum(np.linalg.norm(v, axis=1), 1e-9)[:, None]
        speeds.append(np.einsum("td,td...->t...", along, L[:, part])[:, None])
    return np.concatenate([L, *speeds], axis=1)


def gradient_bounds(body: BodyModel, i: int, x: Matrix, P: Matrix) -> tuple[Matrix, Matrix]:
    """Compute `(S, g)` with `|grad f~_i(x) . n| <= |S n| + |g . n|` for every n.

    `S^T S` is the covariance of the gradients that norm and data allow; g is their center minus the gradient of mu.

    Args:
        body: Body along a path.
        i: Index of the output.
        x: Points at each time, `(times, features)`.
        P: Displacements for which the bound is to be tight, `(times, features, features)`; see `ellipsoids`.

    Returns:
        S `(times, features, features)` and g `(times, features)`.
    """
    feasible, k = reachability.feasible_set(body, i), reachability.kernel_gradient(body.model, i, x)
    square = np.diag(np.asarray(body.model.hyper.lengthscales)[i] ** -2.0)
    along = _matrix_root(P)
    ellipsoid_set = ellipsoid.minimize_width(feasible, k @ along, ((square @ along) * along).sum((1, 2)))
    S = feasible.unit * np.swapaxes(_matrix_root(ellipsoid_set.covariance(k, square)), 1, 2)
    return S, feasible.unit * ellipsoid_set.center(k) - reachability.gradient(body.model, i, x)


def _matrix_root(P: Matrix) -> Matrix:
    """Return R with `R R^T = P` for P that is positive semidefinite up to rounding."""
    U, w, _ = np.linalg.svd(P)  # eigh may fail for clustered eigenvalues
    return U * np.sqrt(w)[:, None]


def ellipsoids(bodies: Sequence[BodyModel], L: Sequence[Matrix]) -> list[tuple[Matrix, Matrix]]:
    """Compute ellipsoids of the displacement dphi of each body due to f~ on the nominal path.

    dphi is c plus a part of each input j with `|n . part_j| <= sqrt(n^T P_j n)` for every n. For one input and time,
    the features of all bodies share an ellipsoid that is tight in units of length-scales.

    Args:
        bodies: Bodies along the nominal path.
        L: Effect of f~ at each point of the path on the features of each body, `(times, features, path, inputs)`.

    Returns:
        P `(inputs, times, features, features)` and c `(times, features)` of each body.
    """
    times, _, end, inputs = L[0].shape
    out = [
        (np.zeros((inputs, times, weights.shape[1], weights.shape[1])), np.zeros((times, weights.shape[1])))
        for weights in L
    ]
    each = [np.sqrt((np.asarray(body.model.hyper.lengthscales) ** -2.0).mean(0)) for body in bodies]
    for body in bodies:
        difference = reachability.prior_mean(body) - reachability.mean(body.model, body.x[:end])
        for i in range(len(body.beta)):
            j, feasible = body.columns.start + i, reachability.feasible_set(body, i)
            C = reachability.low_rank_factor(reachability.correlation(body.model, i, body.x[:end], body.x[:end]))
            X = feasible.correlations(body.x[:end])
            rows = [np.ascontiguousarray(weights[..., j]) for weights in L]
            k = [np.swapaxes(weights @ X.T, 1, 2) for weights in rows]
            squared_norm = [C.products(weights) for weights in rows]
            scaled = np.concatenate([weights * size for weights, size in zip(k, each, strict=True)], axis=2)
            trace = sum(
                np.einsum("tff,f->t", weights, size**2) for weights, size in zip(squared_norm, each, strict=True)
            )
            ellipsoid_set = ellipsoid.minimize_width(feasible, scaled, np.asarray(trace))
            for (P, c), weights, k_of, square_of in zip(out, rows, k, squared_norm, strict=True):
                P[j] = feasible.unit**2 * ellipsoid_set.covariance(k_of, square_of)
                c += feasible.unit * ellipsoid_set.center(k_of) + weights @ difference[:, i]
    return out


def direct_term(S: Matrix, g: Matrix, P: Matrix, c: Matrix) -> Matrix:
    """Compute the largest `|S dphi| + |g . dphi|` for dphi in the ellipsoids (P, c).

    The bound is `|S c| + sum_j sqrt(lambda_max(X_j)) + ...` with `X_j = S P_j S^T` and
    `lambda_max(X) <= (tr X^8)^(1/8)`.

    Args:
        S: See `gradient_bounds`.
        g: See `gradient_bounds`.
        P: See `ellipsoids`.
        c: See `ellipsoids`.

    Returns:
        `(times,)`, in the unit of the output.
    """
    along = np.abs((g * c).sum(1)) + np.sqrt(np.maximum(((P @ g[:, :, None])[..., 0] * g).sum(-1), 0)).sum(0)
    X = S @ P @ np.swapaxes(S, 1, 2)
    size = np.maximum(np.trace(X, axis1=2, axis2=3), 0.0)
    X = X / np.where(size > 0, size, np.inf)[..., None, None]
    X = X @ X
    greatest = size * np.linalg.norm(X @ X, axis=(2, 3)) ** 0.25
    across = np.linalg.norm((S @ c[:, :, None])[..., 0], axis=1) + np.sqrt(greatest).sum(0)
    return along + across


def feedback_matrix(S: Matrix, g: Matrix, L: Matrix) -> Matrix:
    """Compute `|S L_k| + |g . L_k|`, the gain from a deviation at point k to the deviation of an output.

    Args:
        S: See `gradient_bounds`.
        g: See `gradient_bounds`.
        L: Effect of f~ on the features, `(times, features, path, inputs)`.

    Returns:
        `(times, path, inputs)`.
    """
    flat = L.reshape(*L.shape[:2], -1)
    each = np.sqrt(((S @ flat) ** 2).sum(1)) + np.abs((g[:, None] @ flat)[:, 0])
    return each.reshape(len(L), *L.shape[2:])


def solve_tube(M: Matrix, direct_term: Matrix) -> tuple[Matrix, float]:
    """Solve `d(t) = direct(t) + sum_(s <= t) M(t, s) d(s)` on time cells.

    The deviation of a cell is the larger one of its ends.

    Args:
        M: `(times, inputs, times, inputs)`; cell s ends at time s.
        direct_term: Direct terms, `(times, inputs)`.

    Returns:
        The deviation of each cell, and the contraction, the spectral radius of `sup_t sum_s M`.

    Raises:
        ValueError: If the deviation exceeds all limits, so that no tube exists.
    """
    contraction = float(np.abs(np.linalg.eigvals(M.sum(2).max(0))).max())
    d = np.zeros_like(direct_term)  # of each cell
    at = np.zeros(direct_term.shape[1])  # at the start of the cell
    for t in range(len(direct_term)):
        known = direct_term[t] + np.einsum("isj,sj->i", M[t, :, :t], d[:t])
        end = known
        for _ in range(MAX_CELL_ITERATIONS):
            previous, end = end, known + M[t, :, t] @ np.maximum(at, end)
            if np.allclose(previous, end, rtol=1e-9, atol=0) and (end <= MAX_DEVIATION_RATIO * direct_term.max()).all():
                break
        else:
            raise ValueError(
                f"no tube exists: deviations amplify themselves through the residual's gradient, by a factor of "
                f"{contraction:.3g}; state a smaller norm or longer length-scales, or increase the gains"
            )
        d[t], at = np.maximum(at, end), end
    return d, contraction
