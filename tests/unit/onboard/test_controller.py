"""Tests of one control step: recording, prediction, integration, observer and limits, from short simulations."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import signals, simulator
from colift.closed_loop.flight import Experiment, run_experiment
from colift.math import so3
from colift.models.state import Wrench, flatten_payload_state, zero_residual
from colift.onboard import controller, interfaces
from colift.onboard.control import agent_controllers, allocation, payload_controllers, tracking
from colift.onboard.estimation import state_estimator
from colift.onboard.learning import recorder, residual_model, residual_predictors
from colift.scenario.cases import BASELINES, PAPER_CASES
from colift.simulation import disturbances, sensors
from colift.trajectories import base
from tests.support import paper_flights
from tests.support.paper_flights import ROOM, SETTINGS, number, paper_experiment, with_controller, with_exact_sensors

DT = 1 / SETTINGS.control_Hz


def simulate_chunks(one_experiment: Experiment, chunks: int = 1) -> tuple[simulator.LoopState, signals.StepRecord]:
    """Return the loop after some half seconds, and its log."""
    loop, rows = simulator.reset(one_experiment.loop_config, one_experiment.initial_state), []
    noise = one_experiment.world.sample_noise(jax.random.key(0), ROOM)
    for _ in range(chunks):
        loop, some = simulator.rollout(one_experiment.loop_config, loop, noise, jnp.asarray(ROOM))
        rows.append(jax.tree.map(np.asarray, some))
    return loop, jax.tree.map(lambda *x: np.concatenate(x), *rows)


def recording(case: str, **parts: Any) -> Experiment:
    """Return a case with its recorder changed."""
    of = paper_experiment(case)
    return with_controller(of, recorder=dataclasses.replace(of.controller.recorder, **parts))


@pytest.mark.parametrize(
    ("case", "payload", "agents"), [("C1", 0, 0), ("C2", 1, 0), ("C3", 1, 1), ("parametric", 1, 0)]
)
def test_each_case_records_only_its_training_data(case, payload, agents):
    loop, _ = simulate_chunks(recording(case, start=number(0.1), sample_period=number(0.04)))
    n = 10  # 0.1, 0.14, .. 0.46 s
    assert int(loop.controller.recorder.payload.n) == payload * n
    assert list(loop.controller.recorder.agents[0].n) == [agents * n] * 2


def test_samples_have_their_rate_between_start_and_end():
    loop, rows = simulate_chunks(recording("C3", start=number(0.06), sample_period=number(0.05), end=number(0.31)))
    data = loop.controller.recorder.payload
    expected = [0.06, 0.11, 0.16, 0.21, 0.26, 0.31]
    np.testing.assert_allclose(data.t[: int(data.n)], expected, atol=1e-9)
    np.testing.assert_array_equal(loop.controller.recorder.agents[0].t[:, :6], np.tile(data.t[:6], (2, 1)))
    # the label filter delays the inputs by some steps: positions are close, not equal
    at = np.searchsorted(rows.t, np.array(expected) - 1e-9)
    np.testing.assert_allclose(data.X[:6, :3], rows.p[at], atol=0.05)


def test_recording_ends_at_the_capacity():
    of = recording("C3", start=number(0.0), sample_period=number(DT))
    loop, _ = simulate_chunks(of, chunks=2)
    assert int(loop.controller.recorder.payload.n) == of.controller.residual_model.payload.capacity == 256
    np.testing.assert_allclose(loop.controller.recorder.payload.t, DT * np.arange(256), atol=1e-12)


@pytest.mark.long
def test_calibration_rig_records_true_states():
    """With noisy sensors the labels are the true residual plus the rig's error, and the inputs are true states."""
    of = recording("C3", start=number(0.06), sample_period=number(0.05))
    of = with_controller(
        paper_flights.with_nominal_world(of), recorder=recorder.RigRecorder(**vars(of.controller.recorder))
    )
    rng = np.random.default_rng(0)
    error = jax.tree.map(lambda x: jnp.array(rng.uniform(0.01, 0.1, x.shape)), zero_residual(of.world.team))
    of = paper_flights.with_world(of, sensor_models=(sensors.CalibrationRig(label_error=error),))
    loop, rows = simulate_chunks(of)
    n = int(loop.controller.recorder.payload.n)
    assert n == 9  # 0.06, 0.11, .. 0.46 s
    rows = jax.tree.map(
        lambda x: x[np.round(np.asarray(loop.controller.recorder.payload.t)[:n] / DT).astype(int)], rows
    )
    payload, (agents,) = signals.model_inputs(of.world.team, rows)
    np.testing.assert_allclose(loop.controller.recorder.payload.X[:n, :18], payload, atol=1e-12)
    assert not loop.controller.recorder.payload.X[:n, 18:].any()  # accelerations are no model input
    np.testing.assert_allclose(loop.controller.recorder.agents[0].X[:, :n].transpose(1, 0, 2), agents, atol=1e-12)
    z, _ = paper_flights.states(of.world.team, rows)
    f = jax.jit(jax.vmap(disturbances.initial_forces, in_axes=(None, None, 0)))(of.world.disturbances, of.world.team, z)
    off = np.asarray(loop.controller.recorder.payload.Y)[:n] - np.concatenate([f.payload.F, f.payload.tau], axis=1)
    bound = np.concatenate([error.payload.F, error.payload.tau])
    np.testing.assert_allclose(np.abs(off), np.tile(bound, (n, 1)), rtol=1e-8)
    (g,), (e,) = f.agents, error.agents
    off = np.asarray(loop.controller.recorder.agents[0].Y)[:, :n] - np.concatenate([g.f_x, g.f_w, g.f_r], 2).transpose(
        1, 0, 2
    )
    bound = np.concatenate([e.f_x, e.f_w, e.f_r], axis=1)
    np.testing.assert_allclose(np.abs(off), np.tile(bound[:, None], (1, n, 1)), rtol=1e-8)
    assert (np.ptp(np.sign(off), axis=1) > 0).any()


# Control law at an exact state ----------------------------------------------------------------------------------------


setpoints = jax.jit(jax.vmap(lambda path, t: path.evaluate(t), in_axes=(None, 0)))


def commanded(
    rows: signals.StepRecord, payload_controller: payload_controllers.GeometricTracking, path: base.ReferenceTrajectory
) -> np.ndarray:
    """Return `a_cmd` of the paper's law for the true errors."""
    a_d = np.array(setpoints(path, jnp.asarray(rows.t)).a)
    return (
        a_d - rows.e_p @ np.asarray(payload_controller.gains.K_p) - rows.e_v @ np.asarray(payload_controller.gains.K_v)
    )


@pytest.mark.long
def test_integral_action_sums_the_errors():
    of = with_exact_sensors(paper_experiment("integral"))
    _, rows = simulate_chunks(of)
    nominal, gains = of.controller.team, of.controller.payload_controller
    a = commanded(rows, gains.base, of.controller.reference) - float(gains.K_i) * DT * np.cumsum(rows.e_p, axis=0)
    np.testing.assert_allclose(
        rows.W_d[:, :3], float(nominal.payload.mass) * (a - np.asarray(nominal.gravity)), atol=1e-6
    )
    assert np.abs(a - commanded(rows, gains.base, of.controller.reference)).max() > 0.01
    J, w = np.asarray(nominal.payload.inertia), rows.omega_L
    turn = np.asarray(gains.base.gains.k_R) * rows.e_R + np.asarray(gains.base.gains.k_omega) * rows.e_omega
    alpha = -turn - np.asarray(gains.k_i) * DT * np.cumsum(rows.e_R, axis=0)
    np.testing.assert_allclose(rows.W_d[:, 3:], alpha @ J + np.cross(w, w @ J), atol=1e-6)


@pytest.mark.long
def test_observer_filters_the_unexplained_wrench():
    """The disturbance observer filters the wrench that the last command did not explain."""
    of = with_exact_sensors(paper_experiment("disturbance_observer"))
    _, rows = simulate_chunks(of)
    z, inputs = paper_flights.states(of.world.team, rows)

    # measurements of a step follow from the command of the previous step
    a, _ = paper_flights.accelerations_and_residuals(
        of, jax.tree.map(lambda x: x[1:], z), jax.tree.map(lambda x: x[:-1], inputs)
    )
    a = np.asarray(a)
    w, J = rows.omega_L[1:], np.asarray(of.controller.team.payload.inertia)
    w_dot = np.diff(rows.omega_L, axis=0) / DT
    gravity = np.asarray(of.controller.team.gravity)
    missed = np.concatenate(
        [float(of.controller.team.payload.mass) * (a[:, :3] - gravity), w_dot @ J + np.cross(w, w @ J)], axis=1
    )
    missed -= rows.W_d[:-1]
    hertz = np.repeat(of.controller.residual_predictor.bandwidth, 3)  # of force and moment
    b, d = 1 - np.exp(-2 * np.pi * hertz * DT), np.zeros(6)
    np.testing.assert_array_equal(rows.f_L_hat[0], 0)
    for k, sample in enumerate(missed):
        d = d + b * (sample - d)
        np.testing.assert_allclose(rows.f_L_hat[k + 1], d, atol=1e-5)


@pytest.mark.long
def test_parameter_mismatch_uses_commanded_acceleration():
    """Case `true_residual` has the disturbances; the remainder is `Y(a_cmd) theta` (errata, row 12)."""
    of = with_exact_sensors(paper_experiment("true_residual"))
    _, rows = simulate_chunks(of)
    z, _ = paper_flights.states(of.world.team, rows)
    predicted = jax.jit(jax.vmap(disturbances.initial_forces, in_axes=(None, None, 0)))(
        of.world.disturbances, of.world.team, z
    ).payload
    nominal = of.controller.team
    dm = float(nominal.payload.mass - of.world.team.payload.mass)
    expected = predicted.F + dm * (
        commanded(rows, of.controller.payload_controller, of.controller.reference) - np.asarray(nominal.gravity)
    )
    np.testing.assert_allclose(rows.f_L_hat[:, :3], expected, atol=1e-6)


def test_only_true_residual_uses_the_true_residual():
    for case in PAPER_CASES | BASELINES:
        assert isinstance(paper_experiment(case).controller.residual_predictor, residual_predictors.TrueResidual) == (
            case == "true_residual"
        )
        assert not np.any(paper_experiment(case).controller.residual_model.inertial_parameters)


def test_predictions_use_the_frozen_model():
    """Between updates predictions are those of one model at the estimated state, and zero before the first update."""
    of = dataclasses.replace(with_exact_sensors(paper_experiment("C3")), duration=2.0, update_times=(1.0,))
    flight = run_experiment(of)
    rows = flight.records
    after = rows.t >= 1.0 - 1e-9
    assert not rows.f_L_hat[~after].any()
    assert not rows.f_x_hat[~after].any()
    z, _ = paper_flights.states(of.world.team, jax.tree.map(lambda x: x[after], rows))
    x = jax.vmap(flatten_payload_state, in_axes=(0, None))(z.payload, jnp.zeros(6))
    W = jax.jit(jax.vmap(residual_model.predict_payload, in_axes=(None, 0)))(flight.model, x)
    np.testing.assert_allclose(rows.f_L_hat[after], np.concatenate([W.F, W.tau], axis=1), atol=1e-6)
    assert np.abs(W.F).max() > 0.1


@functools.partial(jax.jit, static_argnums=0)
def _agent_inputs(
    lam_dot_of: Any, controlled: controller.LeaderFollowerController, now: interfaces.ControlContext, lam: jax.Array
) -> Any:
    """Return the inputs of agents for given contact forces and a given rate of these forces."""
    to = tracking.tracking_acceleration(
        controlled.payload_controller.gains, now.estimate.payload, now.estimate.a_L[:3], now.setpoint
    )
    forces = interfaces.ContactForceCommand(
        lam=lam, lam_dot=lam_dot_of(controlled, now.estimate, to), eta=controlled.allocator.internal.eta
    )
    (inputs, _), _ = controlled.agent_controller.compute((), now, to, forces, zero_residual(controlled.team))
    return inputs


def _rate_by_differences(
    controlled: controller.LeaderFollowerController,
    q_hat: state_estimator.StateEstimate,
    to: tracking.AccelerationCommand,
) -> jax.Array:
    """Return the rate of the allocated forces for the wrench of the commanded motion, by differences of allocations.

    The wrench is at most quadratic in time, so that central differences are exact.
    """
    payload, q, h = controlled.team.payload, q_hat.payload, 0.5
    eta, one_experiment = jnp.zeros_like(controlled.allocator.internal.eta), controlled.allocator.allocation

    def forces(s: float) -> jax.Array:
        w = q.omega + s * to.alpha
        tau = payload.inertia @ (to.alpha + s * to.alpha_dot) + so3.cross(w, payload.inertia @ w)
        return allocation.allocate(one_experiment, q.R, Wrench(F=payload.mass * (to.a + s * to.jerk), tau=tau), eta)

    return (forces(h) - forces(-h)) / (2 * h)


@pytest.mark.long
def test_attitude_feedforward_uses_the_force_rate():
    """Contact forces with a constant internal part lam_f0 (Eq. follower_force), at a moving state."""
    of = with_exact_sensors(paper_experiment("C1"))
    rng = np.random.default_rng(0)
    allocator = of.controller.allocator
    kernel = allocator.allocation.nullspace
    offset = kernel @ jnp.array(rng.normal(size=kernel.shape[1]))
    allocation = dataclasses.replace(allocator.allocation, offset=offset)
    of = with_controller(of, allocator=dataclasses.replace(allocator, allocation=allocation))
    _, rows = simulate_chunks(of)
    z, _ = paper_flights.states(of.world.team, jax.tree.map(lambda x: x[100:101], rows))
    z = jax.tree.map(lambda x: x[0], z)
    now = controller.context_at(of.controller, z, jnp.array([0.5, -1.0, 0.3, 0, 0, 0]), number(100 * DT))
    inputs, _, telemetry = jax.jit(lambda controlled, now: controlled.control_law(controlled.init_control_law(), now))(
        of.controller, now
    )
    assert np.abs(offset).max() > 0.1
    expected = _agent_inputs(_rate_by_differences, of.controller, now, telemetry.lam_cmd)
    for found, predicted in zip(jax.tree.leaves(inputs), jax.tree.leaves(expected), strict=True):
        np.testing.assert_allclose(found, predicted, atol=1e-8)
    without = _agent_inputs(lambda *_: jnp.zeros_like(telemetry.lam_cmd), of.controller, now, telemetry.lam_cmd)
    assert np.abs(inputs[0].tau - without[0].tau).max() > 1e-3  # the rate counts


def test_thrust_limit_is_applied_and_reported():
    """Thrust is limited to the maximum of the rotors, and the limit is reported."""
    of = paper_experiment("C1")
    (group,) = of.controller.team.agent_groups
    weak = dataclasses.replace(group, thrust_max=jnp.array([23.5, 50.0]))
    of = with_controller(of, team=dataclasses.replace(of.controller.team, agent_groups=(weak,)))
    _, rows = simulate_chunks(of)
    assert rows.u[:, 0].max() == 23.5
    assert rows.u[:, 1].max() > 23.5
    np.testing.assert_array_equal(rows.thrust_saturated[:, 0], rows.u[:, 0] == 23.5)
    assert rows.thrust_saturated[:, 0].any()
    assert not rows.thrust_saturated[:, 1].any()


def test_internal_forces_follow_their_pulse():
    of = paper_experiment("C1")
    of = paper_flights.with_internal(of, start=number(0.1), end=number(0.4), ramp=number(0.1))
    internal = of.controller.allocator.internal
    _, rows = simulate_chunks(of)
    height = base.smooth_pulse(jnp.asarray(rows.t), internal.start, internal.end, internal.ramp)
    np.testing.assert_allclose(rows.eta, np.outer(height, internal.eta), atol=1e-12)
    assert np.linalg.norm(rows.eta, axis=1).max() >= 1


# Preview --------------------------------------------------------------------------------------------------------------


@pytest.mark.long
def test_preview_reduces_error_without_residuals():
    """Without residuals and noise only the neglected attitude rates of the paper's law remain, which preview
    compensates.
    """
    of = with_exact_sensors(paper_experiment("C1"))
    of = dataclasses.replace(
        of, world=dataclasses.replace(of.world, team=of.controller.team, disturbance_scale=number(0.0))
    )
    ours, gains = of.controller.agent_controller, of.controller.payload_controller.gains
    with_preview = agent_controllers.PreviewThrustVectoringController(
        gains=gains, yaw=ours.yaw, nominal_posture=ours.nominal_posture
    )
    flights = [
        run_experiment(dataclasses.replace(x, duration=6.0))
        for x in (of, with_controller(of, agent_controller=with_preview, preview_step=number(0.03)))
    ]
    late = [np.linalg.norm(flight.records.e_p[-1000:], axis=1).max() for flight in flights]
    assert late[1] < late[0] / 5, late
    assert not flights[1].records.thrust_saturated[500:].any()


def test_preview_controller_requires_a_preview():
    of = paper_experiment("C1")
    ours = of.controller.agent_controller
    with_preview = agent_controllers.PreviewThrustVectoringController(
        gains=ours.gains, yaw=ours.yaw, nominal_posture=ours.nominal_posture
    )
    with pytest.raises(ValueError, match="requires a preview of the reference"):
        run_experiment(dataclasses.replace(with_controller(of, agent_controller=with_preview), duration=0.01))
