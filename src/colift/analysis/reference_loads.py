"""Loads of a team that follows its reference in the equilibrium configuration: thrust and residual forces.

Contributions of joint motion, agent attitudes and tracking errors are neglected.
"""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.closed_loop import flight
from colift.math import so3
from colift.math.linalg import matmul, transpose
from colift.models import grasp
from colift.models.parameters import Team
from colift.models.state import PayloadState, State, Wrench
from colift.onboard import controller, interfaces
from colift.onboard.control import tracking
from colift.simulation import disturbances
from colift.trajectories.base import PayloadSetpoint


def thrust_profile(experiment: flight.Experiment, state: State, t: np.ndarray) -> np.ndarray:
    """Compute the thrust that every agent needs along the reference.

    The team is assumed to follow the reference in its equilibrium configuration. Contributions of joint motion, agent
    attitudes and tracking errors are neglected.

    Args:
        experiment: Experiment with team, controller and disturbances.
        state: Equilibrium of the team.
        t: Times [s].

    Returns:
        Thrust `(times, agents)` [N].
    """
    return np.asarray(
        _along(experiment.world.team, experiment.controller, experiment.world.disturbances, state, jnp.asarray(t))
    )


def residual_forces(experiment: flight.Experiment, state: State, t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Compute the residual forces that are to be learned along the reference: disturbances and mass errors.

    Args:
        experiment: Experiment with team, controller and disturbances.
        state: Equilibrium of the team.
        t: Times [s].

    Returns:
        Forces on the payload `(times, 3)` and on the agents `(times, agents, 3)` [N].
    """
    world = experiment.world
    payload, agents = _residuals(world.team, experiment.controller, world.disturbances, state, jnp.asarray(t))
    return np.asarray(payload), np.asarray(agents)


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, None, None, None, 0))
def _along(
    team: Team,
    onboard_controller: controller.LeaderFollowerController,
    sources: disturbances.DisturbanceSet,
    state: State,
    t: Array,
) -> Float[Array, "agents"]:
    """Compute the thrust of every agent at one time on the reference."""
    g, payload = team.gravity, team.payload
    d, moved, accelerations = _on_reference(team, onboard_controller, state, t)
    f = disturbances.initial_forces(sources, team, moved)
    angular_rate = payload.inertia @ d.omega_dot + so3.cross(d.omega, payload.inertia @ d.omega)
    demand = interfaces.AllocationDemand(
        acceleration_cmd=tracking.AccelerationCommand(a=d.a, alpha=d.omega_dot, jerk=jnp.zeros(3)),
        f_hat=f,
        W=Wrench(F=payload.mass * (d.a - g) - f.payload.F, tau=angular_rate - f.payload.tau),
        W_dot=Wrench(F=jnp.zeros(3), tau=jnp.zeros(3)),
    )
    context = controller.context_at(onboard_controller, moved, jnp.zeros(6), t)
    allocator = onboard_controller.allocator
    lam = allocator.allocate(allocator.init(), context, demand)[0].lam
    parts = zip(team.agent_groups, grasp.split_contacts(team, lam), accelerations, f.agents, strict=True)
    required = [
        force.sum(1) + group.mass.sum(1, keepdims=True) * (a - g[None]) - f_j.f_x for group, force, a, f_j in parts
    ]
    return jnp.linalg.norm(jnp.concatenate(required), axis=1)


def _on_reference(
    team: Team, onboard_controller: controller.LeaderFollowerController, state: State, t: Array
) -> tuple[PayloadSetpoint, State, list[Float[Array, "_agents 3"]]]:
    """Return the setpoint, the state that follows it in the equilibrium configuration, and accelerations of agents."""
    d = onboard_controller.reference.evaluate(t)
    omega_hat = so3.hat(d.omega)
    rotation_acceleration = matmul(d.R, so3.hat(d.omega_dot) + matmul(omega_hat, omega_hat))
    agents, accelerations = [], []
    for group, q in zip(team.agent_groups, state.agents, strict=True):
        c = group.contact_position.mean(1)
        shift = (d.p - state.payload.p)[None] + c @ transpose(d.R - state.payload.R)
        agents.append(dataclasses.replace(q, x=q.x + shift, v=d.v[None] + c @ transpose(matmul(d.R, omega_hat))))
        accelerations.append(d.a[None] + c @ transpose(rotation_acceleration))
    return d, State(agents=tuple(agents), payload=PayloadState(p=d.p, R=d.R, v=d.v, omega=d.omega)), accelerations


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, None, None, None, 0))
def _residuals(
    team: Team,
    onboard_controller: controller.LeaderFollowerController,
    sources: disturbances.DisturbanceSet,
    state: State,
    t: Array,
) -> tuple[Float[Array, "3"], Float[Array, "agents 3"]]:
    """Compute the residual forces of payload and agents at one time on the reference [N]."""
    d, moved, accelerations = _on_reference(team, onboard_controller, state, t)
    f = disturbances.initial_forces(sources, team, moved)
    mismatch = onboard_controller.team.payload.mass - team.payload.mass
    agents = [
        f_j.f_x + (nominal.mass.sum(1) - group.mass.sum(1))[:, None] * (a - team.gravity[None])
        for f_j, nominal, group, a in zip(
            f.agents, onboard_controller.team.agent_groups, team.agent_groups, accelerations, strict=True
        )
    ]
    return f.payload.F + mismatch * (d.a - team.gravity), jnp.concatenate(agents)
