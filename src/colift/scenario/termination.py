"""Termination limits of a scenario, and the thrust in hover."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift.closed_loop import termination
from colift.models import grasp, parameters
from colift.models.parameters import Team
from colift.models.state import ResidualForces, State, zero_residual
from colift.onboard import controller, interfaces
from colift.onboard.control import tracking
from colift.scenario import initial_states, schema, team
from colift.scenario.conversion import array
from colift.scenario.errors import ScenarioError
from colift.simulation import disturbances

HOVER_THRUST_MARGIN = 0.1
"""Default share of an agent's largest thrust that should remain in hover.

A mass error of 10 % or a commanded vertical acceleration of 1 m/s^2 then does not saturate the thrust.
"""
MIN_GRASP_RATIO = 0.01
"""Smallest singular value of an agent's `A M^-1 A^T` that ends a flight, relative to the initial value.

The value is zero in a singular configuration of the arms, and contact forces grow with its inverse. It stays above a
tenth of its initial value in the paper's study.
"""


def make_termination_limits(settings: schema.Scenario, truth: Team, state: State) -> termination.TerminationLimits:
    """Return the termination limits; the grasp limit is relative to the initial state."""
    given = settings.termination
    return termination.TerminationLimits(
        min_delassus=MIN_GRASP_RATIO * _grip(truth, state),
        max_distance=array(given.max_position_error_m),
        min_height=array(-np.inf if given.min_height_m is None else given.min_height_m),
        max_attitude_error=_limit_rad(given.max_attitude_error_deg),
        max_tilt=_limit_rad(given.max_tilt_deg),
        max_saturation_time=array(given.max_saturation_time_s),
        contacts=_contact_limits(settings),
    )


def _contact_limits(settings: schema.Scenario) -> termination.ContactLimits | None:
    """Return the limits of the contact forces; None without limits."""
    given = settings.physics
    if isinstance(given, schema.Plugin) or given.contact == schema.PlantContactLimits():
        return None
    contact, names = given.contact, team.contact_names(settings)
    normals = np.array([(contact.normal or {}).get(name, (0.0, 0.0, 1.0)) for name in names])  # required where used
    torsional = contact.torsional_friction_m
    with_friction = contact.friction is not None or torsional is not None  # such contacts can only press
    least = contact.min_force_N or 0.0 if with_friction else contact.min_force_N
    return termination.ContactLimits(
        normal=array(normals / np.linalg.norm(normals, axis=1, keepdims=True)),
        friction=array(np.inf if contact.friction is None else contact.friction),
        min_force=array(-np.inf if least is None else least),
        max_force=array(np.inf if contact.max_force_N is None else contact.max_force_N),
        torsional_friction=None
        if torsional is None
        else array([torsional if kind == parameters.SOFT_FINGER else np.inf for kind in team.contact_types(settings)]),
    )


_grip = jax.jit(grasp.min_delassus_singular_value)


def _limit_rad(deg: float) -> Array:
    """Convert a limit to rad; 180 deg disables it, because a computed angle may exceed pi by rounding."""
    return array(np.inf if deg == 180 else np.deg2rad(deg))


def true_hover_thrust(
    settings: schema.Scenario,
    truth: Team,
    base_controller: controller.LeaderFollowerController,
    sources: disturbances.DisturbanceSet,
) -> np.ndarray:
    """Compute the true thrust in hover on the reference: the larger of the values with and without internal forces.

    Args:
        settings: Scenario.
        truth: True parameters, for which an initial state exists.
        base_controller: Controller.
        sources: Disturbances.

    Returns:
        Thrust `(agents,)` [N].

    Raises:
        ScenarioError: If it exceeds the largest thrust of an agent.
    """
    z, given = initial_states.state_at_rest(settings, truth), settings.allocation.internal
    f, moments = _acting(sources, truth, z), [0.0] if given is None else [0.0, (given.start_s + given.end_s) / 2]
    required = np.max([hover_forces(truth, base_controller, z, f, array(t))[0] for t in moments], axis=0)
    have = np.concatenate([group.thrust_max for group in truth.agent_groups])
    names = team.agent_names(settings)
    short = [
        f"{name} needs {u:.4g} N of {most:.4g} N"
        for name, u, most in zip(names, required, have, strict=True)
        if u > most
    ]
    if short:
        raise ScenarioError(
            f"{settings.name}: the team cannot hover on its reference: {', '.join(short)} (agent_types: thrust_max_N); "
            f"all agents together need {required.sum():.4g} N and have {have.sum():.4g} N"
        )
    return required


def undisturbed_hover_thrust(
    truth: Team, base_controller: controller.LeaderFollowerController, state: State
) -> np.ndarray:
    """Compute the thrust in hover without disturbances and without internal forces.

    Args:
        truth: True parameters.
        base_controller: Controller.
        state: State at rest.

    Returns:
        Thrust `(agents,)` [N].
    """
    return np.asarray(hover_forces(truth, base_controller, state, zero_residual(truth), jnp.zeros(()))[0])


def disturbance_torques(truth: Team, sources: disturbances.DisturbanceSet, state: State) -> np.ndarray:
    """Compute the moments of the disturbances on the bases of the agents at time zero.

    Args:
        truth: True parameters.
        sources: Disturbances.
        state: State at rest.

    Returns:
        Moments about the centers of mass `(agents, 3)`, base frames [N m].
    """
    return np.concatenate([np.asarray(f.f_w) for f in _acting(sources, truth, state).agents])


_acting = jax.jit(disturbances.initial_forces)
_hover_thrust = jax.jit(termination.hover_thrust)


@jax.jit
def hover_command(
    team: Team, base_controller: controller.LeaderFollowerController, state: State, f: ResidualForces, t: Array
) -> interfaces.ContactForceCommand:
    """Allocate contact forces for zero acceleration at rest, with the internal forces of one time.

    Args:
        team: Parameters of the payload and gravity.
        base_controller: Controller.
        state: State at rest.
        f: Forces on payload and agents in addition to gravity.
        t: Time [s].

    Returns:
        The commanded contact forces, and the acceleration that they achieve.
    """
    rest = tracking.AccelerationCommand(a=jnp.zeros(3), alpha=jnp.zeros(3), jerk=jnp.zeros(3))
    demand = controller.tracking_demand(team, state.payload, rest, f)
    context = controller.context_at(base_controller, state, jnp.zeros(6), t)
    command, _ = base_controller.allocator.allocate(base_controller.allocator.init(), context, demand)
    return command


def hover_forces(
    truth: Team, base_controller: controller.LeaderFollowerController, state: State, f: ResidualForces, t: Array
) -> tuple[Array, Array]:
    """Compute the forces at rest, with the allocation of a controller and its internal forces at one time.

    Args:
        truth: True parameters.
        base_controller: Controller.
        state: State at rest.
        f: Forces on payload and agents in addition to gravity.
        t: Time [s].

    Returns:
        Thrust `(agents,)` [N], and contact forces on the payload `(contacts, 3)` [N, world].
    """
    lam = hover_command(truth, base_controller, state, f, t).lam
    return _hover_thrust(truth, lam, f), lam
