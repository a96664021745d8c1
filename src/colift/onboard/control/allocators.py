"""Implementation of the protocol `Allocator` by a linear allocation."""

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
    """Internal-force input that rises from zero, stays constant, and returns to zero."""

    eta: Float[Array, " eta"]  # N, coordinates in the null space of the allocation
    start: Scalar  # s, start of the rise
    end: Scalar  # s, end of the fall
    ramp: Scalar  # s, duration of rise and of fall


@pytree
class LinearAllocator:
    """Linear allocation with a scheduled internal force."""

    allocation: AllocationMap  # map from wrench and internal-force input to contact forces
    internal: InternalForceSchedule  # internal-force input over time

    def allocate(self, context: ControlContext, W: Wrench, W_dot: Wrench) -> ContactForceCommand:
        """Compute `lam = G^+ W + Z eta + offset`; see `Allocator`. Its rate contains that of the wrench only."""
        schedule, R = self.internal, context.estimate.payload.R
        eta = base.smooth_pulse(context.clock.t, schedule.start, schedule.end, schedule.ramp) * schedule.eta
        rate = dataclasses.replace(self.allocation, offset=jnp.zeros_like(self.allocation.offset))
        return ContactForceCommand(
            lam=allocate(self.allocation, R, W, eta),
            lam_dot=allocate(rate, R, W_dot, jnp.zeros_like(eta)),
            eta=eta,
        )
