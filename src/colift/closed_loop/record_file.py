"""Records of a flight in a file, so that the memory of a flight does not grow with its duration.

A file with a name remains if the process is killed, and contains all rows until the last chunk. Its first line has 64
bytes and states the number of rows. The second line is JSON with the signals. A block of rows follows for each of them,
which begins at a multiple of 64 bytes and has the size of the whole flight.

See Also:
    colift.closed_loop.flight: flights, which add their records chunk by chunk.
"""

from __future__ import annotations

import dataclasses
import json
import math
import mmap
import tempfile
from pathlib import Path
from typing import Any

import jax
import numpy as np

from colift.closed_loop.signals import StepRecord
from colift.math.pytree import transfer
from colift.runtime import bounded_read

ALIGNMENT = 64
"""Alignment of the blocks [bytes]; JAX uses aligned arrays without a copy."""
TITLE = b"colift records of a flight, rows: "


class RecordFile:
    """File with one block of rows for each signal.

    A file without name is removed with the last array that reads from it, and with the process.

    Example:
        ::

            with contextlib.closing(RecordFile(ticks=250)) as file:
                for _ in range(2):
                    loop, rows = rollout(setup, loop, noise, jnp.asarray(125))
                    file.append(jax.tree.map(np.asarray, rows))
                records = file.read()
    """

    def __init__(self, ticks: int, path: Path | None = None) -> None:
        """Create an empty file.

        Args:
            ticks: Largest number of rows.
            path: Path of the file, which is replaced; None for a temporary file without name.

        Raises:
            OSError: If the file cannot be created.
        """
        self._ticks, self._num_rows, self._place = ticks, 0, path or tempfile.gettempdir()
        self._file = (
            tempfile.TemporaryFile(buffering=0, prefix="colift-") if path is None else path.open("w+b", buffering=0)  # noqa: SIM115
        )

    def close(self) -> None:
        """Close the file; arrays from `read` stay valid."""
        self._file.close()

    def append(self, rows: StepRecord) -> None:
        """Add rows at the end.

        Args:
            rows: Records as NumPy arrays. All calls have the same signals, shapes and types.

        Raises:
            OSError: If the file cannot be written.
        """
        arrays = {field.name: getattr(rows, field.name) for field in dataclasses.fields(rows)}
        arrays = {name: np.asarray(x) for name, x in arrays.items() if x is not None}
        signals = {name: (x.dtype.str, x.shape[1:]) for name, x in arrays.items()}
        header = {"ticks": self._ticks, "signals": signals}
        line = json.dumps(header).encode() + b"\n"
        blocks, size = _blocks(header, ALIGNMENT + len(line))
        try:
            if not self._num_rows:
                self._file.truncate(size)
                self._write(ALIGNMENT, line)
            for name, x in arrays.items():
                dtype, shape, offset = blocks[name]
                self._write(offset + self._num_rows * dtype.itemsize * math.prod(shape), x.tobytes())
            self._num_rows += len(rows.t)
            self._write(0, TITLE + str(self._num_rows).encode().rjust(ALIGNMENT - len(TITLE) - 1) + b"\n")
        except OSError as error:
            raise OSError(
                error.errno, f"cannot write the records of the flight to {self._place}: {error.strerror}"
            ) from error

    def _write(self, offset: int, content: bytes) -> None:
        """Write all bytes at a position."""
        self._file.seek(offset)
        rest = memoryview(content)
        while rest:
            rest = rest[self._file.write(rest) :]

    def read(self) -> StepRecord:
        """Return all rows; see `read_records`."""
        return _read(self._file.fileno())


def read_records(path: str | Path) -> StepRecord:
    """Return the records of a file, also of one whose flight was killed.

    Args:
        path: Path of the file.

    Returns:
        Records as arrays that the operating system reads from the file on access. Changes of the arrays are not written
        to the file.

    Raises:
        OSError: If the file cannot be read.
        ValueError: If it is not a file of records, or has no row.

    Example:
        ::

            rows = read_records("flight.rows")
            print(f"{len(rows.t)} rows until t = {rows.t[-1]} s")
    """
    with bounded_read.open_regular(path) as descriptor:
        try:
            return _read(descriptor)
        except (ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{path}: no records of a flight: {error}") from error


def _read(descriptor: int) -> StepRecord:
    """Return the records of an open file."""
    content = mmap.mmap(descriptor, 0, access=mmap.ACCESS_COPY)
    if content[: len(TITLE)] != TITLE:
        raise ValueError("another kind of file")
    num_rows, end = int(content[len(TITLE) : ALIGNMENT]), content.find(b"\n", ALIGNMENT)
    blocks, _ = _blocks(json.loads(content[ALIGNMENT:end]), end + 1)
    empty = StepRecord(**{name: transfer(np.zeros((0, *shape), dtype)) for name, (dtype, shape, _) in blocks.items()})
    arrays = [np.ndarray((num_rows, *shape), dtype, content, offset) for dtype, shape, offset in blocks.values()]
    return jax.tree.unflatten(jax.tree.structure(empty), arrays)


def _blocks(header: dict[str, Any], start: int) -> tuple[dict[str, tuple[np.dtype, tuple[int, ...], int]], int]:
    """Return type, shape of a row and offset of each signal, and the size of the file."""
    blocks, offset = {}, _align(start)
    for name, (dtype, shape) in header["signals"].items():
        blocks[name] = np.dtype(dtype), tuple(shape), offset
        offset = _align(offset + header["ticks"] * np.dtype(dtype).itemsize * math.prod(shape))
    return blocks, offset


def _align(offset: int) -> int:
    """Return the next multiple of the alignment."""
    return -(-offset // ALIGNMENT) * ALIGNMENT
