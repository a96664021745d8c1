"""The log of a flight as labelled NetCDF: every signal with its axes, unit, frame and symbol."""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
import re
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import xarray as xr

from colift.closed_loop.signals import StepRecord
from colift.onboard.learning.prediction_uncertainty import PredictionUncertainty
from colift.runtime import atomic_write


class SignalSpec(NamedTuple):
    """What a reader of one variable must know; `dims` come after the time axis."""

    dims: tuple[str, ...]
    units: str
    frame: str
    long_name: str


AXES = ("x", "y", "z")
WRENCH = ("F_x", "F_y", "F_z", "tau_x", "tau_y", "tau_z")
ACCELERATION = ("v_dot_x", "v_dot_y", "v_dot_z", "omega_dot_x", "omega_dot_y", "omega_dot_z")

ROTATION_DIMS = ("axis", "body_axis")
LOAD, AGENT, JOINT, CONTACT, FORCE = ("axis",), ("agent",), ("joint",), ("contact", "axis"), ("wrench",)
AGENT_VECTOR_DIMS = ("agent", "axis")
NEWTON, ANGLE, TORQUE = "N (F), N m (tau)", "rad (prismatic joints: m)", "N m (prismatic joints: N)"
RATE = "rad/s (prismatic joints: m/s)"
WRENCH_FRAMES = "world (F), payload (tau)"

SIGNALS = {
    "p": SignalSpec(LOAD, "m", "world", "payload position p_L"),
    "v": SignalSpec(LOAD, "m/s", "world", "payload velocity v_L"),
    "R_L": SignalSpec(ROTATION_DIMS, "1", "payload to world", "payload attitude R_L"),
    "omega_L": SignalSpec(LOAD, "rad/s", "payload", "payload body rate omega_L"),
    "a_L": SignalSpec(
        ("acceleration",),
        "m/s^2 (v_dot), rad/s^2 (omega_dot)",
        "world (v_dot), payload (omega_dot)",
        "payload acceleration (dv_L/dt, domega_L/dt)",
    ),
    "p_d": SignalSpec(LOAD, "m", "world", "reference position p_L,d"),
    "e_p": SignalSpec(LOAD, "m", "world", "position error e_p = p_L - p_L,d"),
    "e_v": SignalSpec(LOAD, "m/s", "world", "velocity error e_v"),
    "e_R": SignalSpec(LOAD, "1", "payload", "attitude error e_R"),
    "e_omega": SignalSpec(LOAD, "rad/s", "payload", "body-rate error e_omega"),
    "Psi": SignalSpec((), "1", "none", "attitude error function Psi = tr(I - R_d^T R_L)/2"),
    "R": SignalSpec(("agent", *ROTATION_DIMS), "1", "base to world", "base attitude R_j"),
    "x": SignalSpec(AGENT_VECTOR_DIMS, "m", "world", "centre of mass of an agent x_j"),
    "omega": SignalSpec(AGENT_VECTOR_DIMS, "rad/s", "base", "base body rate omega_j"),
    "x_dot": SignalSpec(AGENT_VECTOR_DIMS, "m/s", "world", "velocity of the centre of mass dx_j/dt"),
    "r": SignalSpec(JOINT, ANGLE, "joint", "joint position r"),
    "r_dot": SignalSpec(JOINT, RATE, "joint", "joint rate dr/dt"),
    "u": SignalSpec(AGENT, "N", "along the base's z axis", "thrust u_j, as applied"),
    "tau": SignalSpec(AGENT_VECTOR_DIMS, "N m", "base", "body torque tau_j, as applied"),
    "tau_r": SignalSpec(JOINT, TORQUE, "joint", "joint torque tau_r, as applied"),
    "saturated": SignalSpec(AGENT, "1", "none", "whether the thrust limit was met"),
    "lam": SignalSpec(CONTACT, "N", "world", "contact force on the payload lambda_app"),
    "lam_cmd": SignalSpec(CONTACT, "N", "world", "commanded contact force lambda_cmd"),
    "lam_hat": SignalSpec(CONTACT, "N", "world", "estimated contact force lambda_hat"),
    "R_L_hat": SignalSpec(
        ROTATION_DIMS, "1", "payload to world", "payload attitude as estimated, at which G allocates"
    ),
    "W_d": SignalSpec(FORCE, NEWTON, WRENCH_FRAMES, "desired payload wrench W_d"),
    "delta_W": SignalSpec(FORCE, NEWTON, WRENCH_FRAMES, "wrench mismatch Delta W = G lambda_app - W_d"),
    "eta": SignalSpec(("eta_index",), "N", "coordinates in the kernel of G", "internal-force input eta"),
    "f_L": SignalSpec(FORCE, NEWTON, WRENCH_FRAMES, "payload residual of the nominal model f_uk,L, exact"),
    "f_L_hat": SignalSpec(FORCE, NEWTON, WRENCH_FRAMES, "payload residual f_uk,L, predicted"),
    "f_x": SignalSpec(AGENT_VECTOR_DIMS, "N", "world", "agent residual f_x, exact"),
    "f_w": SignalSpec(AGENT_VECTOR_DIMS, "N m", "base", "agent residual f_omega, exact"),
    "f_r": SignalSpec(JOINT, TORQUE, "joint", "agent residual f_r, exact"),
    "f_x_hat": SignalSpec(AGENT_VECTOR_DIMS, "N", "world", "agent residual f_x, predicted"),
    "f_w_hat": SignalSpec(AGENT_VECTOR_DIMS, "N m", "base", "agent residual f_omega, predicted"),
    "f_r_hat": SignalSpec(JOINT, TORQUE, "joint", "agent residual f_r, predicted"),
    "Phi": SignalSpec((), "m", "none", "largest grasp constraint violation |Phi|"),
    "Phi_dot": SignalSpec((), "m/s", "none", "largest rate of the grasp constraints |dPhi/dt|"),
    "singular": SignalSpec(AGENT, "1/kg", "none", "smallest singular value of A_j M_j^-1 A_j^T"),
    "r_L": SignalSpec(FORCE, NEWTON, WRENCH_FRAMES, "what labels say of the payload beyond what is learned, as used"),
    "r_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "what labels say of an agent's f_x beyond what is learned, as used"
    ),
    "trust_L": SignalSpec(
        FORCE, "1 (F), 1 (tau)", WRENCH_FRAMES, "how much of what the map of the payload changes is used: as labels do"
    ),
    "trust_x": SignalSpec(
        AGENT_VECTOR_DIMS, "1", "world", "how much of what the map of an agent's f_x changes is used"
    ),
    "late_L": SignalSpec(
        FORCE, NEWTON, WRENCH_FRAMES, "by how much labels of the payload are late, with their age, RMS of late"
    ),
    "late_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "by how much labels of an agent's f_x are late, with their age, RMS of late"
    ),
    "left_L": SignalSpec(
        FORCE, NEWTON, WRENCH_FRAMES, "what labels of the payload said beyond what is used now, RMS of late"
    ),
    "left_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "what labels of an agent's f_x said beyond what is used now, RMS of late"
    ),
    "fresh": SignalSpec((), "1", "none", "1 where labels correct, 0 where they have stopped and their mean does"),
    "comes": SignalSpec((), "1", "none", "1 while labels come, if now and then, 0 once they have stopped"),
}
"""Every field of `simulate.Row` but its time; the last ten are those of pilots that listen to labels."""

UNCERTAINTY_SIGNALS = {
    "sigma_f_L": SignalSpec(FORCE, NEWTON, WRENCH_FRAMES, "posterior deviation of the payload residual f_uk,L"),
    "sigma_f_x": SignalSpec(AGENT_VECTOR_DIMS, "N", "world", "posterior deviation of the agent residual f_x"),
    "sigma_f_w": SignalSpec(AGENT_VECTOR_DIMS, "N m", "base", "posterior deviation of the agent residual f_omega"),
    "sigma_f_r": SignalSpec(JOINT, TORQUE, "joint", "posterior deviation of the agent residual f_r"),
    "sigma_L": SignalSpec(
        (), NEWTON, "none", "sigma_L = |Sigma_L^(1/2)|, Frobenius, plain norm over forces and moments"
    ),
    "sigma_L_force": SignalSpec((), "N", "none", "force part of sigma_L"),
    "sigma_L_moment": SignalSpec((), "N m", "none", "moment part of sigma_L"),
    "sigma_A": SignalSpec(
        (), NEWTON, "none", "sigma_A = sum_j |Sigma_j^(1/2)|, Frobenius, plain norm over all outputs"
    ),
    "sigma_A_force": SignalSpec((), "N", "none", "sum over agents of the norm of the f_x part of sigma_A"),
    "sigma_A_moment": SignalSpec(
        (), TORQUE, "none", "sum over agents of the norm of the (f_omega, f_r) part of sigma_A"
    ),
    "bias_f_L": SignalSpec(
        FORCE, NEWTON, WRENCH_FRAMES, "deviation of what labels of f_uk,L are constantly off, as stated"
    ),
    "bias_f_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "deviation of what labels of f_x are constantly off, as stated"
    ),
    "bias_f_w": SignalSpec(
        AGENT_VECTOR_DIMS, "N m", "base", "deviation of what labels of f_omega are constantly off, as stated"
    ),
    "bias_f_r": SignalSpec(JOINT, TORQUE, "joint", "deviation of what labels of f_r are constantly off, as stated"),
    "deviation_f_L": SignalSpec(
        FORCE, NEWTON, WRENCH_FRAMES, "predictive deviation of the payload residual f_uk,L as used"
    ),
    "deviation_f_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "predictive deviation of the agent residual f_x as used"
    ),
    "rho_f_L": SignalSpec(
        FORCE, NEWTON, WRENCH_FRAMES, "radius about the predicted payload residual f_uk,L, by output"
    ),
    "rho_f_x": SignalSpec(AGENT_VECTOR_DIMS, "N", "world", "radius about the predicted agent residual f_x, by output"),
    "rho_f_w": SignalSpec(
        AGENT_VECTOR_DIMS, "N m", "base", "radius about the predicted agent residual f_omega, by output"
    ),
    "rho_f_r": SignalSpec(JOINT, TORQUE, "joint", "radius about the predicted agent residual f_r, by output"),
    "rho_bar_L": SignalSpec(
        (), NEWTON, "none", "rho_bar_L, bounds |f_uk,L - f_hat_L|, plain norm over forces and moments"
    ),
    "rho_bar_L_force": SignalSpec((), "N", "none", "force part of rho_bar_L"),
    "rho_bar_L_moment": SignalSpec((), "N m", "none", "moment part of rho_bar_L"),
    "rho_bar_j": SignalSpec(AGENT, NEWTON, "none", "rho_bar_j, bounds |f_uk,j - f_hat_j|, plain norm over all outputs"),
    "rho_bar_j_force": SignalSpec(AGENT, "N", "none", "f_x part of rho_bar_j"),
    "rho_bar_j_moment": SignalSpec(AGENT, TORQUE, "none", "(f_omega, f_r) part of rho_bar_j"),
}
"""The posterior, what labels cannot say, both as `predictive`, and the error bound along the run, on the coarser axis
`time_sigma`; infinite where data contradict what the bound rests on."""


def dataset(
    rows: StepRecord,
    *,
    agents: Sequence[str],
    joints: Sequence[str],
    contacts: Sequence[str],
    attrs: Mapping[str, Any],
    sigma: PredictionUncertainty,
) -> xr.Dataset:
    """A flight with labelled axes: `ds.lam.sel(contact="front/left", axis="z")`.

    `joints` are named `agent/joint`, `contacts` `agent/arm`, all in team order. Wrenches hold N (world) and N m
    (payload frame) on one axis, which their `units` and `frame` say. `attrs` are strings, numbers or lists of numbers.
    Raises ValueError where the names do not fit the signals.
    """
    names = {"agent": agents, "joint": joints, "contact": contacts, "axis": AXES, "body_axis": AXES}
    names |= {"wrench": WRENCH, "acceleration": ACCELERATION}
    named = [field.name for field in dataclasses.fields(rows) if field.name != "t"]
    fields = [name for name in named if getattr(rows, name) is not None]
    variables = {name: _variable("time", SIGNALS[name], getattr(rows, name)) for name in fields}
    variables |= {
        name: _variable("time_sigma", UNCERTAINTY_SIGNALS[name], x) for name, x in _deviations(rows, sigma).items()
    }
    coordinates = {name: (name, np.asarray(labels, dtype=object)) for name, labels in names.items()}
    times = {"time": (rows.t, "time"), "time_sigma": (sigma.t, "time of deviations")}
    moments = {dim: (dim, np.asarray(t), {"units": "s", "long_name": name}) for dim, (t, name) in times.items()}
    plain = {name: value if isinstance(value, str) else np.asarray(value) for name, value in attrs.items()}
    return xr.Dataset(variables, coordinates | moments, plain)


def _variable(time: str, signal: SignalSpec, values: object) -> xr.Variable:
    attrs = {"units": signal.units, "frame": signal.frame, "long_name": signal.long_name}
    return xr.Variable((time, *signal.dims), np.asarray(values), attrs)


def _deviations(rows: StepRecord, sigma: PredictionUncertainty) -> dict[str, np.ndarray]:
    """Deviations and radii by output, and their norms."""
    payload, force = predictive_std(rows, sigma)
    return {
        "deviation_f_L": payload,
        "deviation_f_x": force,
        "sigma_f_L": sigma.payload_std,
        **_by_output("sigma", sigma.agent_std),
        "bias_f_L": sigma.payload_label_bias,
        **_by_output("bias", sigma.agent_label_bias),
        "rho_f_L": sigma.payload_radius,
        **_by_output("rho", sigma.agent_radius),
        **uncertainty_norms(sigma),
    }


def _by_output(name: str, groups: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    return {
        f"{name}_f_x": np.concatenate([group[..., 0:3] for group in groups], axis=1),
        f"{name}_f_w": np.concatenate([group[..., 3:6] for group in groups], axis=1),
        f"{name}_f_r": np.concatenate([_flat(group[..., 6:]) for group in groups], axis=1),
    }


def _flat(x: np.ndarray) -> np.ndarray:
    """Agents' joints in one row each time, also where there is no time yet."""
    return x.reshape(len(x), x.shape[1] * x.shape[2])


def uncertainty_indices(rows: StepRecord, sigma: PredictionUncertainty) -> np.ndarray:
    """Index into the rows of each time at which deviations and radii are known."""
    return np.searchsorted(rows.t, sigma.t - 1e-9)


def predictive_std(rows: StepRecord, sigma: PredictionUncertainty) -> tuple[np.ndarray, np.ndarray]:
    """Deviations that errors of what is used for `f_L` and `f_x` should have, `(time, 6)` and `(time, agents, 3)`.

    `sqrt(u^2 + b^2)` while labels correct, `sqrt(s^2 + d^2 + b^2)` once they have stopped: s of the posterior, b of
    what labels are constantly off as data sheets state. What is learned need not be right: u says how late labels are
    that correct it, d what they said until they stopped beyond what is used since.
    """
    s, b = (
        (payload, np.concatenate([group[..., :3] for group in groups], axis=1))
        for payload, groups in (
            (sigma.payload_std, sigma.agent_std),
            (sigma.payload_label_bias, sigma.agent_label_bias),
        )
    )
    u, d = (rows.delay_error_L, rows.delay_error_x), (rows.correction_error_L, rows.correction_error_x)
    if rows.labels_available is None or u[0] is None or u[1] is None or d[0] is None or d[1] is None:
        return np.hypot(s[0], b[0]), np.hypot(s[1], b[1])
    at = uncertainty_indices(rows, sigma)
    come = rows.labels_available[at][:, None] > 0
    payload = np.hypot(np.where(come, u[0][at], np.hypot(s[0], d[0][at])), b[0])
    return payload, np.hypot(np.where(come[:, None], u[1][at], np.hypot(s[1], d[1][at])), b[1])


def uncertainty_norms(sigma: PredictionUncertainty) -> dict[str, np.ndarray]:
    """`sigma_L = |Sigma_L^(1/2)|`, `sigma_A = sum_j |Sigma_j^(1/2)|`, `rho_bar_L`, `rho_bar_j`, each with its parts.

    `rho_bar = |(rho_1, ..., rho_m)|` of a body (ass:oracle_bound), agents by column. The plain norms add newtons and
    newton metres, as the paper's; their force and moment parts are apart.
    """
    out = {}
    for part, of in {"": slice(None), "_force": slice(0, 3), "_moment": slice(3, None)}.items():
        each = [np.linalg.norm(group[..., of], axis=2) for group in sigma.agent_std]
        radii = [np.linalg.norm(group[..., of], axis=2) for group in sigma.agent_radius]
        out[f"sigma_L{part}"] = np.linalg.norm(sigma.payload_std[:, of], axis=1)
        out[f"sigma_A{part}"] = np.concatenate(each, axis=1).sum(1)
        out[f"rho_bar_L{part}"] = np.linalg.norm(sigma.payload_radius[:, of], axis=1)
        out[f"rho_bar_j{part}"] = np.concatenate(radii, axis=1)
    return out


def save(ds: xr.Dataset, path: str | Path) -> None:
    """Write a NetCDF-4 file, losslessly compressed.

    Raises OSError, in one line, where it cannot be written; then `path` is as it was before.
    """
    # HDF5 never sees the disk: its own errors are pages long, and a file half written by it would remain
    state = io.BytesIO()
    packed = {name: {"zlib": True, "shuffle": True, "complevel": 1} for name, x in ds.data_vars.items() if x.size}
    ds.to_netcdf(state, engine="h5netcdf", encoding=packed)
    atomic_write.write_atomic(path, state.getvalue())


def load(path: str | Path) -> xr.Dataset:
    """Read into memory what `save` wrote, every bit of it.

    Raises FileNotFoundError where there is no file, ValueError for one that is not NetCDF-4.
    """
    content = Path(path).read_bytes()
    try:
        return xr.load_dataset(io.BytesIO(content), engine="h5netcdf", decode_times=False)
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: not a NetCDF-4 file") from error


def update_times(ds: xr.Dataset) -> tuple[list[float], float | None]:
    """When a flight's models were updated, and when its learning ends, s: never where they were updated after T_end."""
    times, end = np.atleast_1d(ds.attrs["update_times_s"]).astype(float).tolist(), float(ds.attrs["T_end_s"])
    return times, None if times and max(times) > end else end


def load_flights(folder: Path, cases: Iterable[str]) -> tuple[str, dict[str, xr.Dataset]]:
    """The run whose results a folder holds, and its logs, by case.

    Raises ValueError where there are none, or where they are not of one run.
    """
    found = {case: load(folder / f"{case}.nc") for case in cases if (folder / f"{case}.nc").is_file()}
    if not found:
        names = ", ".join(f"{case}.nc" for case in cases)
        raise ValueError(f"{folder} holds no flight ({names}): run colift study first")
    runs = {str(ds.attrs.get("run")) for ds in found.values()}
    if len(runs) > 1:
        raise ValueError(f"{folder} holds flights of {len(runs)} runs: {', '.join(sorted(runs))}")
    return runs.pop(), found


def to_csv(ds: xr.Dataset) -> str:
    """A log as CSV, a row a tick: `time [s]`, `p x [m]`, `lam front/left z [N]`, ..., and the run that it is of.

    Every digit is kept. Deviations and radii are empty at the ticks at which they were not computed.
    """
    often, seldom = (list(_columns(ds, time)) for time in ("time", "time_sigma"))
    text = io.StringIO()
    lines = csv.writer(text, lineterminator="\n")
    lines.writerow(["time [s]", *(name for name, _ in (*often, *seldom)), "run"])
    every, some = (np.stack([x for _, x in columns], axis=1) for columns in (often, seldom))
    when = set(ds.time_sigma.values.tolist())
    computed, empty, run = iter(some.tolist()), [""] * len(seldom), ds.attrs.get("run", "")
    for t, row in zip(ds.time.values.tolist(), every.tolist(), strict=True):
        lines.writerow([t, *row, *(next(computed) if t in when else empty), run])
    return text.getvalue()


def _columns(ds: xr.Dataset, time: str) -> Iterator[tuple[str, np.ndarray]]:
    """What stands at the head of each column, and its numbers, of all signals on one time axis."""
    for name, x in ds.data_vars.items():
        if x.dims[0] == time:
            labels = itertools.product(
                *(map(str, ds[dim].values if dim in ds.coords else range(ds.sizes[dim])) for dim in x.dims[1:])
            )
            flat = x.values.reshape(ds.sizes[time], -1).astype(float)
            for label, column in zip(labels, flat.T, strict=True):
                yield f"{' '.join((str(name), *label))} [{_unit(x.attrs['units'], label)}]", column


def _unit(units: str, label: Sequence[str]) -> str:
    """The unit of one component: of `N (F), N m (tau)` the one that its label begins with."""
    for unit, part in re.findall(r"([^,()]+) \((\w+)\)", units):
        if any(name.startswith(f"{part}_") for name in label):
            return unit.strip()
    return units
