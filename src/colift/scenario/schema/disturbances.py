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
from colift.scenario.schema.base import ZERO, Name, Plugin, Section


class _Source(Section):
    """A force or torque at a named point of a named body; the truth's, unknown to the controller."""

    name: Name
    """Names the source in results."""
    acts_on: Name
    """`payload`, `agents` (each of them), or the name of one agent."""
    body: Name = "base"
    """The agent's body: `base`, or a joint's name. Not for the payload."""
    attachment_point_m: fields.BodyPoint = ZERO
    """Where it attacks, in the body's frame."""


class ConstantWrench(_Source):
    """A force fixed in the world and a torque fixed in the body."""

    kind: Literal["constant"]
    """Which law."""
    force_N: fields.Force = ZERO
    """Force, world frame."""
    torque_Nm: fields.Moment = ZERO
    """Torque, body's frame."""


class Gust(Section):
    """One wave of a wind field."""

    amplitude_mps: fields.Velocity
    """Wind speed at the crest."""
    wave_vector_radpm: fields.WaveVector
    """Wave vector: its length is 2 pi over the wavelength."""
    phase_deg: fields.Degrees = 0.0
    """Phase at the origin."""
    period_s: fields.Period | None = None
    """Time in which the wave travels one wavelength, along its vector; by default it stands."""


class WindTurn(Section):
    """The mean wind turns about the vertical, once."""

    change_deg: fields.Degrees
    """By how much."""
    start_s: fields.Time
    """When it begins to."""
    ramp_time_s: fields.Span = 0.3
    """How long it takes."""


class Wind(_Source):
    """Drag in a wind field that varies in space, and in time where gusts travel or the mean turns."""

    kind: Literal["wind"]
    """Which law."""
    linear_drag_Nspm: fields.Drag = 0.0
    """Linear drag coefficient."""
    quadratic_drag_Ns2pm2: fields.Drag = 0.0
    """Quadratic drag coefficient."""
    mean_wind_mps: fields.Velocity = ZERO
    """Mean wind."""
    gusts: Annotated[tuple[Gust, ...], Field(max_length=MAX_ENTRIES)] = ()
    """Waves added to the mean."""
    direction_change: WindTurn | None = None
    """Of the mean."""


class Tether(_Source):
    """An elastic line to a fixed point; it pulls when longer than its rest length."""

    kind: Literal["tether"]
    """Which law."""
    anchor_m: fields.Position
    """The fixed end."""
    stiffness_Npm: fields.Stiffness
    """Stiffness."""
    rest_length_m: fields.Length = 0.0
    """Length at rest."""


class GaussianJet(_Source):
    """A local stream: a force that falls off around a centre as a Gaussian."""

    kind: Literal["jet"]
    """Which law."""
    force_N: fields.Force
    """Force at the centre."""
    center_m: fields.Position
    """Centre of the stream."""
    std_m: fields.Width
    """Distance at which the force has fallen to 0.61 of that at the centre."""


class RotorBias(_Source):
    """Rotors that do not give what is asked."""

    kind: Literal["rotor_bias"]
    """Which law."""
    thrust_N: fields.Newton = 0.0
    """Thrust that is added, along the body's third axis."""
    torque_Nm: fields.Moment = ZERO
    """Torque that is added, body's frame."""


class JointFriction(Section):
    """Friction in every joint of the agent: `-viscous r_dot - coulomb tanh(r_dot / speed)`."""

    kind: Literal["joint_friction"]
    """Which law."""
    name: Name
    """Names the source in results."""
    acts_on: Name
    """`agents` (each of them), or the name of one agent."""
    viscous_Nms: fields.Drag = 0.0
    """Viscous coefficient; for a sliding joint in N s/m."""
    coulomb_Nm: fields.DryFriction = 0.0
    """Dry friction; for a sliding joint in N."""
    smoothing_speed_radps: fields.SlowSpeed = 0.05
    """Joint rate below which dry friction is smoothed; for a sliding joint in m/s."""


class PluginDisturbance(_Source, Plugin):
    """A law of one's own: `build()` gives a `colift.simulation.disturbances.Law`."""


Law = ConstantWrench | Wind | Tether | GaussianJet | RotorBias | PluginDisturbance
Source = Annotated[Law | JointFriction, Field(discriminator="kind")]


class RandomResidual(Section):
    """Residuals drawn at random from the space of functions that the learner assumes, with a norm that is known.

    Each output of payload and agents is `sum_k w_k k(z_k, .)`, k its prior's kernel, the z_k states around the
    reference, the w_k normal and scaled to the norm.
    """

    rkhs_norm: fields.Norm
    """RKHS norm of every output: its values are at most this many signal deviations of its prior."""
    num_centers: fields.Centers = 30
    """How many kernels are added."""
    center_std: fields.Ratio = 0.2
    """Deviation of the centres from the states on the reference, in length-scales."""
    min_variation: fields.Fraction = 0.0
    """By how many signal deviations, half from least to greatest, every output is to vary along the reference."""
