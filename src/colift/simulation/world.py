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

from colift.math.filters import smoothing_factor
from colift.math.pytree import pytree
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import ControlClock, ResidualForces, ResidualFunctionType, State, TeamInputs, zero_residual
from colift.simulation import contact_dynamics, disturbances
from colift.simulation import sensors as sensors_module
from colift.simulation.actuators import IdealActuators

Scalar = Float[Array, ""]


@pytree
class WorldState:
    """The state of our world between ticks."""

    state: State
    applied_inputs: TeamInputs  # what acted in the last tick
    filtered_tip_forces: tuple[Float[Array, "agents arms 3"], ...]  # N, tip forces behind the sensors' bandwidth, world
    disturbances: disturbances.DisturbanceState
    actuators: Any
    sensors: tuple[Any, ...]  # of the extra sensors


@pytree
class GroundTruth:
    """What is true at the start of a tick, under what acts during it; for the log."""

    state: State
    inputs: TeamInputs
    acceleration: contact_dynamics.Acceleration
    lam: tuple[Float[Array, "agents arms 3"], ...]  # N, contact forces on the payload, world


@pytree
class WorldNoise:
    """What is random in the sensors of one tick, or with a leading time axis, of many."""

    sensors: sensors_module.Noise
    sensor_models: tuple[Any, ...]


@runtime_checkable
class Plant(Protocol):
    """The grasped team's motion under known forces."""

    def forward_dynamics(
        self, team: Team, state: State, inputs: TeamInputs, f: ResidualForces
    ) -> tuple[contact_dynamics.Acceleration, tuple[Float[Array, "_agents _arms 3"], ...]]:
        """Accelerations, and contact forces on the payload, N, world."""
        ...

    def step(self, team: Team, state: State, inputs: TeamInputs, residual: ResidualFunctionType, dt: Scalar) -> State:
        """The state after dt, s, inputs held; residual: of a state and of the time since the step began."""
        ...


@runtime_checkable
class World(Protocol):
    """What a flight meets."""

    @property
    def team(self) -> Team:
        """The true parameters."""
        ...

    def sample_noise(self, key: Array, ticks: int) -> Any:
        """The noise of `ticks` ticks from one random key, a PyTree with time first."""
        ...

    def measure_at_rest(self, state: State) -> Measurement:
        """What sensors without noise or bias read of the team held still at z: what a pilot begins with."""
        ...

    def init(self, state: State, command: TeamInputs) -> Any:
        """The state at z, held until now by a command."""
        ...

    def measure(self, state: Any, clock: ControlClock, noise: Any) -> tuple[Measurement, Any]:
        """The measurement now, and the state with the sensors' memory after it."""
        ...

    def step(self, state: Any, command: TeamInputs, clock: ControlClock) -> tuple[Any, GroundTruth]:
        """The state after the tick, under a command that is held; and the truth at its start."""
        ...


@pytree
class PayloadMassStep:
    """Mass that is put on the payload's centre of mass in flight, or taken off it."""

    mass: Scalar  # kg
    start: Scalar  # s
    ramp_time: Scalar  # s

    def team_at(self, team: Team, t: Scalar) -> Team:
        """The team at time t, s."""
        mass = team.payload.mass + self.mass * disturbances.smoothstep((t - self.start) / self.ramp_time)
        return dataclasses.replace(team, payload=dataclasses.replace(team.payload, mass=mass))


@pytree
class SimulatedWorld:
    """Our world: the grasped team under its sources, flown through actuators and seen by sensors."""

    team: Team
    plant: Plant
    disturbances: disturbances.DisturbanceSet
    disturbance_scale: Scalar  # share of the sources that acts: 1 in flight, 0 for the loop by itself
    actuators: IdealActuators
    sensors: sensors_module.SensorNoise
    tip_force_bias: tuple[Float[Array, "agents arms 3"], ...]  # N, tip frames
    sensor_models: tuple[sensors_module.SensorModel, ...]
    mass_step: PayloadMassStep | None = None

    def team_at(self, t: Scalar) -> Team:
        """The true parameters at time t, s."""
        return self.team if self.mass_step is None else self.mass_step.team_at(self.team, t)

    def sample_noise(self, key: Array, ticks: int) -> WorldNoise:
        """The noise of `ticks` ticks from one random key."""
        extra = tuple(one.sample_noise(self.team, key, ticks) for one in self.sensor_models)
        return WorldNoise(sensors=sensors_module.sample_noise(self.team, key, ticks), sensor_models=extra)

    def measure_at_rest(self, state: State) -> Measurement:
        """What sensors without noise or bias read of the team held still at z: what a pilot begins with."""
        return self._still(state)[0]

    def _still(self, state: State) -> tuple[Measurement, tuple[Any, ...]]:
        """The reading at rest, and the memories of the extra sensors before it."""
        still = sensors_module.SensedState(
            z=state,
            v_dot=tuple(jnp.zeros_like(a.v) for a in state.agents),
            xi_dot=tuple(jnp.zeros((a.r.shape[0], 3 + a.r.shape[1])) for a in state.agents),
            a_L=jnp.zeros(6),
            lam=tuple(jnp.zeros_like(group.contact_position) for group in self.team.agent_groups),
            f=zero_residual(self.team),
        )
        quiet = jax.tree.map(lambda x: jnp.zeros(x.shape[1:], x.dtype), self.sample_noise(jax.random.key(0), 1))
        m = sensors_module.measure(
            self.team, self.sensors, jax.tree.map(jnp.zeros_like, self.tip_force_bias), still, quiet.sensors
        )
        kept, clock = [], ControlClock(t=jnp.zeros(()), dt=jnp.zeros(()))
        for one, none in zip(self.sensor_models, quiet.sensor_models, strict=True):
            kept.append(one.init(m))
            m, _ = one.apply(m, still, clock, kept[-1], none)
        return m, tuple(kept)

    def init(self, state: State, command: TeamInputs) -> WorldState:
        """The state at z, held until now by a command."""
        _, kept = self._still(state)
        laws = disturbances.init(self.disturbances, self.team)
        _, lam = self.plant.forward_dynamics(
            self.team_at(jnp.zeros(())), state, command, self.disturbance_forces(state, jnp.zeros(()), laws)
        )
        return WorldState(
            state=state,
            applied_inputs=command,
            filtered_tip_forces=lam,
            disturbances=laws,
            actuators=self.actuators.init(command),
            sensors=kept,
        )

    def disturbance_forces(self, state: State, t: Scalar, laws: disturbances.DisturbanceState) -> ResidualForces:
        """The unknown forces in the state z at time t, s."""
        f = disturbances.disturbance_forces(self.disturbances, self.team, state, t, laws)
        return jax.tree.map(lambda x: self.disturbance_scale * x, f)

    def measure(self, state: WorldState, clock: ControlClock, noise: WorldNoise) -> tuple[Measurement, WorldState]:
        """The measurement now: the end of the last tick, under what acted in it."""
        t = clock.t
        f = self.disturbance_forces(state.state, t, state.disturbances)
        a, lam = self.plant.forward_dynamics(self.team_at(t), state.state, state.applied_inputs, f)
        b = smoothing_factor(self.sensors.tip_force_bandwidth, clock.dt)
        felt = tuple(old + b * (new - old) for old, new in zip(state.filtered_tip_forces, lam, strict=True))
        seen = sensors_module.SensedState(
            z=state.state,
            v_dot=tuple(x.v_dot for x in a.agents),
            xi_dot=tuple(x.xi_dot for x in a.agents),
            a_L=a.payload,
            lam=felt,
            f=f,
        )
        m = sensors_module.measure(self.team, self.sensors, self.tip_force_bias, seen, noise.sensors)
        kept = []
        for one, past, drawn in zip(self.sensor_models, state.sensors, noise.sensor_models, strict=True):
            m, context = one.apply(m, seen, clock, past, drawn)
            kept.append(context)
        return m, WorldState(
            state=state.state,
            applied_inputs=state.applied_inputs,
            filtered_tip_forces=felt,
            disturbances=state.disturbances,
            actuators=state.actuators,
            sensors=tuple(kept),
        )

    def step(self, state: WorldState, command: TeamInputs, clock: ControlClock) -> tuple[WorldState, GroundTruth]:
        """The state after the tick, under a command that is held; and the truth at its start."""
        t, dt = clock.t, clock.dt
        inputs, actuators = self.actuators(command, state.actuators, clock)
        f = self.disturbance_forces(state.state, t, state.disturbances)
        team = self.team_at(t)
        a, lam = self.plant.forward_dynamics(team, state.state, inputs, f)
        z = self.plant.step(
            team, state.state, inputs, lambda z, s: self.disturbance_forces(z, t + s, state.disturbances), dt
        )
        context = WorldState(
            state=z,
            applied_inputs=inputs,
            filtered_tip_forces=state.filtered_tip_forces,
            disturbances=disturbances.update(self.disturbances, self.team, state.state, t, state.disturbances, dt),
            actuators=actuators,
            sensors=state.sensors,
        )
        return context, GroundTruth(state=state.state, inputs=inputs, acceleration=a, lam=lam)
