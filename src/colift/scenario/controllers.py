"""What flies a scenario: gains, allocation, internal forces, and the pilot made of them."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from colift.models import grasp
from colift.models.parameters import Agent, Team
from colift.onboard import controller, interfaces
from colift.onboard.control import (
    actuator_compensation,
    agent_controllers,
    allocators,
    label_feedback,
    payload_controllers,
    tracking,
)
from colift.onboard.control.allocation import Allocation, balanced, internal, leader_follower, squeeze
from colift.onboard.estimation import state_estimator
from colift.onboard.learning import residual_correction, residual_predictors
from colift.onboard.learning.recorder import FromRig, Recorder
from colift.scenario import priors, schema, trajectories
from colift.scenario import team as team_module
from colift.scenario.conversion import array, built, lag
from colift.scenario.errors import ScenarioError


def gains(settings: schema.Settings) -> tracking.Gains:
    """Feedback gains."""
    given = settings.control
    return tracking.Gains(
        K_p=jnp.diag(array(given.K_p)),
        K_v=jnp.diag(array(given.K_v)),
        k_R=array(given.k_R),
        k_omega=array(given.k_omega),
        agent_k_R=array(given.agent_k_R),
        agent_k_omega=array(given.agent_k_omega),
        posture=array(given.posture),
    )


def allocation(settings: schema.Settings, nominal: Team) -> tuple[Allocation, allocators.Internal]:
    """The allocation, and the internal forces it is asked for.

    Raises ScenarioError for a grasp or a leader block of rank below 6, and for internal forces that this
    allocation cannot give.
    """
    given = settings.allocation
    c = np.asarray(grasp.contacts(nominal))
    index = {name: i for i, name in enumerate(team_module.contact_names(settings))}
    try:
        if isinstance(given, schema.LeaderFollower):
            offset = None if given.lam_f0_N is None else np.array(given.lam_f0_N)
            plan = leader_follower(c, [index[name] for name in given.leader_contacts], offset)
        else:
            plan = balanced(c)
        return plan, _internal(given.internal, plan, c, index)
    except ValueError as error:
        numbered = ", ".join(f"{i} {name}" for name, i in index.items())
        raise ScenarioError(f"{settings.name}: allocation: {error} (contacts: {numbered})") from None


def _internal(
    given: schema.Internal | None, plan: Allocation, c: np.ndarray, index: dict[str, int]
) -> allocators.Internal:
    if given is None:
        eta, times = np.zeros(plan.kernel.shape[1]), (0.0, 0.0, 1.0)
    else:
        pairs = [(index[a], index[b], newton) for a, b, newton in given.pairs]
        eta, times = internal(plan, squeeze(c, pairs)), (given.start_s, given.end_s, given.ramp_s)
    start, end, ramp = (array(t) for t in times)
    return allocators.Internal(eta=jnp.asarray(eta), start=start, end=end, ramp=ramp)


def pilot(settings: schema.Settings, nominal: Team) -> controller.LeaderFollower:
    """Everything the team takes along in case C1: no data are recorded, nothing is known.

    Raises ScenarioError as `allocation`, and for a part of one's own that is none.
    """
    plan, internal = allocation(settings, nominal)
    learning, gain = settings.learning, gains(settings)
    recorder = FromRig if learning.samples == "rig" else Recorder
    ahead = settings.control.look_ahead_s
    realizer = agent_controllers.Aligned if ahead is None else agent_controllers.Anticipating
    ours = controller.LeaderFollower(
        team=nominal,
        path=trajectories.path(settings),
        estimator=state_estimator.Estimator(
            filters=_filters(settings),
            patience=array(settings.innovation.patience_s),
        ),
        recorder=recorder(
            every=array(1 / learning.sample_Hz),
            start=array(learning.start_s),
            end=array(learning.end_s),
            payload=jnp.array(False),
            agents=jnp.array(False),
        ),
        oracle=priors.prior(settings, nominal),
        predictor=residual_predictors.Learned(),
        leader=payload_controllers.Geometric(gains=gain),
        allocator=allocators.Linear(allocation=plan, internal=internal),
        realizer=realizer(gains=gain, heading=team_module.heading(settings), rest=team_module.rest(settings)),
        drive=_drive(settings),
        look_ahead=None if ahead is None else array(ahead),
    )
    theirs = {
        name: built(part, f"parts.{name}", kind, ours)
        for name, kind in PILOT_PARTS.items()
        if (part := getattr(settings.parts, name)) is not None
    }
    return dataclasses.replace(ours, **theirs)


def ahead(settings: schema.Settings, flying: controller.LeaderFollower) -> controller.LeaderFollower:
    """The same, looking ahead where it did not."""
    if flying.look_ahead is not None or type(flying.realizer) is not agent_controllers.Aligned:
        return flying
    mine = {field.name: getattr(flying.realizer, field.name) for field in dataclasses.fields(flying.realizer)}
    step = array(settings.innovation.look_ahead_s)
    return dataclasses.replace(flying, realizer=agent_controllers.Anticipating(**mine), look_ahead=step)


def listening(settings: schema.Settings, flying: controller.LeaderFollower, held: bool) -> controller.LeaderFollower:
    """The same with its predictions corrected by labels.

    A held correction stays when labels stop, is carried ahead by `lead_s`, and trusts what is learned; any other fades,
    is carried ahead by the labels' whole delay, as far as such rates came true, and doubts.
    """
    given, filters = settings.innovation, _filters(settings)
    listener = residual_correction.Listener(
        filters=filters,
        hold=array(given.hold_s),
        fade=array(np.inf if held else given.fade_s),
        span=array(given.span_s),
        doubt=array(0.0 if held else given.doubt),
        coherence=array(0.0 if held else given.coherence),
    )
    lead = array(given.lead_s) if held else filters.delay()
    heeded = tuple(array([label_feedback.heeded(gain) for gain in group]) for group in echoes(settings, flying.team))
    predictor = residual_predictors.Corrected(predictor=flying.predictor, lead=lead, heeded=heeded)
    return dataclasses.replace(flying, listener=listener, predictor=predictor)


def echoes(settings: schema.Settings, team: Team) -> tuple[tuple[float, ...], ...]:
    """How strongly each agent hears itself, `echo.gain`, by group, as it hovers with an even share of the payload."""
    g, share = float(jnp.linalg.norm(team.gravity)), float(team.payload.mass) / sum(team.sizes)
    gain, filters = gains(settings), _filters(settings)

    def of(agent: Agent, rest: Any) -> float:
        weight = g * (float(agent.mass.sum()) + share)
        return label_feedback.gain(agent, rest, gain, filters, weight)

    return tuple(
        tuple(of(jax.tree.map(lambda x, j=j: x[j], group), rest[j]) for j in range(size))
        for group, size, rest in zip(team.groups, team.sizes, team_module.rest(settings), strict=True)
    )


def _filters(settings: schema.Settings) -> state_estimator.Filters:
    return state_estimator.Filters(
        fusion=array(settings.control.fusion_Hz),
        bias=array(settings.control.bias_Hz),
        joint=array(settings.control.joint_filter_Hz),
        label=array(settings.learning.filter_Hz),
        tip_force=array(settings.sensors.tip_force_bandwidth_Hz),
    )


def _drive(settings: schema.Settings) -> interfaces.Drive:
    believed = settings.nominal.actuators
    if believed is None:
        return actuator_compensation.Direct()
    return actuator_compensation.Hastened(lag=lag(believed, settings), haste=array(settings.control.haste))


PILOT_PARTS: dict[str, type] = {
    "leader": interfaces.Leader,
    "allocator": interfaces.Allocator,
    "realizer": interfaces.Realizer,
    "estimator": interfaces.Estimator,
    "predictor": interfaces.Predictor,
}
