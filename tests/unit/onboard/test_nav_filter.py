"""Tests of the complementary filter with slow, late and lost readings."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from colift import scenario
from colift.math import filters
from colift.onboard.estimation import nav_filter
from colift.scenario import experiment
from tests.unit.onboard.test_state_estimator import FILTERS
from tests.unit.simulation import test_sensors

DT = 0.002
PERIODS = 1000
OMEGA, ACCELERATION = np.array([0.3, -0.5, 0.8]), np.array([0.5, 1.0, -0.4])


def motion(periods: int = PERIODS) -> nav_filter.NavState:
    """Return a body at constant rate and acceleration, time first."""
    t = DT * np.arange(periods)[:, None]
    return nav_filter.NavState(
        R=jnp.array(Rotation.from_rotvec(t * OMEGA).as_matrix()),
        x=jnp.array(t**2 / 2 * ACCELERATION),
        v=jnp.array(t * ACCELERATION),
    )


def readings(truth: nav_filter.NavState, every: int, delay: int) -> tuple[nav_filter.NavState, nav_filter.ReadingClock]:
    """Return held readings, sampled every few periods and late by a delay, with their clocks."""
    k = np.arange(len(truth.x))
    sample = np.maximum((k - delay) // every * every, 0)
    age = DT * (k - np.where(k < delay, 0, sample))
    is_new = ((k - delay) % every == 0) & (k >= delay)
    number = np.cumsum(is_new)
    last = np.where(number > 0, np.maximum.accumulate(np.where(is_new, k, 0)), 0)
    before = np.concatenate([[0], last[:-1]])
    clock = nav_filter.ReadingClock(
        age=jnp.array(np.repeat(age[:, None], 3, 1)),
        elapsed=jnp.array(np.repeat(DT * np.where(is_new, k - before, k - last)[:, None], 3, 1)),
        is_new=jnp.array(np.repeat(is_new[:, None].astype(float), 3, 1)),
    )
    return jax.tree.map(lambda leaf: leaf[sample], truth), clock


def run(
    read: nav_filter.NavState,
    clock: nav_filter.ReadingClock | None,
    length: int,
    offset: float = 0.0,
    hertz: float = 0.0,
    bias: float = 0.0,
) -> tuple[nav_filter.NavState, nav_filter.ImuBias]:
    """Return the estimates from a wrong start, and the last biases; the given history has a fixed length."""
    bandwidths = dataclasses.replace(FILTERS, imu_bias=jnp.array(hertz))
    truth = motion(len(read.x))

    def step(past: Any, now: tuple) -> tuple[Any, nav_filter.NavState]:
        measured, R, clock = now
        specific_force = R.T @ jnp.asarray(ACCELERATION) + bias
        pose, biases, _, _ = nav_filter.update(
            past,
            *(
                measured,
                jnp.asarray(OMEGA) + bias,
                specific_force,
                jnp.zeros(3),
                bandwidths,
                jnp.ones(()),
                jnp.array(DT),
            ),
            clock,
        )
        return (pose, biases), nav_filter.newest(pose, clock)

    start = jax.tree.map(lambda leaf: leaf[0], truth)
    start = dataclasses.replace(start, x=start.x + offset, v=start.v + offset)
    if clock is not None:
        start = nav_filter.initial_history(start, length)
    (_, biases), estimates = jax.jit(lambda *given: jax.lax.scan(step, *given))(
        (start, nav_filter.zero_bias()),
        (*jax.tree.map(lambda leaf: leaf[1:], (read,)), truth.R[:-1], jax.tree.map(lambda leaf: leaf[1:], clock)),
    )
    return estimates, biases


@pytest.mark.parametrize("length", [1, 6])
def test_readings_of_every_period_give_the_undelayed_filter(length):
    """With a bias of the inertial sensors and a wrong start."""
    read, clock = readings(motion(), every=1, delay=0)
    given = {"offset": 0.3, "hertz": 0.1, "bias": 0.02}
    expected, expected_bias = run(read, None, 0, **given)
    found, bias = run(read, clock, length, **given)
    for now, true in zip(jax.tree.leaves((found, bias)), jax.tree.leaves((expected, expected_bias)), strict=True):
        np.testing.assert_allclose(now, true, atol=1e-10)


@given(every=st.integers(1, 12), delay=st.integers(0, 12))
@settings(max_examples=8)
def test_late_readings_leave_no_error(every, delay):
    """A wrong start is corrected, and late readings of a right estimate change nothing."""
    truth = motion()
    read, clock = readings(truth, every, delay)
    found, _ = run(read, clock, length=delay + 1)
    for now, true in zip(jax.tree.leaves(found), jax.tree.leaves(truth), strict=True):
        np.testing.assert_allclose(now[-1], true[-1], atol=1e-10)
    corrected, _ = run(read, clock, length=delay + 1, offset=0.3)
    np.testing.assert_allclose(corrected.v[-1], truth.v[-1], atol=1e-5)
    np.testing.assert_allclose(corrected.x[-1], truth.x[-1], atol=1e-3)
    undelayed, _ = run(read, None, 0)
    if every + delay > 4:  # as current readings they are wrong by the way of the delay
        assert np.abs(undelayed.x[-1] - truth.x[-1]).max() > 1e-3


def test_biases_are_estimated_from_rare_late_readings():
    """Biases of gyroscope and accelerometer converge as with readings of every period."""
    read, clock = readings(motion(10_000), every=5, delay=5)
    _, bias = run(read, clock, 6, hertz=0.1, bias=0.05)
    np.testing.assert_allclose(bias.omega, 0.05, atol=2e-3)
    np.testing.assert_allclose(bias.a, 0.05, atol=2e-3)


def test_a_lost_sensor_leaves_the_prediction():
    """Without new readings the estimate is the integral of the inertial sensors, not the held reading."""
    truth = motion()
    read, clock = readings(truth, every=5, delay=5)
    lost = np.arange(PERIODS) >= 500
    clock = dataclasses.replace(clock, is_new=jnp.asarray(np.where(lost[:, None], 0.0, clock.is_new)))
    read = jax.tree.map(lambda leaf: leaf[np.minimum(np.arange(PERIODS), 499)], read)
    found, _ = run(read, clock, 6)
    np.testing.assert_allclose(found.x[-1], truth.x[-1], atol=1e-9)


def test_a_held_reading_corrects_once():
    """A wrong position shifts the estimate by the smoothing factor of five periods, also in a longer history."""
    truth = motion()
    read, clock = readings(truth, every=5, delay=5)
    wrong = (np.arange(PERIODS) >= 505) & (np.arange(PERIODS) < 510)
    read = dataclasses.replace(read, x=read.x + jnp.asarray(np.where(wrong, 0.1, 0.0))[:, None])
    found, _ = run(read, clock, length=12)
    b = filters.irregular_smoothing_factor(filters.smoothing_factor(jnp.array(5.0), jnp.array(DT)), jnp.array(5.0))
    np.testing.assert_allclose(found.x[508] - truth.x[509], 0.1 * float(b), atol=1e-9)


def test_a_reading_older_than_the_history_is_not_used():
    truth = motion()
    found, _ = run(*readings(truth, every=5, delay=5), length=5, offset=0.3)
    np.testing.assert_allclose(found.x[-1] - truth.x[-1], 0.3 * (1 + DT * (PERIODS - 1)), atol=1e-9)


@pytest.mark.parametrize(("every", "delay", "loss"), [(0.002, 0, 0.0), (0.01, 5, 0.0), (0.004, 3, 0.4)])
def test_clock_detects_new_readings_of_the_simulated_sensor(every, delay, loss):
    """Age, arrival and interval follow from the ages of the measurement alone."""
    of = test_sensors.intermittent(("payload.p",), every=every, loss=loss, delay=delay)
    m = test_sensors.apply_to_motion(of)
    sample = np.rint((np.asarray(m.payload.p[:, 0]) - float(test_sensors.ideal().payload.p[0])) / 0.002).astype(int)

    def step(clock: nav_filter.ReadingClock, age: jax.Array) -> tuple[nav_filter.ReadingClock, nav_filter.ReadingClock]:
        ages = {"payload.p": age}
        clock = nav_filter.advance_clock(clock, nav_filter.CHANNELS["payload"], ages, jnp.array(DT))
        return clock, clock

    clocks = jax.lax.scan(step, nav_filter.initial_clock(), m.measurement_age_s["payload.p"])[1]
    arrived = np.flatnonzero(np.diff(sample) > 0) + 1
    is_new = np.asarray(clocks.is_new[:, 1])
    np.testing.assert_array_equal(np.flatnonzero(is_new[arrived[0] :]) + arrived[0], arrived)
    np.testing.assert_allclose(clocks.age[arrived, 1], DT * (arrived - sample[arrived]), atol=1e-12)
    np.testing.assert_allclose(clocks.elapsed[arrived[1:], 1], DT * np.diff(arrived), atol=1e-12)
    assert len(arrived) > 50
    np.testing.assert_array_equal(clocks.is_new[:, 0], 1.0)  # attitudes have no age


@pytest.mark.parametrize(
    ("models", "delay"),
    [
        ((), None),
        (({"channels": ["agents.lam"], "rate_Hz": 250},), None),
        (({"channels": ["agents.x"], "rate_Hz": 100},), 0),
        (({"channels": ["payload.p"], "rate_Hz": 100, "delay_s": 0.01}, {"channels": ["agents.R"], "rate_Hz": 50}), 5),
    ],
)
def test_scenario_states_the_delay_of_poses(models, delay):
    """The history is as long as the largest delay of poses and velocities."""
    settings = scenario.load_scenario("paper").model_dump()
    settings["sensors"]["models"] = [{"kind": "intermittent", **model} for model in models]
    plan = experiment.make_experiment(scenario.Scenario.model_validate(settings), "C1")
    assert plan.controller.estimator.pose_delay == delay
