"""Settings of the sensors.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    Field,
)

from colift.scenario import fields
from colift.scenario.fields import unit
from colift.scenario.plain_data import MAX_ENTRIES
from colift.scenario.schema.base import Plugin, Section
from colift.scenario.schema.shared import Transmitted

Reading = Literal[
    "payload.p",
    "payload.R",
    "payload.v",
    "payload.omega",
    "payload.a",
    "agents.x",
    "agents.R",
    "agents.v",
    "agents.omega",
    "agents.a",
    "agents.r",
    "agents.lam",
]
Readings = Annotated[tuple[Reading, ...], Field(min_length=1, max_length=12)]


class _SensorModel(Section):
    """Settings that all sensor models have."""

    channels: Readings
    """Names of the readings, of the payload or of all agents; errors of an attitude R are rotations about body axes."""


class Intermittent(Transmitted, _SensorModel):
    """Readings with their own rate, delay and dropouts; the last received reading is held."""

    kind: Literal["intermittent"]
    """Selects this sensor model."""
    failure_time_s: fields.Time | None = None
    """Time after which there are no readings; default: never."""


class BiasRandomWalk(_SensorModel):
    """A bias that is a random walk, added to every component."""

    kind: Literal["bias_random_walk"]
    """Selects this sensor model."""
    random_walk_density: Annotated[fields.Noise, unit("of the reading, or rad, per √s")]
    """Standard deviation of the change in one second."""
    initial_bias_std: Annotated[fields.Noise, unit("of the reading, or rad")] = 0.0
    """Standard deviation of the initial bias."""


class Sensors(Section):
    """Standard deviations of the white noise per control period, and bias and bandwidth of tip force sensors."""

    position_m: fields.Noise = 0.002
    """Position."""
    attitude_deg: fields.AngularNoise = 0.2
    """Attitude, by component of the rotation vector."""
    velocity_mps: fields.Noise = 0.01
    """Velocity."""
    angular_velocity_radps: fields.Noise = 0.01
    """Angular velocity."""
    accelerometer_mps2: fields.Noise = 0.05
    """Specific force."""
    joint_position_deg: fields.AngularNoise = 0.1
    """Joint position; for a prismatic joint the number in rad is used in m (0.1 deg: 1.7 mm)."""
    tip_force_N: fields.Noise = 0.1
    """Force at a tip, by axis."""
    tip_moment_Nm: fields.Noise = 0.005
    """Moment at the tip of a contact that bears moments, by axis."""
    tip_force_bias_N: fields.Noise = 0.05
    """Standard deviation of the constant bias of each axis of a tip force sensor."""
    tip_force_bandwidth_Hz: fields.Bandwidth = 50.0
    """Bandwidth of the first-order lag of the tip force sensors."""
    payload_imu: bool = True
    """Gyroscope and accelerometer of the payload; without them a Kalman filter estimates its motion."""
    models: Annotated[
        tuple[Annotated[Intermittent | BiasRandomWalk | Plugin, Field(discriminator="kind")], ...],
        Field(max_length=MAX_ENTRIES),
    ] = ()
    """Further sensor models, applied in this order; a plugin builds a `colift.simulation.sensors.SensorModel`."""
