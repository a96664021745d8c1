"""What flies: a pilot made of parts, each of which can be replaced alone. Memory is explicit; nothing sees the truth.

One tick: observe, record, predict, lead, allocate, realize. A part is a PyTree with the one or two methods of its class
here; `docs/change_a_part.md` leads from each wish to the one to replace. `Now` is all that a part may look at.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.pytree import pytree
from colift.onboard.control import tracking
from colift.onboard.interfaces import ControlContext, PayloadController

Scalar = Float[Array, ""]


@pytree
class GeometricTracking:
    """The paper's leader (Eq. payload_force_cmd_learning, payload_torque_cmd_learning), as accelerations."""

    gains: tracking.Gains

    def init(self) -> Any:
        """Nothing is remembered."""
        return ()

    def compute(self, state: Any, context: ControlContext) -> tuple[tracking.AccelerationCommand, Any]:
        """`control.command`."""
        return tracking.tracking_acceleration(
            self.gains, context.estimate.payload, context.estimate.a_L[:3], context.setpoint
        ), state


@pytree
class IntegralAction:
    """Another leader with integral action: `a - K_i int e_p`, `alpha - k_i int e_R`, summed over ticks."""

    base: PayloadController
    K_i: Scalar  # 1/s^3
    k_i: Scalar  # 1/s^3

    def init(self) -> Any:
        """`(K_i int e_p, k_i int e_R)`, and the other's memory."""
        return jnp.zeros(6), self.base.init()

    def compute(self, state: Any, context: ControlContext) -> tuple[tracking.AccelerationCommand, Any]:
        """The other's command less the integrals."""
        past, of_other = state
        q, d = context.estimate.payload, context.setpoint
        rate = jnp.concatenate([self.K_i * (q.p - d.p), self.k_i * so3.e_R(q.R, d.R)])
        integral = past + context.clock.dt * rate
        to, of_other = self.base.compute(of_other, context)
        return dataclasses.replace(to, a=to.a - integral[:3], alpha=to.alpha - integral[3:]), (integral, of_other)
