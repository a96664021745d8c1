"""What a flight's radii rest on and do not show: each named where it is not covered, and nowhere else."""

from __future__ import annotations

import dataclasses

import pytest

from colift.certification import assumptions
from colift.closed_loop import flight
from colift.scenario import disturbances, experiment
from colift.simulation import sensors
from colift.simulation.disturbances import Wind, time_varying_names
from tests.support import paper_flights as paper

ALWAYS = (assumptions.FIRST_ORDER,)
OTHER = ("tip_force_bandwidth",)
READINGS = [x.name for x in dataclasses.fields(sensors.SensorNoise) if x.name not in OTHER]


def world(plan: flight.Experiment, **parts: object) -> flight.Experiment:
    """A plan in another world."""
    return dataclasses.replace(plan, world=dataclasses.replace(plan.world, **parts))


def quiet(**deviations: float) -> flight.Experiment:
    """The paper's C3 with exact sensors, but for those given."""
    given = dict.fromkeys(READINGS, 0.0) | deviations
    sensors = {name: paper.number(x) for name, x in given.items()}
    plan = paper.paper_experiment("C3")
    return world(plan, sensors=dataclasses.replace(plan.world.sensors, **sensors))


def found(plan: flight.Experiment, limited: bool = False, whole: bool = True) -> tuple[str, ...]:
    """What a certificate on it says."""
    return assumptions.certificate_assumptions(plan, limited, whole)


def test_with_any_name_the_word_is_assumed():
    assert assumptions.status_label(()) == "certified"
    assert assumptions.status_label(("norm",)) == "assumed"


def test_first_order_is_assumed_of_every_flight_and_the_rest():
    """First order is assumed of every flight and the rest where it is not covered."""
    assert found(quiet()) == ALWAYS
    assert found(paper.paper_experiment("C3")) == (*ALWAYS, assumptions.NOISE)
    assert found(quiet(), limited=True) == (*ALWAYS, assumptions.SATURATION)
    assert found(quiet(), whole=False) == (*ALWAYS, assumptions.PERIODICITY)


@pytest.mark.parametrize("reading", READINGS)
def test_any_noise_or_bias_of_a_reading_is_noise(reading):
    assert assumptions.has_sensor_noise(quiet(**{reading: 1e-6}).world.sensors)


def test_the_study_s_own_sensors_are_noisy_and_exact_ones():
    """The study is own sensors are noisy and exact ones are not."""
    assert assumptions.has_sensor_noise(paper.paper_experiment("C3").world.sensors)
    assert not assumptions.has_sensor_noise(quiet().world.sensors)


def test_a_source_that_changes_with_time_is_assumed_steady(monkeypatch):
    """Its law says so: the settings' wind, made to."""
    plan = quiet()
    assert time_varying_names(plan.world.disturbances) == ()
    monkeypatch.setattr(Wind, "time_invariant", False)
    named = ("time invariance of load_wind", "time invariance of agent_wind")
    assert found(plan) == (*ALWAYS, *named)
    assert assumptions.radius_assumptions(plan)[-2:] == named
    none = dataclasses.replace(plan.world.disturbances, payload=(), agents=((),))
    assert found(world(plan, disturbances=none)) == ALWAYS


def test_radii_along_a_run_rest_on_the_estimated_state():
    """Radii along a run rest on the estimated state and of some rivals on a posterior mean."""
    bound = paper.paper_experiment("C3").bound_assumptions.assumed
    assert bound == ("rkhs norm", "bounded noise energy")
    assert assumptions.radius_assumptions(quiet()) == (*bound, assumptions.SAMPLED)
    cases = experiment.make_experiments(paper.SETTINGS, (*experiment.PAPER_CASES, *experiment.BASELINES))
    for case, plan in cases.items():
        rival = case in (
            "disturbance_observer",
            "parametric",
            "true_residual",
            "label_feedback",
            "regression",
            "gp_label_feedback",
        )
        expected = (*bound, assumptions.NOISE, assumptions.SAMPLED, *((assumptions.MEAN,) if rival else ()))
        assert assumptions.radius_assumptions(plan) == expected, case


def test_sources_carry_the_names_of_the_scenario():
    sources = disturbances.make_disturbances(paper.SETTINGS)
    named = {mount.name for mount in (*sources.payload, *sources.agents[0])}
    assert named == {source.name for source in paper.SETTINGS.disturbances if source.kind != "joint_friction"}
