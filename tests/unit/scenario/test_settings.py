"""Tests of number and use of the settings, and of fields that replace constants of algorithms."""

from __future__ import annotations

import re
import typing
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal

import jax
import numpy as np
from pydantic import BaseModel

from colift.models import actuator_lag
from colift.onboard.control import actuator_compensation
from colift.onboard.estimation import state_estimator
from colift.onboard.learning import kalman_correction, residual_predictors, semiparametric
from colift.scenario import Scenario, experiment, termination
from colift.scenario.schema_docs import unit_of
from colift.scenario.shipped import SHIPPED_DIRECTORY
from tests.support import small_team as light
from tests.support.varied_scenarios import changed

ROOT = Path(__file__).parents[3]
MAX_SETTINGS = 201


def sections(found: tuple[type[BaseModel], ...] = (Scenario,)) -> tuple[type[BaseModel], ...]:
    """All section classes of a scenario."""
    inside = [field.annotation for section in found for field in section.model_fields.values()]
    more = dict.fromkeys((*found, *(section for annotation in inside for section in section_classes(annotation))))
    return found if len(more) == len(found) else sections(tuple(more))


def section_classes(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inside in typing.get_args(annotation):
        yield from section_classes(inside)


def declarations() -> set[tuple[str, str]]:
    """Each setting with the class that declares it first; sections that inherit it may change default and range."""
    return {
        ([of.__name__ for of in section.__mro__ if name in vars(of).get("__annotations__", {})][-1], name)
        for section in sections()
        for name in section.model_fields
    }


def selectors() -> tuple[set[tuple[str, str]], set[str]]:
    """Settings that select one of several variants, as declared by the variants, and the settings that hold these."""
    values = {
        (section.__name__, name)
        for section in sections()
        for name, field in section.model_fields.items()
        if typing.get_origin(field.annotation) is Literal and field.is_required()
    }
    schema = Scenario.model_json_schema()
    held = {
        f"{title}.{name}"
        for title, section in (("Scenario", schema), *schema["$defs"].items())
        for name, node in section.get("properties", {}).items()
        if "discriminator" in node or "discriminator" in node.get("items", {})
    }
    return values, held


def test_a_scenario_has_at_most_201_settings():
    """A setting counts once in the class that declares it, and a selector such as `kind` once where it stands."""
    values, held = selectors()
    assert {name for _, name in values} == {"kind", "type"}
    assert held == {
        "AgentType.joints",
        "Scenario.actuators",
        "Scenario.allocation",
        "Scenario.contact_forces",
        "Scenario.disturbances",
        "Scenario.faults",
        "Scenario.physics",
        "Scenario.reference",
        "Sensors.models",
    }
    generated = {("Sampled", "tables")}  # content of a table, which no file states
    assert len(declarations() - values - generated) + len(held) <= MAX_SETTINGS


def test_an_inherited_setting_keeps_its_unit():
    """A setting that several sections share has one unit; its default and range may differ."""
    units: dict[tuple[str, str], set[str]] = {}
    for section in sections():
        for name, node in section.model_json_schema().get("properties", {}).items():
            owner = [of.__name__ for of in section.__mro__ if name in vars(of).get("__annotations__", {})][-1]
            units.setdefault((owner, name), set()).add(unit_of(node, (name,)))
    assert all(len(found) == 1 for found in units.values())


def test_every_setting_is_used_by_a_scenario_a_test_or_a_page():
    pages = [path for path in (ROOT / "docs").rglob("*.md") if path.name != "scenarios.md"]
    sources = [*ROOT.glob("tests/**/*.py"), *ROOT.glob("tests/**/*.yaml"), *ROOT.glob("examples/*.py"), *pages]
    texts = [path.read_text(encoding="utf-8") for path in sources]
    texts += [file.read_text(encoding="utf-8") for file in SHIPPED_DIRECTORY.iterdir() if file.name.endswith(".yaml")]
    words = {word for text in texts for word in re.findall(r"\w+", text)}
    assert not {name for _, name in declarations()} - words


def test_rotors_limit_thrust_and_torque_jointly():
    rotors = {"num_rotors": 4, "radius_m": 0.25, "moment_ratio_m": 0.016}
    settings = light.settings(actuators={"kind": "motors", "bandwidth_Hz": 20.0, "rotors": rotors})
    limits = experiment.make_experiment(settings, "C1").world.actuators.limits
    assert all(isinstance(limit, actuator_lag.RotorMixer) for limit in limits)
    np.testing.assert_allclose(limits[0].force_max, 10.0)


def test_constants_of_algorithms_have_their_stated_values():
    """Defaults of fields are strongly typed float64 arrays, as values from a scenario are."""
    settings = changed("paper", nominal={"actuators": {"bandwidth_Hz": 10.0}})
    made = experiment.make_experiments(settings, ("adaptive", "gp_label_feedback"))
    controller, held = made["adaptive"].controller, made["gp_label_feedback"].controller.residual_predictor
    assert isinstance(held, residual_predictors.CorrectedResidual)
    corrector, estimator, lag = controller.residual_corrector, controller.estimator, controller.actuator_compensator
    assert isinstance(corrector, kalman_correction.ResidualKalmanFilter)
    assert isinstance(estimator, state_estimator.ComplementaryFilter)
    assert isinstance(lag, actuator_compensation.LagInversion)
    values = {
        "averaging_time": corrector.averaging_time,
        "decay_rate": corrector.decay_rate,
        "max_bandwidth": corrector.max_bandwidth,
        "noise_averaging_time": corrector.noise_averaging_time,
        "max_reading_age": estimator.contact_forces.max_reading_age,
        "bandwidth_ratio": lag.bandwidth_ratio,
        "preview_step": controller.preview_step,
        "lead_time": held.lead_time,
    }
    assert {name: float(value) for name, value in values.items()} == {
        "averaging_time": 1.0,
        "decay_rate": 1.0,
        "max_bandwidth": 10.0,
        "noise_averaging_time": 5.0,
        "max_reading_age": 0.02,
        "bandwidth_ratio": 2.0,
        "preview_step": 0.03,
        "lead_time": 0.02,
    }
    assert all(value.dtype == float and not value.weak_type for value in jax.tree.leaves(values))
    assert semiparametric.MeanPrior.median_rate == 1 / 300
    assert (termination.MIN_GRASP_RATIO, termination.HOVER_THRUST_MARGIN) == (0.01, 0.1)
