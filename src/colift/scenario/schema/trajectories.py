"""Settings of the reference trajectory of the payload.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    Field,
)

from colift.scenario import fields
from colift.scenario.cross_checks import MAX_ENTRIES
from colift.scenario.schema.base import ZERO, Section
from colift.scenario.schema.shared import AttitudeOscillation, Centered, Located, Orientation, Ramp, RampTime, Sinusoid


class PathDeparture(AttitudeOscillation, Ramp):
    """A change of the reference after `start_s`: an offset in position, and later an oscillation of the attitude."""

    offset_m: fields.Position
    """Offset in position."""
    ramp_time_s: fields.Span = 2.0
    """Duration of the rise of the offset, and of that of the oscillation."""
    rotation_start_s: fields.Time = 0.0
    """Start of the oscillation."""
    rotation_period_s: fields.Period = 4.0
    """Period of the oscillation."""


class Lissajous(AttitudeOscillation, Sinusoid, RampTime, Orientation, Centered):
    """A Lissajous curve `p_d = center + ramp(t) amplitude sin(2 pi t / period + phase)` with oscillating attitude.

    The ramp is the rise of all amplitudes from zero. The attitude oscillates about `rpy_deg`.
    """

    kind: Literal["lissajous"]
    """Selects this reference."""
    amplitude_m: fields.Extents
    """Amplitude by axis."""
    period_s: fields.Periods
    """Period by axis; a single number applies to all axes."""
    phase_deg: fields.Angles = ZERO
    """Phase by axis."""
    rotation_period_s: fields.Periods = (10.0, 10.0, 10.0)
    """Period of the oscillation by axis; a single number applies to all axes."""
    departure: PathDeparture | None = None
    """Change of the reference after a time."""


class Pose(Orientation, Located):
    """A desired pose of the payload at a time, world frame."""

    time_s: fields.Time
    """Time."""


class Waypoints(Section):
    """Minimum-snap polynomials through poses at given times, from rest to rest."""

    kind: Literal["waypoints"]
    """Selects this reference."""
    poses: Annotated[tuple[Pose, ...], Field(min_length=2, max_length=MAX_ENTRIES)]
    """Poses, times ascending; the reference is constant before the first and after the last."""
