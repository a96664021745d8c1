"""Settings of disturbances, which the controller does not model.

The docstrings and defaults are the source of the reference page and of the error messages.
"""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import (
    Field,
)

from colift.scenario import fields
from colift.scenario.plain_data import MAX_ENTRIES
from colift.scenario.schema.base import ZERO, Name, Plugin
from colift.scenario.schema.shared import Centered, Named, Ramp, ResidualNorm, Sinusoid


class _Disturbance(Named):
    """Settings that all disturbances have."""

    acts_on: Name
    """`payload`, `agents` (all of them), or the name of an agent; some kinds act on agents only."""


class _PointDisturbance(_Disturbance):
    """A force or torque at a point of a body."""

    body: Name = "base"
    """Body of the agent: `base` or the name of a joint; must be omitted for the payload."""
    attachment_point_m: fields.BodyPoint = ZERO
    """Point of application, in the frame of the body."""


class _ForceDisturbance(_PointDisturbance):
    """A force at a point of a body."""

    force_N: fields.Force
    """Force, world frame."""


class _TorqueDisturbance(_PointDisturbance):
    """A torque on a body."""

    torque_Nm: fields.Moment = ZERO
    """Torque, frame of the body."""


class ConstantWrench(_TorqueDisturbance, _ForceDisturbance):
    """A constant force and a constant torque."""

    kind: Literal["constant"]
    """Selects this disturbance."""
    force_N: fields.Force = ZERO
    """Force, world frame."""


class Gust(Sinusoid):
    """A sinusoidal component of a wind field."""

    amplitude_mps: fields.Velocity
    """Amplitude of the wind velocity."""
    wave_vector_radpm: fields.WaveVector
    """Wave vector; its length is 2 pi divided by the wavelength."""
    phase_deg: fields.Degrees = 0.0
    """Phase at the origin."""
    period_s: fields.Period | None = None
    """Time in which the wave travels one wavelength along its wave vector; default: the wave is stationary."""


class WindTurn(Ramp):
    """A single change of the direction of the mean wind, about the vertical."""

    change_deg: fields.Degrees
    """Angle of the change."""
    ramp_time_s: fields.Span = 0.3
    """Duration of the change."""


class Wind(_PointDisturbance):
    """Drag in a wind field that varies in space, and in time with traveling gusts or a change of direction."""

    kind: Literal["wind"]
    """Selects this disturbance."""
    linear_drag_Nspm: fields.Drag = 0.0
    """Linear drag coefficient."""
    quadratic_drag_Ns2pm2: fields.Drag = 0.0
    """Quadratic drag coefficient."""
    mean_wind_mps: fields.Velocity = ZERO
    """Mean wind velocity."""
    gusts: Annotated[tuple[Gust, ...], Field(max_length=MAX_ENTRIES)] = ()
    """Waves that are added to the mean."""
    direction_change: WindTurn | None = None
    """Change of the direction of the mean wind."""


class Tether(_PointDisturbance):
    """An elastic line to a fixed point, which pulls when it is longer than its rest length."""

    kind: Literal["tether"]
    """Selects this disturbance."""
    anchor_m: fields.Position
    """Fixed end."""
    stiffness_Npm: fields.Stiffness
    """Stiffness."""
    rest_length_m: fields.Length = 0.0
    """Rest length."""


class GaussianJet(Centered, _ForceDisturbance):
    """A local air stream: the constant force `force_N` multiplied by a Gaussian of the distance from a center."""

    kind: Literal["jet"]
    """Selects this disturbance."""
    std_m: fields.Width
    """Standard deviation of the Gaussian: distance at which the force is 0.61 times that at the center."""


class RotorBias(_TorqueDisturbance):
    """A constant error of the thrust and torque of an agent."""

    kind: Literal["rotor_bias"]
    """Selects this disturbance."""
    thrust_N: fields.ForceComponent = 0.0
    """Added thrust, along the third axis of the body."""


class JointFriction(_Disturbance):
    """Friction in all joints of an agent: `-viscous r_dot - coulomb tanh(r_dot / smoothing_speed)`."""

    kind: Literal["joint_friction"]
    """Selects this disturbance."""
    viscous_Nms: fields.Drag = 0.0
    """Viscous coefficient; in N s/m for a prismatic joint."""
    coulomb_Nm: fields.DryFriction = 0.0
    """Coulomb friction; in N for a prismatic joint."""
    smoothing_speed_radps: fields.SmoothingSpeed = 0.05
    """Joint velocity below which Coulomb friction is smoothed; in m/s for a prismatic joint."""


class PluginDisturbance(_PointDisturbance, Plugin):
    """A plugin whose `build()` returns a `colift.simulation.disturbances.DisturbanceModel`."""


PointDisturbance = ConstantWrench | Wind | Tether | GaussianJet | RotorBias | PluginDisturbance
Disturbance = Annotated[PointDisturbance | JointFriction, Field(discriminator="kind")]


class RandomResidual(ResidualNorm):
    """Random residual functions from the RKHS of the kernel, with a given norm.

    Each output of payload and agents is `sum_k w_k k(z_k, .)` with the kernel k of its prior. The centers z_k are
    states near the reference, and the normally distributed weights w_k are scaled to the norm, which bounds the values.
    """

    min_variation: fields.Fraction = 0.0
    """Smallest half range of every output along the reference, in signal standard deviations."""
