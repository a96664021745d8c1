"""Checks of a log that was read from a file: variables, dimensions, types, times, labels and attributes.

A damaged file may be valid NetCDF. The checks refuse it before a reader fails on a missing variable or a wrong type.

See Also:
    colift.closed_loop.log_signals: all variables with their dimensions.
"""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator

import numpy as np
import xarray as xr

from colift.closed_loop import log_signals
from colift.runtime import text

CORRECTION = ("correction_L_", "correction_x")
"""Prefixes of the correction, which only controllers with a residual corrector log."""
CORRECTOR = (
    "correction_std_",
    "correction_weight_",
    "correction_nis",
    "label_L",
    "label_x",
    "label_valid",
    "model_pred",
)
"""Prefixes of the other variables of a residual corrector, which logs of older schemas lack."""
LIMITED = ("slack_", "allocation_", "tilt_limited", "thrust_limited", "friction_limited", "force_limited")
LIMITED += ("effectiveness",)
"""Prefixes of the variables that only allocators with limits log."""
ESTIMATED = ("lam_std", "delta_W_hat", "delta_W_std")
"""Prefixes of the variables of contact forces that are estimated without tip force sensors."""
MOMENTS = ("contact_moment",)
"""Prefixes of the variables of contacts that bear moments."""
GROUPS = (CORRECTION, CORRECTOR, LIMITED, ESTIMATED, MOMENTS)
"""Groups of variables that only some controllers log."""
COMPUTED = ("p_base",)
"""Variables that logs of older schemas lack."""
DIM_SIZES = {"axis": 3, "body_axis": 3, "quaternion": 4}
TEXTS = ("scenario", "case", "version", "settings_digest", "run", "termination_reason", "learning_warnings")
TEXTS += ("change_points", "refits", "rho_bound", "bound_assumptions", "scenario_json")
NUMBERS = ("seed", "complete", "T_end_s", "rho_confidence", "rho_rkhs_norm")
LISTS = ("update_times_s", "update_activation_s", "num_samples_payload", "num_samples_agents")
REQUIRED_ATTRIBUTES = ("termination_reason", "update_times_s", "T_end_s")
MAX_TEXT = 80  # characters of a value in a message


HEAP_SIGNATURE = b"GCOL"
"""Signature of a global heap collection of HDF5, which contains text and references of variable length."""
HEAP_HEADER = 16
"""Length of the header of a collection, and of an object in it [bytes]."""


def refuse_endless_heap(content: bytes) -> None:
    """Raise ValueError if the HDF5 library would read a damaged heap in an endless loop, which no signal can end.

    The library advances by the size of each object in a collection. The size of free space, object 0, includes its
    header; the sum wraps at 2^64 (HDF5 File Format Specification, version 3, section III.E).

    Args:
        content: Bytes of an HDF5 file.

    Raises:
        ValueError: If an object has the size zero, or if collections overlap.
    """
    remaining = len(content) // 8  # each object has at least 16 bytes; overlapping ones would take quadratic time
    start = content.find(HEAP_SIGNATURE)
    while start >= 0:
        position = start + HEAP_HEADER
        if position <= len(content):
            (size,) = struct.unpack_from("<Q", content, start + 8)
            end = min(start + size, len(content))
            while position + HEAP_HEADER <= end:
                index, length = struct.unpack_from("<H6xQ", content, position)
                step = length if index == 0 else (HEAP_HEADER + -(-length // 8) * 8) % 2**64
                if step == 0:
                    raise ValueError(f"damaged: object {index} of the heap at byte {start} has the size zero")
                position, remaining = position + step, remaining - 1
                if remaining < 0:
                    raise ValueError("damaged: its heaps overlap")
        start = content.find(HEAP_SIGNATURE, start + 1)


def refuse_damage(ds: xr.Dataset) -> None:
    """Raise ValueError with the first fault of a log; variables that are not those of this version are ignored.

    Args:
        ds: Log of the present schema.

    Raises:
        ValueError: If the log has a fault, in one line.
    """
    for check in (_times, _labels, _variables, _attributes, _finite):
        for fault in check(ds):
            raise ValueError(f"damaged: {fault}")


def _times(ds: xr.Dataset) -> Iterator[str]:
    """Yield faults of the time axes."""
    for dim in ("time", "time_sigma"):
        if dim not in ds.coords or ds[dim].dims != (dim,) or ds[dim].dtype.kind != "f":
            yield f"the coordinate {dim} is missing or has a wrong type"
        elif not np.isfinite(ds[dim].values).all() or (np.diff(ds[dim].values) <= 0).any():
            yield f"the coordinate {dim} must have finite and increasing times"
    t, t_sigma = ds.time.values, ds.time_sigma.values
    if not len(t):
        yield "it has no time"
    elif len(t_sigma) and not (t[0] - 1e-9 <= t_sigma[0] and t_sigma[-1] <= t[-1] + 1e-9):
        yield "the coordinate time_sigma exceeds the times of the flight"


def _labels(ds: xr.Dataset) -> Iterator[str]:
    """Yield faults of the dimensions with labels."""
    for dim in ("agent", "contact", "axis", "body_axis", "quaternion"):
        if dim not in ds.coords or ds[dim].dims != (dim,) or ds[dim].dtype.kind not in "OUT":
            yield f"the coordinate {dim} is missing or has a wrong type"
        elif len({str(name) for name in ds[dim].values}) != ds.sizes[dim] or not ds.sizes[dim]:
            yield f"the coordinate {dim} must have different names"
        elif ds.sizes[dim] != DIM_SIZES.get(dim, ds.sizes[dim]):
            yield f"the coordinate {dim} must have {DIM_SIZES[dim]} names, got {ds.sizes[dim]}"
    places: list[int] = []
    for dim in ("joint", "prismatic_joint"):
        order = f"{dim}_order"
        if dim not in ds.coords and order not in ds.coords:
            continue
        if dim not in ds.coords or order not in ds.coords or ds[order].dims != (dim,) or ds[order].dtype.kind != "i":
            yield f"the coordinates {dim} and {order} must occur together"
        else:
            places += ds[order].values.tolist()
    if sorted(places) != list(range(len(places))):
        yield "the places of the joints are not 0, 1, 2 and so on"


def _variables(ds: xr.Dataset) -> Iterator[str]:
    """Yield faults of the variables: missing, of other dimensions, or no numbers."""
    logged = [group for group in GROUPS if any(str(name).startswith(group) for name in ds.data_vars)]
    for name, spec in log_signals.SPECS.items():
        time = "time" if name in log_signals.SIGNALS else "time_sigma"
        if name not in ds.data_vars:
            joint = next((dim for dim in spec.dims if dim in ("joint", "prismatic_joint")), None)
            group = next((group for group in GROUPS if name.startswith(group)), None)
            optional = name in COMPUTED or (group is not None and group not in logged)
            if not optional and (joint is None or joint in ds.coords):
                yield f"the variable {name} is missing"
        elif ds[name].dims != (time, *spec.dims):
            dims = text.shorten(ds[name].dims, MAX_TEXT)
            yield f"the variable {name} has the dimensions {dims}, not {(time, *spec.dims)}"
        elif ds[name].dtype.kind not in "fiub":
            yield f"the variable {name} contains no numbers"


def _attributes(ds: xr.Dataset) -> Iterator[str]:
    """Yield faults of the global attributes."""
    for name in REQUIRED_ATTRIBUTES:
        if name not in ds.attrs:
            yield f"the attribute {name} is missing"
    for name in (*TEXTS, *NUMBERS, *LISTS):
        if name in ds.attrs:
            value = ds.attrs[name]
            if name in TEXTS:
                if not isinstance(value, str) or not text.is_encodable(value):
                    yield f"the attribute {name} is {text.shorten(value, MAX_TEXT)}, not a text"
            elif np.asarray(value).dtype.kind not in "fiu" or not np.isfinite(value).all():
                yield f"the attribute {name} is {text.shorten(value, MAX_TEXT)}, not a finite number"
            elif name in NUMBERS and np.size(value) != 1:
                yield f"the attribute {name} has {np.size(value)} numbers, not one"
    if "scenario_json" in ds.attrs:
        try:
            stated = json.loads(ds.attrs["scenario_json"])
        except (ValueError, RecursionError):
            stated = None
        if not isinstance(stated, dict):
            yield "the attribute scenario_json is not the JSON of a scenario"


def _finite(ds: xr.Dataset) -> Iterator[str]:
    """Yield variables of a complete flight with numbers that are not finite; error bounds may be infinite."""
    if not int(ds.attrs.get("complete", 0)):
        return
    for name in log_signals.SPECS:
        if name in ds.data_vars and ds[name].dtype.kind == "f":
            bad = np.isnan(ds[name].values) if name.startswith("rho_") else ~np.isfinite(ds[name].values)
            if bad.any():
                yield f"the variable {name} has {int(bad.sum())} values that are not finite"
