"""Symbolic evaluation of jaxprs: every primitive has a rule on NumPy arrays of graph nodes.

A rule receives the graph, the equation and one node array per operand. It returns one node array, or a list of them.
Primitives without a rule are evaluated by JAX if all operands are constants.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np

from colift.codegen.equations import Equation, Value, inline_calls, statement_count
from colift.codegen.graph import FOLD, INTEGER_RANGES, LIBM, Graph, Nodes
from colift.codegen.jax_internals import Program, UnsupportedPrimitive, readable, require_known_parameters
from colift.codegen.loop_fusion import fuse_loops

Rule = Callable[..., Any]
RULES: dict[str, Rule] = {}

MAX_STATEMENTS = 50_000  # of one operation outside a loop; a C compiler needs minutes for larger ones


def rule(*names: str) -> Callable[[Rule], Rule]:
    """Make a decorator that registers the rule of one or more primitives.

    Args:
        *names: Names of the primitives.

    Returns:
        The decorator; a rule has the arguments graph, equation and one node array per operand.

    Example:
        >>> @rule("copy")
        ... def _copy(g, eqn, a):
        ...     return a
    """

    def register(f: Rule) -> Rule:
        RULES.update(dict.fromkeys(names, f))
        return f

    return register


def interpret(g: Graph, program: Program, args: Sequence[Nodes]) -> list[Nodes]:
    """Add the equations of a program to a graph.

    Args:
        g: Graph.
        program: Program.
        args: Nodes of its inputs that are not constants.

    Returns:
        The nodes of its outputs.
    """
    values = [Value(aval) for aval in program.inputs]
    equations, outputs = inline_calls(program, values)
    return evaluate(g, equations, outputs, dict(zip(values, args, strict=True)))


def evaluate(
    g: Graph, equations: Sequence[Equation], outputs: Sequence[Value], inputs: dict[Value, Nodes]
) -> list[Nodes]:
    """Evaluate equations symbolically.

    Args:
        g: Graph to which nodes are added.
        equations: Equations in order of evaluation.
        outputs: Values to be returned.
        inputs: Nodes of the values that no equation defines.

    Returns:
        The nodes of `outputs`.

    Raises:
        UnsupportedPrimitive: If an operation has no rule or is too large.
        OverflowError: If a constant integer is out of range.
    """
    env = dict(inputs)

    def read(v: Value) -> Nodes:
        return env[v] if v.number is None else g.constants(v.number)

    for e in fuse_loops(equations, outputs):
        try:
            out = _apply(g, e, [read(v) for v in e.invars])
        except (UnsupportedPrimitive, OverflowError) as error:
            if e.source_location and ", at " not in str(error):
                raise type(error)(f"{error}, at {e.source_location}") from None
            raise
        env.update(zip(e.outvars, out, strict=True))
    return [read(v) for v in outputs]


def _apply(g: Graph, eqn: Equation, nodes: list[Nodes]) -> list[Nodes]:
    """Apply the rule of one equation; fold it if it has no rule and all operands are constants."""
    name, shapes = eqn.name, [v.aval.shape for v in eqn.outvars]
    if shapes and all(0 in shape for shape in shapes):  # empty arrays, such as those of a vehicle without joints
        return [np.zeros(shape, dtype=np.int64) for shape in shapes]
    if name not in ("loop", "scan", "while", "cond") and (size := statement_count([eqn])) > MAX_STATEMENTS:
        raise UnsupportedPrimitive(f"codegen: '{name}' would be {size} statements of C, {MAX_STATEMENTS} are allowed")
    if name in RULES or name in LIBM or name in FOLD:
        if eqn.evaluate is not None:
            require_known_parameters(name, eqn.params)
        with readable(name):
            out = RULES[name](g, eqn, *nodes) if name in RULES else check_integer(g, eqn, g.map(name, *nodes))
            out = out if isinstance(out, list) else [out]
            assert [x.shape for x in out] == shapes, f"shapes {[x.shape for x in out]} instead of {shapes}"
        return out
    values = [g.constant_values(x) for x in nodes]
    if eqn.evaluate is None or any(v is None for v in values):
        raise UnsupportedPrimitive(f"codegen: primitive '{name}' is not supported")
    with jax.ensure_compile_time_eval():
        out = eqn.evaluate(*(np.asarray(v, x.aval.dtype) for v, x in zip(values, eqn.invars, strict=True)))
    return [g.constants(np.asarray(x)) for x in out]


def is_bool(v: Any) -> bool:
    """Return whether a value is boolean; booleans are lane masks, or doubles 0 and 1 in arrays."""
    return v.aval.dtype == bool


def is_integer(v: Any) -> bool:
    """Return whether a value is an integer; integers are carried as doubles, exact below 2^53."""
    return np.issubdtype(v.aval.dtype, np.integer)


def check_integer(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    """Add the range check of integer results; results of other types pass unchanged.

    Every intermediate integer needs a check: a value that was rounded may return into the valid range.

    Args:
        g: Graph.
        eqn: Equation that computes `a`.
        a: Nodes of its first result.

    Returns:
        The checked nodes.

    Raises:
        UnsupportedPrimitive: If the integer type is not supported.
    """
    out = eqn.outvars[0]
    if not is_integer(out):
        return a
    if out.aval.dtype.name not in INTEGER_RANGES:
        raise UnsupportedPrimitive(f"codegen: integers must be {', '.join(INTEGER_RANGES)}; got {out.aval.dtype}")
    return g.map(out.aval.dtype.name, a)


def select_case(g: Graph, index: Nodes, cases: Sequence[Nodes]) -> Nodes:
    """Select `cases[index]` elementwise; an index out of range is clipped.

    Args:
        g: Graph.
        index: Nodes of the index.
        cases: Nodes of each case.

    Returns:
        The nodes of the selected elements.
    """
    out = cases[-1]
    for k in reversed(range(len(cases) - 1)):
        out = g.map("select", g.map("le", index, g.constants(np.array(float(k)))), cases[k], out)
    return out
