"""Tests of number and use of the settings, and of fields that replace constants of algorithms."""

from __future__ import annotations

import re
from pathlib import Path

import jax
import numpy as np

from colift.onboard.control import actuator_compensation
from colift.onboard.estimation import state_estimator
from colift.onboard.learning import online_learner, residual_correction
from colift.scenario import Scenario, experiment
from colift.scenario.loading import SHIPPED_DIRECTORY
from colift.simulation import actuators
from tests.support import small_team as light
from tests.support.varied_scenarios import changed

ROOT = Path(__file__).parents[3]
MAX_SETTINGS = 180


def setting_names() -> set[str]:
    """Return names of all settings of a scenario; a name has one meaning in all sections."""
    schema = Scenario.model_json_schema()
    return {name for section in (schema, *schema["$defs"].values()) for name in section.get("properties", {})}


def test_a_scenario_has_at_most_180_settings():
    assert len(setting_names()) <= MAX_SETTINGS


def test_every_setting_is_used_by_a_scenario_a_test_or_a_page():
    pages = [path for path in (ROOT / "docs").rglob("*.md") if path.name != "scenarios.md"]
    sources = [*ROOT.glob("tests/**/*.py"), *ROOT.glob("tests/**/*.yaml"), *ROOT.glob("examples/*.py"), *pages]
    texts = [path.read_text(encoding="utf-8") for path in sources]
    texts += [file.read_text(encoding="utf-8") for file in SHIPPED_DIRECTORY.iterdir() if file.name.endswith(".yaml")]
    words = {word for text in texts for word in re.findall(r"\w+", text)}
    assert not setting_names() - words


def test_rotors_limit_thrust_and_torque_jointly():
    rotors = {"num_rotors": 4, "radius_m": 0.25, "moment_ratio_m": 0.016}
    settings = light.settings(actuators={"kind": "motors", "bandwidth_Hz": 20.0, "rotors": rotors})
    limits = experiment.make_experiment(settings, "C1").world.actuators.limits
    assert all(isinstance(limit, actuators.RotorMixer) for limit in limits)
    np.testing.assert_allclose(limits[0].force_max, 10.0)


def test_constants_of_algorithms_have_their_former_values():
    """Defaults of fields are strongly typed float64 arrays, as values from a scenario are."""
    settings = changed("paper", nominal={"actuators": {"bandwidth_Hz": 10.0}})
    controller = experiment.make_experiment(settings, "adaptive").controller
    correction, estimator, lag = controller.innovation_filter, controller.estimator, controller.actuator_compensator
    assert isinstance(correction, residual_correction.InnovationFilter)
    assert isinstance(estimator, state_estimator.ComplementaryFilter)
    assert isinstance(lag, actuator_compensation.LagInversion)
    values = {
        "decay_time": correction.decay_time,
        "variance_ratio": correction.variance_ratio,
        "coherence": correction.coherence,
        "max_reading_age": estimator.max_reading_age,
        "bandwidth_ratio": lag.bandwidth_ratio,
    }
    assert {name: float(value) for name, value in values.items()} == {
        "decay_time": 0.3,
        "variance_ratio": 10.0,
        "coherence": 0.2,
        "max_reading_age": 0.02,
        "bandwidth_ratio": 2.0,
    }
    assert all(value.dtype == float and not value.weak_type for value in jax.tree.leaves(values))
    options = online_learner.OnlineUpdateOptions
    assert (options.transient_time, options.min_samples, options.forgetting_time) == (0.5, 150, 20.0)
