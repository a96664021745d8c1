"""Tests of open contacts on board: detection, joint rates, and the torques of an arm without a contact."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.analysis import metrics
from colift.closed_loop import flight
from colift.math import so3
from colift.models import aerial_manipulator
from colift.models.parameters import OPEN_COMPLIANCE, Team
from colift.models.state import State, zero_residual
from colift.onboard import controller
from colift.onboard.control import tracking
from colift.onboard.estimation import contact_monitor, nav_filter, state_estimator
from colift.scenario import experiment
from colift.simulation import contact_dynamics
from colift.workflows import python_api
from tests.support import paper_flights as paper

PAPER = paper.paper_experiment("C1")
TEAM = PAPER.controller.team
POSITION, ATTITUDE, JOINT, FORCE = 0.002, 0.003, 0.001, 0.1
NOISE = contact_monitor.ReadingNoise(position=POSITION, attitude=ATTITUDE, joint=JOINT, tip_force=FORCE)
POSTURE = tuple(q.r for q in PAPER.initial_state.agents)
MONITOR = contact_monitor.contact_monitor(TEAM, POSTURE, NOISE, 5.0, 0.002)
AT_REST = PAPER.world.measure_at_rest(PAPER.initial_state)
CLOSED = MONITOR.init(TEAM, AT_REST)
LATE = jnp.asarray(1.0)  # s, after the state estimate has settled


def opened(team: Team, *contacts: tuple[int, int]) -> Team:
    """Return a team of one group with open contacts, stated as agent and arm."""
    (group,) = team.agent_groups
    value = np.zeros(group.contact_position.shape[:2])
    for contact in contacts:
        value[contact] = OPEN_COMPLIANCE
    return dataclasses.replace(team, agent_groups=(dataclasses.replace(group, contact_compliance=jnp.asarray(value)),))


@jax.jit
def detect(
    state: contact_monitor.OpenContacts, r: jax.Array, lam: jax.Array, t: jax.Array
) -> contact_monitor.OpenContacts:
    """Return the open contacts for joint readings and contact forces at the initial state."""
    z = PAPER.initial_state
    estimate = state_estimator.StateEstimate(agents=z.agents, payload=z.payload, a_L=jnp.zeros(6), lam=(lam,))
    (reading,) = AT_REST.agents
    return MONITOR.update(
        state, TEAM, estimate, dataclasses.replace(AT_REST, agents=(dataclasses.replace(reading, r=r),)), t
    )


@pytest.mark.parametrize(("angle", "force", "is_open"), [(0.2, 0.1, True), (0.2, 3.0, False), (0.001, 0.1, False)])
def test_an_open_contact_is_away_and_unloaded(angle, force, is_open):
    r = PAPER.initial_state.agents[0].r.at[1, 2].add(angle)
    (found,) = detect(CLOSED, r, jnp.full((2, 2, 3), 3.0).at[1, 1].set(force / 3**0.5), LATE)
    np.testing.assert_array_equal(found, [[False, False], [False, is_open]])
    assert not np.asarray(detect(CLOSED, r, jnp.zeros((2, 2, 3)), jnp.asarray(0.05))[0]).any()


def test_a_contact_closes_by_the_report_of_its_gripper():
    z, before = PAPER.initial_state, (jnp.array([[True, False], [True, False]]),)
    estimate = state_estimator.StateEstimate(
        agents=z.agents, payload=z.payload, a_L=jnp.zeros(6), lam=(jnp.zeros((2, 2, 3)),)
    )
    reading = dataclasses.replace(AT_REST, regrasped=(jnp.array([[True, False], [False, False]]),))
    (found,) = jax.jit(MONITOR.update)(before, TEAM, estimate, reading, LATE)
    np.testing.assert_array_equal(found, [[False, False], [True, False]])


def test_an_open_contact_stays_open():
    """An agent can lose its last contact."""
    at_rest, light = PAPER.initial_state.agents[0].r, jnp.zeros((2, 2, 3))
    (found,) = detect((jnp.array([[False, False], [True, False]]),), at_rest, light, LATE)
    np.testing.assert_array_equal(found, [[False, False], [True, False]])
    (found,) = detect((found,), at_rest + 0.2, light, LATE)
    np.testing.assert_array_equal(found[1], [True, True])


def test_a_gripper_reports_contacts_open_from_the_start():
    given = (jnp.array([[True, False], [False, False]]),)
    reading = dataclasses.replace(AT_REST, ungrasped=given)
    assert MONITOR.init(TEAM, reading) is given
    assert not np.asarray(CLOSED[0]).any()


def test_the_standard_deviation_is_that_of_noisy_readings():
    rng, (agents,), payload = np.random.default_rng(0), PAPER.initial_state.agents, PAPER.initial_state.payload
    count = 4000

    @jax.jit
    @jax.vmap
    def gaps(noise: jax.Array) -> jax.Array:
        q = dataclasses.replace(
            agents,
            R=agents.R @ so3.exp(ATTITUDE * noise[:2]),
            r=agents.r + JOINT * noise[2:4],
        )
        model = jax.vmap(lambda agent, r: aerial_manipulator.forward_kinematics(agent, r).points[-2:])
        tips = jnp.einsum("aij,abj->abi", q.R, model(TEAM.agent_groups[0], q.r)) + POSITION * noise[4:6][:, None]
        R_L = payload.R @ so3.exp(ATTITUDE * noise[6])
        return tips - TEAM.agent_groups[0].contact_position @ R_L.T - POSITION * noise[7][None, None]

    found = np.asarray(gaps(jnp.asarray(rng.normal(size=(count, 8, 3)))))
    # relative standard error of a variance of three components: sqrt(2 / 3 / count), below 0.02 for unequal ones
    unfiltered = contact_monitor.contact_monitor(TEAM, POSTURE, NOISE, 1e4, 0.002)
    np.testing.assert_allclose(found.var(0).sum(-1), np.asarray(unfiltered.distance_std[0]) ** 2, rtol=0.1)
    np.testing.assert_allclose(MONITOR.force_std, FORCE * 3**0.5)


def test_open_contacts_have_a_compliance():
    acting = MONITOR.acting((jnp.array([[True, False], [True, True]]),), TEAM)
    np.testing.assert_array_equal(acting.agent_groups[0].closed_contacts, [[0, 1], [0, 0]])
    np.testing.assert_array_equal(acting.closed_contacts, [0, 1, 0, 0])


def test_joint_rates_of_a_free_arm_are_those_of_the_encoders():
    z = PAPER.initial_state
    q = jax.tree.map(lambda x: x[0], z.agents[0])
    rate, base = jnp.array([0.3, 2.0, -1.0]), nav_filter.NavState(R=q.R, x=q.x, v=jnp.zeros(3))

    @jax.jit
    def rates(team: Team) -> jax.Array:
        agent = jax.tree.map(lambda x: x[0], team.agent_groups[0])
        g = aerial_manipulator.forward_kinematics(agent, q.r)
        return state_estimator.joint_rates(agent, g, base, jnp.zeros(3), z.payload, rate)

    closed, half, free = (np.asarray(rates(opened(TEAM, *which))) for which in ((), ((0, 0),), ((0, 0), (0, 1))))
    np.testing.assert_allclose(closed, 0.0, atol=0.01)  # the payload is at rest
    np.testing.assert_allclose([half[1], half[2]], [2.0, 0.0], atol=0.01)
    np.testing.assert_allclose(free, rate, rtol=1e-12)


def test_the_free_arm_returns_to_its_contact():
    """A deflection of its joint changes the acceleration of the joint in the closed loop by `-k_R` times itself."""
    onboard, zero, f_hat = PAPER.controller, jnp.zeros(3), zero_residual(TEAM)
    (agents,), payload = PAPER.initial_state.agents, PAPER.initial_state.payload
    team, rest = opened(TEAM, (0, 1)), tracking.AccelerationCommand(a=zero, alpha=zero, jerk=zero)

    @jax.jit
    def response(deflection: jax.Array) -> tuple[jax.Array, jax.Array, jax.Array]:
        """Return the acceleration of the free joint, and the commanded and the true contact force of its arm."""
        moved = dataclasses.replace(agents, r=agents.r.at[0, 2].add(deflection))
        kinematics = jax.vmap(aerial_manipulator.center_of_mass)
        before, after = (kinematics(TEAM.agent_groups[0], q.r) for q in (agents, moved))
        moved = dataclasses.replace(moved, x=agents.x + jnp.einsum("aij,aj->ai", agents.R, after - before))
        z = dataclasses.replace(PAPER.initial_state, agents=(moved,))
        now = controller.context_at(dataclasses.replace(onboard, team=team), z, jnp.zeros(6), jnp.zeros(()))
        forces, _ = onboard.allocator.allocate((), now, controller.tracking_demand(TEAM, payload, rest, f_hat))
        (inputs, _), _ = onboard.agent_controller.compute((), now, rest, forces, f_hat)
        acceleration, lam = contact_dynamics.forward_dynamics(team, z, inputs, f_hat)
        return acceleration.agents[0].xi_dot[0, 5], forces.lam[1], lam[0][0, 1]

    (a_0, _, _), (a, commanded, true) = response(jnp.asarray(0.0)), response(jnp.asarray(0.01))
    np.testing.assert_allclose(a - a_0, -0.01 * float(onboard.agent_controller.gains.agent_k_R), rtol=0.1)
    np.testing.assert_allclose([commanded, true], 0.0, atol=1e-9)


def test_an_agent_without_contacts_returns_to_its_contact_points():
    """A displacement d changes its thrust by `-m K_p d`, and the commanded payload acceleration has no influence."""
    onboard, f_hat, d = PAPER.controller, zero_residual(TEAM), jnp.array([0.01, -0.02, 0.03])
    (agents,), payload = PAPER.initial_state.agents, PAPER.initial_state.payload
    team, zero = opened(TEAM, (0, 0), (0, 1)), jnp.zeros(3)

    @jax.jit
    def thrusts(d: jax.Array, a: jax.Array) -> tuple[jax.Array, jax.Array]:
        """Return the desired thrust vectors and the thrusts."""
        moved = dataclasses.replace(agents, x=agents.x.at[0].add(d))
        z, command = State(agents=(moved,), payload=payload), tracking.AccelerationCommand(a=a, alpha=zero, jerk=zero)
        now = controller.context_at(dataclasses.replace(onboard, team=team), z, jnp.zeros(6), jnp.zeros(()))
        demand = controller.tracking_demand(TEAM, payload, command, f_hat)
        forces, _ = onboard.allocator.allocate((), now, demand)
        (steering,) = onboard.agent_controller._steering(now, command)
        (inputs, _), _ = onboard.agent_controller.compute((), now, command, forces, f_hat)
        return steering + a[None], inputs[0].u

    (a_0, u_0), (a_1, u_1), (a_2, u_2) = thrusts(zero, zero), thrusts(d, zero), thrusts(d, jnp.array([0.5, 0.4, 0.3]))
    m, up = TEAM.agent_groups[0].mass[0].sum(), agents.R[0][:, 2]
    expected = -onboard.agent_controller.gains.K_p @ d
    np.testing.assert_allclose((a_1 - a_0)[0], expected, rtol=1e-9)
    np.testing.assert_allclose(a_2[0], a_1[0], atol=1e-12)
    np.testing.assert_allclose([u_1[0] - u_0[0], u_2[0] - u_1[0]], [m * up @ expected, 0.0], atol=1e-9)
    np.testing.assert_allclose((a_1 - a_0)[1], 0.0, atol=1e-12)


@pytest.mark.long
@pytest.mark.parametrize("free", [("left",), ("left", "right")])
def test_an_agent_flies_before_its_grasp(free):
    """A free arm grasps at 1 s. In case C1 an agent in free flight has the offset `f / (m K_p)` of its residual f."""
    faults = [{"kind": "contact", "who": f"agent_1/{arm}", "start_s": 0.0, "end_s": 1.0} for arm in free]
    settings = python_api.load_scenario("trio", {"allocation": {"kind": "constrained"}, "faults": faults})
    setup = experiment.make_experiment(settings, "C1")
    result = flight.run_experiment(dataclasses.replace(setup, duration=4.0))
    rows, last = result.records, result.records.t > 3.5
    lam = np.linalg.norm(rows.lam, axis=2)
    assert not result.termination_reason
    assert lam[rows.t < 1, 0].max() < 1e-8
    if len(free) == 1:
        assert lam[last, 0].min() > 1
        return
    assert lam[:, :2].max() < 1e-8
    group, c = setup.world.team.agent_groups[0], np.asarray(setup.world.team.agent_groups[0].contact_position[0])
    joints = rows.r[last].reshape(last.sum(), 3, -1)[:, 0]
    agent = jax.tree.map(lambda x: x[0], group)
    tips = jax.vmap(lambda r: aerial_manipulator.forward_kinematics(agent, r).points[-2:])(jnp.asarray(joints))
    tips = rows.x[last, 0, None] + np.einsum("tij,taj->tai", rows.R[last, 0], tips)
    gap = (tips - rows.p[last, None] - np.einsum("tij,aj->tai", rows.R_L[last], c)).mean((0, 1))
    stiffness = float(agent.mass.sum()) * np.asarray(setup.controller.agent_controller.gains.K_p)
    np.testing.assert_allclose(gap, np.linalg.solve(stiffness, rows.f_x[last, 0].mean(0)), atol=0.02)


@pytest.mark.long
def test_a_flight_continues_after_a_regrasp():
    """The contact closes, bears its force again, and no force exceeds that of the flight with an open contact."""
    fault = {"kind": "contact", "who": "agent_1/left", "start_s": 2.0, "end_s": 4.0}
    settings = python_api.load_scenario("trio", {"allocation": {"kind": "constrained"}, "faults": [fault]})
    setup = experiment.make_experiment(settings, "C1")
    result = flight.run_experiment(dataclasses.replace(setup, duration=6.0))
    t, lam = np.asarray(result.records.t), np.linalg.norm(result.records.lam, axis=2)
    assert not result.termination_reason
    assert lam[(t > 2.1) & (t < 3.9), 0].max() < 1e-8
    assert lam[t > 5, 0].min() > 1
    assert not metrics.warn_step_size(result.records)  # the impact is no error of the time step
    assert lam[t > 4].max() < lam[(t > 2) & (t < 4)].max()


@pytest.mark.long
def test_a_flight_continues_with_one_contact_less():
    """Without the detection the vehicle is lost within 0.9 s."""
    overrides = {
        "allocation": {"kind": "constrained"},
        "faults": [{"kind": "contact", "who": "front/left", "start_s": 2.0}],
    }
    setup = experiment.make_experiment(python_api.load_scenario("paper", overrides), "C1")
    result = flight.run_experiment(dataclasses.replace(setup, duration=5.0))
    after = np.asarray(result.records.t) >= 2.0
    assert not result.termination_reason
    assert np.linalg.norm(result.records.lam[after], axis=2).max() < 12.0
