"""Faults of single readings: held, delayed and wrong readings of one agent or of the payload, in an interval.

See Also:
    colift.simulation.sensors: sensors with noise, bias, rates, delays and dropouts.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from colift.math.pytree import pytree, static
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import ControlClock
from colift.simulation import sensors
from colift.simulation.sensors import SensedState, SensorModel

Scalar = Float[Array, ""]


@pytree
class ReadingFault(SensorModel):
    """Base class of faults of one reading of one agent or of the payload."""

    channel: str = static()  # field of the payload or agent readings, for example `payload.p`, `agents.x`
    failed: tuple[Bool[Array, "agents"], ...]  # agents whose reading fails, by group; unused for the payload
    start: Scalar  # s
    end: Scalar  # s; inf: until the end of the flight

    def active(self, t: Scalar) -> Bool[Array, ""]:
        """Return True within the interval, for a time t [s]."""
        return (t >= self.start - 1e-9) & (t < self.end - 1e-9)

    def reading(self, measurement: Measurement) -> Any:
        """Return the reading of the payload, or that of all agents by group."""
        return sensors.select_channels(measurement, (self.channel,))[self.channel]

    def replaced(
        self, measurement: Measurement, faulty: Any, fails: Bool[Array, ""]
    ) -> tuple[Measurement, dict[str, Any]]:
        """Return the measurement with the faulty readings where the fault acts, and all readings of the channel.

        Args:
            measurement: Measurement without this fault.
            faulty: Faulty reading of the payload, or of all agents by group.
            fails: Whether the fault acts.
        """

        def select(mask: Bool[Array, "*agents"], new: Array, wrong: Array) -> Array:
            return jnp.where((fails & mask).reshape(mask.shape + (1,) * (new.ndim - mask.ndim)), wrong, new)

        readings = self.reading(measurement)
        if isinstance(readings, tuple):
            readings = tuple(map(select, self.failed, readings, faulty))
        else:
            readings = select(jnp.array(True), readings, faulty)
        values = {self.channel: readings}
        return sensors.replace_channels(measurement, (self.channel,), values), values


@pytree
class HeldReadingState:
    """State of `HeldReading`."""

    last_reading: dict[str, Any]  # readings of the previous period, by channel
    age: Scalar  # s, age of the held reading


@pytree
class HeldReading(ReadingFault):
    """A reading that is held between samples: stuck, off, slow or intermittent.

    A sample is due when `sample_period` has passed since the previous one, first at the start. It is lost with
    probability `dropout_probability`.
    """

    sample_period: Scalar  # s
    dropout_probability: Scalar  # 1: stuck or off
    reports_age: bool = static(default=True)  # whether `Measurement.measurement_age_s` contains the age

    def sample_noise(self, team: Team, key: Array, ticks: int) -> Float[Array, "time"]:
        """Draw uniform numbers; a value below `dropout_probability` discards the reading."""
        return jax.random.uniform(key, (ticks,))

    def init(self, measurement: Measurement) -> Any:
        """Return the readings at rest."""
        held = sensors.select_channels(measurement, (self.channel,))
        return HeldReadingState(last_reading=held, age=jnp.zeros(()))

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: HeldReadingState, noise: Any
    ) -> tuple[Measurement, Any]:
        """Replace the reading by that of the previous period, unless a sample arrives."""
        passed = clock.t - self.start + 1e-9
        due = jnp.floor(passed / self.sample_period) > jnp.floor((passed - clock.dt) / self.sample_period)
        holds = self.active(clock.t) & ~(due & (noise >= self.dropout_probability))
        measured, values = self.replaced(measurement, state.last_reading[self.channel], holds)
        age = jnp.where(holds, state.age + clock.dt, 0.0)
        if self.reports_age:
            ages = measurement.measurement_age_s
            oldest = jnp.maximum(ages.get(self.channel, jnp.zeros(())), age)
            measured = dataclasses.replace(measured, measurement_age_s=ages | {self.channel: oldest})
        return measured, HeldReadingState(last_reading=values, age=age)


@pytree
class DelayedReading(ReadingFault):
    """A reading that arrives late; its age is not reported."""

    delay: int = static()  # ticks

    def init(self, measurement: Measurement) -> Any:
        """Return a delay line of readings at rest, oldest first."""
        return (self.reading(measurement),) * self.delay

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: Any, noise: Any
    ) -> tuple[Measurement, Any]:
        """Replace the reading by the delayed one."""
        late, *pending = (*state, self.reading(measurement))
        return self.replaced(measurement, late, self.active(clock.t))[0], tuple(pending)


@pytree
class WrongReading(ReadingFault):
    """A reading with a constant offset or white noise, equal in size on all components.

    Offset and noise of an attitude are rotation vectors in the body frame.
    """

    offset: Scalar  # unit of the reading (attitude: rad)
    noise: Scalar  # standard deviation, unit of the reading (attitude: rad)

    def sample_noise(self, team: Team, key: Array, ticks: int) -> Any:
        """Draw standard normal samples in the shape of the reading."""
        return sensors.sample_channel_noise(team, (self.channel,), key, ticks)[self.channel]

    def apply(
        self, measurement: Measurement, truth: SensedState, clock: ControlClock, state: Any, noise: Any
    ) -> tuple[Measurement, Any]:
        """Add offset and noise to the reading."""
        faulty = jax.tree.map(
            lambda x, n: sensors.add_bias(self.channel, x, self.offset + self.noise * n),
            self.reading(measurement),
            noise,
        )
        return self.replaced(measurement, faulty, self.active(clock.t))[0], state
