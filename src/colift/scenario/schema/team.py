"""What a scenario may say: one frozen model a section, units in the names, a sentence for every setting.

World frame unless a description says otherwise. The words and defaults here are the reference page
(docs/scenarios.md) and the help of the error messages; there is no second list.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    Field,
)

from colift.scenario import fields
from colift.scenario.cross_checks import MAX_ENTRIES
from colift.scenario.schema.base import ZERO, Inertia, Name, Section, _nonzero


class Body(Section):
    """A rigid body."""

    mass_kg: fields.Mass
    """Mass."""
    center_of_mass_m: fields.BodyPoint = ZERO
    """Centre of mass, in the body's frame."""
    inertia_kgm2: Inertia
    """Inertia about the centre of mass, body's frame: 3 principal moments, 6 entries xx yy zz xy xz yz, or 3 rows."""


class _Joint(Section):
    """One joint and the body that it moves."""

    name: Name
    """Names the joint and the body that it moves."""
    parent: Name = "base"
    """The body that carries the joint: `base`, or the name of a joint listed above it."""
    position_m: fields.BodyPoint = ZERO
    """Joint origin, in the parent's frame."""
    rpy_deg: fields.Angles = ZERO
    """Roll, pitch, yaw of the joint's frame in the parent's, at joint position 0: R_z(yaw) R_y(pitch) R_x(roll)."""
    axis: Annotated[fields.Axis, AfterValidator(_nonzero)]
    """Direction of the axis in the joint's frame; any length but zero, it is normalized."""
    body: Body
    """The body that the joint moves."""


class Revolute(_Joint):
    """A joint that turns."""

    type: Literal["revolute"]
    """Turns about its axis."""
    nominal_position_rad: fields.JointAngle = 0.0
    """Joint position at rest: where the start is sought, and where a redundant arm tends to."""


class Prismatic(_Joint):
    """A joint that slides."""

    type: Literal["prismatic"]
    """Slides along its axis."""
    nominal_position_m: fields.BodyLength = 0.0
    """Joint position at rest: where the start is sought, and where a redundant arm tends to."""


Joint = Annotated[Revolute | Prismatic, Field(discriminator="type")]


class Arm(Section):
    """One point contact with the payload."""

    name: Name
    """Names the arm; `agent/arm` names a contact."""
    joint: Name
    """The body that carries the tip: a joint's name, or `base`."""
    tip_position_m: fields.BodyPoint
    """Contact point, in that body's frame."""


class AgentType(Section):
    """An aerial manipulator: a base and a tree of joints and arms."""

    base: Body
    """The vehicle without its arms; its frame is the agent's, thrust along its third axis."""
    thrust_max_N: fields.Thrust
    """The largest thrust; a command beyond it is cut there, and the tick is marked."""
    joints: Annotated[tuple[Joint, ...], Field(max_length=MAX_ENTRIES)] = ()
    """Joints, parents before children."""
    arms: Annotated[tuple[Arm, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Arms, one contact each."""


class Agent(Section):
    """One member of the team."""

    name: Name
    """Names the agent."""
    type: Name
    """One of `agent_types`."""
    yaw_deg: fields.Degrees = 0.0
    """Heading that the agent starts with and keeps."""
    contact_positions_m: Annotated[tuple[fields.BodyPoint, ...], Field(max_length=MAX_ENTRIES)]
    """Where each arm holds the payload, in the order of the type's arms; payload frame."""


class Payload(Section):
    """The rigid payload; its frame sits at its centre of mass."""

    mass_kg: fields.Mass
    """Mass."""
    inertia_kgm2: Inertia
    """Inertia, payload frame: 3 principal moments, 6 entries xx yy zz xy xz yz, or 3 rows."""


class NominalAgentType(Section):
    """What the controller believes of an agent type where it differs."""

    base: Body | None = None
    """The base as believed."""
    joints: Annotated[dict[Name, Body], Field(max_length=MAX_ENTRIES)] = {}
    """Joint name to the body that it moves, as believed."""


class ActuatorLag(Section):
    """A delay and a first-order lag of thrust and body torque; joints act at once."""

    bandwidth_Hz: fields.Bandwidth
    """Of the lag."""
    delay_s: fields.Time = 0.0
    """Of commands; whole ticks."""


class NominalModel(Section):
    """What the controller believes where it differs from the truth."""

    payload: Payload | None = None
    """The payload as believed."""
    agent_types: Annotated[dict[Name, NominalAgentType], Field(max_length=MAX_ENTRIES)] = {}
    """Agent type to the bodies of it that are believed to be otherwise."""
    actuators: ActuatorLag | None = None
    """How thrusts and torques are believed to follow commands: used for labels, and inverted. By default, at once."""


class PayloadMassStep(Section):
    """Mass that is put on the payload's centre of mass in flight, or taken off it."""

    mass_kg: fields.MassChange
    """How much; negative: taken off."""
    start_s: fields.Time
    """When it begins to act."""
    ramp_time_s: fields.Span = 0.1
    """How long that takes."""


class InitialState(Section):
    """Where the run begins; the agents are placed so that all tips touch (on the manifold)."""

    position_error_m: fields.Position = ZERO
    """Payload position less the reference at t = 0."""
    attitude_error_deg: fields.RotationVector = ZERO
    """Rotation vector from the reference attitude to the payload's, in the reference's frame."""
    velocity_mps: fields.Velocity = ZERO
    """Payload velocity."""
    angular_velocity_radps: fields.BodyRate = ZERO
    """Payload body rate, payload frame."""
