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
from colift.onboard.interfaces import Leader, Now

Scalar = Float[Array, ""]


@pytree
class Geometric:
    """The paper's leader (Eq. payload_force_cmd_learning, payload_torque_cmd_learning), as accelerations."""

    gains: tracking.Gains

    def begin(self) -> Any:
        """Nothing is remembered."""
        return ()

    def lead(self, memory: Any, now: Now) -> tuple[tracking.Command, Any]:
        """`control.command`."""
        return tracking.command(self.gains, now.q_hat.payload, now.q_hat.a_L[:3], now.d), memory


@pytree
class Integral:
    """Another leader with integral action: `a - K_i int e_p`, `alpha - k_i int e_R`, summed over ticks."""

    leader: Leader
    K_i: Scalar  # 1/s^3
    k_i: Scalar  # 1/s^3

    def begin(self) -> Any:
        """`(K_i int e_p, k_i int e_R)`, and the other's memory."""
        return jnp.zeros(6), self.leader.begin()

    def lead(self, memory: Any, now: Now) -> tuple[tracking.Command, Any]:
        """The other's command less the integrals."""
        past, of_other = memory
        q, d = now.q_hat.payload, now.d
        rate = jnp.concatenate([self.K_i * (q.p - d.p), self.k_i * so3.e_R(q.R, d.R)])
        integral = past + now.clock.dt * rate
        to, of_other = self.leader.lead(of_other, now)
        return dataclasses.replace(to, a=to.a - integral[:3], alpha=to.alpha - integral[3:]), (integral, of_other)
