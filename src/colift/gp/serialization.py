"""Storage of a posterior in a NumPy `.npz` file, without pickle and with an atomic write.

A file contains data, hyperparameters and capacity, bit for bit. The posterior is recomputed from them, so a file
cannot contradict itself.

See Also:
    docs/decisions/0022-store-gp-data-not-factors.md: Choice of the contents.
"""

from __future__ import annotations

import io
import zipfile
from pathlib import Path

import numpy as np

from colift.gp.fitting import validate_data
from colift.gp.hyperparameters import RANGE, Hyperparameters, make_hyperparameters, validate
from colift.gp.kernels import SquaredExponential
from colift.gp.posterior import GPPosterior, condition
from colift.runtime import atomic_write, bounded_read

FORMAT = "colift gp 2"  # name and version of the file format
FIELD_NAMES = tuple(RANGE)
MAX_CHOLESKY_SIZE = 2**30  # numbers, 8 GiB; for example 13 000 points of 6 outputs


def save_gp(gp: GPPosterior, path: str | Path) -> None:
    """Write one posterior to a file, through a temporary file in the same directory.

    An OSError is raised if the directory is not writable.

    Args:
        gp: Posterior without batch axes.
        path: File to write.

    Raises:
        ValueError: If the posterior has batch axes, a custom kernel, or values that `load_gp` rejects.
    """
    if gp.X.ndim != 2:
        raise ValueError(f"gp has batch axes {gp.X.shape[:-2]}: save one GP per file")
    if type(gp.hyper.kernel) is not SquaredExponential:
        raise ValueError(f"the kernel is {type(gp.hyper.kernel).__name__}: only SquaredExponential can be stored")
    n = int(gp.num_points)
    arrays = {name: np.asarray(getattr(gp.hyper, name)) for name in FIELD_NAMES}
    arrays |= {"X": np.asarray(gp.X[:n]), "Y": np.asarray(gp.Y[:n]), "capacity": np.asarray(gp.capacity, np.int64)}
    _validate_arrays(arrays)
    state = io.BytesIO()
    np.savez(state, allow_pickle=False, format=np.asarray(FORMAT), **arrays)
    atomic_write.write_atomic(path, state.getvalue())


def load_gp(path: str | Path) -> GPPosterior:
    """Read a posterior written by `save_gp` and condition it on the stored data.

    Predictions are equal to rounding, and bitwise equal for a posterior created by `condition` alone. An OSError is
    raised if the file is not readable.

    Args:
        path: File to read.

    Returns:
        Posterior.

    Raises:
        ValueError: If the file is damaged or not of this format; the message contains the path and the reason.
    """
    content = bounded_read.read_bytes(path, bounded_read.MAX_LOG_BYTES)
    try:
        arrays = _read_arrays(content)
        _validate_arrays(arrays)
        return condition(arrays["X"], arrays["Y"], _hyperparameters(arrays), int(arrays["capacity"]))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _hyperparameters(arrays: dict[str, np.ndarray]) -> Hyperparameters:
    """Create the hyperparameters of stored arrays."""
    signal_variance, lengthscales, noise_variance, offset = (arrays[name] for name in FIELD_NAMES)
    return make_hyperparameters(signal_variance, lengthscales, noise_variance, offset)


def _read_arrays(content: bytes) -> dict[str, np.ndarray]:
    """Read the arrays of an `.npz` file of this format and verify checksums; raise ValueError for other contents."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            stored = {m.filename.removesuffix(".npy"): archive.read(m) for m in members if not m.compress_type}
        if len(stored) != len(members):
            raise ValueError("members are compressed or have equal names")
        arrays = {name: np.lib.format.read_array(io.BytesIO(data)) for name, data in stored.items()}
    # zipfile and NumPy raise many types on damaged bytes; the bytes are in memory, so any error is damage
    except Exception as error:
        raise ValueError(f"not a GP file ({type(error).__name__}: {error})") from error
    found = arrays.pop("format", np.asarray("not stated")).tolist()
    if found != FORMAT:
        raise ValueError(f"format is {str(found)[:40]}, must be '{FORMAT}'")
    return arrays


def _validate_arrays(arrays: dict[str, np.ndarray]) -> None:
    """Raise ValueError if the arrays are not those of one posterior; `condition` performs its own checks."""
    names = {*FIELD_NAMES, "X", "Y", "capacity"}
    if arrays.keys() != names:
        raise ValueError(f"contains {', '.join(sorted(arrays))}: must contain {', '.join(sorted(names))}")
    for name, array in arrays.items():
        dtype = np.dtype(np.int64 if name == "capacity" else np.float64)
        if array.dtype != dtype:
            raise ValueError(f"{name} has type {array.dtype}: must be {dtype}")
    X, Y = validate_data(arrays["X"], arrays["Y"])
    (n, D), m, capacity = X.shape, Y.shape[1], arrays["capacity"]
    if not (D and m):
        raise ValueError(f"X {X.shape} and Y {Y.shape}: must have at least one dimension and one output")
    shapes = {"capacity": (), "lengthscales": (m, D)}
    for name in (*FIELD_NAMES, "capacity"):
        if arrays[name].shape != (expected := shapes.get(name, (m,))):
            raise ValueError(
                f"{name} has shape {arrays[name].shape}: must be {expected} for X {X.shape} and Y {Y.shape}"
            )
    if not n <= int(capacity) or m * int(capacity) ** 2 > MAX_CHOLESKY_SIZE:
        max_capacity = int((MAX_CHOLESKY_SIZE / max(m, 1)) ** 0.5)
        raise ValueError(
            f"capacity = {capacity}: must be at least {n}, the number of points, and at most {max_capacity} "
            f"for {m} outputs"
        )
    validate(_hyperparameters(arrays), int(capacity))
