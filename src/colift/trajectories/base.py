"""Where the payload should be: a smooth pose with the derivatives that the controllers feed forward."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import matmul, transpose
from colift.math.pytree import pytree

Scalar = Float[Array, ""]


@pytree
class PayloadSetpoint:
    """The desired payload pose `(p_d, R_d)` at one time, with derivatives."""

    p: Float[Array, "3"]  # m
    v: Float[Array, "3"]  # m/s
    a: Float[Array, "3"]  # m/s^2
    j: Float[Array, "3"]  # m/s^3
    R: Float[Array, "3 3"]
    omega: Float[Array, "3"]  # rad/s, desired payload frame
    omega_dot: Float[Array, "3"]  # rad/s^2, desired payload frame


@runtime_checkable
class ReferenceTrajectory(Protocol):
    """A smooth pose of the payload over time."""

    def evaluate(self, t: Scalar) -> PayloadSetpoint:
        """The setpoint at time t, s."""
        ...


def differentiate_pose(
    pose: Callable[[Scalar], Float[Array, "6"]], R: Float[Array, "3 3"], t: Scalar
) -> PayloadSetpoint:
    """The setpoint of `pose(t) = (p, theta)`, attitude `R exp(theta)`, with exact derivatives.

    `omega_d = (R_d^T R_d_dot)^vee`, payload frame, and its rate.
    """

    def turning(t: Scalar) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
        R_d, R_d_dot = _and_rate(lambda t: matmul(R, so3.exp(pose(t)[3:])))(t)
        return R_d, so3.vee(matmul(transpose(R_d), R_d_dot))

    (R_d, omega), (_, omega_dot) = _and_rate(turning)(t)
    ((p, v), (_, a)), (_, (_, j)) = _and_rate(_and_rate(_and_rate(lambda t: pose(t)[:3])))(t)
    return PayloadSetpoint(p=p, v=v, a=a, j=j, R=R_d, omega=omega, omega_dot=omega_dot)


def _and_rate(f: Callable[[Scalar], Any]) -> Callable[[Scalar], tuple[Any, Any]]:
    """A function and its derivative in time, both from one evaluation."""
    return lambda t: jax.jvp(f, (t,), (jnp.ones_like(t),))


def smooth_step(s: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """0 before 0, 1 after 1, a polynomial of degree 7 between, with three vanishing derivatives at both ends."""
    s = jnp.clip(s, 0.0, 1.0)
    return s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)


def smooth_pulse(t: Float[Array, "*batch"], start: Scalar, end: Scalar, ramp: Scalar) -> Float[Array, "*batch"]:
    """Rises smoothly from 0 at `start`, is 1 in between, is 0 again from `end`; each flank lasts `ramp`, s."""
    return smooth_step((t - start) / ramp) * smooth_step((end - t) / ramp)
