"""Errors of parts that do not fit their interface: part, method, what is required and what was returned."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any, ClassVar

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import flight, part_checks
from colift.math.pytree import pytree, static
from colift.onboard.control import payload_controllers
from colift.onboard.learning import residual_correction
from colift.scenario import experiment
from colift.simulation.actuators import IdealActuators
from colift.simulation.disturbances import DisturbanceModel
from colift.simulation.sensors import SensorModel
from colift.trajectories import base
from tests.support import small_team as light


@functools.cache
def built() -> flight.Experiment:
    return experiment.make_experiment(light.settings(), "C1")


def with_parts(**parts: Any) -> flight.Experiment:
    """The smallest team with other parts of its controller."""
    return dataclasses.replace(built(), controller=dataclasses.replace(built().controller, **parts))


def with_world(**parts: Any) -> flight.Experiment:
    return dataclasses.replace(built(), world=dataclasses.replace(built().world, **parts))


def refused(made: flight.Experiment) -> str:
    """Return the message of the error, which is one line."""
    with pytest.raises(part_checks.PartError) as error:
        part_checks.check_parts(made)
    assert "\n" not in str(error.value)
    return str(error.value)


def with_last_field(value: Any, x: Any) -> Any:
    """Return a PyTree with another last array, without the run-time check of its shape."""
    leaves, structure = jax.tree.flatten(value)
    return jax.tree.unflatten(structure, [*leaves[:-1], x])


# Controller -----------------------------------------------------------------------------------------------------------


@pytree
class Own:
    """A payload controller of a user; `fault` selects what is wrong with it."""

    base: Any
    gain: Any
    fault: str = static()

    def init(self) -> Any:
        return jnp.zeros(2)

    def compute(self, state: Any, context: Any) -> Any:
        command, _ = self.base.compute((), context)
        if self.fault == "no state":
            return command
        if self.fault == "other state":
            return command, jnp.zeros(3)
        if self.fault == "other result":
            return command.a, state
        if self.fault == "condition" and command.a[0] > 0:
            return command, state
        if self.fault == "no rate":
            return dataclasses.replace(command, alpha_dot=None), state
        if self.fault == "wrong rate":
            return with_last_field(command, jnp.zeros(2)), state
        if self.fault == "numpy":
            return dataclasses.replace(command, a=np.array(command.a)), state
        if self.fault == "key":
            return {}[self.fault], state
        return command, state


def own(fault: str) -> flight.Experiment:
    return with_parts(
        payload_controller=Own(base=built().controller.payload_controller, gain=jnp.ones(()), fault=fault)
    )


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("no state", "compute: returned AccelerationCommand; must return (result, next state)"),
        ("other state", "compute: the next state is float64[3]; must be float64[2] as before"),
        ("other result", "compute: the result is float64[3]; must be AccelerationCommand"),
        ("condition", "a Python condition depends on an array; use `jnp.where` or `jax.lax.cond` instead of `if`"),
        ("numpy", "a NumPy function is applied to an array of JAX; use `jax.numpy` instead"),
        ("wrong rate", "compute: `alpha_dot` of the result is float64[2]; must be float64[3]"),
        ("key", "KeyError: 'key'"),
    ],
)
def test_fault_is_named_with_part_and_method(fault: str, message: str):
    found = refused(own(fault))
    assert found.startswith("payload_controller: Own.compute")
    assert found.endswith(message)
    assert ("(test_part_checks.py:" in found) == (fault in ("condition", "numpy", "key"))  # the line of the user's code


@pytree
class OwnCorrector:
    """A residual corrector of a user without a correction."""

    fault: str = static()

    def init(self, team: Any) -> Any:
        return jnp.zeros(())

    def update(self, state: Any, observation: Any, clock: Any) -> Any:
        correction = residual_correction.zero_correction(observation.label, clock.t)
        if self.fault == "no weight":
            correction = dataclasses.replace(correction, weight=None)
        return correction, jnp.zeros(2) if self.fault == "other state" else state


def test_residual_corrector_is_checked():
    """A corrector that fits passes; a fault is named with part and method."""
    part_checks.check_parts(with_parts(residual_corrector=OwnCorrector(fault="")))
    for fault in ("other state", "no weight"):
        assert "residual_corrector: OwnCorrector.update" in refused(
            with_parts(residual_corrector=OwnCorrector(fault=fault))
        )


def test_parts_that_fit_pass():
    part_checks.check_parts(own(""))
    part_checks.check_parts(own("no rate"))  # the rate of the angular acceleration is optional
    part_checks.check_parts(built())


def test_own_part_within_a_part_of_colift_is_checked():
    inner = Own(base=built().controller.payload_controller, gain=jnp.ones(()), fault="no state")
    around = payload_controllers.IntegralAction(base=inner, K_i=jnp.array(1.0), k_i=jnp.array(1.0))
    assert "payload_controller: IntegralAction.compute" in refused(with_parts(payload_controller=around))


class Result:
    """A stand-in for a method whose result is given."""

    def __init__(self, name: str, method: str, result: Any) -> None:
        others = dict.fromkeys(part_checks._methods(part_checks.CONTROLLER_PARTS[name]))
        if (name, method) in part_checks.STATE_ARGUMENT:
            result = (result, ())
        part = type("Own", (), {**others, method: lambda *_: result})()
        expected = part_checks._expected_results(built().controller.team, built().initial_state)
        self.call = getattr(part_checks._CheckedPart(name, part, expected), method)


@pytest.mark.parametrize(
    ("name", "method", "result", "message"),
    [
        ("allocator", "allocate", jnp.zeros(3), "the result is float64[3]; must be ContactForceCommand"),
        ("agent_controller", "compute", (), r"the result is (); must be ((AgentInput), (bool[3]))"),
        ("residual_predictor", "predict", None, "the result is NoneType; must be ResidualForces"),
        ("actuator_compensator", "effective_command", (), "the result is (); must be (AgentInput)"),
    ],
)
def test_results_of_other_methods(name: str, method: str, result: Any, message: str):
    with pytest.raises(part_checks.PartError) as error:
        Result(name, method, result).call(())
    assert str(error.value) == f"{name}: Own.{method}: {message}"


def test_shapes_are_compared_by_entry():
    """A missing entry and a further one are named; internal-force coordinates may have any number."""
    lam = jnp.zeros((3, 3))
    wanted = {"lam": lam, "lam_dot": lam, "eta": jnp.zeros(0)}
    part_checks._check_value("here", "the result", {**wanted, "eta": jnp.zeros(3)}, wanted)
    for given, message in (
        ({"lam": lam, "lam_dot": lam[:2]}, "`lam_dot` of the result is float64[2,3]; must be float64[3,3]"),
        ({"lam": lam}, "`lam_dot` of the result is missing; must be float64[3,3]"),
        ({**wanted, "more": jnp.zeros(2, int)}, "`more` of the result is int64[2]; must be left out"),
    ):
        with pytest.raises(part_checks.PartError) as error:
            part_checks._check_value("here", "the result", given, wanted)
        assert str(error.value) == f"here: {message}"


def test_class_that_is_no_pytree_or_lacks_a_method():
    class Plain:
        def init(self):
            return ()

    pytree_without = pytree(type("Half", (), {"__annotations__": {}, "init": lambda _: ()}))()
    with pytest.raises(part_checks.PartError, match="payload_controller: Plain is not a PyTree; decorate"):
        part_checks._check_class("payload_controller", Plain(), part_checks.CONTROLLER_PARTS["payload_controller"])
    with pytest.raises(part_checks.PartError, match="Half has no method compute; PayloadController requires it"):
        part_checks._check_class(
            "payload_controller", pytree_without, part_checks.CONTROLLER_PARTS["payload_controller"]
        )


# World and reference --------------------------------------------------------------------------------------------------


@pytree
class Gust(DisturbanceModel):
    """A disturbance with a state; `fault` selects what is wrong with it."""

    fault: str = static()
    time_invariant: ClassVar[bool] = False

    def init(self) -> Any:
        return jnp.zeros(3)

    def __call__(self, at: Any, t: Any, state: Any) -> Any:
        return state if self.fault == "force only" else (state, jnp.zeros(3))

    def update(self, at: Any, t: Any, state: Any, dt: Any) -> Any:
        return state[:2] if self.fault == "other state" else state + dt


@pytree
class Silent(DisturbanceModel):
    """A disturbance without force."""

    time_invariant: ClassVar[bool] = True


@pytree
class Undeclared(Gust):
    """A disturbance that does not state whether it depends on time."""

    time_invariant: ClassVar[Any] = None


@pytest.mark.parametrize(
    ("model", "message"),
    [
        (Gust(fault="force only"), "Gust.__call__: the result is float64[3]; must be (float64[3], float64[3])"),
        (Gust(fault="other state"), "Gust.update: the next state is float64[2]; must be float64[3] as before"),
        (Silent(), "Silent.__call__: is not implemented"),
        (Undeclared(fault=""), "Undeclared has no class variable `time_invariant`; it must be True or False"),
    ],
)
def test_faulty_disturbance(model: DisturbanceModel, message: str):
    mounts = built().world.disturbances
    one = dataclasses.replace(mounts.payload[0], name="gust", model=model)
    made = with_world(disturbances=dataclasses.replace(mounts, payload=(one,)))
    assert refused(made) == f"disturbances.gust: {message}"


@pytree
class Beacon(SensorModel):
    """A sensor with noise; `fault` selects what is wrong with it."""

    fault: str = static()

    def sample_noise(self, team: Any, key: Any, ticks: int) -> Any:
        return jnp.zeros(3) if self.fault == "noise" else jnp.zeros((ticks, 3))

    def apply(self, measurement: Any, truth: Any, clock: Any, state: Any, noise: Any) -> Any:
        payload = measurement.payload
        if self.fault == "no state":
            return measurement
        if self.fault == "truth":
            return truth, state
        return dataclasses.replace(measurement, extra={"beacon": payload.p + noise}), state


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("noise", "sample_noise: the noise of 2 ticks has an entry float64[3]; the leading axis must be the time"),
        ("no state", "apply: returned Measurement; must return (result, next state)"),
        ("truth", "apply: the result is SensedState; must be Measurement"),
    ],
)
def test_faulty_sensor(fault: str, message: str):
    part_checks.check_parts(with_world(sensor_models=(Beacon(fault=""),)))
    assert refused(with_world(sensor_models=(Beacon(fault=""), Beacon(fault=fault)))).startswith(
        f"sensors.models.1: Beacon.{message}"
    )


@pytree
class Slow(IdealActuators):
    """Actuators of a user; `fault` selects what is wrong with them."""

    fault: str = static()

    def init(self, command: Any) -> Any:
        return command

    def __call__(self, command: Any, state: Any, clock: Any) -> Any:
        if self.fault == "no state":
            return command
        return (command[0].u, state) if self.fault == "thrust only" else (state, command)


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("no state", "returned (AgentInput); must return (result, next state)"),
        ("thrust only", "the result is float64[3]; must be (AgentInput)"),
    ],
)
def test_faulty_actuators(fault: str, message: str):
    part_checks.check_parts(with_world(actuators=Slow(fault="")))
    assert refused(with_world(actuators=Slow(fault=fault))) == f"actuators: Slow.__call__: {message}"


@pytree
class Still:
    """A reference of a user; `fault` selects what is wrong with it."""

    at: Any
    fault: str = static()

    def evaluate(self, t: Any) -> Any:
        if self.fault == "position only":
            return self.at
        at = base.differentiate_pose(lambda t: jnp.concatenate([self.at + 0 * t, jnp.zeros(3)]), jnp.eye(3), t)
        if self.fault == "no rate":
            return dataclasses.replace(at, omega_ddot=None)
        return with_last_field(at, jnp.zeros((3, 3))) if self.fault == "wrong rate" else at


@pytest.mark.parametrize("fault", ["", "no rate"])
def test_reference_may_neglect_the_rate_of_angular_acceleration(fault: str):
    part_checks.check_parts(with_parts(reference=Still(at=jnp.zeros(3), fault=fault)))


def test_faulty_reference():
    found = refused(with_parts(reference=Still(at=jnp.zeros(3), fault="wrong rate")))
    assert found == "reference: Still.evaluate: `omega_ddot` of the result is float64[3,3]; must be float64[3]"
    found = refused(with_parts(reference=Still(at=jnp.zeros(3), fault="position only")))
    assert found == "reference: Still.evaluate: the result is float64[3]; must be PayloadSetpoint"
