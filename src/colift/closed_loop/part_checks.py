"""Checks of controller parts that are not colift's own, before a simulation is compiled.

Each part is called once on abstract values. An error names the part, the method and what the interface requires.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp

from colift.closed_loop.flight import Experiment
from colift.models.state import ControlClock
from colift.onboard import interfaces
from colift.onboard.controller import LeaderFollowerController

PARTS: dict[str, type] = {
    "estimator": interfaces.Estimator,
    "residual_predictor": interfaces.ResidualPredictor,
    "payload_controller": interfaces.PayloadController,
    "allocator": interfaces.Allocator,
    "agent_controller": interfaces.AgentController,
    "actuator_compensator": interfaces.ActuatorCompensator,
}
"""Parts of `LeaderFollowerController` and their interfaces."""
STATEFUL = {("estimator", "update"), ("payload_controller", "compute"), ("actuator_compensator", "command")}
"""Methods that return a result and the next state of the part."""
STATE_ARGUMENT = {"estimator": 1, "payload_controller": 0, "actuator_compensator": 1}
"""Position of the state among the arguments of these methods."""


class PartError(TypeError):
    """A part does not fit its interface."""


def check_parts(experiment: Experiment) -> None:
    """Check the parts of an experiment's controller that are not colift's own.

    Args:
        experiment: Experiment; its controller is evaluated once on abstract values if a part is a user's own.

    Raises:
        PartError: If a part is no PyTree, lacks a method, returns no state, or returns another structure, shape or
            type than its interface requires, or if a Python condition depends on an array.
    """
    controller = experiment.controller
    if not isinstance(controller, LeaderFollowerController):
        return
    own = {name: part for name in PARTS if not _is_builtin(part := getattr(controller, name))}
    for name, part in own.items():
        _check_class(name, part)
    if not own:
        return
    checked = {name: _CheckedPart(name, part) for name, part in own.items()}
    world, dt = experiment.world, jnp.asarray(experiment.dt)
    measurement = world.measure_at_rest(experiment.initial_state)
    clock = ControlClock(t=jnp.zeros(()), dt=dt)

    def evaluate(measurement: Any) -> Any:
        tested = dataclasses.replace(controller, **checked)
        _, state = tested.init(measurement, clock)
        return tested.step(state, measurement, clock)[:2]

    jax.eval_shape(evaluate, measurement)


def _is_builtin(part: object) -> bool:
    """Return whether this package defines the class of a part."""
    return type(part).__module__.split(".")[0] == "colift"


def _check_class(name: str, part: object) -> None:
    """Raise PartError unless a part is a PyTree with the methods of its interface."""
    kind, protocol = type(part).__name__, PARTS[name]
    if jax.tree_util.all_leaves([part]):
        raise PartError(f"{name}: {kind} is not a PyTree; decorate the class with `colift.math.pytree.pytree`")
    if missing := [method for method in _methods(protocol) if not callable(getattr(part, method, None))]:
        raise PartError(f"{name}: {kind} has no method {', '.join(missing)}; {protocol.__name__} requires it")


class _CheckedPart:
    """Stand-in for a part that checks every call.

    The methods of the interface are attributes: since Python 3.12 `isinstance` of a protocol ignores `__getattr__`.
    """

    def __init__(self, name: str, part: object) -> None:
        self._name, self._part = name, part
        for method in _methods(PARTS[name]):
            setattr(self, method, self.__getattr__(method))

    def __getattr__(self, method: str) -> Any:
        value = getattr(self._part, method)
        return _checked(self._name, type(self._part).__name__, method, value) if callable(value) else value


def _methods(protocol: type) -> list[str]:
    """Return the names of the methods of an interface."""
    return [name for name, value in vars(protocol).items() if not name.startswith("_") and callable(value)]


def _checked(name: str, kind: str, method: str, function: Callable[..., Any]) -> Callable[..., Any]:
    """Return a method whose errors and results are checked."""
    where = f"{name}: {kind}.{method}"

    def call(*arguments: Any, **keywords: Any) -> Any:
        try:
            result = function(*arguments, **keywords)
        except jax.errors.TracerBoolConversionError as error:
            raise PartError(
                f"{where}: a Python condition depends on an array; use `jnp.where` or `jax.lax.cond` instead of `if`"
            ) from error
        except PartError:
            raise
        except Exception as error:
            raise PartError(f"{where}: {type(error).__name__}: {error}") from error
        if (name, method) in STATEFUL:
            _check_state(where, result, arguments[STATE_ARGUMENT[name]])
        if name == "payload_controller" and method == "compute":
            _check_command(where, result[0])
        return result

    return call


def _check_state(where: str, result: Any, state: Any) -> None:
    """Raise PartError unless a method returned a result and a next state like the previous one."""
    if not (isinstance(result, tuple) and len(result) == 2):
        raise PartError(f"{where}: returned {type(result).__name__}; must return (result, next state)")
    before, after = (jax.tree.map(_shape, value) for value in (state, result[1]))
    if jax.tree.structure(before) != jax.tree.structure(after):
        raise PartError(
            f"{where}: the next state has structure {jax.tree.structure(after)}; "
            f"must be that of `init`, {jax.tree.structure(before)}"
        )
    if jax.tree.leaves(before) != jax.tree.leaves(after):
        raise PartError(
            f"{where}: the next state has shapes and types {jax.tree.leaves(after)}; "
            f"must be those of `init`, {jax.tree.leaves(before)}"
        )


def _check_command(where: str, command: Any) -> None:
    """Raise PartError unless an acceleration command has three float64 entries in each field."""
    for field in ("a", "alpha", "jerk"):
        value = getattr(command, field, None)
        if value is None or _shape(value) != "float64[3]":
            found = "nothing" if value is None else _shape(value)
            raise PartError(f"{where}: `{field}` is {found}; must be float64[3]")


def _shape(value: Any) -> str:
    """Return type and shape of an array as text, such as `float64[3]`."""
    array = jnp.asarray(value)
    return f"{array.dtype}[{','.join(map(str, array.shape))}]"
