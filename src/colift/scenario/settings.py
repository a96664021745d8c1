"""What a scenario may say: one frozen model a section, units in the names, a sentence for every setting.

World frame unless a description says otherwise. The words and defaults here are the reference page
(docs/scenarios.md) and the help of the error messages; there is no second list.
"""

from __future__ import annotations

import hashlib
import re
from collections.abc import Mapping, Sequence
from typing import Annotated, Any, Literal, TypeVar

import numpy as np
from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    SerializeAsAny,
    WithJsonSchema,
    model_validator,
)

from colift.scenario import own
from colift.scenario import quantities as of
from colift.scenario.mistake import shown
from colift.scenario.quantities import of_unit
from colift.scenario.references import MOST, mistakes
from colift.scenario.validation import as_validation_error, told


def _inertia(given: Any) -> Any:
    """Three principal moments, six entries (xx, yy, zz, xy, xz, yz), or three rows, as three rows."""
    if not isinstance(given, Sequence) or isinstance(given, str):
        return given
    if len(given) == 6:
        xx, yy, zz, xy, xz, yz = given
        return ((xx, xy, xz), (xy, yy, yz), (xz, yz, zz))
    if len(given) == 3 and not any(isinstance(row, Sequence) for row in given):
        return tuple(tuple(value if i == k else 0.0 for k in range(3)) for i, value in enumerate(given))
    return given


def _physical(rows: Rows) -> Rows:
    """Refuses what no rigid body has: asymmetry, a principal moment that is not positive, or above the other two."""
    J = np.array(rows)
    if not np.allclose(J, J.T, rtol=1e-12, atol=0):
        raise ValueError("must be symmetric")
    a, b, c = np.linalg.eigvalsh(J)
    if a <= 0:
        raise ValueError(f"must be positive definite; its principal moments are {a:.4g}, {b:.4g}, {c:.4g}")
    if c > (a + b) * (1 + 1e-9):
        raise ValueError(
            f"breaks the triangle inequality: of its principal moments {a:.4g}, {b:.4g}, {c:.4g} "
            "the largest exceeds the sum of the others, which no rigid body has"
        )
    return rows


def _module_and_name(part: str) -> str:
    if not re.fullmatch(PART, part):
        raise ValueError(f"must be `module:Name`, got {shown(part)}")
    return part


def _even(count: int) -> int:
    if count % 2:
        raise ValueError(f"must be even: rotors turn in turns, got {count}")
    return count


def _nonzero(axis: of.Axis) -> of.Axis:
    if not any(abs(x) >= 1e-6 for x in axis):
        raise ValueError(f"must not be zero: one entry must be 1e-6 or more, got {list(axis)}")
    return axis


NAME = r"^[A-Za-z_][A-Za-z0-9_-]*$"
PART = r"[A-Za-z_][A-Za-z0-9_]*(\.[A-Za-z_][A-Za-z0-9_]*)*:[A-Za-z_][A-Za-z0-9_]*"
Name = Annotated[str, Field(strict=True, pattern=NAME, max_length=100)]
Row = tuple[of.InertiaEntry, of.InertiaEntry, of.InertiaEntry]
Rows = tuple[Row, Row, Row]
Inertia = Annotated[Rows, BeforeValidator(_inertia), AfterValidator(_physical)]
Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)


S = TypeVar("S", bound="Section")


class Section(BaseModel):
    """A part of a scenario: no unknown settings, no change after validation."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)

    def __init__(self, **given: Any) -> None:
        """Raises ScenarioError, one line a mistake."""
        with told(type(self)):
            super().__init__(**given)

    # pydantic then builds the sections inside by itself, and finds all mistakes at once
    __init__.__pydantic_base_init__ = True  # ty: ignore[missing-attribute]

    @classmethod
    def model_validate(cls: type[S], obj: Any, **how: Any) -> S:
        """As `pydantic.BaseModel`, but raises ScenarioError, one line a mistake."""
        with told(cls):
            return super().model_validate(obj, **how)

    @classmethod
    def model_validate_json(cls: type[S], json_data: str | bytes | bytearray, **how: Any) -> S:
        """As `pydantic.BaseModel`, but raises ScenarioError, one line a mistake."""
        with told(cls):
            return super().model_validate_json(json_data, **how)

    def model_copy(self: S, *, update: Mapping[str, Any] | None = None, deep: bool = False) -> S:
        """As `pydantic.BaseModel`, but what is updated is checked; raises ScenarioError, one line a mistake."""
        return type(self).model_validate({**dict(self), **update}) if update else super().model_copy(deep=deep)


class Part(Section):
    """A part of one's own. Reading the scenario imports the module, which runs it (docs/change_a_part.md)."""

    part: Annotated[str, Field(strict=True, max_length=200), AfterValidator(_module_and_name)]
    """`module:Name`: a class that extends `colift.scenario.Section` and has a `build`, in a module beside the file."""
    settings: Annotated[SerializeAsAny[Section], WithJsonSchema({"type": "object"}), Field(default_factory=Section)]
    """Settings of the part; its class says which there are."""

    @model_validator(mode="before")
    @classmethod
    def _with_settings(cls, given: Any) -> Any:
        """The settings as the part's class has them."""
        named = given.get("part") if isinstance(given, Mapping) else None
        if not isinstance(named, str) or not re.fullmatch(PART, named):
            return given  # which is told by the fields
        return {**given, "settings": own.settings(named, given.get("settings", {}), Section)}


class Own(Part):
    """A part of one's own, as a variant beside ours. Reading the scenario imports its module, which runs it."""

    kind: Literal["own"]
    """Which variant."""


class Body(Section):
    """A rigid body."""

    mass_kg: of.Mass
    """Mass."""
    com_m: of.BodyPoint = ZERO
    """Centre of mass, in the body's frame."""
    inertia_kgm2: Inertia
    """Inertia about the centre of mass, body's frame: 3 principal moments, 6 entries xx yy zz xy xz yz, or 3 rows."""


class _Joint(Section):
    """One joint and the body that it moves."""

    name: Name
    """Names the joint and the body that it moves."""
    parent: Name = "base"
    """The body that carries the joint: `base`, or the name of a joint listed above it."""
    position_m: of.BodyPoint = ZERO
    """Joint origin, in the parent's frame."""
    rpy_deg: of.Angles = ZERO
    """Roll, pitch, yaw of the joint's frame in the parent's, at joint position 0: R_z(yaw) R_y(pitch) R_x(roll)."""
    axis: Annotated[of.Axis, AfterValidator(_nonzero)]
    """Direction of the axis in the joint's frame; any length but zero, it is normalized."""
    body: Body
    """The body that the joint moves."""


class Revolute(_Joint):
    """A joint that turns."""

    type: Literal["revolute"]
    """Turns about its axis."""
    rest_rad: of.JointAngle = 0.0
    """Joint position at rest: where the start is sought, and where a redundant arm tends to."""


class Prismatic(_Joint):
    """A joint that slides."""

    type: Literal["prismatic"]
    """Slides along its axis."""
    rest_m: of.BodyLength = 0.0
    """Joint position at rest: where the start is sought, and where a redundant arm tends to."""


Joint = Annotated[Revolute | Prismatic, Field(discriminator="type")]


class Arm(Section):
    """One point contact with the payload."""

    name: Name
    """Names the arm; `agent/arm` names a contact."""
    joint: Name
    """The body that carries the tip: a joint's name, or `base`."""
    tip_m: of.BodyPoint
    """Contact point, in that body's frame."""


class AgentType(Section):
    """An aerial manipulator: a base and a tree of joints and arms."""

    base: Body
    """The vehicle without its arms; its frame is the agent's, thrust along its third axis."""
    thrust_max_N: of.Thrust
    """The largest thrust; a command beyond it is cut there, and the tick is marked."""
    joints: Annotated[tuple[Joint, ...], Field(max_length=MOST)] = ()
    """Joints, parents before children."""
    arms: Annotated[tuple[Arm, ...], Field(min_length=1, max_length=MOST)]
    """Arms, one contact each."""


class Agent(Section):
    """One member of the team."""

    name: Name
    """Names the agent."""
    type: Name
    """One of `agent_types`."""
    yaw_deg: of.Degrees = 0.0
    """Heading that the agent starts with and keeps."""
    contacts_m: Annotated[tuple[of.BodyPoint, ...], Field(max_length=MOST)]
    """Where each arm holds the payload, in the order of the type's arms; payload frame."""


class Payload(Section):
    """The rigid payload; its frame sits at its centre of mass."""

    mass_kg: of.Mass
    """Mass."""
    inertia_kgm2: Inertia
    """Inertia, payload frame: 3 principal moments, 6 entries xx yy zz xy xz yz, or 3 rows."""


class NominalAgentType(Section):
    """What the controller believes of an agent type where it differs."""

    base: Body | None = None
    """The base as believed."""
    joints: Annotated[dict[Name, Body], Field(max_length=MOST)] = {}
    """Joint name to the body that it moves, as believed."""


class Lag(Section):
    """A delay and a first-order lag of thrust and body torque; joints act at once."""

    bandwidth_Hz: of.Bandwidth
    """Of the lag."""
    delay_s: of.Time = 0.0
    """Of commands; whole ticks."""


class Nominal(Section):
    """What the controller believes where it differs from the truth."""

    payload: Payload | None = None
    """The payload as believed."""
    agent_types: Annotated[dict[Name, NominalAgentType], Field(max_length=MOST)] = {}
    """Agent type to the bodies of it that are believed to be otherwise."""
    actuators: Lag | None = None
    """How thrusts and torques are believed to follow commands: used for labels, and inverted. By default, at once."""


class Added(Section):
    """Mass that is put on the payload's centre of mass in flight, or taken off it."""

    mass_kg: of.MassChange
    """How much; negative: taken off."""
    start_s: of.Time
    """When it begins to act."""
    over_s: of.Span = 0.1
    """How long that takes."""


class Start(Section):
    """Where the run begins; the agents are placed so that all tips touch (on the manifold)."""

    position_error_m: of.Position = ZERO
    """Payload position less the reference at t = 0."""
    attitude_error_deg: of.RotationVector = ZERO
    """Rotation vector from the reference attitude to the payload's, in the reference's frame."""
    velocity_mps: of.Velocity = ZERO
    """Payload velocity."""
    body_rate_radps: of.BodyRate = ZERO
    """Payload body rate, payload frame."""


class Leaving(Section):
    """The path moves off, and later turns as it had not."""

    shift_m: of.Position
    """By how much it moves."""
    start_s: of.Time
    """When it begins to."""
    over_s: of.Span = 2.0
    """How long that takes, and the swing to rise."""
    swing_deg: of.RotationVector = ZERO
    """Greatest rotation vector of the swing about `rpy_deg`, in its frame."""
    swing_start_s: of.Time = 0.0
    """When the swing begins."""
    swing_period_s: of.Period = 4.0
    """Of the swing."""


class Lissajous(Section):
    """`p_d = center + ramp(t) amplitude sin(2 pi t / period + phase)`, axis by axis; the attitude swings likewise."""

    kind: Literal["lissajous"]
    """Which reference."""
    center_m: of.Position
    """Centre of the figure."""
    amplitude_m: of.Extents
    """Amplitude along each axis."""
    period_s: of.Periods
    """Period along each axis; one number for all three."""
    phase_deg: of.Angles = ZERO
    """Phase along each axis."""
    ramp_s: of.Span
    """Time in which the amplitude rises smoothly from zero."""
    rpy_deg: of.Angles = ZERO
    """Roll, pitch, yaw of the desired attitude, or of the one about which it swings."""
    swing_deg: of.RotationVector = ZERO
    """Amplitude of the attitude's swing, a rotation vector in the frame of that attitude; zero: it is constant."""
    swing_period_s: of.Periods = (10.0, 10.0, 10.0)
    """Period of the swing about each axis; one number for all three."""
    swing_phase_deg: of.Angles = ZERO
    """Phase of the swing about each axis."""
    leaves: Leaving | None = None
    """Where it leaves for."""


class Pose(Section):
    """Where the payload should be at one time."""

    t_s: of.Time
    """When."""
    p_m: of.Position
    """Position."""
    rpy_deg: of.Angles = ZERO
    """Roll, pitch, yaw of the attitude."""


class Waypoints(Section):
    """Through poses at given times by polynomials of least snap, from rest to rest."""

    kind: Literal["waypoints"]
    """Which reference."""
    poses: Annotated[tuple[Pose, ...], Field(min_length=2, max_length=MOST)]
    """The poses, times ascending; before the first and after the last the payload should stand still."""


class _Source(Section):
    """A force or torque at a named point of a named body; the truth's, unknown to the controller."""

    name: Name
    """Names the source in results."""
    acts_on: Name
    """`payload`, `agents` (each of them), or the name of one agent."""
    body: Name = "base"
    """The agent's body: `base`, or a joint's name. Not for the payload."""
    point_m: of.BodyPoint = ZERO
    """Where it attacks, in the body's frame."""


class Constant(_Source):
    """A force fixed in the world and a torque fixed in the body."""

    kind: Literal["constant"]
    """Which law."""
    force_N: of.Force = ZERO
    """Force, world frame."""
    torque_Nm: of.Moment = ZERO
    """Torque, body's frame."""


class Gust(Section):
    """One wave of a wind field."""

    amplitude_mps: of.Velocity
    """Wind speed at the crest."""
    wave_radpm: of.WaveVector
    """Wave vector: its length is 2 pi over the wavelength."""
    phase_deg: of.Degrees = 0.0
    """Phase at the origin."""
    period_s: of.Period | None = None
    """Time in which the wave travels one wavelength, along its vector; by default it stands."""


class Turn(Section):
    """The mean wind turns about the vertical, once."""

    angle_deg: of.Degrees
    """By how much."""
    start_s: of.Time
    """When it begins to."""
    over_s: of.Span = 0.3
    """How long it takes."""


class Wind(_Source):
    """Drag in a wind field that varies in space, and in time where gusts travel or the mean turns."""

    kind: Literal["wind"]
    """Which law."""
    linear_Nspm: of.Drag = 0.0
    """Linear drag coefficient."""
    quadratic_Ns2pm2: of.Drag = 0.0
    """Quadratic drag coefficient."""
    mean_mps: of.Velocity = ZERO
    """Mean wind."""
    gusts: Annotated[tuple[Gust, ...], Field(max_length=MOST)] = ()
    """Waves added to the mean."""
    turn: Turn | None = None
    """Of the mean."""


class Tether(_Source):
    """An elastic line to a fixed point; it pulls when longer than its rest length."""

    kind: Literal["tether"]
    """Which law."""
    anchor_m: of.Position
    """The fixed end."""
    stiffness_Npm: of.Stiffness
    """Stiffness."""
    length_m: of.Extent = 0.0
    """Length at rest."""


class Jet(_Source):
    """A local stream: a force that falls off around a centre as a Gaussian."""

    kind: Literal["jet"]
    """Which law."""
    force_N: of.Force
    """Force at the centre."""
    center_m: of.Position
    """Centre of the stream."""
    width_m: of.Width
    """Distance at which the force has fallen to 0.61 of that at the centre."""


class RotorBias(_Source):
    """Rotors that do not give what is asked."""

    kind: Literal["rotor_bias"]
    """Which law."""
    thrust_N: of.Newton = 0.0
    """Thrust that is added, along the body's third axis."""
    torque_Nm: of.Moment = ZERO
    """Torque that is added, body's frame."""


class JointFriction(Section):
    """Friction in every joint of the agent: `-viscous r_dot - coulomb tanh(r_dot / speed)`."""

    kind: Literal["joint_friction"]
    """Which law."""
    name: Name
    """Names the source in results."""
    acts_on: Name
    """`agents` (each of them), or the name of one agent."""
    viscous_Nms: of.Drag = 0.0
    """Viscous coefficient; for a sliding joint in N s/m."""
    coulomb_Nm: of.DryFriction = 0.0
    """Dry friction; for a sliding joint in N."""
    speed_radps: of.SlowSpeed = 0.05
    """Joint rate below which dry friction is smoothed; for a sliding joint in m/s."""


class OwnLaw(_Source, Own):
    """A law of one's own: `build()` gives a `colift.disturbance.Law`."""


Law = Constant | Wind | Tether | Jet | RotorBias | OwnLaw
Source = Annotated[Law | JointFriction, Field(discriminator="kind")]


class Drawn(Section):
    """Residuals drawn at random from the space of functions that the learner assumes, with a norm that is known.

    Each output of payload and agents is `sum_k w_k k(z_k, .)`, k its prior's kernel, the z_k states around the
    reference, the w_k normal and scaled to the norm.
    """

    norm: of.Norm
    """RKHS norm of every output: its values are at most this many signal deviations of its prior."""
    centers: of.Centers = 30
    """How many kernels are added."""
    spread: of.Ratio = 0.2
    """Deviation of the centres from the states on the reference, in length-scales."""
    least: of.Share = 0.0
    """By how many signal deviations, half from least to greatest, every output is to vary along the reference."""


Reading = Literal[
    "payload.p",
    "payload.R",
    "payload.v",
    "payload.omega",
    "payload.a",
    "agents.x",
    "agents.R",
    "agents.v",
    "agents.omega",
    "agents.a",
    "agents.r",
    "agents.lam",
]
Readings = Annotated[tuple[Reading, ...], Field(min_length=1, max_length=12)]


class Intermittent(Section):
    """Readings at a rate of their own, late, and lost now and then; in between the last one that came is held."""

    kind: Literal["intermittent"]
    """Which."""
    of: Readings
    """Which readings: of the payload or of all agents, position p or x, attitude R, and so on."""
    rate_Hz: of.Rate
    """How often they are taken, at most once a tick."""
    delay_s: of.Time = 0.0
    """How late they come; whole ticks."""
    loss: of.Share = 0.0
    """Probability that one is lost."""
    until_s: of.Time | None = None
    """When the sensor dies; by default never."""


class Drifting(Section):
    """A bias that walks at random and is added to every component."""

    kind: Literal["drifting"]
    """Which."""
    of: Readings
    """Which readings, as for [Intermittent](#intermittent); an attitude is turned about its body's axes."""
    rate: Annotated[of.Noise, of_unit("of the reading, or rad, per √s")]
    """Standard deviation of the walk after one second."""
    start: Annotated[of.Noise, of_unit("of the reading, or rad")] = 0.0
    """Standard deviation of the bias that it begins with."""


class Sensors(Section):
    """Standard deviations of white noise on every tick's reading, and the tips' bias and bandwidth."""

    position_m: of.Noise = 0.002
    """Position."""
    attitude_deg: of.AngularNoise = 0.2
    """Attitude, per axis of the rotation vector."""
    velocity_mps: of.Noise = 0.01
    """Velocity."""
    body_rate_radps: of.Noise = 0.01
    """Body rate."""
    accelerometer_mps2: of.Noise = 0.05
    """Specific force."""
    joint_deg: of.AngularNoise = 0.1
    """Joint encoder; a sliding joint has the same number of radians as metres (0.1 deg: 1.7 mm)."""
    tip_force_N: of.Noise = 0.1
    """Force at a tip, per axis."""
    tip_force_bias_N: of.Noise = 0.05
    """Deviation from which the constant bias of each tip axis is drawn."""
    tip_force_bandwidth_Hz: of.Bandwidth = 50.0
    """First-order bandwidth of the tip force sensors."""
    then: Annotated[
        tuple[Annotated[Intermittent | Drifting | Own, Field(discriminator="kind")], ...], Field(max_length=MOST)
    ] = ()
    """What readings go through after that, in this order; `build()` of one's own gives a `colift.sensor.Extra`."""


class Ideal(Section):
    """Commands act at once and in full."""

    kind: Literal["ideal"]
    """Which."""


class Rotors(Section):
    """Rotors evenly around a ring, which turn in turns; they push between nothing and `thrust_max_N` over their number.

    What they cannot give is taken from yaw first, then from tilt, then from thrust.
    """

    count: Annotated[of.RotorCount, AfterValidator(_even)]
    """How many: an even number."""
    arm_m: of.Lever
    """Radius of the ring."""
    yaw_m: of.Lever
    """Torque about the third axis over force, of each rotor."""


class Motors(Lag):
    """A delay and a first-order lag of thrust and body torque, then their limits; joints act at once."""

    kind: Literal["motors"]
    """Which."""
    rotors: Rotors | None = None
    """Of every vehicle; without them thrust and torque are limited each alone."""
    torque_max_Nm: of.Torque | None = None
    """Largest torque about each axis of every vehicle's body; not beside `rotors`. By default there is no limit."""

    @model_validator(mode="after")
    def _one_limit(self) -> Motors:
        if self.rotors is not None and self.torque_max_Nm is not None:
            raise as_validation_error([(("torque_max_Nm",), "must be left out where there are rotors")], "worded")
        return self


class Rigid(Section):
    """Our equations of motion, with rigid contacts."""

    kind: Literal["rigid"]
    """Which."""


class Mujoco(Section):
    """MuJoCo on the model of `colift export mjcf` (the extra `mujoco`), contacts as stiff as its steps allow."""

    kind: Literal["mujoco"]
    """Which."""
    substeps: of.Substeps = 4
    """Steps of MuJoCo in a control period."""


class Parts(Section):
    """Parts of one's own in the place of the paper's: `build(pilot)`, with ours in it, gives each."""

    leader: Part | None = None
    """A `colift.fly.Leader`."""
    allocator: Part | None = None
    """A `colift.fly.Allocator`; [allocation](#settings) says what ours is."""
    realizer: Part | None = None
    """A `colift.fly.Realizer`."""
    estimator: Part | None = None
    """A `colift.fly.Estimator`."""
    predictor: Part | None = None
    """A `colift.fly.Predictor`."""
    features: Part | None = None
    """A `colift.learn.Features`, by `build()`: what GPs see of a sample."""
    kernel: Part | None = None
    """A `colift.gp.Kernel`, by `build()`: of the distance of two samples in length-scales, for all outputs."""


class Control(Section):
    """Feedback gains. Rotational ones multiply the inertia (docs/errata.md, row 6)."""

    K_p: Annotated[of.Gains, of_unit("1/s²")]
    """Payload position gain, per axis; one number for all three."""
    K_v: Annotated[of.Gains, of_unit("1/s")]
    """Payload velocity gain, per axis; one number for all three."""
    k_R: Annotated[of.Gain, of_unit("1/s²")]
    """Payload attitude gain: `K_R = k_R J_L`."""
    k_omega: Annotated[of.Gain, of_unit("1/s")]
    """Payload body-rate gain: `K_omega = k_omega J_L`."""
    agent_k_R: Annotated[of.Gain, of_unit("1/s²")]
    """Agents' attitude gain."""
    agent_k_omega: Annotated[of.Gain, of_unit("1/s")]
    """Agents' body-rate gain."""
    posture: Annotated[of.GainOrNone, of_unit("1/s")] = 2.0
    """Rate at which joints that contacts leave free return to rest: the agents lean for it as they do for a path."""
    fusion_Hz: of.Bandwidth = 1.0
    """How fast measured poses and velocities pull the inertial prediction."""
    bias_Hz: of.BandwidthOrNone = 0.0
    """How fast constant errors of gyroscopes and accelerometers are learned; 0: never."""
    joint_filter_Hz: of.Rate = 30.0
    """Corner of the second-order filter of joint readings, of which the rates are the derivative."""
    haste: Annotated[of.Haste, of_unit("times")] = 2.0
    """How many times as fast as `nominal.actuators` by themselves thrusts and torques are driven."""
    look_ahead_s: of.LookAhead | None = None
    """Step between five times around now at which the law is evaluated on the reference: agents' attitudes are then fed
    forward with their rates and their swing about the tips. By default as the paper has it, without."""


class Internal(Section):
    """Internal forces, which leave the payload's wrench alone, switched on for a while."""

    start_s: of.Time
    """When they begin to rise."""
    end_s: of.Span
    """When they are gone again."""
    ramp_s: of.Span
    """How long each flank lasts."""
    pairs: Annotated[tuple[tuple[str, str, of.Newton], ...], Field(min_length=1, max_length=MOST)]
    """`[contact a, contact b, N]`: presses a and b towards each other along their line, or apart if negative."""


class Balanced(Section):
    """The general allocation: least squares over all contacts."""

    kind: Literal["balanced"]
    """Which allocation."""
    internal: Internal | None = None
    """Internal-force input."""


class LeaderFollower(Section):
    """The paper's split: leader contacts carry the wrench, followers hold internal forces only."""

    kind: Literal["leader_follower"]
    """Which allocation."""
    leader_contacts: Annotated[tuple[str, ...], Field(min_length=1, max_length=MOST)]
    """Contacts of the leader block, as `agent/arm`; three that are not collinear, or more."""
    lam_f0_N: Annotated[tuple[of.Force, ...], Field(max_length=MOST)] | None = None
    """Constant force of each follower contact, in team order; an internal force; payload frame."""
    internal: Internal | None = None
    """Internal-force input, on follower contacts only."""


class Prior(Section):
    """Deviations that a model states before it has data."""

    force_N: of.Deviation
    """Signal deviation of a force output."""
    moment_Nm: of.Deviation
    """Signal deviation of a moment output."""
    force_noise_N: of.Deviation
    """Label noise deviation of a force output."""
    moment_noise_Nm: of.Deviation
    """Label noise deviation of a moment output."""
    lengthscale: Annotated[of.Lengthscale, of_unit("of each feature")] = 1.0
    """Length-scale of every feature but rates of rotation and of joints."""
    rate_lengthscale: Annotated[of.Lengthscale, of_unit("of each feature")] = 1.0
    """Length-scale of rates of rotation and of joints."""


class AgentPrior(Prior):
    """Deviations that an agent's model states before it has data."""

    joint_Nm: of.Deviation
    """Signal deviation of a joint output; for a sliding joint in N."""
    joint_noise_Nm: of.Deviation
    """Label noise deviation of a joint output; for a sliding joint in N."""


class Learning(Section):
    """When data are recorded, when models are fitted and frozen, and how."""

    update_times_s: Annotated[tuple[of.Span, ...], Field(min_length=1, max_length=MOST)]
    """The t_k at which all models are fitted to the data so far and frozen, ascending."""
    start_s: of.Time
    """When recording begins; the filters have settled by then."""
    end_s: of.Span
    """T_end: no data are recorded after it."""
    sample_Hz: of.Rate
    """Rate at which samples are recorded; no denser than the filter's memory."""
    filter_Hz: of.Rate
    """Corner of the second-order filter that every term of a label goes through."""
    capacity: of.Capacity
    """Most samples a data set holds."""
    payload: Prior
    """The payload model's prior."""
    agents: AgentPrior
    """The agent models' prior."""
    lengthscale_bounds: tuple[of.Lengthscale, of.Lengthscale] = (0.1, 30.0)
    """Least and largest length-scale of any feature, in its own unit: m, m/s, rad, rad/s, none for an entry of R."""
    prior_factor: of.Factor = 3.0
    """Before data, two of three length-scales and deviations lie within this factor of the prior's (log-normal)."""
    hyperparameters: Literal["fitted", "stated"] = "fitted"
    """`fitted` to the data at each update, or `stated`: those of the prior, without a mean, as error bounds ask for."""
    fit_latency: of.Time | Literal["measured"] = 0.0
    """How long a fit takes until what it learned flies, s; `measured`: as long as it takes on this machine, which makes
    a run unlike the next."""
    samples: Literal["estimated", "rig"] = "estimated"
    """`estimated` on board from the sensors, or of a calibration `rig`: true states, labels with bounded errors."""
    rig_error: of.Ratio = 0.1
    """Error of every label of the rig, one way or the other, as a share of the drawn residual's deviation."""
    restarts: of.Restarts = 1
    """Further starts of the fit, beside the warm one."""
    max_iterations: of.Iterations = 300
    """Most iterations of one start."""


class Baselines(Section):
    """Tuning of the rivals of learning."""

    K_i: Annotated[of.GainOrNone, of_unit("1/s³")] = 2.0
    """Integral action on the position error, baseline I."""
    k_i: Annotated[of.GainOrNone, of_unit("1/s³")] = 40.0
    """Integral action on the attitude error, baseline I."""
    observer_Hz: of.Rate = 0.5
    """Bandwidth of the wrench observer's force, baseline DOB."""
    observer_moment_Hz: of.Rate | None = None
    """Of its moment; as of its force if absent."""
    mass_kg: of.Deviation = 0.5
    """Prior deviation of the payload's mass error, baseline P."""
    first_moment_kgm: of.Deviation = 0.05
    """Prior deviation of the payload's first moments, baseline P."""
    inertia_kgm2: of.Deviation = 0.05
    """Prior deviation of the payload's inertia error, baseline P."""
    ridge: Annotated[of.Deviation, of_unit("label noise over weight, squared")] = 0.3
    """What a squared weight of the basis costs beside a squared label error, for forces, baseline R."""
    ridge_moment: Annotated[of.Deviation | None, of_unit("label noise over weight, squared")] = None
    """For moments and joints; as for forces if absent."""


class Innovation(Section):
    """How labels correct what is learned, in the cases F, H and C4."""

    lead_s: of.Time = 0.02
    """By how much the correction of F and H is carried ahead along its rate, for the delay of labels."""
    coherence: of.Coherence = 0.2
    """C4 carries its correction ahead by the whole delay of labels where so much, in the square, of what their rates
    foretold came true; where less did, as much less far. Of what noise foretells nothing comes true on average."""
    doubt: of.Factor = 10.0
    """C4's map is used as far as labels move with it once it has moved by more than the variance of labels over so
    many: in the square, from one label filter's memory to the next. A rate that foretells less counts for nothing."""
    patience_s: of.Span = 0.02
    """How old a reading of the tips may be for a label."""
    hold_s: of.Time = 0.2
    """How long labels may be silent until they count as stopped for C4, if they have not been silent half as long
    lately; its correction is held meanwhile."""
    fade_s: of.Span = 0.3
    """Once labels have stopped, how soon C4's correction is its mean over the last `span_s`."""
    span_s: of.Span = 0.5
    """Of that mean."""
    renew_s: of.Span = 1.0
    """How often C4's models take in new samples, hyperparameters kept."""
    refit_s: of.Span = 10.0
    """How often, after the last of `learning.update_times_s`, C4 fits hyperparameters and means anew."""
    age_s: of.Span = 20.0
    """Of more samples than `learning.capacity` C4 keeps those that tell most; those that are so old as if they were
    twice as noisy."""
    surprise: of.Factor = 3.0
    """Mean square of new labels off what was predicted, in predictive variances, over its usual value (or 1, if that is
    less), above which the world has changed for a body: C4 amends its older samples by what the new ones say."""
    settle_s: of.Time = 0.5
    """How long after the first sample that surprises the world may be changing: samples of then speak of no world."""
    enough: of.Capacity = 150
    """New samples after a change for a new model: until then the old one, shifted, is corrected by labels, and what
    surprises is the same change. A model of less than a third as many cannot be surprised."""
    drag_Nspm: of.Deviation = 0.5
    """Prior deviation of each body's drag, in the mean of C4's maps; mass and first moments as in `baselines`."""
    drag_lever_m: of.Deviation = 0.4
    """Prior deviation of the lever of the payload's drag."""
    thrust_N: of.Deviation = 2.0
    """Prior deviation of what an agent's rotors have more or less of thrust."""
    constant: of.Factor = 3.0
    """Prior deviation of a constant force or moment, over its signal's."""
    look_ahead_s: of.LookAhead = 0.03
    """`control.look_ahead_s` of these cases and of O, where it says nothing."""


class LabelError(Section):
    """Largest errors of labels: noise, bias and delay, and all by which the residual is no function of the state."""

    force_N: of.Deviation
    """Of a force output."""
    moment_Nm: of.Deviation
    """Of a moment output."""


class AgentLabelError(LabelError):
    """Largest errors of an agent's labels."""

    joint_Nm: of.Deviation
    """Of a joint output; for a sliding joint in N."""


class Certificate(Section):
    """What error bounds rest on; results call assumed what the scenario does not make true by construction."""

    bound: Literal["energy", "srinivas", "abbasi_yadkori", "chowdhury_gopalan", "fiedler"] = "energy"
    """Which bound of the prediction error (docs/bounds.md)."""
    confidence: of.Confidence = 0.95
    """With which all bounds hold at once: all bodies, outputs and updates."""
    norm: of.Norm = 3.0
    """RKHS norm of every residual output less its prior mean, at most: at most this many signal deviations anywhere."""
    payload: LabelError | None = None
    """Label errors of the payload; by default the calibration rig's, or three of the prior's label noise deviations."""
    agents: AgentLabelError | None = None
    """Label errors of the agents; by default as for the payload."""


class Limits(Section):
    """What a flight may not exceed: beyond a limit it ends there, with time and cause, and is incomplete."""

    distance_m: of.Distance = 3.0
    """Largest distance of the payload from its reference."""
    height_m: of.Coordinate | None = None
    """Least height of the payload and of every agent, centres of mass along the third world axis; by default none."""
    attitude_deg: of.AnyAngle = 90.0
    """Largest angle between the payload's attitude and its reference; 180 allows every one."""
    tilt_deg: of.AnyAngle = 90.0
    """Largest angle between an agent's thrust and the third world axis; 180 allows every one."""
    saturation_s: of.Span = 2.0
    """Longest time that a thrust may be cut at zero or at `thrust_max_N` without a break."""
    grip: Annotated[of.Share, of_unit("of the start's")] = 0.01
    """Least singular value of an agent's `A M^-1 A^T`; it is zero where arms lock up or work against each other."""
    thrust_margin: Annotated[of.Share, of_unit("of `thrust_max_N`")] = 0.1
    """What hovering should leave of every agent's thrust; a warning before the flight says where it leaves less."""


class Settings(Section):
    """A whole scenario."""

    name: Name
    """Names the scenario in results."""
    description: str = ""
    """What it is for, in a sentence."""
    duration_s: of.Duration
    """Length of a run."""
    control_Hz: of.ControlRate
    """Control rate; the plant is stepped once a tick."""
    seed: of.Seed = 0
    """Seed of all noise."""
    gravity_mps2: of.Gravities = (0.0, 0.0, -9.81)
    """Gravitational acceleration."""
    agent_types: Annotated[dict[Name, AgentType], Field(min_length=1, max_length=MOST)]
    """Kinds of aerial manipulator, by name; in a file, each in plain numbers or [from URDF](#agenttypefromurdf)."""
    agents: Annotated[tuple[Agent, ...], Field(min_length=1, max_length=MOST)]
    """The team."""
    payload: Payload
    """The payload in truth."""
    added: Added | None = None
    """What is put on the payload in flight, of which nobody tells the controller."""
    nominal: Nominal = Nominal()
    """What the controller believes where it differs."""
    start: Start = Start()
    """Where the run begins."""
    reference: Annotated[Lissajous | Waypoints | Own, Field(discriminator="kind")]
    """Where the payload should be; `build()` of one's own gives a `colift.reference.Reference`."""
    disturbances: Annotated[tuple[Source, ...], Field(max_length=MOST)] = ()
    """Unknown forces and torques."""
    drawn: Drawn | None = None
    """Unknown forces and torques drawn at random, in addition."""
    sensors: Sensors = Sensors()
    """Measurement noise."""
    actuators: Annotated[Ideal | Motors | Own, Field(discriminator="kind")] = Ideal(kind="ideal")
    """What vehicles make of commands; `build(world)` of one's own gives a `colift.actuator.Ideal`."""
    control: Control
    """Gains."""
    allocation: Annotated[Balanced | LeaderFollower, Field(discriminator="kind")]
    """From the payload's wrench to contact forces."""
    learning: Learning
    """Data and models."""
    innovation: Innovation = Innovation()
    """How labels correct what is learned."""
    baselines: Baselines = Baselines()
    """Rivals of learning."""
    certificate: Certificate = Certificate()
    """What error bounds rest on."""
    limits: Limits = Limits()
    """What a flight may not exceed."""
    plant: Annotated[Rigid | Mujoco | Own, Field(discriminator="kind")] = Rigid(kind="rigid")
    """What moves the team in truth; `build(world)` of one's own gives a `colift.world.Plant`."""
    parts: Parts = Parts()
    """Parts of one's own in the place of the paper's."""

    @model_validator(mode="after")
    def _consistent(self) -> Settings:
        """Refuses settings that contradict each other, all at once."""
        wrong = mistakes(self.model_dump())
        if wrong:
            raise as_validation_error(wrong)
        return self

    @property
    def digest(self) -> str:
        """Twelve hexadecimal digits that differ when any setting does: the identity of a run."""
        return hashlib.sha256(self.model_dump_json().encode()).hexdigest()[:12]
