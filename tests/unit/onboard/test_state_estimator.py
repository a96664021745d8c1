"""Tests of estimation: filters, states from measurements, and labels equal to the filtered true residual."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift.closed_loop import flight, simulator
from colift.math import filters
from colift.models import aerial_manipulator, inverse_dynamics, measurement
from colift.models.parameters import KinematicTree, Team
from colift.models.state import (
    AgentInput,
    ControlClock,
    ResidualForces,
    State,
    flatten_agent_state,
    flatten_payload_state,
    zero_residual,
)
from colift.onboard.estimation import nav_filter, state_estimator
from colift.simulation import contact_dynamics, sensors
from tests.support import paper_flights
from tests.support import random_teams as teams
from tests.support.paper_flights import number
from tests.support.pinocchio_team import PinocchioTeam

STRUCTURE = ((teams.WAIST_TWO_ARMS, 2),)
DT = 0.002
TICKS = 200


# Filters --------------------------------------------------------------------------------------------------------------


@jax.jit
def apply_low_pass(x: jax.Array, hertz: jax.Array, dt: jax.Array) -> jax.Array:
    """Apply the low-pass in the steady state of the first sample."""

    def step(
        state: filters.SecondOrderLowPassState, sample: jax.Array
    ) -> tuple[filters.SecondOrderLowPassState, jax.Array]:
        state = filters.update(state, sample, filters.smoothing_factor(hertz, dt))
        return state, state.stage2

    return jax.lax.scan(step, filters.steady_state(x[0]), x)[1]


def test_the_low_pass_is_critically_damped():
    dt, hertz = 1e-4, 8.0
    t = dt * np.arange(4000)
    w = 2 * np.pi * hertz
    rise = apply_low_pass(jnp.array(np.where(t > 0, 1.0, 0.0)), jnp.array(hertz), jnp.array(dt))
    np.testing.assert_allclose(rise, 1 - (1 + w * t) * np.exp(-w * t), atol=2 * w * dt)
    np.testing.assert_allclose(apply_low_pass(jnp.full(50, 3.3), jnp.array(hertz), jnp.array(dt)), 3.3, atol=1e-14)


def test_the_low_pass_halves_a_sine_at_its_corner():
    dt, hertz = 1e-4, 8.0
    t = dt * np.arange(10000)
    out = np.asarray(apply_low_pass(jnp.array(np.sin(2 * np.pi * hertz * t)), jnp.array(hertz), jnp.array(dt)))
    assert np.abs(out[-1250:]).max() == pytest.approx(0.5, rel=0.01)


def test_initial_smoothing_factor():
    """The smoothing factor of a sample is that of its time constant."""
    b = filters.smoothing_factor(jnp.array(5.0), jnp.array(DT))
    assert float(b) == pytest.approx(1 - np.exp(-2 * np.pi * 5 * DT), rel=1e-12)
    # n ticks at once or one by one: the same decay
    assert (1 - float(b)) ** 7 == pytest.approx(
        1 - float(filters.smoothing_factor(jnp.array(5.0), jnp.array(7 * DT))), rel=1e-12
    )


@pytest.mark.parametrize("ticks", [1, 3, 50])
def test_irregular_smoothing_factor_is_a_kalman_gain(ticks):
    """The steady gain by Riccati's recursion for a random walk, whose gain at every step is b."""
    b = 0.06
    q = b * b / (1 - b)  # variance of the walk per step, relative to that of a sample
    P = 1.0
    for _ in range(3000):
        P += ticks * q
        K = P / (P + 1)
        P *= 1 - K
    assert float(filters.irregular_smoothing_factor(jnp.array(b), jnp.array(float(ticks)))) == pytest.approx(
        K, rel=1e-9
    )
    assert float(filters.irregular_smoothing_factor(jnp.array(1.0), jnp.array(float(ticks)))) == 1.0


def test_sparse_labels_settle_in_the_same_time():
    """With one label in fifty steps a constant force is estimated to 10 % within a second."""
    b, n = filters.smoothing_factor(jnp.array(5.0), jnp.array(DT)), 50
    state = filters.steady_state(jnp.zeros(()))
    for _ in range(round(1 / DT / n)):
        state = filters.update(state, jnp.ones(()), filters.irregular_smoothing_factor(b, jnp.array(float(n))))
    assert float(state.stage2) > 0.9
    counted = filters.steady_state(jnp.zeros(()))
    for _ in range(round(1 / DT / n)):
        counted = filters.update(counted, jnp.ones(()), b)
    assert float(counted.stage2) < 0.5


CORNERS = {"complementary": 5.0, "imu_bias": 0.0, "joint": 20.0, "label": 8.0, "tip_force": 50.0}
FILTERS = nav_filter.FilterBandwidths(**{name: jnp.array(hertz) for name, hertz in CORNERS.items()})


def constant_motion(
    noise: float, runs: int, seed: int = 0, hertz: float = 0.0
) -> tuple[nav_filter.NavState, nav_filter.NavState, nav_filter.NavState]:
    """Bodies at constant rate and acceleration: truth, measurements, and estimates of the complementary filter."""
    rng = np.random.default_rng(seed)
    time = 400
    omega, a = np.array([0.3, -0.5, 0.8]), np.array([0.5, 1.0, -0.4])
    t = DT * np.arange(time)
    R = Rotation.from_rotvec(t[:, None] * omega).as_matrix()
    truth = nav_filter.NavState(R=jnp.array(R), x=jnp.array(t[:, None] ** 2 / 2 * a), v=jnp.array(t[:, None] * a))

    def errors(size: float) -> np.ndarray:
        return noise * size * rng.normal(size=(runs, time, 3))

    turned = R @ Rotation.from_rotvec(errors(0.003).reshape(-1, 3)).as_matrix().reshape(runs, time, 3, 3)
    read = nav_filter.NavState(
        R=jnp.array(turned),
        x=jnp.array(np.asarray(truth.x) + errors(0.002)),
        v=jnp.array(np.asarray(truth.v) + errors(0.01)),
    )
    gyro, accelerometer = jnp.array(omega + errors(0.01)), jnp.array(a + errors(0.05))

    still = dataclasses.replace(FILTERS, imu_bias=jnp.array(hertz))

    def run(read: nav_filter.NavState, gyro: jax.Array, accelerometer: jax.Array) -> nav_filter.NavState:
        def step(past: Any, now: tuple) -> tuple[Any, nav_filter.NavState]:
            measured, omega, a = now
            # the filter takes the specific force in the body frame; here it is given in the world frame
            specific_force = past[0].R.T @ a
            pose, bias, _, _ = nav_filter.update(
                past, measured, omega, specific_force, jnp.zeros(3), still, jnp.ones(()), jnp.array(DT)
            )
            return (pose, bias), pose

        first = jax.tree.map(lambda leaf: leaf[0], truth), nav_filter.zero_bias()
        rest = jax.tree.map(lambda leaf: leaf[1:], (read, gyro, accelerometer))
        return jax.lax.scan(step, first, rest)[1]

    fused = jax.jit(jax.vmap(run))(read, gyro, accelerometer)
    return jax.tree.map(lambda leaf: leaf[1:], truth), jax.tree.map(lambda leaf: leaf[:, 1:], read), fused


def test_the_complementary_filter_follows_constant_rates():
    """The complementary filter follows constant rates without delay."""
    truth, _, fused = constant_motion(noise=0.0, runs=1)
    for now, true in zip(jax.tree.leaves(fused), jax.tree.leaves(truth), strict=True):
        np.testing.assert_allclose(now[0], true, atol=1e-12)


def test_the_complementary_filter_reduces_noise():
    """The complementary filter is unbiased with less noise than the measurements."""
    runs = 400
    truth, read, fused = constant_motion(noise=1.0, runs=runs)

    def turn(R: jax.Array) -> np.ndarray:
        error = np.asarray(truth.R)[-1].T @ np.asarray(R)[:, -1]
        return Rotation.from_matrix(error).as_rotvec()

    pairs = [(np.asarray(f)[:, -1] - np.asarray(t)[-1], np.asarray(r)[:, -1] - np.asarray(t)[-1])
             for f, r, t in ((fused.x, read.x, truth.x), (fused.v, read.v, truth.v))]  # fmt: skip
    for now, raw in (*pairs, (turn(fused.R), turn(read.R))):
        assert np.abs(now.mean(0)).max() < 5 * now.std(0).max() / np.sqrt(runs)
        assert now.std(0).max() < 0.5 * raw.std(0).min()


def test_imu_biases_are_estimated():
    """At rest under gravity: 20 s with biases of 0.02 rad/s and 0.1 m/s^2 and a corner frequency of 0.1 Hz."""
    R = jnp.array(Rotation.from_rotvec([0.3, -0.2, 1.0]).as_matrix())
    gravity, off = jnp.array([0.0, 0.0, -9.81]), nav_filter.ImuBias(
        omega=jnp.array([0.02, -0.01, 0.005]), a=jnp.array([0.1, -0.05, 0.02])
    )  # fmt: skip
    rest = nav_filter.NavState(R=R, x=jnp.zeros(3), v=jnp.zeros(3))

    def last(hertz: float) -> tuple:
        filters = dataclasses.replace(FILTERS, imu_bias=jnp.array(hertz))

        def step(past: Any, _: None) -> tuple[Any, None]:
            specific_force = -R.T @ gravity + off.a
            pose, bias, _, _ = nav_filter.update(
                past, rest, off.omega, specific_force, gravity, filters, jnp.ones(()), jnp.array(DT)
            )
            return (pose, bias), None

        return jax.jit(lambda: jax.lax.scan(step, (rest, nav_filter.zero_bias()), length=10_000)[0])()

    pose, bias = last(0.1)
    np.testing.assert_allclose(bias.omega, off.omega, atol=1e-3 * 0.02)
    np.testing.assert_allclose(bias.a, off.a, atol=1e-3 * 0.1)
    assert np.abs(pose.v).max() < 1e-5
    pose, bias = last(0.0)
    assert not np.any(bias.a)
    assert np.abs(pose.v).max() > 1e-3


# States ---------------------------------------------------------------------------------------------------------------


@jax.jit
def run_estimator(
    team: Team,
    filters: nav_filter.FilterBandwidths,
    stream: measurement.Measurement,
    applied: tuple[AgentInput, ...],
    f_hat: ResidualForces | None = None,
) -> tuple[state_estimator.StateEstimate, state_estimator.EstimatorState]:
    """Return estimates and states of all steps of a stream of measurements."""
    f_hat = zero_residual(team) if f_hat is None else f_hat
    of = state_estimator.ComplementaryFilter(filters=filters)

    def step(state: state_estimator.EstimatorState, m: measurement.Measurement) -> tuple:
        q_hat, state = of.update(team, state, m, applied, f_hat, ControlClock(t=jnp.zeros(()), dt=jnp.array(DT)))
        return state, (q_hat, state)

    first = of.init(team, jax.tree.map(lambda leaf: leaf[0], stream))
    return jax.lax.scan(step, first, stream)[1]


def constant_inputs() -> tuple[AgentInput, ...]:
    """Return a constant command."""
    return (AgentInput(u=jnp.full(2, 20.0), tau=jnp.zeros((2, 3)), tau_r=jnp.zeros((2, 3))),)


@functools.cache
def steady_stream() -> tuple[Team, State, sensors.SensedState, measurement.Measurement]:
    """A team that moves as one rigid body, its sensed state, and the same measurement at every step."""
    rng = np.random.default_rng(2)
    team = teams.team(rng, STRUCTURE)
    team, z = PinocchioTeam(team).on_grasp(teams.free_state(rng, STRUCTURE))
    (q,), load = z.agents, z.payload
    w = np.asarray(load.R @ load.omega)
    v = np.asarray(load.v) + np.cross(w, np.asarray(q.x - load.p[None]))
    omega = jnp.einsum("aji,j->ai", q.R, jnp.asarray(w))
    z = dataclasses.replace(
        z, agents=(dataclasses.replace(q, v=jnp.asarray(v), omega=omega, r_dot=jnp.zeros_like(q.r_dot)),)
    )
    a, lam = jax.jit(contact_dynamics.forward_dynamics)(team, z, constant_inputs(), zero_residual(team))
    truth = sensors.SensedState(
        z=z, v_dot=(a.agents[0].v_dot,), xi_dot=(a.agents[0].xi_dot,), a_L=a.payload, lam=lam, f=zero_residual(team)
    )
    names = {field.name for field in dataclasses.fields(sensors.SensorNoise)}
    ideal = sensors.SensorNoise(**dict.fromkeys(names, jnp.array(0.0)))
    noise = jax.tree.map(lambda x: x[0] * 0, sensors.sample_noise(team, jax.random.key(0), 1))
    m = jax.jit(sensors.measure)(team, ideal, (jnp.zeros((2, 2, 3)),), truth, noise)
    return team, z, truth, jax.tree.map(lambda x: jnp.broadcast_to(x, (TICKS, *x.shape)), m)


def test_first_estimate_without_noise_is_the_true_state():
    team, z, truth, stream = steady_stream()
    q_hat, _ = run_estimator(team, FILTERS, stream, constant_inputs())
    first = jax.tree.map(lambda x: x[0], q_hat)
    # the correction is the sine of the rotation per step: (omega dt)^3 / 6 is missing
    close = functools.partial(np.testing.assert_allclose, rtol=1e-6, atol=1e-6)
    jax.tree.map(close, first.agents[0], z.agents[0])
    jax.tree.map(close, first.payload, z.payload)
    close(first.lam[0], truth.lam[0])
    close(first.a_L[:3], truth.a_L[:3])


ARM_AND_FREE_LINK = KinematicTree(parents=(0, 1, 2, 0), prismatic=(False,) * 4, tip_bodies=(3,))
RATE = np.array([0.4, -0.2, 0.7, -0.5])


@functools.cache
def joint_ramp() -> tuple[Team, measurement.Measurement, np.ndarray]:
    """An agent at rest whose arm moves a payload at constant joint rates; the last joint moves no tip."""
    structure = ((ARM_AND_FREE_LINK, 1),)
    rng = np.random.default_rng(19)  # an arm far from singular postures
    team, q = teams.team(rng, structure), teams.agent_state(rng, ARM_AND_FREE_LINK)
    agent = jax.tree.map(lambda x: x[0], team.agent_groups[0])
    ramp = np.asarray(q.r) + DT * np.arange(TICKS)[:, None] * RATE

    def tip(t: jax.Array) -> jax.Array:
        return aerial_manipulator.forward_kinematics(agent, q.r + t * jnp.asarray(RATE)).points[-1] @ q.R.T

    def with_rate(f: Any) -> Any:
        return lambda t: jax.jvp(f, (t,), (jnp.ones_like(t),))

    def read(t: jax.Array, r: jax.Array) -> measurement.Measurement:
        (p, v), (_, a) = with_rate(with_rate(tip))(t)
        still, zero = q.R.T @ -team.gravity, jnp.zeros(3)
        readings = measurement.AgentReading(R=q.R, x=zero, v=zero, omega=zero, a=still, r=r, lam=jnp.zeros((1, 3)))
        return measurement.Measurement(
            agents=(jax.tree.map(lambda x: x[None], readings),),
            payload=measurement.PayloadReading(R=jnp.eye(3), p=p, v=v, omega=zero, a=a - team.gravity),
        )

    return team, jax.jit(jax.vmap(read))(DT * jnp.arange(TICKS, dtype=float), jnp.asarray(ramp)), ramp


def test_joint_estimates_follow_a_ramp():
    """Positions and rates of joints have no lag, both of those that move the tip and of one that does not."""
    team, stream, ramp = joint_ramp()
    applied = (AgentInput(u=jnp.full(1, 20.0), tau=jnp.zeros((1, 3)), tau_r=jnp.zeros((1, 4))),)
    q_hat, _ = run_estimator(team, FILTERS, stream, applied)
    # the payload's acceleration is held over a control period
    np.testing.assert_allclose(q_hat.agents[0].r_dot[-1, 0], RATE, atol=3e-4)
    np.testing.assert_allclose(q_hat.agents[0].r[-1, 0], ramp[-1], rtol=0, atol=3e-5)
    np.testing.assert_allclose(q_hat.agents[0].r_dot[-1, 0, 3], RATE[3], rtol=1e-9)


def test_encoder_noise_reaches_only_rates_without_tip_motion():
    """Rates of joints that move the tip have less than a tenth of the noise of differenced encoder readings."""
    team, stream, _ = joint_ramp()
    noise = 2e-3 * np.random.default_rng(7).normal(size=(TICKS, 1, 4))
    noisy = dataclasses.replace(stream.agents[0], r=stream.agents[0].r + jnp.asarray(noise))
    applied = (AgentInput(u=jnp.full(1, 20.0), tau=jnp.zeros((1, 3)), tau_r=jnp.zeros((1, 4))),)
    q_hat, _ = run_estimator(team, FILTERS, dataclasses.replace(stream, agents=(noisy,)), applied)
    spread = np.asarray(q_hat.agents[0].r_dot)[TICKS // 2 :, 0].std(0)
    assert spread[:3].max() < 0.1 * spread[3]
    assert 0.02 < spread[3] < 0.2


def test_poses_are_propagated_by_accelerometers():
    """Payload and agents at constant acceleration: the propagated state is the next measurement."""
    team, _, _, stream = steady_stream()
    a = jnp.array([0.5, -1.0, 2.0])
    specific_force = a - team.gravity

    def falling(t: jax.Array, m: measurement.Measurement) -> measurement.Measurement:
        load, (agents,) = m.payload, m.agents
        shift, speed = t**2 / 2 * a, t * a
        load = dataclasses.replace(load, p=load.p + shift, v=speed, omega=0 * load.omega, a=load.R.T @ specific_force)
        agents = dataclasses.replace(
            agents,
            x=agents.x + shift[None],
            v=jnp.tile(speed, (2, 1)),
            omega=0 * agents.omega,
            a=jnp.einsum("aji,j->ai", agents.R, specific_force),
        )
        return dataclasses.replace(m, payload=load, agents=(agents,))

    moving = jax.vmap(falling)(DT * jnp.arange(TICKS, dtype=float), stream)
    slow = dataclasses.replace(
        FILTERS, complementary=jnp.array(0.01)
    )  # so that corrections by measurements are negligible
    q_hat, state = run_estimator(team, slow, moving, constant_inputs())
    np.testing.assert_allclose(q_hat.payload.v, moving.payload.v, atol=1e-10)
    np.testing.assert_allclose(q_hat.payload.p, moving.payload.p, atol=1e-10)
    np.testing.assert_allclose(state.agents[0].base.v, moving.agents[0].v, atol=1e-10)
    np.testing.assert_allclose(state.agents[0].base.x, moving.agents[0].x, atol=1e-10)


def test_estimates_and_labels_use_past_readings_only():
    team, _, _, stream = steady_stream()
    rng = np.random.default_rng(4)
    noisy = jax.tree.map(lambda x: x + 0.01 * jnp.array(rng.normal(size=x.shape)), stream)
    other = jax.tree.map(lambda a, b: jnp.concatenate([a[:120], b[120:]]), noisy, stream)
    now, then = (run_estimator(team, FILTERS, s, constant_inputs()) for s in (noisy, other))
    for a, b in zip(jax.tree.leaves(now), jax.tree.leaves(then), strict=True):
        np.testing.assert_array_equal(a[:120], b[:120])
    assert np.abs(now[1].label.stage2[-1] - then[1].label.stage2[-1]).max() > 1e-3


# Labels ---------------------------------------------------------------------------------------------------------------


def low_pass(x: np.ndarray, hertz: float, dt: float) -> np.ndarray:
    """First-order filter, sample by sample."""
    b, y, out = 1 - np.exp(-2 * np.pi * hertz * dt), x[0], []
    for sample in x:
        y = y + b * (sample - y)
        out.append(y)
    return np.array(out)


def test_model_inputs_have_the_delay_of_labels():
    """Inputs of payload and agents pass the same filters as labels, at every step."""
    team, _, _, stream = steady_stream()
    rng = np.random.default_rng(5)
    noisy = jax.tree.map(lambda x: x + 0.01 * jnp.array(rng.normal(size=x.shape)), stream)
    q_hat, state = run_estimator(team, FILTERS, noisy, constant_inputs())
    specific_force = np.asarray(q_hat.a_L) - np.concatenate([team.gravity, np.zeros(3)])
    payload = jax.vmap(flatten_payload_state)(q_hat.payload, jnp.asarray(specific_force))
    agents = jax.vmap(jax.vmap(flatten_agent_state))(q_hat.agents[0])
    for inputs, found in ((payload, state.inputs.stage2), (agents, state.agents[0].inputs.stage2)):
        expected = low_pass(low_pass(np.asarray(inputs), 8.0, DT), 8.0, DT)
        scale = np.abs(inputs).max()
        np.testing.assert_allclose(found, expected, atol=1e-10 * scale)
        assert np.abs(inputs - expected).max() > 1e-3


def test_modelled_wrench_has_the_tip_force_filter():
    """The modelled wrench has the same delay as the contact forces with which it is compared."""
    team, _, _, stream = steady_stream()
    rng = np.random.default_rng(6)
    noisy = jax.tree.map(lambda x: x + 0.01 * jnp.array(rng.normal(size=x.shape)), stream)
    q_hat, state = run_estimator(team, FILTERS, noisy, constant_inputs())
    required = jax.vmap(inverse_dynamics.payload_inverse_dynamics, in_axes=(None, 0, 0, 0))(
        team.payload, q_hat.a_L[:, :3] - team.gravity[None], q_hat.a_L[:, 3:], q_hat.payload.omega
    )
    expected = low_pass(np.concatenate([required.F, required.tau], axis=1), 50.0, DT)
    np.testing.assert_allclose(state.modelled_wrench, expected, atol=1e-10 * np.abs(expected).max())


def recorded_labels(experiment: flight.Experiment, dt: float) -> tuple[np.ndarray, np.ndarray]:
    """Labels of payload and agents of a flight of 1.5 s, and the filtered true residual at the same times."""
    every = dataclasses.replace(
        experiment.controller.recorder,
        sample_period=number(0.01), start=number(0.3), payload=jnp.array(True), agents=jnp.array(True),
    )  # fmt: skip
    experiment = dataclasses.replace(paper_flights.with_controller(experiment, recorder=every), dt=dt)
    world, filters = experiment.world, experiment.controller.estimator.filters
    loop, flown, room = simulator.reset(experiment.loop_config, experiment.initial_state), [], 250
    noise = world.sample_noise(jax.random.key(0), room)
    for _ in range(round(1.5 / dt) // room):
        loop, rows = simulator.rollout(experiment.loop_config, loop, noise, jnp.array(room))
        flown.append(rows)
    z, inputs = paper_flights.states(world.team, jax.tree.map(lambda *x: np.concatenate(x), *flown))
    # measurements of a step follow from the command of the previous step
    z, inputs = jax.tree.map(lambda x: x[1:], z), jax.tree.map(lambda x: x[:-1], inputs)
    _, f = paper_flights.accelerations_and_residuals(experiment, z, inputs)
    (g,), load, data = f.agents, loop.controller.recorder.payload, loop.controller.recorder.agents[0]
    y = np.concatenate([f.payload.F, f.payload.tau, *(x.reshape(len(x), -1) for x in (g.f_x, g.f_w, g.f_r))], axis=1)
    for hertz in (float(filters.tip_force), float(filters.label), float(filters.label)):
        y = low_pass(y, hertz, dt)
    n = int(load.n)
    assert list(data.n) == [n, n]
    assert n >= 120
    k = np.round(np.asarray(load.t)[:n] / dt).astype(int) - 1
    per_agent = np.asarray(data.Y)[:, :n].transpose(1, 0, 2)
    parts = [per_agent[:, :, part].reshape(n, -1) for part in (slice(0, 3), slice(3, 6), slice(6, None))]
    return np.concatenate([np.asarray(load.Y)[:n], *parts], axis=1), y[k]


@pytest.mark.long
def test_labels_converge_to_the_filtered_true_residual():
    """Without noise, with delays that are multiples of the step, the error is first order in the step."""
    errors = []
    for dt in (0.002, 0.001):
        experiment = paper_flights.with_exact_sensors(paper_flights.paper_experiment("C1"))
        quick = number(0.4 / dt)
        experiment = paper_flights.with_filters(experiment, joint=quick, tip_force=quick)
        sensors = dataclasses.replace(experiment.world.sensors, tip_force_bandwidth=quick)
        y, expected = recorded_labels(paper_flights.with_world(experiment, sensors=sensors), dt)
        errors.append(np.sqrt(((y - expected) ** 2).mean(0)))
    coarse, fine = errors
    most = np.repeat([1e-6, 3e-4, 3e-4, 2e-4], [3, 3, 6, 12])  # N, N m, of the payload and of the agents
    assert (coarse < most).all()
    np.testing.assert_allclose(fine, coarse / 2, rtol=0.1, atol=1e-6)  # no error of the payload's force


def test_filter_error_of_the_study_is_below_label_noise():
    """Without noise, the filters of the study have a smaller error than its label noise."""
    y, expected = recorded_labels(paper_flights.without_noise(paper_flights.paper_experiment("C1")), 0.002)
    error = np.sqrt(((y - expected) ** 2).mean(0))
    load, agents = (getattr(paper_flights.SETTINGS.learning, body).noise_std for body in ("payload", "agents"))
    stated = [load.force_N, load.moment_Nm, agents.force_N, agents.moment_Nm, agents.joint_torque_Nm]
    assert (error < np.repeat(stated, [3, 3, 6, 6, 6])).all()
    assert (error[:3] < 0.05 * np.sqrt((expected[:, :3] ** 2).mean(0))).all()
