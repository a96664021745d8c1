"""Predictive standard deviations, label biases and error bounds along a trajectory.

The posterior standard deviation of a residual model depends on the distance to its data. A constant sensor error is
in all labels, so no likelihood detects it. Its standard deviation follows from the sensor data sheets and is reported
separately. Prediction errors are compared with both together.

See Also:
    docs/learning: predictive uncertainty.
    colift.onboard.learning.confidence_bounds: the error bounds.
"""

from __future__ import annotations

import dataclasses
import functools
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

BATCH_STATES = 32
"""Number of states of one evaluation, so that one shape has to be compiled."""


@pytree
class PredictionUncertainty:
    """Standard deviations and error bounds along a run, in NumPy arrays with time on the first axis.

    Attributes:
        t: Times [s].
        payload_std: Posterior standard deviations of the payload outputs, of shape (time, 6) [N, N m].
        agent_std: Posterior standard deviations of the agent outputs, by group, of shape (time, agents, outputs).
        payload_label_bias: Standard deviations of the label bias of the payload, of shape (time, 6) [N, N m].
        agent_label_bias: Standard deviations of the label bias of the agents, by group.
        payload_radius: Error bounds of the payload outputs, of shape (time, 6); see `confidence_bounds.error_radius`.
        agent_radius: Error bounds of the agent outputs, by group.
        force_errors_to_payload: Squared entries of the maps of `force_errors_to_payload`, of shape
            (time, 6, agents, 3) [1, m^2].
    """

    t: np.ndarray
    payload_std: np.ndarray
    agent_std: tuple[np.ndarray, ...]
    payload_label_bias: np.ndarray
    agent_label_bias: tuple[np.ndarray, ...]
    payload_radius: np.ndarray
    agent_radius: tuple[np.ndarray, ...]
    force_errors_to_payload: np.ndarray


@dataclasses.dataclass(frozen=True)
class BiasModel:
    """Standard deviation ``sqrt(b_0^2 + q^2 t)`` of a sensor bias, as stated in a data sheet.

    Attributes:
        initial_std: Initial standard deviation ``b_0`` in the unit of the measurement.
        random_walk_density: Density ``q`` of the random walk in the unit of the measurement per root second.
    """

    initial_std: float = 0.0
    random_walk_density: float = 0.0

    def std_at(self, t: np.ndarray) -> np.ndarray:
        """Return the standard deviation at times.

        Args:
            t: Times since the initial calibration [s].

        Returns:
            Standard deviations in the unit of the measurement.
        """
        return np.sqrt(self.initial_std**2 + self.random_walk_density**2 * t)

    def __add__(self, other: BiasModel) -> BiasModel:
        """Return the model of the sum of two independent biases."""
        return BiasModel(
            float(np.hypot(self.initial_std, other.initial_std)),
            float(np.hypot(self.random_walk_density, other.random_walk_density)),
        )


@dataclasses.dataclass(frozen=True)
class LabelBiasModel:
    """Biases of the sensors from which labels are computed, of each axis.

    Attributes:
        tips: Bias of the tip force sensors [N].
        payload: Bias of the payload's accelerometer [m/s^2].
        agents: Bias of the agents' accelerometers [m/s^2].
    """

    tips: BiasModel = BiasModel()
    payload: BiasModel = BiasModel()
    agents: BiasModel = BiasModel()


class UncertaintyAlongRun:
    """Standard deviations and error bounds along a run, evaluated model by model in the order of use.

    States are added as the run proceeds. Before a residual model is replaced, `evaluate` is called with it, so that no
    earlier model has to be kept.

    Example:
        ::

            along = UncertaintyAlongRun(team, biases)
            along.add(t, x, agents)
            along.evaluate(model, bands, {})
            uncertainty = along.result()
    """

    def __init__(self, team: Team, biases: LabelBiasModel) -> None:
        """Start without states.

        Args:
            team: Nominal parameters.
            biases: Biases of the sensors.
        """
        self._team, self._biases = team, biases
        self._states: list[tuple[np.ndarray, np.ndarray, tuple[np.ndarray, ...]]] = []
        self._blocks: list[tuple[Any, ...]] = []
        self._num_evaluated = 0  # entries of `_states`

    def add(self, t: np.ndarray, x: np.ndarray, agents: Sequence[np.ndarray]) -> None:
        """Add true states of the run.

        Args:
            t: Times of the states [s].
            x: Payload inputs, time first.
            agents: Agent inputs by group, time first.
        """
        if len(t):
            self._states.append((t, x, tuple(agents)))

    def evaluate(
        self,
        model: residual_model.ResidualModel,
        bands: confidence_bounds.ConfidenceBands,
        mean_uncertainties: semiparametric.MeanUncertainties,
    ) -> None:
        """Evaluate all states since the last call.

        Args:
            model: Residual model in use at these states.
            bands: Error bounds of the model.
            mean_uncertainties: Mean uncertainties of the model, by body.
        """
        states = self._states[self._num_evaluated :]
        if not states:
            return
        self._num_evaluated = len(self._states)
        _, x, agents = _concatenate(states)
        if not _has_samples(model):  # the prior is equal at all states
            prior = _evaluate_prior(_PriorKey(model, bands, x[:1], tuple(group[:1] for group in agents)))
            self._blocks.append(jax.tree.map(lambda values: np.repeat(values, len(x), axis=0), prior))
            return
        for start in range(0, len(x), BATCH_STATES):
            rows = slice(start, min(start + BATCH_STATES, len(x)))
            inputs = [group[rows] for group in agents]
            self._blocks.append(_evaluate_block(model, bands, mean_uncertainties, x[rows], inputs))

    def result(self) -> PredictionUncertainty:
        """Return standard deviations and error bounds at all states, which were evaluated before."""
        team, biases, (t, x, agents) = self._team, self._biases, _concatenate(self._states)
        payload_std, agent_std, payload_radius, agent_radius = _concatenate(self._blocks)
        agent_label_bias = tuple(
            _agent_label_bias(group, biases, t, inputs) for group, inputs in zip(team.agent_groups, agents, strict=True)
        )
        return PredictionUncertainty(
            t=t,
            payload_std=payload_std,
            agent_std=agent_std,
            payload_label_bias=payload_label_bias_std(team, biases, t),
            agent_label_bias=agent_label_bias,
            payload_radius=payload_radius,
            agent_radius=agent_radius,
            force_errors_to_payload=force_errors_to_payload(team, x[:, 6:15].reshape(-1, 3, 3)) ** 2,
        )


def _concatenate(parts: Sequence[tuple[Any, ...]]) -> tuple[Any, ...]:
    """Concatenate the arrays of equal structures along the time."""
    return jax.tree.map(lambda *arrays: np.concatenate(arrays), *parts)


def _has_samples(model: residual_model.ResidualModel) -> bool:
    """Return whether the GP of any body has samples."""
    return any(np.any(np.asarray(each.num_points) > 0) for each in (model.payload, *model.agents))


@dataclasses.dataclass(frozen=True, eq=False)
class _PriorKey:
    """Prior with its bounds and any one state; equal if all arrays of prior and bounds are the same objects."""

    model: residual_model.ResidualModel
    bands: confidence_bounds.ConfidenceBands
    x: np.ndarray
    agents: tuple[np.ndarray, ...]

    @functools.cached_property
    def arrays(self) -> tuple[Any, list[int]]:
        """Structure of prior and bounds, and the identities of their arrays, which the key keeps alive."""
        leaves, structure = jax.tree.flatten((self.model, self.bands))
        return structure, [id(leaf) for leaf in leaves]

    def __hash__(self) -> int:
        """Return the hash of the arrays."""
        return hash(tuple(self.arrays[1]))

    def __eq__(self, other: object) -> bool:
        """Return whether prior and bounds have the same arrays."""
        return isinstance(other, _PriorKey) and self.arrays == other.arrays


@functools.lru_cache(maxsize=2)
def _evaluate_prior(key: _PriorKey) -> tuple[Any, ...]:
    """Evaluate a prior at one state; flights with the same prior share the result, which takes 25 ms."""
    return _evaluate_block(key.model, key.bands, {}, key.x, key.agents, states=1)


def _pad(inputs: np.ndarray, states: int = BATCH_STATES) -> Array:
    """Return the inputs with zeros up to a number of states."""
    return jnp.asarray(np.pad(inputs, ((0, states - len(inputs)), *[(0, 0)] * (inputs.ndim - 1))))


def _agent_label_bias(
    group: AerialManipulator, biases: LabelBiasModel, t: np.ndarray, x: np.ndarray
) -> Float[np.ndarray, "time agents outputs"]:
    """Return the standard deviation of the label bias of the agents of a group at a series of inputs."""
    blocks = []
    for start in range(0, len(x), BATCH_STATES):
        rows = slice(start, min(start + BATCH_STATES, len(x)))
        values = (np.asarray(each)[: rows.stop - start] for each in _arm_levers(group, _pad(x[rows])))
        blocks.append(agent_label_bias_std(biases, t[rows], *values))
    return np.concatenate(blocks)


def _evaluate_block(
    model: residual_model.ResidualModel,
    bands: confidence_bounds.ConfidenceBands,
    mean_uncertainties: semiparametric.MeanUncertainties,
    x: np.ndarray,
    agents: Sequence[np.ndarray],
    states: int = BATCH_STATES,
) -> tuple[Any, ...]:
    """Evaluate standard deviations and error bounds of at most a number of states."""
    n = len(x)
    padded, *padded_agents = (_pad(inputs, states) for inputs in (x, *agents))
    features = [model.features.agent(inputs) for inputs in padded_agents]
    payload = np.asarray(residual_model.payload_std(model, padded))
    agent_std = [
        np.array(residual_model.agent_std(group, inputs)) for group, inputs in zip(model.agents, features, strict=True)
    ]
    for body, uncertainty in mean_uncertainties.items():
        if isinstance(body, str):
            Z = np.asarray(model.features.payload(padded))
            variance = semiparametric.mean_variance(
                model.payload, uncertainty, Z, semiparametric.mean_regressors(np.asarray(padded), True)
            )
            payload = np.hypot(payload, np.sqrt(variance))
        else:
            i, j = body
            Z, posterior = np.asarray(features[i])[:, j], residual_model.get_model(model, body)
            variance = semiparametric.mean_variance(
                posterior, uncertainty, Z, semiparametric.mean_regressors(np.asarray(padded_agents[i])[:, j], False)
            )
            agent_std[i][:, j] = np.hypot(agent_std[i][:, j], np.sqrt(variance))
    groups = list(zip(model.agents, bands.bound_posterior.agents, bands.agent_beta, features, strict=True))
    return (
        payload[:n],
        tuple(std[:n] for std in agent_std),
        np.asarray(confidence_bounds.payload_radius(model, bands, padded))[:n],
        tuple(np.asarray(confidence_bounds.agent_radius(*group))[:n] for group in groups),
    )


def payload_label_bias_std(team: Team, biases: LabelBiasModel, t: np.ndarray) -> Float[np.ndarray, "time 6"]:
    """Compute the standard deviation of the label bias of the payload.

    Let ``b`` be the tip bias, ``a`` the accelerometer bias, and ``rho_c`` the positions of the ``n`` contacts. The
    standard deviation of the force is ``sqrt(n b^2 + (m_L a)^2)``. That of the moment about axis i is
    ``sqrt(sum_c |rho_c x e_i|^2) b``.

    Args:
        team: Nominal parameters.
        biases: Biases of the sensors.
        t: Times [s].

    Returns:
        Standard deviations of force [N, world frame] and moment [N m, payload frame].
    """
    rho = np.asarray(grasp.contact_points(team))
    b, a = biases.tips.std_at(t), biases.payload.std_at(t)
    force = np.sqrt(len(rho) * b**2 + (float(team.payload.mass) * a) ** 2)
    lever = np.sqrt(((rho**2).sum(1)[:, None] - rho**2).sum(0))
    return np.concatenate([np.repeat(force[:, None], 3, 1), b[:, None] * lever], axis=1)


def force_errors_to_payload(team: Team, R: Float[np.ndarray, "time 3 3"]) -> Float[np.ndarray, "time 6 agents 3"]:
    """Compute the maps from force errors of agents to the payload wrench, for periods without tip force readings.

    Contact forces then follow from the equations of motion of the agents. An error ``e_j`` of the compensated force of
    agent j enters the payload's label as ``(-e_j, -rho_j x R^T e_j)``, with the mean position ``rho_j`` of the contacts
    of the agent. Errors of the differences between the arms of one agent are not included.

    Args:
        team: Nominal parameters.
        R: Attitudes of the payload, body to world.

    Returns:
        The maps without the sign, from forces [N, world] to force [N, world] and moment [N m, payload frame].
    """
    lever = np.concatenate([np.asarray(group.contact_position).mean(1) for group in team.agent_groups])
    moments = np.cross(lever[None, :, None], R[:, None], axis=-1)  # rows of R: axes of the world in the payload frame
    forces = np.broadcast_to(np.eye(3)[:, None], (len(R), 3, len(lever), 3))
    return np.concatenate([forces, moments.transpose(0, 3, 1, 2)], axis=1)


def agent_label_bias_std(
    biases: LabelBiasModel,
    t: np.ndarray,
    arms: Float[np.ndarray, "time agents"],
    mass: Float[np.ndarray, "time agents"],
    lever: Float[np.ndarray, "time agents moments"],
) -> Float[np.ndarray, "time agents outputs"]:
    """Compute the standard deviation of the label bias of agents (Eq. learning_output_components).

    With the tip bias ``b`` and the accelerometer bias ``a``, it is ``sqrt(arms b^2 + (m a)^2)`` for the force and
    ``lever b`` for the moments.

    Args:
        biases: Biases of the sensors.
        t: Times [s].
        arms: Number of arms of each agent.
        mass: Masses of the agents [kg].
        lever: Lever of the tip forces for each moment on base and joints [m]: root of the sum, over arms and axes, of
            the squared entries of the tip Jacobian.

    Returns:
        Standard deviations of force [N], base moment [N m] and joint torques [N m or N].
    """
    b, a = biases.tips.std_at(t)[:, None], biases.agents.std_at(t)[:, None]
    force = np.sqrt(arms * b**2 + (mass * a) ** 2)
    return np.concatenate([np.repeat(force[..., None], 3, 2), b[..., None] * lever], axis=2)


@jax.jit
def _arm_levers(
    group: AerialManipulator, x: Float[Array, "time agents inputs"]
) -> tuple[Float[Array, "time agents"], Float[Array, "time agents"], Float[Array, "time agents moments"]]:
    """Return number of arms, mass and lever of the agents of a group, as `agent_label_bias_std` requires them."""

    def one(agent: AerialManipulator, x: Float[Array, "inputs"]) -> tuple[Array, Array, Array]:
        p = aerial_manipulator.centroidal_model(
            agent, aerial_manipulator.forward_kinematics(agent, x[12 : 12 + agent.tree.joints])
        )
        return jnp.asarray(float(agent.tree.arms)), p.mass, jnp.sqrt((p.J_tip * p.J_tip).sum((0, 1)))

    return jax.vmap(jax.vmap(one), (None, 0))(group, x)
