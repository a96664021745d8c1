"""Scalar expressions with sharing and folding, and the functions made of them.

A node is an integer. Equal expressions are one node (hash consing), constants are folded on the merge in:
`0 x = 0`, `0 / x = 0`, `1 x = x`, `x + 0 = x`, `x - x = 0`, as real numbers: where x is NaN or infinite (or zero, as
a divisor) they are zero too, unlike in JAX; and zero has no sign.
Arrays of nodes are NumPy integer arrays, so moving elements about (slices, transposes, gathers) costs nothing.
Integers are carried as doubles, exact below 2^53: what computes one is followed by the operation of its type (`INTEGER_RANGES`),
which lets it pass within the range of the type and below 2^53, and is an error otherwise. Booleans are lane masks.
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
LIBM = {  # one call a lane
    "tan", "asin", "acos", "atan", "sinh", "cosh", "tanh", "asinh", "acosh", "atanh",
    "exp", "exp2", "expm1", "log", "log1p", "cbrt", "atan2", "pow", "fmod", "erf",
}  # fmt: skip
INTEGER_RANGES = {  # what is carried exactly of an integer type
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
    """The nodes of one function."""

    def __init__(self) -> None:
        self.code: dict[int, tuple] = {}  # node -> (op, *argument nodes), or ("const", value)
        self.node: dict[tuple, int] = {}
        self.blocks: list[Block] = []
        self.starts: list[int] = []  # first node of each block's outputs
        self.ranges: list[tuple[int, int, str, int, int]] = []  # start, size, "in" or "out", array, block
        self._range_starts: list[int] = []
        self._bounds: np.ndarray | None = None  # starts and ends of `ranges`
        self.count = 0
        self.ufuncs: dict[str, np.ufunc] = {}

    # nodes

    def array(self, size: int, kind: str, array: int, block: int = -1) -> Nodes:
        """Nodes for the elements of an input, or of an output of a block."""
        start = self.count
        if size:
            self._range_starts.append(start)
            self.ranges.append((start, size, kind, array, block))
            self._bounds = None
        self.count += size
        return np.arange(start, start + size)

    def element(self, node: int) -> tuple[str, int, int, int] | None:
        """`(kind, array, block, index)` of a node made by `array`, None for any other."""
        if node in self.code:
            return None
        start, _, kind, array, block = self.ranges[bisect.bisect_right(self._range_starts, node) - 1]
        return kind, array, block, node - start

    def range_indices(self, nodes: Nodes) -> np.ndarray:
        """For each node the number of its range, -1 for those not made by `array`."""
        if not self.ranges:
            return np.full(nodes.shape, -1)
        if self._bounds is None:
            self._bounds = np.array([(start, start + size) for start, size, *_ in self.ranges]).T
        at = np.searchsorted(self._bounds[0], nodes, side="right") - 1
        return np.where(nodes < self._bounds[1][at], at, -1) if len(self.ranges) else at

    def constant_mask(self, nodes: Nodes) -> np.ndarray:
        """Which nodes are numbers or truth values known now."""
        found = self.range_indices(nodes) < 0
        found[found] = [self.is_constant(n) for n in nodes[found].tolist()]
        return found

    def make(self, *code: object) -> int:
        """The node of an expression."""
        found = self.node.get(code)
        if found is None:
            found = self.count
            self.count += 1
            self.node[code] = found
            self.code[found] = code
        return found

    def arguments(self, node: int) -> tuple[int, ...]:
        """The nodes an expression is made of."""
        op, *args = self.code[node]
        return () if op == "const" else tuple(args)

    def const(self, value: float | int) -> int:
        """The node of a number; zeros of both signs are one. Raises `OverflowError` for what no double is."""
        if float(value) != value and isinstance(value, int):
            raise OverflowError(f"native: the integer {value} is no double; integers are carried as doubles")
        value = float(value)
        return self.make("const", value if value == value and value != 0 else (0.0 if value == 0 else "nan"))

    def value(self, node: int) -> float | None:
        """The number behind a constant node, None for any other."""
        code = self.code.get(node)
        return float(code[1]) if code is not None and code[0] == "const" else None

    def constants(self, values: np.ndarray) -> Nodes:
        """Nodes of an array of numbers or truth values."""
        values = np.asarray(values)
        one = (lambda v: self.make("true" if v else "false")) if values.dtype == bool else self.const
        return np.array([one(v) for v in values.ravel().tolist()], dtype=np.int64).reshape(values.shape)

    def constant_values(self, nodes: Nodes) -> np.ndarray | None:
        """The inverse of `constants`, None unless every node is constant."""
        values = []
        for node in nodes.ravel().tolist():
            if not self.is_constant(node):
                return None
            code = self.code[node]
            values.append(float(code[1]) if code[0] == "const" else code[0] == "true")
        return np.array(values).reshape(nodes.shape)

    def as_numbers(self, nodes: Nodes) -> Nodes:
        """`to_number` of many nodes, flat."""
        nodes = np.array(nodes, dtype=np.int64).ravel()
        made = self.range_indices(nodes) < 0
        nodes[made] = self.map("to_number", nodes[made])
        return nodes

    def map(self, op: str, *arrays: Nodes | np.integer | int) -> Nodes:
        """An operation elementwise, broadcasting."""
        f = self.ufuncs.get(op)
        if f is None:
            rule = getattr(self, op, None) or (lambda *a, op=op: self._plain(op, *a))
            f = self.ufuncs[op] = np.frompyfunc(rule, len(arrays), 1)
        return np.asarray(f(*arrays), dtype=np.int64)

    def _plain(self, op: str, *args: int) -> int:
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
        """An integer known to be in range, or checked where it is computed."""
        low, high = INTEGER_RANGES[kind]
        x = self.value(a)
        if x is None:
            return a if self.code.get(a, ("",))[0] == kind else self.make(kind, a)
        if not low <= x <= high:
            raise OverflowError(f"native: an {kind} would be {x:.17g}; {low} to {high} are carried exactly")
        return a

    # arithmetic, in a canonical form: negation outermost, arguments of commutative operations sorted

    def _negated(self, a: int) -> int | None:
        code = self.code.get(a)
        return code[1] if code is not None and code[0] == "neg" else None

    def add(self, a: int, b: int) -> int:
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
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.const(_divide(x, y))
        if x == 0:
            return a
        if y is not None and y != 0 and math.frexp(y)[0] in (0.5, -0.5):  # a power of two: exact
            return self.mul(a, self.const(1 / y))
        m, n = self._negated(a), self._negated(b)
        if m is not None or n is not None:
            quotient = self.div(a if m is None else m, b if n is None else n)
            return quotient if m is not None and n is not None else self.neg(quotient)
        return self.make("div", a, b)

    def integer_pow(self, a: int, power: int) -> int:
        """`a^power` by squaring."""
        if power < 0:
            return self.div(self.const(1.0), self.integer_pow(a, -power))
        result, square = self.const(1.0), a
        while power:
            if power & 1:
                result = self.mul(result, square)
            square, power = (self.mul(square, square), power >> 1) if power > 1 else (square, 0)
        return result

    def sign(self, a: int) -> int:
        zero = self.const(0.0)
        below = self.select(self.lt(a, zero), self.const(-1.0), a)  # a itself: zero, or NaN
        return self.select(self.lt(zero, a), self.const(1.0), below)

    # logic

    def _compare(self, op: str, a: int, b: int) -> int:
        x, y = self.value(a), self.value(b)
        if x is not None and y is not None:
            return self.make("true" if COMPARE_FOLD[op](x, y) else "false")
        return self.make(op, a, b)

    def lt(self, a: int, b: int) -> int:
        return self._compare("lt", a, b)

    def le(self, a: int, b: int) -> int:
        return self._compare("le", a, b)

    def eq(self, a: int, b: int) -> int:
        return self._compare("eq", a, b)

    def ne(self, a: int, b: int) -> int:
        return self._compare("ne", a, b)

    def truth(self, a: int) -> bool | None:
        """The truth value of a constant mask, None for any other."""
        code = self.code.get(a)
        return code[0] == "true" if code is not None and code[0] in ("true", "false") else None

    def is_mask(self, a: int) -> bool:
        """Whether a node is a mask rather than a number."""
        code = self.code.get(a)
        return code is not None and code[0] in MASKS

    def is_constant(self, a: int) -> bool:
        """Whether a node is a number or a truth value known now."""
        code = self.code.get(a)
        return code is not None and code[0] in ("const", "true", "false")

    def logical_and(self, a: int, b: int) -> int:
        for x, y in ((a, b), (b, a)):
            if self.truth(x) is not None:
                return y if self.truth(x) else x
        return a if a == b else self.make("and", min(a, b), max(a, b))

    def logical_not(self, a: int) -> int:
        if self.truth(a) is not None:
            return self.make("false" if self.truth(a) else "true")
        code = self.code[a]
        return code[1] if code[0] == "not" else self.make("not", a)

    def logical_or(self, a: int, b: int) -> int:
        for x, y in ((a, b), (b, a)):
            if self.truth(x) is not None:
                return x if self.truth(x) else y
        return a if a == b else self.make("or", min(a, b), max(a, b))

    def logical_xor(self, a: int, b: int) -> int:
        return self.logical_or(self.logical_and(a, self.logical_not(b)), self.logical_and(self.logical_not(a), b))

    def select(self, mask: int, if_true: int, if_false: int) -> int:
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
        """The truth value of a number."""
        if self.is_mask(a):
            return a
        x = self.value(a)
        return self.make("nonzero", a) if x is None else self.make("true" if x != 0 else "false")

    def to_flag(self, a: int) -> int:
        """The truth value of a number that is one or zero."""
        return self.to_mask(a) if self.is_constant(a) else self.make("flag", a)

    def to_number(self, a: int) -> int:
        """One for true, zero for false. A `flag` is the mask of a number that is one or zero already."""
        if a in self.code and self.code[a][0] == "flag":
            return self.code[a][1]
        return self.select(a, self.const(1.0), self.const(0.0)) if self.is_mask(a) else a

    # blocks

    def block(self, kind: type[Block], inputs: Sequence[Nodes], sizes: Sequence[int], **how: Any) -> list[Nodes]:
        """Add a block; its outputs, flat."""
        self.blocks.append(kind(inputs=tuple(map(self.as_numbers, inputs)), outputs=tuple(sizes), **how))
        self.starts.append(self.count)
        return [self.array(size, "out", k, len(self.blocks) - 1) for k, size in enumerate(sizes)]
