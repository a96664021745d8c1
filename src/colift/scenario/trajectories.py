"""Reference trajectory of a scenario, and the heading at its start."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift.closed_loop import part_checks
from colift.math import so3
from colift.scenario import packing, schema, team
from colift.scenario.conversion import array, build_plugin, check_plugin, once, rotation
from colift.trajectories import base, departure, knots, lissajous, minimum_snap, pose_spline
from colift.trajectories.rotation_legs import shortest_turns

Reference = schema.Lissajous | schema.Waypoints | schema.Sampled | schema.Plugin
HALF_TURN = 1e-3
"""Distance from a half turn [rad] within which the stated angles decide on the direction of a leg."""


def make_reference(settings: schema.Scenario) -> base.ReferenceTrajectory:
    """Return the reference trajectory of the payload."""
    return _reference(settings.reference)


def _reference(given: Reference) -> base.ReferenceTrajectory:
    """Return the reference trajectory of a section."""
    if isinstance(given, schema.Plugin):
        reference = build_plugin(given, "reference", base.ReferenceTrajectory)
        check_plugin(part_checks.check_reference, reference)
        return reference
    if isinstance(given, schema.Waypoints):
        return _waypoints(given)
    if isinstance(given, schema.Sampled):
        return _sampled(given.tables["position_knots"], given.tables["attitude_knots"])
    return _lissajous(given)


@once
def _lissajous(given: schema.Lissajous) -> base.ReferenceTrajectory:
    """Return a closed reference curve."""
    loop = lissajous.Lissajous(
        center=array(given.center_m),
        amplitude=array(given.amplitude_m),
        period=array(given.period_s),
        phase=array(np.deg2rad(given.phase_deg)),
        ramp_time=array(given.ramp_time_s),
        R=rotation(given.rpy_deg),
        rotation_amplitude=array(np.deg2rad(given.rotation_amplitude_deg)),
        rotation_period=array(given.rotation_period_s),
        rotation_phase=array(np.zeros(3)),
    )
    if (off := given.departure) is None:
        return loop
    return departure.PathDeparture(
        base=loop,
        offset=array(off.offset_m),
        start=array(off.start_s),
        ramp_time=array(off.ramp_time_s),
        rotation_amplitude=array(np.deg2rad(off.rotation_amplitude_deg)),
        rotation_start=array(off.rotation_start_s),
        rotation_period=array(off.rotation_period_s),
    )


@functools.lru_cache(maxsize=16)
def _waypoints(waypoints: schema.Waypoints) -> pose_spline.PoseSpline:
    """Return the reference through waypoints."""
    R = np.array([rotation(pose.rpy_deg) for pose in waypoints.poses])
    return minimum_snap.minimum_snap(
        np.array([pose.time_s for pose in waypoints.poses]),
        np.array([pose.position_m for pose in waypoints.poses]),
        R,
        _turns(R, np.deg2rad([pose.rpy_deg for pose in waypoints.poses])),
    )


def _turns(R: np.ndarray, angles: np.ndarray) -> np.ndarray:
    """Return the rotation vectors of the legs; the direction of a half turn is that of the stated angles."""
    delta = shortest_turns(R)
    for k in np.flatnonzero(np.linalg.norm(delta, axis=1) > np.pi - HALF_TURN):
        roll, pitch, yaw = np.diff(angles[k : k + 2], axis=0)[0]
        heading = np.array([np.cos(angles[k, 2]), np.sin(angles[k, 2]), 0.0])
        stated = yaw * np.eye(3)[2] + pitch * np.cross(np.eye(3)[2], heading) + roll * R[k][:, 0]
        if stated @ R[k] @ delta[k] < 0:
            delta[k] *= 1 - 2 * np.pi / np.linalg.norm(delta[k])
    return delta


@functools.lru_cache(maxsize=16)
def _sampled(position_knots: str, attitude_knots: str) -> pose_spline.PoseSpline:
    """Return the reference through the rows of a table."""
    from colift.trajectories import smoothing_spline  # here, because SciPy's splines take long to import

    return smoothing_spline.pose_spline(
        smoothing_spline.SplineKnots(
            position=packing.unpack(position_knots, knots.POSITION_COLUMNS),
            attitude=packing.unpack(attitude_knots, knots.ATTITUDE_COLUMNS),
        )
    )


setpoint = jax.jit(lambda path, t: path.evaluate(t))
"""Setpoint of a reference at a time [s]."""


def headings(settings: schema.Scenario) -> tuple[Array, ...]:
    """Return the heading of every agent [rad, world], by group.

    It is `yaw_deg` plus the heading of the reference at t = 0, so that the team starts in the same configuration about
    the payload, whatever its heading. The latter is the angle about the vertical of the swing-twist decomposition.

    Args:
        settings: Scenario.

    Returns:
        The headings.
    """
    heading = _initial_heading(settings.reference)
    return tuple(yaw + heading for yaw in team.initial_yaw(settings))


@once
def _initial_heading(given: Reference) -> Array:
    """Return the heading of a reference at t = 0 [rad]."""
    return _heading(setpoint(_reference(given), array(0.0)).R)


@jax.jit
def _heading(R: Array) -> Array:
    """Return the angle about the vertical of the swing-twist decomposition [rad]."""
    q = so3.quaternion(R)
    return 2 * jnp.arctan2(q[3], q[0])
