"""The truth that a scenario's team meets: its plant, actuators and sensors."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift.models.parameters import Team
from colift.models.state import Residual, State
from colift.scenario import schema
from colift.scenario.conversion import array, built, lag
from colift.scenario.errors import ScenarioError
from colift.simulation import actuators, contact_dynamics, disturbances
from colift.simulation.sensors import Drifting, Extra, Intermittent, Rig, Sensors, bias
from colift.simulation.world import Added, Plant, Simulated


def world(
    settings: schema.Settings, truth: Team, z: State, sources: disturbances.Disturbances, rig: Residual
) -> Simulated:
    """The truth that the team meets from z on; rig: largest error of the calibration rig's labels, where it is asked.

    Raises ScenarioError for a part of one's own that is none, and where MuJoCo is asked for and not installed.
    """
    seen = sensors(settings)
    then = tuple(_reading(x, f"sensors.then.{i}", settings) for i, x in enumerate(settings.sensors.then))
    ours = Simulated(
        team=truth,
        plant=contact_dynamics.Rigid(),
        sources=sources,
        acting=jnp.asarray(1.0),
        actuators=actuators.Ideal(),
        sensors=seen,
        lam_bias=bias(truth, seen, jax.random.fold_in(jax.random.key(settings.seed), 1)),
        extra=(*then, Rig(error=rig)) if settings.learning.samples == "rig" else then,
        added=None if settings.added is None else _added(settings.added),
    )
    return dataclasses.replace(ours, actuators=_actuators(settings, ours), plant=_plant(settings, ours, z))


def _added(given: schema.Added) -> Added:
    return Added(mass=array(given.mass_kg), start=array(given.start_s), over=array(given.over_s))


def _plant(settings: schema.Settings, ours: Simulated, z: State) -> Plant:
    given = settings.plant
    if isinstance(given, schema.Own):
        return built(given, "plant", Plant, ours)
    if isinstance(given, schema.Rigid):
        return contact_dynamics.Rigid()
    try:
        from colift.simulation import mujoco_plant  # MuJoCo is an extra
    except ModuleNotFoundError as error:
        raise ScenarioError(f"{settings.name}: plant: {error}") from None
    return mujoco_plant.plant(ours.team, z, 1 / settings.control_Hz, given.substeps)


def _reading(given: schema.Intermittent | schema.Drifting | schema.Own, where: str, settings: schema.Settings) -> Extra:
    match given:
        case schema.Intermittent():
            return Intermittent(
                of=given.of,
                every=array(1 / given.rate_Hz),
                loss=array(given.loss),
                until=array(np.inf if given.until_s is None else given.until_s),
                delay=round(given.delay_s * settings.control_Hz),
            )
        case schema.Drifting():
            return Drifting(of=given.of, rate=array(given.rate), start=array(given.start))
    return built(given, where, Extra)


def _actuators(settings: schema.Settings, ours: Simulated) -> actuators.Ideal:
    given = settings.actuators
    if isinstance(given, schema.Own):
        return built(given, "actuators", actuators.Ideal, ours)
    if isinstance(given, schema.Ideal):
        return actuators.Ideal()
    return actuators.Motors(
        lag=lag(given, settings), limits=tuple(_limit(given, group.thrust_max) for group in ours.team.groups)
    )


def _limit(given: schema.Motors, thrust_max: Array) -> actuators.Limit:
    if given.rotors is not None:
        ring = given.rotors
        return actuators.rotors(ring.count, ring.arm_m, ring.yaw_m, thrust_max / ring.count)
    most = np.inf if given.torque_max_Nm is None else given.torque_max_Nm
    return actuators.Box(thrust_max=thrust_max, torque_max=array([most] * len(thrust_max)))


def sensors(settings: schema.Settings) -> Sensors:
    """Noise of the sensors, in SI."""
    given = settings.sensors
    return Sensors(
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
