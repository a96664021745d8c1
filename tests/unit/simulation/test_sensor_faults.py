"""Tests of faults of single readings: intervals, agents, and the law of each failure."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift.simulation import sensor_faults
from tests.unit.simulation.test_sensors import CLOCK, apply_to_motion, case, ideal

START, END, TICKS = 0.1, 0.5, 400
K = np.arange(TICKS)
ACTIVE = (K >= 50) & (K < 250)


def failing(of: type[sensor_faults.ReadingFault], channel: str = "payload.p", **values: Any) -> Any:
    """Return a fault of the first agent or of the payload, from `START` to `END`."""
    failed = tuple(jnp.arange(size) == 0 for size in case()[0].sizes)
    values = {name: x if isinstance(x, bool | int) else jnp.array(x) for name, x in values.items()}
    return of(channel=channel, failed=failed, start=jnp.array(START), end=jnp.array(END), **values)


def held(period: float = 0.002, loss: float = 1.0, reports_age: bool = True) -> sensor_faults.HeldReading:
    """Return a reading that is held between samples."""
    return failing(sensor_faults.HeldReading, sample_period=period, dropout_probability=loss, reports_age=reports_age)


def travelled(of: sensor_faults.ReadingFault) -> tuple[np.ndarray, Any]:
    """Return the reading of the payload's position along its motion in control periods, and the measurement."""
    m = apply_to_motion(of, TICKS)
    return np.asarray(m.payload.p[:, 0] - ideal().payload.p[0]) / 0.002, m


@pytest.mark.parametrize("reported", [False, True])
def test_stuck_reading_keeps_its_last_value_in_the_interval(reported):
    """Only a reading that is off reports its age. It returns to the true value after the interval."""
    x, m = travelled(held(reports_age=reported))
    np.testing.assert_allclose(x, np.where(ACTIVE, 49, K), atol=1e-9)
    age = np.where(ACTIVE, 0.002 * (K - 49), 0.0)
    assert set(m.measurement_age_s) == ({"payload.p"} if reported else set())
    np.testing.assert_allclose(m.measurement_age_s.get("payload.p", age), age, atol=1e-12)


def test_slow_reading_is_sampled_at_its_rate_from_the_start():
    x, _ = travelled(held(period=0.1, loss=0.0))
    np.testing.assert_allclose(x, np.where(ACTIVE, K // 50 * 50, K), atol=1e-9)


def test_intermittent_reading_loses_its_share_of_samples():
    x, m = travelled(held(loss=0.8))
    fresh = np.abs(x - K) < 1e-6
    assert fresh[~ACTIVE].all()
    assert 0.1 < fresh[ACTIVE].mean() < 0.3
    np.testing.assert_allclose(m.measurement_age_s["payload.p"], 0.002 * (K - x), atol=1e-9)


def test_delayed_reading_is_late_in_the_interval():
    x, m = travelled(failing(sensor_faults.DelayedReading, delay=20))
    np.testing.assert_allclose(x, np.where(ACTIVE, K - 20, K), atol=1e-9)
    assert m.measurement_age_s == {}


def test_wrong_reading_has_a_constant_offset():
    x, _ = travelled(failing(sensor_faults.WrongReading, offset=0.3, noise=0.0))
    np.testing.assert_allclose(x, K + np.where(ACTIVE, 150.0, 0.0), atol=1e-9)


def test_garbage_is_white_noise_of_its_size():
    x, _ = travelled(failing(sensor_faults.WrongReading, offset=0.0, noise=0.3))
    error = 0.002 * (x - K)
    np.testing.assert_allclose(error[~ACTIVE], 0.0, atol=1e-9)
    assert abs(error[ACTIVE].std() / 0.3 - 1) < 0.2
    assert abs((error[ACTIVE][1:] * error[ACTIVE][:-1]).mean()) < 0.3 * 0.3 * 0.3


def test_reading_of_one_agent_fails():
    """The offset of an attitude is a rotation about the axes of the body."""
    of = failing(sensor_faults.WrongReading, channel="agents.R", offset=0.2, noise=0.0)
    first, truth = ideal(), case()[2]
    clock = dataclasses.replace(CLOCK, t=jnp.array(START))
    noise = tuple(jnp.zeros((*agent.R.shape[:1], 3)) for agent in first.agents)
    m, _ = of.apply(first, truth, clock, (), noise)
    for now, before in zip(m.agents, first.agents, strict=True):
        turned = np.asarray(before.R)[0] @ Rotation.from_rotvec([0.2] * 3).as_matrix()
        np.testing.assert_allclose(now.R[0], turned, atol=1e-12)
        np.testing.assert_array_equal(now.R[1:], before.R[1:])
