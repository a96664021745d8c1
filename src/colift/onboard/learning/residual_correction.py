"""Feedback correction of a learned residual model from force labels.

The residual model is constant between updates and cannot follow changes of the environment. A residual corrector
estimates the error of the model, label minus prediction, from the label of each control period.

See Also:
    colift.onboard.learning.kalman_correction, colift.onboard.learning.label_filter: the correctors.
    colift.onboard.learning.residual_predictors.CorrectedResidual: the predictor that adds the correction.
    docs/learning: equations and limits.
"""

from __future__ import annotations

import dataclasses
import itertools
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float, Int

from colift.math.pytree import pytree
from colift.models.parameters import Team
from colift.models.state import ControlClock, ResidualForces, Wrench, split_agent_force, zero_residual
from colift.onboard.estimation.effectiveness import LabelChange
from colift.onboard.estimation.state_estimator import StateEstimate
from colift.onboard.learning import residual_model

Scalar = Float[Array, ""]
Outputs = Float[Array, "outputs"]


@pytree
class ResidualObservation:
    """Label and prediction of the residual in one control period.

    Attributes:
        label: Label before the label filter [N, N m].
        prediction: Prediction of the residual model at the estimated state and acceleration [N, N m].
        update_index: Index of the model update whose model predicts.
        label_valid: 1 for outputs that have a label in this control period, 0 otherwise (`by_output`).
        interval: Time since the previous label of the output [s].
        next_label_change: Change of the next labels by a change of the assumed rotor effectiveness; None without an
            estimate of it. A corrector that does not use it compensates a detected loss of thrust twice for some time.
    """

    label: ResidualForces
    prediction: ResidualForces
    update_index: Int[Array, ""]
    label_valid: ResidualForces
    interval: ResidualForces
    next_label_change: LabelChange | None = None


def observe(
    model: residual_model.ResidualModel, team: Team, estimate: StateEstimate, dt: Scalar
) -> ResidualObservation:
    """Return label and prediction of a control period.

    Args:
        model: Residual model in use.
        team: Nominal parameters.
        estimate: State estimate with labels.
        dt: Control period [s].

    Returns:
        The observation.

    Raises:
        ValueError: If the estimator provides no labels.
    """
    sample = estimate.sample
    if sample is None:
        raise ValueError("the state estimator provides no labels; a residual corrector requires labels")
    payload, agents = sample.unfiltered
    label = ResidualForces(
        payload=Wrench(F=payload[:3], tau=payload[3:]), agents=tuple(split_agent_force(y) for y in agents)
    )
    return ResidualObservation(
        label=label,
        prediction=residual_model.predict(
            model, estimate.payload, estimate.agents, estimate.a_L[:3] - team.gravity, estimate.a_L[3:]
        ),
        update_index=model.update_index,
        label_valid=by_output(team, jnp.ones(()), sample.valid),
        interval=by_output(team, dt, sample.sample_interval),
    )


def by_output(team: Team, value: Scalar, with_tips: Scalar) -> ResidualForces:
    """Return one value for outputs whose labels require tip readings, and another one for all other outputs.

    Labels of the agents' forces require tip readings. If contacts bear moments, labels of the payload moment and all
    labels of these agents do.

    Args:
        team: Nominal parameters.
        value: Value of outputs whose labels do not require tip readings.
        with_tips: Value of outputs whose labels require tip readings.
    """
    filled = jax.tree.map(lambda x: jnp.full_like(x, value), zero_residual(team))
    agents = []
    for group, f in zip(team.agent_groups, filled.agents, strict=True):
        required = jax.tree.map(lambda x: jnp.full_like(x, with_tips), f)
        agents.append(dataclasses.replace(f, f_x=required.f_x) if group.moment_axis is None else required)
    payload = filled.payload
    if any(group.moment_axis is not None for group in team.agent_groups):
        payload = dataclasses.replace(payload, tau=jnp.full_like(payload.tau, with_tips))
    return dataclasses.replace(filled, payload=payload, agents=tuple(agents))


@pytree
class ResidualCorrection:
    """Correction of the residual model in one control period: ``f = f_hat + d + h v`` after a time ``h``.

    Attributes:
        t: Time of the control period [s].
        error: Correction ``d`` [N, N m]: the applied share of the estimated error of the model.
        rate: Rate ``v`` of the correction [N/s, N m/s].
        std: Standard deviation of the corrected prediction [N, N m].
        weight: Share of the estimated error that is applied, in [0, 1]: 1 with labels, decays without.
        label: Label before the label filter [N, N m].
        prediction: Prediction of the residual model [N, N m].
        label_valid: 1 if all outputs have a label in this control period, 0 otherwise.
        nis: Normalized innovation squared, averaged over the outputs with a label; its mean is 1 for correct variances.
    """

    t: Scalar
    error: ResidualForces
    rate: ResidualForces
    std: ResidualForces
    weight: ResidualForces
    label: ResidualForces
    prediction: ResidualForces
    label_valid: Scalar
    nis: Scalar

    @property
    def corrected(self) -> ResidualForces:
        """Prediction with the correction [N, N m]."""
        return jax.tree.map(jnp.add, self.prediction, self.error)


def without_explained_error(errors: tuple[Outputs, ...], observation: ResidualObservation) -> tuple[Outputs, ...]:
    """Return an error of the model, and quantities that follow it, without the part that a loss of thrust explains.

    Labels assume the rotor effectiveness. If it changes from `theta` to `theta_new` at the thrust u, the next label of
    an agent changes by ``c = (theta - theta_new) u`` along its thrust axis ``b_3``. The corrector followed the loss
    before, so its error d contains a part of c. Its component along ``b_3`` becomes the smallest of all
    ``b_3 . d + s c`` with s in [0, 1]::

        d <- d - rho (b_3 . d) b_3,    rho = min(max(-c / (b_3 . d), 0), 1)

    Args:
        errors: Error d, then its rate or other states of a filter, which lose the same share ``rho`` [N, N m].
        observation: Observation with the changes of the next labels; without them the errors are unchanged.

    Returns:
        The same quantities without the explained part.
    """
    change = observation.next_label_change
    if change is None:
        return errors
    remaining = []
    shares: list[Float[Array, "_agents"]] = []
    for outputs in errors:
        forces = unflatten(outputs, observation.label)
        along = [(f.f_x * b).sum(-1) for f, b in zip(forces.agents, change.axes, strict=True)]
        if not shares:
            shares = [_explained_share(c, d) for c, d in zip(change.thrust, along, strict=True)]
        agents = tuple(
            dataclasses.replace(f, f_x=f.f_x - (rho * d)[:, None] * b)
            for f, b, rho, d in zip(forces.agents, change.axes, shares, along, strict=True)
        )
        remaining.append(flatten(dataclasses.replace(forces, agents=agents)))
    return tuple(remaining)


def _explained_share(c: Float[Array, "agents"], d: Float[Array, "agents"]) -> Float[Array, "agents"]:
    """Return the share ``rho`` of the errors d that the changes c explain."""
    return jnp.where(d == 0, 0.0, jnp.clip(-c / jnp.where(d == 0, 1.0, d), 0.0, 1.0))


def zero_correction(like: ResidualForces, t: Scalar) -> ResidualCorrection:
    """Return the correction before the first label.

    Args:
        like: Residual forces of the same structure.
        t: Time [s].

    Returns:
        A correction of zero.
    """
    none, zero = jax.tree.map(jnp.zeros_like, like), jnp.zeros(())
    return ResidualCorrection(
        t=t,
        error=none,
        rate=none,
        std=none,
        weight=jax.tree.map(jnp.ones_like, none),
        label=none,
        prediction=none,
        label_valid=zero,
        nis=zero,
    )


@runtime_checkable
class ResidualCorrector(Protocol):
    """Protocol of the estimators of the model error.

    Implementations: ``ResidualKalmanFilter`` and ``LabelFilter``.
    """

    def init(self, team: Team) -> Any:
        """Return the state before the first control period."""
        ...

    def update(
        self, state: Any, observation: ResidualObservation, clock: ControlClock
    ) -> tuple[ResidualCorrection, Any]:
        """Advance the estimator by one control period; return the correction and its state."""
        ...


def prediction_step(
    observation: ResidualObservation, update_index: Int[Array, ""], prediction: Outputs, initialized: Scalar
) -> Outputs:
    """Return the step of the prediction if the model was replaced since the previous control period, otherwise zero.

    A corrector offsets its error by this step (bumpless transfer).

    Args:
        observation: Observation of this control period.
        update_index: Index of the model update in the previous control period.
        prediction: Prediction in the previous control period [N, N m].
        initialized: 0 before the first control period, 1 afterwards.
    """
    replaced = (observation.update_index != update_index) & (initialized > 0)
    return jnp.where(replaced, flatten(observation.prediction) - prediction, 0.0)


def flatten(forces: ResidualForces) -> Outputs:
    """Return the outputs of all bodies as one vector."""
    return jnp.concatenate([jnp.ravel(x) for x in jax.tree.leaves(forces)])


def unflatten(outputs: Outputs, like: ResidualForces) -> ResidualForces:
    """Return residual forces of the structure of `like` from the vector of `flatten`."""
    leaves, structure = jax.tree.flatten(like)
    ends = list(itertools.accumulate(leaf.size for leaf in leaves))
    parts = [outputs[end - leaf.size : end].reshape(leaf.shape) for leaf, end in zip(leaves, ends, strict=True)]
    return jax.tree.unflatten(structure, parts)
