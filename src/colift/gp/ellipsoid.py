"""Ellipsoids that hold every function that norm and data allow, narrow where they are asked (host).

Where every label errs by at most eps, any weights `w_k >= 0` give one:
`||f||^2 + sum_k w_k (r_k - f(x_k))^2 <= 1 + eps^2 sum_k w_k`, f and labels in units of their largest value. The energy
bound has one weight for all labels, so that one of them may err by what all may together. For the greatest value of
one functional the best weights leave what optimal recovery does, whose multipliers they are (S-procedure: nothing is
lost for a linear objective). One ellipsoid for both its ends, or for many functionals, is wider.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from colift.gp.optimal_recovery import INFEASIBLE_MESSAGE, FeasibleSet

ROUNDS, GAIN = 30, 0.01  # at most so many, and no other after one in which fewer than half of the sets gain so much
MAX_INDIVIDUAL_WEIGHTS = 160  # labels beyond which they keep one weight: each round takes the cube of their number
STEP = 0.8  # exponent of a round: below one it does not swing
LEAST, MOST = 1e-12, 1e4  # weights over the energy bound's
MAX_WEIGHT = 1e9  # of a weight: what is inverted is conditioned no worse than this times the number of labels
ROUNDING_MARGIN = 1e-7  # of what the ellipsoid's size is a difference of: above its rounding


@dataclasses.dataclass(frozen=True)
class FunctionalEllipsoids:
    """`(l(f) - centre)^2 <= covariance` for every functional l and every f that norm and data allow; one or many.

    In units of `Consistent.unit`. `Q = (K + V)^-1` to rounding, which widens them: sizes are those of any Q.
    """

    squared_radius: (
        np.ndarray
    )  # (sets,), `(sqrt(1 + eps^2 sum w - r^T Q r) + |V^-1/2 q|)^2`, `q = r - (K + V) a`: rounding
    Q: np.ndarray  # (sets, N, N)
    a: np.ndarray  # (sets, N), `Q r`
    K: np.ndarray  # (N, N), correlations of the data
    v: np.ndarray  # (sets, N), diagonal of V: one over the weights

    def center(self, k: np.ndarray) -> np.ndarray:
        """`(sets, rows)`, `k^T a` of rows of functionals, whose representers' products with the data's are k.

        k: (sets, N, rows), see `recovery.Consistent.correlations`.
        """
        return (np.swapaxes(k, 1, 2) @ self.a[..., None])[..., 0]

    def covariance(self, k: np.ndarray, square: np.ndarray) -> np.ndarray:
        """`(sets, rows, rows)`, `beta^2 (square - k^T A - A^T k + A^T (K + V) A)`, `A = Q k`.

        square: the representers' products with each other. Whatever A, this is no less than with the best.
        """
        A = self.Q @ k
        kA = np.swapaxes(k, 1, 2) @ A
        return self.squared_radius[:, None, None] * (
            square - kA - np.swapaxes(kA, 1, 2) + np.swapaxes(A, 1, 2) @ (self.K @ A + self.v[..., None] * A)
        )


def minimize_width(allowed: FeasibleSet, k: np.ndarray, square: np.ndarray) -> FunctionalEllipsoids:
    """Ellipsoids in which the sum of a set's squared widths, the trace of its covariance, is small.

    k: (sets, N, rows); square: (sets,), the trace of what `Ellipsoids.covariance` has. From the energy bound's
    `w = 1 / (N eps^2)` on each round multiplies `w_k` by `((R_k^2 + beta^2 |G_k|^2 / tr) / eps^2)^STEP`, R what the
    centre leaves of labels and G of k: where that no longer changes w the derivative of `beta^2 tr` is zero. The best
    round counts. Raises ValueError where the data contradict norm and eps.
    """
    n, eps2 = len(allowed.r), allowed.eps**2
    rounds = ROUNDS if n <= MAX_INDIVIDUAL_WEIGHTS else 0
    equal = min(1 / (max(n, 1) * eps2), MAX_WEIGHT)
    w = np.full((len(k) if rounds else 1, n), equal)
    best, least = None, np.inf
    for left in reversed(range(rounds + 1)):
        of = _weighed(allowed, w)
        A = of.Q @ k
        G = k - allowed.K @ A
        trace = np.maximum(square - (A * (k + G - of.v[..., None] * A)).sum((1, 2)), 0.0)
        size = of.squared_radius * trace
        best, gained = of if best is None else _chosen(size < least, of, best), size < (1 - GAIN) * least
        least = np.minimum(size, least)
        if not left or gained.mean() < 0.5:
            break
        R = allowed.r - of.a @ allowed.K
        share = of.squared_radius / np.where(trace > 0, trace, np.inf)
        w = w * ((R * R + share[:, None] * (G * G).sum(2)) / eps2) ** STEP
        w = np.clip(w, LEAST * equal, min(MOST * equal, MAX_WEIGHT))
    assert best is not None
    return best


def _weighed(allowed: FeasibleSet, w: np.ndarray) -> FunctionalEllipsoids:
    """The ellipsoids of weights w, (sets, N)."""
    h, v = np.sqrt(w), 1 / w
    Q = h[:, :, None] * np.linalg.inv(np.eye(w.shape[1]) + h[:, :, None] * allowed.K * h[:, None]) * h[:, None]
    a = Q @ allowed.r
    most, q = 1 + allowed.eps**2 * w.sum(1), allowed.r - a @ allowed.K - v * a
    beta2 = most * (1 + ROUNDING_MARGIN) - (a * (allowed.r + q)).sum(1)
    if (beta2 < 0).any():
        raise ValueError(INFEASIBLE_MESSAGE)
    return FunctionalEllipsoids(
        squared_radius=(np.sqrt(beta2) + np.sqrt((w * q * q).sum(1))) ** 2, Q=Q, a=a, K=allowed.K, v=v
    )


def _chosen(which: np.ndarray, new: FunctionalEllipsoids, old: FunctionalEllipsoids) -> FunctionalEllipsoids:
    """Of each set the new one where `which` says so."""
    return FunctionalEllipsoids(
        squared_radius=np.where(which, new.squared_radius, old.squared_radius),
        Q=np.where(which[:, None, None], new.Q, old.Q),
        a=np.where(which[:, None], new.a, old.a),
        K=new.K,
        v=np.where(which[:, None], new.v, old.v),
    )
