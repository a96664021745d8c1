"""How far predictions may be off along a flight: posterior deviations, what no label can say, and radii.

A posterior knows where data are. A constant error of a sensor is in every label alike: no likelihood sees it, so what
the sensors' data sheets state of it is a part of its own. Both together are what an error is held against.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math.pytree import pytree
from colift.models import aerial_manipulator, grasp
from colift.models.parameters import AerialManipulator, Team
from colift.onboard.learning import confidence_bounds, residual_model, semiparametric

BATCH_STATES = 128  # states whose deviations are computed at once: one shape, one program


@pytree
class PredictionUncertainty:
    """Deviations of predictions and radii of their errors along a run, at a lower rate than the log; NumPy arrays."""

    t: np.ndarray  # s
    payload_std: np.ndarray  # (time, 6), posterior
    agent_std: tuple[np.ndarray, ...]  # (time, agents, outputs) by group
    payload_label_bias: np.ndarray  # (time, 6), of what labels are constantly off, as stated
    agent_label_bias: tuple[np.ndarray, ...]
    payload_radius: np.ndarray  # (time, 6), bounds each output's error: see `band.radius`
    agents_radius: tuple[np.ndarray, ...]


@dataclasses.dataclass(frozen=True)
class BiasModel:
    """What a data sheet states of an error that is constant or wanders: a deviation, `sqrt(start^2 + rate^2 t)`."""

    initial_std: float = 0.0  # unit of the reading
    random_walk_density: float = 0.0  # unit of the reading per square root of a second

    def std_at(self, t: np.ndarray) -> np.ndarray:
        """At times t, s."""
        return np.sqrt(self.initial_std**2 + self.random_walk_density**2 * t)

    def __add__(self, other: BiasModel) -> BiasModel:
        """Of two errors that know nothing of each other."""
        return BiasModel(
            float(np.hypot(self.initial_std, other.initial_std)),
            float(np.hypot(self.random_walk_density, other.random_walk_density)),
        )


@dataclasses.dataclass(frozen=True)
class LabelBiasModel:
    """Constant errors of what labels are made of, of each axis."""

    tips: BiasModel = BiasModel()  # N
    payload: BiasModel = BiasModel()  # m/s^2, of the accelerometer
    agents: BiasModel = BiasModel()  # m/s^2


@dataclasses.dataclass(frozen=True)
class ModelInterval:
    """An oracle, its bands and what its means may be off, which hold from a tick on."""

    start_tick: int
    model: residual_model.ResidualModel
    bands: confidence_bounds.ConfidenceBands
    mean_uncertainties: semiparametric.MeanUncertainties = dataclasses.field(default_factory=dict)


def evaluate_along(
    team: Team,
    held: Sequence[ModelInterval],
    every: int,
    biases: LabelBiasModel,
    t: np.ndarray,
    x: np.ndarray,
    agents: Sequence,
) -> PredictionUncertainty:
    """Deviations and radii at the true states of a flight, every so many ticks.

    team: as believed. x: payload samples at t, s; agents: those of the agents, by group.
    """
    first = [-(-each.start_tick // every) for each in held] + [len(x)]
    found = []
    for each, start, end in zip(held, first, first[1:], strict=False):
        for one in range(start, end, BATCH_STATES):
            here = slice(one, min(one + BATCH_STATES, end))
            found.append(_block(team, biases, each, t[here], x[here], [part[here] for part in agents]))
    payload, of_agents, labels, radius, radius_of_agents = jax.tree.map(lambda *parts: np.concatenate(parts), *found)
    return PredictionUncertainty(
        t=t,
        payload_std=payload,
        agent_std=of_agents,
        payload_label_bias=payload_label_bias_std(team, biases, t),
        agent_label_bias=labels,
        payload_radius=radius,
        agents_radius=radius_of_agents,
    )


def _block(
    team: Team, biases: LabelBiasModel, held: ModelInterval, t: np.ndarray, x: np.ndarray, agents: Sequence[np.ndarray]
) -> tuple[Any, ...]:
    """Posterior deviations and radii of payload and agents at a block of states, or at fewer."""
    n, oracle, bands = len(x), held.model, held.bands
    full, *of_agents = (
        jnp.asarray(np.pad(each, ((0, BATCH_STATES - n), *[(0, 0)] * (each.ndim - 1)))) for each in (x, *agents)
    )
    seen = [oracle.features.agent(each) for each in of_agents]
    payload = np.asarray(residual_model.payload_std(oracle, full))
    each_agent = [
        np.array(residual_model.agent_std(model, each)) for model, each in zip(oracle.agents, seen, strict=True)
    ]
    for body, unsure in held.mean_uncertainties.items():
        if isinstance(body, str):
            Z = np.asarray(oracle.features.payload(full))
            payload = np.hypot(
                payload,
                np.sqrt(
                    semiparametric.mean_variance(
                        oracle.payload, unsure, Z, semiparametric.mean_regressors(np.asarray(full), True)
                    )
                ),
            )
        else:
            i, j = body
            Z, one = np.asarray(seen[i])[:, j], residual_model.get_model(oracle, body)
            more = semiparametric.mean_variance(
                one, unsure, Z, semiparametric.mean_regressors(np.asarray(of_agents[i])[:, j], False)
            )
            each_agent[i][:, j] = np.hypot(each_agent[i][:, j], np.sqrt(more))
    groups = list(zip(oracle.agents, bands.bound_posterior.agents, bands.agent_beta, seen, strict=True))
    return (
        payload[:n],
        tuple(each[:n] for each in each_agent),
        tuple(
            agent_label_bias_std(biases, t, *(np.asarray(each)[:n] for each in _levers(group, inputs)))
            for group, inputs in zip(team.agent_groups, of_agents, strict=True)
        ),
        np.asarray(confidence_bounds.payload_radius(oracle, bands, full))[:n],
        tuple(np.asarray(confidence_bounds.agent_radius(*group))[:n] for group in groups),
    )


def payload_label_bias_std(team: Team, biases: LabelBiasModel, t: np.ndarray) -> Float[np.ndarray, "time 6"]:
    """What biases make of `m_L v_dot - f_g - G lam_hat`: `sqrt(n b^2 + (m_L a)^2)`, `sqrt(sum_c |rho_c x e_i|^2) b`.

    N (world) and N m (payload frame); b of each axis of the tips, a of the accelerometer.
    """
    rho = np.asarray(grasp.contact_points(team))
    b, a = biases.tips.std_at(t), biases.payload.std_at(t)
    force = np.sqrt(len(rho) * b**2 + (float(team.payload.mass) * a) ** 2)
    lever = np.sqrt(((rho**2).sum(1)[:, None] - rho**2).sum(0))
    return np.concatenate([np.repeat(force[:, None], 3, 1), b[:, None] * lever], axis=1)


def agent_label_bias_std(
    biases: LabelBiasModel,
    t: np.ndarray,
    arms: Float[np.ndarray, "time agents"],
    mass: Float[np.ndarray, "time agents"],
    lever: Float[np.ndarray, "time agents moments"],
) -> Float[np.ndarray, "time agents outputs"]:
    """What biases make of Eq. learning_output_components: `sqrt(arms b^2 + (m a)^2)`, N, and `lever b`, N m (base).

    lever: `sqrt(sum tip^2)` over all arms and axes, m, of the moments on the body and on its joints.
    """
    b, a = biases.tips.std_at(t)[:, None], biases.agents.std_at(t)[:, None]
    force = np.sqrt(arms * b**2 + (mass * a) ** 2)
    return np.concatenate([np.repeat(force[..., None], 3, 2), b[..., None] * lever], axis=2)


@jax.jit
def _levers(
    group: AerialManipulator, x: Float[Array, "time agents inputs"]
) -> tuple[Float[Array, "time agents"], Float[Array, "time agents"], Float[Array, "time agents moments"]]:
    """How many arms agents have, their masses and their levers along a path of inputs."""

    def one(agent: AerialManipulator, x: Float[Array, "inputs"]) -> tuple[Array, Array, Array]:
        p = aerial_manipulator.centroidal_model(
            agent, aerial_manipulator.forward_kinematics(agent, x[12 : 12 + agent.tree.joints])
        )
        return jnp.asarray(float(agent.tree.arms)), p.mass, jnp.sqrt((p.J_tip * p.J_tip).sum((0, 1)))

    return jax.vmap(jax.vmap(one), (None, 0))(group, x)
