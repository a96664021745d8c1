"""Implementations of the protocol `PayloadController`."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.pytree import constant, pytree
from colift.onboard.control import tracking
from colift.onboard.interfaces import ControlContext, PartState, PayloadController

Scalar = Float[Array, ""]


@pytree
class GeometricTracking:
    """Payload controller of the paper (Eq. payload_force_cmd_learning, payload_torque_cmd_learning).

    The position error may be bounded by its norm. A team that falls behind its reference at a limit then returns at a
    bounded speed.
    """

    gains: tracking.Gains  # feedback gains
    position_error_bound: Scalar | None = None  # m, bound of the position error's norm; None for no bound

    def init(self) -> PartState:
        """Return the empty state."""
        return ()

    def compute(self, state: PartState, context: ControlContext) -> tuple[tracking.AccelerationCommand, PartState]:
        """Compute the acceleration of `tracking.tracking_acceleration`; see `PayloadController`."""
        q, setpoint = context.estimate.payload, context.setpoint
        if self.position_error_bound is not None:
            e_p = q.p - setpoint.p
            scale = jnp.minimum(1.0, self.position_error_bound / jnp.sqrt((e_p * e_p).sum() + 1e-30))
            setpoint = dataclasses.replace(setpoint, p=q.p - scale * e_p)
        return tracking.tracking_acceleration(self.gains, q, context.estimate.a_L[:3], setpoint), state


@pytree
class IntegralAction:
    """Integral action on position and attitude error, added to another payload controller.

    `a = a_base - K_i int e_p dt`, `alpha = alpha_base - k_i int e_R dt`, with sums over control periods. If the
    allocator has limits, the difference d between achieved and commanded acceleration is fed back to the integrals
    (back-calculation): `d/dt I = K_i e_p - d / anti_windup_time`.

    References:
        Astrom, Hagglund, *PID Controllers: Theory, Design, and Tuning*, 2nd ed., 1995, sec. 3.5.
    """

    base: PayloadController  # controller to which the integral action is added
    K_i: Scalar  # 1/s^3, gain of the integrated position error
    k_i: Scalar | Float[Array, "3"]  # 1/s^3, gain of the integrated attitude error, or one by axis of the payload
    anti_windup_time: Scalar = constant(0.5)  # s, time constant of the back-calculation

    def init(self) -> PartState:
        """Return the integrals `(K_i int e_p, k_i int e_R)`, zero, and the state of the base controller."""
        return jnp.zeros(6), self.base.init()

    def compute(self, state: PartState, context: ControlContext) -> tuple[tracking.AccelerationCommand, PartState]:
        """Compute the base controller's command minus the integrals; see `PayloadController`."""
        previous, base_state = state
        q, d = context.estimate.payload, context.setpoint
        rate = jnp.concatenate([self.K_i * (q.p - d.p), self.k_i * so3.e_R(q.R, d.R)])
        if context.last_shortfall is not None:
            rate = rate - context.last_shortfall / self.anti_windup_time
        integral = previous + context.clock.dt * rate
        command, base_state = self.base.compute(base_state, context)
        command = dataclasses.replace(command, a=command.a - integral[:3], alpha=command.alpha - integral[3:])
        return command, (integral, base_state)
