"""What a scenario may say: one frozen model a section, units in the names, a sentence for every setting.

World frame unless a description says otherwise. The words and defaults here are the reference page
(docs/scenarios.md) and the help of the error messages; there is no second list.
"""

from __future__ import annotations

from typing import Annotated, Literal

from colift.scenario import fields
from colift.scenario.fields import unit
from colift.scenario.schema.base import Section


class LabelError(Section):
    """Largest errors of labels: noise, bias and delay, and all by which the residual is no function of the state."""

    force_error_N: fields.Deviation
    """Of a force output."""
    moment_error_Nm: fields.Deviation
    """Of a moment output."""


class AgentLabelError(LabelError):
    """Largest errors of an agent's labels."""

    joint_torque_error_Nm: fields.Deviation
    """Of a joint output; for a sliding joint in N."""


class Certificate(Section):
    """What error bounds rest on; results call assumed what the scenario does not make true by construction."""

    error_bound: Literal["energy", "srinivas", "abbasi_yadkori", "chowdhury_gopalan", "fiedler"] = "energy"
    """Which bound of the prediction error (docs/bounds.md)."""
    confidence: fields.Confidence = 0.95
    """With which all bounds hold at once: all bodies, outputs and updates."""
    rkhs_norm: fields.Norm = 3.0
    """RKHS norm of every residual output less its prior mean, at most: at most this many signal deviations anywhere."""
    payload_label_error: LabelError | None = None
    """Label errors of the payload; by default the calibration rig's, or three of the prior's label noise deviations."""
    agent_label_error: AgentLabelError | None = None
    """Label errors of the agents; by default as for the payload."""


class TerminationLimits(Section):
    """What a flight may not exceed: beyond a limit it ends there, with time and cause, and is incomplete."""

    max_position_error_m: fields.Distance = 3.0
    """Largest distance of the payload from its reference."""
    min_height_m: fields.Coordinate | None = None
    """Least height of the payload and of every agent, centres of mass along the third world axis; by default none."""
    max_attitude_error_deg: fields.AnyAngle = 90.0
    """Largest angle between the payload's attitude and its reference; 180 allows every one."""
    max_tilt_deg: fields.AnyAngle = 90.0
    """Largest angle between an agent's thrust and the third world axis; 180 allows every one."""
    max_saturation_time_s: fields.Span = 2.0
    """Longest time that a thrust may be cut at zero or at `thrust_max_N` without a break."""
    min_grasp_ratio: Annotated[fields.Fraction, unit("of the start's")] = 0.01
    """Least singular value of an agent's `A M^-1 A^T`; it is zero where arms lock up or work against each other."""
    hover_thrust_margin: Annotated[fields.Fraction, unit("of `thrust_max_N`")] = 0.1
    """What hovering should leave of every agent's thrust; a warning before the flight says where it leaves less."""
