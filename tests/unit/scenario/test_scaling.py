"""Scaling of a new scenario with the size of its vehicles."""

from __future__ import annotations

import dataclasses
import re

import numpy as np
import pytest

from colift import scenario
from colift.scenario import scaling, template
from colift.scenario.scaling import Scale


def test_the_reference_vehicle_has_scale_one() -> None:
    found = scaling.vehicle_scale(1.5, 1.5, 0.035)
    np.testing.assert_allclose([found.length, found.mass], 1.0, rtol=1e-12)
    assert Scale().control_rate == 500.0


@pytest.mark.parametrize(("mass", "radius"), [(0.027, 0.028), (0.7, 0.1), (30.0, 0.5)])
def test_lengths_are_radii_of_gyration(mass: float, radius: float) -> None:
    found = scaling.vehicle_scale(mass, mass, mass * radius**2)
    assert found.length == pytest.approx(radius / scaling.REFERENCE_RADIUS)


def test_a_placeholder_inertia_does_not_set_the_length() -> None:
    for inertia in (1e-9, 1e3):
        ratio = scaling.vehicle_scale(1.5, 1.5, inertia).length
        assert ratio in (pytest.approx(1 / scaling.MAX_SHAPE_RATIO), pytest.approx(scaling.MAX_SHAPE_RATIO))


@pytest.mark.parametrize("by", [Scale(0.19, 0.018), Scale(2.5, 20.0)])
def test_scaled_scenarios_are_similar(by: Scale) -> None:
    """Dimensionless groups of the scenario do not depend on the scale."""
    vehicle = template.VEHICLES[0]
    scaled = dataclasses.replace(
        vehicle,
        mass=vehicle.mass * by.mass,
        contact_offset=((0.0, 0.0, 0.0),),
        scale=by,
        text=re.sub("mass_kg: 1.5", f"mass_kg: {1.5 * by.mass}", vehicle.text),
    )
    one = scenario.parse(template.scenario_template("t", 3, 0), "t.yaml")
    other = scenario.parse(template.scenario_text("t", scaled, 3), "t.yaml")

    def groups(of: scenario.Scenario) -> list[float]:
        m, l, g = of.payload.mass_kg, of.agents[0].contact_positions_m[0][0], 9.81  # noqa: E741
        t = np.sqrt(l / g)
        wind, rotors = of.disturbances
        return [
            of.duration_s / t,
            of.reference.period_s[0] / t,
            of.reference.amplitude_m[0] / l,
            of.control.K_p[0] * t**2,
            of.control.agent_k_omega * t,
            of.control.k_R * t**2,
            wind.linear_drag_Nspm * wind.mean_wind_mps[0] / (m * g),
            wind.gusts[0].wave_vector_radpm[0] * l,
            rotors.thrust_N / (m * g),
            rotors.torque_Nm[0] / (m * g * l),
            of.payload.inertia_kgm2[0][0] / (m * l**2),
            of.learning.payload.signal_std.force_N / (m * g),
            of.learning.agents.noise_std.moment_Nm / (m * g * l),
            of.learning.sample_Hz * t,
            of.sensors.tip_force_bias_N / (m * g),
            of.sensors.position_m / l,
            of.sensors.velocity_mps * t / l,
            of.baselines.position_integral_gain * t**3,
            of.baselines.first_moment_prior_std_kgm / (m * l),
            of.termination.max_position_error_m / l,
            of.learning.refit_period_s / t,
        ]

    np.testing.assert_allclose(groups(other), groups(one), rtol=0.02)
    assert other.control_Hz >= 0.9 * one.control_Hz / by.time * 0.99
