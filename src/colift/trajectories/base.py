"""Setpoint of the payload, protocol of a reference trajectory, and exact derivatives of a pose."""

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
    """Desired payload pose `(p_d, R_d)` at one time, with the derivatives for feedforward."""

    p: Float[Array, "3"]  # m, world
    v: Float[Array, "3"]  # m/s, world
    a: Float[Array, "3"]  # m/s^2, world
    j: Float[Array, "3"]  # m/s^3, world
    R: Float[Array, "3 3"]  # desired attitude, payload to world
    omega: Float[Array, "3"]  # rad/s, desired payload frame
    omega_dot: Float[Array, "3"]  # rad/s^2, desired payload frame
    omega_ddot: Float[Array, "3"] | None = None  # rad/s^3, desired payload frame; None where it is neglected


@runtime_checkable
class ReferenceTrajectory(Protocol):
    """Smooth pose of the payload as a function of time.

    Position and attitude need three continuous derivatives. Implementations: ``Lissajous``,
    ``PathDeparture`` and ``PoseSpline``.

    Example:
        A circle of constant attitude; `differentiate_pose` computes the derivatives::

            @pytree
            class Circle:
                radius: Float[Array, ""]  # m
                rate: Float[Array, ""]  # rad/s

                def evaluate(self, t: Float[Array, ""]) -> PayloadSetpoint:
                    def pose(t: Float[Array, ""]) -> Float[Array, "6"]:
                        x, y = self.radius * jnp.cos(self.rate * t), self.radius * jnp.sin(self.rate * t)
                        return jnp.stack([x, y, *jnp.zeros(4)])

                    return differentiate_pose(pose, jnp.eye(3), t)
    """

    def evaluate(self, t: Scalar) -> PayloadSetpoint:
        """Compute the setpoint at a time.

        Args:
            t: Time [s].

        Returns:
            Desired pose with its derivatives.
        """
        ...


def differentiate_pose(
    pose: Callable[[Scalar], Float[Array, "6"]], R: Float[Array, "3 3"], t: Scalar
) -> PayloadSetpoint:
    """Compute the setpoint of a pose function by nested forward-mode differentiation, without approximation.

    The desired attitude is `R_d = R exp(theta)`, and `omega_d = (R_d^T R_d_dot)^vee`.

    Args:
        pose: Function from time [s] to position [m, world] and rotation vector `theta` [rad, frame of R].
        R: Attitude at `theta = 0`, payload to world.
        t: Time [s].

    Returns:
        Desired pose with its derivatives.
    """
    return differentiate_motion(lambda t: pose(t)[:3], lambda t: matmul(R, so3.exp(pose(t)[3:])), t)


def differentiate_motion(
    position: Callable[[Scalar], Float[Array, "3"]], rotation: Callable[[Scalar], Float[Array, "3 3"]], t: Scalar
) -> PayloadSetpoint:
    """Compute the setpoint of a position and an attitude function by nested forward-mode differentiation.

    Args:
        position: Function from time [s] to position [m, world].
        rotation: Function from time [s] to attitude, payload to world.
        t: Time [s].

    Returns:
        Desired pose with its derivatives.
    """

    def attitude(t: Scalar) -> tuple[Float[Array, "3 3"], Float[Array, "3"]]:
        R_d, R_d_dot = _with_rate(rotation)(t)
        return R_d, so3.vee(matmul(transpose(R_d), R_d_dot))

    ((R_d, omega), (_, omega_dot)), (_, (_, omega_ddot)) = _with_rate(_with_rate(attitude))(t)
    ((p, v), (_, a)), (_, (_, j)) = _with_rate(_with_rate(_with_rate(position)))(t)
    return PayloadSetpoint(p=p, v=v, a=a, j=j, R=R_d, omega=omega, omega_dot=omega_dot, omega_ddot=omega_ddot)


def _with_rate(f: Callable[[Scalar], Any]) -> Callable[[Scalar], tuple[Any, Any]]:
    """Return a function that evaluates f together with its time derivative."""
    return lambda t: jax.jvp(f, (t,), (jnp.ones_like(t),))


def smooth_step(s: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """Compute a smooth step from 0 at `s <= 0` to 1 at `s >= 1`, with three derivatives of zero at both ends.

    Args:
        s: Argument; the step is a polynomial of degree 7 between 0 and 1.

    Returns:
        Value of the step, in [0, 1].
    """
    s = jnp.clip(s, 0.0, 1.0)
    return s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)


def smooth_pulse(t: Float[Array, "*batch"], start: Scalar, end: Scalar, ramp: Scalar) -> Float[Array, "*batch"]:
    """Compute a smooth pulse from 0 to 1 and back to 0.

    Args:
        t: Time [s].
        start: Start of the rise [s].
        end: End of the fall [s].
        ramp: Duration of rise and of fall [s].

    Returns:
        Value of the pulse, in [0, 1].
    """
    return smooth_step((t - start) / ramp) * smooth_step((end - t) / ramp)
