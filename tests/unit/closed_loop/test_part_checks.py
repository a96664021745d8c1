"""Tests of errors for controller parts that do not implement their interface."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax.numpy as jnp
import pytest

from colift.closed_loop import flight, part_checks
from colift.math.pytree import pytree
from colift.onboard.interfaces import PayloadController
from colift.scenario import experiment
from tests.support import small_team as light


@pytree
class CustomPayloadController:
    """User-defined payload controller; `fault` selects its error."""

    base: PayloadController
    gain: Any
    fault: str = dataclasses.field(metadata={"static": True})

    def init(self) -> Any:
        return jnp.zeros(2)

    def compute(self, state: Any, context: Any) -> Any:
        command, _ = self.base.compute((), context)
        if self.fault == "no state":
            return command
        if self.fault == "other state":
            return command, jnp.zeros(3)
        if self.fault == "shape":
            return dataclasses.replace(command, a=command.a[:2]), state
        if self.fault == "condition" and command.a[0] > 0:
            return command, state
        return command, state


def with_fault(fault: str) -> flight.Experiment:
    made = experiment.make_experiment(light.settings(), "C1")
    part = CustomPayloadController(base=made.controller.payload_controller, gain=jnp.ones(()), fault=fault)
    return dataclasses.replace(made, controller=dataclasses.replace(made.controller, payload_controller=part))


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ("no state", r"payload_controller: CustomPayloadController.compute: returned AccelerationCommand; must return"),
        (
            "other state",
            r"CustomPayloadController.compute: the next state has shapes and types \['float64\[3\]'\]; "
            "must be those of `init`",
        ),
        ("shape", r"payload_controller: CustomPayloadController.compute: .*"),  # in tests beartype reports it first
        ("condition", r"CustomPayloadController.compute: a Python condition depends on an array; use `jnp.where`"),
    ],
)
def test_fault_is_named_with_part_and_method(fault: str, message: str):
    with pytest.raises(part_checks.PartError, match=message):
        part_checks.check_parts(with_fault(fault))


def test_valid_part_passes():
    part_checks.check_parts(with_fault(""))


def test_class_without_pytree_is_refused():
    class Plain:
        def init(self):
            return ()

    with pytest.raises(part_checks.PartError, match="payload_controller: Plain is not a PyTree"):
        part_checks._check_class("payload_controller", Plain())


def test_command_of_another_shape_is_refused():
    class Command:
        a, alpha, jerk = jnp.zeros(2), jnp.zeros(3), jnp.zeros(3)

    with pytest.raises(part_checks.PartError, match=r"`a` is float64\[2\]; must be float64\[3\]"):
        part_checks._check_command("payload_controller: CustomPayloadController.compute", Command())
