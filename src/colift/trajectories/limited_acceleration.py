"""Least-squares spline whose acceleration stays within that of the rows (host).

A spline overshoots a step of the acceleration, as a truncated Fourier series does. The second differences of the rows
are averages of the acceleration. Limits on the coefficients of the second derivative keep the path within their range,
because the spline lies in the convex hull of its coefficients.

References:
    de Boor, *A Practical Guide to Splines*, 2001, ch. 10 and 11.
    Hintermüller, Ito, Kunisch, *The primal-dual active set strategy as a semismooth Newton method*, SIAM J. Optim. 13,
    2003.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
from scipy import sparse
from scipy.sparse import linalg as sparse_linalg

SLACK = 0.04
"""Permitted excess over the second differences of an axis, relative to the largest one of the axis."""
MIN_SLACK = 0.01
"""Least permitted excess, relative to the largest second difference of all axes."""
MAX_NOISE = 0.02
"""Largest noise of the second differences, relative to the largest acceleration."""
REGULARIZATION = 1e-6
"""Weight of the squared changes of the acceleration, which determine a path with more coefficients than rows."""
PENALTIES = (1.0, 1e3, 1e6)
"""Successive weights of the squared excess."""
NEWTON_STEPS = 100
BISECTIONS = 40
STEP_TOLERANCE = 1e-11  # m


@dataclasses.dataclass(frozen=True)
class SecondDifferences:
    """Averages of the acceleration between rows of a table.

    Attributes:
        t: Times of the middle rows [s].
        a: Second divided differences [m/s^2], one row per time.
    """

    t: np.ndarray
    a: np.ndarray

    @property
    def largest(self) -> float:
        """Return the largest magnitude [m/s^2]."""
        return float(np.linalg.norm(self.a, axis=1).max())


def second_differences(t: np.ndarray, p: np.ndarray, deviation: float, acceleration: float) -> SecondDifferences:
    """Compute the second differences over so many rows that noise has little effect.

    Args:
        t: Times of the rows, at least three [s].
        p: Positions [m].
        deviation: Root-mean-square distance of the rows from the path [m].
        acceleration: Largest acceleration of the path [m/s^2].

    Returns:
        The differences.
    """
    interval = math.sqrt(math.sqrt(6) * deviation / max(MAX_NOISE * acceleration, 1e-12))
    rows = int(min(max(math.ceil(interval / np.median(np.diff(t)) - 1e-9), 1), (len(t) - 1) // 2))
    before, middle, after = t[: -2 * rows], t[rows:-rows], t[2 * rows :]
    rise = (p[2 * rows :] - p[rows:-rows]) / (after - middle)[:, None]
    rise -= (p[rows:-rows] - p[: -2 * rows]) / (middle - before)[:, None]
    return SecondDifferences(middle, 2 * rise / (after - before)[:, None])


def limited_coefficients(
    B: sparse.csr_array,
    knots: np.ndarray,
    degree: int,
    p: np.ndarray,
    differences: SecondDifferences,
) -> np.ndarray:
    """Compute the least-squares spline with limited coefficients of its second derivative.

    Args:
        B: Basis functions at the rows.
        knots: Knots of the basis, with repeated ends.
        degree: Degree of the basis.
        p: Positions of the rows [m].
        differences: Second differences of the rows.

    Returns:
        The coefficients.
    """
    D = _second_derivative(knots, degree)
    first, last = knots[2 : 2 + D.shape[0]], knots[degree + 1 : degree + 1 + D.shape[0]]
    low, high = _ranges(differences, first, last)
    unit = ((last - first) / (degree - 1)) ** 2  # so that the weights do not depend on the spacing of the knots
    change = (D[1:] - D[:-1]) * unit.mean()
    D = (sparse.diags_array(unit) @ D).tocsr()
    N = (B.T @ B + REGULARIZATION * (change.T @ change)).tocsc()
    columns = []
    for k in range(p.shape[1]):
        r, limits = B.T @ p[:, k], (unit * low[:, k], unit * high[:, k])
        c = sparse_linalg.spsolve(N, r)
        for weight in PENALTIES:
            c = _newton(N, r, D, limits, weight, c)
        columns.append(c)
    return np.stack(columns, axis=1)


def _second_derivative(knots: np.ndarray, degree: int) -> sparse.csr_array:
    """Return the matrix from coefficients to those of the second derivative."""
    D = sparse.eye_array(len(knots) - degree - 1, format="csr")
    for d in (degree, degree - 1):
        inner = knots[degree - d : len(knots) - (degree - d)]
        count = D.shape[0]
        D = sparse.diags_array(d / (inner[d + 1 : d + count] - inner[1:count])) @ (D[1:] - D[:-1])
    return D.tocsr()


def _ranges(differences: SecondDifferences, first: np.ndarray, last: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the range of the differences within each interval and next to it, with the permitted excess."""
    t, a = differences.t, np.concatenate([_beyond(differences.a), differences.a, _beyond(differences.a[::-1])])
    slack = np.maximum(SLACK * np.abs(a).max(0), MIN_SLACK * differences.largest)
    start, end = np.searchsorted(t, first, side="left"), np.searchsorted(t, last, side="right") + 2
    low = np.array([a[i:j].min(0) for i, j in zip(start, end, strict=True)])
    high = np.array([a[i:j].max(0) for i, j in zip(start, end, strict=True)])
    return low - slack, high + slack


def _beyond(a: np.ndarray) -> np.ndarray:
    """Extrapolate differences to the row before the first one, at most to zero and to the largest one of each axis."""
    most, next_one = np.abs(a).max(0), a[min(1, len(a) - 1)]
    outside = np.clip(2 * a[0] - next_one, -most, most)
    return np.where(outside * a[0] < 0, 0.0, outside)[None]


def _newton(
    N: sparse.csc_array,
    r: np.ndarray,
    D: sparse.csr_array,
    limits: tuple[np.ndarray, np.ndarray],
    weight: float,
    c: np.ndarray,
) -> np.ndarray:
    """Minimize `c^T N c / 2 - r^T c + weight |D c - clip(D c)|^2 / 2` by a semismooth Newton method."""
    active = None
    for _ in range(NEWTON_STEPS):
        v = D @ c
        excess = v - np.clip(v, *limits)
        before, active = active, np.sign(excess)
        if before is not None and (active == before).all():
            break
        gradient = N @ c - r + weight * (D.T @ excess)
        A = D[np.flatnonzero(excess)]
        step = sparse_linalg.spsolve((N + weight * (A.T @ A)).tocsc(), -gradient)
        size = _line_search(step @ (N @ step), (N @ c - r) @ step, v, D @ step, limits, weight)
        if size < 1:
            active = None  # only a whole step solves the equations of an active set
        c = c + size * step
        if np.abs(size * step).max() <= STEP_TOLERANCE:
            break
    return c


def _line_search(
    curvature: float,
    slope: float,
    v: np.ndarray,
    change: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    weight: float,
) -> float:
    """Return the length of the step, at most 1, that minimizes the function along it."""

    def derivative(size: float) -> float:
        w = v + size * change
        return float(slope + size * curvature + weight * ((w - np.clip(w, *limits)) @ change))

    low, high = 0.0, 1.0
    if derivative(high) <= 0:
        return high
    for _ in range(BISECTIONS):
        middle = (low + high) / 2
        low, high = (low, middle) if derivative(middle) > 0 else (middle, high)
    return high
