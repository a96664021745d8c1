"""Settings of error bounds and of the termination of a flight.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

from typing import Annotated, Literal

from colift.scenario import fields
from colift.scenario.fields import unit
from colift.scenario.schema.base import Section


class LabelError(Section):
    """Largest errors of the payload's labels, including all parts of the residual that are no function of the state."""

    force_error_N: fields.Deviation
    """Largest error of a force output."""
    moment_error_Nm: fields.Deviation
    """Largest error of a moment output."""


class AgentLabelError(LabelError):
    """Largest errors of an agent's labels."""

    joint_torque_error_Nm: fields.Deviation
    """Largest error of a joint output; in N for a prismatic joint."""


class Certificate(Section):
    """Assumptions of the error bounds; the results list those that the scenario does not satisfy by construction."""

    error_bound: Literal["energy", "srinivas", "abbasi_yadkori", "chowdhury_gopalan", "fiedler"] = "energy"
    """Bound of the prediction error (docs/bounds.md)."""
    confidence: fields.Confidence = 0.95
    """Probability with which all bounds hold jointly, over all bodies, outputs and updates."""
    rkhs_norm: fields.Norm = 3.0
    """Upper bound of the RKHS norm of every residual output minus its prior mean, in signal standard deviations."""
    payload_label_error: LabelError | None = None
    """Label errors of the payload; default: those of the calibration rig, or three noise standard deviations."""
    agent_label_error: AgentLabelError | None = None
    """Label errors of the agents; default: as for the payload."""


class TerminationLimits(Section):
    """Limits of a flight, which is terminated with time and cause when one of them is exceeded."""

    max_position_error_m: fields.Distance = 3.0
    """Largest distance of the payload from its reference."""
    min_height_m: fields.Coordinate | None = None
    """Smallest height of the payload and of every agent (centers of mass); default: no limit."""
    max_attitude_error_deg: fields.AnyAngle = 90.0
    """Largest angle between the payload's attitude and its reference; 180 for no limit."""
    max_tilt_deg: fields.AnyAngle = 90.0
    """Largest angle between an agent's thrust and the vertical; 180 for no limit."""
    max_saturation_time_s: fields.Span = 2.0
    """Longest uninterrupted time of a thrust at zero or at `thrust_max_N`."""
    min_grasp_ratio: Annotated[fields.Fraction, unit("of the initial value")] = 0.01
    """Smallest singular value of an agent's `A M^-1 A^T`, which is zero in a singular configuration of the arms."""
    hover_thrust_margin: Annotated[fields.Fraction, unit("of `thrust_max_N`")] = 0.1
    """Share of every agent's thrust that remains in hover; a smaller share causes a warning before the flight."""
