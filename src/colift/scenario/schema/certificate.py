"""Settings of error bounds and of the termination of a flight.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

from typing import Literal

from colift.scenario import fields
from colift.scenario.schema.base import Section
from colift.scenario.schema.shared import AgentForceMagnitudes, ForceMagnitudes, ResidualNorm


class Certificate(ResidualNorm):
    """Assumptions of the error bounds; the results list those that the scenario does not satisfy by construction.

    Label errors include all parts of the residual that are not a function of the state.
    """

    error_bound: Literal["energy", "srinivas", "abbasi_yadkori", "chowdhury_gopalan", "fiedler"] = "energy"
    """Bound of the prediction error (docs/bounds.md)."""
    confidence: fields.Confidence = 0.95
    """Probability with which all bounds hold jointly, over all bodies, outputs and updates."""
    rkhs_norm: fields.Norm = 3.0
    """Upper bound of the RKHS norm of every residual output minus its prior mean, in signal standard deviations."""
    payload_label_error: ForceMagnitudes | None = None
    """Largest label errors of the payload; default: those of the rig, or three noise standard deviations."""
    agent_label_error: AgentForceMagnitudes | None = None
    """Largest label errors of the agents; default: as for the payload."""


class TerminationLimits(Section):
    """Limits of a flight, which is terminated with time and cause when one of them is exceeded."""

    max_position_error_m: fields.Distance = 3.0
    """Largest distance of the payload from its reference."""
    min_height_m: fields.Coordinate | None = None
    """Smallest height of the payload and of every agent (centers of mass); default: no limit."""
    max_attitude_error_deg: fields.AngleLimit = 90.0
    """Largest angle between the payload's attitude and its reference; 180 for no limit."""
    max_tilt_deg: fields.AngleLimit = 90.0
    """Largest angle between an agent's thrust and the vertical; 180 for no limit."""
    max_saturation_time_s: fields.Span = 2.0
    """Longest uninterrupted time of a thrust at zero or at `thrust_max_N`."""
