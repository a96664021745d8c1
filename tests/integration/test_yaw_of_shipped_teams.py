"""Test of the yaw acceleration that shipped teams achieve, with exact parameters and thrusts along their setpoints."""

from __future__ import annotations

import dataclasses
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import codegen, scenario
from colift.models import grasp
from colift.models.state import State, zero_residual
from colift.onboard import controller
from colift.onboard.control import setpoints, tracking
from colift.scenario import controllers, initial_states, team
from colift.simulation import contact_dynamics

ZERO = jnp.zeros(3)
YAW = tracking.AccelerationCommand(a=ZERO, alpha=jnp.array([0.0, 0.0, 1.0]), jerk=ZERO, alpha_dot=ZERO)


@jax.jit
@codegen.compile
def respond(controlled: controller.LeaderFollowerController, z: State) -> tuple[Any, jax.Array]:
    """Return the attitude setpoints and the payload acceleration of a team at rest for `alpha_z = 1 rad/s^2`."""
    nominal, agents = controlled.team, controlled.agent_controller
    none, now = zero_residual(nominal), controller.context_at(controlled, z, jnp.zeros(6), jnp.zeros(()))
    demand = controller.tracking_demand(nominal, z.payload, YAW, none)
    forces, _ = controlled.allocator.allocate((), now, demand)
    shares = tuple(
        setpoints.AgentSetpoint(lam=lam, lam_dot=0 * lam, yaw=yaw, nominal_posture=posture)
        for lam, yaw, posture in zip(
            grasp.split_contacts(nominal, forces.lam), agents.yaw, agents.nominal_posture, strict=True
        )
    )
    desired = agents.attitude_setpoints(now, YAW, shares, none)
    (inputs, _), _ = agents.compute((), now, YAW, forces, none)
    acceleration, _ = contact_dynamics.forward_dynamics(nominal, z, inputs, none)
    return tuple(each.R for each in desired), acceleration.payload


@pytest.mark.parametrize("name", scenario.shipped_names())
def test_agents_on_their_setpoints_achieve_the_yaw_acceleration(name):
    """The thrusts include the tangential acceleration of the contacts; without it, rigid hooks reach less than half."""
    settings = scenario.load_scenario(name)
    _, nominal = team.team(settings)
    if nominal.is_rigid_assembly:
        pytest.skip("all agents rotate with the payload")
    controlled, z = controllers.make_controller(settings, nominal), initial_states.equilibrium_state(settings, nominal)
    for _ in range(2):  # the second step corrects the change of the attitudes by closing the contacts
        R, _ = respond(controlled, z)
        turned = tuple(dataclasses.replace(q, R=new) for q, new in zip(z.agents, R, strict=True))
        z = contact_dynamics.consistent_initial_state(nominal, dataclasses.replace(z, agents=turned))
    R, acceleration = respond(controlled, z)
    for q, new in zip(z.agents, R, strict=True):
        np.testing.assert_allclose(q.R, new, atol=1e-5)
    assert acceleration[5] == pytest.approx(1.0, abs=0.01)
    np.testing.assert_allclose(acceleration[:5], 0, atol=0.01)
