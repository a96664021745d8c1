"""Disturbances of a scenario, attached to points of the payload and of the agents."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import jax
import numpy as np

from colift.closed_loop import part_checks
from colift.math.pytree import transfer
from colift.scenario import schema, team
from colift.scenario.conversion import array, build_plugin, check_plugin, rows
from colift.simulation.disturbances import (
    AgentDisturbance,
    ConstantWrench,
    DisturbanceModel,
    DisturbanceSet,
    GaussianJet,
    JointFriction,
    PayloadDisturbance,
    RotorBias,
    Tether,
    TimeVaryingWind,
    Wind,
)


def make_disturbances(settings: schema.Scenario) -> DisturbanceSet:
    """Make the disturbances of a scenario, each attached to its point."""
    teams = team.group_agents(settings)
    point_disturbances = _point_disturbances(settings)
    return DisturbanceSet(
        payload=tuple(
            PayloadDisturbance(name=source.name, model=_make_model(source), point=array(source.attachment_point_m))
            for source in point_disturbances
            if source.acts_on == "payload"
        ),
        agents=tuple(
            tuple(attached for source in point_disturbances for attached in _attach_to_group(settings, source, group))
            for group in teams
        ),
        joints=tuple(_friction(settings, group) for group in teams),
    )


def _point_disturbances(settings: schema.Scenario) -> list[schema.PointDisturbance]:
    return [source for source in settings.disturbances if not isinstance(source, schema.JointFriction)]


def _attach_to_group(
    settings: schema.Scenario, source: schema.PointDisturbance, group: list[schema.Agent]
) -> Iterator[AgentDisturbance]:
    """Attach a disturbance to the agents of a group on which it acts.

    The body of the disturbance can have another index in each agent type, so one attachment is made for each index.
    """
    carriers: dict[int, list[float]] = {}
    for k, agent in enumerate(group):
        if source.acts_on in ("agents", agent.name):
            body = team.body_names(settings.agent_types[agent.type]).index(source.body)
            carriers.setdefault(body, [0.0] * len(group))[k] = 1.0
    model = jax.tree.map(lambda x: transfer(np.broadcast_to(x, (len(group), *x.shape))), _make_model(source))
    for body, active in carriers.items():
        point = array([source.attachment_point_m] * len(group))
        yield AgentDisturbance(body=body, name=source.name, model=model, point=point, active=array(active))


def _friction(settings: schema.Scenario, group: list[schema.Agent]) -> JointFriction:
    frictions = [source for source in settings.disturbances if isinstance(source, schema.JointFriction)]
    joints = len(settings.agent_types[group[0].type].joints)
    table = np.tile([0.0, 0.0, 1.0], (len(group), 1))  # no friction; the speed then has no effect
    for k, agent in enumerate(group):
        for source in frictions:
            if source.acts_on in ("agents", agent.name):
                table[k] = source.viscous_Nms, source.coulomb_Nm, source.smoothing_speed_radps
    viscous, coulomb, speed = (array(np.tile(column[:, None], (1, joints))) for column in table.T)
    return JointFriction(viscous=viscous, coulomb=coulomb, speed=speed)


def _make_model(source: schema.PointDisturbance) -> DisturbanceModel:
    return DISTURBANCE_MODELS[type(source)](source)


def _wind(source: schema.Wind) -> Wind | TimeVaryingWind:
    wind = Wind(
        linear=array(source.linear_drag_Nspm),
        quadratic=array(source.quadratic_drag_Ns2pm2),
        mean=array(source.mean_wind_mps),
        gust=rows(gust.amplitude_mps for gust in source.gusts),
        wave=rows(gust.wave_vector_radpm for gust in source.gusts),
        phase=array(np.deg2rad([gust.phase_deg for gust in source.gusts])),
    )
    if source.direction_change is None and all(gust.period_s is None for gust in source.gusts):
        return wind
    turn = schema.WindTurn(change_deg=0.0, start_s=0.0) if source.direction_change is None else source.direction_change
    return TimeVaryingWind(
        base_wind=wind,
        phase_rate=array([0.0 if gust.period_s is None else 2 * np.pi / gust.period_s for gust in source.gusts]),
        turn_angle=array(np.deg2rad(turn.change_deg)),
        start=array(turn.start_s),
        ramp_time=array(turn.ramp_time_s),
    )


def _plugin(source: schema.PluginDisturbance) -> DisturbanceModel:
    """Make and check a user-defined disturbance."""
    model = build_plugin(source, f"disturbances: {source.name}", DisturbanceModel)
    check_plugin(part_checks.check_disturbance, source.name, model)
    return model


DISTURBANCE_MODELS: dict[type, Callable[..., DisturbanceModel]] = {
    schema.ConstantWrench: lambda x: ConstantWrench(force=array(x.force_N), torque=array(x.torque_Nm)),
    schema.Wind: _wind,
    schema.Tether: lambda x: Tether(
        anchor=array(x.anchor_m), stiffness=array(x.stiffness_Npm), length=array(x.rest_length_m)
    ),
    schema.GaussianJet: lambda x: GaussianJet(force=array(x.force_N), center=array(x.center_m), width=array(x.std_m)),
    schema.RotorBias: lambda x: RotorBias(thrust=array(x.thrust_N), torque=array(x.torque_Nm)),
    schema.PluginDisturbance: _plugin,
}
