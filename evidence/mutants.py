"""Mutation tests of control, estimation, learning and certificates: each mutant must fail a test.

A mutant is a copy of the project with one wrong expression. The tests that `keyword` selects run first. If they pass,
all tests of the listed modules run. The result contains the first test that fails, or that none does.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any, NamedTuple

from evidence import ROOT, collect

RUNS = ("src", "tests")  # folders that the copy requires


class Mutant(NamedTuple):
    """Replacement of one expression in a source file, with the tests that must fail."""

    file: str  # relative to src/colift
    original: str  # text that occurs once in the file
    replacement: str
    test_modules: str  # paths relative to tests, without suffix, separated by spaces
    keyword: str = ""  # beginning of the name of the test that runs first, or several joined by ` or `


MUTANTS = {
    # payload controller
    "jerk: sign of K_v (a - a_d)": Mutant(
        "onboard/control/tracking.py",
        "- gains.jerk_feedback * (gains.K_v",
        "+ gains.jerk_feedback * (gains.K_v",
        "unit/onboard/test_control",
        "test_the_jerk_is_the_rate",
    ),
    "jerk: sign of K_p e_v": Mutant(
        "onboard/control/tracking.py",
        "jerk=setpoint.j - gains.K_p @ e_v",
        "jerk=setpoint.j + gains.K_p @ e_v",
        "unit/onboard/test_control",
        "test_the_jerk_is_the_rate",
    ),
    "jerk: j_d omitted": Mutant(
        "onboard/control/tracking.py",
        "jerk=setpoint.j - gains",
        "jerk=-gains",
        "unit/onboard/test_control",
        "test_the_jerk_is_the_rate",
    ),
    "alpha_cmd: sign of omega_d_dot": Mutant(
        "onboard/control/tracking.py",
        "- to_body @ setpoint.omega_dot",
        "+ to_body @ setpoint.omega_dot",
        "unit/onboard/test_control",
        "test_commanded_acceleration_gives_the_error_dynamics",
    ),
    "alpha_cmd: sign of the feedforward": Mutant(
        "onboard/control/tracking.py",
        "alpha=-feedback - feedforward",
        "alpha=-feedback + feedforward",
        "unit/onboard/test_control",
        "test_commanded_acceleration_gives_the_error_dynamics",
    ),
    "Euler equation: sign of w x J w": Mutant(
        "models/inverse_dynamics.py",
        "matvec(J, alpha) + so3.cross",
        "matvec(J, alpha) - so3.cross",
        "unit/onboard/test_control",
        "test_desired_wrench_gives_the_commanded_acceleration",
    ),
    "integral action: sign": Mutant(
        "onboard/control/payload_controllers.py",
        "previous + context.clock.dt * rate",
        "previous - context.clock.dt * rate",
        "unit/onboard/test_controller",
        "test_integral_action_sums_the_errors",
    ),
    # agent controllers and allocation
    "thrust direction: f_hat_x omitted": Mutant(
        "onboard/control/attitude.py",
        "+ lam.sum(0) - f_x",
        "+ lam.sum(0)",
        "unit/onboard/test_control",
        "test_agents_follow_the_attitude_law",
    ),
    "attitude rate: rate of lam omitted": Mutant(
        "onboard/control/attitude.py",
        "jerk + setpoint.lam_dot.sum(0)",
        "jerk",
        "unit/onboard/test_control",
        "test_agents_follow_the_attitude_law",
    ),
    "body torque: f_hat_w omitted": Mutant(
        "onboard/control/realization.py",
        "tau=Q[:3] - f_hat.f_w",
        "tau=Q[:3]",
        "unit/onboard/test_control",
        "test_aligned_thrust_realizes_forces_and_motion",
    ),
    "posture control: half the damping": Mutant(
        "onboard/control/redundancy.py",
        "* e - 2 * POSTURE_DAMPING * k * e_dot",
        "* e - POSTURE_DAMPING * k * e_dot",
        "unit/onboard/test_control",
        "test_posture_tilt_accelerates_the_center_of_mass",
    ),
    "contact acceleration: sign of w x (w x c)": Mutant(
        "onboard/control/tracking.py",
        "rotational = so3.cross(acceleration_cmd.alpha[None], c) + so3.cross",
        "rotational = so3.cross(acceleration_cmd.alpha[None], c) - so3.cross",
        "unit/onboard/test_control",
        "test_aligned_thrust_realizes_forces_and_motion",
    ),
    "rate of lam: zero": Mutant(
        "onboard/control/tracking.py",
        "F_dot = payload.mass * acceleration_cmd.jerk",
        "F_dot = payload.mass * 0.0 * acceleration_cmd.jerk",
        "unit/onboard/test_controller",
        "test_attitude_feedforward_uses_the_force_rate",
    ),
    "rate of lam: constant offset included": Mutant(
        "onboard/control/allocators.py",
        "offset=jnp.zeros_like(self.allocation.offset)",
        "offset=self.allocation.offset",
        "unit/onboard/test_controller",
        "test_attitude_feedforward_uses_the_force_rate",
    ),
    "label loop gain: joint filter without lag": Mutant(
        "onboard/control/label_feedback.py",
        "(1 - _low_pass(s, filters.joint) ** 2)",
        "1",
        "unit/onboard/test_label_feedback",
    ),
    # state estimation
    "agent inputs: label filter omitted": Mutant(
        "onboard/estimation/state_estimator.py",
        "inputs=_filter_label(state.inputs, balance.x, b, initialized)",
        "inputs=steady_state(balance.x)",
        "unit/onboard/test_state_estimator",
        "test_model_inputs_have_the_delay_of_labels",
    ),
    "payload inputs: label filter omitted": Mutant(
        "onboard/estimation/state_estimator.py",
        "_filter_label(state.inputs, inputs, b, ",
        "_filter_label(state.inputs, inputs, 0.0 * b + 1.0, ",
        "unit/onboard/test_state_estimator",
        "test_model_inputs_have_the_delay_of_labels",
    ),
    "joint positions: rates omitted": Mutant(
        "onboard/estimation/state_estimator.py",
        "predicted = state.r + dt * state.r_dot",
        "predicted = state.r",
        "unit/onboard/test_state_estimator",
        "test_joint_estimates",
    ),
    "joint rates: encoders instead of the grasp": Mutant(
        "onboard/estimation/state_estimator.py",
        "return encoder_rate + _rate_gain(B) @ ",
        "return encoder_rate + 0.0 * _rate_gain(B) @ ",
        "unit/onboard/test_joint_rates",
        "test_",
    ),
    "torques: contact force deficit omitted": Mutant(
        "onboard/control/agent_controllers.py",
        "acceleration_cmd, setpoint, f, desired, deficit",
        "acceleration_cmd, setpoint, f, desired, 0.0 * deficit",
        "unit/onboard/test_contact_force_deficits",
        "test_static_torque",
    ),
    "thrust direction: rotation of the payload omitted": Mutant(
        "onboard/control/tracking.py",
        "return acceleration_cmd.a[None] + rotational @ q.R.T",
        "return acceleration_cmd.a[None] + 0.0 * rotational @ q.R.T",
        "integration/test_yaw_of_shipped_teams",
        "test_agents_on",
    ),
    "accelerometer: gravity omitted": Mutant(
        "onboard/estimation/nav_filter.py",
        "nav.R @ specific_force + gravity",
        "nav.R @ specific_force",
        "unit/onboard/test_state_estimator",
        "test_poses_are_propagated_by_accelerometers",
    ),
    "position prediction: dt^2 / 2 omitted": Mutant(
        "onboard/estimation/nav_filter.py",
        "nav.v * dt + acceleration * (dt * dt / 2)",
        "nav.v * dt",
        "unit/onboard/test_state_estimator",
        "test_the_complementary_filter_follows",
    ),
    "late position: compared with the present estimate": Mutant(
        "onboard/estimation/nav_filter.py",
        "sampled[1] @ x",
        "x[0]",
        "unit/onboard/test_nav_filter",
        "test_late_readings_leave_no_error",
    ),
    "held readings: used in every control period": Mutant(
        "onboard/estimation/nav_filter.py",
        "clock.is_new * sampled.sum(1)",
        "sampled.sum(1)",
        "unit/onboard/test_nav_filter",
        "test_a_held_reading_corrects_once",
    ),
    "agent label: sign of the momentum drift": Mutant(
        "onboard/estimation/state_estimator.py",
        "momenta_dot - drift",
        "momenta_dot + drift",
        "unit/onboard/test_state_estimator",
        "test_labels_converge_to_the_filtered_true_residual",
    ),
    "agent label: acceleration by joints omitted": Mutant(
        "onboard/estimation/state_estimator.py",
        "specific_force + velocity_offset_dot)",
        "specific_force)",
        "unit/onboard/test_state_estimator",
        "test_labels_converge_to_the_filtered_true_residual",
    ),
    "agent label: sign of the tip moment readings": Mutant(
        "onboard/estimation/state_estimator.py",
        "y=modelled.at[3:].add(load)",
        "y=modelled.at[3:].add(-load)",
        "unit/onboard/test_rigid_assembly",
        "test_a_beam_with_two_vehicles_flies",
    ),
    "payload label: sign of the tip moment readings": Mutant(
        "onboard/estimation/contact_forces.py",
        "label.at[3:].add(-(balance.payload.R.T @ sum(in_world)))",
        "label.at[3:].add(balance.payload.R.T @ sum(in_world))",
        "unit/onboard/test_rigid_assembly",
        "test_a_beam_with_two_vehicles_flies",
    ),
    "payload label: tip force filter omitted": Mutant(
        "onboard/estimation/state_estimator.py",
        "state.initialized, smoothing_factor(filters.tip_force, dt)",
        "0.0 * state.initialized, smoothing_factor(filters.tip_force, dt)",
        "unit/onboard/test_state_estimator",
        "test_modelled_wrench_has_the_tip_force_filter",
    ),
    "joint rates: factor 1 - b omitted": Mutant(
        "onboard/estimation/state_estimator.py",
        "* b / ((1 - b) * dt)",
        "* b / dt",
        "unit/onboard/test_state_estimator",
        "test_encoder_noise or test_joint_estimates",
    ),
    "tip forces: transposed rotation": Mutant(
        "onboard/estimation/state_estimator.py",
        '"bij,bj->bi", tips, lam',
        '"bji,bj->bi", tips, lam',
        "unit/onboard/test_state_estimator",
        "test_first_estimate_without_noise_is_the_true_state",
    ),
    # learning
    "recorder: last sample omitted": Mutant(
        "onboard/learning/recorder.py",
        "(t <= self.end + 1e-9)",
        "(t < self.end - 1e-9)",
        "unit/onboard/test_controller",
        "test_samples_have_their_rate_between_start_and_end",
    ),
    "data set: points beyond the capacity": Mutant(
        "gp/dataset.py",
        "kept = valid & (slot < len(data.X))",
        "kept = valid",
        "unit/onboard/test_residual_model",
        "test_data_are_appended_until_the_buffer_is_full",
    ),
    "fit: warm start omitted": Mutant(
        "onboard/learning/model_update.py",
        "start=before.hyper if before else None",
        "start=None",
        "unit/onboard/test_residual_model",
        "test_second_fit_starts_at_the_first_optimum",
    ),
    "fit: last fits discarded": Mutant(
        "onboard/learning/model_update.py",
        "fits = {**last_fits, **{",
        "fits = {**{",
        "unit/onboard/test_residual_model",
        "test_second_fit_starts_at_the_first_optimum",
    ),
    "identification: prior counted twice": Mutant(
        "onboard/learning/identification.py",
        "A, T) + np.eye(len(prior))",
        "A, T) + 2 * np.eye(len(prior))",
        "unit/onboard/test_residual_model",
        "test_identification",
    ),
    "identification: negative inertia": Mutant(
        "onboard/learning/identification.py",
        "kept + scaled / max(",
        "kept + scaled / min(",
        "unit/onboard/test_residual_model",
        "test_physical_consistency_keeps_a_tenth_of_the_inertia",
    ),
    "changes: parameters do not jump": Mutant(
        "gp/time_variation.py",
        "rate * walk + jumps",
        "rate * walk + 0 * jumps",
        "unit/onboard/test_semiparametric",
        "test_jump_of_constants_and_mass_keeps_the_field",
    ),
    "changes: change point at the first candidate": Mutant(
        "onboard/learning/change_detection.py",
        "best = int(np.argmax(log_factors))",
        "best = 0",
        "unit/onboard/test_online_learner",
        "test_contradicting_labels_are_a_change_point",
    ),
    "regressor: sign of the lever arm": Mutant(
        "onboard/learning/identification.py",
        "-so3.hat(q.R.T @ a)",
        "so3.hat(q.R.T @ a)",
        "unit/onboard/test_residual_model",
        "test_regressor_gives_the_wrench_of_a_point_cloud",
    ),
    "features: speeds in the wrong order": Mutant(
        "onboard/learning/features.py",
        "v, omega = x[..., 3:6], x[..., 15:18]",
        "omega, v = x[..., 3:6], x[..., 15:18]",
        "unit/onboard/test_residual_model",
        "test_features_are_those_of_the_paper",
    ),
    "disturbance observer: first period included": Mutant(
        "onboard/learning/residual_predictors.py",
        "context.initialized * jnp.repeat(",
        "jnp.repeat(",
        "unit/onboard/test_controller",
        "test_observer_filters_the_unexplained_wrench",
    ),
    "label rate: attenuation omitted": Mutant(
        "onboard/learning/residual_predictors.py",
        "jnp.multiply, a[:, None]",
        "jnp.multiply, 1.0",
        "unit/onboard/test_label_feedback",
    ),
    "Kalman filter: differenced label noise omitted": Mutant(
        "onboard/learning/kalman_correction.py",
        "S = H_d - P_dn + P_nn + R + Q",
        "S = H_d - P_dn + P_nn + R",
        "unit/onboard/test_residual_correction",
    ),
    "Kalman filter: variance gained without labels omitted": Mutant(
        "onboard/learning/kalman_correction.py",
        "weight = (self.error_ms + TINY) / (self.error_ms + gained + TINY)",
        "weight = jnp.ones_like(gained)",
        "unit/onboard/test_residual_correction",
    ),
    "contact forces: difference between the arms omitted": Mutant(
        "onboard/estimation/contact_forces.py",
        "return lam + difference - ",
        "return lam + 0 * difference - ",
        "unit/onboard/test_contact_forces",
    ),
    "contact forces: measured ones in place of reconstructed ones": Mutant(
        "onboard/estimation/contact_forces.py",
        "jnp.where(valid > 0, each.measured, reconstructed)",
        "each.measured",
        "unit/onboard/test_contact_forces",
    ),
    "contact forces: payload's equations omitted": Mutant(
        "onboard/estimation/contact_forces.py",
        "rhs + weighted @ payload.y",
        "rhs",
        "unit/onboard/test_residual_prior_estimator",
    ),
    "contact forces: noise omitted": Mutant(
        "onboard/estimation/contact_forces.py",
        "P + P @ jax.scipy.linalg.block_diag(*noise_blocks) @ P",
        "P",
        "unit/onboard/test_residual_prior_estimator",
    ),
    "model update: error not offset": Mutant(
        "onboard/learning/kalman_correction.py",
        "d=state.d - step",
        "d=state.d",
        "unit/onboard/test_residual_correction",
    ),
    # bounds and certificates
    "tube: feedback of the deviation omitted": Mutant(
        "certification/tube.py",
        'direct_term[t] + np.einsum("isj,sj->i", M[t, :, :t], d[:t])',
        "direct_term[t]",
        "unit/certification/test_tube",
    ),
    "tube: width of the ellipsoids omitted": Mutant(
        "certification/tube.py", "np.sqrt(greatest).sum(0)", "0", "unit/certification/test_tube"
    ),
    "tube: gradient of the mean difference omitted": Mutant(
        "certification/tube.py", "np.abs((g[:, None] @ flat)[:, 0])", "0", "unit/certification/test_tube"
    ),
    "ellipsoid: mean instead of sum of label errors": Mutant(
        "gp/ellipsoid.py", "feasible.eps**2 * w.sum(1)", "feasible.eps**2 * w.mean(1)", "unit/gp/test_ellipsoid"
    ),
    "ellipsoid: center omitted": Mutant(
        "gp/ellipsoid.py", "@ self.a[..., None]", "@ (0 * self.a)[..., None]", "unit/gp/test_ellipsoid"
    ),
    "reachability: sign of the shift, lower bound": Mutant(
        "certification/reachability.py",
        "[width + shift, width - shift]",
        "[width + shift, width + shift]",
        "unit/certification/test_reachability",
    ),
    "reachability: shift of the mean omitted": Mutant(
        "certification/reachability.py",
        "return difference + body.beta",
        "return body.beta",
        "unit/certification/test_reachability unit/certification/test_certificate",
    ),
    "reachability: sign of the compensation": Mutant(
        "certification/reachability.py",
        "l1_norm) - sign * center",
        "l1_norm) + sign * center",
        "unit/certification/test_reachability",
    ),
    "linearized trajectory: direct term omitted": Mutant(
        "certification/linearized_trajectory.py",
        "L[t, :, k] = loop.D[k, rows]",
        "L[t, :, k] = 0 * loop.D[k, rows]",
        "unit/certification/test_linearized_trajectory",
    ),
    "linearized trajectory: old model after an update": Mutant(
        "certification/linearized_trajectory.py",
        "if active[k + 1] == active[k]",
        "if True",
        "unit/certification/test_linearized_trajectory",
    ),
    "optimal recovery: cost of label errors omitted": Mutant(
        "gp/optimal_recovery.py",
        "feasible.r @ nu + feasible.eps * size",
        "feasible.r @ nu",
        "unit/gp/test_error_bounds unit/certification/test_reachability",
    ),
    "peak gain: remainder of the quadrature omitted": Mutant(
        "certification/peak_gain.py",
        "h**3 / 12 * curvature.sum()",
        "0 * curvature.sum()",
        "unit/certification/test_translation_bound",
    ),
    "assumptions: periodicity omitted": Mutant(
        "certification/assumptions.py",
        "[] if full_period else [PERIODICITY]",
        "[]",
        "unit/certification/test_assumptions",
    ),
}


def run(name: str) -> dict[str, Any]:
    """Return the test that detects a mutant, if any."""
    mutant = MUTANTS[name]
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "colift"
        shutil.copytree(
            ROOT, copy, ignore=shutil.ignore_patterns(".*", "out", "build", "dist", "__pycache__", "_build")
        )
        path = copy / "src" / "colift" / mutant.file
        path.write_text(path.read_text().replace(mutant.original, mutant.replacement))
        modules = [f"tests/{module}.py" for module in mutant.test_modules.split()]
        for chosen in ([["-k", mutant.keyword]] if mutant.keyword else []) + [[]]:
            done = subprocess.run(
                [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", "-m", "", *modules, *chosen],
                cwd=copy,
                env=os.environ | {"PYTHONPATH": str(copy / "src")},
                capture_output=True,
                text=True,
                check=False,
            )
            if done.returncode == 1:
                (by,) = re.findall(r"^(?:FAILED|ERROR) (\S+?)(?:\[.*)?(?: - .*)?$", done.stdout, re.MULTILINE)[:1]
                return {"survived": False, "killed_by": by}
            if done.returncode not in (0, 5):  # 5: no test is selected
                raise RuntimeError(f"{name}: the tests could not run:\n{done.stdout[-2000:]}{done.stderr[-2000:]}")
    return {"survived": True, "killed_by": None}


def main() -> bool:
    """Print the test that detects each mutant; return whether all are detected."""
    found = collect("mutants", MUTANTS, run)
    for name in MUTANTS:
        print(f"{name:<56} {'NOT DETECTED' if found[name]['survived'] else found[name]['killed_by']}")
    return not any(found[name]["survived"] for name in MUTANTS)


if __name__ == "__main__":
    main()
