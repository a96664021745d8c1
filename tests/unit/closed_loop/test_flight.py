"""The closed loop: residuals against their sources, the log against itself, runs that stop, runs that repeat."""

from __future__ import annotations

import dataclasses
import functools
import time
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift.analysis import metrics
from colift.closed_loop import signals, simulator, termination
from colift.closed_loop.flight import UNCERTAINTY_PERIOD, Experiment, FlightResult, run_experiment
from colift.math.pytree import pytree
from colift.onboard.learning import model_update, online_learner
from colift.scenario import experiment
from colift.simulation import disturbances
from tests.support import paper_flights
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
    """A second of case C1 as shipped, with noise."""
    return simulate(paper_experiment("C1"), 1.0)


# The residual ---------------------------------------------------------------------------------------------------------


def test_with_the_right_parameters_the_residual():
    """With the right parameters the residual is what the sources do."""
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


def test_mass_and_inertia_mismatch_add_to_the_residual_what_they(flight):
    """Mass and inertia mismatch add to the residual what they take from inertia."""
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


# The log --------------------------------------------------------------------------------------------------------------


def test_the_log_moves_as_it_says(flight):
    """Positions, velocities and accelerations are each other's rates: the plant integrates what it logs."""
    rows = jax.tree.map(lambda x: x[50:], flight.records)  # after the first tenth of a second, which jerks
    dt = float(np.diff(rows.t[:2])[0])
    # within a tick commands are held and all is smooth: the trapezoidal rule errs by dt^2 / 12 times the jerk,
    # which for the joints is some 100 rad/s^3
    for x, x_dot in ((rows.p, rows.v), (rows.x, rows.v_agent), (rows.r, rows.r_dot)):
        np.testing.assert_allclose(np.diff(x, axis=0) / dt, (x_dot[1:] + x_dot[:-1]) / 2, atol=1e-4)
    # the log has the acceleration at the beginning of a tick: first order in dt
    error = np.diff(rows.v, axis=0) / dt - rows.a_L[:-1, :3]
    assert paper_flights.rms(error) < 0.01 * paper_flights.rms(rows.a_L[:, :3])


def test_every_attitude_stays_a_rotation(flight):
    for R in (flight.records.R_L[:, None], flight.records.R):
        np.testing.assert_allclose(R @ R.swapaxes(-1, -2), np.broadcast_to(np.eye(3), R.shape), atol=1e-12)


def test_the_grasp_holds(flight):
    assert flight.records.Phi.max() <= 1e-10
    assert flight.records.Phi_dot.max() <= 1e-10
    assert (
        flight.records.min_delassus_singular_value.min()
        > 10 * np.asarray(paper_experiment("C1").termination_limits.min_delassus).max()
    )


def test_errors_are_those_of_the_truth_not_of_the_estimate(flight):
    rows, start = flight.records, paper_flights.SETTINGS.initial_state
    np.testing.assert_allclose(rows.e_p[0], start.position_error_m, atol=1e-3)
    assert np.linalg.norm(rows.e_p[0]) == pytest.approx(0.2, abs=0.01)
    assert rows.Psi[0] == pytest.approx(1 - np.cos(np.deg2rad(10)), rel=0.02)
    np.testing.assert_allclose(rows.e_p, rows.p - rows.p_d, atol=1e-15)


def test_contact_forces_are_read_back_with_the_noise_of_the_tips(flight):
    rows = flight.records
    settled = rows.t > 0.2
    error = (rows.lam_hat - rows.lam)[settled]
    given = paper_flights.SETTINGS.sensors
    bound = 1.5 * np.hypot(given.tip_force_N, 3 * given.tip_force_bias_N)
    assert 0.5 * given.tip_force_N < error.std(0).min()
    assert np.sqrt((error**2).mean(0)).max() < bound


# Repetition -----------------------------------------------------------------------------------------------------------


def same(a: signals.StepRecord, b: signals.StepRecord) -> None:
    """Every number of two logs is the same, to the last bit."""
    for field in dataclasses.fields(a):
        np.testing.assert_array_equal(getattr(a, field.name), getattr(b, field.name), err_msg=field.name)


def test_the_same_seed_gives_the_same_flight(flight):
    same(flight.records, simulate(paper_experiment("C1"), 1.0).records)


def test_another_seed_gives_another_noise_on_the_same_start(flight):
    other = simulate(dataclasses.replace(paper_experiment("C1"), seed=1), 1.0).records
    np.testing.assert_array_equal(other.p[0], flight.records.p[0])
    assert np.abs(other.lam_hat - flight.records.lam_hat).max() > 0.1


def test_noise_does_not_depend_on_when_updates_cut_the_run(flight):
    cut = dataclasses.replace(
        paper_experiment("C1"), duration=1.0, update_times=(0.302, 0.7)
    )  # C1 has no data: nothing is learned
    stopped = run_experiment(cut)
    assert [update.t for update in stopped.updates] == pytest.approx([0.302, 0.7])
    same(flight.records, stopped.records)


def test_until_the_first_update_all_cases_fly_the_same(flight):
    for case in ("C2", "C3"):
        learning = simulate(dataclasses.replace(paper_experiment(case), update_times=(5.0,)), 1.0)
        same(flight.records, learning.records)


def test_updates_come_at_their_ticks_with_the_data_until_then():
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
def test_what_is_learned_flies_when_it_is_ready_and_not_before(latency, monkeypatch):
    """None: as long as teaching takes here, which a clock that is turned says. An update due meanwhile is left out."""
    of = dataclasses.replace(
        paper_experiment("C3"), duration=1.3, update_times=(0.5, 0.6, 0.9), fit_latency=latency, fit_options=None
    )
    teach = online_learner.OnlineLearner.update

    def slowly(*given, **more):
        shift[0] += 0.3
        return teach(*given, **more)

    shift, clock = [0.0], time.perf_counter
    began = clock()
    if latency is None:
        monkeypatch.setattr(time, "perf_counter", lambda: began + shift[0])
        monkeypatch.setattr(online_learner.OnlineLearner, "update", slowly)
    flight = run_experiment(of)
    assert [update.t for update in flight.updates] == pytest.approx([0.5, 0.9])
    assert [update.activation_time for update in flight.updates] == pytest.approx([0.8, 1.2])
    heard = np.abs(flight.records.f_L_hat).max(1) > 0
    assert flight.records.t[heard][0] == pytest.approx(0.8)
    said = "no model update at t = 0.600 s: the previous update was not finished (learning.fit_latency)"
    assert flight.learning_warnings == (said,)


def test_what_is_ready_when_the_next_is_due_flies_and_the_next():
    """What is ready when the next is due flies and the next is learned."""
    of = dataclasses.replace(
        paper_experiment("C3"), duration=1.2, update_times=(0.5, 0.8), fit_latency=0.3, fit_options=None
    )
    flight = run_experiment(of)
    assert [update.activation_time for update in flight.updates] == pytest.approx([0.8, 1.1])
    assert not flight.learning_warnings


def test_what_is_not_ready_when_the_flight_ends_is_said():
    of = dataclasses.replace(
        paper_experiment("C3"), duration=0.7, update_times=(0.5,), fit_latency=0.3, fit_options=None
    )
    flight = run_experiment(of)
    assert not flight.updates
    assert flight.learning_warnings == ("the model update of t = 0.500 s was not finished when the flight ended",)
    assert flight.learning_warnings[0] in metrics.summary(flight, of.world.team, of.controller.team)["warnings"]


def test_a_fit_that_fails_leaves_the_oracle_as_it_was_and_says(monkeypatch):
    """A fit that fails leaves the oracle as it was and says so."""

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


def test_deviations_come_at_their_rate_and_are_the_prior(flight):
    """Deviations come at their rate and are the prior is before any data."""
    sigma = flight.uncertainty
    np.testing.assert_allclose(np.diff(sigma.t), UNCERTAINTY_PERIOD, atol=1e-12)
    assert sigma.t[0] == 0
    given = paper_flights.SETTINGS.learning
    stated = np.repeat([given.payload.force_std_N, given.payload.moment_std_Nm], 3)
    np.testing.assert_allclose(sigma.payload_std, np.tile(stated, (len(sigma.t), 1)))
    assert sigma.agent_std[0].shape == (len(sigma.t), 2, 9)


# Runs that stop -------------------------------------------------------------------------------------------------------


def limited(of: Experiment, **beyond: Any) -> Experiment:
    """The plan with no limits but some."""
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
    """A team whose rotors give less than its weight, without limits; and its flight."""
    of = limited(with_exact_sensors(paper_experiment("C1")))
    (group,) = of.controller.team.agent_groups
    weak = dataclasses.replace(group, thrust_max=jnp.array([19.0, 24.0]))
    of = with_controller(of, team=dataclasses.replace(of.controller.team, agent_groups=(weak,)))
    return of, simulate(of, 1.0)


def watched(rows: signals.StepRecord) -> dict[str, np.ndarray]:
    """What the limits are about, `(time, bodies)`, written out another way; oriented so that more is worse."""
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
def test_a_run_stops_at_the_tick_that_first_exceeds_a_limit(limit, whose, setting):
    """A run stops at the tick that first exceeds a limit and says which."""
    of, free = falling()
    assert not free.termination_reason
    signal = watched(free.records)[limit]
    worst = signal.max(1)
    most = (worst[0] + worst.max()) / 2 + 1e-6  # between two ticks of the longest saturation as well
    first = int(np.argmax(worst > most))
    assert 0 < first < len(worst) - 1
    stopped = simulate(limited(of, **{limit: -most if limit == "min_height" else most}), 1.0)
    same(stopped.records, jax.tree.map(lambda x: x[: first + 1], free.records))
    assert whose[int(np.argmax(signal[first]))] in stopped.termination_reason
    degrees = np.rad2deg(1) if setting.endswith("_deg") else 1.0
    said = float(stopped.termination_reason.rpartition(" ")[2])
    assert f"at t = {first * 0.002:.3f} s, beyond termination.{setting} = " in stopped.termination_reason
    assert abs(said) == pytest.approx(abs(most) * degrees, rel=1e-5)


def test_a_run_whose_grasp_is_near_singular_stops_at_that_tick():
    """A run whose grasp is near singular stops at that tick and names the agent."""
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
        " 1/kg (termination.min_grasp_ratio); the constraints of arms 1 and 2 are redundant"
    )
    assert len(stopped.uncertainty.t) == first // 10 + 1


def test_the_least_grip_is_a_share_of_the_start_s(flight):
    share = paper_flights.SETTINGS.termination.min_grasp_ratio
    np.testing.assert_allclose(
        paper_experiment("C1").termination_limits.min_delassus,
        share * flight.records.min_delassus_singular_value[0],
        rtol=1e-12,
    )


def test_a_run_with_a_signal_that_is_not_finite_stops_and_names():
    """A run with a signal that is not finite stops and names it."""
    path = dataclasses.replace(paper_experiment("C1").controller.reference, center=jnp.array([np.nan, 0, 2]))
    lost = simulate(with_controller(paper_experiment("C1"), reference=path), 0.5)
    assert lost.termination_reason == "signal p_d is not finite at t = 0.000 s"
    assert len(lost.records.t) == 1
    broken = jax.tree.map(lambda x: x * np.nan, paper_experiment("C1").world.tip_force_bias)
    assert (
        simulate(with_world(paper_experiment("C1"), tip_force_bias=broken), 0.5).termination_reason
        == "signal lam_hat is not finite at t = 0.000 s"
    )


def test_a_run_that_blows_up_stops_at_that_tick_and_keeps():
    """A run that blows up stops at that tick and keeps what was flown."""
    wild = simulate(paper_flights.with_gains(limited(paper_experiment("C1")), agent_k_omega=number(1e6)), 0.5)
    assert "not finite" in wild.termination_reason
    assert 1 < len(wild.records.t) < 20
    assert f"t = {wild.records.t[-1]:.3f} s" in wild.termination_reason
    assert all(np.isfinite(leaf[:-1]).all() for leaf in jax.tree.leaves(wild.records))


# Native code ----------------------------------------------------------------------------------------------------------


def test_a_flight_with_frozen_oracles_in_native_code_is_jax_s():
    """A second of C3 after an update, with noise: two compilers' rounding, and nothing more."""
    of = dataclasses.replace(paper_experiment("C3"), duration=4.0, update_times=(3.5,))
    oracle = simulate(of, 4.0).model
    assert int(oracle.payload.num_points) > 10
    setup = with_controller(of, residual_model=oracle).loop_config
    by_native = by_jax = simulator.reset(setup, of.initial_state)
    jax_s = jax.jit(simulator._advance)
    for k in range(2):
        noise = of.world.sample_noise(jax.random.key(k), paper_flights.ROOM)
        by_native, rows = simulator.rollout(setup, by_native, noise, jnp.asarray(paper_flights.ROOM))
        by_jax, same = jax_s(setup, by_jax, noise, jnp.asarray(paper_flights.ROOM))
        assert jax.tree.structure(rows) == jax.tree.structure(same)
        for field in dataclasses.fields(rows):
            got, want = np.asarray(getattr(rows, field.name)), np.asarray(getattr(same, field.name))
            np.testing.assert_allclose(got.astype(float), want.astype(float), atol=1e-9, err_msg=field.name)
    assert np.abs(rows.f_L_hat).max() > 0.1


@pytree
class Asking(disturbances.DisturbanceModel):
    """A force that a Python function says, which no C code can call."""

    def __call__(self, at: disturbances.PointKinematics, t: Any, memory: Any) -> tuple[Any, Any]:
        force = jax.pure_callback(lambda v: -0.1 * np.asarray(v), jax.ShapeDtypeStruct((3,), float), at.v)
        return force, jnp.zeros(3)


@pytest.mark.long
def test_a_part_that_native_code_cannot_call_is_flown_by_jax(caplog):
    of = experiment.make_experiment(light.settings(), "C1")
    mount = disturbances.PayloadDisturbance(name="asked", model=Asking(), point=jnp.zeros(3))
    sources = dataclasses.replace(of.world.disturbances, payload=(*of.world.disturbances.payload, mount))
    with caplog.at_level("INFO", logger="colift.simulate"):
        flown = run_experiment(dataclasses.replace(with_world(of, disturbances=sources), duration=0.02))
    assert flown.termination_reason == ""
    assert "simulation runs in JAX" in caplog.text
    assert "pure_callback" in caplog.text
