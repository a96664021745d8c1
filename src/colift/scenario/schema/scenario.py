"""What a scenario may say: one frozen model a section, units in the names, a sentence for every setting.

World frame unless a description says otherwise. The words and defaults here are the reference page
(docs/scenarios.md) and the help of the error messages; there is no second list.
"""

from __future__ import annotations

import hashlib
from typing import Annotated

from pydantic import (
    Field,
    model_validator,
)

from colift.scenario import fields
from colift.scenario.cross_checks import MAX_ENTRIES, consistency_errors
from colift.scenario.schema.base import Name, Plugin, Section
from colift.scenario.schema.certificate import Certificate, TerminationLimits
from colift.scenario.schema.control import Control, ControllerPlugins, LeaderFollowerAllocation, LeastSquaresAllocation
from colift.scenario.schema.disturbances import RandomResidual, Source
from colift.scenario.schema.learning import BaselineTuning, Learning, OnlineCorrection
from colift.scenario.schema.physics import IdealActuators, LaggedMotors, MujocoPhysics, RigidContactPhysics
from colift.scenario.schema.sensors import Sensors
from colift.scenario.schema.team import Agent, AgentType, InitialState, NominalModel, Payload, PayloadMassStep
from colift.scenario.schema.trajectories import Lissajous, Waypoints
from colift.scenario.validation import as_validation_error


class Scenario(Section):
    """A whole scenario."""

    name: Name
    """Names the scenario in results."""
    description: str = ""
    """What it is for, in a sentence."""
    duration_s: fields.Duration
    """Length of a run."""
    control_Hz: fields.ControlRate
    """Control rate; the plant is stepped once a tick."""
    seed: fields.Seed = 0
    """Seed of all noise."""
    gravity_mps2: fields.Gravities = (0.0, 0.0, -9.81)
    """Gravitational acceleration."""
    agent_types: Annotated[dict[Name, AgentType], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Kinds of aerial manipulator, by name; in a file, each in plain numbers or [from URDF](#agenttypefromurdf)."""
    agents: Annotated[tuple[Agent, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """The team."""
    payload: Payload
    """The payload in truth."""
    payload_mass_step: PayloadMassStep | None = None
    """What is put on the payload in flight, of which nobody tells the controller."""
    nominal: NominalModel = NominalModel()
    """What the controller believes where it differs."""
    initial_state: InitialState = InitialState()
    """Where the run begins."""
    reference: Annotated[Lissajous | Waypoints | Plugin, Field(discriminator="kind")]
    """Where the payload should be; `build()` of one's own gives a `colift.trajectories.base.Reference`."""
    disturbances: Annotated[tuple[Source, ...], Field(max_length=MAX_ENTRIES)] = ()
    """Unknown forces and torques."""
    random_residual: RandomResidual | None = None
    """Unknown forces and torques drawn at random, in addition."""
    sensors: Sensors = Sensors()
    """Measurement noise."""
    actuators: Annotated[IdealActuators | LaggedMotors | Plugin, Field(discriminator="kind")] = IdealActuators(
        kind="ideal"
    )
    """What vehicles make of commands; `build(world)` of one's own gives a `colift.simulation.actuators.Ideal`."""
    control: Control
    """Gains."""
    allocation: Annotated[LeastSquaresAllocation | LeaderFollowerAllocation, Field(discriminator="kind")]
    """From the payload's wrench to contact forces."""
    learning: Learning
    """Data and models."""
    online_correction: OnlineCorrection = OnlineCorrection()
    """How labels correct what is learned."""
    baselines: BaselineTuning = BaselineTuning()
    """Rivals of learning."""
    certificate: Certificate = Certificate()
    """What error bounds rest on."""
    termination: TerminationLimits = TerminationLimits()
    """What a flight may not exceed."""
    physics: Annotated[RigidContactPhysics | MujocoPhysics | Plugin, Field(discriminator="kind")] = RigidContactPhysics(
        kind="rigid"
    )
    """What moves the team in truth; `build(world)` of one's own gives a `colift.simulation.world.Plant`."""
    plugins: ControllerPlugins = ControllerPlugins()
    """Parts of one's own in the place of the paper's."""

    @model_validator(mode="after")
    def _consistent(self) -> Scenario:
        """Refuses settings that contradict each other, all at once."""
        wrong = consistency_errors(self.model_dump())
        if wrong:
            raise as_validation_error(wrong)
        return self

    @property
    def digest(self) -> str:
        """Twelve hexadecimal digits that differ when any setting does: the identity of a run."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:12]
