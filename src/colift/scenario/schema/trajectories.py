"""Settings of the reference trajectory of the payload.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

from typing import Annotated, Literal

import numpy as np
from pydantic import (
    AfterValidator,
    Field,
)

from colift.scenario import fields, packing
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
    """Minimum-snap polynomials and rotation legs through poses at given times, from rest to rest.

    Each leg turns by the shorter way, at most 180 degrees. A table of more poses, or one that starts in motion, is a
    [sampled](#sampledfromfile) reference.
    """

    kind: Literal["waypoints"]
    """Selects this reference."""
    poses: Annotated[tuple[Pose, ...], Field(min_length=2, max_length=MAX_ENTRIES)]
    """Poses, times ascending; the reference is constant before the first and after the last."""


def _position_knots(text: str) -> str:
    _require_ascending(text, POSITION_COLUMNS)
    return text


def _attitude_knots(text: str) -> str:
    _require_ascending(text, ATTITUDE_COLUMNS)
    return text


def _require_ascending(text: str, columns: int) -> None:
    if (np.diff(packing.unpack(text, columns)[:, 0]) <= 0).any():
        raise ValueError("must have ascending times in its first column")


POSITION_COLUMNS, ATTITUDE_COLUMNS = 13, 14
Choice = tuple[fields.NonNegative, fields.NonNegative]


class Sampled(Section):
    """Smoothing spline of a table of poses, as results contain it; a file states [SampledFromFile](#sampledfromfile).

    The columns of the knots are those of `colift.trajectories.smoothing_spline.SplineKnots`.
    """

    kind: Literal["sampled"]
    """Selects this reference."""
    source: Annotated[str, Field(max_length=300)]
    """Name of the table."""
    rows: Annotated[fields.Count, Field(ge=2)]
    """Number of poses in the table."""
    start_s: fields.Instant
    """Time of the first pose."""
    end_s: fields.Instant
    """Time of the last pose; afterwards the reference comes to rest."""
    lowest_m: fields.Position
    """Least coordinates of the poses."""
    highest_m: fields.Position
    """Largest coordinates of the poses."""
    position_choices: Annotated[tuple[Choice, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Root-mean-square distance of the poses from the path in m, and largest acceleration in m/s², of the splines that
    were tried. The last one was chosen."""
    attitude_choices: Annotated[tuple[Choice, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """The same for the attitude, in deg and rad/s²."""
    position_knots: Annotated[str, AfterValidator(_position_knots)]
    """Knots of the position as text: time, position, velocity, acceleration and jerk."""
    attitude_knots: Annotated[str, AfterValidator(_attitude_knots)]
    """Knots of the attitude as text: time, quaternion, angular velocity, acceleration and its rate."""
