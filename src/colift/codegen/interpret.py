"""From jaxprs to graphs: an evaluation on NumPy arrays of nodes, by one rule a primitive."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import jax
import numpy as np
from jax.extend import core

from colift.codegen.equations import Equation, Value, constant, inline_calls, statement_count
from colift.codegen.graph import FOLD, INTEGER_RANGES, LIBM, Graph, Nodes
from colift.codegen.loop_fusion import fuse_loops

Rule = Callable[..., Any]
RULES: dict[str, Rule] = {}

MAX_STATEMENTS = 50_000  # statements of one operation outside a loop: what is larger takes a C compiler minutes


class UnsupportedPrimitive(NotImplementedError):
    """A function holds an operation the native back end does not know."""


def rule(*names: str) -> Callable[[Rule], Rule]:
    """Register `f(graph, eqn, *nodes)`, the rule of some primitives; it returns one array, or a list."""

    def register(f: Rule) -> Rule:
        RULES.update(dict.fromkeys(names, f))
        return f

    return register


def interpret(g: Graph, jaxpr: core.Jaxpr, consts: Sequence[Any], args: Sequence[Nodes]) -> list[Nodes]:
    """Add a jaxpr's equations to a graph; `consts` are arrays of numbers."""
    values = [Value(v.aval) for v in jaxpr.invars]
    equations, outputs = inline_calls(jaxpr, [*map(constant, consts), *values])
    return evaluate(g, equations, outputs, dict(zip(values, args, strict=True)))


def interpret_closed(g: Graph, jaxpr: core.ClosedJaxpr, args: Sequence[Nodes]) -> list[Nodes]:
    """`interpret` with the jaxpr's own constants."""
    return interpret(g, jaxpr.jaxpr, jaxpr.consts, args)


def evaluate(
    g: Graph, equations: Sequence[Equation], outputs: Sequence[Value], inputs: dict[Value, Nodes]
) -> list[Nodes]:
    """The nodes of `outputs`, given those of the values that come from outside."""
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
        for v, x in zip(e.outvars, out, strict=True):
            assert x.shape == v.aval.shape, (e, x.shape)
            env[v] = x
    return [read(v) for v in outputs]


def _apply(g: Graph, eqn: Equation, nodes: list[Nodes]) -> list[Nodes]:
    name, shapes = eqn.primitive.name, [v.aval.shape for v in eqn.outvars]
    if shapes and all(0 in shape for shape in shapes):  # of a vehicle without joints, say: nothing to compute
        return [np.zeros(shape, dtype=np.int64) for shape in shapes]
    if name not in ("loop", "scan", "while", "cond") and (size := statement_count([eqn])) > MAX_STATEMENTS:
        raise UnsupportedPrimitive(f"native: '{name}' would be {size} statements of C, {MAX_STATEMENTS} are allowed")
    if name in RULES:
        out = RULES[name](g, eqn, *nodes)
    elif name in LIBM or name in FOLD:
        out = check_integer(g, eqn, g.map(name, *nodes))
    else:
        values = [g.constant_values(x) for x in nodes]
        if any(v is None for v in values):
            raise UnsupportedPrimitive(f"native: primitive '{name}' is not supported")
        with jax.ensure_compile_time_eval():
            typed = [np.asarray(v, x.aval.dtype) for v, x in zip(values, eqn.invars, strict=True)]
            out = eqn.primitive.bind(*typed, **eqn.params)
        out = [g.constants(np.asarray(x)) for x in (out if eqn.primitive.multiple_results else [out])]
    return out if isinstance(out, list) else [out]


def is_bool(v: Any) -> bool:
    """Whether a jaxpr's variable holds truth values, which are carried as doubles 0 and 1."""
    return v.aval.dtype == bool


def is_integer(v: Any) -> bool:
    """Whether a jaxpr's variable holds integers, which are carried as doubles, exact below 2^53."""
    return np.issubdtype(v.aval.dtype, np.integer)


def check_integer(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    """What an equation computed: as it is, or, of integers, checked to be what JAX has. Every step is to be checked,
    as what has once been rounded may come back into the range.
    """
    out = eqn.outvars[0]
    if not is_integer(out):
        return a
    if out.aval.dtype.name not in INTEGER_RANGES:
        raise UnsupportedPrimitive(f"native: integers must be {', '.join(INTEGER_RANGES)}; got {out.aval.dtype}")
    return g.map(out.aval.dtype.name, a)


def select_case(g: Graph, which: Nodes, cases: Sequence[Nodes]) -> Nodes:
    """`cases[which]`, an index out of range being the nearest in range."""
    out = cases[-1]
    for k in reversed(range(len(cases) - 1)):
        out = g.map("select", g.map("le", which, g.constants(np.array(float(k)))), cases[k], out)
    return out
