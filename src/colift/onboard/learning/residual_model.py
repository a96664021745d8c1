"""What is learned: features, samples that are recorded in flight, frozen oracles.

On `[t_k, t_{k+1})` the oracle is an immutable value. Data sets keep the raw, filtered inputs; a feature map turns
them into what a GP sees, so another map needs no new data.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from colift import gp
from colift.math.pytree import pytree
from colift.models.state import (
    AgentForce,
    AgentState,
    PayloadState,
    Residual,
    State,
    Wrench,
    agent_force,
    flat_agent,
    flat_payload,
    with_wrench,
)
from colift.onboard.learning.features import Body, Features, Plain
from colift.onboard.learning.identification import regressor
from colift.onboard.learning.mean_functions import Air, Linear


@pytree
class Oracle:
    """The frozen predictors of one interval; those that have no data predict zero with their prior's deviation."""

    features: Features = Plain()
    payload: gp.GP
    agents: tuple[gp.GP, ...]  # by group, agents lead
    theta: Float[Array, "10"]  # nominal less true rigid-body parameters of the payload, or zero: see `regressor`
    known: Linear | Air | None = None  # beside the GPs, see `Known`
    k: Int[Array, ""] = dataclasses.field(default_factory=lambda: jnp.zeros((), int))  # of the update t_k, 0 before any


def mean(oracle: Oracle, load: PayloadState, agents: tuple[AgentState, ...]) -> Residual:
    """The oracle's `f_hat` without its parametric part, in a state of the team."""
    return Residual(
        payload=payload_mean(oracle, flat_payload(load, jnp.zeros(6))),
        agents=agents_mean(oracle, tuple(jax.vmap(flat_agent)(q) for q in agents)),
    )


def prediction(
    oracle: Oracle,
    load: PayloadState,
    agents: tuple[AgentState, ...],
    a: Float[Array, "3"],
    alpha: Float[Array, "3"],
) -> Residual:
    """`f_hat`: the means, and `Y theta` of a payload that accelerates by a less gravity, m/s^2, and alpha, rad/s^2."""
    return with_wrench(mean(oracle, load, agents), regressor(load, a, alpha) @ oracle.theta)


@pytree
class Function:
    """An oracle's mean as a function of the state: an unknown whose norm in its RKHS is known."""

    oracle: Oracle

    def __call__(self, z: State) -> Residual:
        """`mean(z)`."""
        return mean(self.oracle, z.payload, z.agents)


def payload_mean(oracle: Oracle, x: Float[Array, "inputs"]) -> Wrench:
    """The GP's share of `f_hat_L` at a payload sample."""
    f = gp.mean(oracle.payload, oracle.features.payload(x))
    if oracle.known is not None:
        f = f + oracle.known.on_payload(x)
    return Wrench(F=f[:3], tau=f[3:])


def agents_mean(oracle: Oracle, x: tuple[Float[Array, "agents inputs"], ...]) -> tuple[AgentForce, ...]:
    """`f_hat_j` of every agent."""
    out = []
    for i, (group, inputs) in enumerate(zip(oracle.agents, x, strict=True)):
        f = jax.vmap(gp.mean)(group, oracle.features.agent(inputs))
        if oracle.known is not None:
            f = f + oracle.known.on_agents(i, inputs)
        out.append(agent_force(f))
    return tuple(out)


def told(model: gp.GP, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A model's means and variances at up to as many places as its capacity: one shape, one program."""
    n = len(X)
    padded = np.concatenate([X, np.repeat(X[:1], model.capacity - n, 0)])
    mean, variance = gp.predict(model, jnp.asarray(padded))
    return np.asarray(mean)[:n], np.asarray(variance)[:n]


def of_body(oracle: Oracle, body: Body) -> gp.GP:
    """A body's model."""
    return oracle.payload if isinstance(body, str) else _one(oracle.agents[body[0]], body[1])


def with_bodies(oracle: Oracle, models: Mapping[Body, gp.GP]) -> Oracle:
    """The oracle with some bodies' models in place of what they had."""
    if not models:
        return oracle
    groups = []
    for i, group in enumerate(oracle.agents):
        each = [models[i, j] if (i, j) in models else _one(group, j) for j in range(len(group.n))]
        groups.append(jax.tree.map(lambda *x: jnp.stack(x), *each))
    payload = models.get("payload", oracle.payload)
    return dataclasses.replace(oracle, payload=payload, agents=tuple(groups), k=oracle.k + 1)


def _one(group: gp.GP, j: int) -> gp.GP:
    return jax.tree.map(lambda x: x[j], group)


@jax.jit
def payload_deviation(oracle: Oracle, x: Float[Array, "time inputs"]) -> Float[Array, "time 6"]:
    """Posterior deviation of each payload output along a path of samples, N and N m."""
    return jnp.sqrt(jax.vmap(gp.variance, in_axes=(None, 0))(oracle.payload, oracle.features.payload(x)))


@jax.jit
def agent_deviation(group: gp.GP, x: Float[Array, "time agents features"]) -> Float[Array, "time agents outputs"]:
    """Posterior deviation of each agent output of a group along a path of features."""
    each = jax.vmap(gp.variance)
    return jnp.sqrt(jax.vmap(each, in_axes=(None, 0))(group, x))
