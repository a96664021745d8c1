"""Single settings to the values that a run computes with: arrays, rotations, lags in ticks, parts of one's own."""

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


def array(given: object) -> Array:
    """Numbers as float64; `jnp.asarray` alone would make a weakly typed value of a Python float."""
    return jnp.asarray(np.array(given, dtype=float))


def rows(vectors: Iterable[schema.Vector]) -> Array:
    """`(n, 3)` of n vectors, of none too."""
    return array(list(vectors)).reshape(-1, 3)


def rotation(deg: schema.Vector) -> Array:
    """`R_z(yaw) R_y(pitch) R_x(roll)` of roll, pitch, yaw in deg."""
    return _turned(jnp.deg2rad(array(deg)))


@jax.jit
def _turned(angles: Array) -> Array:
    roll, pitch, yaw = jax.vmap(so3.exp)(jnp.diag(angles))
    return matmul(yaw, matmul(pitch, roll))


def actuator_lag(given: schema.ActuatorLag, settings: schema.Scenario) -> ActuatorLag:
    """A lag with its delay in whole ticks of the control loop."""
    return ActuatorLag(bandwidth=array(given.bandwidth_Hz), delay=round(given.delay_s * settings.control_Hz))


P = TypeVar("P")


def build_plugin(given: schema.PluginReference, where: str, kind: type[P], *joins: Any) -> P:
    """What a part of one's own builds, its numbers as arrays. Raises ScenarioError where it is not of that kind."""
    build = getattr(given.settings, "build")  # noqa: B009  `own.settings` has seen that it is there
    made = jax.tree.map(lambda x: x if isinstance(x, jax.Array) else jnp.asarray(np.asarray(x)), build(*joins))
    if not isinstance(made, kind):
        raise ScenarioError(
            f"{where}: {given.class_path} built a value of type {type(made).__name__}, "
            f"which is no {kind.__module__}.{kind.__name__} (docs/change_a_part.md)"
        )
    return made
