"""Logs of flights as labelled NetCDF: every variable with dimensions, unit, frame and description.

`dataset` builds an xarray dataset from the records of a flight. `save` and `load` use NetCDF-4, `to_csv` exports text.
Each variable has one unit; `stack_parts` and `all_joints` return wrenches and joint signals on one axis.

See Also:
    colift.closed_loop.log_signals: all variables with units and frames.
    colift.closed_loop.log_upgrade: logs of older schemas.
"""

from __future__ import annotations

import csv
import dataclasses
import io
import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import xarray as xr
from jaxtyping import Array

from colift.closed_loop import log_checks, log_signals, log_upgrade, pose_signals
from colift.closed_loop.log_signals import all_joints as all_joints
from colift.closed_loop.log_signals import stack_parts as stack_parts
from colift.closed_loop.log_upgrade import SCHEMA
from colift.closed_loop.signals import StepRecord
from colift.models.parameters import Team
from colift.onboard.learning.prediction_uncertainty import PredictionUncertainty
from colift.runtime import atomic_write, bounded_read


def dataset(
    rows: StepRecord,
    *,
    team: Team,
    agents: Sequence[str],
    joints: Sequence[str],
    contacts: Sequence[str],
    attrs: Mapping[str, Any],
    sigma: PredictionUncertainty,
) -> xr.Dataset:
    """Build the labelled dataset of a flight.

    Wrenches are split into force [N, world] and moment [N m, payload frame]. Joint signals are split into revolute and
    prismatic joints; variables of a type of joint that the team lacks are absent. Quaternions and base positions are
    computed from the records. xarray raises a ValueError if the number of names differs from the shape of a signal.

    Args:
        rows: Records of the flight.
        team: True parameters of the team.
        agents: Agent names in team order.
        joints: Joint names `agent/joint` in team order.
        contacts: Contact names `agent/arm` in team order.
        attrs: Global attributes: strings, numbers or lists of numbers.
        sigma: Standard deviations and error bounds along the flight.

    Returns:
        The dataset, in which `ds.lam.sel(contact="front/left", axis="z")` selects one component. Its global attributes
        include `Conventions`, `title`, `source` and `history` of the CF conventions.

    Raises:
        ValueError: If the number of joint names differs from the number of joints of the team.
    """
    prismatic = prismatic_joints(team)
    if len(joints) != len(prismatic):
        raise ValueError(f"{len(joints)} joint names for a team of {len(prismatic)} joints")
    fields = [field.name for field in dataclasses.fields(rows) if field.name != "t"]
    records = {name: np.asarray(getattr(rows, name)) for name in fields if getattr(rows, name) is not None}
    poses = {"p_base": pose_signals.base_positions(team, records["R"], records["x"], records["r"])}
    poses |= {q: pose_signals.continuous_quaternions(records[R]) for q, R in log_signals.QUATERNIONS.items()}
    variables = log_signals.variables("time", records | poses, prismatic)
    variables |= log_signals.variables("time_sigma", _uncertainty_signals(rows, sigma), prismatic)
    coordinates = log_signals.label_coordinates({"agent": agents, "contact": contacts})
    coordinates |= log_signals.joint_coordinates(np.asarray(joints, dtype=object), prismatic)
    times = {"time": np.asarray(rows.t), "time_sigma": sigma.t}
    coordinates |= {dim: log_signals.time_coordinate(dim, t) for dim, t in times.items()}
    global_attrs = _cf_attributes(attrs) | {
        name: value if isinstance(value, str) else np.asarray(value) for name, value in attrs.items()
    }
    return xr.Dataset(variables, coordinates, global_attrs)


def prismatic_joints(team: Team) -> np.ndarray:
    """Return for each joint of a team whether it is prismatic, in team order.

    Args:
        team: Parameters of the team.
    """
    flags = [group.tree.prismatic * size for size, group in zip(team.sizes, team.agent_groups, strict=True)]
    return np.array(list(itertools.chain(*flags)), dtype=bool)


def _cf_attributes(attrs: Mapping[str, Any]) -> dict[str, Any]:
    """Return the global attributes of the CF conventions."""
    subject = ", ".join(f"{name} {attrs[name]}" for name in ("scenario", "case") if attrs.get(name))
    program = f"colift {attrs.get('version', '')}".strip()
    return {
        "Conventions": "CF-1.11",
        "schema": SCHEMA,
        "title": f"Simulated flight{': ' + subject if subject else ''}",
        "source": f"numerical simulation with {program}",
        "history": f"created by {program}",
    }


def _uncertainty_signals(rows: StepRecord, sigma: PredictionUncertainty) -> dict[str, np.ndarray]:
    """Return all uncertainty signals by name, with all outputs of a body or joints of the team on one axis."""
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

    The result is `sqrt(c^2 + (1 - w) s^2 + b^2)` with a correction and `sqrt(s^2 + b^2)` without. Here s is the
    posterior standard deviation of the model, b the label bias from data sheets, c the standard deviation of the
    correction and w its weight: without labels the prediction returns to that of the model. In periods without tip
    force readings, the force errors of the agents are in the label of the payload, and their variances are added.

    Args:
        rows: Records of the flight.
        sigma: Standard deviations along the flight.

    Returns:
        Arrays `(time, 6)` of the payload [N, N m] and `(time, agents, 3)` of the agents [N].
    """
    at = uncertainty_indices(rows, sigma)

    def combined(
        s: np.ndarray, b: np.ndarray, c: Array | np.ndarray | None, w: Array | np.ndarray | None
    ) -> np.ndarray:
        if c is None or w is None:
            return np.hypot(s, b)
        c, w = np.asarray(c)[at], np.asarray(w)[at]
        return np.sqrt(c * c + (1 - w) * s * s + b * b)

    agents = [
        np.concatenate([group[..., :3] for group in of], axis=1) for of in (sigma.agent_std, sigma.agent_label_bias)
    ]
    payload = combined(sigma.payload_std, sigma.payload_label_bias, rows.correction_std_L, rows.correction_weight_L)
    force = combined(*agents, rows.correction_std_x, rows.correction_weight_x)
    if rows.label_valid is not None:
        variance = np.einsum("tiak,tak->ti", sigma.force_errors_to_payload, force**2)
        payload = np.sqrt(payload**2 + (1 - np.asarray(rows.label_valid)[at, None]) * variance)
    return payload, force


def uncertainty_norms(sigma: PredictionUncertainty) -> dict[str, np.ndarray]:
    """Compute norms over the outputs, with their force and moment parts.

    The norms are `sigma_L = |Sigma_L^(1/2)|`, `sigma_A = sum_j |Sigma_j^(1/2)|`, `rho_bar_L` and `rho_bar_j`, where
    `rho_bar = |(rho_1, ..., rho_m)|` of a body (ass:oracle_bound). The total norms add newtons and newton meters, as in
    the paper; their unit is N, with moments divided by 1 m.

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
    encoding = {name: {"zlib": True, "shuffle": True, "complevel": 1} for name, x in ds.data_vars.items() if x.size}
    with atomic_write.open_atomic(path) as file:
        target = _DeferredErrors(file.raw)
        ds.to_netcdf(target, engine="h5netcdf", encoding=encoding)
        target.raise_error()


class _DeferredErrors(io.RawIOBase):
    """File for HDF5, which can end the process by a signal if the disk is full.

    After the first error the content is in memory, until `raise_error` is called.
    """

    def __init__(self, file: io.RawIOBase) -> None:
        """Wrap an open file, which stays open."""
        self._file: io.RawIOBase | io.BytesIO = file
        self._error: OSError | None = None

    def raise_error(self) -> None:
        """Raise the first error of a change of the file, if there was one."""
        if self._error is not None:
            raise self._error

    def _move_to_memory(self, error: OSError) -> None:
        """Copy content and position of the file."""
        position = self._file.tell()
        self._file.seek(0)
        self._file, self._error = io.BytesIO(self._file.read() or b""), error
        self._file.seek(position)

    def write(self, data: Any) -> int:
        """Write all data at the current position."""
        rest = memoryview(data).cast("B")
        while rest:
            try:
                rest = rest[self._file.write(rest) :]
            except OSError as error:
                self._move_to_memory(error)
        return memoryview(data).nbytes

    def truncate(self, size: int | None = None) -> int:
        """Change the size of the file."""
        try:
            return self._file.truncate(size)
        except OSError as error:
            self._move_to_memory(error)
            return self._file.truncate(size)

    def readinto(self, buffer: Any) -> int:
        """Read into a buffer."""
        return self._file.readinto(buffer) or 0

    def seek(self, offset: int, whence: int = io.SEEK_SET) -> int:
        """Change the position."""
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        """Return the position."""
        return self._file.tell()

    def readable(self) -> bool:
        """Return whether the file can be read."""
        return True

    writable = seekable = readable


def load(path: str | Path) -> xr.Dataset:
    """Read a file written by `save` into memory, without loss. A log of an older schema is upgraded.

    Args:
        path: Path of an existing file.

    Returns:
        The dataset.

    Raises:
        ValueError: If the file is not NetCDF-4, is damaged, or was written by a later version with another schema. The
            message has one line with the path.
    """
    content = bounded_read.read_bytes(path, bounded_read.MAX_LOG_BYTES)
    try:
        log_checks.refuse_endless_heap(content)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    try:
        with h5py.File(io.BytesIO(content)) as file:  # h5netcdf prints a traceback if one of these steps fails
            file.attrs.get("_nc3_strict")
        ds = xr.load_dataset(io.BytesIO(content), engine="h5netcdf", decode_times=False, phony_dims="access")
    # HDF5 and its readers raise many types on damaged bytes; the bytes are in memory, so any error is damage
    except Exception as error:
        raise ValueError(f"{path}: not a NetCDF-4 file, or damaged") from error
    try:
        ds = log_upgrade.upgrade(ds)
        log_checks.refuse_damage(ds)
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error
    except (KeyError, TypeError, AttributeError, IndexError, OverflowError) as error:  # in the upgrade of an old log
        reason = f"no {error}" if isinstance(error, KeyError) else " ".join(str(error).split())
        raise ValueError(f"{path}: damaged: {reason}") from error
    ds.encoding["source"] = str(path)
    return ds


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
        OSError: If a log cannot be read, also if a folder or a pipe has its name.
        ValueError: If the folder contains no log of these cases, or logs of different runs.
    """
    present = {path.name for path in folder.iterdir()} if folder.is_dir() else set()
    flights = {case: load(folder / f"{case}.nc") for case in cases if f"{case}.nc" in present}
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
                yield f"{' '.join((str(name), *label))} [{x.attrs['units']}]", column
