"""Simulated world: plant, disturbances, actuators and sensors, each with its own state.

A world is any object with the methods of the protocol `World`. `SimulatedWorld` is a PyTree of numbers and components,
so that a simulation compiles. The onboard controller receives only the measurement; `GroundTruth` is logged.
"""

from __future__ import annotations

import dataclasses
from typing import Any, Protocol, runtime_checkable

import jax
import jax.numpy as jnp
from jaxtyping import Array, Float

from colift.math.filters import smoothing_factor
from colift.math.pytree import pytree, static
from colift.models.measurement import ContactFlags, Measurement
from colift.models.parameters import Team
from colift.models.state import (
    ControlClock,
    ResidualForces,
    ResidualFunctionType,
    State,
    TeamInputs,
    Wrench,
    zero_residual,
)
from colift.simulation import contact_dynamics, disturbances
from colift.simulation import sensors as sensors_module
from colift.simulation.actuators import IdealActuators
from colift.simulation.faults import Faults, RotorForces

Scalar = Float[Array, ""]


@pytree
class WorldState:
    """State of `SimulatedWorld` between ticks."""

    state: State  # state of the team
    applied_inputs: TeamInputs  # inputs during the last tick
    filtered_tip_forces: tuple[Float[Array, "agents arms 3"], ...]  # N, low-pass filtered contact forces, world
    disturbances: disturbances.DisturbanceState  # states of the disturbance models
    actuators: Any  # state of the actuators
    sensors: tuple[Any, ...]  # states of the additional sensors
    rotor_forces: RotorForces | None = None  # N, forces of the last tick; None without faults of single rotors
    regrasped: ContactFlags | None = None  # contacts that have closed again; None if none can
    filtered_tip_moments: tuple[Float[Array, "_agents _arms 3"], ...] | None = None  # N m, low-pass filtered contact
    # moments, payload frame; None if all contacts are points


@pytree
class GroundTruth:
    """True quantities at the start of a tick under the inputs of the tick; for the log."""

    state: State  # state of the team
    inputs: TeamInputs  # inputs that act during the tick
    acceleration: contact_dynamics.Acceleration  # accelerations of payload and agents
    lam: tuple[Float[Array, "agents arms 3"], ...]  # N, contact forces on the payload, world, by group
    team: Team | None = None  # true parameters where contacts are open; None if they are those of the world


@pytree
class WorldNoise:
    """Sensor noise of one tick, or of many ticks with a leading time axis."""

    sensors: sensors_module.Noise  # noise of the built-in sensors
    sensor_models: tuple[Any, ...]  # noise of the additional sensors


@runtime_checkable
class Plant(Protocol):
    """Dynamics of the coupled team under given forces."""

    def forward_dynamics(
        self, team: Team, state: State, inputs: TeamInputs, f: ResidualForces
    ) -> tuple[contact_dynamics.Acceleration, tuple[Float[Array, "_agents _arms 3"], ...]]:
        """Compute accelerations, and contact forces on the payload [N, world] by group."""
        ...

    def step(self, team: Team, state: State, inputs: TeamInputs, residual: ResidualFunctionType, dt: Scalar) -> State:
        """Integrate over dt [s] with constant inputs.

        Args:
            team: True parameters.
            state: State at the start of the step.
            inputs: Inputs, constant over the step.
            residual: Unmodelled forces as a function of the state and of the time since the step began [s].
            dt: Step length [s].

        Returns:
            The state at the end of the step.
        """
        ...


@runtime_checkable
class World(Protocol):
    """Interface between simulator and simulated world."""

    @property
    def team(self) -> Team:
        """True parameters."""
        ...

    def sample_noise(self, key: Array, ticks: int) -> Any:
        """Draw the noise of several ticks from one random key, as a PyTree with time as the leading axis."""
        ...

    def measure_at_rest(self, state: State) -> Measurement:
        """Return the measurement of the team at rest, without noise and bias; it initializes the controller."""
        ...

    def init(self, state: State, command: TeamInputs) -> Any:
        """Return the initial world state at a team state, with a constant command before the first tick."""
        ...

    def measure(self, state: Any, clock: ControlClock, noise: Any) -> tuple[Measurement, Any]:
        """Compute the measurement at the current tick.

        Args:
            state: World state.
            clock: Time and period [s].
            noise: Noise of this tick.

        Returns:
            The measurement, and the world state with the updated sensor states.
        """
        ...

    def step(self, state: Any, command: TeamInputs, clock: ControlClock) -> tuple[Any, GroundTruth]:
        """Advance the world by one tick with a constant command.

        Args:
            state: World state at the start of the tick.
            command: Commands of the controller, by group.
            clock: Time and period [s].

        Returns:
            The world state after the tick, and the ground truth at its start.
        """
        ...


@pytree
class PayloadMassStep:
    """Change of the payload mass during the run, at the center of mass."""

    mass: Scalar  # kg, added mass; negative if mass is removed
    start: Scalar  # s
    ramp_time: Scalar  # s, duration of the change

    def team_at(self, team: Team, t: Scalar) -> Team:
        """Return the true parameters at time t [s]."""
        mass = team.payload.mass + self.mass * disturbances.smoothstep((t - self.start) / self.ramp_time)
        return dataclasses.replace(team, payload=dataclasses.replace(team.payload, mass=mass))


@pytree
class SimulatedWorld:
    """World of the coupled team with disturbances, actuators and sensors; implements `World`."""

    team: Team  # true parameters
    plant: Plant  # dynamics of the team
    disturbances: disturbances.DisturbanceSet  # unmodelled forces
    disturbance_scale: Scalar  # factor on all disturbances: 1 in simulations, 0 in the linearization of the loop
    actuators: IdealActuators  # actuator model
    sensors: sensors_module.SensorNoise  # standard deviations of the built-in sensors
    tip_force_bias: tuple[Float[Array, "agents arms 3"], ...]  # N, tip frames, by group
    sensor_models: tuple[sensors_module.SensorModel, ...]  # additional sensors
    mass_step: PayloadMassStep | None = None  # change of the payload mass; None without one
    faults: Faults | None = None  # faults of rotors and contacts; None without one
    payload_on_ground: bool = static(default=False)  # True: the ground bears the payload, which is not held

    def team_at(self, t: Scalar, regrasped: ContactFlags | None = None) -> Team:
        """Return the true parameters at time t [s], for given contacts that have closed again."""
        team = self.closed_team_at(t)
        return team if self.faults is None else self.faults.team_at(team, t, regrasped)

    def closed_team_at(self, t: Scalar) -> Team:
        """Return the true parameters at time t [s] without open contacts."""
        return self.team if self.mass_step is None else self.mass_step.team_at(self.team, t)

    def sample_noise(self, key: Array, ticks: int) -> WorldNoise:
        """Draw the sensor noise of several ticks from one random key."""
        extra = tuple(sensor.sample_noise(self.team, key, ticks) for sensor in self.sensor_models)
        return WorldNoise(sensors=sensors_module.sample_noise(self.team, key, ticks), sensor_models=extra)

    def measure_at_rest(self, state: State) -> Measurement:
        """Return the measurement of the team at rest, without noise and bias."""
        return self._at_rest(state)[0]

    def sensed_at_rest(self, state: State) -> sensors_module.SensedState:
        """Return the true quantities that the sensors measure at rest, without contact forces and disturbances."""
        return sensors_module.SensedState(
            z=state,
            v_dot=tuple(jnp.zeros_like(a.v) for a in state.agents),
            xi_dot=tuple(jnp.zeros((a.r.shape[0], 3 + a.r.shape[1])) for a in state.agents),
            a_L=jnp.zeros(6),
            lam=tuple(jnp.zeros_like(group.contact_position) for group in self.team.agent_groups),
            f=zero_residual(self.team),
            moments=self.team.zero_contact_moments,
        )

    def _with_grippers(self, measurement: Measurement, regrasped: ContactFlags | None) -> Measurement:
        """Return the measurement with the reports of the grippers."""
        ungrasped = None if self.faults is None else self.faults.ungrasped(regrasped)
        return dataclasses.replace(measurement, regrasped=regrasped, ungrasped=ungrasped)

    def _at_rest(self, state: State) -> tuple[Measurement, tuple[Any, ...]]:
        """Return the measurement at rest and the initial states of the additional sensors."""
        sensed = self.sensed_at_rest(state)
        zero_noise = jax.tree.map(lambda x: jnp.zeros(x.shape[1:], x.dtype), self.sample_noise(jax.random.key(0), 1))
        measurement = sensors_module.measure(
            self.team, self.sensors, jax.tree.map(jnp.zeros_like, self.tip_force_bias), sensed, zero_noise.sensors
        )
        if self.faults is not None:
            measurement = self._with_grippers(measurement, self.faults.initial_regrasps())
        sensor_states, clock = [], ControlClock(t=jnp.zeros(()), dt=jnp.zeros(()))
        for sensor, sensor_noise in zip(self.sensor_models, zero_noise.sensor_models, strict=True):
            sensor_states.append(sensor.init(measurement))
            measurement, _ = sensor.apply(measurement, sensed, clock, sensor_states[-1], sensor_noise)
        return measurement, tuple(sensor_states)

    def init(self, state: State, command: TeamInputs) -> WorldState:
        """Return the initial world state at a team state, with a constant command before the first tick."""
        at_rest, sensor_states = self._at_rest(state)
        disturbance_state = disturbances.init(self.disturbances, self.team)
        a, lam = self.plant.forward_dynamics(
            self.team_at(jnp.zeros(())),
            state,
            command,
            self.disturbance_forces(state, jnp.zeros(()), disturbance_state),
        )
        return WorldState(
            state=state,
            applied_inputs=command,
            filtered_tip_forces=lam,
            filtered_tip_moments=a.contact_moments,
            disturbances=disturbance_state,
            actuators=self.actuators.init(command),
            sensors=sensor_states,
            rotor_forces=None if self.faults is None else self.faults.rotor_forces(command),
            regrasped=at_rest.regrasped,
        )

    def disturbance_forces(
        self, state: State, t: Scalar, disturbance_state: disturbances.DisturbanceState
    ) -> ResidualForces:
        """Compute the unmodelled forces.

        Args:
            state: State of the team.
            t: Time [s].
            disturbance_state: States of the disturbance models.

        Returns:
            The forces on agents and payload, scaled by `disturbance_scale`.
        """
        f = disturbances.disturbance_forces(self.disturbances, self.team, state, t, disturbance_state)
        f = jax.tree.map(lambda x: self.disturbance_scale * x, f)
        if self.payload_on_ground:
            weight = self.team.payload.mass * self.team.gravity
            f = dataclasses.replace(f, payload=Wrench(F=-weight, tau=jnp.zeros(3)))
        return f

    def measure(self, state: WorldState, clock: ControlClock, noise: WorldNoise) -> tuple[Measurement, WorldState]:
        """Compute the measurement at the current tick, with the inputs of the last tick still acting.

        Args:
            state: World state.
            clock: Time and period [s].
            noise: Noise of this tick.

        Returns:
            The measurement, and the world state with the updated sensor states.
        """
        t = clock.t
        f = self.disturbance_forces(state.state, t, state.disturbances)
        a, lam = self.plant.forward_dynamics(self.team_at(t, state.regrasped), state.state, state.applied_inputs, f)
        b = smoothing_factor(self.sensors.tip_force_bandwidth, clock.dt)
        filtered = tuple(old + b * (new - old) for old, new in zip(state.filtered_tip_forces, lam, strict=True))
        sensed = sensors_module.SensedState(
            z=state.state,
            v_dot=tuple(x.v_dot for x in a.agents),
            xi_dot=tuple(x.xi_dot for x in a.agents),
            a_L=a.payload,
            lam=filtered,
            f=f,
            moments=self._filtered_moments(state, a, b),
        )
        measurement = sensors_module.measure(self.team, self.sensors, self.tip_force_bias, sensed, noise.sensors)
        measurement = self._with_grippers(measurement, state.regrasped)
        sensor_states = []
        for sensor, sensor_state, sensor_noise in zip(
            self.sensor_models, state.sensors, noise.sensor_models, strict=True
        ):
            measurement, next_sensor_state = sensor.apply(measurement, sensed, clock, sensor_state, sensor_noise)
            sensor_states.append(next_sensor_state)
        return measurement, dataclasses.replace(
            state,
            filtered_tip_forces=filtered,
            filtered_tip_moments=sensed.moments,
            sensors=tuple(sensor_states),
        )

    def _filtered_moments(
        self, state: WorldState, a: contact_dynamics.Acceleration, b: Scalar
    ) -> tuple[Float[Array, "_agents _arms 3"], ...] | None:
        """Advance the low-pass filter of the tip moments with the smoothing factor b."""
        if a.contact_moments is None or state.filtered_tip_moments is None:
            return None
        return tuple(
            old + b * (new - old) for old, new in zip(state.filtered_tip_moments, a.contact_moments, strict=True)
        )

    def step(self, state: WorldState, command: TeamInputs, clock: ControlClock) -> tuple[WorldState, GroundTruth]:
        """Advance the world by one tick with a constant command.

        Args:
            state: World state at the start of the tick.
            command: Commands of the controller, by group.
            clock: Time and period [s].

        Returns:
            The world state after the tick, and the ground truth at its start.
        """
        t, dt = clock.t, clock.dt
        inputs, actuators = self.actuators(command, state.actuators, clock)
        rotor_forces = None
        if self.faults is not None:
            inputs, rotor_forces = self.faults.limit(inputs, state.rotor_forces, t)
        f = self.disturbance_forces(state.state, t, state.disturbances)
        regrasped, team = state.regrasped, self.team_at(t, state.regrasped)
        closing = team  # a contact that closes is closed in this period; the ground truth is that before it
        if self.faults is not None and regrasped is not None:
            regrasped = self.faults.regrasps(self.closed_team_at(t), state.state, regrasped, t)
            closing = self.team_at(t, regrasped)
        a, lam = self.plant.forward_dynamics(team, state.state, inputs, f)
        z = self.plant.step(
            closing, state.state, inputs, lambda z, s: self.disturbance_forces(z, t + s, state.disturbances), dt
        )
        rigid = isinstance(self.plant, contact_dynamics.RigidContactPlant)
        if rigid and state.regrasped is not None and regrasped is not None:
            closes = [(new & ~old).any() for new, old in zip(regrasped, state.regrasped, strict=True)]
            z = contact_dynamics.complete_impact(closing, z, jnp.stack(closes).any())
        next_state = WorldState(
            state=z,
            applied_inputs=inputs,
            filtered_tip_forces=state.filtered_tip_forces,
            filtered_tip_moments=state.filtered_tip_moments,
            disturbances=disturbances.update(self.disturbances, self.team, state.state, t, state.disturbances, dt),
            actuators=actuators,
            sensors=state.sensors,
            rotor_forces=rotor_forces,
            regrasped=regrasped,
        )
        opens = self.faults is not None and self.faults.release_time is not None
        return next_state, GroundTruth(
            state=state.state, inputs=inputs, acceleration=a, lam=lam, team=team if opens else None
        )
