"""What a function does to whole arrays: loops, branches, and reads and writes at computed places."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from colift.codegen.graph import Graph

Nodes = np.ndarray  # of int64


@dataclass
class Function:
    """A C function to be: input sizes, a graph, and the nodes of each output."""

    inputs: tuple[int, ...]
    graph: Graph
    outputs: list[Nodes] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Block:
    """A call whose inputs (flat nodes) and outputs (sizes) are arrays."""

    inputs: tuple[Nodes, ...]
    outputs: tuple[int, ...]

    @property
    def functions(self) -> tuple[Function, ...]:
        """What is called."""
        return ()


@dataclass(frozen=True, eq=False)
class Map(Block):
    """A function over the rows of inputs (where `mapped`); outputs are stacked, or joined by an operation."""

    function: Function
    length: int
    mapped: tuple[bool, ...]
    reductions: tuple[str, ...]  # by output: "add", "mul", "max", "min"; "" where rows are stacked

    @property
    def functions(self) -> tuple[Function, ...]:
        return (self.function,)


@dataclass(frozen=True, eq=False)
class Scan(Block):
    """A function over time: inputs are `consts`, the carry, what is scanned; outputs the last carry, the stacks."""

    function: Function
    length: int
    consts: int
    carry: int
    reverse: bool

    @property
    def functions(self) -> tuple[Function, ...]:
        return (self.function,)


@dataclass(frozen=True, eq=False)
class While(Block):
    """A function while a test holds: inputs are the test's constants, the function's, the carry; outputs the carry."""

    test: Function
    function: Function
    tests: int  # constants of the test
    consts: int  # of the function

    @property
    def functions(self) -> tuple[Function, ...]:
        return (self.test, self.function)


@dataclass(frozen=True, eq=False)
class Branch(Block):
    """One of several functions: the first input is which, the nearest where there is none."""

    branches: tuple[Function, ...]

    @property
    def functions(self) -> tuple[Function, ...]:
        return self.branches


@dataclass(frozen=True, eq=False)
class Window:
    """Where in a flat array a window lies: at point q, `base[q] + sum_d stride[d] index[q, d] + offset`."""

    base: np.ndarray  # by point
    offset: np.ndarray  # by element of the window
    stride: tuple[int, ...]
    max_index: tuple[int, ...]  # largest index of each kind at which the window fits; the least is zero
    drops: bool  # whether a window that does not fit is left out; else it is moved to where it does


@dataclass(frozen=True, eq=False)
class Read(Block):
    """Windows of an array, (points, window): inputs are the array and the indices (points, kinds)."""

    window: Window
    fill_value: float  # what a window that is left out holds


@dataclass(frozen=True, eq=False)
class Write(Block):
    """An array with windows written: inputs are the array, the indices, the updates (points, window)."""

    window: Window
    reduction: str  # "", or the operation that reductions what is there and what comes
    check: str  # the operation every step is to pass, of integers
