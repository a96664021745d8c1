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
from colift.scenario.fields import unit
from colift.scenario.schema.base import PluginReference, Section


class ControllerPlugins(Section):
    """Parts of one's own in the place of the paper's: `build(pilot)`, with ours in it, gives each."""

    payload_controller: PluginReference | None = None
    """A `colift.onboard.interfaces.Leader`."""
    allocator: PluginReference | None = None
    """A `colift.onboard.interfaces.Allocator`; [allocation](#settings) says what ours is."""
    agent_controller: PluginReference | None = None
    """A `colift.onboard.interfaces.Realizer`."""
    estimator: PluginReference | None = None
    """A `colift.onboard.interfaces.Estimator`."""
    residual_predictor: PluginReference | None = None
    """A `colift.onboard.interfaces.Predictor`."""
    features: PluginReference | None = None
    """A `colift.onboard.learning.features.Features`, by `build()`: what GPs see of a sample."""
    kernel: PluginReference | None = None
    """A `colift.gp.Kernel`, by `build()`: of the distance of two samples in length-scales, for all outputs."""


class Control(Section):
    """Feedback gains. Rotational ones multiply the inertia (docs/errata.md, row 6)."""

    K_p: Annotated[fields.Gains, unit("1/s²")]
    """Payload position gain, per axis; one number for all three."""
    K_v: Annotated[fields.Gains, unit("1/s")]
    """Payload velocity gain, per axis; one number for all three."""
    k_R: Annotated[fields.Gain, unit("1/s²")]
    """Payload attitude gain: `K_R = k_R J_L`."""
    k_omega: Annotated[fields.Gain, unit("1/s")]
    """Payload body-rate gain: `K_omega = k_omega J_L`."""
    agent_k_R: Annotated[fields.Gain, unit("1/s²")]
    """Agents' attitude gain."""
    agent_k_omega: Annotated[fields.Gain, unit("1/s")]
    """Agents' body-rate gain."""
    posture_bandwidth: Annotated[fields.GainOrNone, unit("1/s")] = 2.0
    """Rate at which joints that contacts leave free return to rest: the agents lean for it as they do for a path."""
    complementary_filter_Hz: fields.Bandwidth = 1.0
    """How fast measured poses and velocities pull the inertial prediction."""
    imu_bias_filter_Hz: fields.BandwidthOrNone = 0.0
    """How fast constant errors of gyroscopes and accelerometers are learned; 0: never."""
    joint_filter_Hz: fields.Rate = 30.0
    """Corner of the second-order filter of joint readings, of which the rates are the derivative."""
    actuator_bandwidth_ratio: Annotated[fields.BandwidthRatio, unit("times")] = 2.0
    """How many times as fast as `nominal.actuators` by themselves thrusts and torques are driven."""
    preview_step_s: fields.LookAhead | None = None
    """Step between five times around now at which the law is evaluated on the reference: agents' attitudes are then fed
    forward with their rates and their swing about the tips. By default as the paper has it, without."""


class InternalForces(Section):
    """Internal forces, which leave the payload's wrench alone, switched on for a while."""

    start_s: fields.Time
    """When they begin to rise."""
    end_s: fields.Span
    """When they are gone again."""
    ramp_time_s: fields.Span
    """How long each flank lasts."""
    squeeze_pairs: Annotated[tuple[tuple[str, str, fields.Newton], ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """`[contact a, contact b, N]`: presses a and b towards each other along their line, or apart if negative."""


class LeastSquaresAllocation(Section):
    """The general allocation: least squares over all contacts."""

    kind: Literal["least_squares"]
    """Which allocation."""
    internal: InternalForces | None = None
    """Internal-force input."""


class LeaderFollowerAllocation(Section):
    """The paper's split: leader contacts carry the wrench, followers hold internal forces only."""

    kind: Literal["leader_follower"]
    """Which allocation."""
    leader_contacts: Annotated[tuple[str, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Contacts of the leader block, as `agent/arm`; three that are not collinear, or more."""
    follower_offset_N: Annotated[tuple[fields.Force, ...], Field(max_length=MAX_ENTRIES)] | None = None
    """Constant force of each follower contact, in team order; an internal force; payload frame."""
    internal: InternalForces | None = None
    """Internal-force input, on follower contacts only."""
