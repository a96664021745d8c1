"""Where a scenario's flight begins: on the manifold, off the reference as stated, or at rest on it."""

from __future__ import annotations

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
from colift.scenario import schema, team, trajectories
from colift.scenario.conversion import array
from colift.scenario.errors import ScenarioError
from colift.simulation import contact_dynamics

IDENTITY = np.eye(3)


def initial_state(settings: schema.Scenario, truth: Team) -> State:
    """The first state: the payload off its reference as stated, every agent over its contacts, on the manifold.

    Raises ScenarioError where no such state is near, with what remains, and for a body that is not physical or a grasp
    that is redundant, singular or beyond control there.
    """
    given, d = settings.initial_state, _setpoint(trajectories.make_reference(settings), jnp.zeros(()))
    load = PayloadState(
        p=d.p + array(given.position_error_m),
        R=_off(d.R, jnp.deg2rad(array(given.attitude_error_deg))),
        v=array(given.velocity_mps),
        omega=array(given.angular_velocity_radps),
    )
    agents = tuple(
        _over_contacts(group, yaw, r, load)
        for group, yaw, r in zip(
            truth.agent_groups, team.initial_yaw(settings), team.nominal_posture(settings), strict=True
        )
    )
    names = team.agent_names(settings)
    try:
        z = contact_dynamics.consistent_initial_state(truth, State(agents=agents, payload=load), names)
        validation.validate_team(truth, names)
        grasp.check_grasp(truth, z, names)
        grasp.check_controllability(truth, z, names)
    except ValueError as error:
        raise ScenarioError(f"{settings.name}: {error}") from None
    return z


_setpoint = jax.jit(lambda path, t: path.evaluate(t))


_off = jax.jit(lambda R, theta: matmul(R, so3.exp(theta)))


@jax.jit
@functools.partial(jax.vmap, in_axes=(0, 0, 0, None))
def _over_contacts(agent: AerialManipulator, yaw: Array, r: Array, payload: PayloadState) -> AgentState:
    """Agents at rest, each with its tips, on average, where they belong."""
    R = so3.exp(yaw * jnp.asarray(IDENTITY[2]))
    tips = aerial_manipulator.forward_kinematics(agent, r).points[-agent.tree.arms :]
    base = payload.p + (agent.contact_position @ payload.R.T - tips @ R.T).mean(0)
    zero = jnp.zeros(3)
    x = base + R @ aerial_manipulator.center_of_mass(agent, r)
    return AgentState(R=R, x=x, r=r, omega=zero, v=zero, r_dot=jnp.zeros_like(r))


def equilibrium_state(settings: schema.Scenario, team: Team) -> State:
    """The payload on its reference and everything at rest; raises as `start`."""
    return initial_state(settings.model_copy(update={"initial_state": schema.InitialState()}), team)
