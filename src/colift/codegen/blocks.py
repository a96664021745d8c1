"""Operations on whole arrays: loops, branches, and reads and writes at computed indices.

A `Graph` contains scalar expressions only. An operation whose unrolled form would be too large, or whose indices are
unknown at compile time, is a block of the graph.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from colift.codegen.graph import Graph

Nodes = np.ndarray  # of int64


@dataclass
class Function:
    """Intermediate form of one C function.

    Attributes:
        inputs: Size of each input array.
        graph: Expressions and blocks.
        outputs: Nodes of each output array.
    """

    inputs: tuple[int, ...]
    graph: Graph
    outputs: list[Nodes] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Block:
    """Operation on arrays.

    Attributes:
        inputs: Nodes of each input array, flat.
        outputs: Size of each output array.
    """

    inputs: tuple[Nodes, ...]
    outputs: tuple[int, ...]

    @property
    def functions(self) -> tuple[Function, ...]:
        """Functions that the block calls."""
        return ()


@dataclass(frozen=True, eq=False)
class Map(Block):
    """Loop over independent rows.

    Attributes:
        function: Function of one row.
        length: Number of rows.
        mapped: Whether each input has rows; otherwise all rows share it.
        reductions: For each output the operation that combines the rows, "add", "mul", "max" or "min"; "" if the rows
            are stacked.
    """

    function: Function
    length: int
    mapped: tuple[bool, ...]
    reductions: tuple[str, ...]

    @property
    def functions(self) -> tuple[Function, ...]:
        """Functions that the block calls."""
        return (self.function,)


@dataclass(frozen=True, eq=False)
class Scan(Block):
    """Loop with a carry, `jax.lax.scan`.

    The inputs are the constants, the initial carry and the scanned arrays. The outputs are the final carry and the
    stacked arrays.

    Attributes:
        function: Function of one step.
        length: Number of steps.
        consts: Number of constants.
        carry: Number of carried arrays.
        reverse: Whether the last element is scanned first.
    """

    function: Function
    length: int
    consts: int
    carry: int
    reverse: bool

    @property
    def functions(self) -> tuple[Function, ...]:
        """Functions that the block calls."""
        return (self.function,)


@dataclass(frozen=True, eq=False)
class While(Block):
    """Loop until a condition fails, `jax.lax.while_loop`.

    The inputs are the constants of the condition, those of the body, and the carry. The outputs are the final carry.

    Attributes:
        test: Condition.
        function: Body.
        tests: Number of constants of the condition.
        consts: Number of constants of the body.
    """

    test: Function
    function: Function
    tests: int
    consts: int

    @property
    def functions(self) -> tuple[Function, ...]:
        """Functions that the block calls."""
        return (self.test, self.function)


@dataclass(frozen=True, eq=False)
class Branch(Block):
    """Call of one of several functions; the first input is its index, clipped to the valid range."""

    branches: tuple[Function, ...]

    @property
    def functions(self) -> tuple[Function, ...]:
        """Functions that the block calls."""
        return self.branches


@dataclass(frozen=True, eq=False)
class Window:
    """Location of windows in a flat array: window q has the elements `base[q] + sum_d stride[d] index[q, d] + offset`.

    Attributes:
        base: Element of each window at index zero.
        offset: Offset of each element of a window.
        stride: Stride of each index.
        max_index: Largest value of each index at which the window fits; the smallest is zero.
        drops: Whether a window that does not fit is left out; otherwise its index is clipped.
    """

    base: np.ndarray
    offset: np.ndarray
    stride: tuple[int, ...]
    max_index: tuple[int, ...]
    drops: bool


@dataclass(frozen=True, eq=False)
class Read(Block):
    """Read of windows; the inputs are the array and the indices, one row per window.

    Attributes:
        window: Location of the windows.
        fill_value: Value of the elements of a window that is left out.
    """

    window: Window
    fill_value: float


@dataclass(frozen=True, eq=False)
class Write(Block):
    """Write of windows; the inputs are the array, the indices (one row per window) and the new elements.

    Attributes:
        window: Location of the windows.
        reduction: Operation that combines old and new elements; "" if the new ones replace the old ones.
        check: Range check of integers after every operation; "" for other types.
    """

    window: Window
    reduction: str
    check: str
