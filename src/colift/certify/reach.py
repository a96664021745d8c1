"""Which errors of the payload the unknown forces can bring about, given what norm and data allow of them.

An error at time t is one linear functional of the unknown, `sum_s h(t - s) f~(q(s))`, with h the response of the
closed loop: bounded as a whole it is smaller than the gain times the greatest `|f~|`. Derivation:
`docs/certificate.md`, "The team's loop and the unknown as one functional".
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.spatial.distance import cdist

from colift import gp
from colift.gp import recovery
from colift.response import Response

Matrix = NDArray[np.float64]

NEGLIGIBLE = 1e-3  # share of a row's bound below which an output keeps its band instead of a conic program


@dataclasses.dataclass(frozen=True)
class Body:
    """One body's unknown outputs along the path, and what bounds them."""

    columns: slice  # of the response's inputs
    model: gp.GP  # whose mean is compensated
    companion: gp.GP  # the posterior in which its band is stated, see `colift.band`
    beta: Matrix  # (outputs,)
    norm: float  # B
    eps: Matrix  # (outputs,), unit of y
    x: Matrix  # (path, dimensions), what the models see along the path


def impulse(response: Response, rows: Matrix, step: float, count: int) -> Matrix:
    """`H_m`, (count, rows, inputs): what f~ at sample k, held from half a step before to half a step after, adds at k + m.

    rows: (rows, states) and direct term behind it, `[C D]`.
    """
    n = len(response.A)
    both = np.zeros((n + response.B.shape[1],) * 2)
    both[:n] = np.hstack([response.A, response.B]) * (step / 2)
    both = expm(both)
    A, B, C, D = both[:n, :n], both[:n, n:], rows[:, :n], rows[:, n:]
    halves = np.empty((2 * count - 1, len(rows), B.shape[1]))
    for k in range(len(halves)):
        halves[k] = C @ B
        B = A @ B
    H = np.empty((count, *halves.shape[1:]))
    H[0] = halves[0] + D
    H[1:] = halves[1::2] + halves[2::2]
    return H


def weights(H: Matrix, at: Sequence[int], path: int) -> Matrix:
    """`L[t, row, k] = H[t - k, row]`, zero for later samples: weights of the path's samples at output samples `at`."""
    lag = np.asarray(at)[:, None] - np.arange(path)[None]
    L = np.where((lag >= 0)[:, :, None], H[np.clip(lag, 0, len(H) - 1)], 0.0)
    return np.ascontiguousarray(np.swapaxes(L, 1, 2))


def by_band(body: Body, H: Matrix, at: Sequence[int]) -> Matrix:
    """`(2, times, rows, outputs)`: bounds of each output's contribution and of its negative, by the body's band.

    `|l(f - mu)| <= |l(m - mu)| + beta sigma(l)` with m and sigma the companion's (see `colift.gp.bounds.energy`: the
    bound is on `|f - m|` in the posterior's space, hence on every functional).
    """
    found = np.empty((2, len(at), H.shape[1], len(body.beta)))
    shift = _mean(body.companion, body.x) - _mean(body.model, body.x)
    for i in range(len(body.beta)):
        L = weights(H[:, :, body.columns.start + i], at, len(body.x))
        S = _covariance(body.companion, i, body.x)
        width = body.beta[i] * np.sqrt(np.maximum(np.sum((L @ S) * L, axis=-1), 0.0))
        moved = L @ shift[:, i]
        found[0, ..., i], found[1, ..., i] = moved + width, width - moved
    return found


def by_recovery(
    body: Body, H: Matrix, at: Sequence[int], every: int, band: Matrix, progress: Callable[[], None] = lambda: None
) -> Matrix:
    """`(2, times, rows, outputs)` as `by_band`, by optimal recovery: a conic program at every so many of the times.

    In between, the multipliers are interpolated: any prove a bound. Never above `band`, that of `by_band`, which stays
    where an output contributes next to nothing. Raises as `gp.recovery.recover`.
    """
    found, path = band.copy(), len(body.x)
    anchors = sorted({*range(0, len(at), every), len(at) - 1})
    n, total = int(body.model.n), band.sum(-1).max((0, 1))
    mu = _mean(body.model, body.x)
    for i in range(len(body.beta)):
        matters = [row for row in range(H.shape[1]) if band[..., row, i].max() > NEGLIGIBLE * total[row]]
        if not matters:
            continue
        X, Y = np.asarray(body.model.X)[:n], np.asarray(body.model.Y)[:n]
        allowed = recovery.consistent(X, Y, body.model.hyper, i, body.norm, float(body.eps[i]))
        offset = float(np.asarray(body.model.hyper.offset)[i])
        K, C = allowed.correlations(body.x), _correlation(body.model, i, body.x, body.x)
        L = weights(H[:, :, body.columns.start + i], at, path)
        for row in matters:
            k, square = K @ L[:, row].T, np.sum((L[:, row] @ C) * L[:, row], axis=1)
            centre = L[:, row] @ (mu[:, i] - offset)
            for side, sign in enumerate((1, -1)):
                nu = np.stack([recovery.greatest(allowed, sign * k[:, a], square[a]).nu for a in anchors], axis=1)
                nu = np.stack([np.interp(np.arange(len(at)), anchors, each) for each in nu])
                value = recovery.above(allowed, nu, sign * k, square) - sign * centre
                found[side, :, row, i] = np.minimum(value, band[side, :, row, i])
        progress()
    return found


def _mean(model: gp.GP, x: Matrix) -> Matrix:
    """`(path, outputs)`."""
    n, offset = int(model.n), np.asarray(model.hyper.offset)
    s, alpha, X = np.asarray(model.hyper.signal_variance), np.asarray(model.alpha), np.asarray(model.X)[:n]
    return np.stack(
        [offset[i] + s[i] * _correlation(model, i, x, X) @ alpha[i, :n] for i in range(len(offset))], axis=1
    )


def _covariance(model: gp.GP, i: int, x: Matrix) -> Matrix:
    """Posterior covariance of output i along the path."""
    n, s = int(model.n), float(np.asarray(model.hyper.signal_variance)[i])
    V = np.asarray(model.W)[i, :n, :n] @ (s * _correlation(model, i, np.asarray(model.X)[:n], x))
    return s * _correlation(model, i, x, x) - V.T @ V


def _correlation(model: gp.GP, i: int, x: Matrix, z: Matrix) -> Matrix:
    ls = np.asarray(model.hyper.lengthscales)[i]
    return np.exp(-0.5 * cdist(x / ls, z / ls, "sqeuclidean"))
