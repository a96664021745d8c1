"""What a scenario may say: one frozen model a section, units in the names, a sentence for every setting.

World frame unless a description says otherwise. The words and defaults here are the reference page
(docs/scenarios.md) and the help of the error messages; there is no second list.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    Field,
)

from colift.scenario import fields
from colift.scenario.cross_checks import MAX_ENTRIES
from colift.scenario.schema.base import ZERO, Section


class PathDeparture(Section):
    """The path moves off, and later turns as it had not."""

    offset_m: fields.Position
    """By how much it moves."""
    start_s: fields.Time
    """When it begins to."""
    ramp_time_s: fields.Span = 2.0
    """How long that takes, and the swing to rise."""
    rotation_amplitude_deg: fields.RotationVector = ZERO
    """Greatest rotation vector of the swing about `rpy_deg`, in its frame."""
    rotation_start_s: fields.Time = 0.0
    """When the swing begins."""
    rotation_period_s: fields.Period = 4.0
    """Of the swing."""


class Lissajous(Section):
    """`p_d = center + ramp(t) amplitude sin(2 pi t / period + phase)`, axis by axis; the attitude swings likewise."""

    kind: Literal["lissajous"]
    """Which reference."""
    center_m: fields.Position
    """Centre of the figure."""
    amplitude_m: fields.Extents
    """Amplitude along each axis."""
    period_s: fields.Periods
    """Period along each axis; one number for all three."""
    phase_deg: fields.Angles = ZERO
    """Phase along each axis."""
    ramp_time_s: fields.Span
    """Time in which the amplitude rises smoothly from zero."""
    rpy_deg: fields.Angles = ZERO
    """Roll, pitch, yaw of the desired attitude, or of the one about which it swings."""
    rotation_amplitude_deg: fields.RotationVector = ZERO
    """Amplitude of the attitude's swing, a rotation vector in the frame of that attitude; zero: it is constant."""
    rotation_period_s: fields.Periods = (10.0, 10.0, 10.0)
    """Period of the swing about each axis; one number for all three."""
    rotation_phase_deg: fields.Angles = ZERO
    """Phase of the swing about each axis."""
    departure: PathDeparture | None = None
    """Where it leaves for."""


class Pose(Section):
    """Where the payload should be at one time."""

    time_s: fields.Time
    """When."""
    position_m: fields.Position
    """Position."""
    rpy_deg: fields.Angles = ZERO
    """Roll, pitch, yaw of the attitude."""


class Waypoints(Section):
    """Through poses at given times by polynomials of least snap, from rest to rest."""

    kind: Literal["waypoints"]
    """Which reference."""
    poses: Annotated[tuple[Pose, ...], Field(min_length=2, max_length=MAX_ENTRIES)]
    """The poses, times ascending; before the first and after the last the payload should stand still."""
