"""Check that the limits of the allocation permit hover."""

from __future__ import annotations

from collections.abc import Iterator

import jax
import jax.numpy as jnp
import numpy as np

from colift.analysis.findings import Finding, failure
from colift.models.state import State, zero_residual
from colift.onboard import controller, interfaces
from colift.onboard.control import tracking
from colift.onboard.control.constrained_allocation import ConstrainedAllocator
from colift.scenario import Scenario, team

MAX_ACCELERATION = 0.01  # m/s^2 and rad/s^2 in hover, above the error of the solver


def check_allocation(
    settings: Scenario, base_controller: controller.LeaderFollowerController, state: State
) -> Iterator[Finding]:
    """Check that the allocation within limits achieves zero acceleration with the nominal parameters.

    Args:
        settings: Scenario.
        base_controller: Controller.
        state: State at rest.

    Yields:
        A failed finding if the limits of thrust, tilt or contact forces do not permit hover; otherwise none.
    """
    allocator = base_controller.allocator
    if not isinstance(allocator, ConstrainedAllocator):
        return
    command = jax.jit(_hover_command)(base_controller, allocator.converged(), state)
    a, alpha = np.asarray(command.acceleration.a), np.asarray(command.acceleration.alpha)
    if max(np.linalg.norm(a), np.linalg.norm(alpha)) <= MAX_ACCELERATION:
        return
    report, agents, contacts = command.report, team.agent_names(settings), team.contact_names(settings)
    limits = {
        "thrust": (report.thrust, agents, "agent_types: thrust_max_N"),
        "tilt": (report.tilt, agents, "allocation.tilt_deg"),
        "friction": (report.friction, contacts, "allocation.contact.friction"),
        "contact force": (report.force, contacts, "allocation.contact.max_force_N, allocation.contact.min_force_N"),
    }
    active = {
        name: ([who for who, acts in zip(names, np.asarray(at).tolist(), strict=True) if acts], paths)
        for name, (at, names, paths) in limits.items()
        if np.asarray(at).any()
    }
    yield failure(
        "allocation",
        f"within its limits the team cannot hover: the payload accelerates by {np.linalg.norm(a):.3g} m/s^2 and "
        f"{np.linalg.norm(alpha):.3g} rad/s^2; active limits: "
        + "; ".join(f"{name} ({', '.join(names)})" for name, (names, _) in active.items()),
        {"acceleration_mps2": a.tolist(), "angular_acceleration_radps2": alpha.tolist()},
        f"change {', '.join(paths for _, paths in active.values())}, or lower payload.mass_kg",
    )


def _hover_command(
    base_controller: controller.LeaderFollowerController, allocator: ConstrainedAllocator, state: State
) -> interfaces.ContactForceCommand:
    """Return the contact forces for zero acceleration, without residuals and at the start of the flight."""
    nominal, f = base_controller.team, zero_residual(base_controller.team)
    demand = controller.tracking_demand(
        nominal,
        state.payload,
        tracking.AccelerationCommand(a=jnp.zeros(3), alpha=jnp.zeros(3), jerk=jnp.zeros(3)),
        f,
    )
    context = controller.context_at(base_controller, state, jnp.zeros(6), jnp.zeros(()))
    command, _ = allocator.allocate(allocator.init(), context, demand)
    return command
