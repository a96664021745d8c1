"""How far the unknown of a run may be from that along its twin's path, and what that adds.

The unknown is bounded along one path; the run takes another, near it, because of the unknown. To first order in how
far it is, `f~_i(run) - f~_i(twin) = grad f~_i . dphi`, phi what the models see, dphi what f~ brought about before; the
slope is known to norm and data. What f~ on the twin's path makes of dphi is one functional of it and has a band; the
rest comes of the differences themselves: `d(t) <= own(t) + sum_(s <= t) M(t, s) d(s)`, solved forward in time. What
they change by from node to node obeys the same with other gains; by that less of a response that swings adds up.
Derivation: `docs/certificate.md`, "The tube".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from colift.certify import reach
from colift.certify.reach import Body

Matrix = NDArray[np.float64]


ITERATIONS = 100  # of a cell's own part, which is small
FAR = 1e3  # times what f~ on the path makes of them: where differences are beyond, no tube is said to hold the run


@dataclasses.dataclass(frozen=True)
class Tube:
    """The tube around the path: what f~ of any run in it may differ by from that of the path."""

    difference: Matrix  # (path, inputs), N and N m
    change: Matrix  # (path, inputs), of that the greatest `|d_k - keep d_(k-1)|` from node to node; or infinite
    keep: float
    contraction: float  # spectral radius of `sup_t sum_s M(t, s)`: how strongly the unknown feeds itself

    def reached(self, L: Matrix) -> Matrix:
        """What the difference adds to rows, at most, (times, rows); L: (times, rows, path, inputs).

        Of each input the lesser of `sum_k |L_k| d_k` and, if changes are bounded, the same with `later` and these.
        """
        by_size = np.einsum("trki,ki->tri", np.abs(L), self.difference)
        if np.isinf(self.change).any():
            return by_size.sum(2)
        return np.minimum(by_size, np.einsum("trki,ki->tri", np.abs(later(L, self.keep)), self.change)).sum(2)


def seen(x: Matrix, L: Matrix) -> Matrix:
    """`(times, features, ...)` of the payload's models, from `(times, 18, ...)` of p, v, R and omega along x.

    The two speeds they see besides are taken to first order: `d|v| = v . dv / |v|`.
    """
    speeds = []
    for part in (slice(3, 6), slice(15, 18)):
        v = x[:, part]
        along = v / np.maximum(np.linalg.norm(v, axis=1), 1e-9)[:, None]
        speeds.append(np.einsum("td,td...->t...", along, L[:, part])[:, None])
    return np.concatenate([L, *speeds], axis=1)


def later(L: Matrix, keep: float) -> Matrix:
    """`b_k = L_k + keep b_(k+1)` along the third axis, with which `sum_k L_k d_k = sum_k b_k (d_k - keep d_(k-1))`."""
    b = L.copy()
    for k in reversed(range(L.shape[2] - 1)):
        b[:, :, k] += keep * b[:, :, k + 1]
    return b


def slopes(body: Body, i: int, points: Sequence[Matrix]) -> tuple[Matrix, Matrix]:
    """`(S, g)`: `|sum_p grad f~_i(x_p) . n_p| <= |S n| + |g . n|`, n the n_p one behind the other, for times at once.

    points: each (times, features). `S^T S = beta^2 d d' k_n`, the posterior covariance of the gradients; g those of
    `m - mu`.
    """
    C = np.block([[reach.gradient_covariance(body.companion, i, x, z) for z in points] for x in points])
    _, w, V = np.linalg.svd(C)  # not eigh, which may fail where eigenvalues come in clusters, as at points so near
    S = body.beta[i] * np.sqrt(w)[:, :, None] * V
    g = [reach.gradient(body.companion, i, x) - reach.gradient(body.model, i, x) for x in points]
    return S, np.concatenate(g, axis=1)


def ellipsoids(held: Sequence[Body], L: Matrix) -> tuple[Matrix, Matrix]:
    """`(P, c)`: what f~ on the path makes of dphi is c and a part of each input, `|n . part_j| <= sqrt(n^T P_j n)`.

    L: (times, features, path, inputs), what f~ at a sample of the path, or of its start, adds to a feature. P: (inputs,
    times, features, features), `beta^2 L k_n L^T`; c: (times, features), `L (m - mu)`.
    """
    end = L.shape[2]
    P, c = np.zeros((L.shape[3], *L.shape[:2], L.shape[1])), np.zeros(L.shape[:2])
    for body in held:
        shift = reach.shift(body)[:end]
        for i in range(len(body.beta)):
            j = body.columns.start + i
            of = np.ascontiguousarray(L[..., j])
            K = body.beta[i] ** 2 * reach.covariance(body.companion, i, body.x[:end])
            P[j] = (of.reshape(-1, end) @ K).reshape(of.shape) @ np.swapaxes(of, 1, 2)
            c += of @ shift[:, i]
    return P, c


def own(S: Matrix, g: Matrix, P: Matrix, c: Matrix) -> Matrix:
    """The greatest `|S dphi| + |g . dphi|`, (times,), for dphi in the `ellipsoids` (P, c).

    `|S c| + sum_j sqrt(lambda_max(X_j)) + ...` with `X_j = S P_j S^T` and `lambda_max(X) <= (tr X^8)^(1/8)`.
    """
    along = np.abs((g * c).sum(1)) + np.sqrt(np.maximum(((P @ g[:, :, None])[..., 0] * g).sum(-1), 0)).sum(0)
    X = S @ P @ np.swapaxes(S, 1, 2)
    size = np.maximum(np.trace(X, axis1=2, axis2=3), np.finfo(float).tiny)
    X = X / size[..., None, None]
    X = X @ X
    greatest = size * np.linalg.norm(X @ X, axis=(2, 3)) ** 0.25
    across = np.linalg.norm((S @ c[:, :, None])[..., 0], axis=1) + np.sqrt(greatest).sum(0)
    return along + across


def feeding(S: Matrix, g: Matrix, L: Matrix) -> Matrix:
    """`|S L_k| + |g . L_k|`, (times, path, inputs); L: (times, features, path, inputs)."""
    flat = L.reshape(*L.shape[:2], -1)
    each = np.sqrt(((S @ flat) ** 2).sum(1)) + np.abs((g[:, None] @ flat)[:, 0])
    return each.reshape(len(L), *L.shape[2:])


def solve(M: Matrix, own: Matrix) -> tuple[Matrix, float]:
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
            if np.allclose(before, end, rtol=1e-9, atol=0) and (end <= FAR * own.max()).all():
                break
        else:
            raise ValueError(
                f"no tube holds the run: the unknown may vary so fast that it feeds itself, by a factor of "
                f"{contraction:.3g}; state a smaller norm or longer length-scales, or raise the gains"
            )
        d[t], at = np.maximum(at, end), end
    return d, contraction
