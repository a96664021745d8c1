"""Settings of the agents, the payload, the nominal model and the initial state.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    Field,
    PrivateAttr,
)

from colift.scenario import fields
from colift.scenario.plain_data import MAX_ENTRIES
from colift.scenario.schema.base import ZERO, Inertia, Name, Section, _ascending, _nonzero
from colift.scenario.schema.shared import Delayed, Located, Mass, Named, Orientation, Ramp


class _MassProperties(Mass):
    """Mass and inertia of a rigid body."""

    inertia_kgm2: Inertia
    """Inertia about the center of mass, body frame: 3 principal moments, 6 entries xx yy zz xy xz yz, or 3 rows."""


class Body(_MassProperties):
    """A rigid body."""

    center_of_mass_m: fields.BodyPoint = ZERO
    """Center of mass, frame of the body."""


class _Joint(Orientation, Located, Named):
    """A joint and the body that it moves, which has the name of the joint."""

    parent: Name = "base"
    """Body that carries the joint: `base`, or the name of a preceding joint."""
    position_m: fields.BodyPoint = ZERO
    """Position of the joint frame at joint position 0, frame of the parent; `rpy_deg` is its orientation there."""
    axis: Annotated[fields.Axis, AfterValidator(_nonzero)]
    """Direction of the axis in the joint frame; it is normalized."""
    position_limits: Annotated[
        tuple[fields.JointAngle, fields.JointAngle] | None,
        AfterValidator(_ascending),
        fields.unit("rad; m for a prismatic joint"),
    ] = None
    """Smallest and largest joint position; not enforced, `check` and `study` report violations; default: none."""
    max_speed_radps: fields.JointRate | None = None
    """Largest joint velocity, in m/s for a prismatic joint; not enforced, `study` reports violations; default: none."""
    max_torque_Nm: fields.JointEffort | None = None
    """Largest joint torque, in N for a prismatic joint; not enforced, `study` reports violations; default: none."""
    body: Body
    """Body that the joint moves."""


class Revolute(_Joint):
    """A revolute joint and the body that it moves, which has the name of the joint."""

    type: Literal["revolute"]
    """Selects this joint."""
    nominal_position_rad: fields.JointAngle = 0.0
    """Joint position of the nominal posture, to which unconstrained joint motions return."""


class Prismatic(_Joint):
    """A prismatic joint and the body that it moves, which has the name of the joint."""

    type: Literal["prismatic"]
    """Selects this joint."""
    nominal_position_m: fields.BodyLength = 0.0
    """Joint position of the nominal posture, to which unconstrained joint motions return."""


Joint = Annotated[Revolute | Prismatic, Field(discriminator="type")]


class Arm(Named):
    """An arm with one contact on the payload; `agent/arm` is the name of the contact."""

    joint: Name
    """Body that carries the tip: the name of a joint, or `base`."""
    tip_position_m: fields.BodyPoint
    """Contact point, frame of that body."""
    contact: Literal["point", "soft_finger", "rigid"] = "point"
    """Type of the contact: `point` bears forces, `soft_finger` also the moment about `physics.contact.normal`.

    `rigid` bears forces and moments; it holds the orientation that the tip has on the level payload in the nominal
    posture.
    """


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
    _from_file: bool = PrivateAttr(default=False)

    @property
    def from_file(self) -> bool:
        """True if the scenario file refers to a URDF file; the settings of joints then have other paths."""
        return self._from_file

    def mark_as_from_file(self) -> None:
        """Record that the scenario file refers to a URDF file."""
        self._from_file = True


class Agent(Named):
    """A member of the team."""

    type: Name
    """A name in `agent_types`."""
    yaw_deg: fields.Degrees = 0.0
    """Constant yaw angle of the agent minus the heading of the reference at t = 0."""
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


class ActuatorLag(Delayed):
    """Delay and first-order lag of thrust and body torque; joint torques are applied without delay."""

    bandwidth_Hz: fields.Bandwidth
    """Bandwidth of the lag."""


class NominalModel(Section):
    """Parameters of the controller's model that differ from the true ones."""

    payload: Payload | None = None
    """Nominal payload."""
    agent_types: dict[Name, NominalAgentType] = Field(default_factory=dict, max_length=MAX_ENTRIES)
    """Nominal bodies by agent type."""
    actuators: ActuatorLag | None = None
    """Nominal lag of thrust and torque, which is used for labels and inverted in commands; default: no lag."""


class PayloadMassStep(Ramp, Mass):
    """A mass that is added at the payload's center of mass during the flight, or removed from it."""

    mass_kg: fields.MassChange
    """Added mass; negative for a removed mass."""
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
