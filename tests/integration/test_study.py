"""Tests of the paper's study with shortened learning: shared settings of the cases, and orderings of figures 1 to 4."""

from __future__ import annotations

import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import scenario
from colift.analysis import metrics
from colift.closed_loop import flight
from colift.onboard.learning import confidence_bounds
from colift.scenario import ScenarioError, experiment, termination
from colift.scenario.schema import PayloadMassStep
from colift.workflows import study
from tests.support import paper_flights as paper
from tests.support import small_team as light


@pytest.fixture(scope="module")
def found() -> dict[str, dict]:
    """Metrics of the three cases."""
    experiment = paper.paper_experiment("C1")
    return {
        case: metrics.summary(paper.flight(case), experiment.world.team, experiment.controller.team)
        for case in ("C1", "C2", "C3")
    }


@pytest.mark.parametrize("program", ["/anywhere/.venv/bin/colift", "/usr/lib/python3/site-packages/colift/__main__.py"])
def test_the_recorded_command_can_be_typed(program):
    assert study.command_line([program, "study", "my team.yaml"]) == "colift study 'my team.yaml'"


def test_cases_differ_only_in_recorded_data():
    c1, c3 = paper.paper_experiment("C1"), paper.paper_experiment("C3")
    same = jax.tree.map(
        np.array_equal,
        (c1.world, c1.controller.residual_model, c1.initial_state),
        (c3.world, c3.controller.residual_model, c3.initial_state),
    )
    assert all(jax.tree.leaves(same))
    a, b = (jax.tree.leaves_with_path(experiment.controller) for experiment in (c1, c3))
    different = [jax.tree_util.keystr(path) for (path, x), (_, y) in zip(a, b, strict=True) if not np.array_equal(x, y)]
    assert different == [".recorder.payload", ".recorder.agents"]
    assert (c1.seed, c1.duration) == (c3.seed, c3.duration)


def test_unknown_case_is_refused_with_known_cases():
    with pytest.raises(KeyError, match=r"C5.*C1, C2, C3, adaptive, integral, disturbance_observer, parametric"):
        experiment.make_experiments(paper.SETTINGS, ("C5",))


# Extensions of the paper ----------------------------------------------------------------------------------------------


@functools.cache
def light_flight(case: str) -> flight.FlightResult:
    """Flight of the smallest team with a step of the payload mass after learning."""
    settings = light.settings(
        duration_s=4.0,
        learning=light.SAMPLE.learning.model_copy(
            update={"update_times_s": (1.0, 1.5), "end_s": 1.5, "update_period_s": 0.5}
        ),
        payload_mass_step=PayloadMassStep(mass_kg=0.3, start_s=2.2),
    )
    made = experiment.make_experiment(settings, case)
    return flight.run_experiment(made)


def test_adaptive_refits_after_the_stated_times():
    """Case `adaptive` refits after the stated update times."""
    settings = scenario.load_scenario(
        "paper", ["duration_s=35", "learning.refit_period_s=8", "learning.max_samples=100"]
    )
    adaptive = experiment.make_experiment(settings, "adaptive")
    assert adaptive.update_times == pytest.approx((2, 4, 6, 8, 10, 18, 26, 34))
    assert experiment.make_experiment(settings, "gp_label_feedback").update_times == pytest.approx((2, 4, 6, 8, 10))


@pytest.mark.long
def test_label_feedback_compensates_added_mass():
    """Cases with label feedback compensate mass that is added to the payload."""
    flights = {case: light_flight(case) for case in ("C1", "label_feedback", "gp_label_feedback", "adaptive")}
    e_p = {case: metrics.rms_norm(flight.records.e_p[flight.records.t > 3.0]) for case, flight in flights.items()}
    assert not any(flight.termination_reason for flight in flights.values())
    assert max(e_p[case] for case in ("label_feedback", "gp_label_feedback", "adaptive")) < 0.3 * e_p["C1"]


def test_adaptive_detects_and_learns_added_mass():
    c4 = light_flight("adaptive")
    assert c4.records.correction_L is not None
    assert [update.t for update in c4.updates] == pytest.approx([1.0, 1.5, 2.0, 2.5, 3.0, 3.5])
    assert all(update.t == update.activation_time for update in c4.updates)
    assert {id(update.fits["payload"]) for update in c4.updates[1:]} == {id(c4.updates[1].fits["payload"])}
    assert int(c4.model.update_index) == 6
    first = next(update for update in c4.updates if "payload" in update.change_points)
    assert 2.5 - 1e-9 <= first.t <= 3.0 + 1e-9
    rows = c4.records
    late, before = rows.t > 3.5, (rows.t > 1.6) & (rows.t < 2.2)
    learned, true = (x[late, 2].mean() - x[before, 2].mean() for x in (rows.model_prediction_L, rows.f_L))
    assert true == pytest.approx(-0.3 * 9.81, abs=0.3)
    assert learned == pytest.approx(true, abs=0.4)  # N, without the correction


@pytest.mark.long
def test_gp_label_feedback_updates_like_c3():
    assert [update.t for update in light_flight("gp_label_feedback").updates] == pytest.approx([1.0, 1.5])
    assert light_flight("gp_label_feedback").records.correction_L is not None


@pytest.mark.long
def test_label_feedback_is_logged_and_extrapolated():
    f = light_flight("label_feedback").records
    np.testing.assert_allclose(f.correction_weight_L, 1.0)
    # the prediction is the label extrapolated along its rate
    predictor = experiment.make_experiment(light.settings(), "label_feedback").controller.residual_predictor
    lead_time = float(predictor.lead_time)
    rate = np.diff(f.correction_L, axis=0) / float(f.t[1])
    np.testing.assert_allclose(f.f_L_hat[1:], f.correction_L[1:] + lead_time * rate, atol=1e-9)


# Before the simulation ------------------------------------------------------------------------------------------------


def test_team_with_too_little_thrust_is_refused():
    """Agents of 1.84 kg with half of 1.5 kg each, a clamp of 1.2 N, and rotors with a thrust bias of -1.5 N."""
    weight = 9.81 * (2 * 1.84 + 1.5)
    with pytest.raises(ScenarioError, match="cannot hover") as refused:
        experiment.make_experiments(paper.with_weaker_rotors(weight / 4), ("C1",))
    message = str(refused.value)
    assert "front needs 28.35 N of 12.7 N, rear needs 27.88 N of 12.7 N" in message
    required = float(message.rpartition("need ")[2].split()[0])
    assert weight + 1.2 < required < weight + 1.2 + 1.5 + 1.55 + 3
    with pytest.raises(ScenarioError) as refused:
        experiment.make_experiments(paper.with_weaker_rotors(28.0), ("C1",))
    assert "front needs" in str(refused.value)
    assert "rear needs" not in str(refused.value)


def test_flights_of_the_study_stay_far_from_all_limits():
    limits = paper.SETTINGS.termination
    for case in ("C1", "C2", "C3"):
        rows = paper.flight(case).records
        assert not paper.flight(case).termination_reason
        assert rows.correction_L is None  # these cases use labels in updates only
        assert np.linalg.norm(rows.e_p, axis=1).max() < limits.max_position_error_m / 4
        assert rows.Psi.max() < (1 - np.cos(np.deg2rad(limits.max_attitude_error_deg))) / 4
        assert rows.R[:, :, 2, 2].min() > np.cos(np.deg2rad(limits.max_tilt_deg / 2))
        assert (
            rows.min_delassus_singular_value.min()
            > 10 * termination.MIN_GRASP_RATIO * rows.min_delassus_singular_value[0].max()
        )
        assert rows.thrust_saturated.sum(0).max() * 0.002 < limits.max_saturation_time_s / 4


# The paper's figures --------------------------------------------------------------------------------------------------


def test_figure_1_errors_decrease_from_c1_to_c2_to_c3(found: dict[str, dict]):
    for key in ("e_p_rms_m", "Psi_mean"):
        assert found["C1"][key] > found["C2"][key] > found["C3"][key]


def test_figure_2_mismatch_decreases_with_learning(found: dict[str, dict]):
    """Figure 2: the wrench mismatch decreases with payload learning, and again with agent learning."""
    assert found["C1"]["delta_W_rms"] > found["C2"]["delta_W_rms"] > found["C3"]["delta_W_rms"]


def test_figure_3_std_decreases_for_learned_bodies(found: dict[str, dict]):
    """Figure 3: predictive standard deviations decrease only for bodies that are learned."""
    assert found["C2"]["sigma_L_mean"] < found["C1"]["sigma_L_mean"]
    assert found["C3"]["sigma_L_mean"] < found["C1"]["sigma_L_mean"]
    assert found["C2"]["sigma_A_mean"] == pytest.approx(found["C1"]["sigma_A_mean"], rel=1e-12)
    assert found["C3"]["sigma_A_mean"] < found["C1"]["sigma_A_mean"]


def test_figure_5_bounds_contain_errors_and_decrease(found: dict[str, dict]):
    """Figure 5: error bounds contain the true errors and decrease for bodies that are learned."""
    stated, learning = paper.paper_experiment("C1").bound_assumptions, paper.SETTINGS.learning
    signal = learning.payload.signal_std
    before = stated.rkhs_norm * np.repeat([signal.force_N, signal.moment_Nm], 3)
    for case in ("C1", "C2", "C3"):
        bodies = [found[case]["error_bound"]["payload"], *found[case]["error_bound"]["agents"]]
        assert [body["violation_rate"]["total"] for body in bodies] == [0, 0, 0]
        sigma = paper.flight(case).uncertainty
        np.testing.assert_allclose(sigma.payload_radius[sigma.t < 2], np.tile(before, (20, 1)), rtol=1e-12)
        learned = [case != "C1", case == "C3", case == "C3"]
        for body, is_learned in zip(bodies, learned, strict=True):
            beta = np.array(body["beta"])
            assert (beta <= 2**0.5 * stated.rkhs_norm).all()
            assert (beta == stated.rkhs_norm).all() != is_learned
            assert not is_learned or body["bound_over_error_median"] < 20
    c1, c3 = (np.linalg.norm(paper.flight(case).uncertainty.payload_radius[-20:, :3], axis=1) for case in ("C1", "C3"))
    assert c3.max() < 0.6 * c1.min()


def test_figure_5_bounds_are_confidence_bands():
    """Figure 5: the logged bounds are the confidence bands at the true states."""
    flight = paper.flight("C3")
    rows, sigma = flight.records, flight.uncertainty
    late = np.flatnonzero(sigma.t > 6.0)[::8]
    at = [int(np.argmin(np.abs(rows.t - t))) for t in sigma.t[late]]
    x = np.concatenate([rows.p, rows.v, rows.R_L.reshape(-1, 9), rows.omega_L, np.zeros((len(rows.t), 6))], axis=1)[at]
    radius = confidence_bounds.payload_radius(flight.model, flight.bands, jnp.asarray(x))
    np.testing.assert_allclose(sigma.payload_radius[late], radius, rtol=1e-9)
    assert len(late) > 3


@pytest.mark.long
def test_figure_4_internal_forces_reshape_contact_forces(found: dict[str, dict]):
    """Figure 4: internal forces change the contact forces and not the motion."""
    for case in ("C1", "C2", "C3"):
        with_eta, without = paper.flight(case).records, paper.flight(case, eta=False).records
        assert np.linalg.norm(with_eta.eta, axis=1).max() >= 1
        assert np.abs(with_eta.lam - without.lam).max(axis=(1, 2))[2500:3000].min() >= 0.5
        assert paper.rms(with_eta.e_p - without.e_p) < 0.05 * paper.rms(without.e_p)
        assert found[case]["contact_force_hf_rms_N"] <= 0.2


def test_lemma_2_and_the_interface_identity_hold(found: dict[str, dict]):
    nominal = paper.paper_experiment("C1").controller.team
    for case in ("C1", "C2", "C3"):
        assert found[case]["wrench_consistency_max"] <= 1e-9
        assert found[case]["interface_identity_max"] <= 1e-9
    assert metrics.wrench_consistency_error(paper.flight("C1", eta=False).records, nominal) <= 1e-9


def test_proposition_1_the_grasp_is_invariant(found: dict[str, dict]):
    for case in ("C1", "C2", "C3"):
        assert found[case]["Phi_max_m"] <= 1e-10
        assert found[case]["Phi_dot_max_mps"] <= 1e-10


def test_simulation_is_deterministic():
    experiment = paper.paper_experiment("C1")
    a, b = paper.simulate(experiment, 1.0), paper.simulate(experiment, 1.0)
    assert all(jax.tree.leaves(jax.tree.map(np.array_equal, a.records, b.records)))
