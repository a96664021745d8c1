"""How far the unknown of a run may be from that along its twin's path, and what that adds.

The unknown is bounded along one path; the run takes another, near it, because of the unknown. To first order in how
far it is, `f~_i(run) - f~_i(twin) = grad f~_i . dphi`, phi what the models see, dphi what f~ brought about before; the
slope is known to norm and data. What f~ on the twin's path makes of dphi is one functional of it and has an ellipsoid;
the rest comes of the differences themselves: `d(t) <= own(t) + sum_(s <= t) M(t, s) d(s)`, solved forward in time.
Derivation: `docs/certificate.md`, "The tube".
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


ITERATIONS = 100  # of a cell's own part, which is small
MAX_DEVIATION_RATIO = (
    1e3  # times what f~ on the path makes of them: where differences are beyond, no tube is said to hold the run
)


@dataclasses.dataclass(frozen=True)
class Tube:
    """The tube around the path: what f~ of any run in it may differ by from that of the path."""

    residual_deviation: Matrix  # (path, inputs), N and N m
    contraction: float  # spectral radius of `sup_t sum_s M(t, s)`: how strongly the unknown feeds itself

    def deviation(self, L: Matrix) -> Matrix:
        """What the difference adds to rows, at most, `sum_k |L_k| d_k`, (times, rows).

        L: (times, rows, path, inputs).
        """
        return np.einsum("trki,ki->tr", np.abs(L), self.residual_deviation)


def feature_jacobian(x: Matrix, L: Matrix) -> Matrix:
    """`(times, features, ...)` of the payload's models, from `(times, 18, ...)` of p, v, R and omega along x.

    The two speeds they see besides are taken to first order: `d|v| = v . dv / |v|`.
    """
    speeds = []
    for part in (slice(3, 6), slice(15, 18)):
        v = x[:, part]
        along = v / np.maximum(np.linalg.norm(v, axis=1), 1e-9)[:, None]
        speeds.append(np.einsum("td,td...->t...", along, L[:, part])[:, None])
    return np.concatenate([L, *speeds], axis=1)


def gradient_bounds(body: BodyModel, i: int, x: Matrix, P: Matrix) -> tuple[Matrix, Matrix]:
    """`(S, g)`: `|grad f~_i(x) . n| <= |S n| + |g . n|` for every n, at points x of as many times.

    x: (times, features); P: (times, features, features), of displacements for which this is to be narrow, see
    `ellipsoids`. `S^T S` is the covariance of what norm and data allow of the slope, g its centre less the slope of mu.
    """
    allowed, k = reachability.feasible_set(body, i), reachability.kernel_gradient(body.model, i, x)
    square = np.diag(np.asarray(body.model.hyper.lengthscales)[i] ** -2.0)
    along = _root(P)
    held = ellipsoid.minimize_width(allowed, k @ along, ((square @ along) * along).sum((1, 2)))
    S = allowed.unit * np.swapaxes(_root(held.covariance(k, square)), 1, 2)
    return S, allowed.unit * held.center(k) - reachability.gradient(body.model, i, x)


def _root(P: Matrix) -> Matrix:
    """R with `R R^T = P`, for P that are not negative but for rounding."""
    U, w, _ = np.linalg.svd(P)  # not eigh, which may fail where eigenvalues come in clusters
    return U * np.sqrt(w)[:, None]


def ellipsoids(held: Sequence[BodyModel], L: Sequence[Matrix]) -> list[tuple[Matrix, Matrix]]:
    """`(P, c)` of each body: what f~ on the path makes of its dphi.

    It is c and a part of each input, `|n . part_j| <= sqrt(n^T P_j n)` for every n.
    L, a body each: (times, features, path, inputs), what f~ at a sample of the path, or of its start, adds to a
    feature. P: (inputs, times, features, features); c: (times, features). Of an input and a time all bodies' features
    share one ellipsoid, narrow where they are taken in length-scales.
    """
    times, _, end, inputs = L[0].shape
    out = [(np.zeros((inputs, times, of.shape[1], of.shape[1])), np.zeros((times, of.shape[1]))) for of in L]
    each = [np.sqrt((np.asarray(body.model.hyper.lengthscales) ** -2.0).mean(0)) for body in held]
    for body in held:
        off = reachability.prior_mean(body) - reachability.mean(body.model, body.x[:end])
        for i in range(len(body.beta)):
            j, allowed = body.columns.start + i, reachability.feasible_set(body, i)
            C = reachability.low_rank_factor(reachability.correlation(body.model, i, body.x[:end], body.x[:end]))
            X = allowed.correlations(body.x[:end])
            rows = [np.ascontiguousarray(of[..., j]) for of in L]
            k = [np.swapaxes(of @ X.T, 1, 2) for of in rows]
            square = [C.products(of) for of in rows]
            taken = np.concatenate([of * size for of, size in zip(k, each, strict=True)], axis=2)
            trace = sum(np.einsum("tff,f->t", of, size**2) for of, size in zip(square, each, strict=True))
            around = ellipsoid.minimize_width(allowed, taken, np.asarray(trace))
            for (P, c), of, k_of, square_of in zip(out, rows, k, square, strict=True):
                P[j] = allowed.unit**2 * around.covariance(k_of, square_of)
                c += allowed.unit * around.center(k_of) + of @ off[:, i]
    return out


def direct_term(S: Matrix, g: Matrix, P: Matrix, c: Matrix) -> Matrix:
    """The greatest `|S dphi| + |g . dphi|`, (times,), for dphi in the `ellipsoids` (P, c).

    `|S c| + sum_j sqrt(lambda_max(X_j)) + ...` with `X_j = S P_j S^T` and `lambda_max(X) <= (tr X^8)^(1/8)`.
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
    """`|S L_k| + |g . L_k|`, (times, path, inputs); L: (times, features, path, inputs)."""
    flat = L.reshape(*L.shape[:2], -1)
    each = np.sqrt(((S @ flat) ** 2).sum(1)) + np.abs((g[:, None] @ flat)[:, 0])
    return each.reshape(len(L), *L.shape[2:])


def solve_tube(M: Matrix, own: Matrix) -> tuple[Matrix, float]:
    """`d(t) = own(t) + sum_(s <= t) M(t, s) d(s)` of cells, and the contraction, spectral radius of `sup_t sum_s M`.

    M: (times, inputs, times, inputs), cell s ends at time s; own: (times, inputs). Of a cell, the greater of those at
    its ends. Raises ValueError where it grows beyond bounds: then no tube holds the run.
    """
    contraction = float(np.abs(np.linalg.eigvals(M.sum(2).max(0))).max())
    d = np.zeros_like(own)  # of a cell
    at = np.zeros(own.shape[1])  # at its start
    for t in range(len(own)):
        known = own[t] + np.einsum("isj,sj->i", M[t, :, :t], d[:t])
        end = known
        for _ in range(ITERATIONS):
            before, end = end, known + M[t, :, t] @ np.maximum(at, end)
            if np.allclose(before, end, rtol=1e-9, atol=0) and (end <= MAX_DEVIATION_RATIO * own.max()).all():
                break
        else:
            raise ValueError(
                f"no tube holds the run: the unknown may vary so fast that it feeds itself, by a factor of "
                f"{contraction:.3g}; state a smaller norm or longer length-scales, or raise the gains"
            )
        d[t], at = np.maximum(at, end), end
    return d, contraction
