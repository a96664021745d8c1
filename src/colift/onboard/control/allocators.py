"""Implementation of the protocol `Allocator` by a linear allocation."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math import linalg
from colift.math.pytree import pytree
from colift.models import grasp
from colift.onboard.control.allocation import AllocationMap, allocate, allocate_to_closed_contacts
from colift.onboard.interfaces import AllocationDemand, ContactForceCommand, ControlContext, PartState
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

    def init(self) -> PartState:
        """Return the empty state."""
        return ()

    def allocate(
        self, state: PartState, context: ControlContext, demand: AllocationDemand
    ) -> tuple[ContactForceCommand, PartState]:
        """Compute the contact forces of the linear map; see `Allocator`. Their rate contains that of the wrench only.

        Open contacts have no force; the others then apply the wrench (`allocate_to_closed_contacts`).
        """
        schedule, R = self.internal, context.estimate.payload.R
        eta = base.smooth_pulse(context.clock.t, schedule.start, schedule.end, schedule.ramp) * schedule.eta
        rate = dataclasses.replace(self.allocation, offset=jnp.zeros_like(self.allocation.offset))
        lam = allocate(self.allocation, R, demand.W, eta)
        if (gain := self.allocation.yaw_gain) is not None:
            f_yaw = jnp.concatenate([f.f_w[:, 2] for f in demand.f_hat.agents])
            lam = lam + linalg.matvec(gain, f_yaw).reshape(-1, 3) @ R.T
        lam_dot = allocate(rate, R, demand.W_dot, jnp.zeros_like(eta))
        if (closed := context.team.closed_contacts) is not None:
            c = grasp.contact_points(context.team)
            lam = allocate_to_closed_contacts(c, closed, R, demand.W, lam)
            lam_dot = allocate_to_closed_contacts(c, closed, R, demand.W_dot, lam_dot)
        return ContactForceCommand(lam=lam, lam_dot=lam_dot, eta=eta), state
