"""How far the unknown of a run may be from that along its twin's path, and what that adds.

The unknown is bounded along one path; the run takes another, near it, because of the unknown. To first order in how
far it is, `f~_i(run) - f~_i(twin) = grad f~_i . dphi`, phi what the models see, dphi what f~ brought about before; the
slope is known to norm and data. So the differences obey `d(t) <= sum_(s <= t) M(t, s) (rho(s) + d(s))`, which is solved
forward in time. Derivation: `docs/certificate.md`, "The tube".
"""

from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from colift.certify import reach
from colift.certify.reach import Body

Matrix = NDArray[np.float64]


ITERATIONS = 100  # of a cell's own part, which is small
FAR = 1e3  # times what f~ is on the path: where differences are beyond, no tube is said to hold the run


@dataclasses.dataclass(frozen=True)
class Tube:
    """The tube around the path: what f~ of any run in it may differ by from that of the path."""

    difference: Matrix  # (path, inputs), N and N m
    contraction: float  # spectral radius of `sup_t sum_s M(t, s)`: how strongly the unknown feeds itself


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


def slopes(body: Body, i: int, x: Matrix) -> tuple[Matrix, Matrix]:
    """`(S, g)`: `|grad f~_i . dphi| <= |S dphi| + |g . dphi|` at points x, (times, features, features) and without one.

    `S^T S = beta^2 d d' k_n`, the posterior covariance of the gradient; g the gradient of `m - mu`.
    """
    covariance = reach.gradient_covariance(body.companion, i, x)
    w, V = np.linalg.eigh(covariance)
    S = body.beta[i] * np.sqrt(np.maximum(w, 0))[:, :, None] * np.swapaxes(V, 1, 2)
    return S, reach.gradient(body.companion, i, x) - reach.gradient(body.model, i, x)


def feeding(body: Body, x: Matrix, L: Matrix, cells: NDArray[np.intp]) -> Matrix:
    """`M`, (times, outputs, cells, inputs): `sum_(k in cell) |grad f~_i . dphi(t) / df~_j(k)|`.

    x: (times, features); L: (times, features, path, inputs), what f~ at a sample of the path adds to a feature; cells:
    where each begins.
    """
    out = np.empty((len(x), len(body.beta), len(cells), L.shape[3]))
    flat = L.reshape(*L.shape[:2], -1)
    for i in range(len(body.beta)):
        S, g = slopes(body, i, x)
        each = np.sqrt(((S @ flat) ** 2).sum(1)) + np.abs((g[:, None] @ flat)[:, 0])
        out[:, i] = np.add.reduceat(each.reshape(len(x), *L.shape[2:]), cells, axis=1)
    return out


def solve(M: Matrix, rho: Matrix) -> Tube:
    """`d(t) = sum_(s <= t) M(t, s) (rho(s) + d(s))`; M: (times, inputs, times, inputs), cell s ends at time s.

    rho: (times, inputs), the greatest `|f~|` of a cell. Difference: of a cell, the greater of those at its ends.
    Raises ValueError where it grows beyond bounds: then no tube holds the run.
    """
    contraction = float(np.abs(np.linalg.eigvals(M.sum(2).max(0))).max())
    d = np.zeros_like(rho)  # of a cell
    at = np.zeros(rho.shape[1])  # at its start
    for t in range(len(rho)):
        known = np.einsum("isj,sj->i", M[t, :, :t], rho[:t] + d[:t]) + M[t, :, t] @ rho[t]
        end = known
        for _ in range(ITERATIONS):
            before, end = end, known + M[t, :, t] @ np.maximum(at, end)
            if np.allclose(before, end, rtol=1e-9, atol=0) and (end <= FAR * rho.max()).all():
                break
        else:
            raise ValueError(
                f"no tube holds the run: the unknown may vary so fast that it feeds itself, by a factor of "
                f"{contraction:.3g}; state a smaller norm or longer length-scales, or raise the gains"
            )
        d[t], at = np.maximum(at, end), end
    return Tube(difference=d, contraction=contraction)
