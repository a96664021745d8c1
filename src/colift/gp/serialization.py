"""A GP in a file: what it follows from, in NumPy's `.npz`, no pickle, written whole or not at all.

A posterior follows from its data, its hyperparameters and its capacity. Only these are kept, every bit of them, so
that a file cannot contradict itself; decision 0022 says why.
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
from colift.runtime import atomic_write

FORMAT = "colift gp 2"
HYPER = tuple(RANGE)
MAX_CHOLESKY_SIZE = 2**30  # numbers, 8 GiB: 13 000 points of 6 outputs


def save_gp(gp: GPPosterior, path: str | Path) -> None:
    """Write one GP (no batch axes) to `path`, through a temporary name in the same folder.

    Raises ValueError for a batch of GPs, a kernel of one's own or what `load` would refuse, OSError where the folder
    cannot be written.
    """
    if gp.X.ndim != 2:
        raise ValueError(f"gp has batch axes {gp.X.shape[:-2]}: save one GP a file")
    if type(gp.hyper.kernel) is not SquaredExponential:
        raise ValueError(f"the kernel is {type(gp.hyper.kernel).__name__}: a file holds SquaredExponential alone")
    n = int(gp.num_points)
    arrays = {name: np.asarray(getattr(gp.hyper, name)) for name in HYPER}
    arrays |= {"X": np.asarray(gp.X[:n]), "Y": np.asarray(gp.Y[:n]), "capacity": np.asarray(gp.capacity, np.int64)}
    _check(arrays)
    state = io.BytesIO()
    np.savez(state, allow_pickle=False, format=np.asarray(FORMAT), **arrays)
    atomic_write.write_atomic(path, state.getvalue())


def load_gp(path: str | Path) -> GPPosterior:
    """Read the GP that `save` wrote: `condition` on its data, which are what they were bit for bit.

    What it says is thus the same to rounding, and the same bits for a GP that came from `condition` alone. Raises
    ValueError, with the path and what is wrong, for any file that is not one, damaged or made by hand; OSError where
    the file cannot be read.
    """
    content = Path(path).read_bytes()
    try:
        arrays = _arrays(content)
        _check(arrays)
        return condition(arrays["X"], arrays["Y"], _hyper(arrays), int(arrays["capacity"]))
    except ValueError as error:
        raise ValueError(f"{path}: {error}") from error


def _hyper(arrays: dict[str, np.ndarray]) -> Hyperparameters:
    signal_variance, lengthscales, noise_variance, offset = (arrays[name] for name in HYPER)
    return make_hyperparameters(signal_variance, lengthscales, noise_variance, offset)


def _arrays(content: bytes) -> dict[str, np.ndarray]:
    """What an `.npz` file of this format holds by name, checksums verified; ValueError where it is none."""
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as archive:
            members = archive.infolist()
            stored = {m.filename.removesuffix(".npy"): archive.read(m) for m in members if not m.compress_type}
        if len(stored) != len(members):
            raise ValueError("members are compressed or named twice")
        arrays = {name: np.lib.format.read_array(io.BytesIO(part)) for name, part in stored.items()}
    # no list of what zipfile and NumPy raise on damaged bytes would be complete; these are in memory, so it is damage
    except Exception as error:
        raise ValueError(f"not a GP file ({type(error).__name__}: {error})") from error
    found = arrays.pop("format", np.asarray("not stated")).tolist()
    if found != FORMAT:
        raise ValueError(f"format is {str(found)[:40]}, must be '{FORMAT}'")
    return arrays


def _check(arrays: dict[str, np.ndarray]) -> None:
    """Raise ValueError where arrays by name are not those of one GP; what `condition` checks is left to it."""
    names = {*HYPER, "X", "Y", "capacity"}
    if arrays.keys() != names:
        raise ValueError(f"holds {', '.join(sorted(arrays))}: must hold {', '.join(sorted(names))}")
    for name, array in arrays.items():
        kind = np.dtype(np.int64 if name == "capacity" else np.float64)
        if array.dtype != kind:
            raise ValueError(f"{name} has type {array.dtype}: must be {kind}")
    X, Y = validate_data(arrays["X"], arrays["Y"])
    (n, D), m, capacity = X.shape, Y.shape[1], arrays["capacity"]
    if not (D and m):
        raise ValueError(f"X {X.shape} and Y {Y.shape}: must have at least one dimension and one output")
    shapes = {"capacity": (), "lengthscales": (m, D)}
    for name in (*HYPER, "capacity"):
        if arrays[name].shape != (must := shapes.get(name, (m,))):
            raise ValueError(
                f"{name} has shape {arrays[name].shape}: must be {must} beside X {X.shape} and Y {Y.shape}"
            )
    if not n <= int(capacity) or m * int(capacity) ** 2 > MAX_CHOLESKY_SIZE:
        most = int((MAX_CHOLESKY_SIZE / max(m, 1)) ** 0.5)
        raise ValueError(f"capacity = {capacity}: must hold the {n} points, and be at most {most} for {m} outputs")
    validate(_hyper(arrays), int(capacity))
