"""Ellipsoids that contain all functions allowed by a norm bound and data with bounded noise (host).

If every label error is at most eps, any weights `w_k >= 0` define such an ellipsoid:
`||f||^2 + sum_k w_k (r_k - f(x_k))^2 <= 1 + eps^2 sum_k w_k`, in units of the largest function value. The energy bound
uses one weight for all labels, so that a single error may contain the whole noise energy. For one functional the best
weights reach the value of optimal recovery (S-procedure; no loss for a linear objective). An ellipsoid for both signs
of a functional, or for several functionals, is wider.

See Also:
    docs/bounds.md: Derivation.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from colift.gp.optimal_recovery import INFEASIBLE_MESSAGE, FeasibleSet

MAX_ITERATIONS = 30
MIN_IMPROVEMENT = 0.01  # the iteration stops when fewer than half of the sets improve by this relative amount
MAX_INDIVIDUAL_WEIGHTS = 160  # more labels share one weight: an iteration costs the cube of their number
UPDATE_EXPONENT = 0.8  # values below one prevent oscillation of the iteration
MIN_RELATIVE_WEIGHT, MAX_RELATIVE_WEIGHT = 1e-12, 1e4  # relative to the weight of the energy bound
MAX_WEIGHT = 1e9  # limits the condition number of the inverted matrix to this times the number of labels
ROUNDING_MARGIN = 1e-7  # relative; above the rounding error of the terms whose difference is the radius


@dataclasses.dataclass(frozen=True)
class FunctionalEllipsoids:
    """Sets of ellipsoids `(l(f) - center)^2 <= covariance`, valid for every functional l and every allowed f.

    Values are in units of `FeasibleSet.unit`. `Q = (K + V)^-1` holds up to rounding. Rounding widens the ellipsoids,
    since the sizes are valid for any Q.

    Attributes:
        squared_radius: `(sets,)`, `(sqrt(1 + eps^2 sum w - r^T Q r) + |V^-1/2 q|)^2` with `q = r - (K + V) a`.
        Q: `(sets, N, N)`.
        a: `(sets, N)`, `Q r`.
        K: `(N, N)`, correlations of the data.
        v: `(sets, N)`, diagonal of V: inverse weights.
    """

    squared_radius: np.ndarray
    Q: np.ndarray
    a: np.ndarray
    K: np.ndarray
    v: np.ndarray

    def center(self, k: np.ndarray) -> np.ndarray:
        """Compute the centers `k^T a` of functionals.

        Args:
            k: `(sets, N, rows)`, inner products with the data's representers; see `FeasibleSet.correlations`.

        Returns:
            `(sets, rows)`, in units of `FeasibleSet.unit`.
        """
        return (np.swapaxes(k, 1, 2) @ self.a[..., None])[..., 0]

    def covariance(self, k: np.ndarray, squared_norm: np.ndarray) -> np.ndarray:
        """Compute `beta^2 (squared_norm - k^T A - A^T k + A^T (K + V) A)` with `A = Q k`.

        The value for any A is an upper bound of the value for the best A.

        Args:
            k: `(sets, N, rows)`, inner products with the data's representers.
            squared_norm: Inner products of the functionals' representers with each other.

        Returns:
            `(sets, rows, rows)`, in squares of `FeasibleSet.unit`.
        """
        A = self.Q @ k
        kA = np.swapaxes(k, 1, 2) @ A
        return self.squared_radius[:, None, None] * (
            squared_norm - kA - np.swapaxes(kA, 1, 2) + np.swapaxes(A, 1, 2) @ (self.K @ A + self.v[..., None] * A)
        )


def minimize_width(feasible: FeasibleSet, k: np.ndarray, squared_norm: np.ndarray) -> FunctionalEllipsoids:
    """Find weights for which the trace of a set's covariance is small.

    A ValueError is raised if the data contradict norm and noise bound. The iteration starts from the weights of the
    energy bound, `w = 1 / (N eps^2)`. Each iteration multiplies `w_k` by
    `((R_k^2 + beta^2 |G_k|^2 / trace) / eps^2)^EXPONENT`, with the remainders R of the labels and G of k. At a fixed
    point the derivative of `beta^2 trace` is zero. The best iterate is returned.

    Args:
        feasible: Functions allowed by norm and data.
        k: `(sets, N, rows)`, inner products of the functionals with the data's representers.
        squared_norm: `(sets,)`, trace of the inner products of the functionals' representers.

    Returns:
        One ellipsoid for each set.
    """
    n, eps2 = len(feasible.r), feasible.eps**2
    iterations = MAX_ITERATIONS if n <= MAX_INDIVIDUAL_WEIGHTS else 0
    equal = min(1 / (max(n, 1) * eps2), MAX_WEIGHT)
    w = np.full((len(k) if iterations else 1, n), equal)
    best, smallest = None, np.inf
    for remaining in reversed(range(iterations + 1)):
        candidate = _ellipsoids(feasible, w)
        A = candidate.Q @ k
        G = k - feasible.K @ A
        trace = np.maximum(squared_norm - (A * (k + G - candidate.v[..., None] * A)).sum((1, 2)), 0.0)
        size = candidate.squared_radius * trace
        best, improved = (
            candidate if best is None else _select(size < smallest, candidate, best),
            size < (1 - MIN_IMPROVEMENT) * smallest,
        )
        smallest = np.minimum(size, smallest)
        if not remaining or improved.mean() < 0.5:
            break
        R = feasible.r - candidate.a @ feasible.K
        share = candidate.squared_radius / np.where(trace > 0, trace, np.inf)
        w = w * ((R * R + share[:, None] * (G * G).sum(2)) / eps2) ** UPDATE_EXPONENT
        w = np.clip(w, MIN_RELATIVE_WEIGHT * equal, min(MAX_RELATIVE_WEIGHT * equal, MAX_WEIGHT))
    assert best is not None
    return best


def _ellipsoids(feasible: FeasibleSet, w: np.ndarray) -> FunctionalEllipsoids:
    """Compute the ellipsoids of weights w, `(sets, N)`."""
    h, v = np.sqrt(w), 1 / w
    Q = h[:, :, None] * np.linalg.inv(np.eye(w.shape[1]) + h[:, :, None] * feasible.K * h[:, None]) * h[:, None]
    a = Q @ feasible.r
    limit, q = 1 + feasible.eps**2 * w.sum(1), feasible.r - a @ feasible.K - v * a
    beta2 = limit * (1 + ROUNDING_MARGIN) - (a * (feasible.r + q)).sum(1)
    if (beta2 < 0).any():
        raise ValueError(INFEASIBLE_MESSAGE)
    return FunctionalEllipsoids(
        squared_radius=(np.sqrt(beta2) + np.sqrt((w * q * q).sum(1))) ** 2, Q=Q, a=a, K=feasible.K, v=v
    )


def _select(use_new: np.ndarray, new: FunctionalEllipsoids, old: FunctionalEllipsoids) -> FunctionalEllipsoids:
    """Select for each set the new ellipsoid where `use_new` is true, else the old one."""
    return FunctionalEllipsoids(
        squared_radius=np.where(use_new, new.squared_radius, old.squared_radius),
        Q=np.where(use_new[:, None, None], new.Q, old.Q),
        a=np.where(use_new[:, None], new.a, old.a),
        K=new.K,
        v=np.where(use_new[:, None], new.v, old.v),
    )
