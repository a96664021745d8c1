"""Check of a reference through poses: overshoot beyond their box, and accelerations beyond those of the team.

Each problem is located by leg and time, and the advice names settings of this kind of reference. Where the effect of a
change can be computed, only changes that remedy the problem are proposed.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Iterator
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.analysis import waypoint_remedies
from colift.analysis.waypoint_remedies import MAX_OVERSHOOT, MIN_OVERSHOOT, rounded_up
from colift.math import so3
from colift.models.parameters import Team
from colift.scenario import Scenario, ScenarioError, schema, trajectories
from colift.trajectories import base

SAMPLES = 4000  # times on the reference


@dataclasses.dataclass(frozen=True)
class ReferenceFinding:
    """Result of the check of a reference.

    Attributes:
        message: One sentence with values and units.
        values: The values by name, with units in the names.
        advice: Proposed changes; empty if and only if the check passed.
        warnings: The problems, one sentence each with its remedy.
    """

    message: str
    values: dict[str, Any]
    advice: tuple[str, ...]
    warnings: tuple[str, ...]


@dataclasses.dataclass(frozen=True)
class _Motion:
    """Reference at many times within the simulation."""

    t: np.ndarray
    d: base.PayloadSetpoint  # fields lead with the times

    @property
    def acceleration(self) -> np.ndarray:
        return np.linalg.norm(self.d.a, axis=1)


@dataclasses.dataclass(frozen=True)
class _Fault:
    """Overshoot, or excess of the thrust."""

    sentence: str
    values: dict[str, Any]
    t: float
    most: float  # largest acceleration of the team in the direction of the reference's [m/s^2]
    ratio: float = 0.0  # required over available thrust
    turning: bool = False  # whether the rotation is the reason


Problem = tuple[str, str, dict[str, Any]]
"""Sentence, remedy and values."""


def check_reference(settings: Scenario, team: Team) -> ReferenceFinding | None:
    """Check a reference through waypoints or a table of poses.

    Args:
        settings: Scenario.
        team: True parameters.

    Returns:
        The finding; None for another kind of reference.
    """
    given = settings.reference
    if not isinstance(given, schema.Waypoints | schema.Sampled):
        return None
    motion = _sample(settings)
    problems = list(_problems(settings, team, motion))
    k = int(np.argmax(motion.acceleration))
    peak = f"largest acceleration {motion.acceleration[k]:.3g} m/s² at {motion.t[k]:.3g} s"
    values: dict[str, Any] = {"acceleration_mps2": float(motion.acceleration[k])}
    for _, _, more in problems:
        values |= more
    return ReferenceFinding(
        message="; ".join([_describe(given), peak, *(sentence for sentence, _, _ in problems)]),
        values=values,
        advice=tuple(remedy for _, remedy, _ in problems),
        warnings=tuple(f"the reference {sentence}; {remedy}" for sentence, remedy, _ in problems),
    )


def _problems(settings: Scenario, team: Team, motion: _Motion) -> Iterator[Problem]:
    """Yield the problems, each with a remedy; overshoot and acceleration of waypoints have one remedy."""
    given = settings.reference
    over, excess = _overshoot(settings, team, motion), _acceleration(settings, team, motion)
    if isinstance(given, schema.Sampled):
        if over is not None:
            yield over.sentence, _less_overshoot_of_table(given, over), over.values
        if excess is not None:
            yield excess.sentence, _less_acceleration_of_table(given, motion, excess), excess.values
        return
    assert isinstance(given, schema.Waypoints)
    turns = list(_shorter_way(given))
    if over is None and excess is None:
        yield from turns
        return
    found = [fault for fault in (over, excess) if fault is not None]
    faults = waypoint_remedies.Faults(
        found[-1].t, over is not None, excess is not None, found[-1].turning, found[-1].most, settings.duration_s
    )
    works = functools.partial(_is_flyable, settings, team)
    both = waypoint_remedies.remedy_with_turns(given, faults, works) if turns else ""
    sentences = [fault.sentence for fault in found]
    if both:
        yield "; ".join([*sentences, turns[0][0]]), both, _united(found)
    else:
        yield "; ".join(sentences), waypoint_remedies.remedy(given, faults, works), _united(found)
        yield from turns


def _united(faults: list[_Fault]) -> dict[str, Any]:
    return {name: value for fault in faults for name, value in fault.values.items()}


def _is_flyable(settings: Scenario, team: Team, given: schema.Waypoints) -> bool:
    """Return whether a path through other waypoints stays near them and within the thrust."""
    end = max(settings.duration_s, given.poses[-1].time_s)
    try:
        changed = settings.model_copy(update={"reference": given, "duration_s": end})
    except ScenarioError:  # for example a log that is too large
        return False
    motion = _sample(changed)
    return _overshoot(changed, team, motion) is None and _acceleration(changed, team, motion) is None


def slower_reference(settings: Scenario) -> str:
    """Return how to slow down the reference of a scenario, as a part of a sentence."""
    match settings.reference:
        case schema.Lissajous():
            return "a slower or smaller reference (reference.period_s, amplitude_m)"
        case schema.Waypoints():
            return "a slower reference (more time between the poses, reference.poses: time_s)"
        case schema.Sampled():
            return "a slower reference (reference.time_scale)"
    return "a slower or smaller reference"


def _describe(given: schema.Waypoints | schema.Sampled) -> str:
    if isinstance(given, schema.Waypoints):
        return f"{len(given.poses)} waypoints"
    deviation, turn = (given.table(name)[-1, 0] for name in ("position_fits", "attitude_fits"))
    return f"{given.name}, root-mean-square deviations {deviation:.2g} m and {turn:.2g} deg"


def _sample(settings: Scenario) -> _Motion:
    """Evaluate the reference at `SAMPLES` times: uniform, or the same number in each leg between waypoints."""
    given, end = settings.reference, settings.duration_s
    t = np.linspace(0.0, end, SAMPLES)
    if isinstance(given, schema.Waypoints):
        knots = np.array([pose.time_s for pose in given.poses])
        s = np.linspace(0, len(knots) - 1, SAMPLES)
        t = np.minimum(np.interp(s, np.arange(len(knots)), knots), end)
    return _Motion(t, _along(trajectories.make_reference(settings), jnp.asarray(t)))


@jax.jit
@functools.partial(jax.vmap, in_axes=(None, 0))
def _along(reference: base.ReferenceTrajectory, t: Array) -> base.PayloadSetpoint:
    return reference.evaluate(t)


def largest_tilt(settings: Scenario) -> float:
    """Compute the largest angle between the third axis of the reference and the vertical.

    Args:
        settings: Scenario.

    Returns:
        The angle [deg].
    """
    t = jnp.linspace(0.0, settings.duration_s, SAMPLES)
    R = _along(trajectories.make_reference(settings), t).R
    return float(np.rad2deg(np.arccos(np.clip(np.asarray(R)[:, 2, 2], -1, 1)).max()))


def _leg(given: schema.Waypoints | schema.Sampled, t: float) -> str:
    """Describe the leg between poses that contains a time."""
    if isinstance(given, schema.Sampled):
        return ""
    times = np.array([pose.time_s for pose in given.poses])
    k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
    return f" in leg {k + 1} (from {times[k]:g} s to {times[k + 1]:g} s)"


# Overshoot ------------------------------------------------------------------------------------------------------------


def _overshoot(settings: Scenario, team: Team, motion: _Motion) -> _Fault | None:
    """Return the largest distance of the path from the box of the poses, if it is too large."""
    given = settings.reference
    assert isinstance(given, schema.Waypoints | schema.Sampled)
    if isinstance(given, schema.Waypoints):
        p = np.array([pose.position_m for pose in given.poses])
        low, high = p.min(0), p.max(0)
    else:
        low, high = given.table("box")
    inside = motion.t <= given.end_s if isinstance(given, schema.Sampled) else np.ones(len(motion.t), bool)
    path = np.asarray(motion.d.p)[inside]
    beyond = np.maximum(low - path, path - high)
    over = beyond / np.maximum(high - low, MIN_OVERSHOOT / MAX_OVERSHOOT)
    k, axis = np.unravel_index(np.argmax(np.where(over > MAX_OVERSHOOT, beyond, 0)), beyond.shape)
    if over[k, axis] <= MAX_OVERSHOOT:
        return None
    size, t = float(beyond[k, axis]), float(motion.t[inside][k])
    sentence = f"leaves the box of its poses by {size:.3g} m along {'xyz'[axis]}{_leg(given, t)} at {t:.3g} s"
    most = _largest_acceleration(team, np.asarray(motion.d.a)[inside][k])
    return _Fault(sentence, {"overshoot_m": size, "overshoot_time_s": t}, t, most)


def _less_overshoot_of_table(given: schema.Sampled, fault: _Fault) -> str:
    """Return a change that keeps the path near its poses."""
    noise = _larger_deviation("deviation_m", given.table("position_fits"), fault.most)
    return noise or f"add poses to the table about {fault.t:.3g} s, between which the path is not determined"


# Acceleration ---------------------------------------------------------------------------------------------------------


def _acceleration(settings: Scenario, team: Team, motion: _Motion) -> _Fault | None:
    """Return the largest excess of the thrust that the motion requires over that of the team or of one agent."""
    given = settings.reference
    assert isinstance(given, schema.Waypoints | schema.Sampled)
    ratio, alone = _thrust_ratio(team, motion.d)
    k = int(np.argmax(ratio))
    if ratio[k] <= 1:
        return None
    t, a = float(motion.t[k]), np.asarray(motion.d.a)[k]
    size, turn = float(np.linalg.norm(a)), float(np.linalg.norm(motion.d.omega_dot[k]))
    values = {"excess_time_s": t, "excess_acceleration_mps2": size, "excess_angular_acceleration_radps2": turn}
    most = _largest_acceleration(team, a)
    if alone[k]:
        sentence = f"requires an angular acceleration of {turn:.3g} rad/s² at {t:.3g} s{_leg(given, t)}"
        sentence += ", which exceeds the thrust of the agents"
    else:
        sentence = (
            f"accelerates by {size:.3g} m/s² at {t:.3g} s{_leg(given, t)}; the limit of the team is {most:.3g} m/s²"
        )
    return _Fault(sentence, values, t, most, float(ratio[k]), bool(alone[k]))


def _thrust_ratio(team: Team, d: base.PayloadSetpoint) -> tuple[np.ndarray, np.ndarray]:
    """Return required over available thrust by time, and whether one agent is the limit instead of the sum."""
    g, a = np.asarray(team.gravity), np.asarray(d.a)
    mass, thrust = _mass_and_thrust(team)
    total = mass * np.linalg.norm(a - g, axis=1) / thrust
    single = np.zeros(len(a))
    for group in team.agent_groups:
        c = np.asarray(group.contact_position.mean(1))
        need = np.asarray(_contact_acceleration(d, jnp.asarray(c))) - g
        each = np.linalg.norm(need, axis=2) * np.asarray(group.mass.sum(1)) / np.asarray(group.thrust_max)
        single = np.maximum(single, each.max(1))
    return np.maximum(total, single), single > total


@jax.jit
def _contact_acceleration(d: base.PayloadSetpoint, c: Float[Array, "agents 3"]) -> Float[Array, "times agents 3"]:
    """Return the accelerations of points on the payload."""
    omega, alpha, c = d.omega[:, None], d.omega_dot[:, None], c[None]
    body = so3.cross(alpha, c) + so3.cross(omega, so3.cross(omega, c))
    return d.a[:, None] + jnp.einsum("tij,taj->tai", d.R, body)


def _mass_and_thrust(team: Team) -> tuple[float, float]:
    """Return the mass [kg] and the maximum thrust [N] of the whole team with its payload."""
    mass = float(team.payload.mass) + sum(float(group.mass.sum()) for group in team.agent_groups)
    return mass, sum(float(group.thrust_max.sum()) for group in team.agent_groups)


def _largest_acceleration(team: Team, direction: np.ndarray) -> float:
    """Return the largest acceleration of the team in a direction [m/s^2]."""
    g = np.asarray(team.gravity)
    mass, thrust = _mass_and_thrust(team)
    along = float(direction @ g) / max(float(np.linalg.norm(direction)), 1e-9)
    return max(along + float(np.sqrt(max(along**2 - float(g @ g) + (thrust / mass) ** 2, 0.0))), 0.0)


def _less_acceleration_of_table(given: schema.Sampled, motion: _Motion, fault: _Fault) -> str:
    """Return a change for a table: a larger deviation if it suffices, else a slower motion."""
    if fault.t > given.end_s:
        return f"reduce duration_s to {given.end_s:.4g}, or add poses with which the table ends at rest"
    if fault.turning:
        limit = float(np.linalg.norm(motion.d.omega_dot, axis=1).max()) / fault.ratio
        noise = _larger_deviation("deviation_deg", given.table("attitude_fits"), limit)
    else:
        noise = _larger_deviation("deviation_m", given.table("position_fits"), fault.most)
    factor = np.sqrt(fault.ratio if fault.turning else float(motion.acceleration.max()) / max(fault.most, 1e-3))
    return noise or f"--set reference.time_scale={rounded_up(1.05 * factor)}, which is a slower motion"


def _larger_deviation(name: str, fits: np.ndarray, limit: float) -> str:
    """Return the least deviation above the present one with an acceleration within a limit; empty if it is no noise."""
    smoother = fits[(fits[:, 1] < limit) & (fits[:, 0] > fits[-1, 0])]
    if not len(smoother) or smoother[:, 0].min() > MAX_NOISE[name]:
        return ""
    deviation, peak = smoother[np.argmin(smoother[:, 0])]
    unit = "m/s²" if name == "deviation_m" else "rad/s²"
    change = f"--set reference.{name}={rounded_up(deviation)}"
    return f"if this is noise of the table, {change} reduces it to {peak:.3g} {unit}"


MAX_NOISE = {"deviation_m": 0.05, "deviation_deg": 3.0}
"""Largest deviations that are proposed, for the noise of sensors."""


# Directions -----------------------------------------------------------------------------------------------------------


def _shorter_way(given: schema.Waypoints | schema.Sampled) -> Iterator[Problem]:
    """Yield the first leg whose stated angles change by more than the rotation that is flown, for unwrapped angles."""
    if isinstance(given, schema.Sampled):
        return
    angles = np.array([pose.rpy_deg for pose in given.poses])
    for k, change in enumerate(np.diff(angles, axis=0)):
        pieces = waypoint_remedies.turn_pieces(given, k)
        if pieces > 1:
            axis = int(np.argmax(np.where(np.ptp(angles, axis=0) >= 360, np.abs(change), 0)))
            name = ("roll", "pitch", "yaw")[axis]
            sentence = f"changes {name} by {abs(change[axis]):g} deg in leg {k + 1}, which turns by the shorter way"
            yield (
                sentence,
                f"add {pieces - 1} pose{'s' * (pieces > 2)} to leg {k + 1}, so that each turns by 170 deg or less",
                {},
            )
            return
