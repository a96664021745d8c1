"""Where the payload should be: a smooth pose with the derivatives that the controllers feed forward."""

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
    """Polynomials between poses, of least `int |d^4/dt^4|^2`: minimum snap, smooth to the sixth derivative inside.

    `(p, theta)(t) = sum_k c_k s^k`, `s = t - t_i` on `[t_i, t_(i+1)]`, `R_d = exp(theta)`; before the first pose and
    after the last it stands still. Made by `waypoints`.
    """

    knots: Float[Array, "knots"]  # s, ascending
    coefficients: Float[Array, "pieces 8 6"]  # m, rad, over powers of s

    def evaluate(self, t: Scalar) -> PayloadSetpoint:
        """The setpoint at time t, s."""
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
    """The minimum-snap path through poses at given times, at rest at both ends (Mellinger and Kumar 2011); on the host.

    t: (n,) s, ascending; p: (n, 3) m; theta: (n, 3) rotation vectors of the attitude, rad, which turn from one to the
    next the way their difference says. Of all curves with velocity, acceleration and jerk zero at both ends, the one of
    least snap is a polynomial of degree 7 between poses whose derivatives up to the sixth are continuous.
    Raises ValueError for fewer than two poses or times that do not ascend.
    """
    t, poses = np.asarray(t, float), np.concatenate([p, theta], axis=1)
    if len(t) < 2 or len(poses) != len(t):
        raise ValueError(f"waypoints: {len(t)} times for {len(poses)} poses; at least two of each are needed")
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

    for i in range(pieces):  # in units of each piece's length, so that powers stay of order one
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
    """The k-th derivative of `(1, s, ..., s^7)`."""
    return np.array([math.perm(n, k) * s ** (n - k) if n >= k else 0.0 for n in range(8)])
