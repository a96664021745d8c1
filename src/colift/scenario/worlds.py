"""The truth that a scenario's team meets: its plant, actuators and sensors."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift import actuator, disturbance, dynamics, sensor
from colift.model import Residual, State, Team
from colift.scenario import settings as s
from colift.scenario.mistake import ScenarioError
from colift.scenario.values import array, built, lag
from colift.world import Added, Plant, Simulated


def world(settings: s.Settings, truth: Team, z: State, sources: disturbance.Disturbances, rig: Residual) -> Simulated:
    """The truth that the team meets from z on; rig: largest error of the calibration rig's labels, where it is asked.

    Raises ScenarioError for a part of one's own that is none, and where MuJoCo is asked for and not installed.
    """
    seen = sensors(settings)
    then = tuple(_reading(x, f"sensors.then.{i}", settings) for i, x in enumerate(settings.sensors.then))
    ours = Simulated(
        team=truth,
        plant=dynamics.Rigid(),
        sources=sources,
        acting=jnp.asarray(1.0),
        actuators=actuator.Ideal(),
        sensors=seen,
        lam_bias=sensor.bias(truth, seen, jax.random.fold_in(jax.random.key(settings.seed), 1)),
        extra=(*then, sensor.Rig(error=rig)) if settings.learning.samples == "rig" else then,
        added=None if settings.added is None else _added(settings.added),
    )
    return dataclasses.replace(ours, actuators=_actuators(settings, ours), plant=_plant(settings, ours, z))


def _added(given: s.Added) -> Added:
    return Added(mass=array(given.mass_kg), start=array(given.start_s), over=array(given.over_s))


def _plant(settings: s.Settings, ours: Simulated, z: State) -> Plant:
    given = settings.plant
    if isinstance(given, s.Own):
        return built(given, "plant", Plant, ours)
    if isinstance(given, s.Rigid):
        return dynamics.Rigid()
    try:
        from colift import engine  # MuJoCo is an extra
    except ModuleNotFoundError as error:
        raise ScenarioError(f"{settings.name}: plant: {error}") from None
    return engine.plant(ours.team, z, 1 / settings.control_Hz, given.substeps)


def _reading(given: s.Intermittent | s.Drifting | s.Own, where: str, settings: s.Settings) -> sensor.Extra:
    match given:
        case s.Intermittent():
            return sensor.Intermittent(
                of=given.of,
                every=array(1 / given.rate_Hz),
                loss=array(given.loss),
                until=array(np.inf if given.until_s is None else given.until_s),
                delay=round(given.delay_s * settings.control_Hz),
            )
        case s.Drifting():
            return sensor.Drifting(of=given.of, rate=array(given.rate), start=array(given.start))
    return built(given, where, sensor.Extra)


def _actuators(settings: s.Settings, ours: Simulated) -> actuator.Ideal:
    given = settings.actuators
    if isinstance(given, s.Own):
        return built(given, "actuators", actuator.Ideal, ours)
    if isinstance(given, s.Ideal):
        return actuator.Ideal()
    return actuator.Motors(
        lag=lag(given, settings), limits=tuple(_limit(given, group.thrust_max) for group in ours.team.groups)
    )


def _limit(given: s.Motors, thrust_max: Array) -> actuator.Limit:
    if given.rotors is not None:
        ring = given.rotors
        return actuator.rotors(ring.count, ring.arm_m, ring.yaw_m, thrust_max / ring.count)
    most = np.inf if given.torque_max_Nm is None else given.torque_max_Nm
    return actuator.Box(thrust_max=thrust_max, torque_max=array([most] * len(thrust_max)))


def sensors(settings: s.Settings) -> sensor.Sensors:
    """Noise of the sensors, in SI."""
    given = settings.sensors
    return sensor.Sensors(
        position=array(given.position_m),
        attitude=jnp.deg2rad(array(given.attitude_deg)),
        velocity=array(given.velocity_mps),
        body_rate=array(given.body_rate_radps),
        accelerometer=array(given.accelerometer_mps2),
        joint=jnp.deg2rad(array(given.joint_deg)),
        tip_force=array(given.tip_force_N),
        tip_force_bias=array(given.tip_force_bias_N),
        tip_force_bandwidth=array(given.tip_force_bandwidth_Hz),
    )
