"""States, inputs and forces of a team as immutable PyTrees.

Agents of a group are stacked on a leading `agents` axis, see `colift.models.parameters`. Quantities are expressed in
the world frame unless stated otherwise; body rates and torques are in the body frame.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models.parameters import Team


@pytree
class AgentState:
    """State `q_bar = (R, x, r, omega, v, r_dot)` of one agent, or of a group with a leading `agents` axis."""

    R: Float[Array, "*agents 3 3"]  # base attitude, body to world
    x: Float[Array, "*agents 3"]  # m, center of mass of the agent
    r: Float[Array, "*agents n_r"]  # rad or m, joint positions
    omega: Float[Array, "*agents 3"]  # rad/s, body frame
    v: Float[Array, "*agents 3"]  # m/s, velocity of the center of mass
    r_dot: Float[Array, "*agents n_r"]  # rad/s or m/s, joint velocities


@pytree
class PayloadState:
    """State `q_L = (p, v, R, omega)` of the payload."""

    R: Float[Array, "3 3"]  # payload attitude, payload frame to world
    p: Float[Array, "3"]  # m, center of mass
    omega: Float[Array, "3"]  # rad/s, payload frame
    v: Float[Array, "3"]  # m/s, velocity of the center of mass


@pytree
class State:
    """State z of the team, `12 (N + 1) + 2 N n_r` numbers for N agents; it satisfies the contact constraints.

    Attributes:
        agents: States of the agents, by group.
        payload: State of the payload.
    """

    agents: tuple[AgentState, ...]
    payload: PayloadState


@pytree
class ControlClock:
    """Time and length of a control period."""

    t: Float[Array, ""]  # s, time since the start
    dt: Float[Array, ""]  # s, control period


@pytree
class AgentInput:
    """Inputs of an agent: thrust along `R e_3`, body torque, joint torques or forces."""

    u: Float[Array, "*agents"]  # N, thrust
    tau: Float[Array, "*agents 3"]  # N m, body frame
    tau_r: Float[Array, "*agents n_r"]  # N m or N, joint torques or forces


@pytree
class GeneralizedForce:
    """Generalized force on an agent: `f_x` on the center of mass, `(f_w, f_r)` on the momenta `(mu, nu)`."""

    f_x: Float[Array, "*agents 3"]  # N, world
    f_w: Float[Array, "*agents 3"]  # N m, body frame
    f_r: Float[Array, "*agents n_r"]  # N m or N


@pytree
class Wrench:
    """Wrench on the payload: force in the world frame, moment about the center of mass in the payload frame."""

    F: Float[Array, "3"]  # N, world
    tau: Float[Array, "3"]  # N m, payload frame


@pytree
class ResidualForces:
    """Residual forces `f_uk`, which the nominal equations do not contain, or an estimate of them.

    Attributes:
        agents: Generalized forces on the agents, by group.
        payload: Wrench on the payload.
    """

    agents: tuple[GeneralizedForce, ...]
    payload: Wrench


TeamInputs = tuple[AgentInput, ...]
"""Inputs of all agents, by group."""
ResidualFunctionType = Callable[[State, Float[Array, ""]], ResidualForces]
"""Function that returns the residual forces for a state and the time since the start of the step [s]."""


def flatten_agent_state(q: AgentState) -> Float[Array, "inputs"]:
    """Concatenate the state of an agent, the input of its residual model (Eq. dataset_agent_online).

    Args:
        q: State of one agent.

    Returns:
        `vec(R), x, r, omega, v, r_dot`.
    """
    return jnp.concatenate([q.R.reshape(9), q.x, q.r, q.omega, q.v, q.r_dot])


def flatten_payload_state(q: PayloadState, a: Float[Array, "6"]) -> Float[Array, "24"]:
    """Concatenate the state and the acceleration of the payload (Eq. dataset_payload_online).

    Args:
        q: State of the payload.
        a: `v_dot - a_g`, world frame, and `w_dot`, payload frame [m/s^2, rad/s^2].

    Returns:
        `p, v, vec(R), omega, a`.
    """
    return jnp.concatenate([q.p, q.v, q.R.reshape(9), q.omega, a])


def split_agent_force(y: Float[Array, "agents outputs"]) -> GeneralizedForce:
    """Split the outputs of residual models into generalized forces.

    Args:
        y: `(f_x, f_w, f_r)` of each agent [N, N m].

    Returns:
        The forces on the group.
    """
    return GeneralizedForce(f_x=y[:, :3], f_w=y[:, 3:6], f_r=y[:, 6:])


def flatten_agent_force(f: GeneralizedForce) -> Float[Array, "*agents outputs"]:
    """Concatenate a generalized force, the inverse of `split_agent_force`.

    Args:
        f: Generalized force on an agent or a group.

    Returns:
        `(f_x, f_w, f_r)` [N, N m].
    """
    return jnp.concatenate([f.f_x, f.f_w, f.f_r], axis=-1)


def add_payload_wrench(f: ResidualForces, W: Float[Array, "6"]) -> ResidualForces:
    """Add a wrench to the residual of the payload.

    Args:
        f: Residual forces.
        W: Force, world frame, and moment, payload frame [N, N m].

    Returns:
        The sum.
    """
    return dataclasses.replace(f, payload=Wrench(F=f.payload.F + W[:3], tau=f.payload.tau + W[3:]))


def zero_residual(team: Team) -> ResidualForces:
    """Return zero residual forces.

    Args:
        team: Team, which determines the shapes.

    Returns:
        The zero residual.
    """
    return ResidualForces(
        agents=tuple(
            GeneralizedForce(
                f_x=jnp.zeros((size, 3)), f_w=jnp.zeros((size, 3)), f_r=jnp.zeros((size, group.tree.joints))
            )
            for size, group in zip(team.sizes, team.agent_groups, strict=True)
        ),
        payload=Wrench(F=jnp.zeros(3), tau=jnp.zeros(3)),
    )
