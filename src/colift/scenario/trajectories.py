"""A scenario's reference."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np

from colift.closed_loop import part_checks
from colift.math import so3
from colift.scenario import schema
from colift.scenario.conversion import array, build_plugin, check_plugin, rotation
from colift.trajectories import base, departure, lissajous, minimum_snap


def make_reference(settings: schema.Scenario) -> base.ReferenceTrajectory:
    """The payload's reference."""
    given = settings.reference
    if isinstance(given, schema.Plugin):
        reference = build_plugin(given, "reference", base.ReferenceTrajectory)
        check_plugin(part_checks.check_reference, reference)
        return reference
    if isinstance(given, schema.Waypoints):
        turns = _unwrap([np.asarray(so3.log(rotation(pose.rpy_deg))) for pose in given.poses])
        return minimum_snap.minimum_snap(
            np.array([pose.time_s for pose in given.poses]), np.array([pose.position_m for pose in given.poses]), turns
        )
    loop = lissajous.Lissajous(
        center=array(given.center_m),
        amplitude=array(given.amplitude_m),
        period=array(given.period_s),
        phase=jnp.deg2rad(array(given.phase_deg)),
        ramp_time=array(given.ramp_time_s),
        R=rotation(given.rpy_deg),
        rotation_amplitude=jnp.deg2rad(array(given.rotation_amplitude_deg)),
        rotation_period=array(given.rotation_period_s),
        rotation_phase=jnp.zeros(3),
    )
    if (off := given.departure) is None:
        return loop
    return departure.PathDeparture(
        base=loop,
        offset=array(off.offset_m),
        start=array(off.start_s),
        ramp_time=array(off.ramp_time_s),
        rotation_amplitude=jnp.deg2rad(array(off.rotation_amplitude_deg)),
        rotation_start=array(off.rotation_start_s),
        rotation_period=array(off.rotation_period_s),
    )


def _unwrap(theta: list[np.ndarray]) -> np.ndarray:
    """Return the rotation vectors of the same rotations that are closest to the previous ones, within one full turn."""
    out = [theta[0]]
    for vector in theta[1:]:
        angle = np.linalg.norm(vector)
        axis = vector / angle if angle > 0 else np.zeros(3)
        out.append(min((vector + 2 * np.pi * k * axis for k in (-1, 0, 1)), key=lambda x: np.linalg.norm(x - out[-1])))
    return np.array(out)
