"""Conversion of single settings to arrays, rotations, lags in ticks and user-defined parts."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift.math import so3
from colift.math.linalg import matmul
from colift.models.actuator_lag import ActuatorLag
from colift.scenario import schema
from colift.scenario.errors import ScenarioError


def array(numbers: object) -> Array:
    """Convert numbers to a float64 array; `jnp.asarray` alone returns a weak type for a Python float."""
    return jnp.asarray(np.array(numbers, dtype=float))


def rows(vectors: Iterable[schema.Vector]) -> Array:
    """Stack n vectors, also for n = 0, to an array `(n, 3)`."""
    return array(list(vectors)).reshape(-1, 3)


def rotation(deg: schema.Vector) -> Array:
    """Return the rotation `R_z(yaw) R_y(pitch) R_x(roll)` for roll, pitch, yaw [deg]."""
    return _turned(jnp.deg2rad(array(deg)))


@jax.jit
def _turned(angles: Array) -> Array:
    roll, pitch, yaw = jax.vmap(so3.exp)(jnp.diag(angles))
    return matmul(yaw, matmul(pitch, roll))


def actuator_lag(lag: schema.ActuatorLag, settings: schema.Scenario) -> ActuatorLag:
    """Return the lag, with its delay in control periods."""
    return ActuatorLag(bandwidth=array(lag.bandwidth_Hz), delay=round(lag.delay_s * settings.control_Hz))


P = TypeVar("P")


def build_plugin(plugin: schema.PluginReference, location: str, kind: type[P], *arguments: Any) -> P:
    """Build a user-defined part, with its numbers as arrays.

    Args:
        plugin: Class and settings of the part.
        location: Setting that names the part, for messages.
        kind: Interface of the part.
        *arguments: Arguments of the method `build` of the part.

    Returns:
        The part.

    Raises:
        ScenarioError: If the part does not have the interface.
    """
    build = getattr(plugin.settings, "build")  # noqa: B009  `plugins.plugin_settings` requires the method
    made = jax.tree.map(lambda x: x if isinstance(x, jax.Array) else jnp.asarray(np.asarray(x)), build(*arguments))
    if not isinstance(made, kind):
        raise ScenarioError(
            f"{location}: {plugin.class_path} built a value of type {type(made).__name__}, "
            f"which is no {kind.__module__}.{kind.__name__} (docs/change_a_part.md)"
        )
    return made
