"""Settings that several sections have, each declared once.

A section that inherits a setting may give it another default or range; name, unit and meaning stay.
"""

from __future__ import annotations

from typing import Annotated

from pydantic import Field

from colift.scenario import fields
from colift.scenario.plain_data import MAX_ENTRIES
from colift.scenario.schema.base import ZERO, Name, Section


class Named(Section):
    """A section to which results and other settings refer by its name."""

    name: Name
    """Name in results and in references from other settings."""


class Start(Section):
    """A section with a start time."""

    start_s: fields.Time
    """Start time."""


class Interval(Start):
    """A section with a start and an end time."""

    end_s: fields.Span
    """End time."""


class RampTime(Section):
    """A gradual change that takes a ramp time."""

    ramp_time_s: fields.Span
    """Duration of each smooth rise, decay or change."""


class Ramp(RampTime, Start):
    """A smooth change that starts at a time."""


class Delayed(Section):
    """A section with a delay."""

    delay_s: fields.Time = 0.0
    """Delay, a multiple of the control period."""


class Transmitted(Delayed):
    """Samples or messages at a rate, with a delay and losses."""

    rate_Hz: fields.Rate
    """Rate of samples or messages, at most the control rate."""
    dropout_probability: fields.Fraction = 0.0
    """Probability that a sample or message is lost."""


class ContactLimits(Section):
    """Limits of the contact forces on the payload."""

    friction: fields.FrictionCoefficient | None = None
    """Friction coefficient: tangential over normal force; default: contacts can shear and pull."""
    normal: Annotated[dict[str, fields.Axis], Field(max_length=MAX_ENTRIES)] | None = None
    """Direction in which each contact `agent/arm` presses on the payload, payload frame; only the direction is used."""
    min_force_N: fields.ForceLimit | None = None
    """Smallest normal force; default: 0 with friction, otherwise none."""
    max_force_N: fields.Thrust | None = None
    """Largest contact force, by its norm; default: none."""


class LimitedContacts(Section):
    """A section with limits of the contact forces."""

    contact: ContactLimits = ContactLimits()
    """Limits of the contact forces."""


class Mass(Section):
    """A section with a mass."""

    mass_kg: fields.Mass
    """Mass."""


class Centered(Section):
    """A section with a center in the world."""

    center_m: fields.Position
    """Center, world frame."""


class Orientation(Section):
    """An orientation in the frame that the section states."""

    rpy_deg: fields.Angles = ZERO
    """Roll, pitch, yaw: `R_z(yaw) R_y(pitch) R_x(roll)`."""


class Located(Section):
    """A position in the frame that the section states."""

    position_m: fields.Position
    """Position."""


class AttitudeOscillation(Section):
    """A sinusoidal rotation about an attitude."""

    rotation_amplitude_deg: fields.RotationVector = ZERO
    """Amplitude of the attitude oscillation, a rotation vector in the frame of the attitude `rpy_deg`; zero: none."""
    rotation_period_s: fields.Period | fields.Periods
    """Period of the attitude oscillation, or its periods by axis."""


class Sinusoid(Section):
    """A sinusoidal function of time, or one for each axis."""

    phase_deg: fields.Degrees | fields.Angles
    """Phase, or phases by axis."""
    period_s: fields.Period | fields.Periods | None
    """Period, or periods by axis."""


class ForceMagnitudes(Section):
    """One number for all force outputs of a model, and one for its moment outputs."""

    force_N: fields.Deviation
    """Value of each force output."""
    moment_Nm: fields.Deviation
    """Value of each moment output."""


class AgentForceMagnitudes(ForceMagnitudes):
    """One number for all force outputs of an agent's model, one for its moment and one for its joint outputs."""

    joint_torque_Nm: fields.Deviation
    """Value of each joint output; in N for a prismatic joint."""


class ResidualNorm(Section):
    """A norm of residual functions."""

    rkhs_norm: fields.Norm
    """RKHS norm of every residual output minus its prior mean, in signal standard deviations of the prior."""
