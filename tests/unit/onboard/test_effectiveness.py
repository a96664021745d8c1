"""Tests of the estimate of rotor effectiveness: Kalman filter in its textbook form, detection, compensation."""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np

from colift.models.state import AgentInput, ControlClock, ResidualForces, zero_residual
from colift.onboard.estimation import effectiveness
from colift.onboard.estimation.state_estimator import StateEstimate, TrainingSample
from colift.onboard.learning import residual_correction
from colift.scenario import experiment
from tests.support import paper_flights as paper
from tests.support import small_team

DT = 0.002
TEAM = paper.paper_experiment("C1").controller.team
FILTER = effectiveness.EffectivenessFilter(residual_std=jnp.array(1.0))


def estimated(force: np.ndarray, valid: float = 1.0) -> StateEstimate:
    """Return an estimate with labels of the two agents, whose bases are as in the initial state."""
    z = paper.paper_experiment("C1").initial_state
    labels = jnp.zeros((2, 9)).at[:, :3].set(force)
    sample = TrainingSample(
        payload=(jnp.zeros(24), jnp.zeros(6)),
        agents=((jnp.zeros((2, 24)), labels),),
        unfiltered=(jnp.zeros(6), (labels,)),
        valid=jnp.asarray(valid),
        sample_interval=jnp.asarray(DT),
    )
    return StateEstimate(agents=z.agents, payload=z.payload, a_L=jnp.zeros(6), lam=(), sample=sample)


def command(u: np.ndarray) -> tuple[AgentInput, ...]:
    return (AgentInput(u=jnp.asarray(u), tau=jnp.ones((2, 3)), tau_r=jnp.ones((2, 3))),)


@jax.jit
def update(state: effectiveness.EffectivenessState, label: jax.Array, u: jax.Array) -> effectiveness.EffectivenessState:
    return FILTER.update(state, TEAM, estimated(label), zero_residual(TEAM), command(u), jnp.asarray(DT))


def simulate(true: float, seconds: float, noise: float = 0.4):
    """Return thrusts, explained thrusts and states; the first agent has an effectiveness, the second one is healthy."""
    rng, z = np.random.default_rng(5), paper.paper_experiment("C1").initial_state
    axes, state, rows = np.asarray(z.agents[0].R)[:, :, 2], FILTER.init(TEAM), []
    for _ in range(round(seconds / DT)):
        u = 25 + 3 * rng.normal(size=2)
        missing = (np.array([true, 1.0]) - np.asarray(state.in_use)) * u + noise * rng.normal(size=2)
        explained = missing + np.asarray(state.in_use) * u
        state = update(state, jnp.asarray(missing[:, None] * axes), jnp.asarray(u))
        rows.append((u, explained, state))
    return rows


def test_the_filter_is_the_kalman_filter_of_a_random_walk():
    """Joseph form of the textbook, with noise variance 1 and the process noise of the stated bandwidth."""
    w = 1 - np.exp(-2 * np.pi * float(FILTER.bandwidth) * DT)
    q = w**2 / (1 - w) / (np.asarray(TEAM.agent_groups[0].thrust_max)[0] / 2) ** 2
    x, P = 1.0, 0.0
    for u, z, state in simulate(0.5, 0.4):
        P = P + q
        K = P * u[0] / (u[0] * P * u[0] + 1.0)
        x = x + K * (z[0] - u[0] * x)
        P = (1 - K * u[0]) * P * (1 - K * u[0]) + K * K
        np.testing.assert_allclose([state.estimate[0], state.covariance[0]], [x, P], rtol=1e-9)


def test_steady_gain_is_that_of_the_stated_bandwidth():
    most = TEAM.agent_groups[0].thrust_max
    state, half = FILTER.init(TEAM), most / 2
    for _ in range(400):
        state = update(state, jnp.zeros((2, 3)), half)
    before = state.estimate[0]
    axes = paper.paper_experiment("C1").initial_state.agents[0].R[:, :, 2]
    state = update(state, -half[:, None] * axes, half)  # explained thrust zero for one period
    np.testing.assert_allclose(state.estimate[0] / before, np.exp(-2 * np.pi * float(FILTER.bandwidth) * DT), rtol=1e-6)


def test_a_loss_is_compensated_and_limits_the_thrust():
    state = simulate(0.5, 0.5)[-1][2]
    np.testing.assert_allclose(state.in_use, [0.5, 1.0], atol=0.02)
    limited = FILTER.limited(state, TEAM).agent_groups[0].thrust_max
    np.testing.assert_allclose(limited, state.in_use * TEAM.agent_groups[0].thrust_max)
    (acting,) = FILTER.acting(state, TEAM, FILTER.compensated(state, TEAM, command(np.array([10.0, 20.0]))))
    np.testing.assert_allclose(acting.u, [10, 20])
    np.testing.assert_allclose(acting.tau, 1.0)


def test_a_residual_force_is_no_fault():
    """A missing thrust of two standard deviations of the residual leaves both agents healthy; of four it does not."""
    for missing, healthy in ((2.0, True), (4.0, False)):
        states = [state for _, _, state in simulate(1 - missing / 25, 0.5, noise=0.1)]
        assert (np.asarray(states[-1].in_use[0]) == 1.0) == healthy
        assert all(float(state.in_use[1]) == 1.0 for state in states)


def test_without_tip_readings_the_estimate_is_held():
    state, force = simulate(0.5, 0.3)[-1][2], np.ones((2, 3))
    arguments = zero_residual(TEAM), command(np.full(2, 25.0)), jnp.asarray(DT)
    after = FILTER.update(state, TEAM, estimated(force, 0.0), *arguments)
    np.testing.assert_array_equal(after.estimate, state.estimate)


def test_a_residual_that_the_model_predicts_is_no_loss():
    force = np.full((2, 3), -8.0)
    (zero,) = zero_residual(TEAM).agents
    predicted = ResidualForces(
        agents=(dataclasses.replace(zero, f_x=jnp.asarray(force)),), payload=zero_residual(TEAM).payload
    )
    state = FILTER.init(TEAM)
    for _ in range(3):
        state = FILTER.update(state, TEAM, estimated(force), predicted, command(np.full(2, 25.0)), jnp.asarray(DT))
    np.testing.assert_allclose(state.estimate, 1.0)


def test_labels_change_by_the_change_of_the_assumed_thrust():
    before = simulate(0.5, 0.01)[-1][2]
    after = dataclasses.replace(before, in_use=jnp.array([0.5, 1.0]))
    at = estimated(np.zeros((2, 3)))
    change = FILTER.label_change(before, after, TEAM, at, command(np.array([20.0, 25.0])))
    np.testing.assert_array_equal(change.axes[0], at.agents[0].R[:, :, 2])
    np.testing.assert_allclose(change.thrust[0], (before.in_use - after.in_use) * jnp.array([20.0, 25.0]))
    state, axes = before, np.asarray(paper.paper_experiment("C1").initial_state.agents[0].R)[:, :, 2]
    for _ in range(200):
        missing = (np.array([0.5, 1.0]) - np.asarray(state.in_use)) * 25.0
        state = update(state, jnp.asarray(missing[:, None] * axes), jnp.full(2, 25.0))
    total = FILTER.label_change(FILTER.init(TEAM), state, TEAM, at, command(np.full(2, 25.0)))
    np.testing.assert_allclose(total.thrust[0], [12.5, 0.0], atol=0.1)


def test_the_controller_compensates_a_detected_loss_once():
    """The correction contained the loss before its detection. Afterwards the thrust limit contains it alone."""
    of = experiment.make_experiment(small_team.settings(), "adaptive")
    onboard, clock = of.controller, ControlClock(t=jnp.array(1.0), dt=jnp.array(DT))
    onboard = dataclasses.replace(onboard, effectiveness_filter=FILTER)
    measurement = of.world.measure_at_rest(of.initial_state)

    @jax.jit
    def corrected(loss: jax.Array) -> jax.Array:
        """Return the correction along the thrust axis of the first agent, before and after a period with a loss."""
        inputs, state = onboard.init(measurement, clock)
        size = state.effectiveness.in_use.at[0]
        found = dataclasses.replace(state.effectiveness, estimate=size.set(1 - loss))
        error = zero_residual(onboard.team)
        agents = tuple(dataclasses.replace(f, f_x=f.f_x.at[0, 2].set(-6.0)) for f in error.agents)
        error = residual_correction.flatten(dataclasses.replace(error, agents=agents))
        certain = tuple(1e-6 * x for x in state.corrector.P)  # one label changes the error by little
        corrector = dataclasses.replace(state.corrector, d=error, P=certain, initialized=jnp.ones(()))
        state = dataclasses.replace(state, effectiveness=found, corrector=corrector, initialized=jnp.ones(()))
        _, state, _ = onboard.step(state, measurement, clock)
        d = residual_correction.unflatten(state.corrector.d, zero_residual(onboard.team))
        return jnp.stack([d.agents[0].f_x[0, 2], state.last_f_hat.agents[0].f_x[0, 2], inputs[0].u[0]])

    healthy, faulty = corrected(jnp.array(0.0)), corrected(jnp.array(0.5))
    assert healthy[2] > 10  # N: a loss of half of it is detected
    np.testing.assert_allclose(healthy[:2], -6.0, atol=1.0)
    np.testing.assert_allclose(faulty[:2], 0.0, atol=1e-9)
