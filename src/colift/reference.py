"""Where the payload should be: a smooth pose with the derivatives that the controllers feed forward."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

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
    """`p_d = center + ramp(t) amplitude sin(2 pi t / period + phase)`, axis by axis, at a constant attitude.

    `ramp` rises from 0 to 1 in `ramp_s` with three vanishing derivatives at both ends, so the payload starts at rest.
    """

    center: Float[Array, "3"]  # m
    amplitude: Float[Array, "3"]  # m
    period: Float[Array, "3"]  # s
    phase: Float[Array, "3"]  # rad
    ramp: Float[Array, ""]  # s
    R: Float[Array, "3 3"]  # attitude, payload to world

    def at(self, t: Scalar) -> Setpoint:
        """The setpoint at time t, s; derivatives are exact (nested forward differentiation)."""

        def position(t: Scalar) -> Float[Array, "3"]:
            wave = jnp.sin(2 * jnp.pi * t / self.period + self.phase)
            return self.center + smooth_step(t / self.ramp) * self.amplitude * wave

        v, a, j = _rate(position), _rate(_rate(position)), _rate(_rate(_rate(position)))
        zero = jnp.zeros(3)
        return Setpoint(p=position(t), v=v(t), a=a(t), j=j(t), R=self.R, omega=zero, omega_dot=zero)


def _rate(f: Callable[[Scalar], Float[Array, "3"]]) -> Callable[[Scalar], Float[Array, "3"]]:
    return lambda t: jax.jvp(f, (t,), (jnp.ones_like(t),))[1]


def smooth_step(s: Float[Array, "*batch"]) -> Float[Array, "*batch"]:
    """0 before 0, 1 after 1, a polynomial of degree 7 between, with three vanishing derivatives at both ends."""
    s = jnp.clip(s, 0.0, 1.0)
    return s**4 * (35 - 84 * s + 70 * s**2 - 20 * s**3)


def pulse(t: Float[Array, "*batch"], start: Scalar, end: Scalar, ramp: Scalar) -> Float[Array, "*batch"]:
    """Rises smoothly from 0 at `start`, is 1 in between, is 0 again from `end`; each flank lasts `ramp`, s."""
    return smooth_step((t - start) / ramp) * smooth_step((end - t) / ramp)
