"""Scalar expression graph with common subexpression elimination and constant folding.

A node is an integer, and equal expressions are one node (hash consing). Arrays of nodes are NumPy integer arrays, so
slices, transposes and constant gathers emit no code.

Constants fold as real numbers do: `0 x = 0`, `0 / x = 0`, `1 x = x`, `x + 0 = x`, `x - x = 0`. Unlike in JAX, this
includes a NaN, an infinity and a zero divisor, and zero has no sign.

Integers are carried as doubles, exact below 2^53. A range check of the type (`INTEGER_RANGES`) follows each operation
with an integer result. Booleans are lane masks.
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from colift.codegen.blocks import Block, Nodes

COMPARE = {"lt": "<", "le": "<=", "eq": "==", "ne": "!="}
MASKS = {*COMPARE, "and", "or", "not", "true", "false", "nonzero", "flag"}


def _divide(a: float, b: float) -> float:
    """Divide as IEEE 754 does, without an error for a zero divisor."""
    with np.errstate(all="ignore"):
        return float(np.float64(a) / np.float64(b))


FOLD: dict[str, Callable[..., float]] = {
    "add": lambda a, b: a + b,
    "sub": lambda a, b: a - b,
    "mul": lambda a, b: a * b,
    "div": _divide,
    "neg": lambda a: -a,
    "abs": abs,
    "sqrt": lambda a: math.sqrt(a) if a >= 0 else math.nan,
    "sin": lambda a: float(np.sin(a)),
    "cos": lambda a: float(np.cos(a)),
    "floor": lambda a: float(np.floor(a)),
    "ceil": lambda a: float(np.ceil(a)),
    "rint": lambda a: float(np.rint(a)),
    "trunc": lambda a: float(np.trunc(a)),
    "max": lambda a, b: float(np.maximum(a, b)),
    "min": lambda a, b: float(np.minimum(a, b)),
}
LIBM = {  # one call of the C library per lane
    "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh",
    "exp", "exp2", "expm1", "log", "log1p", "cbrt", "atan2", "pow", "fmod", "erf",
}  # fmt: skip
INTEGER_RANGES = {  # smallest and largest integer of each type that a double carries exactly
    "int64": (1 - 2**53, 2**53 - 1),
    "int32": (-(2**31), 2**31 - 1),
    "uint32": (0, 2**32 - 1),
}
COMPARE_FOLD = {
    "lt": lambda a, b: a < b,
    "le": lambda a, b: a <= b,
    "eq": lambda a, b: a == b,
    "ne": lambda a, b: a != b,
}


class Graph:
    """Nodes and blocks of one function.

    Attributes:
        code: Expression of each node: operation and argument nodes, or ("const", value).
        node: Node of each expression, the inverse of `code`.
        blocks: Operations on arrays.
        starts: First node of the outputs of each block.
        ranges: For each array of nodes its first node, size, kind ("in" or "out"), index and block.
        count: Number of nodes.
        ufuncs: Elementwise operations by name.
    """

    def __init__(self) -> None:
        """Make an empty graph."""
        self.code: dict[int, tuple] = {}
        self.node: dict[tuple, int] = {}
        self.blocks: list[Block] = []
        self.starts: list[int] = []
        self.ranges: list[tuple[int, int, str, int, int]] = []
        self._range_starts: list[int] = []
        self._bounds: np.ndarray | None = None  # first and last node plus one of `ranges`
        self.count = 0
        self.ufuncs: dict[str, np.ufunc] = {}

    # nodes

    def array(self, size: int, kind: str, array: int, block: int = -1) -> Nodes:
        """Make nodes for the elements of an array.

        Args:
            size: Number of elements.
            kind: "in" for an input of the function, "out" for an output of a block.
            array: Index of the input or output.
            block: Index of the block; -1 for an input.

        Returns:
            Consecutive nodes.
        """
        start = self.count
        if size:
            self._range_starts.append(start)
            self.ranges.append((start, size, kind, array, block))
            self._bounds = None
        self.count += size
        return np.arange(start, start + size)

    def element(self, node: int) -> tuple[str, int, int, int] | None:
        """Return `(kind, array, block, index)` of an array element, None for an expression."""
        if node in self.code:
            return None
        start, _, kind, array, block = self.ranges[bisect.bisect_right(self._range_starts, node) - 1]
        return kind, array, block, node - start

    def range_indices(self, nodes: Nodes) -> np.ndarray:
        """Return the index in `ranges` of each node, -1 for expressions."""
        if not self.ranges:
            return np.full(nodes.shape, -1)
        if self._bounds is None:
            self._bounds = np.array([(start, start + size) for start, size, *_ in self.ranges]).T
        at = np.searchsorted(self._bounds[0], nodes, side="right") - 1
        return np.where(nodes < self._bounds[1][at], at, -1) if len(self.ranges) else at

    def constant_mask(self, nodes: Nodes) -> np.ndarray:
        """Return a mask of the nodes that are constants."""
        found = self.range_indices(nodes) < 0
        found[found] = [self.is_constant(n) for n in nodes[found].tolist()]
        return found

    def make(self, *code: object) -> int:
        """Return the node of an expression; make one if the expression is new."""
        found = self.node.get(code)
        if found is None:
            found = self.count
            self.count += 1
            self.node[code] = found
            self.code[found] = code
        return found

    def arguments(self, node: int) -> tuple[int, ...]:
        """Return the argument nodes of an expression."""
        op, *args = self.code[node]
        return () if op == "const" else tuple(args)

    def const(self, value: float | int) -> int:
        """Return the node of a number; both zeros are one node.

        Args:
            value: Number.

        Returns:
            The node.

        Raises:
            OverflowError: If an integer is not exactly a double.
        """
        if float(value) != value and isinstance(value, int):
            raise OverflowError(
                f"codegen: the integer {value} is not exactly a double; integers are carried as doubles"
            )
        value = float(value)
        return self.make("const", value if value == value and value != 0 else (0.0 if value == 0 else "nan"))

    def value(self, node: int) -> float | None:
        """Return the number of a constant node, None for other nodes."""
        code = self.code.get(node)
        return float(code[1]) if code is not None and code[0] == "const" else None

    def constants(self, values: np.ndarray) -> Nodes:
        """Return the nodes of an array of numbers or booleans."""
        values = np.asarray(values)
        one = (lambda v: self.make("true" if v else "false")) if values.dtype == bool else self.const
        return np.array([one(v) for v in values.ravel().tolist()], dtype=np.int64).reshape(values.shape)

    def constant_values(self, nodes: Nodes) -> np.ndarray | None:
        """Return the values of constant nodes, None if a node is not constant; the inverse of `constants`."""
        values = []
        for node in nodes.ravel().tolist():
            if not self.is_constant(node):
                return None
            code = self.code[node]
            values.append(float(code[1]) if code[0] == "const" else code[0] == "true")
        return np.array(values).reshape(nodes.shape)

    def as_numbers(self, nodes: Nodes) -> Nodes:
        """Flatten nodes and convert masks to numbers."""
        nodes = np.array(nodes, dtype=np.int64).ravel()
        made = self.range_indices(nodes) < 0
        nodes[made] = self.map("to_number", nodes[made])
        return nodes

    def map(self, op: str, *arrays: Nodes | np.integer | int) -> Nodes:
        """Apply an operation elementwise, with broadcasting.

        Args:
            op: Name of a method of this class, of `FOLD`, `LIBM` or `INTEGER_RANGES`, or "flag".
            *arrays: Nodes of each operand.

        Returns:
            The nodes of the results.
        """
        f = self.ufuncs.get(op)
        if f is None:
            rule = getattr(self, op, None) or (lambda *a, op=op: self._plain(op, *a))
            f = self.ufuncs[op] = np.frompyfunc(rule, len(arrays), 1)
        return np.asarray(f(*arrays), dtype=np.int64)

    def _plain(self, op: str, *args: int) -> int:
        """Make the node of an operation without a method; fold constants."""
        fold = FOLD.get(op)
        if fold is not None:
            values = [self.value(a) for a in args]
            if None not in values:
                return self.const(fold(*values))
        elif op in INTEGER_RANGES:
            return self._checked_integer(op, *args)
        elif op not in LIBM and op != "flag":
            raise AssertionError(op)
        return self.make(op, *args)

    def _checked_integer(self, kind: str, a: int) -> int:
        """Check the range of an integer: now if it is constant, else at run time."""
        low, high = INTEGER_RANGES[kind]
        x = self.value(a)
        if x is None:
            return a if self.code.get(a, ("",))[0] == kind else self.make(kind, a)
        if not low <= x <= high:
            raise OverflowError(f"codegen: an {kind} would be {x:.17g}; {low} to {high} is carried exactly")
        return a

    # arithmetic in canonical form: negation is outermost, arguments of commutative operations are sorted

    def _negated(self, a: int) -> int | None:
        """Return the argument of a negation, None for other nodes."""
        code = self.code.get(a)
        return code[1] if code is not None and code[0] == "neg" else None

    def add(self, a: int, b: int) -> int:
        """Return the node of `a + b`."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.const(x + y)
        if x == 0:
            return b
        if y == 0:
            return a
        m, n = self._negated(a), self._negated(b)
        if m is not None and n is not None:
            return self.neg(self.add(m, n))
        if n is not None:
            return self.sub(a, n)
        if m is not None:
            return self.sub(b, m)
        return self.make("add", a, b) if a < b else self.make("add", b, a)

    def sub(self, a: int, b: int) -> int:
        """Return the node of `a - b`."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.const(x - y)
        if a == b:
            return self.const(0.0)
        if y == 0:
            return a
        if x == 0:
            return self.neg(b)
        m, n = self._negated(a), self._negated(b)
        if n is not None:
            return self.add(a, n)
        if m is not None:
            return self.neg(self.add(m, b))
        return self.make("sub", a, b)

    def neg(self, a: int) -> int:
        """Return the node of `-a`."""
        x = self.value(a)
        if x is not None:
            return self.const(-x)
        code = self.code.get(a)
        if code is not None and code[0] == "neg":
            return code[1]
        if code is not None and code[0] == "sub":
            return self.make("sub", code[2], code[1])
        return self.make("neg", a)

    def mul(self, a: int, b: int) -> int:
        """Return the node of `a b`."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.const(x * y)
        if x is not None:
            a, b, x, y = b, a, y, x
        if y is not None:
            if y == 0:
                return b
            if y == 1:
                return a
            if y == -1:
                return self.neg(a)
            if y < 0:
                return self.neg(self.mul(a, self.const(-y)))
        m, n = self._negated(a), self._negated(b)
        if m is not None or n is not None:
            product = self.mul(a if m is None else m, b if n is None else n)
            return product if m is not None and n is not None else self.neg(product)
        return self.make("mul", a, b) if a < b else self.make("mul", b, a)

    def div(self, a: int, b: int) -> int:
        """Return the node of `a / b`."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.const(_divide(x, y))
        if x == 0:
            return a
        if y is not None and y != 0 and math.frexp(y)[0] in (0.5, -0.5):  # the reciprocal of a power of two is exact
            return self.mul(a, self.const(1 / y))
        m, n = self._negated(a), self._negated(b)
        if m is not None or n is not None:
            quotient = self.div(a if m is None else m, b if n is None else n)
            return quotient if m is not None and n is not None else self.neg(quotient)
        return self.make("div", a, b)

    def integer_pow(self, a: int, power: int) -> int:
        """Return the node of `a^power`, computed by squaring."""
        if power < 0:
            return self.div(self.const(1.0), self.integer_pow(a, -power))
        result, square = self.const(1.0), a
        while power:
            if power & 1:
                result = self.mul(result, square)
            square, power = (self.mul(square, square), power >> 1) if power > 1 else (square, 0)
        return result

    def sign(self, a: int) -> int:
        """Return the node of the sign of `a`; zero and NaN are kept."""
        zero = self.const(0.0)
        below = self.select(self.lt(a, zero), self.const(-1.0), a)  # zero and NaN are kept
        return self.select(self.lt(zero, a), self.const(1.0), below)

    # logic

    def _compare(self, op: str, a: int, b: int) -> int:
        """Make the mask of a comparison; fold constants."""
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.make("true" if COMPARE_FOLD[op](x, y) else "false")
        return self.make(op, a, b)

    def lt(self, a: int, b: int) -> int:
        """Return the mask of `a < b`."""
        return self._compare("lt", a, b)

    def le(self, a: int, b: int) -> int:
        """Return the mask of `a <= b`."""
        return self._compare("le", a, b)

    def eq(self, a: int, b: int) -> int:
        """Return the mask of `a = b`."""
        return self._compare("eq", a, b)

    def ne(self, a: int, b: int) -> int:
        """Return the mask of `a != b`."""
        return self._compare("ne", a, b)

    def truth(self, a: int) -> bool | None:
        """Return the value of a constant mask, None for other nodes."""
        code = self.code.get(a)
        return code[0] == "true" if code is not None and code[0] in ("true", "false") else None

    def is_mask(self, a: int) -> bool:
        """Return whether a node is a mask."""
        code = self.code.get(a)
        return code is not None and code[0] in MASKS

    def is_constant(self, a: int) -> bool:
        """Return whether a node is a constant number or mask."""
        code = self.code.get(a)
        return code is not None and code[0] in ("const", "true", "false")

    def logical_and(self, a: int, b: int) -> int:
        """Return the conjunction of two masks."""
        for x, y in ((a, b), (b, a)):
            if self.truth(x) is not None:
                return y if self.truth(x) else x
        return a if a == b else self.make("and", min(a, b), max(a, b))

    def logical_not(self, a: int) -> int:
        """Return the negation of a mask."""
        if self.truth(a) is not None:
            return self.make("false" if self.truth(a) else "true")
        code = self.code[a]
        return code[1] if code[0] == "not" else self.make("not", a)

    def logical_or(self, a: int, b: int) -> int:
        """Return the disjunction of two masks."""
        for x, y in ((a, b), (b, a)):
            if self.truth(x) is not None:
                return x if self.truth(x) else y
        return a if a == b else self.make("or", min(a, b), max(a, b))

    def logical_xor(self, a: int, b: int) -> int:
        """Return the exclusive disjunction of two masks."""
        return self.logical_or(self.logical_and(a, self.logical_not(b)), self.logical_and(self.logical_not(a), b))

    def select(self, mask: int, if_true: int, if_false: int) -> int:
        """Return the node of `if_true` where a mask holds, else `if_false`."""
        known = self.truth(mask)
        if known is not None:
            return if_true if known else if_false
        if if_true == if_false:
            return if_true
        if self.is_mask(if_true):
            chosen = self.logical_and(mask, if_true)
            return self.logical_or(chosen, self.logical_and(self.logical_not(mask), if_false))
        return self.make("select", mask, if_true, if_false)

    def to_mask(self, a: int) -> int:
        """Convert a number to a mask; numbers other than zero are true."""
        if self.is_mask(a):
            return a
        x = self.value(a)
        return self.make("nonzero", a) if x is None else self.make("true" if x != 0 else "false")

    def to_flag(self, a: int) -> int:
        """Convert a number that is one or zero to a mask."""
        return self.to_mask(a) if self.is_constant(a) else self.make("flag", a)

    def to_number(self, a: int) -> int:
        """Convert a mask to one or zero; the conversion of `to_flag` is undone."""
        if a in self.code and self.code[a][0] == "flag":
            return self.code[a][1]
        return self.select(a, self.const(1.0), self.const(0.0)) if self.is_mask(a) else a

    # blocks

    def block(self, kind: type[Block], inputs: Sequence[Nodes], sizes: Sequence[int], **options: Any) -> list[Nodes]:
        """Add a block.

        Args:
            kind: Class of the block.
            inputs: Nodes of each input; masks are converted to numbers.
            sizes: Size of each output.
            **options: Further fields of the class.

        Returns:
            The nodes of each output, flat.
        """
        self.blocks.append(kind(inputs=tuple(map(self.as_numbers, inputs)), outputs=tuple(sizes), **options))
        self.starts.append(self.count)
        return [self.array(size, "out", k, len(self.blocks) - 1) for k, size in enumerate(sizes)]
