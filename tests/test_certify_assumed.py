"""What a flight's radii rest on and do not show: each named where it is not covered, and nowhere else."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from colift import disturbance, sensor, simulate, study
from colift.certify import assumed
from colift.scenario import disturbances
from tests import paper_flights as paper

ALWAYS = (assumed.FIRST_ORDER, assumed.SAMPLED)
OTHER = ("tip_force_bandwidth",)
READINGS = [x.name for x in dataclasses.fields(sensor.Sensors) if x.name not in OTHER]
MID = np.full((5, 2), 25.0)  # N, of at most 50


def world(plan: simulate.Plan, **parts: object) -> simulate.Plan:
    """A plan in another world."""
    return dataclasses.replace(plan, world=dataclasses.replace(plan.world, **parts))


def quiet(**deviations: float) -> simulate.Plan:
    """The paper's C3 with exact sensors, but for those given."""
    given = dict.fromkeys(READINGS, 0.0) | deviations
    sensors = {name: paper.number(x) for name, x in given.items()}
    plan = paper.plan("C3")
    return world(plan, sensors=dataclasses.replace(plan.world.sensors, **sensors))


def found(plan: simulate.Plan, thrusts: tuple[np.ndarray, ...] = (MID, MID), transient: float = 0.0) -> tuple[str, ...]:
    """What a certificate on it says."""
    return assumed.of_certificate(plan, thrusts, transient)


def test_with_any_name_the_word_is_assumed():
    assert assumed.word(()) == "certified"
    assert assumed.word(("norm",)) == "assumed"


def test_first_order_and_sampling_are_assumed_of_every_flight_and_the_rest_is_not():
    assert found(quiet()) == ALWAYS


@pytest.mark.parametrize("reading", READINGS)
def test_any_noise_or_bias_of_a_reading_is_assumed_away(reading):
    assert found(quiet(**{reading: 1e-6})) == (assumed.FIRST_ORDER, assumed.NOISE, assumed.SAMPLED)


def test_the_study_s_own_sensors_are_noisy():
    assert assumed.NOISE in found(paper.plan("C3"))


def test_a_transient_is_assumed_away_unless_the_slowest_mode_leaves_next_to_nothing_of_it():
    assert found(quiet(), transient=assumed.DECAYED) == ALWAYS
    named = (assumed.FIRST_ORDER, assumed.TRANSIENT, assumed.SAMPLED)
    assert found(quiet(), transient=1.01 * assumed.DECAYED) == named
    assert found(quiet(), transient=0.35) == named


@pytest.mark.parametrize(("newton", "near"), [(0.0, True), (4.9, True), (5.1, False), (44.9, False), (45.1, True)])
@pytest.mark.parametrize("of", [0, 1])
def test_one_tick_of_one_agent_near_a_limit_in_flight_or_twin_is_enough(newton, near, of):
    u = MID.copy()
    u[3, 1] = newton
    thrusts = (u, MID) if of == 0 else (MID, u)
    assert found(quiet(), thrusts) == ((*ALWAYS, assumed.SATURATION) if near else ALWAYS)


def test_a_source_that_changes_with_time_is_assumed_steady_by_its_name_in_certificate_and_radii(monkeypatch):
    """Its law says so: the settings' wind, made to."""
    plan = quiet()
    assert disturbance.varying(plan.world.sources) == ()
    monkeypatch.setattr(disturbance.Wind, "time_invariant", False)
    named = ("time invariance of load_wind", "time invariance of agent_wind")
    assert found(plan) == (*ALWAYS, *named)
    assert assumed.of_radii(plan)[-2:] == named
    none = dataclasses.replace(plan.world.sources, payload=(), agents=((),))
    assert found(world(plan, sources=none)) == ALWAYS


def test_radii_along_a_run_rest_on_the_estimated_state_and_of_some_rivals_on_a_posterior_mean():
    bound = paper.plan("C3").stated.assumed
    assert bound == ("norm", "energy")
    assert assumed.of_radii(quiet()) == (*bound, assumed.SAMPLED)
    cases = study.plans(paper.SETTINGS, (*study.CASES, *study.BASELINES))
    for case, plan in cases.items():
        rival = case in ("DOB", "P", "O", "F", "R", "H")
        expected = (*bound, assumed.NOISE, assumed.SAMPLED, *((assumed.MEAN,) if rival else ()))
        assert assumed.of_radii(plan) == expected, case


def test_sources_carry_the_names_of_the_scenario():
    sources = disturbances.disturbances(paper.SETTINGS)
    named = {mount.name for mount in (*sources.payload, *sources.agents[0])}
    assert named == {source.name for source in paper.SETTINGS.disturbances if source.kind != "joint_friction"}


def test_thrusts_are_held_against_each_agent_s_own_limit():
    team = paper.plan("C3").pilot.team
    (group,) = team.groups
    uneven = dataclasses.replace(team, groups=(dataclasses.replace(group, thrust_max=jnp.array([50.0, 27.0])),))
    assert not assumed.near_limit(team, MID)
    assert assumed.near_limit(uneven, MID)
