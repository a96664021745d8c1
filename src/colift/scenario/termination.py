"""What a scenario's flight may not exceed, and the thrust that hovering takes of what there is."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift.closed_loop import termination
from colift.models import grasp
from colift.models.parameters import Team
from colift.models.state import ResidualForces, State, Wrench
from colift.onboard import controller
from colift.scenario import initial_states, schema, team
from colift.scenario.conversion import array
from colift.scenario.errors import ScenarioError
from colift.simulation import disturbances


def make_termination_limits(settings: schema.Scenario, truth: Team, state: State) -> termination.TerminationLimits:
    """What the flight from z may not exceed."""
    given = settings.termination
    return termination.TerminationLimits(
        min_delassus=given.min_grasp_ratio * _grip(truth, state),
        max_distance=array(given.max_position_error_m),
        min_height=array(-np.inf if given.min_height_m is None else given.min_height_m),
        max_attitude_error=_limit_rad(given.max_attitude_error_deg),
        max_tilt=_limit_rad(given.max_tilt_deg),
        max_saturation_time=array(given.max_saturation_time_s),
    )


_grip = jax.jit(grasp.min_delassus_singular_value)


def _limit_rad(deg: float) -> Array:
    """180 deg is no limit: an angle that is computed may exceed pi by rounding."""
    return array(np.inf if deg == 180 else np.deg2rad(deg))


def true_hover_thrust(
    settings: schema.Scenario,
    truth: Team,
    flying: controller.LeaderFollowerController,
    sources: disturbances.DisturbanceSet,
) -> np.ndarray:
    """`(agents,)` thrust that hovering on the reference takes in truth, N, with or without internal forces, the larger.

    Raises ScenarioError where it is more than the agents have.
    """
    z, given = initial_states.equilibrium_state(settings, truth), settings.allocation.internal
    f, moments = _acting(sources, truth, z), [0.0] if given is None else [0.0, (given.start_s + given.end_s) / 2]
    need = np.max([_hovering(truth, flying, z, f, array(t)) for t in moments], axis=0)
    have = np.concatenate([group.thrust_max for group in truth.agent_groups])
    names = team.agent_names(settings)
    short = [
        f"{name} needs {u:.4g} N of {most:.4g} N" for name, u, most in zip(names, need, have, strict=True) if u > most
    ]
    if short:
        raise ScenarioError(
            f"{settings.name}: the team cannot hover on its reference: {', '.join(short)} (agent_types: thrust_max_N); "
            f"all agents together need {need.sum():.4g} N and have {have.sum():.4g} N"
        )
    return need


_acting = jax.jit(disturbances.initial_forces)


@jax.jit
def _hovering(
    truth: Team, flying: controller.LeaderFollowerController, state: State, f: ResidualForces, t: Array
) -> Array:
    """`(agents,)` thrust at rest, N, with the internal forces of time t, s."""
    W = Wrench(F=-truth.payload.mass * truth.gravity - f.payload.F, tau=-f.payload.tau)
    steady = Wrench(F=jnp.zeros(3), tau=jnp.zeros(3))
    forces = flying.allocator.allocate(controller.context_at(flying, state, jnp.zeros(6), t), W, steady)
    return termination.hover_thrust(truth, forces.lam, f)
