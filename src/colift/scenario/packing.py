"""Tables of numbers as text, for settings with more values than a file should list."""

from __future__ import annotations

import base64
import binascii

import numpy as np


def pack(table: np.ndarray) -> str:
    """Return the float64 numbers of a table as text (base64, little endian)."""
    return base64.b64encode(np.ascontiguousarray(table, dtype="<f8").tobytes()).decode("ascii")


def unpack(text: str, columns: int) -> np.ndarray:
    """Return the table that a text contains.

    Args:
        text: As returned by `pack`.
        columns: Number of columns.

    Returns:
        The table.

    Raises:
        ValueError: If the text is not such a table, or if a number is not finite.
    """
    try:
        numbers = np.frombuffer(base64.b64decode(text, validate=True), dtype="<f8").astype(float)
    except (binascii.Error, ValueError):
        raise ValueError("must be a table of numbers as colift writes it (base64 of float64)") from None
    if numbers.size % columns or not numbers.size:
        raise ValueError(f"must have rows of {columns} numbers; it has {numbers.size} numbers")
    if not np.isfinite(numbers).all():
        raise ValueError("must have finite numbers")
    return numbers.reshape(-1, columns)
