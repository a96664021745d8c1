"""Conversion of single settings to arrays, rotations, lags in ticks and user-defined parts."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable
from typing import Any, TypeVar, TypeVarTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

from colift.closed_loop import part_checks
from colift.math import so3
from colift.math.linalg import matmul
from colift.math.pytree import transfer
from colift.models.actuator_lag import ActuatorLag, RotorMixer, ring_mixer
from colift.scenario import schema
from colift.scenario.errors import ScenarioError

P = TypeVar("P")
Q = TypeVarTuple("Q")
KEPT_RESULTS = 4
"""Number of results of `once`; the priors of a team of one group take two."""


def array(numbers: object) -> Array:
    """Convert numbers to a float64 array without a weak type; `jnp.asarray` would compile a program for each shape."""
    return transfer(np.array(numbers, dtype=float))


def once(f: Callable[[*Q], P]) -> Callable[[*Q], P]:
    """Evaluate a function once for equal sections of a scenario.

    Arguments without a hash, such as settings of user-defined parts that contain lists, are evaluated each time.

    Args:
        f: Function whose result is immutable and depends on its arguments only.

    Returns:
        The function, which keeps its last results.
    """
    kept = functools.lru_cache(maxsize=KEPT_RESULTS)(f)

    @functools.wraps(f)
    def evaluate(*args: *Q) -> P:
        try:
            hash(args)
        except TypeError:
            return f(*args)
        return kept(*args)

    return evaluate


def rows(vectors: Iterable[schema.Vector]) -> Array:
    """Stack n vectors, also for n = 0, to an array `(n, 3)`."""
    return transfer(np.array(list(vectors), dtype=float).reshape(-1, 3))


def rotation(deg: schema.Vector) -> Array:
    """Return the rotation `R_z(yaw) R_y(pitch) R_x(roll)` for roll, pitch, yaw [deg]."""
    return _rotation(np.deg2rad(np.array(deg, dtype=float)).tobytes())


@functools.lru_cache(maxsize=256)
def _rotation(angles: bytes) -> Array:
    return _turned(np.frombuffer(angles))


@jax.jit
def _turned(angles: Array) -> Array:
    roll, pitch, yaw = jax.vmap(so3.exp)(jnp.diag(angles))
    return matmul(yaw, matmul(pitch, roll))


def actuator_lag(lag: schema.ActuatorLag, settings: schema.Scenario) -> ActuatorLag:
    """Return the lag, with its delay in control periods."""
    return ActuatorLag(bandwidth=array(lag.bandwidth_Hz), delay=round(lag.delay_s * settings.control_Hz))


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
    try:
        part = build(*arguments)
    except Exception as error:  # a user-defined method may raise any exception
        raise ScenarioError(f"{location}: {plugin.class_path}.build: {type(error).__name__}: {error}") from error
    built = f"{location}: {plugin.class_path} built a value of type {type(part).__name__}"
    if jax.tree_util.all_leaves([part]):
        raise ScenarioError(f"{built}, which is not a PyTree; decorate its class with `colift.math.pytree.pytree`")
    try:
        made = jax.tree.map(lambda x: x if isinstance(x, jax.Array) else jnp.asarray(np.asarray(x)), part)
    except TypeError as error:
        raise ScenarioError(
            f"{built} with a field that is not numeric ({error}); declare it by `colift.math.pytree.static`"
        ) from None
    if not isinstance(made, kind):
        missing = [name for name in vars(kind) if name[0] != "_" and not hasattr(made, name)]
        is_protocol = getattr(kind, "_is_protocol", False)
        reason = f"it has no method {', '.join(missing)}" if is_protocol else "its class must extend it"
        interface = f"{kind.__module__}.{kind.__name__}"
        raise ScenarioError(f"{built}, which does not fit {interface}: {reason} (docs/change_a_part.md)")
    return made


def check_plugin(check: Callable[..., None], *arguments: Any) -> None:
    """Check user-defined parts; their errors become errors of the scenario.

    Args:
        check: Function of `colift.closed_loop.part_checks`.
        *arguments: Its arguments.

    Raises:
        ScenarioError: If a part does not fit its interface.
    """
    try:
        check(*arguments)
    except part_checks.PartError as error:
        raise ScenarioError(f"{error} (docs/change_a_part.md)") from error


def rotor_settings(settings: schema.Scenario) -> schema.Rotors | None:
    """Return the rotors of every vehicle; None for actuators without limits of single rotors."""
    return settings.actuators.rotors if isinstance(settings.actuators, schema.LaggedMotors) else None


def rotor_mixer(ring: schema.Rotors, thrust_max: Array) -> RotorMixer:
    """Return the rotors of a group of agents.

    Args:
        ring: Settings of the rotors.
        thrust_max: Largest thrust of each agent [N].
    """
    return ring_mixer(ring.num_rotors, ring.radius_m, ring.moment_ratio_m, thrust_max / ring.num_rotors)
