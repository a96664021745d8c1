"""Logs of flights as labelled NetCDF: every signal with dimensions, unit, frame and description.

`dataset` builds an xarray dataset from the records of a flight. `save` and `load` use NetCDF-4, `to_csv` exports text.
"""

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

SCHEMA = 2
"""Schema of the logs that `save` writes; `load` renames the variables and attributes of schema 1."""
VARIABLES_OF_SCHEMA_1 = {
    "x_dot": "v_agent",
    "saturated": "thrust_saturated",
    "singular": "min_delassus_singular_value",
    "r_L": "innovation_L",
    "r_x": "innovation_x",
    "trust_L": "model_gain_L",
    "trust_x": "model_gain_x",
    "late_L": "delay_error_L",
    "late_x": "delay_error_x",
    "left_L": "correction_error_L",
    "left_x": "correction_error_x",
    "fresh": "correction_weight",
    "comes": "labels_available",
    **{f"bias_f_{output}": f"label_bias_std_f_{output}" for output in "Lxwr"},
    **{f"deviation_f_{output}": f"predictive_std_f_{output}" for output in "Lxwr"},
}
ATTRIBUTES_OF_SCHEMA_1 = {
    "stopped": "termination_reason",
    "unused": "learning_warnings",
    "world_changed": "change_points",
    "fitted_anew": "refits",
    "update_ready_s": "update_activation_s",
    "update_points_payload": "num_samples_payload",
    "update_points_agents": "num_samples_agents",
    "rho_assumed": "bound_assumptions",
}


class SignalSpec(NamedTuple):
    """Metadata of a logged signal; `dims` follow the time dimension."""

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
    "omega_L": SignalSpec(LOAD, "rad/s", "payload", "payload angular velocity omega_L"),
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
    "e_omega": SignalSpec(LOAD, "rad/s", "payload", "angular velocity error e_omega"),
    "Psi": SignalSpec((), "1", "none", "attitude error function Psi = tr(I - R_d^T R_L)/2"),
    "R": SignalSpec(("agent", *ROTATION_DIMS), "1", "base to world", "base attitude R_j"),
    "x": SignalSpec(AGENT_VECTOR_DIMS, "m", "world", "centre of mass of an agent x_j"),
    "omega": SignalSpec(AGENT_VECTOR_DIMS, "rad/s", "base", "base angular velocity omega_j"),
    "v_agent": SignalSpec(AGENT_VECTOR_DIMS, "m/s", "world", "velocity of the centre of mass dx_j/dt"),
    "r": SignalSpec(JOINT, ANGLE, "joint", "joint position r"),
    "r_dot": SignalSpec(JOINT, RATE, "joint", "joint rate dr/dt"),
    "u": SignalSpec(AGENT, "N", "along the base's z axis", "thrust u_j, as applied"),
    "tau": SignalSpec(AGENT_VECTOR_DIMS, "N m", "base", "body torque tau_j, as applied"),
    "tau_r": SignalSpec(JOINT, TORQUE, "joint", "joint torque tau_r, as applied"),
    "thrust_saturated": SignalSpec(AGENT, "1", "none", "1 if the thrust is at its limit, otherwise 0"),
    "lam": SignalSpec(CONTACT, "N", "world", "contact force on the payload lambda_app"),
    "lam_cmd": SignalSpec(CONTACT, "N", "world", "commanded contact force lambda_cmd"),
    "lam_hat": SignalSpec(CONTACT, "N", "world", "estimated contact force lambda_hat"),
    "R_L_hat": SignalSpec(
        ROTATION_DIMS, "1", "payload to world", "estimated payload attitude, used by the force allocation"
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
    "Phi": SignalSpec((), "m", "none", "largest constraint violation |Phi|"),
    "Phi_dot": SignalSpec((), "m/s", "none", "largest constraint rate |dPhi/dt|"),
    "min_delassus_singular_value": SignalSpec(AGENT, "1/kg", "none", "smallest singular value of A_j M_j^-1 A_j^T"),
    "innovation_L": SignalSpec(FORCE, NEWTON, WRENCH_FRAMES, "innovation of the payload residual, as applied"),
    "innovation_x": SignalSpec(AGENT_VECTOR_DIMS, "N", "world", "innovation of the agent residual f_x, as applied"),
    "model_gain_L": SignalSpec(
        FORCE, "1 (F), 1 (tau)", WRENCH_FRAMES, "gain of changes of the payload residual model, in [0, 1]"
    ),
    "model_gain_x": SignalSpec(AGENT_VECTOR_DIMS, "1", "world", "gain of changes of the f_x residual model, in [0, 1]"),
    "delay_error_L": SignalSpec(FORCE, NEWTON, WRENCH_FRAMES, "RMS error of the payload labels due to their delay"),
    "delay_error_x": SignalSpec(AGENT_VECTOR_DIMS, "N", "world", "RMS error of the f_x labels due to their delay"),
    "correction_error_L": SignalSpec(
        FORCE, NEWTON, WRENCH_FRAMES, "RMS error of the corrected payload prediction without labels"
    ),
    "correction_error_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "RMS error of the corrected f_x prediction without labels"
    ),
    "correction_weight": SignalSpec((), "1", "none", "weight of the current innovation; 0: decayed to its mean"),
    "labels_available": SignalSpec((), "1", "none", "1 while labels are available, otherwise 0"),
}
"""Signals of `StepRecord` except the time; the last ten exist for controllers with an innovation filter."""

UNCERTAINTY_SIGNALS = {
    "sigma_f_L": SignalSpec(
        FORCE, NEWTON, WRENCH_FRAMES, "posterior standard deviation of the payload residual f_uk,L"
    ),
    "sigma_f_x": SignalSpec(AGENT_VECTOR_DIMS, "N", "world", "posterior standard deviation of the agent residual f_x"),
    "sigma_f_w": SignalSpec(
        AGENT_VECTOR_DIMS, "N m", "base", "posterior standard deviation of the agent residual f_omega"
    ),
    "sigma_f_r": SignalSpec(JOINT, TORQUE, "joint", "posterior standard deviation of the agent residual f_r"),
    "sigma_L": SignalSpec((), NEWTON, "none", "sigma_L = |Sigma_L^(1/2)|, Frobenius norm over forces and moments"),
    "sigma_L_force": SignalSpec((), "N", "none", "force part of sigma_L"),
    "sigma_L_moment": SignalSpec((), "N m", "none", "moment part of sigma_L"),
    "sigma_A": SignalSpec((), NEWTON, "none", "sigma_A = sum_j |Sigma_j^(1/2)|, Frobenius norm over all outputs"),
    "sigma_A_force": SignalSpec((), "N", "none", "sum over agents of the norm of the f_x part of sigma_A"),
    "sigma_A_moment": SignalSpec(
        (), TORQUE, "none", "sum over agents of the norm of the (f_omega, f_r) part of sigma_A"
    ),
    "label_bias_std_f_L": SignalSpec(
        FORCE, NEWTON, WRENCH_FRAMES, "standard deviation of the label bias of f_uk,L, from data sheets"
    ),
    "label_bias_std_f_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "standard deviation of the label bias of f_x, from data sheets"
    ),
    "label_bias_std_f_w": SignalSpec(
        AGENT_VECTOR_DIMS, "N m", "base", "standard deviation of the label bias of f_omega, from data sheets"
    ),
    "label_bias_std_f_r": SignalSpec(
        JOINT, TORQUE, "joint", "standard deviation of the label bias of f_r, from data sheets"
    ),
    "predictive_std_f_L": SignalSpec(
        FORCE, NEWTON, WRENCH_FRAMES, "predictive standard deviation of the payload residual f_uk,L"
    ),
    "predictive_std_f_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "predictive standard deviation of the agent residual f_x"
    ),
    "rho_f_L": SignalSpec(
        FORCE, NEWTON, WRENCH_FRAMES, "error bound of the predicted payload residual f_uk,L, by output"
    ),
    "rho_f_x": SignalSpec(
        AGENT_VECTOR_DIMS, "N", "world", "error bound of the predicted agent residual f_x, by output"
    ),
    "rho_f_w": SignalSpec(
        AGENT_VECTOR_DIMS, "N m", "base", "error bound of the predicted agent residual f_omega, by output"
    ),
    "rho_f_r": SignalSpec(JOINT, TORQUE, "joint", "error bound of the predicted agent residual f_r, by output"),
    "rho_bar_L": SignalSpec((), NEWTON, "none", "rho_bar_L, bound of |f_uk,L - f_hat_L|, norm over forces and moments"),
    "rho_bar_L_force": SignalSpec((), "N", "none", "force part of rho_bar_L"),
    "rho_bar_L_moment": SignalSpec((), "N m", "none", "moment part of rho_bar_L"),
    "rho_bar_j": SignalSpec(AGENT, NEWTON, "none", "rho_bar_j, bound of |f_uk,j - f_hat_j|, norm over all outputs"),
    "rho_bar_j_force": SignalSpec(AGENT, "N", "none", "f_x part of rho_bar_j"),
    "rho_bar_j_moment": SignalSpec(AGENT, TORQUE, "none", "(f_omega, f_r) part of rho_bar_j"),
}
"""Uncertainty signals on the coarser axis `time_sigma`: posterior, label bias, predictive and error bounds.

Error bounds are infinite where data contradict the assumptions of the bound.
"""


def dataset(
    rows: StepRecord,
    *,
    agents: Sequence[str],
    joints: Sequence[str],
    contacts: Sequence[str],
    attrs: Mapping[str, Any],
    sigma: PredictionUncertainty,
) -> xr.Dataset:
    """Build the labelled dataset of a flight.

    Wrenches contain force [N, world] and moment [N m, payload frame] on one axis; their `units` and `frame` name both.
    xarray raises a ValueError if the number of names differs from the shape of a signal.

    Args:
        rows: Records of the flight.
        agents: Agent names in team order.
        joints: Joint names `agent/joint` in team order.
        contacts: Contact names `agent/arm` in team order.
        attrs: Global attributes: strings, numbers or lists of numbers.
        sigma: Standard deviations and error bounds along the flight.

    Returns:
        The dataset, in which `ds.lam.sel(contact="front/left", axis="z")` selects one component. Its global attributes
        include `Conventions`, `title` and `history` of the CF conventions.
    """
    names = {"agent": agents, "joint": joints, "contact": contacts, "axis": AXES, "body_axis": AXES}
    names |= {"wrench": WRENCH, "acceleration": ACCELERATION}
    all_fields = [field.name for field in dataclasses.fields(rows) if field.name != "t"]
    fields = [name for name in all_fields if getattr(rows, name) is not None]
    variables = {name: _variable("time", SIGNALS[name], getattr(rows, name)) for name in fields}
    variables |= {
        name: _variable("time_sigma", UNCERTAINTY_SIGNALS[name], x)
        for name, x in _uncertainty_signals(rows, sigma).items()
    }
    coordinates = {name: (name, np.asarray(labels, dtype=object)) for name, labels in names.items()}
    times = {"time": (rows.t, "time"), "time_sigma": (sigma.t, "time of uncertainty signals")}
    time_coordinates = {
        dim: (dim, np.asarray(t), {"units": "s", "long_name": name}) for dim, (t, name) in times.items()
    }
    global_attrs = _cf_attributes(attrs) | {
        name: value if isinstance(value, str) else np.asarray(value) for name, value in attrs.items()
    }
    return xr.Dataset(variables, coordinates | time_coordinates, global_attrs)


def _cf_attributes(attrs: Mapping[str, Any]) -> dict[str, Any]:
    """Return the global attributes of the CF conventions."""
    subject = ", ".join(f"{name} {attrs[name]}" for name in ("scenario", "case") if attrs.get(name))
    return {
        "Conventions": "CF-1.11",
        "schema": SCHEMA,
        "title": f"Simulated flight{': ' + subject if subject else ''}",
        "history": f"created by colift {attrs.get('version', '')}".strip(),
    }


def _variable(time: str, spec: SignalSpec, values: object) -> xr.Variable:
    """Create a variable with unit, frame and description."""
    attrs = {"units": spec.units, "frame": spec.frame, "long_name": spec.long_name}
    return xr.Variable((time, *spec.dims), np.asarray(values), attrs)


def _uncertainty_signals(rows: StepRecord, sigma: PredictionUncertainty) -> dict[str, np.ndarray]:
    """Return all uncertainty signals by name."""
    payload, force = predictive_std(rows, sigma)
    return {
        "predictive_std_f_L": payload,
        "predictive_std_f_x": force,
        "sigma_f_L": sigma.payload_std,
        **_by_output("sigma", sigma.agent_std),
        "label_bias_std_f_L": sigma.payload_label_bias,
        **_by_output("label_bias_std", sigma.agent_label_bias),
        "rho_f_L": sigma.payload_radius,
        **_by_output("rho", sigma.agent_radius),
        **uncertainty_norms(sigma),
    }


def _by_output(name: str, groups: Sequence[np.ndarray]) -> dict[str, np.ndarray]:
    """Concatenate the groups and split the outputs into f_x, f_w and f_r."""
    return {
        f"{name}_f_x": np.concatenate([group[..., 0:3] for group in groups], axis=1),
        f"{name}_f_w": np.concatenate([group[..., 3:6] for group in groups], axis=1),
        f"{name}_f_r": np.concatenate([_flatten_joints(group[..., 6:]) for group in groups], axis=1),
    }


def _flatten_joints(x: np.ndarray) -> np.ndarray:
    """Flatten agents and joints into one axis; also for zero time samples."""
    return x.reshape(len(x), x.shape[1] * x.shape[2])


def uncertainty_indices(rows: StepRecord, sigma: PredictionUncertainty) -> np.ndarray:
    """Return the row index of each time of the uncertainty signals."""
    return np.searchsorted(rows.t, sigma.t - 1e-9)


def predictive_std(rows: StepRecord, sigma: PredictionUncertainty) -> tuple[np.ndarray, np.ndarray]:
    """Compute predictive standard deviations of the residual predictions `f_L` and `f_x`.

    The result is `sqrt(u^2 + b^2)` while labels are available and `sqrt(s^2 + d^2 + b^2)` otherwise. Here s is the
    posterior standard deviation, b the label bias from data sheets, u the RMS error due to the label delay, and d the
    RMS error of the corrected prediction without labels.

    Args:
        rows: Records of the flight.
        sigma: Standard deviations along the flight.

    Returns:
        Arrays `(time, 6)` of the payload [N, N m] and `(time, agents, 3)` of the agents [N].
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
    available = rows.labels_available[at][:, None] > 0
    payload = np.hypot(np.where(available, u[0][at], np.hypot(s[0], d[0][at])), b[0])
    return payload, np.hypot(np.where(available[:, None], u[1][at], np.hypot(s[1], d[1][at])), b[1])


def uncertainty_norms(sigma: PredictionUncertainty) -> dict[str, np.ndarray]:
    """Compute norms over the outputs, with their force and moment parts.

    The norms are `sigma_L = |Sigma_L^(1/2)|`, `sigma_A = sum_j |Sigma_j^(1/2)|`, `rho_bar_L` and `rho_bar_j`, where
    `rho_bar = |(rho_1, ..., rho_m)|` of a body (ass:oracle_bound). The total norms add newtons and newton meters, as in
    the paper; the parts have one unit each.

    Args:
        sigma: Standard deviations and error bounds along the flight.

    Returns:
        Arrays by name, agents by column.
    """
    out = {}
    for part, outputs in {"": slice(None), "_force": slice(0, 3), "_moment": slice(3, None)}.items():
        agent_norms = [np.linalg.norm(group[..., outputs], axis=2) for group in sigma.agent_std]
        radii = [np.linalg.norm(group[..., outputs], axis=2) for group in sigma.agent_radius]
        out[f"sigma_L{part}"] = np.linalg.norm(sigma.payload_std[:, outputs], axis=1)
        out[f"sigma_A{part}"] = np.concatenate(agent_norms, axis=1).sum(1)
        out[f"rho_bar_L{part}"] = np.linalg.norm(sigma.payload_radius[:, outputs], axis=1)
        out[f"rho_bar_j{part}"] = np.concatenate(radii, axis=1)
    return out


def save(ds: xr.Dataset, path: str | Path) -> None:
    """Write a NetCDF-4 file with lossless compression.

    Args:
        ds: Dataset of a flight.
        path: Path of the file; unchanged if writing fails with an OSError.
    """
    # HDF5 writes to memory: its own error messages are long, and it leaves an incomplete file behind
    buffer = io.BytesIO()
    encoding = {name: {"zlib": True, "shuffle": True, "complevel": 1} for name, x in ds.data_vars.items() if x.size}
    ds.to_netcdf(buffer, engine="h5netcdf", encoding=encoding)
    atomic_write.write_atomic(path, buffer.getvalue())


def load(path: str | Path) -> xr.Dataset:
    """Read a file written by `save` into memory, without loss.

    Args:
        path: Path of an existing file.

    Returns:
        The dataset.

    Raises:
        ValueError: If the file is not NetCDF-4.
    """
    content = Path(path).read_bytes()
    try:
        return _upgrade(xr.load_dataset(io.BytesIO(content), engine="h5netcdf", decode_times=False))
    except (OSError, ValueError) as error:
        raise ValueError(f"{path}: not a NetCDF-4 file") from error


def _upgrade(ds: xr.Dataset) -> xr.Dataset:
    """Rename variables and attributes of a log of schema 1; a log of schema 2 is returned as it is."""
    if int(ds.attrs.get("schema", 1)) >= SCHEMA:
        return ds
    renamed = ds.rename({old: new for old, new in VARIABLES_OF_SCHEMA_1.items() if old in ds})
    renamed.attrs = {ATTRIBUTES_OF_SCHEMA_1.get(name, name): value for name, value in ds.attrs.items()}
    renamed.attrs["schema"] = SCHEMA
    return renamed


def update_times(ds: xr.Dataset) -> tuple[list[float], float | None]:
    """Return the times of the model updates, and the end of learning `T_end`.

    Args:
        ds: Dataset of a flight.

    Returns:
        Update times [s], and T_end [s]; None if there are updates after T_end.
    """
    times, end = np.atleast_1d(ds.attrs["update_times_s"]).astype(float).tolist(), float(ds.attrs["T_end_s"])
    return times, None if times and max(times) > end else end


def load_flights(folder: Path, cases: Iterable[str]) -> tuple[str, dict[str, xr.Dataset]]:
    """Load the logs of one run.

    Args:
        folder: Folder with the results.
        cases: Cases to load, if present.

    Returns:
        The id of the run, and its logs by case.

    Raises:
        ValueError: If the folder contains no log of these cases, or logs of different runs.
    """
    flights = {case: load(folder / f"{case}.nc") for case in cases if (folder / f"{case}.nc").is_file()}
    if not flights:
        names = ", ".join(f"{case}.nc" for case in cases)
        raise ValueError(f"{folder} contains no log ({names}): run colift study first")
    runs = {str(ds.attrs.get("run")) for ds in flights.values()}
    if len(runs) > 1:
        raise ValueError(f"{folder} contains logs of {len(runs)} runs: {', '.join(sorted(runs))}")
    return runs.pop(), flights


def to_csv(ds: xr.Dataset) -> str:
    """Format a log as CSV with one row per tick, without loss of digits.

    Columns are `time [s]`, `p x [m]`, `lam front/left z [N]` and so on, and the run id. Uncertainty signals are empty
    at ticks at which they were not computed.

    Args:
        ds: Dataset of a flight.

    Returns:
        The text of the file.
    """
    tick_columns, sparse_columns = (list(_columns(ds, time)) for time in ("time", "time_sigma"))
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["time [s]", *(name for name, _ in (*tick_columns, *sparse_columns)), "run"])
    tick_values, sparse_values = (
        np.stack([x for _, x in columns], axis=1) for columns in (tick_columns, sparse_columns)
    )
    sparse_times = set(ds.time_sigma.values.tolist())
    computed, empty, run = iter(sparse_values.tolist()), [""] * len(sparse_columns), ds.attrs.get("run", "")
    for t, row in zip(ds.time.values.tolist(), tick_values.tolist(), strict=True):
        writer.writerow([t, *row, *(next(computed) if t in sparse_times else empty), run])
    return text.getvalue()


def _columns(ds: xr.Dataset, time: str) -> Iterator[tuple[str, np.ndarray]]:
    """Yield the header and the values of each column on one time axis."""
    for name, x in ds.data_vars.items():
        if x.dims[0] == time:
            labels = itertools.product(
                *(map(str, ds[dim].values if dim in ds.coords else range(ds.sizes[dim])) for dim in x.dims[1:])
            )
            flat = x.values.reshape(ds.sizes[time], -1).astype(float)
            for label, column in zip(labels, flat.T, strict=True):
                yield (
                    f"{' '.join((str(name), *label))} [{_unit(x.attrs['units'], label)}]",
                    column,
                )


def _unit(units: str, label: Sequence[str]) -> str:
    """Return the unit of one component; the component label selects one of `N (F), N m (tau)`."""
    for unit, part in re.findall(r"([^,()]+) \((\w+)\)", units):
        if any(name.startswith(f"{part}_") for name in label):
            return unit.strip()
    return units
