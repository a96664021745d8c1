"""Initial state of a scenario on the constraint manifold, and the equilibrium on its reference."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift.math import so3
from colift.math.linalg import matmul
from colift.models import aerial_manipulator, grasp, validation
from colift.models.parameters import AerialManipulator, Team
from colift.models.state import AgentState, PayloadState, State
from colift.scenario import schema, structure, team, trajectories
from colift.scenario.conversion import array
from colift.scenario.errors import ScenarioError
from colift.simulation import contact_dynamics
from colift.trajectories.base import PayloadSetpoint

IDENTITY = np.eye(3)
STANDSTILL = 1e-9  # m/s and rad/s, rounding of a reference at rest


def initial_state(settings: schema.Scenario, truth: Team, moving: bool = True) -> State:
    """Return the initial state on the constraint manifold, with the stated errors from the reference.

    Args:
        settings: Scenario.
        truth: True parameters.
        moving: True adds the velocities of the reference; the agents move with the payload.

    Returns:
        Initial state; each agent is above its contacts, with the heading of `trajectories.headings`.

    Raises:
        ScenarioError: If the team has a structural error (`structure`), if no such state exists nearby (the message
            contains the remaining error), if a body is not physically consistent, or if the grasp is redundant,
            singular or not controllable there.
    """
    _check_team(settings, truth)
    return _consistent_state(settings, truth, settings.initial_state, moving)


def equilibrium_state(settings: schema.Scenario, team: Team) -> State:
    """Return the state at rest with the payload at the start of its reference; raises as `initial_state`."""
    _check_team(settings, team)
    return state_at_rest(settings, team)


def state_at_rest(settings: schema.Scenario, team: Team) -> State:
    """Return the equilibrium of a team without structural errors, with physically consistent bodies.

    Args:
        settings: Scenario.
        team: Parameters for which `initial_state` exists.

    Returns:
        State at rest; raises as `initial_state`.
    """
    return _consistent_state(settings, team, schema.InitialState(), moving=False)


def _check_team(settings: schema.Scenario, truth: Team) -> None:
    """Check the properties of a team that do not depend on its state."""
    structure.check_structure(settings, truth)
    try:
        validation.validate_team(truth, team.agent_names(settings))
    except ValueError as error:
        raise ScenarioError(f"{settings.name}: {error}") from None


def _consistent_state(settings: schema.Scenario, truth: Team, given: schema.InitialState, moving: bool) -> State:
    """Return the state on the constraint manifold with the stated errors from the reference."""
    d = trajectories.setpoint(trajectories.make_reference(settings), array(0.0))
    load = PayloadState(
        p=d.p + array(given.position_error_m),
        R=_off(d.R, array(np.deg2rad(given.attitude_error_deg))),
        v=array(given.velocity_mps),
        omega=array(given.angular_velocity_radps),
    )
    moving = moving and max(float(np.abs(x).max()) for x in (d.v, d.omega)) > STANDSTILL
    if moving:
        load = dataclasses.replace(load, v=load.v + d.v, omega=load.omega + load.R.T @ (d.R @ d.omega))
    agents = tuple(
        _over_contacts(group, yaw, r, load)
        for group, yaw, r in zip(
            truth.agent_groups, trajectories.headings(settings), team.nominal_posture(settings), strict=True
        )
    )
    if moving:
        agents = tuple(_moved(group, q, d) for group, q in zip(truth.agent_groups, agents, strict=True))
    names = team.agent_names(settings)
    try:
        z = contact_dynamics.consistent_initial_state(
            truth, State(agents=agents, payload=load), names, team.contact_names(settings)
        )
        grasp.check_grasp(truth, z, names)
        grasp.check_controllability(truth, z, names)
    except ValueError as error:
        raise ScenarioError(f"{settings.name}: {error}") from None
    return z


_off = jax.jit(lambda R, theta: matmul(R, so3.exp(theta)))


@jax.jit
@functools.partial(jax.vmap, in_axes=(0, 0, 0, None))
def _over_contacts(agent: AerialManipulator, yaw: Array, r: Array, payload: PayloadState) -> AgentState:
    """Return the agents at rest, each with the mean of its tips at the mean of its contacts."""
    R = so3.exp(yaw * jnp.asarray(IDENTITY[2]))
    tips = aerial_manipulator.forward_kinematics(agent, r).points[-agent.tree.arms :]
    base = payload.p + (agent.contact_position @ payload.R.T - tips @ R.T).mean(0)
    zero = jnp.zeros(3)
    x = base + R @ aerial_manipulator.center_of_mass(agent, r)
    return AgentState(R=R, x=x, r=r, omega=zero, v=zero, r_dot=jnp.zeros_like(r))


def _moved(agents: AerialManipulator, q: AgentState, d: PayloadSetpoint) -> AgentState:
    """Return the agents with the velocity of the payload at the mean of their contacts."""
    arm = agents.contact_position.mean(1) @ d.R.T
    return dataclasses.replace(q, v=q.v + d.v[None] + so3.cross((d.R @ d.omega)[None], arm))
