"""Assumptions of a scenario on residuals, labels and sensors, and the ones that hold by construction."""

from __future__ import annotations

import numpy as np

from colift.gp.error_bounds import BoundAssumption
from colift.models.parameters import Team
from colift.models.state import ResidualForces
from colift.onboard.learning import confidence_bounds, prediction_uncertainty
from colift.scenario import schema
from colift.scenario.errors import ScenarioError


def bound_assumptions(
    settings: schema.Scenario, nominal: Team, rig: ResidualForces
) -> confidence_bounds.BoundAssumptions:
    """Return the assumptions of the error bounds, and the ones that hold by construction.

    Args:
        settings: Scenario.
        nominal: Nominal parameters.
        rig: Largest label errors of the calibration rig.

    Returns:
        Assumptions of the error bounds.

    Raises:
        ScenarioError: If a label error is not positive.
    """
    given, learning = settings.certificate, settings.learning
    payload = _label_errors(given.payload_label_error, learning.payload, 0)
    agents = [
        np.tile(_label_errors(given.agent_label_error, learning.agents, group.tree.joints), (size, 1))
        for size, group in zip(nominal.sizes, nominal.agent_groups, strict=True)
    ]
    within = False
    if learning.rig_label_error is not None:
        of_payload = np.concatenate([rig.payload.F, rig.payload.tau])
        of_agents = [np.concatenate([e.f_x, e.f_w, e.f_r], axis=1) for e in rig.agents]
        payload = of_payload if given.payload_label_error is None else payload
        agents = of_agents if given.agent_label_error is None else agents
        within = all((a >= b).all() for a, b in zip([payload, *agents], [of_payload, *of_agents], strict=True))
    try:
        return confidence_bounds.BoundAssumptions(
            bound=given.error_bound,
            confidence=given.confidence,
            rkhs_norm=given.rkhs_norm,
            payload=payload,
            agents=tuple(agents),
            satisfied=_met(settings, within),
        )
    except ValueError as error:
        raise ScenarioError(f"{settings.name}: certificate: {error}") from None


def label_bias_model(settings: schema.Scenario) -> prediction_uncertainty.LabelBiasModel:
    """Return constant biases and bias random walks of the sensors from which labels are computed.

    Without tip force sensors their bias is zero; the errors of the prior take its place during the flight.
    """
    found = {name: prediction_uncertainty.BiasModel() for name in ("agents.lam", "payload.a", "agents.a")}
    if tips := isinstance(settings.contact_forces, schema.TipSensors):
        found["agents.lam"] = prediction_uncertainty.BiasModel(initial_std=settings.sensors.tip_force_bias_N)
    for each in settings.sensors.models:
        if isinstance(each, schema.BiasRandomWalk):
            for name in found.keys() & set(each.channels):
                if name == "agents.lam" and not tips:
                    continue
                found[name] += prediction_uncertainty.BiasModel(
                    initial_std=each.initial_bias_std, random_walk_density=each.random_walk_density
                )
    return prediction_uncertainty.LabelBiasModel(
        tips=found["agents.lam"], payload=found["payload.a"], agents=found["agents.a"]
    )


def _met(settings: schema.Scenario, within: bool) -> frozenset[BoundAssumption]:
    """Return the assumptions that hold by construction; all others are assumed.

    Args:
        settings: Scenario.
        within: True if no label error exceeds its bound; only labels of a calibration rig can guarantee this.

    Returns:
        Assumptions that hold.
    """
    given, learning = settings.certificate, settings.learning
    rig, fixed = learning.rig_label_error is not None, learning.hyperparameters == "fixed"
    drawn = settings.random_residual is not None and settings.random_residual.rkhs_norm <= given.rkhs_norm
    is_nominal = not settings.disturbances and settings.nominal == schema.NominalModel()
    holds = {
        BoundAssumption.RKHS_NORM: drawn
        and fixed
        and is_nominal,  # the only residuals are functions of that norm for that kernel
        BoundAssumption.BOUNDED_NOISE: within,
        BoundAssumption.NOISE_WITHIN_STD: within,  # the noise bound v is computed from eps
        BoundAssumption.ZERO_MEAN: rig,
        BoundAssumption.INDEPENDENT: rig,
        BoundAssumption.PREDICTABLE_INPUTS: rig,
        BoundAssumption.FIXED_HYPERPARAMETERS: fixed,
        BoundAssumption.HORIZON: True,  # the largest data set is a full one
    }
    return frozenset(assumption for assumption, true in holds.items() if true)


def _label_errors(given: schema.ForceMagnitudes | None, prior: schema.GPPrior, joints: int) -> np.ndarray:
    """Return the bounds `(6 + joints,)`; default: three standard deviations of the label noise."""
    source = _magnitudes(prior.noise_std, 3.0) if given is None else _magnitudes(given, 1.0)
    return np.repeat(source, [3, 3, joints][: len(source)])


def _magnitudes(given: schema.ForceMagnitudes, factor: float) -> list[float]:
    """Return a multiple of the values of force, moment and, of an agent, joint outputs."""
    values = [given.force_N, given.moment_Nm]
    if isinstance(given, schema.AgentForceMagnitudes):
        values.append(given.joint_torque_Nm)
    return [factor * value for value in values]
