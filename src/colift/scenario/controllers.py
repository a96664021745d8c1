"""What flies a scenario: gains, allocation, internal forces, and the pilot made of them."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from colift.models import grasp
from colift.models.parameters import AerialManipulator, Team
from colift.onboard import controller, interfaces
from colift.onboard.control import (
    actuator_compensation,
    agent_controllers,
    allocators,
    label_feedback,
    payload_controllers,
    tracking,
)
from colift.onboard.control.allocation import (
    AllocationMap,
    internal_force_coordinates,
    leader_follower_allocation,
    least_squares_allocation,
    squeeze,
)
from colift.onboard.estimation import state_estimator
from colift.onboard.learning import residual_correction, residual_predictors
from colift.onboard.learning.recorder import DataRecorder, RigRecorder
from colift.scenario import priors, schema, trajectories
from colift.scenario import team as team_module
from colift.scenario.conversion import actuator_lag, array, build_plugin
from colift.scenario.errors import ScenarioError


def gains(settings: schema.Scenario) -> tracking.Gains:
    """Feedback gains."""
    given = settings.control
    return tracking.Gains(
        K_p=jnp.diag(array(given.K_p)),
        K_v=jnp.diag(array(given.K_v)),
        k_R=array(given.k_R),
        k_omega=array(given.k_omega),
        agent_k_R=array(given.agent_k_R),
        agent_k_omega=array(given.agent_k_omega),
        posture_bandwidth=array(given.posture_bandwidth),
    )


def allocation(settings: schema.Scenario, nominal: Team) -> tuple[AllocationMap, allocators.InternalForceSchedule]:
    """The allocation, and the internal forces it is asked for.

    Raises ScenarioError for a grasp or a leader block of rank below 6, and for internal forces that this
    allocation cannot give.
    """
    given = settings.allocation
    c = np.asarray(grasp.contact_points(nominal))
    index = {name: i for i, name in enumerate(team_module.contact_names(settings))}
    try:
        if isinstance(given, schema.LeaderFollowerAllocation):
            experiment = leader_follower_allocation(c, [index[name] for name in given.leader_contacts])
        else:
            experiment = least_squares_allocation(c)
        return experiment, _internal(given.internal, experiment, c, index)
    except ValueError as error:
        numbered = ", ".join(f"{i} {name}" for name, i in index.items())
        raise ScenarioError(f"{settings.name}: allocation: {error} (contacts: {numbered})") from None


def _internal(
    given: schema.InternalForces | None, plan: AllocationMap, c: np.ndarray, index: dict[str, int]
) -> allocators.InternalForceSchedule:
    if given is None:
        eta, times = np.zeros(plan.nullspace.shape[1]), (0.0, 0.0, 1.0)
    else:
        pairs = [(index[a], index[b], newton) for a, b, newton in given.squeeze_pairs]
        eta, times = (
            internal_force_coordinates(plan, squeeze(c, pairs)),
            (given.start_s, given.end_s, given.ramp_time_s),
        )
    start, end, ramp = (array(t) for t in times)
    return allocators.InternalForceSchedule(eta=jnp.asarray(eta), start=start, end=end, ramp=ramp)


def make_controller(settings: schema.Scenario, nominal: Team) -> controller.LeaderFollowerController:
    """Everything the team takes along in case C1: no data are recorded, nothing is known.

    Raises ScenarioError as `allocation`, and for a part of one's own that is none.
    """
    experiment, internal = allocation(settings, nominal)
    learning, gain = settings.learning, gains(settings)
    recorder = RigRecorder if learning.label_source == "calibration_rig" else DataRecorder
    ahead = settings.control.preview_step_s
    agent_controller = (
        agent_controllers.ThrustVectoringController
        if ahead is None
        else agent_controllers.PreviewThrustVectoringController
    )
    ours = controller.LeaderFollowerController(
        team=nominal,
        reference=trajectories.make_reference(settings),
        estimator=state_estimator.ComplementaryFilter(filters=_filters(settings)),
        recorder=recorder(
            sample_period=array(1 / learning.sample_Hz),
            start=array(learning.start_s),
            end=array(learning.end_s),
            payload=jnp.array(False),
            agents=jnp.array(False),
        ),
        residual_model=priors.prior_model(settings, nominal),
        residual_predictor=residual_predictors.LearnedResidual(),
        payload_controller=payload_controllers.GeometricTracking(gains=gain),
        allocator=allocators.LinearAllocator(allocation=experiment, internal=internal),
        agent_controller=agent_controller(
            gains=gain, yaw=team_module.initial_yaw(settings), nominal_posture=team_module.nominal_posture(settings)
        ),
        actuator_compensator=_drive(settings),
        preview_step=None if ahead is None else array(ahead),
    )
    theirs = {
        name: build_plugin(part, f"plugins.{name}", kind, ours)
        for name, kind in CONTROLLER_PARTS.items()
        if (part := getattr(settings.plugins, name)) is not None
    }
    return dataclasses.replace(ours, **theirs)


def with_preview(
    settings: schema.Scenario, flying: controller.LeaderFollowerController
) -> controller.LeaderFollowerController:
    """The same, looking ahead where it did not."""
    if (
        flying.preview_step is not None
        or type(flying.agent_controller) is not agent_controllers.ThrustVectoringController
    ):
        return flying
    mine = {
        field.name: getattr(flying.agent_controller, field.name)
        for field in dataclasses.fields(flying.agent_controller)
    }
    step = array(settings.online_correction.preview_step_s)
    return dataclasses.replace(
        flying, agent_controller=agent_controllers.PreviewThrustVectoringController(**mine), preview_step=step
    )


def with_innovation_filter(
    settings: schema.Scenario, flying: controller.LeaderFollowerController, held: bool
) -> controller.LeaderFollowerController:
    """The same with its predictions corrected by labels.

    A held correction stays when labels stop, is carried ahead by `lead_s`, and trusts what is learned; any other fades,
    is carried ahead by the labels' whole delay, as far as such rates came true, and doubts.
    """
    given, filters = settings.online_correction, _filters(settings)
    innovation_filter = residual_correction.InnovationFilter(
        filters=filters, hold_time=array(given.hold_time_s), averaging_time=array(given.averaging_time_s)
    )
    if held:
        innovation_filter = dataclasses.replace(
            innovation_filter, decay_time=array(np.inf), variance_ratio=array(0.0), coherence=array(0.0)
        )
    lead = array(given.lead_time_s) if held else filters.label_delay()
    heeded = tuple(
        array([label_feedback.rate_attenuation(gain) for gain in group])
        for group in label_loop_gains(settings, flying.team)
    )
    predictor = residual_predictors.InnovationCorrection(
        base=flying.residual_predictor, lead_time=lead, rate_attenuation=heeded
    )
    return dataclasses.replace(flying, innovation_filter=innovation_filter, residual_predictor=predictor)


def label_loop_gains(settings: schema.Scenario, team: Team) -> tuple[tuple[float, ...], ...]:
    """How strongly each agent hears itself, `echo.gain`, by group, as it hovers with an even share of the payload."""
    g, share = float(jnp.linalg.norm(team.gravity)), float(team.payload.mass) / sum(team.sizes)
    gain, filters = gains(settings), _filters(settings)

    def of(agent: AerialManipulator, rest: Any) -> float:
        weight = g * (float(agent.mass.sum()) + share)
        return label_feedback.label_loop_gain(agent, rest, gain, filters, weight)

    return tuple(
        tuple(of(jax.tree.map(lambda x, j=j: x[j], group), rest[j]) for j in range(size))
        for group, size, rest in zip(team.agent_groups, team.sizes, team_module.nominal_posture(settings), strict=True)
    )


def _filters(settings: schema.Scenario) -> state_estimator.FilterBandwidths:
    return state_estimator.FilterBandwidths(
        complementary=array(settings.control.complementary_filter_Hz),
        imu_bias=array(settings.control.imu_bias_filter_Hz),
        joint=array(settings.control.joint_filter_Hz),
        label=array(settings.learning.label_filter_Hz),
        tip_force=array(settings.sensors.tip_force_bandwidth_Hz),
    )


def _drive(settings: schema.Scenario) -> interfaces.ActuatorCompensator:
    nominal = settings.nominal.actuators
    if nominal is None:
        return actuator_compensation.NoCompensation()
    return actuator_compensation.LagInversion(lag=actuator_lag(nominal, settings))


CONTROLLER_PARTS: dict[str, type] = {
    "payload_controller": interfaces.PayloadController,
    "allocator": interfaces.Allocator,
    "agent_controller": interfaces.AgentController,
    "estimator": interfaces.Estimator,
    "residual_predictor": interfaces.ResidualPredictor,
}
