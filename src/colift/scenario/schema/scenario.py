"""Top level of a scenario.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

import hashlib
from typing import Annotated

from pydantic import (
    Field,
    model_validator,
)

from colift.scenario import fields
from colift.scenario.cross_checks import consistency_errors
from colift.scenario.plain_data import MAX_ENTRIES
from colift.scenario.schema.base import Name, Plugin
from colift.scenario.schema.certificate import Certificate, TerminationLimits
from colift.scenario.schema.control import (
    ConstrainedAllocation,
    Control,
    ControllerPlugins,
    LeaderFollowerAllocation,
    LeastSquaresAllocation,
    LeastSquaresForces,
    MomentumObserver,
    TipSensors,
)
from colift.scenario.schema.disturbances import Disturbance, RandomResidual
from colift.scenario.schema.faults import Fault
from colift.scenario.schema.learning import BaselineTuning, Learning
from colift.scenario.schema.physics import IdealActuators, LaggedMotors, MujocoPhysics, RigidContactPhysics
from colift.scenario.schema.sensors import Sensors
from colift.scenario.schema.shared import Named
from colift.scenario.schema.team import Agent, AgentType, InitialState, NominalModel, Payload, PayloadMassStep
from colift.scenario.schema.trajectories import Lissajous, Sampled, Waypoints
from colift.scenario.validation import as_validation_error


class Scenario(Named):
    """All settings of a simulation: plant, controller, learning and certificate."""

    description: str = ""
    """Description in one sentence."""
    duration_s: fields.Duration
    """Duration of the simulation."""
    control_Hz: fields.ControlRate
    """Control rate, which is also the rate of the integration."""
    seed: fields.Seed = 0
    """Seed of all random numbers."""
    gravity_mps2: fields.Gravities = (0.0, 0.0, -9.81)
    """Gravitational acceleration."""
    agent_types: Annotated[dict[Name, AgentType], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Types of aerial manipulators by name; a file states each in numbers or [from URDF](#agenttypefromurdf)."""
    agents: Annotated[tuple[Agent, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Agents of the team."""
    payload: Payload
    """True parameters of the payload."""
    payload_mass_step: PayloadMassStep | None = None
    """Change of the payload's mass during the flight, unknown to the controller."""
    nominal: NominalModel = NominalModel()
    """Nominal parameters that differ from the true ones."""
    initial_state: InitialState = InitialState()
    """Initial state."""
    reference: Annotated[Lissajous | Waypoints | Sampled | Plugin, Field(discriminator="kind")]
    """Reference trajectory of the payload; a plugin builds a `colift.trajectories.base.ReferenceTrajectory`."""
    disturbances: Annotated[tuple[Disturbance, ...], Field(max_length=MAX_ENTRIES)] = ()
    """Disturbance forces and torques, unknown to the controller."""
    random_residual: RandomResidual | None = None
    """Random residual forces and torques, in addition to the disturbances."""
    faults: Annotated[tuple[Fault, ...], Field(max_length=MAX_ENTRIES)] = ()
    """Faults of rotors, sensors, contacts and links, unknown to the controller."""
    sensors: Sensors = Sensors()
    """Sensors."""
    actuators: Annotated[IdealActuators | LaggedMotors | Plugin, Field(discriminator="kind")] = IdealActuators(
        kind="ideal"
    )
    """Actuators; a plugin builds a `colift.simulation.actuators.IdealActuators` by `build(world)`."""
    control: Control
    """Gains and filters."""
    allocation: Annotated[
        LeastSquaresAllocation | LeaderFollowerAllocation | ConstrainedAllocation, Field(discriminator="kind")
    ]
    """Allocation of the payload's wrench to contact forces."""
    contact_forces: Annotated[TipSensors | MomentumObserver | LeastSquaresForces, Field(discriminator="kind")] = (
        TipSensors(kind="tip_sensors")
    )
    """Estimate of the contact forces."""
    learning: Learning
    """Data and models."""
    baselines: BaselineTuning = BaselineTuning()
    """Tuning of the baseline cases."""
    certificate: Certificate = Certificate()
    """Assumptions of the error bounds."""
    termination: TerminationLimits = TerminationLimits()
    """Limits of a flight."""
    physics: Annotated[RigidContactPhysics | MujocoPhysics | Plugin, Field(discriminator="kind")] = RigidContactPhysics(
        kind="rigid"
    )
    """Plant; a plugin builds a `colift.simulation.world.Plant` by `build(world)`."""
    plugins: ControllerPlugins = ControllerPlugins()
    """Plugins that replace parts of the controller."""

    @model_validator(mode="after")
    def _consistent(self) -> Scenario:
        """Refuse settings that contradict each other; report all contradictions."""
        errors = consistency_errors(self.model_dump())
        if errors:
            raise as_validation_error(errors)
        return self

    @property
    def digest(self) -> str:
        """Hash of all settings, twelve hexadecimal digits, which identifies a run."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:12]
