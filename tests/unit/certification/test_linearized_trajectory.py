"""Tests of the loop linearized along a trajectory: against simulations with residuals and noise, and its sums against
the recursion.
"""

from __future__ import annotations

import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from colift import gp
from colift.certification import certificate, linearized_trajectory, nominal_run
from colift.closed_loop import flight, signals, simulator
from tests.support.certified_flights import LAST, late, made
from tests.support.paper_flights import with_world

seeds = st.integers(0, 2**31)


# Comparison with simulations ------------------------------------------------------------------------------------------


def test_run_with_stored_models_repeats_the_flight():
    """The flight's models at their times repeat it without updates; only unused label states differ."""
    of = made()
    nominal_experiment = dataclasses.replace(of.experiment, update_times=())
    rows, loops = linearized_trajectory.simulate_nominal(
        nominal_experiment, of.nominal_linearization.model_schedule, [0, 1000]
    )
    for name in ("e_p", "e_omega", "u", "lam", "f_L_hat", "f_x_hat", "tau_r"):
        np.testing.assert_array_equal(getattr(rows, name), getattr(of.flight.records, name), err_msg=name)
    assert [int(loop.tick) for loop in loops] == [0, 1000]


def remaining_residual(of: object, rows: signals.StepRecord) -> np.ndarray:
    """Return `f~` along a flight: the drawn forces minus the means of the last model, (ticks, inputs)."""
    (function,), last_model = of.experiment.world.disturbances.state_functions, of.flight.model
    truth, means = function.model, jax.jit(jax.vmap(gp.mean, (None, 0)))
    x, (agents,) = signals.model_inputs(of.experiment.world.team, rows)
    first = last_model.features.payload(jnp.asarray(x))
    parts = [means(truth.payload, first) - means(last_model.payload, first)]
    for j in range(agents.shape[1]):
        f, model = (jax.tree.map(lambda leaf, j=j: leaf[j], one.agents[0]) for one in (truth, last_model))
        parts.append(means(f, jnp.asarray(agents[:, j])) - means(model, jnp.asarray(agents[:, j])))
    return np.concatenate(parts, axis=1)


@pytest.mark.parametrize("flight", [made, pytest.param(late, marks=pytest.mark.long)])
def test_response_to_residuals_is_their_weighted_sum(flight):
    """For all errors, across updates: sampling, estimator, and gradients of the means are included."""
    of = flight()
    loop, names = of.nominal_linearization, ("e_p", "e_v", "e_R", "e_omega", "u")
    at = np.arange(10, len(loop.nodes), 7)
    predicted = np.einsum(
        "trki,ki->tr",
        linearized_trajectory.adjoint_weights(loop, loop.output_rows(*names), at),
        remaining_residual(of, of.flight.records)[loop.nodes],
    )
    ticks = loop.nodes[at]
    found = [np.asarray(getattr(of.flight.records, name) - getattr(loop.records, name))[ticks] for name in names]
    for one, part in zip(found, np.split(predicted, np.cumsum([x.shape[1] for x in found])[:-1], axis=1), strict=True):
        assert np.abs(one - part).max() < 0.03 * np.abs(one).max()
        after = loop.t[at] > LAST + 1.5
        assert not after.any() or np.abs(one - part)[after].max() < 0.02 * np.abs(one[after]).max()


def test_other_states_of_the_loop_have_no_effect():
    """Other states of the loop change neither commands nor plant."""
    of = made()
    nominal_experiment = dataclasses.replace(
        nominal_run.nominal_experiment(of.experiment, of.flight.model), duration=8.0
    )
    nodes = np.array([1500])
    rows, (loop,) = linearized_trajectory.simulate_nominal(
        nominal_experiment, of.nominal_linearization.model_schedule, nodes
    )
    setup = dataclasses.replace(
        nominal_experiment.loop_config,
        controller=dataclasses.replace(nominal_experiment.controller, residual_model=of.flight.model),
    )
    rng = np.random.default_rng(0)
    other = jax.tree.map(lambda x: x + rng.normal(size=x.shape) if x.dtype == float else x, loop)
    other = linearized_trajectory._with(other, linearized_trajectory._moving(loop))
    flags = {name: getattr(loop.controller.estimator, name) for name in ("time_since_label", "initialized")}
    controller_state = dataclasses.replace(
        other.controller, estimator=dataclasses.replace(other.controller.estimator, **flags)
    )
    controller_state = dataclasses.replace(
        controller_state, initialized=loop.controller.initialized, recorder=loop.controller.recorder
    )
    other = dataclasses.replace(other, controller=controller_state)
    zero_noise = jax.tree.map(
        jnp.zeros_like,
        nominal_experiment.world.sample_noise(jax.random.key(0), flight.ticks_per_chunk(nominal_experiment)),
    )
    (a, row), (b, row_other) = (simulator.rollout(setup, one, zero_noise, jnp.asarray(3)) for one in (loop, other))
    jax.tree.map(np.testing.assert_array_equal, linearized_trajectory._moving(a), linearized_trajectory._moving(b))
    np.testing.assert_array_equal(row.u, row_other.u)
    assert not np.array_equal(a.controller.estimator.modelled_wrench, b.controller.estimator.modelled_wrench)
    np.testing.assert_array_equal(row.p[0], rows.p[1500])


@pytest.mark.long
def test_noise_response_has_the_predicted_std():
    """RMS over the second half of a simulation with noise relative to the nominal trajectory."""
    of = made()
    noisy = dict.fromkeys(
        ("position", "velocity", "attitude", "angular_velocity", "accelerometer", "joint_position"), jnp.asarray(1e-3)
    )
    sensors = dataclasses.replace(of.experiment.world.sensors, **noisy)
    schedule = of.nominal_linearization.model_schedule
    nominal_experiment = with_world(nominal_run.nominal_experiment(of.experiment, of.flight.model), sensors=sensors)
    loop = linearized_trajectory.linearize_along(nominal_experiment, schedule, with_noise=True)
    np.testing.assert_array_equal(loop.records.p, of.nominal_linearization.records.p)
    nominal_experiment = dataclasses.replace(
        nominal_experiment,
        controller=dataclasses.replace(nominal_experiment.controller, residual_model=of.flight.model),
    )
    flown = [flight.run_experiment(dataclasses.replace(nominal_experiment, seed=seed)).records for seed in range(3)]
    alone, _ = linearized_trajectory.simulate_nominal(
        nominal_experiment, [dataclasses.replace(of.nominal_linearization.model_schedule[-1], start_tick=0)]
    )
    for name in certificate.ERRORS:
        predicted = linearized_trajectory.noise_std(loop, loop.output_rows(name))[loop.t > 5]
        row = np.concatenate([np.asarray(getattr(rows, name) - getattr(alone, name))[rows.t > 5] for rows in flown])
        ratio = np.sqrt((row**2).mean() / (predicted**2).mean())
        assert 0.8 < ratio < 1.25, name


def test_terminated_nominal_trajectory_is_refused():
    of = made()
    nominal_experiment = nominal_run.nominal_experiment(of.experiment, of.flight.model)
    near = dataclasses.replace(
        nominal_experiment,
        termination_limits=dataclasses.replace(nominal_experiment.termination_limits, max_distance=jnp.asarray(1e-4)),
    )
    with pytest.raises(
        linearized_trajectory.TerminatedEarly, match=r"the nominal trajectory ended at t = .* s: distance"
    ):
        linearized_trajectory.simulate_nominal(near, of.nominal_linearization.model_schedule)


# Comparison with the recursion ----------------------------------------------------------------------------------------


def system(
    rng: np.random.Generator, nodes: int = 9, n: int = 5, m: int = 3, r: int = 4
) -> linearized_trajectory.LinearizedTrajectory:
    """Return a random system whose outputs are named a and b."""
    A, B = rng.normal(size=(nodes - 1, n, n)) / n, rng.normal(size=(nodes - 1, 2, n, m))
    half = rng.normal(size=(nodes - 1, n, n))
    return linearized_trajectory.LinearizedTrajectory(
        model_schedule=(),
        records=made().nominal_linearization.records,  # not used
        nodes=np.arange(nodes),
        A=A,
        B=B,
        N=half @ np.swapaxes(half, 1, 2),
        C=rng.normal(size=(nodes, r, n)),
        D=rng.normal(size=(nodes, r, m)),
        N_y=rng.uniform(size=(nodes, r)),
        outputs={"a": slice(0, 1), "b": slice(1, r)},
        bodies=(slice(0, m),),
    )


@given(seeds)
@settings(max_examples=12)
def test_weights_equal_the_recursion(seed):
    rng = np.random.default_rng(seed)
    of, f = system(rng), rng.normal(size=(9, 3))
    x, y = np.zeros(5), []
    for k in range(9):
        y.append(of.C[k] @ x + of.D[k] @ f[k])
        if k < 8:
            x = of.A[k] @ x + of.B[k, 0] @ f[k] + of.B[k, 1] @ f[k + 1]
    at = np.sort(rng.choice(9, 4, replace=False))
    L = linearized_trajectory.adjoint_weights(of, of.output_rows("b"), at)
    np.testing.assert_allclose(np.einsum("trki,ki->tr", L, f), np.array(y)[at][:, 1:], atol=1e-12)


@given(seeds)
@settings(max_examples=12)
def test_noise_std_equals_dense_covariance(seed):
    of = system(np.random.default_rng(seed))
    for k, predicted in enumerate(linearized_trajectory.noise_std(of, of.output_rows("a", "b"))):
        total, onward = np.zeros((4, 4)), np.eye(5)
        for j in reversed(range(k)):
            total += of.C[k] @ onward @ of.N[j] @ onward.T @ of.C[k].T
            onward = onward @ of.A[j]
        np.testing.assert_allclose(predicted**2, np.diag(total) + of.N_y[k], rtol=1e-9)


@given(seeds, st.integers(1, 12))
@settings(max_examples=12)
def test_stride_equals_its_single_steps(seed, ticks):
    """With derivatives and residuals that change linearly over the stride."""
    rng, n, m = np.random.default_rng(seed), 4, 2
    first, last = rng.normal(size=(2, n, n + m + 3)) / n
    A, B, N = linearized_trajectory._discretize(first, last, ticks, n, m)
    x0, f = rng.normal(size=n), rng.normal(size=(2, m))
    x, P = x0, np.zeros((n, n))
    for j in range(ticks):
        J = (1 - j / ticks) * first + j / ticks * last
        s = (j + 0.5) / ticks
        x = J[:, :n] @ x + J[:, n : n + m] @ ((1 - s) * f[0] + s * f[1])
        P = J[:, :n] @ P @ J[:, :n].T + J[:, n + m :] @ J[:, n + m :].T
    np.testing.assert_allclose(A @ x0 + B[0] @ f[0] + B[1] @ f[1], x, atol=1e-12)
    np.testing.assert_allclose(N, P, atol=1e-12)
