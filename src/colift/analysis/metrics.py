"""Figures of merit of a flight."""

from __future__ import annotations

from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from scipy.signal import butter, sosfiltfilt

from colift.closed_loop import linearization, log
from colift.closed_loop.flight import FlightResult
from colift.closed_loop.signals import StepRecord
from colift.models import grasp
from colift.models.parameters import Team
from colift.models.state import PayloadState
from colift.onboard.learning import identification

HIGH_FREQUENCY_HZ = 20.0  # above it, contact forces chatter rather than act
MAX_CONSTRAINT_RATE = (
    1e-9  # m/s, of the grasp after a step: below it is rounding, above it the step is too long for the motion
)


Samples = np.ndarray | jax.Array


def rms_norm(x: Samples) -> float:
    """Root mean square over time of the Euclidean norm of each sample (all axes but the first)."""
    return float(np.sqrt((x.reshape(len(x), -1) ** 2).sum(1).mean()))


def second_half(rows: StepRecord) -> StepRecord:
    """The rows after the middle of the flight."""
    return jax.tree.map(lambda x: x[len(rows.t) // 2 :], rows)


def summary(flight: FlightResult, truth: Team, nominal: Team) -> dict[str, Any]:
    """Everything `summary.json` says of one case but its wall times: RMS and means over the second half of the run.

    Norms of wrenches and of sigma are given as force part, moment part and the paper's plain norm, which adds
    newtons and newton metres.
    """
    rows, half = flight.records, second_half(flight.records)
    out: dict[str, Any] = {
        "complete": not flight.termination_reason,
        "stopped": flight.termination_reason,
        "e_p_rms_m": rms_norm(half.e_p),
        "e_v_rms": rms_norm(half.e_v),
        "e_R_rms": rms_norm(half.e_R),
        "e_omega_rms": rms_norm(half.e_omega),
        "Psi_mean": float(half.Psi.mean()),
        "delta_W_rms": rms_norm(half.delta_W),
        "delta_W_force_rms_N": rms_norm(half.delta_W[:, :3]),
        "delta_W_moment_rms_Nm": rms_norm(half.delta_W[:, 3:]),
        "e_lam_rms_N": rms_norm(half.lam - half.lam_cmd),
        **_sigma(flight),
        "lam_max_N": float(np.linalg.norm(half.lam, axis=2).max()),
        "lam_hf_rms_N": high_frequency_rms(half),
        "thrust_min_N": float(half.u.min()),
        "thrust_max_N": float(half.u.max()),
        "Phi_max_m": float(rows.Phi.max()),
        "Phi_dot_max": float(rows.Phi_dot.max()),
        "wrench_consistency_max": wrench_consistency_error(rows, nominal),
        "interface_identity_max": interface_identity_error(rows, nominal),
        "eta_max_N": float(np.linalg.norm(rows.eta, axis=1).max(initial=0.0)),
        "saturated_ticks": int(rows.thrust_saturated.any(1).sum()),
        "singular_min": float(rows.min_delassus_singular_value.min()),
        "n_data": flight.updates[-1].num_samples if flight.updates else {"payload": 0, "agents": 0},
        "updates": [update.t for update in flight.updates],
        "warnings": [text for text in (warn_step_size(rows), *flight.learning_warnings) if text],
        "correlation": correlations(flight),
        "outside": miscoverage(flight),
        "bound": bound_statistics(flight),
        "residual": residual_statistics(half, truth, nominal),
    }
    return out


def warn_step_size(rows: StepRecord) -> str:
    """A sentence where the grasp's velocity residual `|Phi_dot|` shows that steps are too long for the motion, or none.

    After a step it is of second order in what one projection had to correct.
    """
    over = np.flatnonzero(rows.Phi_dot > MAX_CONSTRAINT_RATE)
    if not len(over):
        return ""
    worst = int(np.nanargmax(rows.Phi_dot))
    return (
        f"the step is too long for the motion: from t = {rows.t[over[0]]:.3f} s tips slide on the payload, by up to "
        f"{rows.Phi_dot[worst]:.3g} m/s at t = {rows.t[worst]:.3f} s ({MAX_CONSTRAINT_RATE:g} allowed); raise control_Hz"
    )


def high_frequency_rms(rows: StepRecord) -> float:
    """RMS of the contact forces above 20 Hz (fourth-order Butterworth, forward and back), worst component, N.

    NaN for rows too few to filter (a flight that stopped early).
    """
    if len(rows.t) < 100:
        return float("nan")
    rate = 1 / float(np.diff(rows.t[:2])[0])
    lam = rows.lam.reshape(len(rows.lam), -1)
    high = butter(4, HIGH_FREQUENCY_HZ, "high", fs=rate, output="sos")
    return float(np.sqrt((sosfiltfilt(high, lam - lam.mean(0), axis=0) ** 2).mean(0)).max())


def _wrenches(rows: StepRecord, nominal: Team, lam: Samples) -> np.ndarray:
    W = jax.vmap(grasp.payload_wrench, in_axes=(None, 0, 0))(
        grasp.contact_points(nominal), jnp.asarray(rows.R_L_hat), jnp.asarray(lam)
    )
    return np.concatenate([W.F, W.tau], axis=1)


def wrench_consistency_error(rows: StepRecord, nominal: Team) -> float:
    """Largest `|G lam_cmd - W_d|`, N and N m, G at the attitude the allocator used (Lemma wrench_consistency)."""
    return float(np.linalg.norm(_wrenches(rows, nominal, rows.lam_cmd) - rows.W_d, axis=1).max())


def interface_identity_error(rows: StepRecord, nominal: Team) -> float:
    """Largest `|delta_W - G e_lam|`, N and N m, G at the attitude the allocator used."""
    return float(np.linalg.norm(_wrenches(rows, nominal, rows.lam - rows.lam_cmd) - rows.delta_W, axis=1).max())


def _sigma(flight: FlightResult) -> dict[str, float]:
    """Means over the second half of `sigma_L` and `sigma_A`, Frobenius norms of `Sigma^(1/2)` (Section V).

    A flight that stopped before its second half holds a sample of them gives its last one.
    """
    half = _half(flight)
    return {
        f"{name}_mean": float(x[half].mean())
        for name, x in log.uncertainty_norms(flight.uncertainty).items()
        if name.startswith("sigma")
    }


def correlations(flight: FlightResult) -> dict[str, dict[str, float | None]]:
    """Pearson correlations of sigma_L with `|e_p|` and of sigma_A with `|delta_W|`; None where one is constant.

    Over the run, after the first update, and over the second half: over the run both fall where something is learned
    first, which says little.
    """
    rows, sigma, at = flight.records, flight.uncertainty, log.uncertainty_indices(flight.records, flight.uncertainty)
    first = flight.updates[0].activation_time if flight.updates else np.inf
    parts = {"run": sigma.t >= 0, "after_first_update": sigma.t >= first, "second_half": _half(flight)}
    norms = log.uncertainty_norms(sigma)
    pairs = {
        "sigma_L_e_p": (norms["sigma_L"], np.linalg.norm(rows.e_p[at], axis=1)),
        "sigma_A_delta_W": (norms["sigma_A"], np.linalg.norm(rows.delta_W[at], axis=1)),
    }
    return {name: {part: _correlation(a[of], b[of]) for part, of in parts.items()} for name, (a, b) in pairs.items()}


def _correlation(a: np.ndarray, b: np.ndarray) -> float | None:
    flat = len(a) < 2 or np.ptp(a) <= 1e-9 * np.abs(a).max() or np.ptp(b) == 0
    return None if flat else float(np.corrcoef(a, b)[0, 1])


def _half(flight: FlightResult) -> np.ndarray:
    """Which of sigma's samples are of the second half; of a flight that ended before, its last one."""
    return flight.uncertainty.t >= min(flight.records.t[len(flight.records.t) // 2], flight.uncertainty.t[-1])


def miscoverage(flight: FlightResult) -> dict[str, Any]:
    """Of the second half, the share of samples whose error exceeds 1.96 `log.predictive` deviations: 5 % if honest.

    Of the payload's six outputs and of each agent's `f_x`. `error_over_deviation`: the RMS of one over the other, 1 if
    deviations are honest, and less if they are too wide.
    """
    rows, at, half = flight.records, log.uncertainty_indices(flight.records, flight.uncertainty), _half(flight)
    found = {}
    errors = (rows.f_L - rows.f_L_hat)[at], (rows.f_x - rows.f_x_hat)[at]
    expected = log.predictive_std(rows, flight.uncertainty)
    for body, error, deviation in zip(("payload", "agents"), errors, expected, strict=True):
        off = np.abs(error[half]) / deviation[half]
        found[body] = {
            "share": (off > 1.96).mean(0).tolist(),
            "error_over_deviation": np.sqrt((off**2).mean(0)).tolist(),
        }
    return found


def bound_statistics(flight: FlightResult) -> dict[str, Any]:
    """How the radii along the run compare with the true errors `f - f_hat`: of the payload, and of each agent.

    `exceeded_share`: of the run's samples, how many lie above, of the plain norm, its force part, its moment part and
    any single output. `tightness_median`: of `rho_bar / |f - f_hat|` over the second half (infinite where data
    contradict what the bound rests on). `beta`: of the last update, by output.
    """
    rows, at, sigma = flight.records, log.uncertainty_indices(flight.records, flight.uncertainty), flight.uncertainty
    half = _half(flight)
    joints = [group.shape[2] - 6 for group in sigma.agent_std for _ in range(group.shape[1])]
    missed = [
        np.asarray(getattr(rows, part) - getattr(rows, f"{part}_hat"))[at] for part in linearization.RESIDUAL_SIGNALS
    ]
    errors = linearization.group_by_body(joints, *missed)
    radii = [sigma.payload_radius, *(group[:, j] for group in sigma.agent_radius for j in range(group.shape[1]))]
    betas = [flight.bands.payload_beta, *(beta for group in flight.bands.agent_beta for beta in group)]
    found = [
        _bounded(error, radius, half) | {"beta": np.asarray(beta).tolist()}
        for error, radius, beta in zip(errors, radii, betas, strict=True)
    ]
    return {"payload": found[0], "agents": found[1:]}


def _bounded(error: np.ndarray, radius: np.ndarray, half: np.ndarray) -> dict[str, Any]:
    """Of one body, all its outputs by column."""
    norm = lambda x: np.linalg.norm(x, axis=1)  # noqa: E731
    over = {
        "plain": norm(error) > norm(radius),
        "force": norm(error[:, :3]) > norm(radius[:, :3]),
        "moment": norm(error[:, 3:]) > norm(radius[:, 3:]),
        "any_output": (np.abs(error) > radius).any(1),
    }
    with np.errstate(divide="ignore"):  # a residual that is known exactly has no error
        tightness = norm(radius[half]) / norm(error[half])
    return {
        "exceeded_share": {part: float(where.mean()) for part, where in over.items()},
        "tightness_median": float(np.median(tightness)),
    }


def residual_statistics(rows: StepRecord, truth: Team, nominal: Team) -> dict[str, Any]:
    """How much of the residuals is constant and how much varies with the state, over the given rows.

    `varying_rms` of the payload is what remains of each channel without its mean and without the mass and inertia
    mismatch (known here from the truth); `constant_share` is the mean's share of each channel's power.
    """

    @jax.vmap
    def inertial(p: jax.Array, v: jax.Array, R: jax.Array, omega: jax.Array, a: jax.Array) -> jax.Array:
        q = PayloadState(p=p, v=v, R=R, omega=omega)
        return identification.inertial_regressor(q, a[:3] - nominal.gravity, a[3:]) @ jnp.asarray(
            parameter_mismatch(truth, nominal)
        )

    sources = rows.f_L - np.asarray(inertial(*map(jnp.asarray, (rows.p, rows.v, rows.R_L, rows.omega_L, rows.a_L))))
    return {
        "payload": _share(rows.f_L) | {"varying_rms": (sources - sources.mean(0)).std(0).tolist()},
        "agents_force": _share(rows.f_x.reshape(len(rows.t), -1)),
        "agents_moment": _share(rows.f_w.reshape(len(rows.t), -1)),
    }


def _share(f: Samples) -> dict[str, list[float]]:
    mean, rms = f.mean(0), f.std(0)
    power = np.maximum(mean**2 + rms**2, np.finfo(float).tiny)
    return {"mean": mean.tolist(), "std": rms.tolist(), "constant_share": (mean**2 / power).tolist()}


def parameter_mismatch(truth: Team, nominal: Team) -> np.ndarray:
    """Nominal less true rigid-body parameters of the payload, in the order of `learn.regressor`."""
    J = np.asarray(nominal.payload.inertia - truth.payload.inertia)
    m = float(nominal.payload.mass - truth.payload.mass)
    return np.array([m, 0, 0, 0, J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]])
