"""Residual models: predictors of the residual forces that are constant between two updates.

A residual model holds one Gaussian process (GP) for the payload and one for each agent. A parametric part may be
added: a mean function, and the inertial wrench of identified rigid-body parameters. Models are immutable; an update
returns a new model.

See Also:
    colift.onboard.learning.model_update: fitting of models to recorded samples.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from colift import gp
from colift.math.pytree import pytree, transfer
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
from colift.onboard.learning.mean_functions import MeanFunction


@pytree
class ResidualModel:
    """Residual model of payload and agents.

    A body without data has a zero prediction with the standard deviation of its prior.

    Attributes:
        features: Maps from inputs to GP inputs.
        payload: GP of the payload.
        agents: GPs of the agents, by group; the agent is the first axis.
        inertial_parameters: Nominal minus true rigid-body parameters of the payload, in the order of
            `inertial_regressor`; zero without identification.
        mean_function: Mean function that is added to the GPs; None without one.
        update_index: Index k of the update that produced the model; 0 before the first update.
    """

    features: Features = DefaultFeatures()
    payload: gp.GPPosterior
    agents: tuple[gp.GPPosterior, ...]
    inertial_parameters: Float[Array, "10"]
    mean_function: MeanFunction | None = None
    update_index: Int[Array, ""] = dataclasses.field(default_factory=lambda: transfer(np.zeros((), int)))


def predict_mean(model: ResidualModel, payload: PayloadState, agents: tuple[AgentState, ...]) -> ResidualForces:
    """Predict the residual without the inertial part.

    Args:
        model: Residual model.
        payload: Payload state.
        agents: Agent states, by group.

    Returns:
        The prediction of GPs and mean function [N, N m].
    """
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
    """Predict the residual ``f_hat`` of payload and agents.

    The payload prediction is ``mean(q) + Y(q, a, alpha) theta`` with the inertial regressor ``Y``.

    Args:
        model: Residual model.
        payload: Payload state.
        agents: Agent states, by group.
        a: Acceleration of the payload's origin minus gravity [m/s^2], world frame.
        alpha: Angular acceleration of the payload [rad/s^2], payload frame.

    Returns:
        The prediction [N, N m].
    """
    return add_payload_wrench(
        predict_mean(model, payload, agents), inertial_regressor(payload, a, alpha) @ model.inertial_parameters
    )


@pytree
class ResidualFunction:
    """Mean of a residual model as a true residual, for scenarios whose residual has a stated RKHS norm.

    Attributes:
        model: Residual model that defines the function.
    """

    model: ResidualModel

    def __call__(self, state: State) -> ResidualForces:
        """Return the mean at a state [N, N m]."""
        return predict_mean(self.model, state.payload, state.agents)


def predict_payload(model: ResidualModel, x: Float[Array, "inputs"]) -> Wrench:
    """Predict the payload residual without the inertial part.

    Args:
        model: Residual model.
        x: Payload input.

    Returns:
        The wrench ``f_hat_L`` of GP and mean function.
    """
    f = gp.mean(model.payload, model.features.payload(x))
    if model.mean_function is not None:
        f = f + model.mean_function.payload_mean(x)
    return Wrench(F=f[:3], tau=f[3:])


def predict_agents(model: ResidualModel, x: tuple[Float[Array, "agents inputs"], ...]) -> tuple[GeneralizedForce, ...]:
    """Predict the residuals ``f_hat_j`` of all agents.

    Args:
        model: Residual model.
        x: Agent inputs, by group.

    Returns:
        The predictions, by group.
    """
    out = []
    for i, (group, inputs) in enumerate(zip(model.agents, x, strict=True)):
        f = jax.vmap(gp.mean)(group, model.features.agent(inputs))
        if model.mean_function is not None:
            f = f + model.mean_function.agent_means(i, inputs)
        out.append(split_agent_force(f))
    return tuple(out)


def get_model(model: ResidualModel, body: BodyKey) -> gp.GPPosterior:
    """Return the GP of a body.

    Args:
        model: Residual model.
        body: Key of the body.

    Returns:
        The GP without an agent axis.
    """
    return model.payload if isinstance(body, str) else _agent_model(model.agents[body[0]], body[1])


def replace_models(model: ResidualModel, models: Mapping[BodyKey, gp.GPPosterior]) -> ResidualModel:
    """Replace the GPs of some bodies.

    Args:
        model: Residual model.
        models: New GPs, by body.

    Returns:
        The model with the next update index; the same model if there is no new GP.
    """
    if not models:
        return model
    groups = []
    for i, group in enumerate(model.agents):
        each = [models[i, j] if (i, j) in models else _agent_model(group, j) for j in range(len(group.num_points))]
        groups.append(jax.tree.map(lambda *x: jnp.stack(x), *each))
    payload = models.get("payload", model.payload)
    return dataclasses.replace(model, payload=payload, agents=tuple(groups), update_index=model.update_index + 1)


def _agent_model(group: gp.GPPosterior, j: int) -> gp.GPPosterior:
    """Return the GP of agent j of a group."""
    return jax.tree.map(lambda x: x[j], group)


@jax.jit
def payload_std(model: ResidualModel, x: Float[Array, "time inputs"]) -> Float[Array, "time 6"]:
    """Compute the posterior standard deviation of the payload outputs at a series of inputs.

    Args:
        model: Residual model.
        x: Payload inputs, time first.

    Returns:
        Standard deviations [N, N m].
    """
    return jnp.sqrt(jax.vmap(gp.variance, in_axes=(None, 0))(model.payload, model.features.payload(x)))


@jax.jit
def agent_std(group: gp.GPPosterior, x: Float[Array, "time agents features"]) -> Float[Array, "time agents outputs"]:
    """Compute the posterior standard deviation of the outputs of a group at a series of features.

    Args:
        group: GPs of the agents of a group.
        x: Features of the agents, time first.

    Returns:
        Standard deviations [N, N m].
    """
    each = jax.vmap(gp.variance)
    return jnp.sqrt(jax.vmap(each, in_axes=(None, 0))(group, x))
