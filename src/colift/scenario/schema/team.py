"""Settings of the agents, the payload, the nominal model and the initial state.

The docstrings and defaults are the source of the reference page and of the error messages.
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


class _MassProperties(Section):
    """Mass and inertia of a rigid body."""

    mass_kg: fields.Mass
    """Mass."""
    inertia_kgm2: Inertia
    """Inertia about the center of mass, body frame: 3 principal moments, 6 entries xx yy zz xy xz yz, or 3 rows."""


class Body(_MassProperties):
    """A rigid body."""

    center_of_mass_m: fields.BodyPoint = ZERO
    """Center of mass, frame of the body."""


class _Joint(Section):
    """A joint and the body that it moves."""

    name: Name
    """Name of the joint and of the body that it moves."""
    parent: Name = "base"
    """Body that carries the joint: `base`, or the name of a preceding joint."""
    position_m: fields.BodyPoint = ZERO
    """Joint origin, frame of the parent."""
    rpy_deg: fields.Angles = ZERO
    """Roll, pitch, yaw of the joint frame in the parent frame at joint position 0: R_z(yaw) R_y(pitch) R_x(roll)."""
    axis: Annotated[fields.Axis, AfterValidator(_nonzero)]
    """Direction of the axis in the joint frame; it is normalized."""
    body: Body
    """Body that the joint moves."""


class Revolute(_Joint):
    """A revolute joint."""

    type: Literal["revolute"]
    """Selects this joint."""
    nominal_position_rad: fields.JointAngle = 0.0
    """Joint position of the nominal posture, to which unconstrained joint motions return."""


class Prismatic(_Joint):
    """A prismatic joint."""

    type: Literal["prismatic"]
    """Selects this joint."""
    nominal_position_m: fields.BodyLength = 0.0
    """Joint position of the nominal posture, to which unconstrained joint motions return."""


Joint = Annotated[Revolute | Prismatic, Field(discriminator="type")]


class Arm(Section):
    """An arm with one point contact on the payload."""

    name: Name
    """Name of the arm; `agent/arm` is the name of its contact."""
    joint: Name
    """Body that carries the tip: the name of a joint, or `base`."""
    tip_position_m: fields.BodyPoint
    """Contact point, frame of that body."""


class AgentType(Section):
    """An aerial manipulator: a base with a tree of joints and arms."""

    base: Body
    """Vehicle without its arms; its frame is that of the agent, with the thrust along the third axis."""
    thrust_max_N: fields.Thrust
    """Largest thrust; larger commands are limited, which the log records."""
    joints: Annotated[tuple[Joint, ...], Field(max_length=MAX_ENTRIES)] = ()
    """Joints, parents before children."""
    arms: Annotated[tuple[Arm, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Arms, one contact each."""


class Agent(Section):
    """A member of the team."""

    name: Name
    """Name of the agent."""
    type: Name
    """A name in `agent_types`."""
    yaw_deg: fields.Degrees = 0.0
    """Constant heading of the agent minus the heading of the reference at t = 0."""
    contact_positions_m: Annotated[tuple[fields.BodyPoint, ...], Field(max_length=MAX_ENTRIES)]
    """Contact points on the payload, in the order of the arms of the type; payload frame."""


class Payload(_MassProperties):
    """The rigid payload, whose frame has its origin at the center of mass."""


class NominalAgentType(Section):
    """Nominal bodies of an agent type that differ from the true ones."""

    base: Body | None = None
    """Nominal base."""
    joints: dict[Name, Body] = Field(default_factory=dict, max_length=MAX_ENTRIES)
    """Nominal bodies by the name of their joint."""


class ActuatorLag(Section):
    """Delay and first-order lag of thrust and body torque; joint torques are applied without delay."""

    bandwidth_Hz: fields.Bandwidth
    """Bandwidth of the lag."""
    delay_s: fields.Time = 0.0
    """Delay of commands, a multiple of the control period."""


class NominalModel(Section):
    """Parameters of the controller's model that differ from the true ones."""

    payload: Payload | None = None
    """Nominal payload."""
    agent_types: dict[Name, NominalAgentType] = Field(default_factory=dict, max_length=MAX_ENTRIES)
    """Nominal bodies by agent type."""
    actuators: ActuatorLag | None = None
    """Nominal lag of thrust and torque, which is used for labels and inverted in commands; default: no lag."""


class PayloadMassStep(Section):
    """A mass that is added at the payload's center of mass during the flight, or removed from it."""

    mass_kg: fields.MassChange
    """Added mass; negative for a removed mass."""
    start_s: fields.Time
    """Start of the change."""
    ramp_time_s: fields.Span = 0.1
    """Duration of the change."""


class InitialState(Section):
    """Initial state of the payload; the agents are placed such that all tips are in contact."""

    position_error_m: fields.Position = ZERO
    """Position of the payload minus its reference at t = 0."""
    attitude_error_deg: fields.RotationVector = ZERO
    """Rotation vector from the reference attitude to that of the payload, frame of the reference."""
    velocity_mps: fields.Velocity = ZERO
    """Velocity of the payload minus that of its reference at t = 0."""
    angular_velocity_radps: fields.BodyRate = ZERO
    """Angular velocity of the payload minus that of its reference, payload frame."""
