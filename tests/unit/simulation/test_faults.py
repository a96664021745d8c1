"""Tests of thrust losses, open contacts and regrasps: inputs, forces, motion, momentum; flights without faults."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import flight
from colift.models import actuator_lag, grasp
from colift.models.parameters import OPEN_COMPLIANCE, Team
from colift.models.state import AgentInput, State, zero_residual
from colift.scenario import experiment
from colift.simulation import contact_dynamics, faults
from tests.support import paper_flights as paper
from tests.support import small_team as light

DYNAMICS = jax.jit(contact_dynamics.forward_dynamics)


def released(compliance: float = OPEN_COMPLIANCE) -> Team:
    """Return the paper's team with an open contact of the first agent."""
    team = paper.paper_experiment("C1").world.team
    (group,) = team.agent_groups
    value = jnp.zeros(group.contact_position.shape[:2]).at[0, 0].set(compliance)
    return dataclasses.replace(team, agent_groups=(dataclasses.replace(group, contact_compliance=value),))


def moving():
    """Return a moving state of the paper's team and inputs near hover."""
    setup = paper.paper_experiment("C1")
    z, rng = setup.initial_state, np.random.default_rng(0)
    (agents,) = z.agents
    agents = dataclasses.replace(agents, r_dot=jnp.asarray(rng.normal(size=agents.r_dot.shape)))
    payload = dataclasses.replace(z.payload, omega=jnp.array([0.1, 0.2, -0.1]))
    z = contact_dynamics.project_to_constraints(
        setup.world.team, dataclasses.replace(z, agents=(agents,), payload=payload)
    )
    return z, (AgentInput(u=jnp.array([28.0, 27.0]), tau=jnp.zeros((2, 3)), tau_r=jnp.zeros_like(agents.r)),)


def losses(share: float, **times: float) -> faults.Faults:
    loss = faults.ThrustLoss(
        share=(jnp.array([share, 1.0]),), start=jnp.array(times["start"]), end=jnp.array(times.get("end", np.inf))
    )
    return faults.Faults(thrust=(loss,))


@pytest.mark.parametrize(("t", "share"), [(0.99, 1.0), (1.0, 0.6), (1.99, 0.6), (2.0, 1.0)])
def test_thrust_loss_scales_thrust_and_torque_of_one_agent(t, share):
    inputs = (AgentInput(u=jnp.array([20.0, 30.0]), tau=jnp.ones((2, 3)), tau_r=jnp.ones((2, 4))),)
    (acting,), _ = losses(0.6, start=1.0, end=2.0).limit(inputs, None, jnp.array(t))
    np.testing.assert_allclose(acting.u, [20 * share, 30])
    np.testing.assert_allclose(acting.tau, [[share] * 3, [1.0] * 3])
    np.testing.assert_array_equal(acting.tau_r, inputs[0].tau_r)


def test_simultaneous_losses_multiply():
    one, two = losses(0.5, start=0.0), losses(0.8, start=0.0)
    inputs = (AgentInput(u=jnp.array([20.0, 30.0]), tau=jnp.ones((2, 3)), tau_r=jnp.ones((2, 4))),)
    (acting,), _ = faults.Faults(thrust=one.thrust + two.thrust).limit(inputs, None, jnp.array(1.0))
    np.testing.assert_allclose(acting.u, [8.0, 30.0])


def rotor_faults(count: int, *given: tuple[int, float | None]) -> faults.Faults:
    """Return faults of rotors of the first of two agents from 1 s to 2 s: number, and share or None if stuck."""
    mixer = actuator_lag.ring_mixer(count, 0.25, 0.016, jnp.full(2, 60.0 / count))
    share, stuck = np.ones((2, count)), np.zeros((2, count), bool)
    for rotor, to in given:
        share[0, rotor], stuck[0, rotor] = 1.0 if to is None else to, to is None
    fault = faults.RotorFault(
        share=(jnp.asarray(share),), stuck=(jnp.asarray(stuck),), start=jnp.array(1.0), end=jnp.array(2.0)
    )
    return faults.Faults(rotors=(fault,), mixers=(mixer,))


def requested(scale: float = 1.0):
    tau = jnp.array([[0.3, -0.2, 0.05], [0.1, 0.2, -0.03]])
    return (AgentInput(u=scale * jnp.array([20.0, 30.0]), tau=scale * tau, tau_r=jnp.ones((2, 4))),)


@pytest.mark.parametrize("count", [4, 6])
@pytest.mark.parametrize("to", [0.0, 0.4])
def test_a_weak_rotor_removes_a_share_of_its_force_and_moment(count, to):
    """A rotor at `(x, y)` with force f contributes the thrust f and the moment `(y f, -x f, +-moment ratio f)`."""
    of, inputs = rotor_faults(count, (1, to)), requested()
    last = of.rotor_forces(inputs)
    (acting,), (forces,) = of.limit(inputs, last, jnp.array(1.0))
    force, angle = float(last[0][0, 1]), 2 * np.pi * 1.5 / count
    lost = (1 - to) * force * np.array([1.0, 0.25 * np.sin(angle), -0.25 * np.cos(angle), -0.016])
    np.testing.assert_allclose(acting.u, [20 - lost[0], 30], rtol=1e-12)
    np.testing.assert_allclose(inputs[0].tau - acting.tau, [lost[1:], [0, 0, 0]], atol=1e-12)
    np.testing.assert_allclose(forces[0, 1], to * force)
    np.testing.assert_array_equal(acting.tau_r, inputs[0].tau_r)


@pytest.mark.parametrize("count", [4, 6])
def test_a_stuck_rotor_keeps_the_force_before_the_fault(count):
    """The other rotors follow the commands, also where several sets of rotor forces generate equal inputs."""
    of, forces = rotor_faults(count, (1, None), (2, 0.5)), None
    forces = of.rotor_forces(requested())
    (before,) = forces
    for k, t in enumerate([0.998, 1.0, 1.5, 1.998, 2.0]):
        inputs = requested(1.0 if t < 1 else 1.2)
        (acting,), (after,) = of.limit(inputs, forces, jnp.array(t))
        (demand,), active = of.rotor_forces(inputs), 0 < k < 4
        np.testing.assert_allclose(after[0, 1], before[0, 1] if active else demand[0, 1])
        np.testing.assert_allclose(after[0, 2], 0.5 * demand[0, 2] if active else demand[0, 2])
        np.testing.assert_allclose(np.delete(after, (1, 2), axis=1), np.delete(demand, (1, 2), axis=1))
        np.testing.assert_allclose(acting.u, after.sum(1), rtol=1e-12)
        forces = (after,)


def test_open_contact_bears_no_force():
    """Newton's law of the payload holds with the other forces, and the closed contacts do not part."""
    z, inputs = moving()
    team = released()
    a, (lam,) = DYNAMICS(team, z, inputs, zero_residual(team))
    assert np.abs(lam[0, 0]).max() < 1e-9
    force = team.payload.mass * (a.payload[:3] - team.gravity)
    np.testing.assert_allclose(np.asarray(lam).reshape(-1, 3).sum(0), force, atol=1e-9)
    plant = contact_dynamics.RigidContactPlant()
    step = jax.jit(lambda z: plant.step(team, z, inputs, lambda z, s: zero_residual(team), jnp.asarray(0.002)))
    for _ in range(20):
        z = step(z)
    closed = dataclasses.replace(team, agent_groups=paper.paper_experiment("C1").world.team.agent_groups)
    gap = np.linalg.norm(grasp.constraint_residual(closed, z), axis=1)
    assert gap[0] > 1e-3
    assert gap[1:].max() < 1e-9
    assert np.abs(grasp.constraint_residual(team, z)).max() < 1e-9  # counts closed contacts only


def regrasp(time: float = 1.0) -> tuple[Team, faults.Faults]:
    """Return the paper's team, and faults by which the first contact opens at 0 s and may close again at a time."""
    release, close = np.full((2, 2, 2), np.inf)
    release[0, 0], close[0, 0] = 0.0, time
    team = paper.paper_experiment("C1").world.team
    return team, faults.Faults(release_time=(jnp.asarray(release),), regrasp_time=(jnp.asarray(close),))


def parted(distance: float) -> State:
    """Return a moving state in which the tip of the first contact is away from its contact point."""
    z, _ = moving()
    (agents,) = z.agents
    agents = dataclasses.replace(agents, r=agents.r.at[0, 1].add(distance / 0.3))  # the arm has a length of 0.3 m
    return contact_dynamics.project_to_constraints(released(), dataclasses.replace(z, agents=(agents,)))


@pytest.mark.parametrize(("distance", "t", "closes"), [(0.008, 1.0, True), (0.02, 1.0, False), (0.008, 0.99, False)])
def test_a_contact_closes_within_the_capture_distance(distance, t, closes):
    """It does not close before its time; it then stays closed, and its distance vanishes."""
    team, given = regrasp()
    z = parted(distance)
    found = given.regrasps(team, z, given.initial_regrasps(), jnp.asarray(t))
    assert bool(found[0][0, 0]) == closes
    later = given.regrasps(team, parted(0.02), found, jnp.asarray(t + 1))
    assert bool(later[0][0, 0]) == closes
    if not closes:
        return
    after = jax.jit(contact_dynamics.project_to_constraints)(given.team_at(team, jnp.asarray(t), found), z)
    gap = np.linalg.norm(grasp.constraint_residual(team, after), axis=1)
    assert gap.max() < 1e-4  # of second order in the distance
    assert given.team_at(team, jnp.asarray(t), found).agent_groups[0].contact_compliance.max() == 0


def test_value_of_the_compliance_has_no_influence():
    z, inputs = moving()
    found = [DYNAMICS(released(value), z, inputs, zero_residual(released()))[0] for value in (1e11, 1e13)]
    for one, two in zip(*map(jax.tree.leaves, found), strict=True):
        np.testing.assert_allclose(one, two, atol=1e-7)


def test_compliance_of_zero_is_a_closed_contact():
    z, inputs = moving()
    team = paper.paper_experiment("C1").world.team
    found = [DYNAMICS(of, z, inputs, zero_residual(team))[1][0] for of in (team, released(0.0))]
    np.testing.assert_allclose(found[0], found[1], atol=1e-12)


def test_faults_of_a_scenario_act_in_the_flight():
    """The logged thrust is the remaining share, the released contact has no force, and a stuck reading is held."""
    settings = light.settings(
        faults=light.faults(
            {"kind": "thrust", "who": "n1", "start_s": 0.1, "end_s": 0.2, "to": 0.9},
            {"kind": "contact", "who": "n2/hook", "start_s": 0.3},
        )
    )
    setups = [experiment.make_experiment(of, "C1") for of in (settings, light.settings())]
    rows, free = (flight.run_experiment(dataclasses.replace(setup, duration=0.35)).records for setup in setups)
    t, before = rows.t, rows.t < 0.1 - 1e-9
    np.testing.assert_array_equal(rows.u[before], free.u[before])
    first = int(np.argmax(~before))
    np.testing.assert_allclose(rows.u[first] / free.u[first], [1.0, 0.9, 1.0], rtol=1e-12)
    opened = t > 0.3 - 1e-9
    assert np.abs(rows.lam[opened, 2]).max() < 1e-8
    assert np.linalg.norm(rows.lam[~opened, 2], axis=1).min() > 1


def test_scenario_without_faults_has_none():
    assert experiment.make_experiment(light.settings(), "C1").world.faults is None
