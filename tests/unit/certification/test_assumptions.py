"""Tests of the unproven assumptions of a flight's bounds: each is named exactly where it is not covered."""

from __future__ import annotations

import dataclasses

import pytest

from colift.certification import assumptions
from colift.closed_loop import flight
from colift.scenario import disturbances, experiment
from colift.scenario.cases import BASELINES, PAPER_CASES
from colift.simulation import sensors
from colift.simulation.disturbances import Wind, time_varying_names
from tests.support import paper_flights as paper

ALWAYS = (assumptions.FIRST_ORDER,)
OTHER = ("tip_force_bandwidth",)
READINGS = [x.name for x in dataclasses.fields(sensors.SensorNoise) if x.name not in OTHER]


def world(one: flight.Experiment, **parts: object) -> flight.Experiment:
    """Return an experiment in another world."""
    return dataclasses.replace(one, world=dataclasses.replace(one.world, **parts))


def exact_sensors(**deviations: float) -> flight.Experiment:
    """Return the paper's C3 with exact sensors, except those given."""
    values = dict.fromkeys(READINGS, 0.0) | deviations
    sensors = {name: paper.number(x) for name, x in values.items()}
    one = paper.paper_experiment("C3")
    return world(one, sensors=dataclasses.replace(one.world.sensors, **sensors))


def assumptions_of(one: flight.Experiment, limited: bool = False, whole: bool = True) -> tuple[str, ...]:
    """Return the assumptions that a certificate of the experiment names."""
    return assumptions.certificate_assumptions(one, limited, whole)


def test_status_is_assumed_with_any_assumption():
    assert assumptions.status_label(()) == "certified"
    assert assumptions.status_label(("norm",)) == "assumed"


def test_assumptions_are_named_where_not_covered():
    """First order is assumed of every flight, all others where they are not covered."""
    assert assumptions_of(exact_sensors()) == ALWAYS
    assert assumptions_of(paper.paper_experiment("C3")) == (*ALWAYS, assumptions.NOISE)
    assert assumptions_of(exact_sensors(), limited=True) == (*ALWAYS, assumptions.SATURATION)
    assert assumptions_of(exact_sensors(), whole=False) == (*ALWAYS, assumptions.PERIODICITY)


@pytest.mark.parametrize("reading", READINGS)
def test_noise_and_bias_of_any_sensor_count_as_noise(reading):
    assert assumptions.has_sensor_noise(exact_sensors(**{reading: 1e-6}).world.sensors)


def test_noise_is_assumed_for_the_study_sensors():
    """The sensors of the study have noise; exact sensors have none."""
    assert assumptions.has_sensor_noise(paper.paper_experiment("C3").world.sensors)
    assert not assumptions.has_sensor_noise(exact_sensors().world.sensors)


def test_time_varying_source_is_assumed_steady(monkeypatch):
    """For a wind whose model reports a dependence on time."""
    one = exact_sensors()
    assert time_varying_names(one.world.disturbances) == ()
    monkeypatch.setattr(Wind, "time_invariant", False)
    named = ("time invariance of load_wind", "time invariance of agent_wind")
    assert assumptions_of(one) == (*ALWAYS, *named)
    assert assumptions.logged_bound_assumptions(one)[-2:] == named
    none = dataclasses.replace(one.world.disturbances, payload=(), agents=((),))
    assert assumptions_of(world(one, disturbances=none)) == ALWAYS


def test_run_bounds_assume_the_estimated_state():
    """Bounds along a run assume the estimated state, and for some baselines a posterior mean."""
    bound = paper.paper_experiment("C3").bound_assumptions.assumed
    assert bound == ("rkhs norm", "bounded noise energy")
    assert assumptions.logged_bound_assumptions(exact_sensors()) == (*bound, assumptions.SAMPLED)
    cases = experiment.make_experiments(paper.SETTINGS, (*PAPER_CASES, *BASELINES))
    for case, one in cases.items():
        is_baseline = case in (
            "disturbance_observer",
            "parametric",
            "true_residual",
            "label_feedback",
            "regression",
            "gp_label_feedback",
        )
        expected = (*bound, assumptions.NOISE, assumptions.SAMPLED, *((assumptions.MEAN,) if is_baseline else ()))
        assert assumptions.logged_bound_assumptions(one) == expected, case


def test_sources_have_the_names_of_the_scenario():
    sources = disturbances.make_disturbances(paper.SETTINGS)
    named = {mount.name for mount in (*sources.payload, *sources.agents[0])}
    assert named == {source.name for source in paper.SETTINGS.disturbances if source.kind != "joint_friction"}
