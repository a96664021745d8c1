"""What flies: a pilot made of parts, each of which can be replaced alone. Memory is explicit; nothing sees the truth.

One tick: observe, record, predict, lead, allocate, realize. A part is a PyTree with the one or two methods of its class
here; `docs/change_a_part.md` leads from each wish to the one to replace. `Now` is all that a part may look at.
"""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models.state import Wrench
from colift.onboard.control.allocation import Allocation, apply
from colift.onboard.interfaces import Forces, Now
from colift.trajectories import base

Scalar = Float[Array, ""]


@pytree
class Internal:
    """An internal-force input that is switched on for a while."""

    eta: Float[Array, " eta"]  # N, coordinates in the allocation's kernel
    start: Scalar  # s
    end: Scalar  # s
    ramp: Scalar  # s


@pytree
class Linear:
    """One of the linear allocations, with an internal force."""

    allocation: Allocation
    internal: Internal

    def allocate(self, now: Now, W: Wrench, W_dot: Wrench) -> Forces:
        """`lam = inverse W + kernel eta + offset`; of its rate, what the wrench's is."""
        on, R = self.internal, now.q_hat.payload.R
        eta = base.pulse(now.clock.t, on.start, on.end, on.ramp) * on.eta
        rate = dataclasses.replace(self.allocation, offset=jnp.zeros_like(self.allocation.offset))
        return Forces(
            lam=apply(self.allocation, R, W, eta),
            lam_dot=apply(rate, R, W_dot, jnp.zeros_like(eta)),
            eta=eta,
        )
