"""Tests of the paper's closed-loop error equations in simulation; test_study.py has Lemma 2 and Proposition 1."""

from __future__ import annotations

import dataclasses
import functools

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from colift.closed_loop import flight, signals
from colift.math import so3
from colift.trajectories import base
from tests.support import paper_flights as paper


@functools.cache
def flown() -> tuple[flight.Experiment, signals.StepRecord]:
    """Two seconds of C1 with exact sensors, so that the payload controller uses the true errors."""
    experiment = paper.with_exact_sensors(paper.paper_experiment("C1"))
    return experiment, paper.simulate(experiment, 2.0).records


def setpoints(experiment: flight.Experiment, rows: signals.StepRecord) -> base.PayloadSetpoint:
    return jax.vmap(experiment.controller.reference.evaluate)(jnp.asarray(rows.t))


def test_translational_error_equation():
    """Eq. err_ev_learning: `m e_v_dot = -m K_p e_p - m K_v e_v + dF + f~_p`, with both unknowns from the plant."""
    experiment, rows = flown()
    m, gains = float(experiment.controller.team.payload.mass), experiment.controller.payload_controller.gains
    left = m * (rows.a_L[:, :3] - np.asarray(setpoints(experiment, rows).a))
    feedback = -m * (rows.e_p @ np.asarray(gains.K_p) + rows.e_v @ np.asarray(gains.K_v))
    right = feedback + rows.delta_W[:, :3] + (rows.f_L - rows.f_L_hat)[:, :3]
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-9)
    assert np.abs(rows.delta_W[:, :3]).max() > 0.1  # there is a wrench mismatch


def test_rotational_error_equation():
    """Eq. err_eomega_learning: `J e_w_dot = -K_R e_R - K_w e_w + dtau + f~_w`; the desired attitude is constant."""
    experiment, rows = flown()
    J, gains = np.asarray(experiment.controller.team.payload.inertia), experiment.controller.payload_controller.gains
    left = rows.a_L[:, 3:] @ J
    feedback = -(np.asarray(gains.k_R) * rows.e_R + np.asarray(gains.k_omega) * rows.e_omega) @ J
    right = feedback + rows.delta_W[:, 3:] + (rows.f_L - rows.f_L_hat)[:, 3:]
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-9)
    assert np.abs(rows.f_L[:, 3:]).max() > 0.1


def test_rotational_error_equation_about_moving_attitude():
    """Eq. pl_cl_eom with omega_d: `J e_w_dot` is the same, `e_w_dot = w_dot + w x R^T R_d w_d - R^T R_d w_d_dot`."""
    of = paper.with_exact_sensors(paper.paper_experiment("C1"))
    path = dataclasses.replace(
        of.controller.reference, rotation_amplitude=jnp.array([0.15, -0.1, 0.2]), rotation_period=jnp.full(3, 4.0)
    )
    experiment = paper.with_controller(of, reference=path)
    rows = paper.simulate(experiment, 2.0).records
    J, gains, d = (
        np.asarray(experiment.controller.team.payload.inertia),
        experiment.controller.payload_controller.gains,
        setpoints(experiment, rows),
    )
    Q = np.einsum("tji,tjk->tik", rows.R_L, np.asarray(d.R))
    turned, changing = (np.einsum("tij,tj->ti", Q, np.asarray(x)) for x in (d.omega, d.omega_dot))
    assert np.abs(turned).max() > 0.1
    left = (rows.a_L[:, 3:] + np.cross(rows.omega_L, turned) - changing) @ J
    feedback = -(np.asarray(gains.k_R) * rows.e_R + np.asarray(gains.k_omega) * rows.e_omega) @ J
    right = feedback + rows.delta_W[:, 3:] + (rows.f_L - rows.f_L_hat)[:, 3:]
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-9)


def test_attitude_error_kinematics():
    """Eq. pl_cl_eR: `e_R_dot = E e_omega`, against central differences along the flight."""
    experiment, rows = flown()
    dt = rows.t[1] - rows.t[0]
    by_differences = (rows.e_R[2:] - rows.e_R[:-2]) / (2 * dt)
    R_d = jnp.broadcast_to(experiment.controller.reference.R, rows.R_L.shape)
    E = so3.attitude_error_jacobian(jnp.asarray(rows.R_L), R_d)
    by_formula = np.einsum("tij,tj->ti", np.asarray(E), rows.e_omega)[1:-1]
    scale = np.abs(by_formula).max()
    assert np.abs(by_differences - by_formula).max() < 2e-3 * scale  # second order in 2 ms


@pytest.mark.long
@pytest.mark.parametrize("signal", ["e_p", "Psi"])
def test_errors_decay_without_residuals_and_noise(signal: str):
    """Eq. pl_cl_ep, pl_cl_eom: with exact parameters the errors decrease by a factor of five in 4 s."""
    experiment = paper.with_exact_sensors(paper.paper_experiment("true_residual"))
    rows = paper.simulate(experiment, 4.0).records
    size = np.abs(getattr(rows, signal).reshape(len(rows.t), -1)).max(1)
    assert size[-500:].max() < 0.2 * size[0]
