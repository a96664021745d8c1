"""The nouns: parameters and states of a team, as immutable PyTrees.

Frames: world unless the name says otherwise; body rates are in the body's own frame. Agents that share a
`Tree` (joints and arms, not numbers) are stacked on a leading `agents` axis in one group; a team is a tuple
of such groups, so unlike agents need no padding. Two values of one type `Team` exist in a run: the truth,
which the plant integrates, and the nominal one, which flies.
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
    """`q_bar = (R, x, r, omega, v, r_dot)` of one agent, or of a group on a leading axis."""

    R: Float[Array, "*agents 3 3"]  # base attitude, body to world
    x: Float[Array, "*agents 3"]  # m, centre of mass of the whole agent
    r: Float[Array, "*agents n_r"]  # rad or m
    omega: Float[Array, "*agents 3"]  # rad/s, body frame
    v: Float[Array, "*agents 3"]  # m/s, velocity of the centre of mass
    r_dot: Float[Array, "*agents n_r"]  # rad/s or m/s


@pytree
class PayloadState:
    """`q_L = (p, v, R, omega)` of the payload."""

    R: Float[Array, "3 3"]
    p: Float[Array, "3"]  # m
    omega: Float[Array, "3"]  # rad/s, payload frame
    v: Float[Array, "3"]  # m/s


@pytree
class State:
    """The differential state z: 12 (N + 1) + 2 N n_r numbers on the grasp's manifold."""

    agents: tuple[AgentState, ...]
    payload: PayloadState


@pytree
class ControlClock:
    """The time of a tick, and how long one lasts: one clock for a whole flight."""

    t: Float[Array, ""]  # s
    dt: Float[Array, ""]  # s


@pytree
class AgentInput:
    """What an agent commands: thrust along `R e_3`, body torque, joint torques or forces."""

    u: Float[Array, "*agents"]  # N
    tau: Float[Array, "*agents 3"]  # N m, body frame
    tau_r: Float[Array, "*agents n_r"]  # N m or N


@pytree
class GeneralizedForce:
    """A generalized force on one agent: `f_x` on its centre of mass, `(f_w, f_r)` on `(mu, nu)`."""

    f_x: Float[Array, "*agents 3"]  # N, world
    f_w: Float[Array, "*agents 3"]  # N m, body frame
    f_r: Float[Array, "*agents n_r"]  # N m or N


@pytree
class Wrench:
    """A force in the world frame and a moment in the payload frame, on the payload."""

    F: Float[Array, "3"]  # N, world
    tau: Float[Array, "3"]  # N m, payload frame


@pytree
class ResidualForces:
    """The unknown `f_uk` of agents and payload, or an estimate of it."""

    agents: tuple[GeneralizedForce, ...]
    payload: Wrench


TeamInputs = tuple[AgentInput, ...]
"""What acts on the agents or is asked of them, by group."""
ResidualFunctionType = Callable[[State, Float[Array, ""]], ResidualForces]
"""The residual of a state and of the time since a step began, s."""


def flatten_agent_state(q: AgentState) -> Float[Array, "inputs"]:
    """`vec(R), x, r, omega, v, r_dot`: the inputs of an agent's learned map (Eq. dataset_agent_online)."""
    return jnp.concatenate([q.R.reshape(9), q.x, q.r, q.omega, q.v, q.r_dot])


def flatten_payload_state(q: PayloadState, a: Float[Array, "6"]) -> Float[Array, "24"]:
    """`p, v, vec(R), omega`, the payload's state (Eq. dataset_payload_online), then `(v_dot - a_g, w_dot)`."""
    return jnp.concatenate([q.p, q.v, q.R.reshape(9), q.omega, a])


def split_agent_force(y: Float[Array, "agents outputs"]) -> GeneralizedForce:
    """Agents' forces of their outputs, `(f_x, f_w, f_r)` in a row."""
    return GeneralizedForce(f_x=y[:, :3], f_w=y[:, 3:6], f_r=y[:, 6:])


def add_payload_wrench(f: ResidualForces, W: Float[Array, "6"]) -> ResidualForces:
    """The residual and a wrench on the payload, N and N m."""
    return dataclasses.replace(f, payload=Wrench(F=f.payload.F + W[:3], tau=f.payload.tau + W[3:]))


def zero_residual(team: Team) -> ResidualForces:
    """The zero residual of a team."""
    return ResidualForces(
        agents=tuple(
            GeneralizedForce(
                f_x=jnp.zeros((size, 3)), f_w=jnp.zeros((size, 3)), f_r=jnp.zeros((size, group.tree.joints))
            )
            for size, group in zip(team.sizes, team.agent_groups, strict=True)
        ),
        payload=Wrench(F=jnp.zeros(3), tau=jnp.zeros(3)),
    )
