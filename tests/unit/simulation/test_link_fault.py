"""Tests of the link fault: times, delay and losses of messages."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np

from colift.models.measurement import Measurement, PayloadReading
from colift.models.state import ControlClock
from colift.simulation import faults
from tests.support import paper_flights as paper

DT = 0.002
SETUP = paper.paper_experiment("C1")


def arrivals(ticks: int, loss: float = 0.0, delay: int = 0, end: float = np.inf, seed: int = 0) -> np.ndarray:
    """Delays in ticks of the messages to two agents; the link of the second one has a fault from 0.02 s, at 100 Hz."""
    fault = faults.LinkFault(
        member=jnp.array([False, True]),
        period=jnp.array(0.01),
        loss_probability=jnp.array(loss),
        start=jnp.array(0.02),
        end=jnp.array(end),
        delay=delay,
    )
    zero = jnp.zeros(3)
    measurement = Measurement(agents=(), payload=PayloadReading(R=jnp.eye(3), p=zero, v=zero, omega=zero, a=zero))
    truth = SETUP.world.sensed_at_rest(SETUP.initial_state)

    def delays(k, noise):
        clock = ControlClock(t=k * DT, dt=jnp.asarray(DT))
        return fault.apply(measurement, truth, clock, (), noise)[0].link_delay_s

    noise = fault.sample_noise(SETUP.world.team, jax.random.key(seed), ticks)
    found = np.asarray(jax.vmap(delays)(jnp.arange(ticks, dtype=float), noise))
    return np.where(found < 0, -1.0, found / DT)


def test_messages_arrive_at_the_rate_of_the_link_after_its_delay():
    found = arrivals(60, delay=3, end=0.1)
    assert (found[:, 0] == 0).all()  # the link of the other agent has no fault
    expected = np.where(np.arange(60) < 10, 0.0, -1.0)
    expected[13:50:5] = 3.0  # sent every 0.01 s from 0.02 s on, 3 ticks later
    expected[50:] = 0.0
    np.testing.assert_allclose(found[:, 1], expected, atol=1e-9)


def test_messages_are_lost_with_the_stated_probability():
    """The number of received messages of 4000 is within 4 binomial standard deviations of its mean."""
    received = (arrivals(20_010, loss=0.3)[10:, 1] >= 0).sum()
    assert abs(received - 0.7 * 4000) < 4 * (4000 * 0.3 * 0.7) ** 0.5
