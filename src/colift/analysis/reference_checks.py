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

from colift.math import so3
from colift.models.parameters import Team
from colift.scenario import Scenario, schema, trajectories
from colift.trajectories import base, minimum_snap, smoothing_spline

MAX_OVERSHOOT = 0.2  # of the side of the box of the poses
MIN_OVERSHOOT = 0.01  # m
SAMPLES = 4000  # times on the reference
SAMPLES_PER_LEG = 33  # times in each leg between waypoints
MIN_TABLE_POSES = 20  # poses from which `kind: sampled` is proposed
MAX_SHOWN_LEGS = 6  # legs that a message lists
TRIED_INTERVALS = 25  # factors of a duration that a search evaluates


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
    problems = [*_overshoot(settings, team, motion), *_acceleration(settings, team, motion), *_shorter_way(given)]
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


def _leg(given: schema.Waypoints | schema.Sampled, t: float) -> str:
    """Describe the leg between poses that contains a time."""
    if isinstance(given, schema.Sampled):
        return ""
    times = np.array([pose.time_s for pose in given.poses])
    k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(times) - 2))
    return f" in leg {k + 1} (from {times[k]:g} s to {times[k + 1]:g} s)"


# Overshoot ------------------------------------------------------------------------------------------------------------


def _overshoot(settings: Scenario, team: Team, motion: _Motion) -> Iterator[Problem]:
    """Yield the largest distance of the path from the box of the poses, if it is too large."""
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
        return
    size, t = float(beyond[k, axis]), float(motion.t[inside][k])
    sentence = f"leaves the box of its poses by {size:.3g} m along {'xyz'[axis]}{_leg(given, t)} at {t:.3g} s"
    most = _largest_acceleration(team, np.asarray(motion.d.a)[inside][k])
    yield sentence, _less_overshoot(given, t, most), {"overshoot_m": size, "overshoot_time_s": t}


def _less_overshoot(given: schema.Waypoints | schema.Sampled, t: float, most: float) -> str:
    """Return a change that keeps the path near its poses."""
    if isinstance(given, schema.Sampled):
        noise = _larger_deviation("deviation_m", given.table("position_fits"), most)
        return noise or f"add poses to the table about {t:.3g} s, between which the path is not determined"
    times, p = np.array([pose.time_s for pose in given.poses]), np.array([pose.position_m for pose in given.poses])
    T = np.diff(times)
    for least in np.geomspace(T.min(), T.max(), TRIED_INTERVALS)[1:]:
        longer = np.concatenate([[times[0]], times[0] + np.cumsum(np.maximum(T, least))])
        if _excess(p, _snap_path(longer, p, 0)) <= MAX_OVERSHOOT:
            short = np.flatnonzero(least > T)
            return f"give {_legs(short)} at least {_rounded_up(least)} s (reference.poses: time_s)"
    fit = smoothing_spline.fit_samples(times, p, np.broadcast_to(np.eye(3), (len(p), 3, 3)))
    path = smoothing_spline.pose_spline(fit.knots)
    if _excess(p, np.asarray(_along(path, jnp.linspace(times[0], times[-1], SAMPLES)).p)) <= MAX_OVERSHOOT:
        return "kind: sampled with these poses as a table stays near the box"
    k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(T) - 1))
    if _excess(p, _snap_path(*_with_middle(times, p, k), 0)) <= MAX_OVERSHOOT:
        return f"add a pose in the middle of leg {k + 1} (reference.poses)"
    return "add poses between those of the legs that are too long, or use a table of the whole path with kind: sampled"


def _excess(p: np.ndarray, path: np.ndarray) -> float:
    """Return the largest overshoot of a path relative to the side of the box of the points."""
    side, low, high = np.ptp(p, axis=0), p.min(0), p.max(0)
    return float((np.maximum(low - path, path - high) / np.maximum(side, MIN_OVERSHOOT / MAX_OVERSHOOT)).max())


def _snap_path(times: np.ndarray, p: np.ndarray, order: int) -> np.ndarray:
    """Evaluate a derivative of the minimum-snap path in every leg."""
    c, T = minimum_snap.minimum_snap_coefficients(times, p), np.diff(times)
    c = np.moveaxis(np.polynomial.polynomial.polyder(np.moveaxis(c, 1, 0), order), 0, 1)
    powers = (T[:, None] * np.linspace(0, 1, SAMPLES_PER_LEG))[:, :, None] ** np.arange(c.shape[1])
    return (powers @ c).reshape(-1, 3)


def _with_middle(times: np.ndarray, p: np.ndarray, k: int) -> tuple[np.ndarray, np.ndarray]:
    return np.insert(times, k + 1, times[k : k + 2].mean()), np.insert(p, k + 1, p[k : k + 2].mean(0), axis=0)


def _legs(numbers: np.ndarray) -> str:
    shown = [str(k + 1) for k in numbers[:MAX_SHOWN_LEGS]]
    if len(numbers) > MAX_SHOWN_LEGS:
        return f"legs {', '.join(shown)} and {len(numbers) - MAX_SHOWN_LEGS} more"
    return f"leg{'s' * (len(shown) > 1)} {' and '.join(filter(None, [', '.join(shown[:-1]), shown[-1]]))}"


def _rounded_up(x: float) -> str:
    """Format a number with two digits, not below it."""
    scale = 10.0 ** (np.floor(np.log10(x)) - 1)
    return f"{np.ceil(x / scale - 1e-9) * scale:.3g}"


# Acceleration ---------------------------------------------------------------------------------------------------------


def _acceleration(settings: Scenario, team: Team, motion: _Motion) -> Iterator[Problem]:
    """Yield the largest excess of the thrust that the motion requires over that of the team or of one agent."""
    given = settings.reference
    assert isinstance(given, schema.Waypoints | schema.Sampled)
    ratio, alone = _thrust_ratio(team, motion.d)
    k = int(np.argmax(ratio))
    if ratio[k] <= 1:
        return
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
    yield sentence, _less_acceleration(given, motion, t, most, float(ratio[k]), bool(alone[k])), values


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


def _less_acceleration(
    given: schema.Waypoints | schema.Sampled, motion: _Motion, t: float, most: float, ratio: float, turning: bool
) -> str:
    """Return a change that reduces the acceleration to that of the team."""
    if isinstance(given, schema.Sampled):
        return _less_acceleration_of_table(given, motion, t, most, ratio, turning)
    times, p = np.array([pose.time_s for pose in given.poses]), np.array([pose.position_m for pose in given.poses])
    T = np.diff(times)
    k = int(np.clip(np.searchsorted(times, t, side="right") - 1, 0, len(T) - 1))
    if turning:
        return f"give leg {k + 1} {_rounded_up(T[k] * np.sqrt(ratio))} s or more (reference.poses: time_s)"
    if len(times) >= MIN_TABLE_POSES:
        choices = smoothing_spline.fit_samples(times, p, np.broadcast_to(np.eye(3), (len(p), 3, 3))).choices
        if choices[-1][1] < most:
            return (
                f"kind: sampled with these poses as a table keeps the start velocity and needs "
                f"{choices[-1][1]:.3g} m/s²"
            )
    for factor in np.geomspace(1.1, 100, TRIED_INTERVALS):
        longer = times + np.where(np.arange(len(times)) > k, (factor - 1) * T[k], 0.0)
        if np.linalg.norm(_snap_path(longer, p, 2), axis=1).max() < most:
            return f"give leg {k + 1} {_rounded_up(factor * T[k])} s (reference.poses: time_s)"
    for factor in np.geomspace(1.1, 100, TRIED_INTERVALS):
        if np.linalg.norm(_snap_path(times * factor, p, 2), axis=1).max() < most:
            return f"multiply all times by {_rounded_up(factor)} (reference.poses: time_s)"
    return "give all legs more time (reference.poses: time_s)"


def _less_acceleration_of_table(
    given: schema.Sampled, motion: _Motion, t: float, most: float, ratio: float, turning: bool
) -> str:
    """Return a change for a table: a larger deviation if it suffices, else a slower motion."""
    if t > given.end_s:
        return f"reduce duration_s to {given.end_s:.4g}, or add poses with which the table ends at rest"
    if turning:
        limit = float(np.linalg.norm(motion.d.omega_dot, axis=1).max()) / ratio
        noise = _larger_deviation("deviation_deg", given.table("attitude_fits"), limit)
    else:
        noise = _larger_deviation("deviation_m", given.table("position_fits"), most)
    factor = np.sqrt(ratio if turning else float(motion.acceleration.max()) / max(most, 1e-3))
    return noise or f"--set reference.time_scale={_rounded_up(1.05 * factor)}, which is a slower motion"


def _larger_deviation(name: str, fits: np.ndarray, limit: float) -> str:
    """Return the least deviation with an acceleration within a limit; empty if it is too large for noise."""
    smoother = fits[fits[:, 1] < limit]
    if not len(smoother) or smoother[:, 0].min() > MAX_NOISE[name]:
        return ""
    deviation, peak = smoother[np.argmin(smoother[:, 0])]
    unit = "m/s²" if name == "deviation_m" else "rad/s²"
    change = f"--set reference.{name}={_rounded_up(deviation)}"
    return f"if this is noise of the table, {change} reduces it to {peak:.3g} {unit}"


MAX_NOISE = {"deviation_m": 0.05, "deviation_deg": 3.0}
"""Largest deviations that are proposed, for the noise of sensors."""


# Directions -----------------------------------------------------------------------------------------------------------


def _shorter_way(given: schema.Waypoints | schema.Sampled) -> Iterator[Problem]:
    """Yield the first leg whose stated angles change by more than the rotation that is flown, for unwrapped angles."""
    if isinstance(given, schema.Sampled):
        return
    angles = np.array([pose.rpy_deg for pose in given.poses])
    unwrapped = np.ptp(angles, axis=0) >= 360
    for k, change in enumerate(np.abs(np.diff(angles, axis=0))):
        for axis in np.flatnonzero(unwrapped & (change > 180)):
            name = ("roll", "pitch", "yaw")[axis]
            sentence = f"changes {name} by {change[axis]:g} deg in leg {k + 1}, which turns by the shorter way"
            pieces = int(change[axis] // 170) + 1
            yield sentence, f"add {pieces - 1} poses to leg {k + 1}, so that each turns by 170 deg or less", {}
            return
