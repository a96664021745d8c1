"""Settings of the plant and of the actuators.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator

from colift.scenario import fields
from colift.scenario.schema.base import Section, _even
from colift.scenario.schema.shared import ContactLimits
from colift.scenario.schema.team import ActuatorLag


class IdealActuators(Section):
    """Actuators that apply commands without delay or error."""

    kind: Literal["ideal"]
    """Selects these actuators."""


class Rotors(Section):
    """Rotors on a circle with alternating directions, each with a thrust from 0 to `thrust_max_N` over their number.

    A command that exceeds these limits is reduced in yaw first, then in thrust, then in roll and pitch. A yaw
    torque of 2 % of the rotors' largest forces is kept longer than the thrust.
    """

    num_rotors: Annotated[fields.RotorCount, AfterValidator(_even)]
    """Number of rotors, which is even."""
    radius_m: fields.LeverArm
    """Radius of the circle."""
    moment_ratio_m: fields.LeverArm
    """Torque about the third axis divided by the thrust of a rotor."""


class LaggedMotors(ActuatorLag):
    """Delay, first-order lag and limits of thrust and body torque; joint torques are applied without delay."""

    kind: Literal["motors"]
    """Selects these actuators."""
    rotors: Rotors | None = None
    """Rotors of every vehicle; default: only the thrust is limited."""


class PlantContactLimits(ContactLimits):
    """Limits of the contact forces and moments of the plant."""

    torsional_friction_m: fields.LeverArm | None = None
    """Largest moment about the normal over the normal force of soft fingers; `min_force_N` is then 0 by default."""


class _Plant(Section):
    """Settings that the plants have."""

    contact: PlantContactLimits = PlantContactLimits()
    """Limits of the contact forces and moments."""


class RigidContactPhysics(_Plant):
    """Equations of motion with rigid contacts; the flight ends at the first contact force beyond its limits."""

    kind: Literal["rigid"]
    """Selects this plant."""


class MujocoPhysics(_Plant):
    """MuJoCo (extra `mujoco`) with the model of `colift export mjcf` and the stiffest contacts its steps permit.

    The flight ends at the first contact force beyond its limits.
    """

    kind: Literal["mujoco"]
    """Selects this plant."""
    substeps: fields.Substeps = 4
    """Number of MuJoCo steps in a control period."""
