"""What a scenario may say: one frozen model a section, units in the names, a sentence for every setting.

World frame unless a description says otherwise. The words and defaults here are the reference page
(docs/scenarios.md) and the help of the error messages; there is no second list.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    AfterValidator,
    model_validator,
)

from colift.scenario import fields
from colift.scenario.schema.base import Section, _even
from colift.scenario.schema.team import ActuatorLag
from colift.scenario.validation import as_validation_error


class IdealActuators(Section):
    """Commands act at once and in full."""

    kind: Literal["ideal"]
    """Which."""


class Rotors(Section):
    """Rotors evenly around a ring, which turn in turns; they push between nothing and `thrust_max_N` over their number.

    What they cannot give is taken from yaw first, then from tilt, then from thrust.
    """

    num_rotors: Annotated[fields.RotorCount, AfterValidator(_even)]
    """How many: an even number."""
    radius_m: fields.LeverArm
    """Radius of the ring."""
    moment_ratio_m: fields.LeverArm
    """Torque about the third axis over force, of each rotor."""


class LaggedMotors(ActuatorLag):
    """A delay and a first-order lag of thrust and body torque, then their limits; joints act at once."""

    kind: Literal["motors"]
    """Which."""
    rotors: Rotors | None = None
    """Of every vehicle; without them thrust and torque are limited each alone."""
    torque_max_Nm: fields.Torque | None = None
    """Largest torque about each axis of every vehicle's body; not beside `rotors`. By default there is no limit."""

    @model_validator(mode="after")
    def _one_limit(self) -> LaggedMotors:
        if self.rotors is not None and self.torque_max_Nm is not None:
            raise as_validation_error([(("torque_max_Nm",), "must be left out where there are rotors")], "worded")
        return self


class RigidContactPhysics(Section):
    """Our equations of motion, with rigid contacts."""

    kind: Literal["rigid"]
    """Which."""


class MujocoPhysics(Section):
    """MuJoCo on the model of `colift export mjcf` (the extra `mujoco`), contacts as stiff as its steps allow."""

    kind: Literal["mujoco"]
    """Which."""
    substeps: fields.Substeps = 4
    """Steps of MuJoCo in a control period."""
