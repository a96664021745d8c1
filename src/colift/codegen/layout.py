"""Where arrays lie in C, and how a function is to be written."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from colift.codegen.blocks import Nodes


@dataclass(frozen=True)
class ArrayRef:
    """Where an array lies: an offset from a pointer of C; `uniform` where it holds one number for all lanes."""

    name: str
    offset: int = 0
    uniform: bool = False

    def __add__(self, by: int) -> ArrayRef:
        return ArrayRef(self.name, self.offset + by, self.uniform)

    def __str__(self) -> str:
        return f"{self.name} + {self.offset}" if self.offset else self.name

    def __getitem__(self, index: int) -> str:
        return f"{self.name}[{self.offset + index}]"


@dataclass(frozen=True)
class FunctionLayout:
    """How a function is to be written: lanes, and which arguments are uniform, outputs left out, or inputs written to."""

    lanes: int
    uniform: frozenset[int] = frozenset()
    kept: frozenset[int] = frozenset()  # outputs that are an input as it was
    written: tuple[tuple[int, int], ...] = ()  # outputs that are an input written to, and which
    guard: bool = False  # whether a mask says which lanes may be written to in place


def copy_runs(
    ranges: np.ndarray, nodes: Nodes, at: np.ndarray, constant: np.ndarray
) -> Iterator[tuple[str, int, int, int]]:
    """Neighbours that are copied alike: "row" of an array, "same" node, "known" numbers, "one"; first, count, step."""
    beside = np.diff(at) == 1
    steps = np.diff(nodes)
    one = beside & (ranges[1:] == ranges[:-1])
    k, last = 0, len(at)
    while k < last:
        n, step, kind = 1, 1, "one"
        if ranges[k] >= 0 and k + 1 < last and one[k] and steps[k] != 0:
            kind, step = "row", int(steps[k])
            while k + n < last and one[k + n - 1] and steps[k + n - 1] == step:
                n += 1
        elif k + 1 < last and beside[k] and steps[k] == 0:
            kind = "same"
            while k + n < last and beside[k + n - 1] and steps[k + n - 1] == 0:
                n += 1
        elif constant[k]:
            kind = "known"
            while k + n < last and beside[k + n - 1] and constant[k + n] and steps[k + n - 1] != 0:
                n += 1
        yield kind, k, n, step
        k += n


def c_literal(value: float | str) -> str:
    """A number in C."""
    value = float(value)
    if math.isnan(value):
        return "NAN"
    if math.isinf(value):
        return "INFINITY" if value > 0 else "-INFINITY"
    return f"({value!r})" if value < 0 else repr(value)
