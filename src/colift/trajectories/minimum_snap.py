"""Minimum-snap reference trajectory through waypoints.

References:
    Mellinger, Kumar, *Minimum snap trajectory generation and control for quadrotors*, ICRA 2011.
"""

from __future__ import annotations

import math

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.trajectories.base import PayloadSetpoint, differentiate_pose

Scalar = Float[Array, ""]


@pytree
class MinimumSnapTrajectory:
    """Piecewise polynomial trajectory that minimizes `int |d^4/dt^4 (p, theta)|^2`; built by `minimum_snap`.

    `(p, theta)(t) = sum_k c_k s^k` with `s = t - t_i` on `[t_i, t_(i+1)]`, and `R_d = exp(theta)`. Derivatives up to
    the sixth are continuous at inner knots. The pose is constant before the first knot and after the last one.
    """

    knots: Float[Array, "knots"]  # s, times of the waypoints, ascending
    coefficients: Float[Array, "pieces 8 6"]  # m (world) and rad per s^k, by piece and power k

    def evaluate(self, t: Scalar) -> PayloadSetpoint:
        """Compute the setpoint at time t [s]; see `ReferenceTrajectory`."""
        t = jnp.clip(t, self.knots[0], self.knots[-1])
        i = jnp.clip((t >= self.knots).sum() - 1, 0, len(self.knots) - 2)
        c, start = self.coefficients[i], self.knots[i]

        def pose(t: Scalar) -> Float[Array, "6"]:
            value = c[-1]
            for k in reversed(range(len(c) - 1)):
                value = c[k] + (t - start) * value
            return value

        return differentiate_pose(pose, jnp.eye(3), t)


def minimum_snap(t: np.ndarray, p: np.ndarray, theta: np.ndarray) -> MinimumSnapTrajectory:
    """Compute the minimum-snap trajectory through poses at given times, at rest at both ends (host).

    Velocity, acceleration and jerk are zero at both ends. The minimizer is a polynomial of degree 7 between two poses,
    with continuous derivatives up to the sixth.

    Args:
        t: Times of the n poses, ascending [s].
        p: Positions, one per row [m, world].
        theta: Rotation vectors of the attitudes, one per row [rad]; they are interpolated by component, so their
            differences determine the direction of rotation.

    Returns:
        The trajectory.

    Raises:
        ValueError: If there are fewer than two poses, the numbers of times and poses differ, or the times do not
            ascend.

    Example:
        Move by 1 m along x within 4 s::

            reference = minimum_snap(np.array([0.0, 4.0]), np.array([[0, 0, 1], [1, 0, 1]]), np.zeros((2, 3)))
    """
    t, poses = np.asarray(t, float), np.concatenate([p, theta], axis=1)
    if len(t) < 2 or len(poses) != len(t):
        raise ValueError(f"waypoints: {len(t)} times for {len(poses)} poses; equal numbers, at least two, are required")
    if not (np.diff(t) > 0).all():
        raise ValueError(f"waypoints: times must ascend, got {t.tolist()}")
    span, pieces = np.diff(t), len(t) - 1
    A, b = [], []

    def row(*terms: tuple[int, np.ndarray], value: np.ndarray | float = 0.0) -> None:
        line = np.zeros((pieces, 8))
        for i, weights in terms:
            line[i] += weights
        A.append(line.ravel())
        b.append(np.broadcast_to(value, 6))

    for i in range(pieces):  # time in units of the length of the piece, so that the powers are of order one
        row((i, _powers(0.0, 0)), value=poses[i])
        row((i, _powers(1.0, 0)), value=poses[i + 1])
    for k in (1, 2, 3):
        row((0, _powers(0.0, k)))
        row((pieces - 1, _powers(1.0, k)))
    for i in range(pieces - 1):
        for k in range(1, 7):
            row((i, _powers(1.0, k) / span[i] ** k), (i + 1, -_powers(0.0, k) / span[i + 1] ** k))
    c = np.linalg.solve(np.array(A), np.array(b)).reshape(pieces, 8, 6)
    return MinimumSnapTrajectory(
        knots=jnp.asarray(t), coefficients=jnp.asarray(c / span[:, None, None] ** np.arange(8)[None, :, None])
    )


def _powers(s: float, k: int) -> np.ndarray:
    """Return the k-th derivative of `(1, s, ..., s^7)`."""
    return np.array([math.perm(n, k) * s ** (n - k) if n >= k else 0.0 for n in range(8)])
