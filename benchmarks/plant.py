"""The plant of the benchmarks: the reference team of the tests, with a step of RK4 and the projection."""

from __future__ import annotations

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
from jax.flatten_util import ravel_pytree

from colift.models.parameters import Team
from colift.models.state import AgentInput, State, zero_residual
from colift.simulation import contact_dynamics
from tests.support import random_teams as teams

DT = 1e-3  # s

Case = tuple[Team, State, contact_dynamics.TeamInputs]


def step(team: Team, z: State, inputs: contact_dynamics.TeamInputs, dt: jax.Array) -> State:
    """Return the state after RK4 and the projection."""
    return contact_dynamics.project_to_constraints(
        team, contact_dynamics.rkmk4_step(team, z, inputs, lambda _z, _t: zero_residual(team), dt)
    )


def rollout(steps: int) -> Callable[..., State]:
    """Return the state after many steps in one call."""

    def run(team: Team, z: State, inputs: contact_dynamics.TeamInputs, dt: jax.Array) -> State:
        return jax.lax.scan(lambda z, _: (step(team, z, inputs, dt), None), z, None, length=steps)[0]

    return run


def hover(agents: int) -> Case:
    """Return the reference team at rest, and its hover inputs."""
    team = teams.reference_team(agents)
    z = contact_dynamics.consistent_initial_state(team, teams.reference_guess(agents))
    zero = (AgentInput(u=jnp.zeros(agents), tau=jnp.zeros((agents, 3)), tau_r=jnp.zeros((agents, 3))),)
    flat, tree = ravel_pytree(zero)

    def acceleration(flat: jax.Array) -> jax.Array:
        return ravel_pytree(contact_dynamics.forward_dynamics(team, z, tree(flat), zero_residual(team))[0])[0]

    b, A = jax.jit(lambda x: (acceleration(x), jax.jacfwd(acceleration)(x)))(flat)
    return team, z, tree(jnp.asarray(np.linalg.lstsq(np.asarray(A), -np.asarray(b), rcond=None)[0]))


def supported_team(agents: int) -> Case:
    """Return the reference team with N agents at rest, each with an upward force of its share of the weight."""
    team = teams.reference_team(agents)
    weight = 9.81 * (team.agent_groups[0].mass.sum() + team.payload.mass)
    share = AgentInput(u=jnp.full(agents, weight / agents), tau=jnp.zeros((agents, 3)), tau_r=jnp.zeros((agents, 3)))
    return team, contact_dynamics.consistent_initial_state(team, teams.reference_guess(agents)), (share,)
