"""Tests of the closed loop: residuals against their sources, consistency of the log, termination, repeatability."""

from __future__ import annotations

import dataclasses
import functools
import time
import types
import weakref
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift.analysis import metrics
from colift.closed_loop import signals, simulator, termination
from colift.closed_loop.flight import (
    UNCERTAINTY_PERIOD,
    CompactInterval,
    Experiment,
    FlightResult,
    run_experiment,
)
from colift.math.pytree import pytree
from colift.onboard.learning import model_update, online_learner
from colift.scenario import experiment
from colift.scenario.termination import MIN_GRASP_RATIO
from colift.simulation import disturbances
from tests.support import paper_flights, random_teams
from tests.support import small_team as light
from tests.support.paper_flights import (
    NAMES,
    number,
    paper_experiment,
    simulate,
    with_controller,
    with_exact_sensors,
    with_nominal_world,
    with_world,
)


@pytest.fixture(scope="module")
def flight() -> FlightResult:
    """One second of case C1 as shipped, with noise."""
    return simulate(paper_experiment("C1"), 1.0)


# Residual -------------------------------------------------------------------------------------------------------------


def test_residual_equals_sources_for_true_parameters():
    """With the true parameters the residual is the sum of the disturbances."""
    of = with_nominal_world(paper_experiment("C1"))
    rows = simulate(of, 0.5).records
    z, _ = paper_flights.states(of.world.team, rows)
    f = jax.jit(jax.vmap(disturbances.initial_forces, in_axes=(None, None, 0)))(of.world.disturbances, of.world.team, z)
    np.testing.assert_allclose(rows.f_L, np.concatenate([f.payload.F, f.payload.tau], axis=1), atol=1e-9)
    (g,) = f.agents
    np.testing.assert_allclose(rows.f_x, g.f_x, atol=1e-9)
    np.testing.assert_allclose(rows.f_w, g.f_w, atol=1e-9)
    np.testing.assert_allclose(rows.f_r, np.asarray(g.f_r).reshape(len(rows.t), -1), atol=1e-9)
    assert np.abs(rows.f_L).max() > 0.5


def test_parameter_mismatch_adds_inertial_residual(flight):
    """Mass and inertia mismatch add the difference of the inertial forces to the residual."""
    of, rows = paper_experiment("C1"), flight.records
    z, _ = paper_flights.states(of.world.team, rows)
    F = jax.jit(jax.vmap(disturbances.initial_forces, in_axes=(None, None, 0)))(
        of.world.disturbances, of.world.team, z
    ).payload
    nominal, truth = of.controller.team.payload, of.world.team.payload
    dm, dJ = float(nominal.mass - truth.mass), np.asarray(nominal.inertia - truth.inertia)
    w = rows.omega_L
    np.testing.assert_allclose(
        rows.f_L[:, :3], F.F + dm * (rows.a_L[:, :3] - np.asarray(of.world.team.gravity)), atol=1e-9
    )
    np.testing.assert_allclose(rows.f_L[:, 3:], F.tau + rows.a_L[:, 3:] @ dJ + np.cross(w, w @ dJ), atol=1e-9)


# Log ------------------------------------------------------------------------------------------------------------------


def test_logged_motion_is_kinematically_consistent(flight):
    """Positions, velocities and accelerations are derivatives of each other."""
    rows = jax.tree.map(lambda x: x[50:], flight.records)  # after the first 0.1 s with large jerk
    dt = float(np.diff(rows.t[:2])[0])
    # within a step commands are constant: the trapezoidal rule has an error of dt^2 / 12 times the jerk,
    # which for the joints is some 100 rad/s^3
    for x, x_dot in ((rows.p, rows.v), (rows.x, rows.v_agent), (rows.r, rows.r_dot)):
        np.testing.assert_allclose(np.diff(x, axis=0) / dt, (x_dot[1:] + x_dot[:-1]) / 2, atol=1e-4)
    # the log has the acceleration at the beginning of a tick: first order in dt
    error = np.diff(rows.v, axis=0) / dt - rows.a_L[:-1, :3]
    assert paper_flights.rms(error) < 0.01 * paper_flights.rms(rows.a_L[:, :3])


def test_attitudes_stay_rotation_matrices(flight):
    for R in (flight.records.R_L[:, None], flight.records.R):
        np.testing.assert_allclose(R @ R.swapaxes(-1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)


def test_contact_constraints_hold(flight):
    assert flight.records.Phi.max() <= 1e-10
    assert flight.records.Phi_dot.max() <= 1e-10
    assert (
        flight.records.min_delassus_singular_value.min()
        > 10 * np.asarray(paper_experiment("C1").termination_limits.min_delassus).max()
    )


def test_logged_errors_are_those_of_the_true_state(flight):
    rows, start = flight.records, paper_flights.SETTINGS.initial_state
    np.testing.assert_allclose(rows.e_p[0], start.position_error_m, atol=1e-3)
    assert np.linalg.norm(rows.e_p[0]) == pytest.approx(0.2, abs=0.01)
    assert rows.Psi[0] == pytest.approx(1 - np.cos(np.deg2rad(10)), rel=0.02)
    np.testing.assert_allclose(rows.e_p, rows.p - rows.p_d, atol=1e-15)


def test_contact_forces_have_tip_sensor_noise(flight):
    rows = flight.records
    settled = rows.t > 0.2
    error = (rows.lam_hat - rows.lam)[settled]
    settings = paper_flights.SETTINGS.sensors
    bound = 1.5 * np.hypot(settings.tip_force_N, 3 * settings.tip_force_bias_N)
    assert 0.5 * settings.tip_force_N < error.std(0).min()
    assert np.sqrt((error**2).mean(0)).max() < bound


# Repeatability --------------------------------------------------------------------------------------------------------


def same(a: signals.StepRecord, b: signals.StepRecord) -> None:
    """Return whether all numbers of two logs are equal bit by bit."""
    for field in dataclasses.fields(a):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name), err_msg=field.name)


def test_equal_seeds_give_equal_flights(flight):
    same(flight.records, simulate(paper_experiment("C1"), 1.0).records)


def test_seed_changes_noise_but_not_the_start(flight):
    other = simulate(dataclasses.replace(paper_experiment("C1"), seed=1), 1.0).records
    np.testing.assert_array_equal(other.p[0], flight.records.p[0])
    assert np.abs(other.lam_hat - flight.records.lam_hat).max() > 0.1


def test_noise_is_independent_of_update_times(flight):
    cut = dataclasses.replace(
        paper_experiment("C1"), duration=1.0, update_times=(0.302, 0.7)
    )  # C1 has no data: nothing is learned
    stopped = run_experiment(cut)
    assert [update.t for update in stopped.updates] == pytest.approx([0.302, 0.7])
    same(flight.records, stopped.records)


def test_cases_are_equal_until_the_first_update(flight):
    for case in ("C2", "C3"):
        learning = simulate(dataclasses.replace(paper_experiment(case), update_times=(5.0,)), 1.0)
        same(flight.records, learning.records)


def test_updates_use_the_data_before_their_step():
    of = dataclasses.replace(paper_experiment("C3"), duration=1.3, update_times=(0.7, 1.1))
    seen = []
    flight = run_experiment(of, seen.append)
    assert [update.t for update in flight.updates] == pytest.approx([0.7, 1.1])
    # from 0.3 s on, 25 a second; the sample of the tick of an update comes after it
    assert [update.num_samples for update in flight.updates] == [{"payload": n, "agents": 2 * n} for n in (10, 20)]
    assert set(flight.updates[-1].fits) == {"payload", (0, 0), (0, 1)}
    assert len(flight.records.t) == 650
    assert not flight.termination_reason
    assert seen[0] == 0
    assert seen == sorted(seen)
    assert seen[-1] == pytest.approx(1.3)
    learned = flight.records.t >= 0.7 - 1e-9
    assert not flight.records.f_L_hat[~learned].any()
    assert np.abs(flight.records.f_L_hat[learned]).max() > 0.1


@pytest.mark.parametrize("latency", [0.3, None])
def test_model_becomes_active_after_fit_latency(latency, monkeypatch):
    """None: the latency is the measured duration of the fit; an update that is due during a fit is skipped."""
    of = dataclasses.replace(
        paper_experiment("C3"), duration=1.3, update_times=(0.5, 0.6, 0.9), fit_latency=latency, fit_options=None
    )
    original = online_learner.OnlineLearner.update

    def slowly(*settings, **options):
        shift[0] += 0.3
        return original(*settings, **options)

    shift, clock = [0.0], time.perf_counter
    began = clock()
    if latency is None:
        monkeypatch.setattr(time, "perf_counter", lambda: began + shift[0])
        monkeypatch.setattr(online_learner.OnlineLearner, "update", slowly)
    flight = run_experiment(of)
    assert [update.t for update in flight.updates] == pytest.approx([0.5, 0.9])
    assert [update.activation_time for update in flight.updates] == pytest.approx([0.8, 1.2])
    is_active = np.abs(flight.records.f_L_hat).max(1) > 0
    assert flight.records.t[is_active][0] == pytest.approx(0.8)
    message = "no model update at t = 0.600 s: the previous update was not finished (learning.fit_latency)"
    assert flight.learning_warnings == (message,)


def test_fit_that_ends_at_next_update_allows_that_update():
    """A model that is ready when the next update is due becomes active, and the next update follows."""
    of = dataclasses.replace(
        paper_experiment("C3"), duration=1.2, update_times=(0.5, 0.8), fit_latency=0.3, fit_options=None
    )
    flight = run_experiment(of)
    assert [update.activation_time for update in flight.updates] == pytest.approx([0.8, 1.1])
    assert not flight.learning_warnings


def test_replaced_models_leave_memory():
    of = dataclasses.replace(paper_experiment("C3"), duration=1.2, update_times=(0.5, 0.7, 0.9), fit_options=None)
    ticks, models, alive = [], [], []

    def observe(interval):
        alive.append(sum(model() is not None for model in models))
        ticks.append(interval.start_tick)
        models.append(weakref.ref(interval.model))

    flight = run_experiment(of, on_model=observe)
    assert ticks == [0, 250, 350, 450]
    assert alive == [0, 1, 2, 2]  # the initial model, which the experiment contains, and the replaced one
    assert isinstance(flight.interval, CompactInterval)  # the result keeps the last one without its factors
    assert [model() is None for model in models] == [False, True, True, True]


def test_unfinished_fit_at_the_end_is_reported():
    of = dataclasses.replace(
        paper_experiment("C3"), duration=0.7, update_times=(0.5,), fit_latency=0.3, fit_options=None
    )
    flight = run_experiment(of)
    assert not flight.updates
    assert flight.learning_warnings == ("the model update of t = 0.500 s was not finished when the flight ended",)
    assert flight.learning_warnings[0] in metrics.summary(flight, of.world.team, of.controller.team)["warnings"]


def test_failed_fit_keeps_the_model_and_is_reported(monkeypatch):
    """A failed fit leaves the model unchanged and is reported."""

    def failing(*_given, **_more):
        raise ValueError("no such luck")

    monkeypatch.setattr(model_update, "fit", failing)
    flight = run_experiment(dataclasses.replace(paper_experiment("C3"), duration=1.0, update_times=(0.7,)))
    assert (
        flight.updates[0].error_message
        == "model update at t = 0.700 s failed, previous model stays in use: no such luck"
    )
    assert flight.learning_warnings == (flight.updates[0].error_message,)
    assert not flight.records.f_L_hat.any()


def test_std_is_logged_at_its_rate_and_starts_at_the_prior(flight):
    """Standard deviations are logged at a decimated rate and equal the prior before any data."""
    sigma = flight.uncertainty
    np.testing.assert_allclose(np.diff(sigma.t), UNCERTAINTY_PERIOD, atol=1e-12)
    assert sigma.t[0] == 0
    settings = paper_flights.SETTINGS.learning.payload.signal_std
    stated = np.repeat([settings.force_N, settings.moment_Nm], 3)
    np.testing.assert_allclose(sigma.payload_std, np.tile(stated, (len(sigma.t), 1)))
    assert sigma.agent_std[0].shape == (len(sigma.t), 2, 9)


# Termination ----------------------------------------------------------------------------------------------------------


def limited(of: Experiment, **beyond: Any) -> Experiment:
    """Return the experiment with only some termination limits."""
    free = {
        "min_delassus": -1.0,
        "max_distance": np.inf,
        "min_height": -np.inf,
        "max_attitude_error": np.inf,
        "max_tilt": np.inf,
        "max_saturation_time": np.inf,
    }
    of_agents = {"min_delassus": jnp.full(2, float(beyond.pop("min_delassus", free.pop("min_delassus"))))}
    numbers = {k: number(x) for k, x in (free | beyond).items()}
    return dataclasses.replace(of, termination_limits=termination.TerminationLimits(**of_agents, **numbers))


@functools.cache
def falling() -> tuple[Experiment, FlightResult]:
    """A team whose rotors yield less than its weight, without limits, and its flight."""
    of = limited(with_exact_sensors(paper_experiment("C1")))
    (group,) = of.controller.team.agent_groups
    weak = dataclasses.replace(group, thrust_max=jnp.array([19.0, 24.0]))
    of = with_controller(of, team=dataclasses.replace(of.controller.team, agent_groups=(weak,)))
    return of, simulate(of, 1.0)


def limited_quantities(rows: signals.StepRecord) -> dict[str, np.ndarray]:
    """Return the limited quantities `(time, bodies)` by independent formulas, where larger is worse."""
    turned = Rotation.from_matrix(np.asarray(paper_experiment("C1").controller.reference.R).T @ rows.R_L).magnitude()
    up = np.einsum("tjik,k->tji", rows.R, [0, 0, 1.0])
    held = np.zeros(rows.thrust_saturated.shape)
    for k, now in enumerate(rows.thrust_saturated):
        held[k] = np.where(now, held[k - 1] + 0.002, 0.0)
    return {
        "max_distance": np.sqrt(((rows.p - rows.p_d) ** 2).sum(1, keepdims=True)),
        "min_height": -np.concatenate([rows.p[:, None], rows.x], axis=1)[:, :, 2],
        "max_attitude_error": turned[:, None],
        "max_tilt": np.arctan2(np.hypot(up[..., 0], up[..., 1]), up[..., 2]),
        "max_saturation_time": held,
    }


@pytest.mark.parametrize(
    ("limit", "whose", "setting"),
    [
        ("max_distance", ["the payload is"], "max_position_error_m"),
        ("min_height", ["the payload is at", "agent front is at", "agent rear is at"], "min_height_m"),
        ("max_attitude_error", ["the attitude error of the payload is"], "max_attitude_error_deg"),
        ("max_tilt", ["the thrust of agent front is", "the thrust of agent rear is"], "max_tilt_deg"),
        ("max_saturation_time", ["thrust of agent front", "thrust of agent rear"], "max_saturation_time_s"),
    ],
)
def test_run_ends_at_the_first_exceeded_limit(limit, whose, setting):
    """A run ends at the first step that exceeds a limit and states which one."""
    of, free = falling()
    assert not free.termination_reason
    signal = limited_quantities(free.records)[limit]
    worst = signal.max(1)
    most = (worst[0] + worst.max()) / 2 + 1e-6  # between two ticks of the longest saturation as well
    first = int(np.argmax(worst > most))
    assert 0 < first < len(worst) - 1
    stopped = simulate(limited(of, **{limit: -most if limit == "min_height" else most}), 1.0)
    same(stopped.records, jax.tree.map(lambda x: x[: first + 1], free.records))
    assert whose[int(np.argmax(signal[first]))] in stopped.termination_reason
    degrees = np.rad2deg(1) if setting.endswith("_deg") else 1.0
    message = float(stopped.termination_reason.rpartition(" ")[2])
    assert f"at t = {first * 0.002:.3f} s, beyond termination.{setting} = " in stopped.termination_reason
    assert abs(message) == pytest.approx(abs(most) * degrees, rel=1e-5)


def test_run_ends_at_a_near_singular_grasp():
    """A run with a nearly singular grasp ends at that step and names the agent."""
    of = limited(with_exact_sensors(paper_experiment("C1")))
    free = simulate(of, 0.5).records
    least = free.min_delassus_singular_value
    assert least[:, 1].min() < least[0].min()
    limit = (least[0].min() + least[:, 1].min()) / 2
    stopped = simulate(limited(of, min_delassus=limit), 0.5)
    (first, *_), (agent, *_) = np.nonzero(least <= limit)
    same(stopped.records, jax.tree.map(lambda x: x[: first + 1], free))
    t = first * 0.002
    name = NAMES[int(np.argmin(least[first]))]
    assert least[first, agent] <= limit
    assert stopped.termination_reason.startswith(f"the grasp of agent {name} is near singular at t = {t:.3f} s: ")
    assert stopped.termination_reason.endswith(
        " 1/kg (limit min_delassus); the constraints of arms 1 and 2 are redundant"
    )
    assert len(stopped.uncertainty.t) == first // round(UNCERTAINTY_PERIOD / 0.002) + 1


def test_singular_value_limit_is_relative_to_the_start(flight):
    np.testing.assert_allclose(
        paper_experiment("C1").termination_limits.min_delassus,
        MIN_GRASP_RATIO * flight.records.min_delassus_singular_value[0],
        rtol=1e-12,
    )


def test_run_ends_at_a_signal_that_is_not_finite():
    """A run with a signal that is not finite ends and names the signal."""
    path = dataclasses.replace(paper_experiment("C1").controller.reference, center=jnp.array([np.nan, 0, 2]))
    lost = simulate(with_controller(paper_experiment("C1"), reference=path), 0.5)
    assert lost.termination_reason == "signal p_d is not finite at t = 0.000 s"
    assert len(lost.records.t) == 1
    broken = jax.tree.map(lambda x: x * np.nan, paper_experiment("C1").world.tip_force_bias)
    assert (
        simulate(with_world(paper_experiment("C1"), tip_force_bias=broken), 0.5).termination_reason
        == "signal lam_hat is not finite at t = 0.000 s"
    )


def test_diverging_run_ends_and_keeps_its_log():
    """A diverging run ends at that step and keeps the records before."""
    unstable = simulate(paper_flights.with_gains(limited(paper_experiment("C1")), agent_k_omega=number(1e6)), 0.5)
    assert "not finite" in unstable.termination_reason
    assert 1 < len(unstable.records.t) < 20
    assert f"t = {unstable.records.t[-1]:.3f} s" in unstable.termination_reason
    assert all(np.isfinite(leaf[:-1]).all() for leaf in jax.tree.leaves(unstable.records))


# Native code ----------------------------------------------------------------------------------------------------------


def test_native_code_equals_jax_with_frozen_models():
    """A second of C3 after an update, with noise: the difference is rounding of two compilers."""
    of = dataclasses.replace(paper_experiment("C3"), duration=4.0, update_times=(3.5,))
    model = simulate(of, 4.0).model
    assert int(model.payload.num_points) > 10
    setup = with_controller(of, residual_model=model).loop_config
    by_native = by_jax = simulator.reset(setup, of.initial_state)
    jax_s = jax.jit(simulator._advance)
    for k in range(2):
        noise = of.world.sample_noise(jax.random.key(k), paper_flights.ROOM)
        by_native, rows = simulator.rollout(setup, by_native, noise, jnp.asarray(paper_flights.ROOM))
        by_jax, same = jax_s(setup, by_jax, noise, jnp.asarray(paper_flights.ROOM))
        assert jax.tree.structure(rows) == jax.tree.structure(same)
        for field in dataclasses.fields(rows):
            actual, expected = np.asarray(getattr(rows, field.name)), np.asarray(getattr(same, field.name))
            np.testing.assert_allclose(actual.astype(float), expected.astype(float), atol=1e-9, err_msg=field.name)
    assert np.abs(rows.f_L_hat).max() > 0.1


@pytree
class PythonForce(disturbances.DisturbanceModel):
    """Disturbance with a Python callback, which C code cannot call."""

    def __call__(self, at: disturbances.PointKinematics, t: Any, state: Any) -> tuple[Any, Any]:
        force = jax.pure_callback(lambda v: -0.1 * np.asarray(v), jax.ShapeDtypeStruct((3,), float), at.v)
        return force, jnp.zeros(3)


@pytest.mark.long
@pytest.mark.jax_fallback
def test_part_without_native_code_runs_in_jax(caplog):
    of = experiment.make_experiment(light.settings(), "C1")
    mount = disturbances.PayloadDisturbance(name="asked", model=PythonForce(), point=jnp.zeros(3))
    sources = dataclasses.replace(of.world.disturbances, payload=(*of.world.disturbances.payload, mount))
    with caplog.at_level("INFO"):
        flown = run_experiment(dataclasses.replace(with_world(of, disturbances=sources), duration=0.02))
    assert flown.termination_reason == ""
    (line,) = [line for line in caplog.messages if "run on JAX" in line]
    assert "'pure_callback' is not supported, at " in line


def test_a_chunk_without_states_has_no_model_inputs():
    """Updates at a short interval leave chunks without a state; a vehicle without joints has no joint columns."""
    team = random_teams.team(np.random.default_rng(0), ((random_teams.RIGID, 3), (random_teams.CHAIN, 1)))
    joints = random_teams.CHAIN.joints
    sizes = {"r": (joints,), "r_dot": (joints,), "R": (4, 3, 3), "x": (4, 3), "omega": (4, 3), "v_agent": (4, 3)}
    sizes |= {"p": (3,), "v": (3,), "R_L": (3, 3), "omega_L": (3,), "t": ()}
    rows = types.SimpleNamespace(**{name: np.zeros((0, *shape)) for name, shape in sizes.items()})
    payload, agents = signals.model_inputs.__wrapped__(team, rows)  # type: ignore[attr-defined]
    assert [x.shape for x in (payload, *agents)] == [(0, 18), (0, 3, 18), (0, 1, 18 + 2 * joints)]
