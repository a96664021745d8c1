"""One tick on board: what is recorded, predicted, integrated, observed and limited, read off short flights."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import signals, simulator
from colift.closed_loop.flight import Plan, fly_plan
from colift.models.state import Wrench, flat_payload, no_force
from colift.onboard import controller, interfaces
from colift.onboard.control import agent_controllers, allocation, payload_controllers, tracking
from colift.onboard.estimation import state_estimator
from colift.onboard.learning import recorder, residual_model, residual_predictors
from colift.scenario import experiment
from colift.simulation import disturbances, sensors
from colift.trajectories import base
from tests import paper_flights
from tests.paper_flights import ROOM, SETTINGS, exact, number, plan, with_pilot

DT = 1 / SETTINGS.control_Hz


def flown(plan: Plan, chunks: int = 1) -> tuple[simulator.Loop, signals.Row]:
    """The loop after some half seconds, and its log."""
    loop, rows = simulator.start(plan.setup, plan.z), []
    noise = plan.world.draw(jax.random.key(0), ROOM)
    for _ in range(chunks):
        loop, some = simulator.advance(plan.setup, loop, noise, jnp.asarray(ROOM))
        rows.append(jax.tree.map(np.asarray, some))
    return loop, jax.tree.map(lambda *x: np.concatenate(x), *rows)


def recording(case: str, **parts: Any) -> Plan:
    """A case with its recorder changed."""
    of = plan(case)
    return with_pilot(of, recorder=dataclasses.replace(of.pilot.recorder, **parts))


@pytest.mark.parametrize(("case", "payload", "agents"), [("C1", 0, 0), ("C2", 1, 0), ("C3", 1, 1), ("P", 1, 0)])
def test_each_case_records_what_it_learns_from_and_nothing_else(case, payload, agents):
    loop, _ = flown(recording(case, start=number(0.1), every=number(0.04)))
    n = 10  # 0.1, 0.14, .. 0.46 s
    assert int(loop.memory.recorder.payload.n) == payload * n
    assert list(loop.memory.recorder.agents[0].n) == [agents * n] * 2


def test_samples_are_taken_at_their_rate_between_start_and_end():
    loop, rows = flown(recording("C3", start=number(0.06), every=number(0.05), end=number(0.31)))
    data = loop.memory.recorder.payload
    expected = [0.06, 0.11, 0.16, 0.21, 0.26, 0.31]
    np.testing.assert_allclose(data.t[: int(data.n)], expected, atol=1e-9)
    np.testing.assert_array_equal(loop.memory.recorder.agents[0].t[:, :6], np.tile(data.t[:6], (2, 1)))
    # the label filter delays by some ticks what it pairs with the label: positions are near, not equal
    at = np.searchsorted(rows.t, np.array(expected) - 1e-9)
    np.testing.assert_allclose(data.X[:6, :3], rows.p[at], atol=0.05)


def test_recording_ends_at_the_capacity():
    of = recording("C3", start=number(0.0), every=number(DT))
    loop, _ = flown(of, chunks=2)
    assert int(loop.memory.recorder.payload.n) == of.pilot.oracle.payload.capacity == 256
    np.testing.assert_allclose(loop.memory.recorder.payload.t, DT * np.arange(256), atol=1e-12)


@pytest.mark.long
def test_of_a_calibration_rig_true_states_and_bounded_labels_are_recorded():
    """The sensors are noisy, the labels are the true residual off by the rig's error, the inputs the true states."""
    of = recording("C3", start=number(0.06), every=number(0.05))
    of = with_pilot(paper_flights.believed(of), recorder=recorder.FromRig(**vars(of.pilot.recorder)))
    rng = np.random.default_rng(0)
    error = jax.tree.map(lambda x: jnp.array(rng.uniform(0.01, 0.1, x.shape)), no_force(of.world.team))
    of = paper_flights.with_world(of, extra=(sensors.Rig(error=error),))
    loop, rows = flown(of)
    n = int(loop.memory.recorder.payload.n)
    assert n == 9  # 0.06, 0.11, .. 0.46 s
    rows = jax.tree.map(lambda x: x[np.round(np.asarray(loop.memory.recorder.payload.t)[:n] / DT).astype(int)], rows)
    payload, (agents,) = signals.inputs(of.world.team, rows)
    np.testing.assert_allclose(loop.memory.recorder.payload.X[:n, :18], payload, atol=1e-12)
    assert not loop.memory.recorder.payload.X[:n, 18:].any()  # accelerations are not an input of the learned map
    np.testing.assert_allclose(loop.memory.recorder.agents[0].X[:, :n].transpose(1, 0, 2), agents, atol=1e-12)
    z, _ = paper_flights.states(of.world.team, rows)
    f = jax.jit(jax.vmap(disturbances.at_start, in_axes=(None, None, 0)))(of.world.sources, of.world.team, z)
    off = np.asarray(loop.memory.recorder.payload.Y)[:n] - np.concatenate([f.payload.F, f.payload.tau], axis=1)
    bound = np.concatenate([error.payload.F, error.payload.tau])
    np.testing.assert_allclose(np.abs(off), np.tile(bound, (n, 1)), rtol=1e-8)
    (g,), (e,) = f.agents, error.agents
    off = np.asarray(loop.memory.recorder.agents[0].Y)[:, :n] - np.concatenate([g.f_x, g.f_w, g.f_r], 2).transpose(
        1, 0, 2
    )
    bound = np.concatenate([e.f_x, e.f_w, e.f_r], axis=1)
    np.testing.assert_allclose(np.abs(off), np.tile(bound[:, None], (1, n, 1)), rtol=1e-8)
    assert (np.ptp(np.sign(off), axis=1) > 0).any()


# The law at an exact state --------------------------------------------------------------------------------------------


setpoints = jax.jit(jax.vmap(lambda path, t: path.at(t), in_axes=(None, 0)))


def commanded(rows: signals.Row, leader: payload_controllers.Geometric, path: base.Reference) -> np.ndarray:
    """`a_cmd` of the paper's law, with the true errors."""
    a_d = np.array(setpoints(path, jnp.asarray(rows.t)).a)
    return a_d - rows.e_p @ np.asarray(leader.gains.K_p) - rows.e_v @ np.asarray(leader.gains.K_v)


@pytest.mark.long
def test_integral_action_sums_the_errors_tick_by_tick():
    of = exact(plan("I"))
    _, rows = flown(of)
    nominal, gains = of.pilot.team, of.pilot.leader
    a = commanded(rows, gains.leader, of.pilot.path) - float(gains.K_i) * DT * np.cumsum(rows.e_p, axis=0)
    np.testing.assert_allclose(
        rows.W_d[:, :3], float(nominal.payload.mass) * (a - np.asarray(nominal.gravity)), atol=1e-6
    )
    assert np.abs(a - commanded(rows, gains.leader, of.pilot.path)).max() > 0.01
    J, w = np.asarray(nominal.payload.inertia), rows.omega_L
    turn = float(gains.leader.gains.k_R) * rows.e_R + float(gains.leader.gains.k_omega) * rows.e_omega
    alpha = -turn - float(gains.k_i) * DT * np.cumsum(rows.e_R, axis=0)
    np.testing.assert_allclose(rows.W_d[:, 3:], alpha @ J + np.cross(w, w @ J), atol=1e-6)


@pytest.mark.long
def test_the_wrench_observer_filters_what_the_last_command_did_not_explain():
    of = exact(plan("DOB"))
    _, rows = flown(of)
    z, inputs = paper_flights.states(of.world.team, rows)

    # the readings of a tick are taken under the command of the tick before
    a, _ = paper_flights.answer(of, jax.tree.map(lambda x: x[1:], z), jax.tree.map(lambda x: x[:-1], inputs))
    a = np.asarray(a)
    w, J = rows.omega_L[1:], np.asarray(of.pilot.team.payload.inertia)
    w_dot = np.diff(rows.omega_L, axis=0) / DT
    gravity = np.asarray(of.pilot.team.gravity)
    missed = np.concatenate(
        [float(of.pilot.team.payload.mass) * (a[:, :3] - gravity), w_dot @ J + np.cross(w, w @ J)], axis=1
    )
    missed -= rows.W_d[:-1]
    b, d = 1 - np.exp(-2 * np.pi * float(of.pilot.predictor.bandwidth) * DT), np.zeros(6)
    np.testing.assert_array_equal(rows.f_L_hat[0], 0)
    for k, sample in enumerate(missed):
        d = d + b * (sample - d)
        np.testing.assert_allclose(rows.f_L_hat[k + 1], d, atol=1e-5)


@pytest.mark.long
def test_the_parametric_part_is_evaluated_at_the_commanded_acceleration():
    """Case O is told the disturbances and knows the mismatch: what remains is `Y(a_cmd) theta` (errata, row 12)."""
    of = exact(plan("O"))
    _, rows = flown(of)
    z, _ = paper_flights.states(of.world.team, rows)
    told = jax.jit(jax.vmap(disturbances.at_start, in_axes=(None, None, 0)))(of.world.sources, of.world.team, z).payload
    nominal = of.pilot.team
    dm = float(nominal.payload.mass - of.world.team.payload.mass)
    expected = told.F + dm * (commanded(rows, of.pilot.leader, of.pilot.path) - np.asarray(nominal.gravity))
    np.testing.assert_allclose(rows.f_L_hat[:, :3], expected, atol=1e-6)


def test_residuals_known_exactly_are_told_to_case_O_alone():
    for case in experiment.CASES | experiment.BASELINES:
        assert isinstance(plan(case).pilot.predictor, residual_predictors.Known) == (case == "O")
        assert not np.any(plan(case).pilot.oracle.theta)


def test_predictions_are_the_frozen_oracle_s_at_the_estimated_state():
    """Between updates one oracle predicts, whatever is recorded meanwhile; before the first it predicts zero."""
    of = dataclasses.replace(exact(plan("C3")), duration=2.0, updates=(1.0,))
    flight = fly_plan(of)
    rows = flight.rows
    after = rows.t >= 1.0 - 1e-9
    assert not rows.f_L_hat[~after].any()
    assert not rows.f_x_hat[~after].any()
    z, _ = paper_flights.states(of.world.team, jax.tree.map(lambda x: x[after], rows))
    x = jax.vmap(flat_payload, in_axes=(0, None))(z.payload, jnp.zeros(6))
    W = jax.jit(jax.vmap(residual_model.payload_mean, in_axes=(None, 0)))(flight.oracle, x)
    np.testing.assert_allclose(rows.f_L_hat[after], np.concatenate([W.F, W.tau], axis=1), atol=1e-6)
    assert np.abs(W.F).max() > 0.1


@functools.partial(jax.jit, static_argnums=0)
def _realized(lam_dot_of: Any, pilot: controller.LeaderFollower, now: interfaces.Now, lam: jax.Array) -> Any:
    """What agents are asked when the rate of their forces is that of an allocation, given the forces themselves."""
    to = tracking.command(pilot.leader.gains, now.q_hat.payload, now.q_hat.a_L[:3], now.d)
    forces = interfaces.Forces(lam=lam, lam_dot=lam_dot_of(pilot, now.q_hat, to), eta=pilot.allocator.internal.eta)
    return pilot.realizer.realize(now, to, forces, no_force(pilot.team))[0]


def _rate_by_differences(
    pilot: controller.LeaderFollower, q_hat: state_estimator.Estimate, to: tracking.Command
) -> jax.Array:
    """How the allocated forces change with the wrench `m jerk`, by differences of whole allocations."""
    m, h, R = pilot.team.payload.mass, 0.5, q_hat.payload.R
    eta, plan = jnp.zeros_like(pilot.allocator.internal.eta), pilot.allocator.allocation
    ends = [allocation.apply(plan, R, Wrench(F=m * (to.a + s * to.jerk), tau=jnp.zeros(3)), eta) for s in (h, -h)]
    return (ends[0] - ends[1]) / (2 * h)


@pytest.mark.long
def test_the_attitude_s_feed_forward_takes_the_rate_of_the_allocated_forces_without_their_constant_part():
    """Contact forces with a constant internal part lam_f0 (Eq. follower_force), at a moving state."""
    of = exact(plan("C1"))
    rng = np.random.default_rng(0)
    allocator = of.pilot.allocator
    kernel = allocator.allocation.kernel
    offset = kernel @ jnp.array(rng.normal(size=kernel.shape[1]))
    allocation = dataclasses.replace(allocator.allocation, offset=offset)
    of = with_pilot(of, allocator=dataclasses.replace(allocator, allocation=allocation))
    _, rows = flown(of)
    z, _ = paper_flights.states(of.world.team, jax.tree.map(lambda x: x[100:101], rows))
    z = jax.tree.map(lambda x: x[0], z)
    now = controller.known(of.pilot, z, jnp.array([0.5, -1.0, 0.3, 0, 0, 0]), number(100 * DT))
    inputs, _, decided = jax.jit(lambda pilot, now: pilot.decide((), (), now))(of.pilot, now)
    assert np.abs(offset).max() > 0.1
    expected = _realized(_rate_by_differences, of.pilot, now, decided.lam_cmd)
    for found, told in zip(jax.tree.leaves(inputs), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(found, told, atol=1e-8)
    without = _realized(lambda *_: jnp.zeros_like(decided.lam_cmd), of.pilot, now, decided.lam_cmd)
    assert np.abs(inputs[0].tau - without[0].tau).max() > 1e-3  # the rate counts


def test_thrust_is_limited_to_what_the_rotors_give_and_the_limit_is_reported():
    of = plan("C1")
    (group,) = of.pilot.team.groups
    weak = dataclasses.replace(group, thrust_max=jnp.array([23.5, 50.0]))
    of = with_pilot(of, team=dataclasses.replace(of.pilot.team, groups=(weak,)))
    _, rows = flown(of)
    assert rows.u[:, 0].max() == 23.5
    assert rows.u[:, 1].max() > 23.5
    np.testing.assert_array_equal(rows.saturated[:, 0], rows.u[:, 0] == 23.5)
    assert rows.saturated[:, 0].any()
    assert not rows.saturated[:, 1].any()


def test_internal_forces_follow_their_pulse():
    of = plan("C1")
    of = paper_flights.with_internal(of, start=number(0.1), end=number(0.4), ramp=number(0.1))
    internal = of.pilot.allocator.internal
    _, rows = flown(of)
    height = base.pulse(jnp.asarray(rows.t), internal.start, internal.end, internal.ramp)
    np.testing.assert_allclose(rows.eta, np.outer(height, internal.eta), atol=1e-12)
    assert np.linalg.norm(rows.eta, axis=1).max() >= 1


# Looking ahead --------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_looking_ahead_a_team_without_unknowns_keeps_to_its_path():
    """What the paper's attitude neglects, and the swing, is all that is left once nothing is unknown or noisy."""
    of = exact(plan("C1"))
    of = dataclasses.replace(of, world=dataclasses.replace(of.world, team=of.pilot.team, acting=number(0.0)))
    ours, gains = of.pilot.realizer, of.pilot.leader.gains
    far = agent_controllers.Anticipating(gains=gains, heading=ours.heading, rest=ours.rest)
    flights = [
        fly_plan(dataclasses.replace(x, duration=6.0))
        for x in (of, with_pilot(of, realizer=far, look_ahead=number(0.03)))
    ]
    late = [np.linalg.norm(flight.rows.e_p[-1000:], axis=1).max() for flight in flights]
    assert late[1] < late[0] / 5, late
    assert not flights[1].rows.saturated[500:].any()


def test_a_realizer_that_needs_to_look_ahead_says_so():
    of = plan("C1")
    ours = of.pilot.realizer
    far = agent_controllers.Anticipating(gains=ours.gains, heading=ours.heading, rest=ours.rest)
    with pytest.raises(ValueError, match="needs a pilot that looks ahead"):
        fly_plan(dataclasses.replace(with_pilot(of, realizer=far), duration=0.01))
