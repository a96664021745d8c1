"""Locations of arrays in C, and the calling convention of a function."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from colift.codegen.blocks import Nodes


@dataclass(frozen=True)
class ArrayRef:
    """Location of an array in C.

    Attributes:
        name: Pointer.
        offset: Offset from the pointer, in elements.
        uniform: Whether an element is one number for all lanes, not a vector.
    """

    name: str
    offset: int = 0
    uniform: bool = False

    def __add__(self, offset: int) -> ArrayRef:
        """Return the location moved by an offset."""
        return ArrayRef(self.name, self.offset + offset, self.uniform)

    def __str__(self) -> str:
        """Return the C expression of the pointer."""
        return f"{self.name} + {self.offset}" if self.offset else self.name

    def __getitem__(self, index: int) -> str:
        """Return the C expression of an element."""
        return f"{self.name}[{self.offset + index}]"


@dataclass(frozen=True)
class FunctionLayout:
    """Calling convention of a C function.

    Attributes:
        lanes: Samples per vector.
        uniform: Inputs with one number for all lanes.
        kept: Outputs that equal an input and are not parameters.
        written: Pairs of output and input; the output is written into the input.
        guard: Whether a mask selects the lanes that may be written in place.
    """

    lanes: int
    uniform: frozenset[int] = frozenset()
    kept: frozenset[int] = frozenset()
    written: tuple[tuple[int, int], ...] = ()
    guard: bool = False


def copy_runs(
    ranges: np.ndarray, nodes: Nodes, at: np.ndarray, constant: np.ndarray
) -> Iterator[tuple[str, int, int, int]]:
    """Group adjacent elements that one statement can copy.

    Args:
        ranges: Range of each node in the graph, -1 for expressions.
        nodes: Nodes to be copied.
        at: Target index of each node.
        constant: Mask of the constant nodes.

    Yields:
        Kind, first element, count and step. The kind is "row" (elements of one array at a constant step), "same" (one
        node), "known" (constants) or "one" (a single element).
    """
    is_adjacent = np.diff(at) == 1
    steps = np.diff(nodes)
    one = is_adjacent & (ranges[1:] == ranges[:-1])
    k, last = 0, len(at)
    while k < last:
        n, step, kind = 1, 1, "one"
        if ranges[k] >= 0 and k + 1 < last and one[k] and steps[k] != 0:
            kind, step = "row", int(steps[k])
            while k + n < last and one[k + n - 1] and steps[k + n - 1] == step:
                n += 1
        elif k + 1 < last and is_adjacent[k] and steps[k] == 0:
            kind = "same"
            while k + n < last and is_adjacent[k + n - 1] and steps[k + n - 1] == 0:
                n += 1
        elif constant[k]:
            kind = "known"
            while k + n < last and is_adjacent[k + n - 1] and constant[k + n] and steps[k + n - 1] != 0:
                n += 1
        yield kind, k, n, step
        k += n


def c_literal(value: float | str) -> str:
    """Return the C literal of a number."""
    value = float(value)
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return f"({value!r})" if value < 0 else repr(value)
