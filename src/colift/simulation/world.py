"""The truth that a flight meets: plant, unknown forces, actuators, sensors, each with a memory of its own.

A world is anything with the methods of `World`; ours, `Simulated`, is a PyTree of numbers and parts, so that a flight
compiles. What flies gets `sense`'s measurement and nothing else; `Truth` goes to the log.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.filters import blend
from colift.math.pytree import pytree
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import Clock, Inputs, Residual, State, Unknown, no_force
from colift.simulation import contact_dynamics, disturbances
from colift.simulation import sensors as sensors_module
from colift.simulation.actuators import Ideal

Scalar = Float[Array, ""]


@pytree
class Moving:
    """The state of our world between ticks."""

    z: State
    applied: Inputs  # what acted in the last tick
    felt: tuple[Float[Array, "agents arms 3"], ...]  # N, tip forces behind the sensors' bandwidth, world
    laws: disturbances.Memory
    actuators: Any
    extra: tuple[Any, ...]  # of the extra sensors


@pytree
class Truth:
    """What is true at the start of a tick, under what acts during it; for the log."""

    z: State
    inputs: Inputs
    a: contact_dynamics.Acceleration
    lam: tuple[Float[Array, "agents arms 3"], ...]  # N, contact forces on the payload, world


@pytree
class Noise:
    """What is random in the sensors of one tick, or with a leading time axis, of many."""

    sensors: sensors_module.Noise
    extra: tuple[Any, ...]


@runtime_checkable
class Plant(Protocol):
    """The grasped team's motion under known forces."""

    def accelerate(
        self, team: Team, z: State, inputs: Inputs, f: Residual
    ) -> tuple[contact_dynamics.Acceleration, tuple[Float[Array, "_agents _arms 3"], ...]]:
        """Accelerations, and contact forces on the payload, N, world."""
        ...

    def step(self, team: Team, z: State, inputs: Inputs, residual: Unknown, dt: Scalar) -> State:
        """The state after dt, s, inputs held; residual: of a state and of the time since the step began."""
        ...


@runtime_checkable
class World(Protocol):
    """What a flight meets."""

    @property
    def team(self) -> Team:
        """The true parameters."""
        ...

    def draw(self, key: Array, ticks: int) -> Any:
        """The noise of `ticks` ticks from one random key, a PyTree with time first."""
        ...

    def rest(self, z: State) -> Measurement:
        """What sensors without noise or bias read of the team held still at z: what a pilot begins with."""
        ...

    def begin(self, z: State, command: Inputs) -> Any:
        """The state at z, held until now by a command."""
        ...

    def sense(self, state: Any, clock: Clock, noise: Any) -> tuple[Measurement, Any]:
        """The measurement now, and the state with the sensors' memory after it."""
        ...

    def step(self, state: Any, command: Inputs, clock: Clock) -> tuple[Any, Truth]:
        """The state after the tick, under a command that is held; and the truth at its start."""
        ...


@pytree
class Added:
    """Mass that is put on the payload's centre of mass in flight, or taken off it."""

    mass: Scalar  # kg
    start: Scalar  # s
    over: Scalar  # s

    def at(self, team: Team, t: Scalar) -> Team:
        """The team at time t, s."""
        mass = team.payload.mass + self.mass * disturbances.risen((t - self.start) / self.over)
        return dataclasses.replace(team, payload=dataclasses.replace(team.payload, mass=mass))


@pytree
class Simulated:
    """Our world: the grasped team under its sources, flown through actuators and seen by sensors."""

    team: Team
    plant: Plant
    sources: disturbances.Disturbances
    acting: Scalar  # share of the sources that acts: 1 in flight, 0 for the loop by itself
    actuators: Ideal
    sensors: sensors_module.Sensors
    lam_bias: tuple[Float[Array, "agents arms 3"], ...]  # N, tip frames
    extra: tuple[sensors_module.Extra, ...]
    added: Added | None = None

    def at(self, t: Scalar) -> Team:
        """The true parameters at time t, s."""
        return self.team if self.added is None else self.added.at(self.team, t)

    def draw(self, key: Array, ticks: int) -> Noise:
        """The noise of `ticks` ticks from one random key."""
        extra = tuple(one.draw(self.team, key, ticks) for one in self.extra)
        return Noise(sensors=sensors_module.draw(self.team, key, ticks), extra=extra)

    def rest(self, z: State) -> Measurement:
        """What sensors without noise or bias read of the team held still at z: what a pilot begins with."""
        return self._still(z)[0]

    def _still(self, z: State) -> tuple[Measurement, tuple[Any, ...]]:
        """The reading at rest, and the memories of the extra sensors before it."""
        still = sensors_module.Truth(
            z=z,
            v_dot=tuple(jnp.zeros_like(a.v) for a in z.agents),
            xi_dot=tuple(jnp.zeros((a.r.shape[0], 3 + a.r.shape[1])) for a in z.agents),
            a_L=jnp.zeros(6),
            lam=tuple(jnp.zeros_like(group.contact) for group in self.team.groups),
            f=no_force(self.team),
        )
        quiet = jax.tree.map(lambda x: jnp.zeros(x.shape[1:], x.dtype), self.draw(jax.random.key(0), 1))
        m = sensors_module.sense(
            self.team, self.sensors, jax.tree.map(jnp.zeros_like, self.lam_bias), still, quiet.sensors
        )
        kept, clock = [], Clock(t=jnp.zeros(()), dt=jnp.zeros(()))
        for one, none in zip(self.extra, quiet.extra, strict=True):
            kept.append(one.begin(m))
            m, _ = one.read(m, still, clock, kept[-1], none)
        return m, tuple(kept)

    def begin(self, z: State, command: Inputs) -> Moving:
        """The state at z, held until now by a command."""
        _, kept = self._still(z)
        laws = disturbances.begin(self.sources, self.team)
        _, lam = self.plant.accelerate(self.at(jnp.zeros(())), z, command, self.unknown(z, jnp.zeros(()), laws))
        return Moving(
            z=z,
            applied=command,
            felt=lam,
            laws=laws,
            actuators=self.actuators.begin(command),
            extra=kept,
        )

    def unknown(self, z: State, t: Scalar, laws: disturbances.Memory) -> Residual:
        """The unknown forces in the state z at time t, s."""
        f = disturbances.forces(self.sources, self.team, z, t, laws)
        return jax.tree.map(lambda x: self.acting * x, f)

    def sense(self, state: Moving, clock: Clock, noise: Noise) -> tuple[Measurement, Moving]:
        """The measurement now: the end of the last tick, under what acted in it."""
        t = clock.t
        f = self.unknown(state.z, t, state.laws)
        a, lam = self.plant.accelerate(self.at(t), state.z, state.applied, f)
        b = blend(self.sensors.tip_force_bandwidth, clock.dt)
        felt = tuple(old + b * (new - old) for old, new in zip(state.felt, lam, strict=True))
        seen = sensors_module.Truth(
            z=state.z,
            v_dot=tuple(x.v_dot for x in a.agents),
            xi_dot=tuple(x.xi_dot for x in a.agents),
            a_L=a.payload,
            lam=felt,
            f=f,
        )
        m = sensors_module.sense(self.team, self.sensors, self.lam_bias, seen, noise.sensors)
        kept = []
        for one, past, drawn in zip(self.extra, state.extra, noise.extra, strict=True):
            m, now = one.read(m, seen, clock, past, drawn)
            kept.append(now)
        return m, Moving(
            z=state.z,
            applied=state.applied,
            felt=felt,
            laws=state.laws,
            actuators=state.actuators,
            extra=tuple(kept),
        )

    def step(self, state: Moving, command: Inputs, clock: Clock) -> tuple[Moving, Truth]:
        """The state after the tick, under a command that is held; and the truth at its start."""
        t, dt = clock.t, clock.dt
        inputs, actuators = self.actuators(command, state.actuators, clock)
        f = self.unknown(state.z, t, state.laws)
        team = self.at(t)
        a, lam = self.plant.accelerate(team, state.z, inputs, f)
        z = self.plant.step(team, state.z, inputs, lambda z, s: self.unknown(z, t + s, state.laws), dt)
        now = Moving(
            z=z,
            applied=inputs,
            felt=state.felt,
            laws=disturbances.after(self.sources, self.team, state.z, t, state.laws, dt),
            actuators=actuators,
            extra=state.extra,
        )
        return now, Truth(z=state.z, inputs=inputs, a=a, lam=lam)
