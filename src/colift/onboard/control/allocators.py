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
from colift.onboard.control.allocation import AllocationMap, allocate
from colift.onboard.interfaces import ContactForceCommand, ControlContext
from colift.trajectories import base

Scalar = Float[Array, ""]


@pytree
class InternalForceSchedule:
    """An internal-force input that is switched on for a while."""

    eta: Float[Array, " eta"]  # N, coordinates in the allocation's kernel
    start: Scalar  # s
    end: Scalar  # s
    ramp: Scalar  # s


@pytree
class LinearAllocator:
    """One of the linear allocations, with an internal force."""

    allocation: AllocationMap
    internal: InternalForceSchedule

    def allocate(self, context: ControlContext, W: Wrench, W_dot: Wrench) -> ContactForceCommand:
        """`lam = inverse W + kernel eta + offset`; of its rate, what the wrench's is."""
        on, R = self.internal, context.estimate.payload.R
        eta = base.smooth_pulse(context.clock.t, on.start, on.end, on.ramp) * on.eta
        rate = dataclasses.replace(self.allocation, offset=jnp.zeros_like(self.allocation.offset))
        return ContactForceCommand(
            lam=allocate(self.allocation, R, W, eta),
            lam_dot=allocate(rate, R, W_dot, jnp.zeros_like(eta)),
            eta=eta,
        )
