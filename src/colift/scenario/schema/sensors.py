"""What a scenario may say: one frozen model a section, units in the names, a sentence for every setting.

World frame unless a description says otherwise. The words and defaults here are the reference page
(docs/scenarios.md) and the help of the error messages; there is no second list.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    Field,
)

from colift.scenario import fields
from colift.scenario.cross_checks import MAX_ENTRIES
from colift.scenario.fields import unit
from colift.scenario.schema.base import Plugin, Section

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


class Intermittent(Section):
    """Readings at a rate of their own, late, and lost now and then; in between the last one that came is held."""

    kind: Literal["intermittent"]
    """Which."""
    channels: Readings
    """Which readings: of the payload or of all agents, position p or x, attitude R, and so on."""
    rate_Hz: fields.Rate
    """How often they are taken, at most once a tick."""
    delay_s: fields.Time = 0.0
    """How late they come; whole ticks."""
    dropout_probability: fields.Fraction = 0.0
    """Probability that one is lost."""
    failure_time_s: fields.Time | None = None
    """When the sensor dies; by default never."""


class BiasRandomWalk(Section):
    """A bias that walks at random and is added to every component."""

    kind: Literal["bias_random_walk"]
    """Which."""
    channels: Readings
    """Which readings, as for [Intermittent](#intermittent); an attitude is turned about its body's axes."""
    random_walk_density: Annotated[fields.Noise, unit("of the reading, or rad, per √s")]
    """Standard deviation of the walk after one second."""
    initial_bias_std: Annotated[fields.Noise, unit("of the reading, or rad")] = 0.0
    """Standard deviation of the bias that it begins with."""


class Sensors(Section):
    """Standard deviations of white noise on every tick's reading, and the tips' bias and bandwidth."""

    position_m: fields.Noise = 0.002
    """Position."""
    attitude_deg: fields.AngularNoise = 0.2
    """Attitude, per axis of the rotation vector."""
    velocity_mps: fields.Noise = 0.01
    """Velocity."""
    angular_velocity_radps: fields.Noise = 0.01
    """Body rate."""
    accelerometer_mps2: fields.Noise = 0.05
    """Specific force."""
    joint_position_deg: fields.AngularNoise = 0.1
    """Joint encoder; a sliding joint has the same number of radians as metres (0.1 deg: 1.7 mm)."""
    tip_force_N: fields.Noise = 0.1
    """Force at a tip, per axis."""
    tip_force_bias_N: fields.Noise = 0.05
    """Deviation from which the constant bias of each tip axis is drawn."""
    tip_force_bandwidth_Hz: fields.Bandwidth = 50.0
    """First-order bandwidth of the tip force sensors."""
    models: Annotated[
        tuple[Annotated[Intermittent | BiasRandomWalk | Plugin, Field(discriminator="kind")], ...],
        Field(max_length=MAX_ENTRIES),
    ] = ()
    """What readings go through after that, in this order; `build()` of one's own gives a `colift.simulation.sensors.Extra`."""
