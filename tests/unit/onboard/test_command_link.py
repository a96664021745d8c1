"""Tests of the link from leader to agents: held messages, fading, and a flight without faults of the link."""

from __future__ import annotations

import dataclasses

import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import flight
from colift.models import grasp
from colift.models.measurement import Measurement, PayloadReading
from colift.models.state import ControlClock, Wrench
from colift.onboard import controller
from colift.onboard.control import command_link, tracking
from colift.onboard.interfaces import ContactForceCommand
from colift.scenario import experiment
from tests.support import small_team as light

CONTROLLER = experiment.make_experiment(light.settings(), "C1").controller
LINK = command_link.CommandLink(allocation=CONTROLLER.allocator.allocation, max_delay=4)


def message(scale: float) -> command_link.LeaderMessage:
    vector = scale * jnp.arange(1.0, 4.0)
    lam = scale * jnp.arange(9.0).reshape(3, 3)
    return command_link.LeaderMessage(
        acceleration_cmd=tracking.AccelerationCommand(a=vector, alpha=-vector, jerk=2 * vector),
        forces=ContactForceCommand(lam=lam, lam_dot=2 * lam, eta=jnp.zeros(3)),
        preview=None,
    )


@pytest.mark.parametrize(("age", "share"), [(0.0, 1.0), (0.4, 1.0), (0.6, np.exp(-1)), (10.0, 0.0)])
def test_an_old_message_fades(age, share):
    """Weight, residuals and internal forces stay: the wrench changes by the inertial wrench alone."""
    team, R, given = CONTROLLER.team, jnp.eye(3), message(1.0)
    found = LINK.fade(team.payload, R, given, jnp.asarray(age))
    np.testing.assert_allclose(found.acceleration_cmd.a, share * given.acceleration_cmd.a, atol=1e-12)
    np.testing.assert_allclose(found.acceleration_cmd.jerk, share * given.acceleration_cmd.jerk, atol=1e-12)
    np.testing.assert_allclose(found.forces.lam_dot, share * given.forces.lam_dot, atol=1e-12)
    lost = grasp.payload_wrench(grasp.contact_points(team), R, given.forces.lam - found.forces.lam)
    inertial = Wrench(
        F=team.payload.mass * given.acceleration_cmd.a, tau=team.payload.inertia @ given.acceleration_cmd.alpha
    )
    np.testing.assert_allclose(lost.F, (1 - share) * inertial.F, atol=1e-9)
    np.testing.assert_allclose(lost.tau, (1 - share) * inertial.tau, atol=1e-9)
    assert (np.asarray(found.forces.lam) == np.asarray(given.forces.lam)).all() == (share == 1.0)


def test_each_agent_holds_the_last_message_that_arrived():
    setup = experiment.make_experiment(light.settings(), "C1")
    dt = jnp.asarray(setup.dt)
    state = LINK.init(CONTROLLER.team, message(0.0), ())
    zero = jnp.zeros(3)
    reading = PayloadReading(R=jnp.eye(3), p=zero, v=zero, omega=zero, a=zero)
    context = controller.context_at(setup.controller, setup.initial_state, jnp.zeros(6), jnp.zeros(()))
    context = dataclasses.replace(context, clock=ControlClock(t=jnp.zeros(()), dt=dt))
    ages = {0: (0, 0, 2), 1: (0, -1, 2), 2: (0, -1, -1), 3: (0, 3, -1), 4: (0, -1, 4)}
    held = {0: (1, 1, 0), 1: (2, 1, 0), 2: (3, 1, 0), 3: (4, 1, 0), 4: (5, 1, 1)}
    for k, delays in ages.items():
        measurement = Measurement(agents=(), payload=reading, link_delay_s=dt * jnp.asarray(delays, float))
        state = LINK.deliver(state, dataclasses.replace(context, measurement=measurement), message(k + 1.0))
        np.testing.assert_allclose(state.received.acceleration_cmd.a[:, 0], held[k])
    np.testing.assert_allclose(state.age / dt, [0, 4, 4])


def fly(*given):
    setup = experiment.make_experiment(light.settings(faults=light.faults(*given)), "C1")
    return flight.run_experiment(dataclasses.replace(setup, duration=0.6)).records


@pytest.mark.long
def test_an_outage_changes_the_inputs_of_its_agent_only():
    """A link without faults changes nothing."""
    outage = {"kind": "link", "who": "n1", "start_s": 0.2, "end_s": 0.5, "rate_Hz": 0.01}
    found, free = fly(outage), fly()
    before = found.t < 0.2 + 1e-9  # the first message of the slow link arrives at 0.2 s
    np.testing.assert_allclose(found.u[before], free.u[before], rtol=1e-9)
    first = int(np.argmax(found.t > 0.2 + 1e-9))
    assert abs(found.u[first, 1] - free.u[first, 1]) > 1e-6
    np.testing.assert_allclose(found.u[first, [0, 2]], free.u[first, [0, 2]], rtol=1e-9)
