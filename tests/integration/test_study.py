"""The paper's study, flown sooner: what the cases share, and the orderings of its figures 1 to 4."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift import scenario
from colift.analysis import metrics
from colift.closed_loop import flight
from colift.onboard.learning import confidence_bounds
from colift.scenario import ScenarioError, experiment
from colift.scenario.schema import OnlineCorrection, PayloadMassStep
from colift.workflows import study
from tests.support import paper_flights as paper
from tests.support import small_team as light


@pytest.fixture(scope="module")
def found() -> dict[str, dict]:
    """Figures of merit of the three cases."""
    plan = paper.plan("C1")
    return {
        case: metrics.summary(paper.flight(case), plan.world.team, plan.controller.team) for case in ("C1", "C2", "C3")
    }


@pytest.mark.parametrize("program", ["/home/me/.venv/bin/colift", "/usr/lib/python3/site-packages/colift/__main__.py"])
def test_the_recorded_command_can_be_typed(program):
    assert study.command_line([program, "study", "my team.yaml"]) == "colift study 'my team.yaml'"


def test_cases_differ_in_what_they_record_and_in_nothing_else():
    c1, c3 = paper.plan("C1"), paper.plan("C3")
    same = jax.tree.map(
        np.array_equal,
        (c1.world, c1.controller.residual_model, c1.initial_state),
        (c3.world, c3.controller.residual_model, c3.initial_state),
    )
    assert all(jax.tree.leaves(same))
    a, b = (jax.tree.leaves_with_path(plan.controller) for plan in (c1, c3))
    different = [jax.tree_util.keystr(path) for (path, x), (_, y) in zip(a, b, strict=True) if not np.array_equal(x, y)]
    assert different == [".recorder.payload", ".recorder.agents"]
    assert (c1.seed, c1.duration) == (c3.seed, c3.duration)


def test_an_unknown_case_is_refused_with_those_there_are():
    with pytest.raises(KeyError, match=r"C5.*C1, C2, C3, adaptive, integral, disturbance_observer, parametric"):
        experiment.make_experiments(paper.SETTINGS, ("C5",))


# What goes beyond the paper -------------------------------------------------------------------------------------------


@functools.cache
def light_flight(case: str) -> flight.FlightResult:
    """The smallest team, on whose payload some mass is put once it has learned."""
    settings = light.settings(
        duration_s=4.0,
        learning=light.SAMPLE.learning.model_copy(update={"update_times_s": (1.0, 1.5), "end_s": 1.5}),
        payload_mass_step=PayloadMassStep(mass_kg=0.3, start_s=2.2),
        online_correction=OnlineCorrection(update_period_s=0.5),
    )
    made = experiment.make_experiment(settings, case)
    if made.online_updates is not None:
        made = dataclasses.replace(made, online_updates=dataclasses.replace(made.online_updates, min_samples=40))
    return flight.run_experiment(made)


def test_after_its_stated_times_c4_goes_on_fitting_and_asks():
    """After its stated times c4 goes on fitting and asks no more samples than it has room for."""
    given = scenario.load_scenario(
        "paper", ["duration_s=35", "online_correction.refit_period_s=8", "learning.max_samples=100"]
    )
    plan = experiment.make_experiment(given, "adaptive")
    assert plan.update_times == pytest.approx((2, 4, 6, 8, 10, 18, 26, 34))
    assert plan.online_updates is not None
    assert plan.online_updates.min_samples == 100
    assert experiment.make_experiment(given, "gp_label_feedback").update_times == pytest.approx((2, 4, 6, 8, 10))


@pytest.mark.long
def test_labels_bring_a_team_back_whose_payload_has_become():
    """Labels bring a team back whose payload has become heavier."""
    flights = {case: light_flight(case) for case in ("C1", "label_feedback", "gp_label_feedback", "adaptive")}
    e_p = {case: metrics.rms_norm(flight.records.e_p[flight.records.t > 3.0]) for case, flight in flights.items()}
    assert not any(flight.termination_reason for flight in flights.values())
    assert max(e_p[case] for case in ("label_feedback", "gp_label_feedback", "adaptive")) < 0.3 * e_p["C1"]


def test_learning_goes_on_and_amends_what_has_become_wrong():
    c4 = light_flight("adaptive")
    assert c4.records.innovation_L is not None
    assert [update.t for update in c4.updates] == pytest.approx([1.0, 1.5, 2.0, 2.5, 3.0, 3.5])
    assert all(update.t == update.activation_time for update in c4.updates)
    assert {id(update.fits["payload"]) for update in c4.updates[1:]} == {id(c4.updates[1].fits["payload"])}
    assert int(c4.model.update_index) == 6
    (heavier,) = [update for update in c4.updates if "payload" in update.change_points]
    assert 2.5 - 1e-9 <= heavier.t <= 3.0 + 1e-9
    before = c4.updates[1].theta[0]  # of the mean, in which mass and a constant force are hard to tell apart
    np.testing.assert_allclose(c4.model.inertial_parameters[0] - before, -0.3, atol=0.05)


@pytest.mark.long
def test_a_map_with_a_correction_beside_it_learns_as_the_paper_s():
    assert [update.t for update in light_flight("gp_label_feedback").updates] == pytest.approx([1.0, 1.5])
    assert light_flight("gp_label_feedback").records.innovation_L is not None


@pytest.mark.long
def test_what_labels_say_is_logged_and_carried_ahead():
    f = light_flight("label_feedback").records
    np.testing.assert_allclose(f.correction_weight, 1.0)
    # what F predicts is what labels say, carried ahead along its rate
    ahead = float(experiment.make_experiment(light.settings(), "label_feedback").controller.predictor.lead_time)
    rate = np.diff(f.innovation_L, axis=0) / float(f.t[1])
    np.testing.assert_allclose(f.f_L_hat[1:], f.innovation_L[1:] + ahead * rate, atol=1e-9)


# Before the flights ---------------------------------------------------------------------------------------------------


def test_a_team_that_cannot_carry_its_weight_is_refused_before():
    """Agents of 1.84 kg with half of 1.5 kg each, a clamp of 1.2 N, and rotors that give 1.5 N less than asked."""
    weight = 9.81 * (2 * 1.84 + 1.5)
    with pytest.raises(ScenarioError, match="cannot hover") as refused:
        experiment.make_experiments(paper.lighter(weight / 4), ("C1",))
    said = str(refused.value)
    assert "front needs 28.35 N of 12.7 N, rear needs 27.88 N of 12.7 N" in said
    need = float(said.rpartition("need ")[2].split()[0])
    assert weight + 1.2 < need < weight + 1.2 + 1.5 + 1.55 + 3
    with pytest.raises(ScenarioError) as refused:
        experiment.make_experiments(paper.lighter(28.0), ("C1",))
    assert "front needs" in str(refused.value)
    assert "rear needs" not in str(refused.value)


def test_the_study_s_flights_stay_far_from_every_limit():
    limits = paper.SETTINGS.termination
    for case in ("C1", "C2", "C3"):
        rows = paper.flight(case).records
        assert not paper.flight(case).termination_reason
        assert rows.innovation_L is None  # of labels these make nothing until an update
        assert np.linalg.norm(rows.e_p, axis=1).max() < limits.max_position_error_m / 4
        assert rows.Psi.max() < (1 - np.cos(np.deg2rad(limits.max_attitude_error_deg))) / 4
        assert rows.R[:, :, 2, 2].min() > np.cos(np.deg2rad(limits.max_tilt_deg / 2))
        assert (
            rows.min_delassus_singular_value.min()
            > 10 * limits.min_grasp_ratio * rows.min_delassus_singular_value[0].max()
        )
        assert rows.thrust_saturated.sum(0).max() * 0.002 < limits.max_saturation_time_s / 4


# The paper's figures --------------------------------------------------------------------------------------------------


def test_figure_1_errors_fall_from_c1_to_c2_to_c3(found: dict[str, dict]):
    for key in ("e_p_rms_m", "Psi_mean"):
        assert found["C1"][key] > found["C2"][key] > found["C3"][key]


def test_figure_2_the_mismatch_falls_with_payload_learning(found: dict[str, dict]):
    """Figure 2 the mismatch falls with payload learning and again with agent learning."""
    assert found["C1"]["delta_W_rms"] > found["C2"]["delta_W_rms"] > found["C3"]["delta_W_rms"]


def test_figure_3_deviations_fall_where_there_is_learning(found: dict[str, dict]):
    """Figure 3 deviations fall where there is learning and only there."""
    assert found["C2"]["sigma_L_mean"] < found["C1"]["sigma_L_mean"]
    assert found["C3"]["sigma_L_mean"] < found["C1"]["sigma_L_mean"]
    assert found["C2"]["sigma_A_mean"] == pytest.approx(found["C1"]["sigma_A_mean"], rel=1e-12)
    assert found["C3"]["sigma_A_mean"] < found["C1"]["sigma_A_mean"]


def test_figure_5_radii_hold_the_true_errors_and_fall(found: dict[str, dict]):
    """Figure 5 radii hold the true errors and fall where there is learning."""
    stated, learning = paper.plan("C1").bound_assumptions, paper.SETTINGS.learning
    before = stated.rkhs_norm * np.repeat([learning.payload.force_std_N, learning.payload.moment_std_Nm], 3)
    for case in ("C1", "C2", "C3"):
        bodies = [found[case]["bound"]["payload"], *found[case]["bound"]["agents"]]
        assert [body["exceeded_share"]["plain"] for body in bodies] == [0, 0, 0]
        sigma = paper.flight(case).uncertainty
        np.testing.assert_allclose(sigma.payload_radius[sigma.t < 2], np.tile(before, (100, 1)), rtol=1e-12)
        learned = [case != "C1", case == "C3", case == "C3"]
        for body, does in zip(bodies, learned, strict=True):
            beta = np.array(body["beta"])
            assert (beta <= 2**0.5 * stated.rkhs_norm).all()
            assert (beta == stated.rkhs_norm).all() != does
            assert not does or body["tightness_median"] < 20
    c1, c3 = (np.linalg.norm(paper.flight(case).uncertainty.payload_radius[-100:, :3], axis=1) for case in ("C1", "C3"))
    assert c3.max() < 0.6 * c1.min()


def test_figure_5_radii_are_those_of_the_bands_at_the_true():
    """Figure 5 radii are those of the bands at the true states."""
    flight = paper.flight("C3")
    rows, sigma = flight.records, flight.uncertainty
    late = np.flatnonzero(sigma.t > 6.0)[::40]
    at = [int(np.argmin(np.abs(rows.t - t))) for t in sigma.t[late]]
    x = np.concatenate([rows.p, rows.v, rows.R_L.reshape(-1, 9), rows.omega_L, np.zeros((len(rows.t), 6))], axis=1)[at]
    radius = confidence_bounds.payload_radius(flight.model, flight.bands, jnp.asarray(x))
    np.testing.assert_allclose(sigma.payload_radius[late], radius, rtol=1e-9)
    assert len(late) > 3


@pytest.mark.long
def test_figure_4_internal_forces_reshape_contact_forces(found: dict[str, dict]):
    """Figure 4 internal forces reshape contact forces and leave the motion."""
    for case in ("C1", "C2", "C3"):
        with_eta, without = paper.flight(case).records, paper.flight(case, eta=False).records
        assert np.linalg.norm(with_eta.eta, axis=1).max() >= 1
        assert np.abs(with_eta.lam - without.lam).max(axis=(1, 2))[2500:3000].min() >= 0.5
        assert paper.rms(with_eta.e_p - without.e_p) < 0.05 * paper.rms(without.e_p)
        assert found[case]["contact_force_hf_rms_N"] <= 0.2


def test_lemma_2_and_the_interface_identity_hold_in_flight(found: dict[str, dict]):
    nominal = paper.plan("C1").controller.team
    for case in ("C1", "C2", "C3"):
        assert found[case]["wrench_consistency_max"] <= 1e-9
        assert found[case]["interface_identity_max"] <= 1e-9
    assert metrics.wrench_consistency_error(paper.flight("C1", eta=False).records, nominal) <= 1e-9


def test_proposition_1_the_grasp_is_invariant_in_flight(found: dict[str, dict]):
    for case in ("C1", "C2", "C3"):
        assert found[case]["Phi_max_m"] <= 1e-10
        assert found[case]["Phi_dot_max"] <= 1e-10


def test_the_same_plan_flies_the_same_flight():
    plan = paper.plan("C1")
    a, b = paper.fly(plan, 1.0), paper.fly(plan, 1.0)
    assert all(jax.tree.leaves(jax.tree.map(np.array_equal, a.records, b.records)))
