"""Check that the limits of the allocation permit hover."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator

import jax.numpy as jnp
import numpy as np

from colift.analysis.findings import Finding, failure
from colift.models.state import State, zero_residual
from colift.onboard import controller
from colift.onboard.control.constrained_allocation import ConstrainedAllocator
from colift.scenario import Scenario, team, termination

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
    converged = dataclasses.replace(base_controller, allocator=allocator.converged())
    nominal, start = base_controller.team, jnp.zeros(())
    command = termination.hover_command(nominal, converged, state, zero_residual(nominal), start)
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
