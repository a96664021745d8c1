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
from colift.scenario.plain_data import MAX_ENTRIES
from colift.scenario.schema.base import ZERO, Section
from colift.scenario.schema.shared import (
    AttitudeOscillation,
    Centered,
    Interval,
    Located,
    Named,
    Orientation,
    Ramp,
    RampTime,
    Sinusoid,
)
from colift.trajectories.knots import ATTITUDE_COLUMNS, POSITION_COLUMNS


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


TABLES = {
    "position_knots": POSITION_COLUMNS,
    "attitude_knots": ATTITUDE_COLUMNS,
    "position_fits": 2,
    "attitude_fits": 2,
}
TABLES |= {"box": 3}
"""Numbers of columns of the tables of a sampled reference."""


def _known_tables(tables: dict[str, str]) -> dict[str, str]:
    """Require all tables, with ascending times of the knots."""
    if set(tables) != set(TABLES):
        raise ValueError(f"must have the tables {', '.join(TABLES)}")
    for name, columns in TABLES.items():
        try:
            table = packing.unpack(tables[name], columns)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from None
        if "knots" in name and not (len(table) > 1 and (np.diff(table[:, 0]) > 0).all()):
            raise ValueError(f"{name}: must have ascending times in its first column")
    return tables


class Sampled(Interval, Named):
    """Smoothing spline of a table of poses, as in results; a file states [SampledFromFile](#sampledfromfile)."""

    kind: Literal["sampled"]
    """Selects this reference."""
    name: Annotated[str, Field(max_length=300)]
    """Description of the table."""
    start_s: fields.Instant
    """Time of the first pose."""
    end_s: fields.Instant
    """Time of the last pose; afterwards the reference comes to rest."""
    tables: Annotated[dict[str, str], AfterValidator(_known_tables)]
    """Numbers as text, by name: `position_knots` and `attitude_knots` as in
    `trajectories.smoothing_spline.SplineKnots`; `position_fits` and `attitude_fits`, the deviations in m or deg and the
    largest accelerations of the splines that were tried; `box`, the least and largest coordinates of the poses."""

    def table(self, name: str) -> np.ndarray:
        """Return the numbers of one of the tables."""
        return packing.unpack(self.tables[name], TABLES[name])
