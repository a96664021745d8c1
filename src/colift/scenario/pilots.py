"""What flies a scenario: gains, allocation, internal forces, and the pilot made of them."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from colift import allocate, control, echo, estimate, fly, grasp, innovation, learn
from colift.model import Agent, Team
from colift.scenario import paths, priors, roster
from colift.scenario import settings as s
from colift.scenario.mistake import ScenarioError
from colift.scenario.values import array, built, lag


def gains(settings: s.Settings) -> control.Gains:
    """Feedback gains."""
    given = settings.control
    return control.Gains(
        K_p=jnp.diag(array(given.K_p)),
        K_v=jnp.diag(array(given.K_v)),
        k_R=array(given.k_R),
        k_omega=array(given.k_omega),
        agent_k_R=array(given.agent_k_R),
        agent_k_omega=array(given.agent_k_omega),
        posture=array(given.posture),
    )


def allocation(settings: s.Settings, nominal: Team) -> tuple[allocate.Allocation, fly.Internal]:
    """The allocation, and the internal forces it is asked for.

    Raises ScenarioError for a grasp or a leader block of rank below 6, and for internal forces that this
    allocation cannot give.
    """
    given = settings.allocation
    c = np.asarray(grasp.contacts(nominal))
    index = {name: i for i, name in enumerate(roster.contact_names(settings))}
    try:
        if isinstance(given, s.LeaderFollower):
            offset = None if given.lam_f0_N is None else np.array(given.lam_f0_N)
            plan = allocate.leader_follower(c, [index[name] for name in given.leader_contacts], offset)
        else:
            plan = allocate.balanced(c)
        return plan, _internal(given.internal, plan, c, index)
    except ValueError as error:
        numbered = ", ".join(f"{i} {name}" for name, i in index.items())
        raise ScenarioError(f"{settings.name}: allocation: {error} (contacts: {numbered})") from None


def _internal(
    given: s.Internal | None, plan: allocate.Allocation, c: np.ndarray, index: dict[str, int]
) -> fly.Internal:
    if given is None:
        eta, times = np.zeros(plan.kernel.shape[1]), (0.0, 0.0, 1.0)
    else:
        pairs = [(index[a], index[b], newton) for a, b, newton in given.pairs]
        eta, times = allocate.internal(plan, allocate.squeeze(c, pairs)), (given.start_s, given.end_s, given.ramp_s)
    start, end, ramp = (array(t) for t in times)
    return fly.Internal(eta=jnp.asarray(eta), start=start, end=end, ramp=ramp)


def pilot(settings: s.Settings, nominal: Team) -> fly.LeaderFollower:
    """Everything the team takes along in case C1: no data are recorded, nothing is known.

    Raises ScenarioError as `allocation`, and for a part of one's own that is none.
    """
    plan, internal = allocation(settings, nominal)
    learning, gain = settings.learning, gains(settings)
    recorder = learn.FromRig if learning.samples == "rig" else learn.Recorder
    ahead = settings.control.look_ahead_s
    realizer = fly.Aligned if ahead is None else fly.Anticipating
    ours = fly.LeaderFollower(
        team=nominal,
        path=paths.path(settings),
        estimator=estimate.Estimator(
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
        predictor=fly.Learned(),
        leader=fly.Geometric(gains=gain),
        allocator=fly.Linear(allocation=plan, internal=internal),
        realizer=realizer(gains=gain, heading=roster.heading(settings), rest=roster.rest(settings)),
        drive=_drive(settings),
        look_ahead=None if ahead is None else array(ahead),
    )
    theirs = {
        name: built(part, f"parts.{name}", kind, ours)
        for name, kind in PILOT_PARTS.items()
        if (part := getattr(settings.parts, name)) is not None
    }
    return dataclasses.replace(ours, **theirs)


def ahead(settings: s.Settings, flying: fly.LeaderFollower) -> fly.LeaderFollower:
    """The same, looking ahead where it did not."""
    if flying.look_ahead is not None or type(flying.realizer) is not fly.Aligned:
        return flying
    mine = {field.name: getattr(flying.realizer, field.name) for field in dataclasses.fields(flying.realizer)}
    step = array(settings.innovation.look_ahead_s)
    return dataclasses.replace(flying, realizer=fly.Anticipating(**mine), look_ahead=step)


def listening(settings: s.Settings, flying: fly.LeaderFollower, held: bool) -> fly.LeaderFollower:
    """The same with its predictions corrected by labels.

    A held correction stays when labels stop, is carried ahead by `lead_s`, and trusts what is learned; any other fades,
    is carried ahead by the labels' whole delay, as far as such rates came true, and doubts.
    """
    given, filters = settings.innovation, _filters(settings)
    listener = innovation.Listener(
        filters=filters,
        hold=array(given.hold_s),
        fade=array(np.inf if held else given.fade_s),
        span=array(given.span_s),
        doubt=array(0.0 if held else given.doubt),
        coherence=array(0.0 if held else given.coherence),
    )
    lead = array(given.lead_s) if held else filters.delay()
    heeded = tuple(array([echo.heeded(gain) for gain in group]) for group in echoes(settings, flying.team))
    predictor = fly.Corrected(predictor=flying.predictor, lead=lead, heeded=heeded)
    return dataclasses.replace(flying, listener=listener, predictor=predictor)


def echoes(settings: s.Settings, team: Team) -> tuple[tuple[float, ...], ...]:
    """How strongly each agent hears itself, `echo.gain`, by group, as it hovers with an even share of the payload."""
    g, share = float(jnp.linalg.norm(team.gravity)), float(team.payload.mass) / sum(team.sizes)
    gain, filters = gains(settings), _filters(settings)

    def of(agent: Agent, rest: Any) -> float:
        weight = g * (float(agent.mass.sum()) + share)
        return echo.gain(agent, rest, gain, filters, weight)

    return tuple(
        tuple(of(jax.tree.map(lambda x, j=j: x[j], group), rest[j]) for j in range(size))
        for group, size, rest in zip(team.groups, team.sizes, roster.rest(settings), strict=True)
    )


def _filters(settings: s.Settings) -> estimate.Filters:
    return estimate.Filters(
        fusion=array(settings.control.fusion_Hz),
        bias=array(settings.control.bias_Hz),
        joint=array(settings.control.joint_filter_Hz),
        label=array(settings.learning.filter_Hz),
        tip_force=array(settings.sensors.tip_force_bandwidth_Hz),
    )


def _drive(settings: s.Settings) -> fly.Drive:
    believed = settings.nominal.actuators
    if believed is None:
        return fly.Direct()
    return fly.Hastened(lag=lag(believed, settings), haste=array(settings.control.haste))


PILOT_PARTS: dict[str, type] = {
    "leader": fly.Leader,
    "allocator": fly.Allocator,
    "realizer": fly.Realizer,
    "estimator": fly.Estimator,
    "predictor": fly.Predictor,
}
