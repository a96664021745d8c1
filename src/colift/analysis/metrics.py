"""Performance metrics of a simulated flight: tracking errors, contact forces, coverage and error bounds."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

from colift.closed_loop import linearization, log
from colift.closed_loop.flight import FlightResult
from colift.closed_loop.signals import StepRecord
from colift.models import grasp
from colift.models.parameters import Team

HIGH_FREQUENCY_HZ = 20.0  # contact forces above it do not move the payload noticeably
MAX_CONSTRAINT_RATE = 1e-9  # m/s, `|Phi_dot|` after a step; larger values indicate that the step is too long


Samples = np.ndarray | jax.Array  # samples with time as the first axis


def rms_norm(x: Samples) -> float:
    """Compute the root mean square over time of the Euclidean norm of each sample (all axes but the first)."""
    return float(np.sqrt((x.reshape(len(x), -1) ** 2).sum(1).mean()))


def second_half(rows: StepRecord) -> StepRecord:
    """Return the records of the second half of the flight."""
    return jax.tree.map(lambda x: x[len(rows.t) // 2 :], rows)


def summary(flight: FlightResult, truth: Team, nominal: Team) -> dict[str, Any]:
    """Compute the entries of one case in `summary.json`, except computation times.

    RMS values and means are over the second half of the flight. Norms of wrenches and of sigma are given in three
    forms: force part, moment part, and the total norm of the paper, which adds newtons and newton meters. Names end
    with the unit; a name without unit belongs to a dimensionless value, or to one that mixes newtons and newton meters.
    Metrics of contact forces are None if the records omit `lam` or `lam_cmd`.

    Args:
        flight: Result of the flight.
        truth: True parameters.
        nominal: Nominal parameters of the controller.

    Returns:
        Values by name, ready for JSON.
    """
    rows, half = flight.records, second_half(flight.records)
    out: dict[str, Any] = {
        "complete": not flight.termination_reason,
        "termination_reason": flight.termination_reason,
        "e_p_rms_m": rms_norm(half.e_p),
        "e_v_rms_mps": rms_norm(half.e_v),
        "e_R_rms": rms_norm(half.e_R),
        "e_omega_rms_radps": rms_norm(half.e_omega),
        "Psi_mean": float(half.Psi.mean()),
        "delta_W_rms": rms_norm(half.delta_W),
        "delta_W_force_rms_N": rms_norm(half.delta_W[:, :3]),
        "delta_W_moment_rms_Nm": rms_norm(half.delta_W[:, 3:]),
        **_sigma(flight),
        **_contact_forces(rows, half, nominal),
        "thrust_min_N": float(half.u.min()),
        "thrust_max_N": float(half.u.max()),
        "Phi_max_m": float(rows.Phi.max()),
        "Phi_dot_max_mps": float(rows.Phi_dot.max()),
        "eta_max_N": float(np.linalg.norm(rows.eta, axis=1).max(initial=0.0)),
        "saturated_ticks": int(rows.thrust_saturated.any(1).sum()),
        "min_delassus_singular_value_1pkg": float(rows.min_delassus_singular_value.min()),
        "num_samples": flight.updates[-1].num_samples if flight.updates else {"payload": 0, "agents": 0},
        "update_times_s": [update.t for update in flight.updates],
        "warnings": [text for text in (warn_step_size(rows), *flight.learning_warnings) if text],
        "correlation": correlations(flight),
        "miscoverage": miscoverage(flight),
        "error_bound": bound_statistics(flight),
        "residual": residual_statistics(half, truth, nominal),
    }
    return out


def _contact_forces(rows: StepRecord, half: StepRecord, nominal: Team) -> dict[str, float | None]:
    """Compute the metrics of the contact forces; None for those whose records are omitted."""
    has_true, has_commanded = (getattr(rows, name) is not None for name in ("lam", "lam_cmd"))
    both = has_true and has_commanded
    return {
        "e_lam_rms_N": rms_norm(half.lam - half.lam_cmd) if both else None,
        "lam_max_N": float(np.linalg.norm(half.lam, axis=2).max()) if has_true else None,
        "contact_force_hf_rms_N": high_frequency_rms(half) if has_true else None,
        "wrench_consistency_max": wrench_consistency_error(rows, nominal) if has_commanded else None,
        "interface_identity_max": interface_identity_error(rows, nominal) if both else None,
    }


def warn_step_size(rows: StepRecord) -> str:
    """Return a warning if the constraint rate `|Phi_dot|` indicates that the time step is too long.

    After a step the rate is of second order in the correction of the projection.

    Args:
        rows: Records of the flight.

    Returns:
        A sentence, or an empty string.
    """
    exceeded = np.flatnonzero(rows.Phi_dot > MAX_CONSTRAINT_RATE)
    if not len(exceeded):
        return ""
    worst = int(np.nanargmax(rows.Phi_dot))
    return (
        f"the time step is too long for the motion: from t = {rows.t[exceeded[0]]:.3f} s on, the contact "
        f"velocity error is up to {rows.Phi_dot[worst]:.3g} m/s, at t = {rows.t[worst]:.3f} s "
        f"(at most {MAX_CONSTRAINT_RATE:g} allowed); raise control_Hz"
    )


def high_frequency_rms(rows: StepRecord) -> float:
    """Compute the RMS of the contact forces above 20 Hz, largest over the components.

    The filter is a fourth-order Butterworth high-pass, forward and backward.

    Args:
        rows: Records of the flight.

    Returns:
        The RMS [N]; NaN for fewer than 100 records, for example after an early termination.
    """
    if len(rows.t) < 100:
        return float("nan")
    rate = 1 / float(np.diff(rows.t[:2])[0])
    lam = rows.lam.reshape(len(rows.lam), -1)
    from scipy.signal import butter, sosfiltfilt  # here, because it takes long to import

    high = butter(4, HIGH_FREQUENCY_HZ, "high", fs=rate, output="sos")
    return float(np.sqrt((sosfiltfilt(high, lam - lam.mean(0), axis=0) ** 2).mean(0)).max())


def _wrenches(rows: StepRecord, nominal: Team, lam: Samples) -> np.ndarray:
    """Compute the payload wrenches of contact forces at the estimated attitude, as `grasp.payload_wrench`."""
    c, lam = np.asarray(grasp.contact_points(nominal)), np.asarray(lam)
    moments = np.cross(c, lam @ np.asarray(rows.R_L_hat)).sum(1)
    return np.concatenate([lam.sum(1), moments], axis=1)


def wrench_consistency_error(rows: StepRecord, nominal: Team) -> float:
    """Compute the largest `|G lam_cmd - W_d|` [N, N m] (Lemma wrench_consistency).

    The grasp matrix G is evaluated at the attitude that the allocator used.

    Args:
        rows: Records of the flight.
        nominal: Nominal parameters of the controller.

    Returns:
        The largest norm over the flight.
    """
    return float(np.linalg.norm(_wrenches(rows, nominal, rows.lam_cmd) - rows.W_d, axis=1).max())


def interface_identity_error(rows: StepRecord, nominal: Team) -> float:
    """Compute the largest `|delta_W - G e_lam|` [N, N m], with G at the attitude that the allocator used."""
    return float(np.linalg.norm(_wrenches(rows, nominal, rows.lam - rows.lam_cmd) - rows.delta_W, axis=1).max())


def _sigma(flight: FlightResult) -> dict[str, float]:
    """Compute means of `sigma_L` and `sigma_A`, Frobenius norms of `Sigma^(1/2)` (Section V), over the second half."""
    half = _half(flight)
    units = {"": "", "_force": "_N", "_moment": "_Nm"}
    norms = log.uncertainty_norms(flight.uncertainty)
    return {
        f"sigma_{body}{part}_mean{unit}": float(norms[f"sigma_{body}{part}"][half].mean())
        for part, unit in units.items()
        for body in "LA"
    }


def correlations(flight: FlightResult) -> dict[str, dict[str, float | None]]:
    """Compute Pearson correlations of sigma_L with `|e_p|` and of sigma_A with `|delta_W|`.

    They are computed over the flight, after the first update, and over the second half. Both values fall at the first
    update, so that the correlation over the whole flight is not informative.

    Args:
        flight: Result of the flight.

    Returns:
        Correlations by pair and interval; None if one of the signals is constant.
    """
    rows, sigma, indices = (
        flight.records,
        flight.uncertainty,
        log.uncertainty_indices(flight.records, flight.uncertainty),
    )
    first = flight.updates[0].activation_time if flight.updates else np.inf
    intervals = {"run": sigma.t >= 0, "after_first_update": sigma.t >= first, "second_half": _half(flight)}
    norms = log.uncertainty_norms(sigma)
    pairs = {
        "sigma_L_e_p": (norms["sigma_L"], np.linalg.norm(rows.e_p[indices], axis=1)),
        "sigma_A_delta_W": (norms["sigma_A"], np.linalg.norm(rows.delta_W[indices], axis=1)),
    }
    return {
        name: {interval: _correlation(a[selected], b[selected]) for interval, selected in intervals.items()}
        for name, (a, b) in pairs.items()
    }


def _correlation(a: np.ndarray, b: np.ndarray) -> float | None:
    """Return the Pearson correlation, or None if one signal is constant."""
    is_constant = len(a) < 2 or np.ptp(a) <= 1e-9 * np.abs(a).max() or np.ptp(b) == 0
    return None if is_constant else float(np.corrcoef(a, b)[0, 1])


def _half(flight: FlightResult) -> np.ndarray:
    """Select the uncertainty samples of the second half; the last one if the flight ended before."""
    return flight.uncertainty.t >= min(flight.records.t[len(flight.records.t) // 2], flight.uncertainty.t[-1])


def miscoverage(flight: FlightResult) -> dict[str, Any]:
    """Compute the fraction of samples outside the 95 % prediction interval over the second half.

    The nominal `rate` is 5 %. `normalized_error_rms` is the RMS of the error divided by its predictive standard
    deviation: 1 if the standard deviations are correct, below 1 if they are conservative.

    Args:
        flight: Result of the flight.

    Returns:
        Both values for the six outputs of the payload and for `f_x` of each agent.
    """
    rows, indices, half = flight.records, log.uncertainty_indices(flight.records, flight.uncertainty), _half(flight)
    result = {}
    errors = (rows.f_L - rows.f_L_hat)[indices], (rows.f_x - rows.f_x_hat)[indices]
    std = log.predictive_std(rows, flight.uncertainty)
    for body, error, std_body in zip(("payload", "agents"), errors, std, strict=True):
        normalized = np.abs(error[half]) / std_body[half]
        result[body] = {
            "rate": (normalized > 1.96).mean(0).tolist(),
            "normalized_error_rms": np.sqrt((normalized**2).mean(0)).tolist(),
        }
    return result


def bound_statistics(flight: FlightResult) -> dict[str, Any]:
    """Compare the error bounds along the flight with the true errors `f - f_hat` of payload and agents.

    `violation_rate` is the fraction of samples whose error exceeds the bound, for the total norm, its force part, its
    moment part and any single output. `bound_over_error_median` is the median of `rho_bar / |f - f_hat|` over the
    second half; it is infinite if data contradict the assumptions of the bound. `beta` belongs to the last update.

    Args:
        flight: Result of the flight.

    Returns:
        The statistics of the payload and of each agent.
    """
    rows, indices, sigma = (
        flight.records,
        log.uncertainty_indices(flight.records, flight.uncertainty),
        flight.uncertainty,
    )
    half = _half(flight)
    joints = [group.shape[2] - 6 for group in sigma.agent_std for _ in range(group.shape[1])]
    residual_errors = [
        np.asarray(getattr(rows, name) - getattr(rows, f"{name}_hat"))[indices]
        for name in linearization.RESIDUAL_SIGNALS
    ]
    errors = linearization.group_by_body(joints, *residual_errors)
    radii = [sigma.payload_radius, *(group[:, j] for group in sigma.agent_radius for j in range(group.shape[1]))]
    bands = flight.bands
    betas = [bands.payload_beta, *(beta for group in bands.agent_beta for beta in group)]
    statistics = [
        _bounded(error, radius, half) | {"beta": np.asarray(beta).tolist()}
        for error, radius, beta in zip(errors, radii, betas, strict=True)
    ]
    return {"payload": statistics[0], "agents": statistics[1:]}


def _bounded(error: np.ndarray, radius: np.ndarray, half: np.ndarray) -> dict[str, Any]:
    """Compute the bound statistics of one body, with all its outputs as columns."""
    norm = lambda x: np.linalg.norm(x, axis=1)  # noqa: E731
    exceeded = {
        "total": norm(error) > norm(radius),
        "force": norm(error[:, :3]) > norm(radius[:, :3]),
        "moment": norm(error[:, 3:]) > norm(radius[:, 3:]),
        "any_output": (np.abs(error) > radius).any(1),
    }
    with np.errstate(divide="ignore"):  # the error of an exact residual is zero
        tightness = norm(radius[half]) / norm(error[half])
    return {
        "violation_rate": {part: float(mask.mean()) for part, mask in exceeded.items()},
        "bound_over_error_median": float(np.median(tightness)),
    }


def residual_statistics(rows: StepRecord, truth: Team, nominal: Team) -> dict[str, Any]:
    """Compute constant and varying parts of the residuals.

    `state_dependent_std` is the standard deviation of each payload channel without the effect of mass and inertia
    errors, which is computed from the true parameters. `mean_power_fraction` is the fraction of a channel's power in
    its mean.

    Args:
        rows: Records of the flight.
        truth: True parameters.
        nominal: Nominal parameters of the controller.

    Returns:
        The statistics of the payload and of the agents.
    """
    m = float(nominal.payload.mass - truth.payload.mass)
    J = np.asarray(nominal.payload.inertia - truth.payload.inertia)
    a, w = np.asarray(rows.a_L), np.asarray(rows.omega_L)
    force = m * (a[:, :3] - np.asarray(nominal.gravity))
    moment = a[:, 3:] @ J + np.cross(w, w @ J)
    remainder = rows.f_L - np.concatenate([force, moment], axis=1)
    return {
        "payload": _share(rows.f_L) | {"state_dependent_std": (remainder - remainder.mean(0)).std(0).tolist()},
        "agents_force": _share(rows.f_x.reshape(len(rows.t), -1)),
        "agents_moment": _share(rows.f_w.reshape(len(rows.t), -1)),
    }


def _share(f: Samples) -> dict[str, list[float]]:
    """Compute mean, standard deviation and fraction of the power in the mean, by channel."""
    mean, rms = f.mean(0), f.std(0)
    power = np.maximum(mean**2 + rms**2, np.finfo(float).tiny)
    return {"mean": mean.tolist(), "std": rms.tolist(), "mean_power_fraction": (mean**2 / power).tolist()}
