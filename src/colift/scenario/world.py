"""Simulated world of a scenario: plant, actuators and sensors."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift.models.actuator_lag import RotorMixer
from colift.models.parameters import Team
from colift.models.state import ResidualForces, State
from colift.scenario import schema
from colift.scenario import team as team_module
from colift.scenario.conversion import actuator_lag, array, build_plugin, rotor_mixer, rotor_settings
from colift.scenario.errors import ScenarioError
from colift.simulation import actuators, contact_dynamics, disturbances, faults, sensor_faults
from colift.simulation.sensors import (
    BiasRandomWalk,
    CalibrationRig,
    Intermittent,
    SensorModel,
    SensorNoise,
    Unavailable,
    sample_tip_bias,
)
from colift.simulation.world import PayloadMassStep, Plant, SimulatedWorld


def make_world(
    settings: schema.Scenario, truth: Team, state: State, sources: disturbances.DisturbanceSet, rig: ResidualForces
) -> SimulatedWorld:
    """Return the simulated world.

    Args:
        settings: Scenario.
        truth: True parameters.
        state: Initial state.
        sources: Disturbances.
        rig: Largest label errors of the calibration rig, used if labels come from the rig.

    Returns:
        Simulated world.

    Raises:
        ScenarioError: If a user-defined part does not have its interface, or if MuJoCo is required and not installed.
    """
    noise = make_sensor_noise(settings)
    models = tuple(_sensor_model(x, f"sensors.models.{i}", settings) for i, x in enumerate(settings.sensors.models))
    models += tuple(_reading_fault(x, settings) for x in settings.faults if isinstance(x, schema.SensorFault))
    models += () if settings.sensors.payload_imu else (Unavailable(channels=("payload.omega", "payload.a")),)
    models += tuple(_link(x, settings) for x in settings.faults if isinstance(x, schema.LinkFault))
    world = SimulatedWorld(
        team=truth,
        plant=contact_dynamics.RigidContactPlant(),
        disturbances=sources,
        disturbance_scale=jnp.asarray(1.0),
        actuators=actuators.IdealActuators(),
        sensors=noise,
        tip_force_bias=sample_tip_bias(truth, noise, jax.random.fold_in(jax.random.key(settings.seed), 1)),
        sensor_models=(*models, CalibrationRig(label_error=rig))
        if settings.learning.rig_label_error is not None
        else models,
        mass_step=None if settings.payload_mass_step is None else _mass_step(settings.payload_mass_step),
        faults=_faults(settings, truth),
    )
    return dataclasses.replace(world, actuators=_actuators(settings, world), plant=_plant(settings, world, state))


def _mass_step(step: schema.PayloadMassStep) -> PayloadMassStep:
    return PayloadMassStep(mass=array(step.mass_kg), start=array(step.start_s), ramp_time=array(step.ramp_time_s))


def _faults(settings: schema.Scenario, truth: Team) -> faults.Faults | None:
    """Return the faults of rotors and contacts; None without one, for which the simulation has no further operation."""
    groups = team_module.group_agents(settings)
    losses = [fault for fault in settings.faults if isinstance(fault, schema.ThrustFault)]
    rotors = [fault for fault in settings.faults if isinstance(fault, schema.RotorFault)]
    opened = [fault for fault in settings.faults if isinstance(fault, schema.ContactFault)]
    if not losses and not rotors and not opened:
        return None
    return faults.Faults(
        thrust=tuple(
            faults.ThrustLoss(
                share=tuple(array([loss.to if agent.name == loss.who else 1.0 for agent in group]) for group in groups),
                start=array(loss.start_s),
                end=array(loss.last_time),
            )
            for loss in losses
        ),
        rotors=tuple(_rotor_fault(fault, settings) for fault in rotors),
        mixers=_mixers(settings, truth) if rotors else (),
        release_time=_contact_times(settings, {fault.who: fault.start_s for fault in opened}),
        regrasp_time=_contact_times(settings, {fault.who: fault.end_s for fault in opened if fault.end_s is not None}),
        starts_open=any(fault.start_s == 0 for fault in opened),
    )


def _contact_times(settings: schema.Scenario, times: dict[str, float]) -> tuple[Array, ...] | None:
    """Return the times of events at contacts by group [s], with inf for contacts without one; None without events."""
    if not times:
        return None
    arms = {name: [arm.name for arm in kind.arms] for name, kind in settings.agent_types.items()}
    return tuple(
        array([[times.get(f"{agent.name}/{arm}", np.inf) for arm in arms[agent.type]] for agent in group])
        for group in team_module.group_agents(settings)
    )


def _rotor_fault(fault: schema.RotorFault, settings: schema.Scenario) -> faults.RotorFault:
    """Return the fault of one rotor."""
    rotors = range(_ring(settings).num_rotors)
    failed = [
        np.array([[f"{agent.name}/{rotor}" == fault.who for rotor in rotors] for agent in group])
        for group in team_module.group_agents(settings)
    ]
    return faults.RotorFault(
        share=tuple(array(np.where(mask, 1.0 if fault.to is None else fault.to, 1.0)) for mask in failed),
        stuck=tuple(jnp.asarray(mask & (fault.to is None)) for mask in failed),
        start=array(fault.start_s),
        end=array(fault.last_time),
    )


def _mixers(settings: schema.Scenario, truth: Team) -> tuple[RotorMixer, ...]:
    """Return the rotors of each group."""
    return tuple(rotor_mixer(_ring(settings), group.thrust_max) for group in truth.agent_groups)


def _ring(settings: schema.Scenario) -> schema.Rotors:
    """Return the rotors of a scenario with faults of single rotors, which the checks of the settings require."""
    ring = rotor_settings(settings)
    assert ring is not None  # for the type checker
    return ring


SIZE_OF_FAILURES = 100
"""Size of garbage and of wrong readings, as a multiple of the standard deviation of the noise."""


def _reading_fault(fault: schema.SensorFault, settings: schema.Scenario) -> sensor_faults.ReadingFault:
    """Return the sensor model of a reading that fails."""
    period = 1 / settings.control_Hz
    common: dict[str, Any] = {
        "channel": f"payload.{fault.reading}" if fault.who == "payload" else f"agents.{fault.reading}",
        "failed": tuple(
            jnp.asarray([agent.name == fault.who for agent in group]) for group in team_module.group_agents(settings)
        ),
        "start": array(fault.start_s),
        "end": array(fault.last_time),
    }
    if fault.to == "delayed":
        return sensor_faults.DelayedReading(**common, delay=round(fault.delay_s * settings.control_Hz))
    if fault.to in ("garbage", "wrong"):
        size, none = SIZE_OF_FAILURES * _noise_of(fault.reading, make_sensor_noise(settings)), jnp.zeros(())
        offset, noise = (size, none) if fault.to == "wrong" else (none, size)
        return sensor_faults.WrongReading(**common, offset=offset, noise=noise)
    return sensor_faults.HeldReading(
        **common,
        sample_period=array(1 / fault.rate_Hz if fault.to == "slow" else period),
        dropout_probability=array({"slow": 0.0, "intermittent": fault.dropout_probability}.get(fault.to, 1.0)),
        reports_age=fault.to != "stuck",
    )


def _noise_of(reading: str, noise: SensorNoise) -> Array:
    """Return the standard deviation of a reading."""
    return {
        "p": noise.position,
        "x": noise.position,
        "R": noise.attitude,
        "v": noise.velocity,
        "omega": noise.angular_velocity,
        "a": noise.accelerometer,
        "r": noise.joint_position,
        "lam": noise.tip_force,
    }[reading]


def _link(fault: schema.LinkFault, settings: schema.Scenario) -> faults.LinkFault:
    """Return the sensor model of the messages that arrive at an agent."""
    return faults.LinkFault(
        member=jnp.asarray([name == fault.who for name in team_module.agent_names(settings)]),
        period=array(1 / fault.rate_Hz),
        loss_probability=array(fault.dropout_probability),
        start=array(fault.start_s),
        end=array(fault.last_time),
        delay=round(fault.delay_s * settings.control_Hz),
    )


def _plant(settings: schema.Scenario, world: SimulatedWorld, state: State) -> Plant:
    given = settings.physics
    if isinstance(given, schema.Plugin):
        return build_plugin(given, "physics", Plant, world)
    if isinstance(given, schema.RigidContactPhysics):
        return contact_dynamics.RigidContactPlant()
    try:
        from colift.simulation import mujoco_plant  # MuJoCo is an extra
    except ModuleNotFoundError as error:
        raise ScenarioError(f"{settings.name}: physics: {error}") from None
    return mujoco_plant.mujoco_plant(world.team, state, 1 / settings.control_Hz, given.substeps)


def _sensor_model(
    given: schema.Intermittent | schema.BiasRandomWalk | schema.Plugin, location: str, settings: schema.Scenario
) -> SensorModel:
    match given:
        case schema.Intermittent():
            return Intermittent(
                channels=given.channels,
                sample_period=array(1 / given.rate_Hz),
                dropout_probability=array(given.dropout_probability),
                failure_time=array(np.inf if given.failure_time_s is None else given.failure_time_s),
                delay=round(given.delay_s * settings.control_Hz),
            )
        case schema.BiasRandomWalk():
            return BiasRandomWalk(
                channels=given.channels,
                random_walk_density=array(given.random_walk_density),
                initial_bias_std=array(given.initial_bias_std),
            )
    return build_plugin(given, location, SensorModel)


def _actuators(settings: schema.Scenario, world: SimulatedWorld) -> actuators.IdealActuators:
    given = settings.actuators
    if isinstance(given, schema.Plugin):
        return build_plugin(given, "actuators", actuators.IdealActuators, world)
    if isinstance(given, schema.IdealActuators):
        return actuators.IdealActuators()
    return actuators.LaggedMotors(
        lag=actuator_lag(given, settings),
        limits=tuple(_limit(given, group.thrust_max) for group in world.team.agent_groups),
    )


def _limit(given: schema.LaggedMotors, thrust_max: Array) -> actuators.InputLimits:
    if given.rotors is not None:
        return rotor_mixer(given.rotors, thrust_max)
    return actuators.BoxLimits(thrust_max=thrust_max, torque_max=array([np.inf] * len(thrust_max)))


def make_sensor_noise(settings: schema.Scenario) -> SensorNoise:
    """Return the sensor noise, in SI units."""
    given, types = settings.sensors, team_module.contact_types(settings)
    return SensorNoise(
        position=array(given.position_m),
        attitude=array(np.deg2rad(given.attitude_deg)),
        velocity=array(given.velocity_mps),
        angular_velocity=array(given.angular_velocity_radps),
        accelerometer=array(given.accelerometer_mps2),
        joint_position=array(np.deg2rad(given.joint_position_deg)),
        tip_force=array(given.tip_force_N),
        tip_moment=array(0.0 if set(types) == {"point"} else given.tip_moment_Nm),
        tip_force_bias=array(given.tip_force_bias_N),
        tip_force_bandwidth=array(given.tip_force_bandwidth_Hz),
    )
