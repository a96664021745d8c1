"""Tests of metrics against independent implementations of their definitions."""

from __future__ import annotations

import copy
import dataclasses

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from colift.analysis import metrics
from colift.closed_loop import log
from colift.closed_loop.flight import FlightResult, ModelInterval
from colift.closed_loop.signals import StepRecord
from colift.models.parameters import Team
from colift.onboard.learning import confidence_bounds
from colift.scenario import team
from tests.support import paper_flights as paper
from tests.support import random_logs as flights

SHAPE = flights.PAPER._replace(time=240)
TRUTH, NOMINAL = team.team(paper.SETTINGS)
CONTACTS = [np.array(c) for agent in paper.SETTINGS.agents for c in agent.contact_positions_m]


def with_rows(rows: StepRecord, **signals: np.ndarray | None) -> StepRecord:
    """Return the log with some signals replaced or omitted, with the shapes that `Row` states."""
    arrays = jax.tree.map(jnp.asarray, signals)
    return jax.tree.map(np.array, dataclasses.replace(jax.tree.map(jnp.asarray, rows), **arrays))


def flight(seed: int, shape: flights.Shape = SHAPE, **rows: np.ndarray) -> FlightResult:
    """Return a random flight with some signals of its log given."""
    rng = np.random.default_rng(seed)
    attitudes = Rotation.random(shape.time, random_state=seed).as_matrix()
    made = with_rows(flights.rows(rng, shape), **({"R_L_hat": attitudes, "R_L": attitudes} | rows))
    beta = [rng.uniform(1, 5, (n, 6 + joints)) for n, joints, _ in shape.groups]
    model = paper.paper_experiment("C1").controller.residual_model
    bands = confidence_bounds.ConfidenceBands(
        bound_posterior=model, payload_beta=jnp.arange(6.0), agent_beta=tuple(jnp.asarray(b) for b in beta)
    )
    return FlightResult(
        records=made,
        uncertainty=flights.sigma(rng, shape),
        updates=(),
        termination_reason="",
        interval=ModelInterval(0, model, bands),
        wall_time={},
    )


def wrench(lam: np.ndarray, R: np.ndarray) -> np.ndarray:
    """Return `(sum lam, sum c x R^T lam)`, computed contact by contact."""
    force, moment = np.zeros(3), np.zeros(3)
    for c, f in zip(CONTACTS, lam, strict=True):
        force += f
        moment += np.cross(c, R.T @ f)
    return np.concatenate([force, moment])


# Metrics --------------------------------------------------------------------------------------------------------------


def test_rms_norm_is_root_mean_square_of_norms():
    x = np.random.default_rng(0).normal(size=(7, 2, 3))
    squares = [sum(v * v for v in sample.flat) for sample in x]
    assert metrics.rms_norm(x) == pytest.approx((sum(squares) / 7) ** 0.5, rel=1e-14)


def test_summary_uses_the_second_half():
    """The summary covers the second half, except quantities that must hold at all times."""
    made = flight(1)
    found = metrics.summary(made, TRUTH, NOMINAL)
    late = slice(120, None)
    rows = made.records
    assert found["e_p_rms_m"] == pytest.approx(np.sqrt((rows.e_p[late] ** 2).sum() / 120), rel=1e-12)
    assert found["Psi_mean"] == pytest.approx(rows.Psi[late].mean(), rel=1e-12)
    assert found["e_lam_rms_N"] == pytest.approx(np.sqrt(((rows.lam - rows.lam_cmd)[late] ** 2).sum() / 120), rel=1e-12)
    force, moment = (np.sqrt((rows.delta_W[late, part] ** 2).sum() / 120) for part in (slice(3), slice(3, None)))
    assert found["delta_W_force_rms_N"] == pytest.approx(force, rel=1e-12)
    assert found["delta_W_moment_rms_Nm"] == pytest.approx(moment, rel=1e-12)
    assert found["delta_W_rms"] == pytest.approx(np.hypot(force, moment), rel=1e-12)
    assert found["lam_max_N"] == pytest.approx(max(np.sqrt((f**2).sum()) for f in rows.lam[late].reshape(-1, 3)))
    assert (found["thrust_min_N"], found["thrust_max_N"]) == (rows.u[late].min(), rows.u[late].max())
    assert (found["Phi_max_m"], found["min_delassus_singular_value_1pkg"]) == (
        rows.Phi.max(),
        rows.min_delassus_singular_value.min(),
    )
    assert found["saturated_ticks"] == sum(bool(tick.any()) for tick in rows.thrust_saturated)
    assert found["num_samples"] == {"payload": 0, "agents": 0}
    sigma = made.uncertainty
    late = sigma.t >= rows.t[120]
    each = [np.linalg.norm(sigma.agent_std[0][late, j], axis=1) for j in range(2)]
    assert found["sigma_A_mean"] == pytest.approx((each[0] + each[1]).mean(), rel=1e-12)
    assert found["sigma_L_force_mean_N"] == pytest.approx(np.linalg.norm(sigma.payload_std[late, :3], axis=1).mean())


@pytest.mark.parametrize(
    ("omitted", "missing"),
    [
        (("lam",), {"e_lam_rms_N", "lam_max_N", "contact_force_hf_rms_N", "interface_identity_max"}),
        (("lam_cmd",), {"e_lam_rms_N", "wrench_consistency_max", "interface_identity_max"}),
        (("lam_hat",), set()),
    ],
)
def test_metrics_without_contact_forces(omitted, missing):
    """Records that omit contact forces have all other metrics, and None for those of the contact forces."""
    complete = flight(11)
    records = copy.copy(complete.records)
    for name in omitted:
        object.__setattr__(records, name, None)
    incomplete = copy.copy(complete)
    object.__setattr__(incomplete, "records", records)
    expected, found = (metrics.summary(each, TRUTH, NOMINAL) for each in (complete, incomplete))
    assert {name for name in expected if found[name] is None and expected[name] is not None} == missing
    assert found["e_p_rms_m"] == expected["e_p_rms_m"]


@pytest.mark.parametrize(("hertz", "share"), [(60.0, 1.0), (100.0, 1.0), (20.0, 0.5), (3.0, 0.0)])
def test_high_frequency_rms_of_a_tone(hertz, share):
    """A tone of 2 N in one component: all of it above the corner, half at the corner (twice -3 dB), none below."""
    shape = SHAPE._replace(time=3000)
    t = shape.period * np.arange(shape.time)
    lam = np.zeros((shape.time, 4, 3))
    lam[:, 2, 1] = 30 + 2 * np.sin(2 * np.pi * hertz * t)
    lam[:, 0, 0] = 5 * np.sin(2 * np.pi * 0.5 * t)
    assert metrics.high_frequency_rms(flight(2, shape, lam=lam).records) == pytest.approx(share * 2 / 2**0.5, abs=0.02)


def test_short_flights_have_no_high_frequency_rms():
    assert np.isnan(metrics.high_frequency_rms(flight(2, SHAPE._replace(time=99)).records))


def test_consistency_errors_detect_one_wrong_step():
    made = flight(3)
    R, lam, lam_cmd = made.records.R_L_hat, made.records.lam, made.records.lam_cmd
    W_d = np.stack([wrench(lam_cmd[k], R[k]) for k in range(SHAPE.time)])
    delta_W = np.stack([wrench(lam[k], R[k]) for k in range(SHAPE.time)]) - W_d
    rows = with_rows(made.records, W_d=W_d, delta_W=delta_W)
    assert metrics.wrench_consistency_error(rows, NOMINAL) < 1e-12
    assert metrics.interface_identity_error(rows, NOMINAL) < 1e-12
    W_d[77] += [0, 0.3, 0, 0, 0, 0.4]
    delta_W[5] += [0.6, 0, 0, 0.8, 0, 0]
    rows = with_rows(made.records, W_d=W_d, delta_W=delta_W)
    assert metrics.wrench_consistency_error(rows, NOMINAL) == pytest.approx(0.5, rel=1e-9)
    assert metrics.interface_identity_error(rows, NOMINAL) == pytest.approx(1.0, rel=1e-9)


def test_correlation_is_pearson_and_none_for_constants():
    """Correlations equal Pearson's; a constant signal has none."""
    made = flight(4)
    at = np.arange(0, SHAPE.time, 5)
    sigma_A = np.linalg.norm(made.uncertainty.agent_std[0], axis=2).sum(1)
    mismatch = np.linalg.norm(made.records.delta_W[at], axis=1)
    centred = [x - x.mean() for x in (sigma_A, mismatch)]
    expected = (centred[0] @ centred[1]) / np.sqrt((centred[0] @ centred[0]) * (centred[1] @ centred[1]))
    found = metrics.correlations(made)["sigma_A_delta_W"]
    assert found["run"] == pytest.approx(expected, rel=1e-9)
    late = slice(len(at) // 2, None)
    assert found["second_half"] == pytest.approx(np.corrcoef(sigma_A[late], mismatch[late])[0, 1], rel=1e-9)
    assert found["after_first_update"] is None, "nothing was learned"
    e_p = np.zeros_like(made.records.e_p)
    e_p[at, 0] = 0.1 + 2 * np.linalg.norm(made.uncertainty.payload_std, axis=1)
    logged = dataclasses.replace(made, records=with_rows(made.records, e_p=e_p))
    assert metrics.correlations(logged)["sigma_L_e_p"]["run"] == pytest.approx(1.0, abs=1e-12)
    flat = dataclasses.replace(made.uncertainty, payload_std=np.ones_like(made.uncertainty.payload_std))
    assert metrics.correlations(dataclasses.replace(made, uncertainty=flat))["sigma_L_e_p"]["run"] is None


# Predictive standard deviations ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("corrected", [False, True])
def test_miscoverage_of_errors_with_stated_std_is_nominal(corrected):
    """Errors with the combined standard deviation of data, data sheets and correction have nominal miscoverage."""
    shape = SHAPE._replace(time=20000)
    made, rng = flight(6, shape), np.random.default_rng(7)
    sigma, at = made.uncertainty, np.arange(0, shape.time, 5)
    n = made.records.f_x.shape[1]
    rows = with_rows(
        made.records,
        correction_std_L=None,
        correction_std_x=None,
        correction_weight_L=None,
        correction_weight_x=None,
        label_valid=None,
    )
    s = np.hypot(sigma.payload_std, sigma.payload_label_bias)
    if corrected:
        w, c = rng.uniform(0, 1, (shape.time, 6)), rng.uniform(0.1, 3, (shape.time, 6))
        none = np.zeros((shape.time, n, 3))
        rows = with_rows(
            rows, correction_weight_L=w, correction_std_L=c, correction_weight_x=none + 1, correction_std_x=none
        )
        s = np.sqrt(c[at] ** 2 + (1 - w[at]) * sigma.payload_std**2 + sigma.payload_label_bias**2)
    f_L = rows.f_L_hat.copy()
    f_L[at] += s * rng.normal(size=s.shape)
    f_x = rows.f_x_hat + 0.5
    logged = dataclasses.replace(made, records=with_rows(rows, f_L=f_L, f_x=f_x))
    found = metrics.miscoverage(logged)
    np.testing.assert_allclose(found["payload"]["rate"], 0.05, atol=0.02)
    np.testing.assert_allclose(found["payload"]["normalized_error_rms"], 1.0, atol=0.05)
    group, label = sigma.agent_std[0][..., :3], sigma.agent_label_bias[0][..., :3]
    half = at >= shape.time // 2
    expected = np.hypot(group, label)[half] < 0.5 / 1.96
    if not corrected:
        np.testing.assert_allclose(found["agents"]["rate"], expected.mean(0), rtol=1e-12)


# Error bounds ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [SHAPE, flights.MIXED._replace(time=200)])
def test_exceeded_share_is_computed_per_body(shape):
    made = flight(5, shape)
    found = metrics.bound_statistics(made)
    ds = log.dataset(made.records, team=shape.team, sigma=made.uncertainty, attrs={}, **shape.names)
    at = np.searchsorted(ds.time, ds.time_sigma)

    def parts(agent: str | None) -> tuple[list, list]:
        if agent is None:
            error = log.stack_parts(ds, "f_L") - log.stack_parts(ds, "f_L_hat")
            return [error[at]], [log.stack_parts(ds, "rho_f_L")]
        joint = log.all_joints(ds, "f_r") - log.all_joints(ds, "f_r_hat")
        own = [name for name in joint.joint.values if name.startswith(f"{agent}/")]
        error = [(ds[f] - ds[f"{f}_hat"])[at].sel(agent=agent) for f in ("f_x", "f_w")]
        radii = [ds[f].sel(agent=agent) for f in ("rho_f_x", "rho_f_w")]
        return [*error, joint[at].sel(joint=own)], [*radii, log.all_joints(ds, "rho_f_r").sel(joint=own)]

    bodies = [None, *ds.agent.values]
    for body, of in zip(bodies, [found["payload"], *found["agents"]], strict=True):
        error, radius = (np.concatenate([x.values for x in part], axis=1) for part in parts(body))
        samples = len(error)
        plain = sum(np.sqrt((error[k] ** 2).sum()) > np.sqrt((radius[k] ** 2).sum()) for k in range(samples))
        each = sum(any(abs(error[k]) > radius[k]) for k in range(samples))
        moment = sum((error[k, 3:] ** 2).sum() > (radius[k, 3:] ** 2).sum() for k in range(samples))
        share = of["violation_rate"]
        assert (share["total"], share["any_output"]) == pytest.approx((plain / samples, each / samples))
        assert share["moment"] == pytest.approx(moment / samples)
        late = ds.time_sigma.values >= ds.time.values[shape.time // 2]
        ratios = np.sqrt((radius**2).sum(1) / (error**2).sum(1))[late]
        assert of["bound_over_error_median"] == pytest.approx(np.median(ratios))
    assert found["payload"]["beta"] == [0, 1, 2, 3, 4, 5]
    assert [len(of["beta"]) for of in found["agents"]] == [
        6 + joints for n, joints, _ in shape.groups for _ in range(n)
    ]


def test_missing_bounds_give_no_exceedance():
    """Without a bound nothing exceeds it, and it has no tightness."""
    made = flight(6)
    sigma = dataclasses.replace(made.uncertainty, payload_radius=np.full_like(made.uncertainty.payload_radius, np.inf))
    found = metrics.bound_statistics(dataclasses.replace(made, uncertainty=sigma))["payload"]
    assert found["violation_rate"] == {"total": 0, "force": 0, "moment": 0, "any_output": 0}
    assert found["bound_over_error_median"] == np.inf


# Residuals ------------------------------------------------------------------------------------------------------------


def with_payload(truth: Team, m: float, J: np.ndarray) -> Team:
    """Return the team with another payload."""
    payload = dataclasses.replace(truth.payload, mass=jnp.asarray(m), inertia=jnp.asarray(J))
    return dataclasses.replace(truth, payload=payload)


def test_residual_statistics_separate_known_parts():
    """A residual of mass and inertia mismatch, a constant, and a sine with known standard deviation."""
    rng = np.random.default_rng(7)
    J = TRUTH.payload.inertia - np.array([[0.01, 0.002, 0], [0.002, 0.03, 0.004], [0, 0.004, 0.02]])
    nominal = with_payload(TRUTH, float(TRUTH.payload.mass) - 0.4, J)
    n = 1000
    a_L, omega = rng.normal(size=(n, 6)), rng.normal(size=(n, 3))
    R = Rotation.random(n, random_state=1).as_matrix()
    dm, dJ = -0.4, np.asarray(J - TRUTH.payload.inertia)
    inertial = np.concatenate(
        [
            dm * (a_L[:, :3] - [0, 0, -9.81]),
            np.stack([dJ @ a[3:] + np.cross(w, dJ @ w) for a, w in zip(a_L, omega, strict=True)]),
        ],
        axis=1,
    )
    phase = 2 * np.pi * np.arange(n) / 50
    sine, constant = np.outer(np.sin(phase), [0.1, 0.2, 0.3, 0.04, 0.05, 0.06]), np.array([1, 0, -2, 0, 0.5, 0])
    f_L = inertial + constant + sine
    rows = flight(7, SHAPE._replace(time=n), f_L=f_L, a_L=a_L, omega_L=omega, R_L=R).records
    found = metrics.residual_statistics(rows, TRUTH, nominal)
    np.testing.assert_allclose(
        found["payload"]["state_dependent_std"], np.array([0.1, 0.2, 0.3, 0.04, 0.05, 0.06]) / 2**0.5
    )
    np.testing.assert_allclose(found["payload"]["mean"], f_L.mean(0), atol=1e-12)
    power = (f_L**2).mean(0)
    np.testing.assert_allclose(found["payload"]["mean_power_fraction"], f_L.mean(0) ** 2 / power, atol=1e-12)
    assert len(found["agents_force"]["mean"]) == 6


# Steps ----------------------------------------------------------------------------------------------------------------


def test_too_long_step_is_reported_with_time_and_size():
    rows = flight(8).records
    fine = np.full(SHAPE.time, 9e-10)
    assert metrics.warn_step_size(with_rows(rows, Phi_dot=fine)) == ""
    fine[[100, 150, 200]] = 2e-9, 3e-7, 4e-8
    warning = metrics.warn_step_size(with_rows(rows, Phi_dot=fine))
    assert "from t = 0.200 s" in warning
    assert "up to 3e-07 m/s, at t = 0.300 s" in warning
    found = metrics.summary(flight(8, Phi_dot=fine), TRUTH, NOMINAL)
    assert found["warnings"] == [warning]
