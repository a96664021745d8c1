"""Where a scenario's flight begins: on the manifold, off the reference as stated, or at rest on it."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift.math import so3
from colift.math.linalg import mul
from colift.models import aerial_manipulator, grasp, validation
from colift.models.parameters import Agent, Team
from colift.models.state import AgentState, PayloadState, State
from colift.scenario import schema, team, trajectories
from colift.scenario.conversion import array
from colift.scenario.errors import ScenarioError
from colift.simulation import contact_dynamics

EYE = np.eye(3)


def start(settings: schema.Settings, truth: Team) -> State:
    """The first state: the payload off its reference as stated, every agent over its contacts, on the manifold.

    Raises ScenarioError where no such state is near, with what remains, and for a body that is not physical or a grasp
    that is redundant, singular or beyond control there.
    """
    given, d = settings.start, _setpoint(trajectories.path(settings), jnp.zeros(()))
    load = PayloadState(
        p=d.p + array(given.position_error_m),
        R=_off(d.R, jnp.deg2rad(array(given.attitude_error_deg))),
        v=array(given.velocity_mps),
        omega=array(given.body_rate_radps),
    )
    agents = tuple(
        _over_contacts(group, yaw, r, load)
        for group, yaw, r in zip(truth.groups, team.heading(settings), team.rest(settings), strict=True)
    )
    names = team.agent_names(settings)
    try:
        z = contact_dynamics.consistent(truth, State(agents=agents, payload=load), names)
        validation.check(truth, names)
        grasp.check(truth, z, names)
        grasp.check_control(truth, z, names)
    except ValueError as error:
        raise ScenarioError(f"{settings.name}: {error}") from None
    return z


_setpoint = jax.jit(lambda path, t: path.at(t))


_off = jax.jit(lambda R, theta: mul(R, so3.exp(theta)))


@jax.jit
@functools.partial(jax.vmap, in_axes=(0, 0, 0, None))
def _over_contacts(agent: Agent, yaw: Array, r: Array, load: PayloadState) -> AgentState:
    """Agents at rest, each with its tips, on average, where they belong."""
    R = so3.exp(yaw * jnp.asarray(EYE[2]))
    tips = aerial_manipulator.geometry(agent, r).point[-agent.tree.arms :]
    base = load.p + (agent.contact @ load.R.T - tips @ R.T).mean(0)
    zero = jnp.zeros(3)
    x = base + R @ aerial_manipulator.center_of_mass(agent, r)
    return AgentState(R=R, x=x, r=r, omega=zero, v=zero, r_dot=jnp.zeros_like(r))


def at_rest(settings: schema.Settings, team: Team) -> State:
    """The payload on its reference and everything at rest; raises as `start`."""
    return start(settings.model_copy(update={"start": schema.Start()}), team)
