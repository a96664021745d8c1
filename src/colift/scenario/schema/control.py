"""Settings of the controller: gains, filters, allocation and plugins.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    Field,
)

from colift.scenario import fields
from colift.scenario.fields import unit
from colift.scenario.plain_data import MAX_ENTRIES
from colift.scenario.schema.base import PluginReference, Section
from colift.scenario.schema.shared import Interval, LimitedContacts, Ramp


class ControllerPlugins(Section):
    """Plugins that replace parts of the controller, made by `build(controller)` from the default controller."""

    payload_controller: PluginReference | None = None
    """A `colift.onboard.interfaces.PayloadController`."""
    allocator: PluginReference | None = None
    """A `colift.onboard.interfaces.Allocator`; the default is set in [allocation](#scenario)."""
    agent_controller: PluginReference | None = None
    """A `colift.onboard.interfaces.AgentController`."""
    estimator: PluginReference | None = None
    """A `colift.onboard.interfaces.Estimator`."""
    residual_predictor: PluginReference | None = None
    """A `colift.onboard.interfaces.ResidualPredictor`."""
    features: PluginReference | None = None
    """A `colift.onboard.learning.features.Features`, made by `build()`: the inputs of the Gaussian processes."""
    kernel: PluginReference | None = None
    """A `colift.gp.Kernel`, made by `build()`: the kernel of all outputs, a function of the scaled distance."""


class Control(Section):
    """Gains and filters; rotational gains multiply the inertia (docs/errata.md, row 6)."""

    K_p: Annotated[fields.Gains, unit("1/s²")]
    """Position gain of the payload by axis; a single number applies to all axes."""
    K_v: Annotated[fields.Gains, unit("1/s")]
    """Velocity gain of the payload by axis; a single number applies to all axes."""
    k_R: Annotated[fields.AxisGains, unit("1/s²")]
    """Attitude gain by axis of the payload: `K_R = k_R J_L`; a single number is reduced for yaw if required."""
    k_omega: Annotated[fields.AxisGains, unit("1/s")]
    """Angular velocity gain by axis: `K_omega = k_omega J_L`; a single number is reduced for yaw if required."""
    agent_k_R: Annotated[fields.Gain, unit("1/s²")]
    """Attitude gain of the agents."""
    agent_k_omega: Annotated[fields.Gain, unit("1/s")]
    """Angular velocity gain of the agents."""
    posture_bandwidth: Annotated[fields.GainOrNone, unit("1/s")] = 2.0
    """Rate at which joint motions that the contacts do not constrain return to the nominal posture; 0: none."""
    complementary_filter_Hz: fields.Bandwidth = 1.0
    """Crossover frequency of the complementary filter of poses and velocities."""
    imu_bias_filter_Hz: fields.BandwidthOrNone = 0.0
    """Corner frequency of the estimate of gyroscope and accelerometer biases; 0: no estimate."""
    joint_filter_Hz: fields.Rate = 30.0
    """Corner frequency of the second-order filter of the joint positions, whose derivative is the joint velocity."""
    position_error_bound_m: Annotated[fields.Distance | None, unit("m")] = None
    """Bound of the position error that the payload controller acts on, by its norm; default: none."""
    preview_step_s: fields.PreviewStep | None = None
    """Time step of the preview of the reference, which yields a feedforward of angular velocities; default: none."""


class TipSensors(Section):
    """Contact forces as measured by force sensors at the tips."""

    kind: Literal["tip_sensors"]
    """Selects this estimate."""


class _ResidualPrior(Section):
    """Settings of the estimates from a prior of the residual forces."""

    calibration_s: fields.Time = 0.0
    """Duration of a flight of the agents without payload that yields the prior of their residuals; 0: no flight."""


class MomentumObserver(_ResidualPrior):
    """Contact forces from momenta and inputs of each agent, and a prior of its residual; without tip force sensors."""

    kind: Literal["momentum_observer"]
    """Selects this estimate."""


class LeastSquaresForces(_ResidualPrior):
    """Contact forces from the equations of motion of agents and payload, and a prior of all residuals.

    The standard deviations of the priors are those of `learning` and `baselines`.
    """

    kind: Literal["least_squares"]
    """Selects this estimate."""


class InternalForces(Ramp, Interval):
    """Internal forces from the start of their rise to the end of their decay; they apply no wrench to the payload."""

    squeeze_pairs: Annotated[
        tuple[tuple[str, str, fields.ForceComponent], ...], Field(min_length=1, max_length=MAX_ENTRIES)
    ]
    """Entries `[contact a, contact b, N]`: force that presses a and b together along their line; negative: apart."""


class _Allocation(Section):
    """Settings that all allocations have."""

    internal: InternalForces | None = None
    """Internal forces; with a leader block, on follower contacts only."""


class LeastSquaresAllocation(_Allocation):
    """Least-squares allocation over all contacts."""

    kind: Literal["least_squares"]
    """Selects this allocation."""


class LeaderFollowerAllocation(_Allocation):
    """Allocation of the paper: leader contacts apply the wrench, follower contacts apply internal forces."""

    kind: Literal["leader_follower"]
    """Selects this allocation."""
    leader_contacts: Annotated[tuple[str, ...], Field(min_length=1, max_length=MAX_ENTRIES)]
    """Contacts of the leader block as `agent/arm`: at least three that are not collinear."""


class ConstrainedAllocation(LimitedContacts, _Allocation):
    """Allocation within limits of thrust, tilt and contact forces.

    It prefers the least-squares allocation with `internal`, which is the grip where contacts can only press. With
    `actuators.rotors` it prefers contact forces that require little yaw torque of the agents.

    Where the limits do not permit the commanded acceleration, roll and pitch of the payload are kept first, then
    yaw, then the vertical, then the horizontal acceleration. Open contacts are detected with
    tip force sensors that have noise.
    """

    kind: Literal["constrained"]
    """Selects this allocation."""
    tilt_deg: fields.TiltLimit = 35.0
    """Largest angle between the commanded thrust of an agent and the vertical."""
