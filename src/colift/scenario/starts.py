"""Where a scenario's flight begins: on the manifold, off the reference as stated, or at rest on it."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift import agent as ag
from colift import dynamics, grasp, model, so3
from colift.linalg import mul
from colift.model import Agent, AgentState, PayloadState, State, Team
from colift.scenario import paths, roster
from colift.scenario import settings as s
from colift.scenario.mistake import ScenarioError
from colift.scenario.values import array

EYE = np.eye(3)


def start(settings: s.Settings, truth: Team) -> State:
    """The first state: the payload off its reference as stated, every agent over its contacts, on the manifold.

    Raises ScenarioError where no such state is near, with what remains, and for a body that is not physical or a grasp
    that is redundant, singular or beyond control there.
    """
    given, d = settings.start, _setpoint(paths.path(settings), jnp.zeros(()))
    load = PayloadState(
        p=d.p + array(given.position_error_m),
        R=_off(d.R, jnp.deg2rad(array(given.attitude_error_deg))),
        v=array(given.velocity_mps),
        omega=array(given.body_rate_radps),
    )
    agents = tuple(
        _over_contacts(group, yaw, r, load)
        for group, yaw, r in zip(truth.groups, roster.heading(settings), roster.rest(settings), strict=True)
    )
    names = roster.agent_names(settings)
    try:
        z = dynamics.consistent(truth, State(agents=agents, payload=load), names)
        model.check(truth, names)
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
    tips = ag.geometry(agent, r).point[-agent.tree.arms :]
    base = load.p + (agent.contact @ load.R.T - tips @ R.T).mean(0)
    zero = jnp.zeros(3)
    x = base + R @ ag.center_of_mass(agent, r)
    return AgentState(R=R, x=x, r=r, omega=zero, v=zero, r_dot=jnp.zeros_like(r))


def at_rest(settings: s.Settings, team: Team) -> State:
    """The payload on its reference and everything at rest; raises as `start`."""
    return start(settings.model_copy(update={"start": s.Start()}), team)
