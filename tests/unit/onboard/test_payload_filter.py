"""Tests of the Kalman filter of a payload without gyroscope and accelerometer."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import linalg
from scipy.spatial.transform import Rotation

from colift import scenario
from colift.closed_loop import flight
from colift.onboard.estimation import payload_filter
from colift.onboard.estimation.nav_filter import NavState, initial_history
from colift.scenario import ScenarioError, experiment
from tests.support import small_team as light
from tests.unit.onboard.test_nav_filter import readings

DT, PERIODS, CORNER = 0.002, 1500, 30.0
TEAM = experiment.make_experiment(light.settings(), "C1").controller.team
FORCE, MOMENT = np.array([0.4, -0.7, 1.1]), np.array([0.003, -0.002, 0.004])  # residual of the payload


def chain(interval: float) -> np.ndarray:
    """Transition matrix of position, velocity and acceleration."""
    return np.array([[1, interval, interval**2 / 2], [0, 1, interval], [0, 0, 1]])


@given(st.floats(1.0, 300.0), st.floats(0.001, 0.05))
@settings(max_examples=50, deadline=None)
def test_corrections_have_the_poles_of_butterworth(corner, interval):
    """The error after a correction is multiplied by a matrix with the sampled poles of a Butterworth filter."""
    gains = np.asarray(payload_filter.correction_gains(jnp.array(corner), jnp.array(interval)))
    error = (np.eye(3) - np.outer(gains, [1, 0, 0])) @ chain(interval)
    poles = corner * np.exp(1j * np.pi * np.array([2 / 3, 1, 4 / 3]))
    assert np.poly(error) == pytest.approx(np.poly(np.exp(poles * interval)).real, abs=1e-8)


@pytest.mark.parametrize("sigma", [0.5, 20.0])
def test_gains_are_those_of_the_riccati_equation(sigma):
    """For short periods the gains equal the steady-state Kalman gains of a random walk of the acceleration."""
    noise, period = 0.002, 0.001
    q = 2 * payload_filter.DECAY_RATE * sigma**2
    P = linalg.solve_discrete_are(chain(period).T, np.eye(3)[:, :1], np.diag([0, 0, q * period]), [[noise**2]])
    expected = P[:, 0] / (P[0, 0] + noise**2)
    corner = payload_filter.corner_frequency(sigma, noise, period)
    found = payload_filter.correction_gains(jnp.array(corner), jnp.array(period))
    np.testing.assert_allclose(found, expected, rtol=2.5 * corner * period)


def motion() -> tuple[NavState, np.ndarray, np.ndarray]:
    """Return the motion under a constant contact wrench and residual, angular velocities, and the contact wrench."""
    mass, J = float(TEAM.payload.mass), np.asarray(TEAM.payload.inertia)
    wrench = np.array([0.3, 0.2, 9.81 * mass - 0.5, 0.004, 0.003, -0.005])
    R, x, v, omega = Rotation.identity(), np.zeros(3), np.zeros(3), np.zeros(3)
    acceleration = (wrench[:3] + FORCE) / mass + np.asarray(TEAM.gravity)
    rows, rates, small = [], [], 20
    for _ in range(PERIODS):
        rows.append((R.as_matrix(), x, v))
        rates.append(omega)
        x, v = x + DT * v + DT**2 / 2 * acceleration, v + DT * acceleration
        for _ in range(small):
            alpha = np.linalg.solve(J, wrench[3:] + MOMENT - np.cross(omega, J @ omega))
            R = R * Rotation.from_rotvec(DT / small * (omega + DT / small / 2 * alpha))
            omega = omega + DT / small * alpha
    R_t, x_t, v_t = (jnp.array(np.stack(part)) for part in zip(*rows, strict=True))
    truth = NavState(R=R_t, x=x_t, v=v_t)
    return truth, np.stack(rates), wrench


def estimates(every: int, delay: int) -> tuple[NavState, np.ndarray, np.ndarray]:
    """Return poses and velocities, angular velocities and residuals from poses of a rate and a delay in periods."""
    truth, _, wrench = motion()
    held, clocks = readings(truth, every, delay)
    clocks = dataclasses.replace(clocks, elapsed=jnp.maximum(clocks.elapsed, DT))
    of = payload_filter.PayloadFilter(corner=jnp.array(CORNER), pose_delay=delay)
    start = dataclasses.replace(of.init(TEAM), wrench=jnp.asarray(wrench))

    def step(past: Any, now: Any) -> tuple[Any, Any]:
        measured, clock = now
        found, state = of.update(TEAM, past, measured, jnp.ones(()), jnp.array(DT), clock)
        return (found.nav, state), (jax.tree.map(lambda leaf: leaf[0], found.nav), found.omega, state.residual)

    first = initial_history(jax.tree.map(lambda leaf: leaf[0], truth), delay + 1)
    _, (nav, omega, residual) = jax.lax.scan(step, (first, start), (held, clocks))
    return nav, np.asarray(omega), np.asarray(residual)


@pytest.mark.parametrize(("every", "delay"), [(1, 0), (5, 5), (10, 12)])
def test_residual_and_motion_are_estimated_from_late_poses(every, delay):
    """With exact poses of any rate and delay, the estimates converge to motion and residual."""
    truth, rates, _ = motion()
    nav, omega, residual = estimates(every, delay)
    np.testing.assert_allclose(residual[-1], [*FORCE, *MOMENT], rtol=0.02, atol=1e-4)
    np.testing.assert_allclose(nav.x[-1], truth.x[-1], atol=1e-3)
    np.testing.assert_allclose(nav.v[-1], truth.v[-1], atol=1e-2)
    np.testing.assert_allclose(omega[-1], rates[-1], atol=5e-3)
    np.testing.assert_allclose(nav.R[-1], truth.R[-1], atol=2e-3)


def test_late_poses_delay_the_residual_and_nothing_else():
    """The estimate from late poses is that from poses without delay at the sample, predicted over the delay."""
    every, delay = 5, 5
    (late, _, d), (early, _, d_early) = estimates(every, delay), estimates(every, 0)
    start = 300  # the first pose is used again when it arrives late
    np.testing.assert_allclose(d[start:, :3], d_early[start - delay : len(d) - delay, :3], atol=1e-6)
    _, _, wrench = motion()
    a = (wrench[:3] + d[start:, :3]) / float(TEAM.payload.mass) + np.asarray(TEAM.gravity)
    x, v = (np.asarray(leaf)[start - delay : len(d) - delay] for leaf in (early.x, early.v))
    predicted = x + delay * DT * v + (delay * DT) ** 2 / 2 * a
    np.testing.assert_allclose(late.x[start:], predicted, atol=1e-6)


@pytest.mark.parametrize(("every", "delay"), [(1, 0), (5, 5), (10, 10)])
def test_input_filter_equals_the_filter_of_the_residual(every, delay):
    """Inputs of the learned model and a residual force with the same course have the same lag."""
    of = payload_filter.PayloadFilter(corner=jnp.array(CORNER), pose_delay=delay)
    signal = np.sin(3 * DT * np.arange(PERIODS)) * float(TEAM.payload.mass)
    a = signal / float(TEAM.payload.mass)
    v = np.concatenate([[0], DT * np.cumsum(a[:-1])])
    x = np.concatenate([[0], np.cumsum(DT * v[:-1] + DT**2 / 2 * a[:-1])])
    truth = NavState(
        R=jnp.broadcast_to(jnp.eye(3), (PERIODS, 3, 3)),
        x=jnp.array(np.repeat(x[:, None], 3, 1)),
        v=jnp.array(np.repeat(v[:, None], 3, 1)),
    )
    held, clocks = readings(truth, every, delay)
    clocks = dataclasses.replace(clocks, elapsed=jnp.maximum(clocks.elapsed, DT))

    def step(past: Any, now: Any) -> tuple[Any, Any]:
        measured, clock, value = now
        found, state = of.update(TEAM, past, measured, jnp.ones(()), jnp.array(DT), clock)
        inputs, state = of.delay_inputs(state, jnp.full(24, value), jnp.ones(()), jnp.array(DT), clock)
        return (found.nav, state), (state.residual[:3], inputs[:3])

    first = initial_history(jax.tree.map(lambda leaf: leaf[0], truth), delay + 1), of.init(TEAM)
    _, (residual, inputs) = jax.lax.scan(step, first, (held, clocks, jnp.asarray(signal)))
    start = 4 * max(every, delay)
    np.testing.assert_allclose(residual[start:], inputs[start:], atol=2e-3 * np.abs(signal).max())
    lag = float(of.label_delay(DT)) + (every - 1) * DT / 2  # on average a pose is used for half its period more
    expected = np.sin(3 * (DT * np.arange(PERIODS) - lag)) * float(TEAM.payload.mass)
    np.testing.assert_allclose(residual[400:, 0], expected[400:], atol=0.05 * np.abs(signal).max())


def test_corner_frequency_follows_from_noise_and_rate():
    """Slower or noisier poses lower the corner frequency; exact poses allow that of the tip force sensors."""

    def corner(**sensors: Any) -> float:
        made = light.settings(sensors={"payload_imu": False, **sensors})
        return float(experiment.make_experiment(made, "C1").controller.estimator.payload_filter.corner)

    slow = [{"kind": "intermittent", "channels": ["payload.p", "payload.R"], "rate_Hz": 100}]
    noise = {"position_m": 0.002, "attitude_deg": 0.2}
    found = corner(**noise)
    assert corner(**noise, models=slow) == pytest.approx(found * (100 / light.settings().control_Hz) ** (1 / 6))
    assert corner(position_m=0.016, attitude_deg=1.6) == pytest.approx(found / 2)
    assert corner(position_m=0.0, attitude_deg=0.0) == pytest.approx(2 * np.pi * 50)


def test_late_poses_of_agents_do_not_delay_the_payload():
    late = [{"kind": "intermittent", "channels": ["agents.R", "agents.x"], "rate_Hz": 100, "delay_s": 0.01}]
    made = light.settings(sensors={"payload_imu": False, "models": late})
    estimator = experiment.make_experiment(made, "C1").controller.estimator
    assert estimator.pose_delay == round(0.01 * made.control_Hz)
    assert estimator.payload_filter.pose_delay == 0


@pytest.mark.parametrize(
    "wrong",
    [
        "sensors.models=[{kind: bias_random_walk, channels: [payload.a], random_walk_density: 0.1}]",
        "faults=[{kind: sensor, who: payload, reading: omega, start_s: 1}]",
        "contact_forces={kind: least_squares}",
    ],
)
def test_settings_that_require_missing_sensors_are_refused(wrong):
    with pytest.raises(ScenarioError, match=r"payload_imu: false"):
        scenario.load_scenario("paper", overrides=["sensors.payload_imu=false", wrong])


def test_flight_without_payload_imu_learns():
    """Readings of missing sensors are NaN, so that a complete flight uses none of them; learning reduces the error."""
    made = scenario.load_scenario(
        "trio",
        overrides=["sensors.payload_imu=false", "duration_s=8", "learning.end_s=8", "learning.update_times_s=[2,4,6]"],
    )
    error = {}
    for case, plan in experiment.make_experiments(made, ("C1", "C3")).items():
        found = flight.run_experiment(plan)
        assert not found.termination_reason
        error[case] = np.sqrt((np.asarray(found.records.e_p)[-1000:] ** 2).sum(1).mean())
    assert error["C3"] < 0.3 * error["C1"]
