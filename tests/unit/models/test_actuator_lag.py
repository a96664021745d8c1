"""Tests of the actuator lag model against the closed form, and of its inversion."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.models.actuator_lag import ActuatorLag
from colift.models.state import AgentInput

DT = jnp.array(0.002)


def command(u: float, tau: float = 0.0) -> tuple[AgentInput, ...]:
    return (AgentInput(u=jnp.array([u]), tau=jnp.full((1, 3), tau), tau_r=jnp.full((1, 2), u)),)


@pytest.mark.parametrize("delay", [0, 3])
def test_step_response_is_delayed_first_order_lag(delay):
    lag = ActuatorLag(bandwidth=jnp.array(8.0), delay=delay)
    state = lag.init(command(10.0))
    for k in range(40):
        state = lag.step(state, command(20.0, 1.0), DT)
        risen = 1 - np.exp(-2 * np.pi * 8.0 * 0.002 * max(0, k + 1 - delay))
        np.testing.assert_allclose(state.output[0].u, 10 + 10 * risen, rtol=1e-12)
        np.testing.assert_allclose(state.output[0].tau, risen, atol=1e-12)
        np.testing.assert_array_equal(state.output[0].tau_r, 20.0)  # joints act at once


@pytest.mark.parametrize("delay", [0, 3])
@pytest.mark.parametrize("ratio", [1.0, 2.0, 20.0])
def test_inverted_lag_has_a_higher_bandwidth(delay, ratio):
    """`output+ = output + ratio b (requested - output)`; with ratio 1 the command is the request."""
    lag = ActuatorLag(bandwidth=jnp.array(8.0), delay=delay)
    state, request = lag.init(command(10.0)), command(20.0, 1.0)
    b = 1 - np.exp(-2 * np.pi * 8.0 * 0.002)
    for k in range(30):
        sent = lag.invert(state, request, jnp.array(ratio), DT)
        if ratio == 1.0:
            jax.tree.map(lambda a, c: np.testing.assert_allclose(a, c, rtol=1e-12), sent, request)
        state = lag.step(state, sent, DT)
        left = (1 - min(ratio * b, 1.0)) ** max(0, k + 1 - delay)
        np.testing.assert_allclose(state.output[0].u, 20 - 10 * left, rtol=1e-10)
