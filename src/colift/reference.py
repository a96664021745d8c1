"""Where the payload should be: a smooth pose with the derivatives that the controllers feed forward."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift import so3
from colift.linalg import mul, transpose
from colift.pytree import pytree

Scalar = Float[Array, ""]


@pytree
class Setpoint:
    """The desired payload pose `(p_d, R_d)` at one time, with derivatives."""

    p: Float[Array, "3"]  # m
    v: Float[Array, "3"]  # m/s
    a: Float[Array, "3"]  # m/s^2
    j: Float[Array, "3"]  # m/s^3
    R: Float[Array, "3 3"]
    omega: Float[Array, "3"]  # rad/s, desired payload frame
    omega_dot: Float[Array, "3"]  # rad/s^2, desired payload frame


@runtime_checkable
class Reference(Protocol):
    """A smooth pose of the payload over time."""

    def at(self, t: Scalar) -> Setpoint:
        """The setpoint at time t, s."""
        ...


@pytree
class Lissajous:
    """`p_d = center + ramp(t) amplitude sin(2 pi t / period + phase)`, axis by axis, and the same of the attitude.

    `R_d = R exp(ramp(t) swing sin(2 pi t / swing_period + swing_phase))`: with a swing of zero it is constant. `ramp`
    rises from 0 to 1 in `ramp_s` with three vanishing derivatives at both ends, so the payload starts at rest.
    """

    center: Float[Array, "3"]  # m
    amplitude: Float[Array, "3"]  # m
    period: Float[Array, "3"]  # s
    phase: Float[Array, "3"]  # rad
    ramp: Float[Array, ""]  # s
    R: Float[Array, "3 3"]  # attitude about which it swings, payload to world
    swing: Float[Array, "3"]  # rad, rotation vector in the frame of R
    swing_period: Float[Array, "3"]  # s
    swing_phase: Float[Array, "3"]  # rad

    def at(self, t: Scalar) -> Setpoint:
        """The setpoint at time t, s; derivatives are exact (nested forward differentiation)."""
        return along(self.pose, self.R, t)

    def pose(self, t: Scalar) -> Float[Array, "6"]:
        """Position, m, and rotation vector off R, rad, at time t, s."""
        on = smooth_step(t / self.ramp)
        wave = jnp.sin(2 * jnp.pi * t / self.period + self.phase)
        turn = jnp.sin(2 * jnp.pi * t / self.swing_period + self.swing_phase)
        return jnp.concatenate([self.center + on * self.amplitude * wave, on * self.swing * turn])


@pytree
class Leaving:
    """Another path that moves off by `shift` from `start` on, and turns as it had not: `swing sin(2 pi s / period)`.

    s is the time since `swing_start`; both rise within `over`.
    """

    path: Lissajous
    shift: Float[Array, "3"]  # m
    start: Float[Array, ""]  # s
    over: Float[Array, ""]  # s
    swing: Float[Array, "3"]  # rad, rotation vector in the frame of the path's R
    swing_start: Float[Array, ""]  # s
    swing_period: Float[Array, ""]  # s

    def at(self, t: Scalar) -> Setpoint:
        """The setpoint at time t, s; derivatives are exact (nested forward differentiation)."""

        def pose(t: Scalar) -> Float[Array, "6"]:
            s = t - self.swing_start
            turn = smooth_step(s / self.over) * jnp.sin(2 * jnp.pi * s / self.swing_period)
            off = smooth_step((t - self.start) / self.over)
            return self.path.pose(t) + jnp.concatenate([off * self.shift, turn * self.swing])

        return along(pose, self.path.R, t)


@pytree
class Waypoints:
    """Polynomials between poses, of least `int |d^4/dt^4|^2`: minimum snap, smooth to the sixth derivative inside.

    `(p, theta)(t) = sum_k c_k s^k`, `s = t - t_i` on `[t_i, t_(i+1)]`, `R_d = exp(theta)`; before the first pose and
    after the last it stands still. Made by `waypoints`.
    """

    knots: Float[Array, "knots"]  # s, ascending
    coefficients: Float[Array, "pieces 8 6"]  # m, rad, over powers of s

    def at(self, t: Scalar) -> Setpoint:
        """The setpoint at time t, s."""
        t = jnp.clip(t, self.knots[0], self.knots[-1])
        i = jnp.clip((t >= self.knots).sum() - 1, 0, len(self.knots) - 2)
        c, start = self.coefficients[i], self.knots[i]

        def pose(t: Scalar) -> Float[Array, "6"]:
            value = c[-1]
            for k in reversed(range(len(c) - 1)):
                value = c[k] + (t - start) * value
            return value

        return along(pose, jnp.eye(3), t)


def waypoints(t: np.ndarray, p: np.ndarray, theta: np.ndarray) -> Waypoints:
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
    return Waypoints(
        knots=jnp.asarray(t), coefficients=jnp.asarray(c / span[:, None, None] ** np.arange(8)[None, :, None])
    )


def _powers(s: float, k: int) -> np.ndarray:
    """The k-th derivative of `(1, s, ..., s^7)`."""
    return np.array([math.perm(n, k) * s ** (n - k) if n >= k else 0.0 for n in range(8)])


def along(pose: Callable[[Scalar], Float[Array, "6"]], R: Float[Array, "3 3"], t: Scalar) -> Setpoint:
    """The setpoint of `pose(t) = (p, theta)`, attitude `R exp(theta)`, with exact derivatives.

    `omega_d = (R_d^T R_d_dot)^vee`, payload frame, and its rate.
    """

    def turning(t: Scalar) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
        R_d, R_d_dot = _and_rate(lambda t: mul(R, so3.exp(pose(t)[3:])))(t)
        return R_d, so3.vee(mul(transpose(R_d), R_d_dot))

    (R_d, omega), (_, omega_dot) = _and_rate(turning)(t)
    ((p, v), (_, a)), (_, (_, j)) = _and_rate(_and_rate(_and_rate(lambda t: pose(t)[:3])))(t)
    return Setpoint(p=p, v=v, a=a, j=j, R=R_d, omega=omega, omega_dot=omega_dot)


def _and_rate(f: Callable[[Scalar], Any]) -> Callable[[Scalar], tuple[Any, Any]]:
    """A function and its derivative in time, both from one evaluation."""
    return lambda t: jax.jvp(f, (t,), (jnp.ones_like(t),))


def smooth_step(s: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """0 before 0, 1 after 1, a polynomial of degree 7 between, with three vanishing derivatives at both ends."""
    s = jnp.clip(s, 0.0, 1.0)
    return s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)


def pulse(t: Float[Array, "*batch"], start: Scalar, end: Scalar, ramp: Scalar) -> Float[Array, "*batch"]:
    """Rises smoothly from 0 at `start`, is 1 in between, is 0 again from `end`; each flank lasts `ramp`, s."""
    return smooth_step((t - start) / ramp) * smooth_step((end - t) / ramp)
