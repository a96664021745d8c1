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
    AgentState,
    GeneralizedForce,
    PayloadState,
    ResidualForces,
    State,
    Wrench,
    add_payload_wrench,
    flatten_agent_state,
    flatten_payload_state,
    split_agent_force,
)
from colift.onboard.learning.features import BodyKey, DefaultFeatures, Features
from colift.onboard.learning.identification import inertial_regressor
from colift.onboard.learning.mean_functions import BasisMean, DragThrustMean


@pytree
class ResidualModel:
    """The frozen predictors of one interval; those that have no data predict zero with their prior's deviation."""

    features: Features = DefaultFeatures()
    payload: gp.GPPosterior
    agents: tuple[gp.GPPosterior, ...]  # by group, agents lead
    inertial_parameters: Float[
        Array, "10"
    ]  # nominal less true rigid-body parameters of the payload, or zero: see `regressor`
    mean_function: BasisMean | DragThrustMean | None = None  # beside the GPs, see `Known`
    update_index: Int[Array, ""] = dataclasses.field(
        default_factory=lambda: jnp.zeros((), int)
    )  # of the update t_k, 0 before any


def predict_mean(model: ResidualModel, payload: PayloadState, agents: tuple[AgentState, ...]) -> ResidualForces:
    """The oracle's `f_hat` without its parametric part, in a state of the team."""
    return ResidualForces(
        payload=predict_payload(model, flatten_payload_state(payload, jnp.zeros(6))),
        agents=predict_agents(model, tuple(jax.vmap(flatten_agent_state)(q) for q in agents)),
    )


def predict(
    model: ResidualModel,
    payload: PayloadState,
    agents: tuple[AgentState, ...],
    a: Float[Array, "3"],
    alpha: Float[Array, "3"],
) -> ResidualForces:
    """`f_hat`: the means, and `Y theta` of a payload that accelerates by a less gravity, m/s^2, and alpha, rad/s^2."""
    return add_payload_wrench(
        predict_mean(model, payload, agents), inertial_regressor(payload, a, alpha) @ model.inertial_parameters
    )


@pytree
class ResidualFunction:
    """An oracle's mean as a function of the state: an unknown whose norm in its RKHS is known."""

    model: ResidualModel

    def __call__(self, state: State) -> ResidualForces:
        """`mean(z)`."""
        return predict_mean(self.model, state.payload, state.agents)


def predict_payload(model: ResidualModel, x: Float[Array, "inputs"]) -> Wrench:
    """The GP's share of `f_hat_L` at a payload sample."""
    f = gp.mean(model.payload, model.features.payload(x))
    if model.mean_function is not None:
        f = f + model.mean_function.payload_mean(x)
    return Wrench(F=f[:3], tau=f[3:])


def predict_agents(model: ResidualModel, x: tuple[Float[Array, "agents inputs"], ...]) -> tuple[GeneralizedForce, ...]:
    """`f_hat_j` of every agent."""
    out = []
    for i, (group, inputs) in enumerate(zip(model.agents, x, strict=True)):
        f = jax.vmap(gp.mean)(group, model.features.agent(inputs))
        if model.mean_function is not None:
            f = f + model.mean_function.agent_means(i, inputs)
        out.append(split_agent_force(f))
    return tuple(out)


def predict_padded(model: gp.GPPosterior, X: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A model's means and variances at up to as many places as its capacity: one shape, one program."""
    n = len(X)
    padded = np.concatenate([X, np.repeat(X[:1], model.capacity - n, 0)])
    mean, variance = gp.predict(model, jnp.asarray(padded))
    return np.asarray(mean)[:n], np.asarray(variance)[:n]


def get_model(model: ResidualModel, body: BodyKey) -> gp.GPPosterior:
    """A body's model."""
    return model.payload if isinstance(body, str) else _one(model.agents[body[0]], body[1])


def replace_models(model: ResidualModel, models: Mapping[BodyKey, gp.GPPosterior]) -> ResidualModel:
    """The oracle with some bodies' models in place of what they had."""
    if not models:
        return model
    groups = []
    for i, group in enumerate(model.agents):
        each = [models[i, j] if (i, j) in models else _one(group, j) for j in range(len(group.num_points))]
        groups.append(jax.tree.map(lambda *x: jnp.stack(x), *each))
    payload = models.get("payload", model.payload)
    return dataclasses.replace(model, payload=payload, agents=tuple(groups), update_index=model.update_index + 1)


def _one(group: gp.GPPosterior, j: int) -> gp.GPPosterior:
    return jax.tree.map(lambda x: x[j], group)


@jax.jit
def payload_std(model: ResidualModel, x: Float[Array, "time inputs"]) -> Float[Array, "time 6"]:
    """Posterior deviation of each payload output along a path of samples, N and N m."""
    return jnp.sqrt(jax.vmap(gp.variance, in_axes=(None, 0))(model.payload, model.features.payload(x)))


@jax.jit
def agent_std(group: gp.GPPosterior, x: Float[Array, "time agents features"]) -> Float[Array, "time agents outputs"]:
    """Posterior deviation of each agent output of a group along a path of features."""
    each = jax.vmap(gp.variance)
    return jnp.sqrt(jax.vmap(each, in_axes=(None, 0))(group, x))
