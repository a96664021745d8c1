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
from colift.scenario.cross_checks import MOST, mistakes
from colift.scenario.schema.base import Name, Own, Section
from colift.scenario.schema.certificate import Certificate, Limits
from colift.scenario.schema.control import Balanced, Control, LeaderFollower, Parts
from colift.scenario.schema.disturbances import Drawn, Source
from colift.scenario.schema.learning import Baselines, Innovation, Learning
from colift.scenario.schema.physics import Ideal, Motors, Mujoco, Rigid
from colift.scenario.schema.sensors import Sensors
from colift.scenario.schema.team import Added, Agent, AgentType, Nominal, Payload, Start
from colift.scenario.schema.trajectories import Lissajous, Waypoints
from colift.scenario.validation import as_validation_error


class Settings(Section):
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
    agent_types: Annotated[dict[Name, AgentType], Field(min_length=1, max_length=MOST)]
    """Kinds of aerial manipulator, by name; in a file, each in plain numbers or [from URDF](#agenttypefromurdf)."""
    agents: Annotated[tuple[Agent, ...], Field(min_length=1, max_length=MOST)]
    """The team."""
    payload: Payload
    """The payload in truth."""
    added: Added | None = None
    """What is put on the payload in flight, of which nobody tells the controller."""
    nominal: Nominal = Nominal()
    """What the controller believes where it differs."""
    start: Start = Start()
    """Where the run begins."""
    reference: Annotated[Lissajous | Waypoints | Own, Field(discriminator="kind")]
    """Where the payload should be; `build()` of one's own gives a `colift.trajectories.base.Reference`."""
    disturbances: Annotated[tuple[Source, ...], Field(max_length=MOST)] = ()
    """Unknown forces and torques."""
    drawn: Drawn | None = None
    """Unknown forces and torques drawn at random, in addition."""
    sensors: Sensors = Sensors()
    """Measurement noise."""
    actuators: Annotated[Ideal | Motors | Own, Field(discriminator="kind")] = Ideal(kind="ideal")
    """What vehicles make of commands; `build(world)` of one's own gives a `colift.simulation.actuators.Ideal`."""
    control: Control
    """Gains."""
    allocation: Annotated[Balanced | LeaderFollower, Field(discriminator="kind")]
    """From the payload's wrench to contact forces."""
    learning: Learning
    """Data and models."""
    innovation: Innovation = Innovation()
    """How labels correct what is learned."""
    baselines: Baselines = Baselines()
    """Rivals of learning."""
    certificate: Certificate = Certificate()
    """What error bounds rest on."""
    limits: Limits = Limits()
    """What a flight may not exceed."""
    plant: Annotated[Rigid | Mujoco | Own, Field(discriminator="kind")] = Rigid(kind="rigid")
    """What moves the team in truth; `build(world)` of one's own gives a `colift.simulation.world.Plant`."""
    parts: Parts = Parts()
    """Parts of one's own in the place of the paper's."""

    @model_validator(mode="after")
    def _consistent(self) -> Settings:
        """Refuses settings that contradict each other, all at once."""
        wrong = mistakes(self.model_dump())
        if wrong:
            raise as_validation_error(wrong)
        return self

    @property
    def digest(self) -> str:
        """Twelve hexadecimal digits that differ when any setting does: the identity of a run."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:12]
