"""What a scenario may say: one frozen model a section, units in the names, a sentence for every setting.

World frame unless a description says otherwise. The words and defaults here are the reference page
(docs/scenarios.md) and the help of the error messages; there is no second list.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, ValidationError, model_validator
from pydantic_core import InitErrorDetails, PydanticCustomError

from colift.scenario.references import Mistake, mistakes


def of_unit(unit: str) -> Any:
    """The unit of a setting that carries a letter of the paper rather than a word with a unit."""
    return Field(json_schema_extra={"unit": unit})


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


def _physical(rows: tuple[Vector, Vector, Vector]) -> tuple[Vector, Vector, Vector]:
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


def _thrice(given: Any) -> Any:
    """One number for all three axes."""
    return (given,) * 3 if isinstance(given, int | float) and not isinstance(given, bool) else given


def _nonzero(axis: Vector) -> Vector:
    if not any(axis):
        raise ValueError("must not be zero")
    return axis


Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Positive = Annotated[Number, Field(gt=0)]
NotNegative = Annotated[Number, Field(ge=0)]
Count = Annotated[int, Field(strict=True, gt=0)]
NAME = r"^[A-Za-z_][A-Za-z0-9_-]*$"
Name = Annotated[str, Field(strict=True, pattern=NAME)]
Vector = tuple[Number, Number, Number]
Axes = Annotated[tuple[Positive, Positive, Positive], BeforeValidator(_thrice)]
Inertia = Annotated[tuple[Vector, Vector, Vector], BeforeValidator(_inertia), AfterValidator(_physical)]
ZERO = (0.0, 0.0, 0.0)


class Section(BaseModel):
    """A part of a scenario: no unknown settings, no change after validation."""

    model_config = ConfigDict(extra="forbid", frozen=True, use_attribute_docstrings=True)


class Body(Section):
    """A rigid body."""

    mass_kg: Positive
    """Mass."""
    com_m: Vector = ZERO
    """Centre of mass, in the body's frame."""
    inertia_kgm2: Inertia
    """Inertia about the centre of mass, body's frame: 3 principal moments, 6 entries xx yy zz xy xz yz, or 3 rows."""


class _Joint(Section):
    """One joint and the body that it moves."""

    name: Name
    """Names the joint and the body that it moves."""
    parent: Name = "base"
    """The body that carries the joint: `base`, or the name of a joint listed above it."""
    position_m: Vector = ZERO
    """Joint origin, in the parent's frame."""
    rpy_deg: Vector = ZERO
    """Roll, pitch, yaw of the joint's frame in the parent's, at joint position 0: R_z(yaw) R_y(pitch) R_x(roll)."""
    axis: Annotated[Vector, AfterValidator(_nonzero)]
    """Direction of the axis in the joint's frame; any length but zero, it is normalized."""
    body: Body
    """The body that the joint moves."""


class Revolute(_Joint):
    """A joint that turns."""

    type: Literal["revolute"]
    """Turns about its axis."""
    rest_rad: Number = 0.0
    """Joint position at rest: where the start is sought, and where a redundant arm tends to."""


class Prismatic(_Joint):
    """A joint that slides."""

    type: Literal["prismatic"]
    """Slides along its axis."""
    rest_m: Number = 0.0
    """Joint position at rest: where the start is sought, and where a redundant arm tends to."""


class Arm(Section):
    """One point contact with the payload."""

    name: Name
    """Names the arm; `agent/arm` names a contact."""
    joint: Name
    """The body that carries the tip: a joint's name, or `base`."""
    tip_m: Vector
    """Contact point, in that body's frame."""


class AgentType(Section):
    """An aerial manipulator: a base and a tree of joints and arms."""

    base: Body
    """The vehicle without its arms; its frame is the agent's, thrust along its third axis."""
    thrust_max_N: Positive
    """The largest thrust; a command beyond it is cut there, and the tick is marked."""
    joints: tuple[Annotated[Revolute | Prismatic, Field(discriminator="type")], ...] = ()
    """Joints, parents before children."""
    arms: Annotated[tuple[Arm, ...], Field(min_length=1)]
    """Arms, one contact each."""


class Agent(Section):
    """One member of the team."""

    name: Name
    """Names the agent."""
    type: Name
    """One of `agent_types`."""
    yaw_deg: Number = 0.0
    """Heading that the agent starts with and keeps."""
    contacts_m: tuple[Vector, ...]
    """Where each arm holds the payload, in the order of the type's arms; payload frame."""


class Payload(Section):
    """The rigid payload; its frame sits at its centre of mass."""

    mass_kg: Positive
    """Mass."""
    inertia_kgm2: Inertia
    """Inertia, payload frame: 3 principal moments, 6 entries xx yy zz xy xz yz, or 3 rows."""


class NominalAgentType(Section):
    """What the controller believes of an agent type where it differs."""

    base: Body | None = None
    """The base as believed."""
    joints: dict[Name, Body] = {}
    """Joint name to the body that it moves, as believed."""


class Nominal(Section):
    """What the controller believes where it differs from the truth."""

    payload: Payload | None = None
    """The payload as believed."""
    agent_types: dict[Name, NominalAgentType] = {}
    """Agent type to the bodies of it that are believed to be otherwise."""


class Start(Section):
    """Where the run begins; the agents are placed so that all tips touch (on the manifold)."""

    position_error_m: Vector = ZERO
    """Payload position less the reference at t = 0."""
    attitude_error_deg: Vector = ZERO
    """Rotation vector from the reference attitude to the payload's, in the reference's frame."""
    velocity_mps: Vector = ZERO
    """Payload velocity."""
    body_rate_radps: Vector = ZERO
    """Payload body rate, payload frame."""


class Lissajous(Section):
    """`p_d = center + ramp(t) amplitude sin(2 pi t / period + phase)`, axis by axis, at a constant attitude."""

    kind: Literal["lissajous"]
    """Which reference."""
    center_m: Vector
    """Centre of the figure."""
    amplitude_m: tuple[NotNegative, NotNegative, NotNegative]
    """Amplitude along each axis."""
    period_s: Axes
    """Period along each axis; one number for all three."""
    phase_deg: Vector = ZERO
    """Phase along each axis."""
    ramp_s: Positive
    """Time in which the amplitude rises smoothly from zero."""
    rpy_deg: Vector = ZERO
    """Roll, pitch, yaw of the desired attitude."""


class _Source(Section):
    """A force or torque at a named point of a named body; the truth's, unknown to the controller."""

    name: Name
    """Names the source in results."""
    acts_on: Name
    """`payload`, `agents` (each of them), or the name of one agent."""
    body: Name = "base"
    """The agent's body: `base`, or a joint's name. Not for the payload."""
    point_m: Vector = ZERO
    """Where it attacks, in the body's frame."""


class Constant(_Source):
    """A force fixed in the world and a torque fixed in the body."""

    kind: Literal["constant"]
    """Which law."""
    force_N: Vector = ZERO
    """Force, world frame."""
    torque_Nm: Vector = ZERO
    """Torque, body's frame."""


class Gust(Section):
    """One wave of a wind field."""

    amplitude_mps: Vector
    """Wind speed at the crest."""
    wave_radpm: Vector
    """Wave vector: its length is 2 pi over the wavelength."""
    phase_deg: Number = 0.0
    """Phase at the origin."""


class Wind(_Source):
    """Drag in a steady wind field that varies in space; with no wind, plain drag."""

    kind: Literal["wind"]
    """Which law."""
    linear_Nspm: NotNegative = 0.0
    """Linear drag coefficient."""
    quadratic_Ns2pm2: NotNegative = 0.0
    """Quadratic drag coefficient."""
    mean_mps: Vector = ZERO
    """Mean wind."""
    gusts: tuple[Gust, ...] = ()
    """Waves added to the mean."""


class Tether(_Source):
    """An elastic line to a fixed point; it pulls when longer than its rest length."""

    kind: Literal["tether"]
    """Which law."""
    anchor_m: Vector
    """The fixed end."""
    stiffness_Npm: Positive
    """Stiffness."""
    length_m: NotNegative = 0.0
    """Length at rest."""


class Jet(_Source):
    """A local stream: a force that falls off around a centre as a Gaussian."""

    kind: Literal["jet"]
    """Which law."""
    force_N: Vector
    """Force at the centre."""
    center_m: Vector
    """Centre of the stream."""
    width_m: Positive
    """Distance at which the force has fallen to 0.61 of that at the centre."""


class RotorBias(_Source):
    """Rotors that do not give what is asked."""

    kind: Literal["rotor_bias"]
    """Which law."""
    thrust_N: Number = 0.0
    """Thrust that is added, along the body's third axis."""
    torque_Nm: Vector = ZERO
    """Torque that is added, body's frame."""


class JointFriction(Section):
    """Friction in every joint of the agent: `-viscous r_dot - coulomb tanh(r_dot / speed)`."""

    kind: Literal["joint_friction"]
    """Which law."""
    name: Name
    """Names the source in results."""
    acts_on: Name
    """`agents` (each of them), or the name of one agent."""
    viscous_Nms: NotNegative = 0.0
    """Viscous coefficient; for a sliding joint in N s/m."""
    coulomb_Nm: NotNegative = 0.0
    """Dry friction; for a sliding joint in N."""
    speed_radps: Positive = 0.05
    """Joint rate below which dry friction is smoothed; for a sliding joint in m/s."""


Law = Constant | Wind | Tether | Jet | RotorBias
Source = Annotated[Law | JointFriction, Field(discriminator="kind")]


class Drawn(Section):
    """Residuals drawn at random from the space of functions that the learner assumes, with a norm that is known.

    Each output of payload and agents is `sum_k w_k k(z_k, .)`, k its prior's kernel, the z_k states around the
    reference, the w_k normal and scaled to the norm.
    """

    norm: Positive
    """RKHS norm of every output: its values are at most this many signal deviations of its prior."""
    centers: Count = 30
    """How many kernels are added."""
    spread: NotNegative = 0.2
    """Deviation of the centres from the states on the reference, in length-scales."""


class Sensors(Section):
    """Standard deviations of white noise on every tick's reading, and the tips' bias and bandwidth."""

    position_m: NotNegative = 0.002
    """Position."""
    attitude_deg: NotNegative = 0.2
    """Attitude, per axis of the rotation vector."""
    velocity_mps: NotNegative = 0.01
    """Velocity."""
    body_rate_radps: NotNegative = 0.01
    """Body rate."""
    accelerometer_mps2: NotNegative = 0.05
    """Specific force."""
    joint_deg: NotNegative = 0.1
    """Joint encoder; a sliding joint has the same number of radians as metres (0.1 deg: 1.7 mm)."""
    tip_force_N: NotNegative = 0.1
    """Force at a tip, per axis."""
    tip_force_bias_N: NotNegative = 0.05
    """Deviation from which the constant bias of each tip axis is drawn."""
    tip_force_bandwidth_Hz: Positive = 50.0
    """First-order bandwidth of the tip force sensors."""


class Control(Section):
    """Feedback gains. Rotational ones multiply the inertia (docs/errata.md, row 6)."""

    K_p: Annotated[Axes, of_unit("1/s²")]
    """Payload position gain, per axis; one number for all three."""
    K_v: Annotated[Axes, of_unit("1/s")]
    """Payload velocity gain, per axis; one number for all three."""
    k_R: Annotated[Positive, of_unit("1/s²")]
    """Payload attitude gain: `K_R = k_R J_L`."""
    k_omega: Annotated[Positive, of_unit("1/s")]
    """Payload body-rate gain: `K_omega = k_omega J_L`."""
    agent_k_R: Annotated[Positive, of_unit("1/s²")]
    """Agents' attitude gain."""
    agent_k_omega: Annotated[Positive, of_unit("1/s")]
    """Agents' body-rate gain."""
    posture: Annotated[NotNegative, of_unit("1/s")] = 2.0
    """Rate at which redundant joints return to rest."""
    fusion_Hz: Positive = 1.0
    """How fast measured poses and velocities pull the inertial prediction."""
    joint_filter_Hz: Positive = 30.0
    """Corner of the second-order filter of joint readings, of which the rates are the derivative."""


class Internal(Section):
    """Internal forces, which leave the payload's wrench alone, switched on for a while."""

    start_s: NotNegative
    """When they begin to rise."""
    end_s: Positive
    """When they are gone again."""
    ramp_s: Positive
    """How long each flank lasts."""
    pairs: Annotated[tuple[tuple[str, str, Number], ...], Field(min_length=1)]
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
    leader_contacts: Annotated[tuple[str, ...], Field(min_length=1)]
    """Contacts of the leader block, as `agent/arm`; three that are not collinear, or more."""
    lam_f0_N: tuple[Vector, ...] | None = None
    """Constant force of each follower contact, in team order; an internal force; payload frame."""
    internal: Internal | None = None
    """Internal-force input, on follower contacts only."""


class Prior(Section):
    """Deviations that a model states before it has data."""

    force_N: Positive
    """Signal deviation of a force output."""
    moment_Nm: Positive
    """Signal deviation of a moment output."""
    force_noise_N: Positive
    """Label noise deviation of a force output."""
    moment_noise_Nm: Positive
    """Label noise deviation of a moment output."""
    lengthscale: Annotated[Positive, of_unit("of each feature")] = 1.0
    """Length-scale of every feature but rates of rotation and of joints."""
    rate_lengthscale: Annotated[Positive, of_unit("of each feature")] = 1.0
    """Length-scale of rates of rotation and of joints."""


class AgentPrior(Prior):
    """Deviations that an agent's model states before it has data."""

    joint_Nm: Positive
    """Signal deviation of a joint output; for a sliding joint in N."""
    joint_noise_Nm: Positive
    """Label noise deviation of a joint output; for a sliding joint in N."""


class Learning(Section):
    """When data are recorded, when models are fitted and frozen, and how."""

    update_times_s: Annotated[tuple[Positive, ...], Field(min_length=1)]
    """The t_k at which all models are fitted to the data so far and frozen, ascending."""
    start_s: NotNegative
    """When recording begins; the filters have settled by then."""
    end_s: Positive
    """T_end: no data are recorded after it."""
    sample_Hz: Positive
    """Rate at which samples are recorded; no denser than the filter's memory."""
    filter_Hz: Positive
    """Corner of the second-order filter that every term of a label goes through."""
    capacity: Count
    """Most samples a data set holds."""
    payload: Prior
    """The payload model's prior."""
    agents: AgentPrior
    """The agent models' prior."""
    lengthscale_bounds: tuple[Positive, Positive] = (0.1, 30.0)
    """Least and largest length-scale of any feature, in its own unit: m, m/s, rad, rad/s, none for an entry of R."""
    prior_factor: Annotated[Number, Field(gt=1)] = 3.0
    """Before data, two of three length-scales and deviations lie within this factor of the prior's (log-normal)."""
    hyperparameters: Literal["fitted", "stated"] = "fitted"
    """`fitted` to the data at each update, or `stated`: those of the prior, without a mean, as error bounds ask for."""
    samples: Literal["estimated", "rig"] = "estimated"
    """`estimated` on board from the sensors, or of a calibration `rig`: true states, labels with bounded errors."""
    rig_error: NotNegative = 0.1
    """Error of every label of the rig, one way or the other, as a share of the drawn residual's deviation."""
    restarts: Annotated[int, Field(strict=True, ge=0)] = 1
    """Further starts of the fit, beside the warm one."""
    max_iterations: Count = 300
    """Most iterations of one start."""


class Baselines(Section):
    """Tuning of the rivals of learning."""

    K_i: Annotated[NotNegative, of_unit("1/s³")] = 2.0
    """Integral action on the position error, baseline I."""
    k_i: Annotated[NotNegative, of_unit("1/s³")] = 40.0
    """Integral action on the attitude error, baseline I."""
    observer_Hz: Positive = 0.5
    """Bandwidth of the wrench observer, baseline DOB."""
    mass_kg: Positive = 0.5
    """Prior deviation of the payload's mass error, baseline P."""
    first_moment_kgm: Positive = 0.05
    """Prior deviation of the payload's first moments, baseline P."""
    inertia_kgm2: Positive = 0.05
    """Prior deviation of the payload's inertia error, baseline P."""


class LabelError(Section):
    """Largest errors of labels: noise, bias and delay, and all by which the residual is no function of the state."""

    force_N: Positive
    """Of a force output."""
    moment_Nm: Positive
    """Of a moment output."""


class AgentLabelError(LabelError):
    """Largest errors of an agent's labels."""

    joint_Nm: Positive
    """Of a joint output; for a sliding joint in N."""


class Certificate(Section):
    """What error bounds rest on; results call assumed what the scenario does not make true by construction."""

    bound: Literal["energy", "srinivas", "abbasi_yadkori", "chowdhury_gopalan", "fiedler"] = "energy"
    """Which bound of the prediction error (docs/bounds.md)."""
    confidence: Annotated[Number, Field(gt=0, lt=1)] = 0.95
    """With which all bounds hold at once: all bodies, outputs and updates."""
    norm: Positive = 3.0
    """RKHS norm of every residual output less its prior mean, at most: at most this many signal deviations anywhere."""
    payload: LabelError | None = None
    """Label errors of the payload; by default the calibration rig's, or three of the prior's label noise deviations."""
    agents: AgentLabelError | None = None
    """Label errors of the agents; by default as for the payload."""


class Settings(Section):
    """A whole scenario."""

    name: Name
    """Names the scenario in results."""
    description: str = ""
    """What it is for, in a sentence."""
    duration_s: Positive
    """Length of a run."""
    control_Hz: Positive
    """Control rate; the plant is stepped once a tick."""
    seed: Annotated[int, Field(strict=True, ge=0)] = 0
    """Seed of all noise."""
    gravity_mps2: Vector = (0.0, 0.0, -9.81)
    """Gravitational acceleration."""
    agent_types: Annotated[dict[Name, AgentType], Field(min_length=1)]
    """Kinds of aerial manipulator, by name; in a file, each in plain numbers or [from URDF](#agenttypefromurdf)."""
    agents: Annotated[tuple[Agent, ...], Field(min_length=1)]
    """The team."""
    payload: Payload
    """The payload in truth."""
    nominal: Nominal = Nominal()
    """What the controller believes where it differs."""
    start: Start = Start()
    """Where the run begins."""
    reference: Lissajous
    """Where the payload should be."""
    disturbances: tuple[Source, ...] = ()
    """Unknown forces and torques."""
    drawn: Drawn | None = None
    """Unknown forces and torques drawn at random, in addition."""
    sensors: Sensors = Sensors()
    """Measurement noise."""
    control: Control
    """Gains."""
    allocation: Annotated[Balanced | LeaderFollower, Field(discriminator="kind")]
    """From the payload's wrench to contact forces."""
    learning: Learning
    """Data and models."""
    baselines: Baselines = Baselines()
    """Rivals of learning."""
    certificate: Certificate = Certificate()
    """What error bounds rest on."""

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


def as_validation_error(wrong: Sequence[Mistake]) -> ValidationError:
    """Mistakes between sections, in the form that pydantic gives those within one."""
    return ValidationError.from_exception_data(
        "Settings",
        [
            InitErrorDetails(type=PydanticCustomError("mistake", "{message}", {"message": text}), loc=loc, input=None)
            for loc, text in wrong
        ],
    )
