"""Minimum-snap reference trajectory through waypoints.

References:
    Mellinger, Kumar, *Minimum snap trajectory generation and control for quadrotors*, ICRA 2011.
"""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np

from colift.trajectories.pose_spline import PiecewisePolynomial, PoseSpline
from colift.trajectories.rotation_legs import interpolate_attitudes


def minimum_snap(t: np.ndarray, p: np.ndarray, R: np.ndarray, delta: np.ndarray | None = None) -> PoseSpline:
    """Compute the trajectory through poses at given times, at rest at both ends (host).

    The position minimizes `int |d^4 p/dt^4|^2`. Its velocity, acceleration and jerk are zero at both ends, and
    derivatives up to the sixth are continuous. The attitude consists of legs on SO(3) with limited turning
    (`interpolate_attitudes`).

    Args:
        t: Times of the n poses, ascending [s].
        p: Positions, one per row [m, world].
        R: Attitudes, payload to world.
        delta: Rotation vectors from each attitude to the next one, n - 1 rows [rad, payload frame]; by default the
            shortest ones.

    Returns:
        The trajectory.

    Raises:
        ValueError: If there are fewer than two poses, the numbers of times and poses differ, or the times do not
            ascend.

    Example:
        Move by 1 m along x within 4 s::

            reference = minimum_snap(
                np.array([0.0, 4.0]), np.array([[0, 0, 1], [1, 0, 1]]), np.broadcast_to(np.eye(3), (2, 3, 3))
            )
    """
    t, p, R = np.asarray(t, float), np.asarray(p, float), np.asarray(R, float)
    if len(t) < 2 or len(p) != len(t) or len(R) != len(t):
        raise ValueError(
            f"waypoints: {len(t)} times for {len(p)} positions and {len(R)} attitudes; equal numbers, at least two, "
            "are required"
        )
    if not (np.diff(t) > 0).all():
        raise ValueError(f"waypoints: times must ascend, got {t.tolist()}")
    position = PiecewisePolynomial(knots=jnp.asarray(t), coefficients=jnp.asarray(minimum_snap_coefficients(t, p)))
    return PoseSpline(position=position, attitude=interpolate_attitudes(t, R, delta))


def minimum_snap_coefficients(t: np.ndarray, p: np.ndarray) -> np.ndarray:
    """Compute the minimum-snap polynomials through points at given times, at rest at both ends.

    Args:
        t: Times of the points, ascending [s].
        p: Points, one per row.

    Returns:
        Coefficients of the powers of the time since the start of each leg, `(legs, 8, columns)`.
    """
    span, pieces = np.diff(t), len(t) - 1
    A, b = [], []

    def row(*terms: tuple[int, np.ndarray], value: np.ndarray | float = 0.0) -> None:
        line = np.zeros((pieces, 8))
        for i, weights in terms:
            line[i] += weights
        A.append(line.ravel())
        b.append(np.broadcast_to(value, p.shape[1]))

    for i in range(pieces):  # time in units of the length of the piece, so that the powers are of order one
        row((i, _powers(0.0, 0)), value=p[i])
        row((i, _powers(1.0, 0)), value=p[i + 1])
    for k in (1, 2, 3):
        row((0, _powers(0.0, k)))
        row((pieces - 1, _powers(1.0, k)))
    for i in range(pieces - 1):
        for k in range(1, 7):
            row((i, _powers(1.0, k) / span[i] ** k), (i + 1, -_powers(0.0, k) / span[i + 1] ** k))
    c = np.linalg.solve(np.array(A), np.array(b)).reshape(pieces, 8, -1)
    return c / span[:, None, None] ** np.arange(8)[None, :, None]


def _powers(s: float, k: int) -> np.ndarray:
    """Return the k-th derivative of `(1, s, ..., s^7)`."""
    return np.array([math.perm(n, k) * s ** (n - k) if n >= k else 0.0 for n in range(8)])
