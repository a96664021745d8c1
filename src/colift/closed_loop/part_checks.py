"""Checks of user-defined parts, before a simulation is compiled.

Each part is called once on abstract values. An error names the part, the method, what the interface requires and what
was returned.

See Also:
    colift.onboard.interfaces: interfaces of the parts of the controller.
    docs/change_a_part: all parts that a user can replace.
"""

from __future__ import annotations

import dataclasses
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from types import TracebackType
from typing import Any

import jax
import jax.numpy as jnp

from colift.closed_loop.flight import Experiment
from colift.models.measurement import Measurement
from colift.models.parameters import Team
from colift.models.state import AgentInput, ControlClock, State, TeamInputs, zero_residual
from colift.onboard import interfaces
from colift.onboard.control import tracking
from colift.onboard.controller import LeaderFollowerController
from colift.onboard.estimation.state_estimator import StateEstimate
from colift.onboard.learning import residual_correction
from colift.simulation import actuators, contact_dynamics, disturbances, sensors
from colift.simulation.world import Plant, SimulatedWorld, World
from colift.trajectories import base

CONTROLLER_PARTS: dict[str, type] = {
    "estimator": interfaces.Estimator,
    "residual_corrector": residual_correction.ResidualCorrector,
    "residual_predictor": interfaces.ResidualPredictor,
    "payload_controller": interfaces.PayloadController,
    "allocator": interfaces.Allocator,
    "agent_controller": interfaces.AgentController,
    "actuator_compensator": interfaces.ActuatorCompensator,
}
"""Parts of `LeaderFollowerController` and their interfaces."""
STATE_ARGUMENT = {
    ("estimator", "update"): 1,
    ("residual_corrector", "update"): 0,
    ("payload_controller", "compute"): 0,
    ("allocator", "allocate"): 0,
    ("agent_controller", "compute"): 0,
    ("actuator_compensator", "command"): 1,
}
"""Position of the state among the arguments of the methods that return a result and the next state."""
OPTIONAL_ENTRIES = ("eta", "sample", "acceleration", "report")
"""Entries of a result that are not compared: internal-force coordinates of any number, the training sample, and the
achieved acceleration and the report of an allocator with limits."""
OPTIONAL_ARRAYS = ("alpha_dot", "omega_ddot")
"""Fields of a result that may be None: higher derivatives, which the control law then neglects."""
LIBRARIES = str(Path(__file__).parents[1]), str(Path(jax.__file__).parent), "<"
"""Beginnings of the file names of code that is not the user's."""


class PartError(TypeError):
    """A part does not fit its interface."""


def check_parts(experiment: Experiment[World]) -> None:
    """Check the user-defined parts of an experiment.

    Args:
        experiment: Experiment; parts of a user are called once on abstract values.

    Raises:
        PartError: If a part is not a PyTree, lacks a method, returns another structure, shape or type than its
            interface requires, or if a Python condition depends on an array.
    """
    world, controller, clock = experiment.world, experiment.controller, _clock(experiment.dt)
    if isinstance(world, SimulatedWorld):
        _check_world(world, experiment.initial_state, clock)
    elif not _is_builtin(world):
        _check_class("world", world, World)
    if isinstance(controller, LeaderFollowerController):
        check_reference(controller.reference)
        _check_controller(controller, world, experiment.initial_state, clock)
    elif not _is_builtin(controller):
        _check_class("controller", controller, interfaces.Controller)


def _clock(dt: float) -> ControlClock:
    """Return the clock of the first control period."""
    return ControlClock(t=jnp.zeros(()), dt=jnp.asarray(dt))


# Controller -----------------------------------------------------------------------------------------------------------


def _check_controller(controller: LeaderFollowerController, world: World, state: State, clock: ControlClock) -> None:
    """Check the parts of a controller by one control period in which every call of them is checked."""
    own = {name: part for name in CONTROLLER_PARTS if not _is_builtin(part := getattr(controller, name))}
    for name, part in own.items():
        _check_class(name, part, CONTROLLER_PARTS[name])
    if not own:
        return
    expected = _expected_results(controller.team, state)
    checked: dict[str, Any] = {name: _CheckedPart(name, part, expected) for name, part in own.items()}

    def evaluate(state: State) -> Any:
        measurement = world.measure_at_rest(state)
        tested = dataclasses.replace(controller, **checked)
        _, controller_state = tested.init(measurement, clock)
        return tested.step(controller_state, measurement, clock)[:2]

    jax.eval_shape(evaluate, state)


def _expected_results(team: Team, state: State) -> dict[tuple[str, str], Any]:
    """Return an example of the result of each method, without the next state."""
    inputs, contacts, vector = _zero_inputs(team), jnp.zeros((team.contacts, 3)), jnp.zeros(3)
    lam = tuple(group.contact_position for group in team.agent_groups)
    return {
        ("estimator", "update"): StateEstimate(agents=state.agents, payload=state.payload, a_L=jnp.zeros(6), lam=lam),
        ("residual_corrector", "update"): residual_correction.zero_correction(zero_residual(team), jnp.zeros(())),
        ("residual_predictor", "predict"): zero_residual(team),
        ("payload_controller", "compute"): tracking.AccelerationCommand(
            a=vector, alpha=vector, jerk=vector, alpha_dot=vector
        ),
        ("allocator", "allocate"): interfaces.ContactForceCommand(lam=contacts, lam_dot=contacts, eta=jnp.zeros(0)),
        ("agent_controller", "compute"): (inputs, tuple(jnp.zeros(size, bool) for size in team.sizes)),
        ("actuator_compensator", "command"): inputs,
        ("actuator_compensator", "effective_command"): inputs,
    }


def _zero_inputs(team: Team) -> TeamInputs:
    """Return zero inputs of all agents."""
    return tuple(
        AgentInput(u=jnp.zeros(size), tau=jnp.zeros((size, 3)), tau_r=jnp.zeros((size, group.tree.joints)))
        for size, group in zip(team.sizes, team.agent_groups, strict=True)
    )


class _CheckedPart:
    """Stand-in for a part of the controller that checks every call.

    The methods of the interface are attributes: since Python 3.12 `isinstance` of a protocol ignores `__getattr__`.
    """

    def __init__(self, name: str, part: object, expected: Mapping[tuple[str, str], Any]) -> None:
        self._name, self._part, self._expected = name, part, expected
        for method in _methods(CONTROLLER_PARTS[name]):
            setattr(self, method, self.__getattr__(method))

    def __getattr__(self, method: str) -> Any:
        value, name = getattr(self._part, method), self._name
        if not callable(value):
            return value
        where = f"{name}: {type(self._part).__name__}.{method}"

        def call(*arguments: Any) -> Any:
            returned = result = _call(where, value, *arguments)
            if (name, method) in STATE_ARGUMENT:
                result = _check_state(where, returned, arguments[STATE_ARGUMENT[name, method]])
            elif (name, method) == ("residual_predictor", "update"):
                _check_value(where, "the next state", returned, arguments[0], " as before")
            if (expected := self._expected.get((name, method))) is not None:
                _check_value(where, "the result", result, expected)
            return returned

        return call


# World and reference --------------------------------------------------------------------------------------------------


def check_reference(reference: object) -> None:
    """Check a user-defined reference trajectory.

    Args:
        reference: Reference trajectory.

    Raises:
        PartError: If it does not fit `ReferenceTrajectory`.
    """
    if _is_builtin(reference):
        return
    _check_class("reference", reference, base.ReferenceTrajectory)
    vector = jnp.zeros(3)
    expected = base.PayloadSetpoint(
        p=vector, v=vector, a=vector, j=vector, R=jnp.eye(3), omega=vector, omega_dot=vector, omega_ddot=vector
    )
    where = f"reference: {type(reference).__name__}.evaluate"

    def evaluate(t: jax.Array) -> None:
        _check_value(where, "the result", _call(where, getattr(reference, "evaluate"), t), expected)  # noqa: B009

    jax.eval_shape(evaluate, jnp.zeros(()))


def check_disturbance(name: str, model: disturbances.DisturbanceModel) -> None:
    """Check a user-defined disturbance.

    Args:
        name: Name of the disturbance.
        model: Disturbance of one point.

    Raises:
        PartError: If it does not fit `DisturbanceModel`.
    """
    if _is_builtin(model):
        return
    label, kind = f"disturbances.{name}", type(model).__name__
    _check_class(label, model, disturbances.DisturbanceModel)
    if not isinstance(getattr(model, "time_invariant", None), bool):
        raise PartError(f"{label}: {kind} has no class variable `time_invariant`; it must be True or False")
    vector = jnp.zeros(3)
    at = disturbances.PointKinematics(x=vector, v=vector, R=jnp.eye(3), omega=vector)

    def evaluate(model: Any, at: disturbances.PointKinematics, t: jax.Array) -> None:
        state = _call(f"{label}: {kind}.init", model.init)
        wrench = _call(f"{label}: {kind}.__call__", model, at, t, state)
        _check_value(f"{label}: {kind}.__call__", "the result", wrench, (vector, vector))
        next_state = _call(f"{label}: {kind}.update", model.update, at, t, state, t)
        _check_value(f"{label}: {kind}.update", "the next state", next_state, state, " as before")

    jax.eval_shape(evaluate, model, at, jnp.zeros(()))


def _check_world(world: SimulatedWorld, state: State, clock: ControlClock) -> None:
    """Check the parts of a simulated world."""
    for disturbance in world.disturbances.payload:
        check_disturbance(disturbance.name, disturbance.model)
    for group in world.disturbances.agents:
        for mounted in group:
            if not _is_builtin(mounted.model):
                check_disturbance(mounted.name, jax.tree.map(lambda x: x[0], mounted.model))
    parts = (world.plant, world.actuators, *world.sensor_models)
    if all(map(_is_builtin, parts)):
        return

    def evaluate(state: State) -> None:
        _check_actuators(world, clock)
        _check_plant(world, state)
        _check_sensors(world, state, clock)

    jax.eval_shape(evaluate, state)


def _check_actuators(world: SimulatedWorld, clock: ControlClock) -> None:
    """Check the actuators of a world."""
    if _is_builtin(part := world.actuators):
        return
    _check_class("actuators", part, actuators.IdealActuators)
    kind, command = f"actuators: {type(part).__name__}", _zero_inputs(world.team)
    state = _call(f"{kind}.init", part.init, command)
    result = _call(f"{kind}.__call__", part, command, state, clock)
    _check_value(f"{kind}.__call__", "the result", _check_state(f"{kind}.__call__", result, state), command)


def _check_plant(world: SimulatedWorld, state: State) -> None:
    """Check the plant of a world."""
    if _is_builtin(part := world.plant):
        return
    _check_class("plant", part, Plant)
    kind, team, inputs = f"plant: {type(part).__name__}", world.team, _zero_inputs(world.team)
    expected = (
        contact_dynamics.Acceleration(
            agents=tuple(
                contact_dynamics.AgentAcceleration(v_dot=q.v, xi_dot=jnp.concatenate([q.omega, q.r_dot], axis=1))
                for q in state.agents
            ),
            payload=jnp.zeros(6),
        ),
        tuple(group.contact_position for group in team.agent_groups),
    )
    f = zero_residual(team)
    result = _call(f"{kind}.forward_dynamics", part.forward_dynamics, team, state, inputs, f)
    _check_value(f"{kind}.forward_dynamics", "the result", result, expected)
    after = _call(f"{kind}.step", part.step, team, state, inputs, lambda _z, _t: f, jnp.asarray(1e-3))
    _check_value(f"{kind}.step", "the result", after, state)


def _check_sensors(world: SimulatedWorld, state: State, clock: ControlClock) -> None:
    """Check the additional sensors of a world, each with the measurement of those before it."""
    measurement = dataclasses.replace(world, sensor_models=()).measure_at_rest(state)
    truth, key = world.sensed_at_rest(state), jax.random.key(0)
    for k, part in enumerate(world.sensor_models):
        label = f"sensors.models.{k}"
        if not _is_builtin(part):
            _check_class(label, part, sensors.SensorModel)
        kind = f"{label}: {type(part).__name__}"
        noise = _call(f"{kind}.sample_noise", part.sample_noise, world.team, key, 2)
        for leaf in jax.tree.leaves(noise):
            if jnp.shape(leaf)[:1] != (2,):
                raise PartError(
                    f"{kind}.sample_noise: the noise of 2 ticks has an entry {_describe(leaf)}; "
                    "the leading axis must be the time, of length 2"
                )
        sensor_state = _call(f"{kind}.init", part.init, measurement)
        now = jax.tree.map(lambda x: x[0], noise)
        result = _call(f"{kind}.apply", part.apply, measurement, truth, clock, sensor_state, now)
        after = _check_state(f"{kind}.apply", result, sensor_state)
        measurement = _check_measurement(f"{kind}.apply", after, measurement)


def _check_measurement(where: str, after: Any, before: Measurement) -> Measurement:
    """Raise PartError unless a sensor returned a measurement whose agents and payload have the same shapes."""
    if not isinstance(after, Measurement):
        raise PartError(f"{where}: the result is {_describe(after)}; must be Measurement")
    _check_value(where, "the readings of the agents", after.agents, before.agents)
    _check_value(where, "the readings of the payload", after.payload, before.payload)
    return after


# Calls and values -----------------------------------------------------------------------------------------------------


def _is_builtin(part: object) -> bool:
    """Return whether this package defines the classes of a part and of the parts in it."""
    if isinstance(part, tuple):
        return all(map(_is_builtin, part))
    package = type(part).__module__.partition(".")[0]
    if package != "colift":
        return package in ("builtins", "numpy", "jax", "jaxlib")  # numbers, arrays, text
    fields = dataclasses.fields(part) if dataclasses.is_dataclass(part) else ()
    return all(_is_builtin(getattr(part, field.name)) for field in fields)


def _check_class(name: str, part: object, interface: type) -> None:
    """Raise PartError unless a part is a PyTree with the methods of its interface."""
    kind = type(part).__name__
    if jax.tree_util.all_leaves([part]):
        raise PartError(f"{name}: {kind} is not a PyTree; decorate the class with `colift.math.pytree.pytree`")
    if missing := [method for method in _methods(interface) if not callable(getattr(part, method, None))]:
        raise PartError(f"{name}: {kind} has no method {', '.join(missing)}; {interface.__name__} requires it")


def _methods(interface: type) -> list[str]:
    """Return the names of the methods of an interface."""
    return [
        method
        for method, value in vars(interface).items()
        if (not method.startswith("_") or method == "__call__") and callable(value)
    ]


def _call(where: str, function: Callable[..., Any], *arguments: Any) -> Any:
    """Call a method of a part; an exception becomes a PartError with the line of the user's code."""
    try:
        return function(*arguments)
    except PartError:
        raise
    except Exception as error:
        first = str(error).strip().partition("\n")[0]
        reasons = (reason for kind, reason in REASONS.items() if isinstance(error, kind))
        reason = next(reasons, f"{type(error).__name__}: {first}")
        raise PartError(f"{where}{_line(error.__traceback__)}: {reason}") from error


REASONS: dict[type[Exception], str] = {
    jax.errors.TracerBoolConversionError: "a Python condition depends on an array; use `jnp.where` or `jax.lax.cond` "
    "instead of `if`",
    jax.errors.TracerArrayConversionError: "a NumPy function is applied to an array of JAX; use `jax.numpy` instead",
    jax.errors.ConcretizationTypeError: "an array is converted to a Python number; use `jax.numpy` instead",
    NotImplementedError: "is not implemented",
}
"""Reasons of exceptions in a user's method."""


def _line(error: TracebackType | None) -> str:
    """Return file and line of the last call in a user's code, such as ` (parts.py:12)`; empty if there is none."""
    frames = [frame for frame in traceback.extract_tb(error) if not frame.filename.startswith(LIBRARIES)]
    return f" ({Path(frames[-1].filename).name}:{frames[-1].lineno})" if frames else ""


def _check_state(where: str, result: Any, state: Any) -> Any:
    """Raise PartError unless a method returned a result and a next state like the previous one; return the result."""
    if not (isinstance(result, tuple) and len(result) == 2):
        raise PartError(f"{where}: returned {_describe(result)}; must return (result, next state)")
    _check_value(where, "the next state", result[1], state, " as before")
    return result[0]


def _check_value(where: str, label: str, value: Any, expected: Any, note: str = "") -> None:
    """Raise PartError unless a value has the structure, shapes and types of an expected one."""
    if _describe(value) != _describe(expected):
        raise PartError(f"{where}: {label} is {_describe(value)}; must be {_describe(expected)}{note}")
    given, required = _leaves(value), _leaves(expected)
    for path in (*required, *given):
        found, wanted = given.get(path, "missing"), required.get(path, "left out")
        is_neglected = path not in given and path.rpartition(".")[2] in OPTIONAL_ARRAYS
        if found != wanted and not is_neglected:
            raise PartError(f"{where}: `{path}` of {label} is {found}; must be {wanted}{note}")


def _leaves(value: Any) -> dict[str, str]:
    """Return type and shape of every compared array of a PyTree by its path."""
    leaves = jax.tree_util.tree_leaves_with_path(value)
    paths = ((jax.tree_util.keystr(path, simple=True, separator="."), leaf) for path, leaf in leaves)
    return {path: _describe(leaf) for path, leaf in paths if path.partition(".")[0] not in OPTIONAL_ENTRIES}


def _describe(value: Any) -> str:
    """Return type and shape of an array, such as `float64[3]`, or the class of another value."""
    if isinstance(value, tuple):
        entries = (_describe(entry) for entry in value)
        return f"({', '.join(entries)})"
    if isinstance(value, jax.Array | float | int) or hasattr(value, "dtype"):
        array = jnp.asarray(value)
        return f"{array.dtype}[{','.join(map(str, array.shape))}]"
    return type(value).__name__
