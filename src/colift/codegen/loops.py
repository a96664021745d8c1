"""Rules of branches and loops: `cond`, `scan`, `while` and the loops formed by `loop_fusion`.

Small loops and branches are unrolled. Others become blocks whose bodies are functions of their own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from colift.codegen.blocks import Branch, Function, Map, Scan, While
from colift.codegen.equations import Equation, Value, inline_calls, statement_count
from colift.codegen.graph import Graph, Nodes
from colift.codegen.interpret import evaluate, interpret, is_bool, rule, select_case
from colift.codegen.jax_internals import Program

MAX_INLINE_STATEMENTS = 400  # a loop or branch with at most this many unrolled statements is unrolled


@rule("cond")
def _cond(g: Graph, eqn: Equation, index: Nodes, *x: Nodes) -> list[Nodes]:
    branches = eqn.params["branches"]
    known = g.constant_values(index)
    if known is not None:
        return interpret(g, branches[int(np.clip(known, 0, len(branches) - 1))], x)
    if sum(statement_count(branch.equations) for branch in branches) <= MAX_INLINE_STATEMENTS:
        cases = [interpret(g, branch, x) for branch in branches]
        return [select_case(g, index, case) for case in zip(*cases, strict=True)]
    avals = [v.aval for v in eqn.invars[1:]]
    functions = tuple(
        build_function(g, avals, lambda inner, nodes, branch=branch: interpret(inner, branch, nodes), x)
        for branch in branches
    )
    sizes = [out.size for out in functions[0].outputs]
    return _restore_types(g, g.block(Branch, [index, *x], sizes, branches=functions), eqn.outvars)


def build_function(
    g: Graph, avals: Sequence[Any], body: Callable[[Graph, list[Nodes]], list[Nodes]], shared: Sequence[Nodes | None]
) -> Function:
    """Build the function of a loop body or branch.

    Args:
        g: Graph of the caller.
        avals: Shape and type of each argument.
        body: Adds the body to a graph; receives the nodes of the arguments and returns those of the results.
        shared: Nodes of each argument in the caller, -1 or None where they vary; constants are folded into the body.

    Returns:
        The function.
    """
    inner = Graph()
    nodes = []
    for k, (aval, outer) in enumerate(zip(avals, shared, strict=True)):
        argument = inner.array(math.prod(aval.shape), "in", k)
        if aval.dtype == bool:
            argument = inner.map("flag", argument)
        if outer is not None:
            outer, argument = outer.ravel(), np.array(argument)
            known = np.flatnonzero(g.constant_mask(outer))
            argument[known] = [inner.make(*g.code[n]) for n in outer[known].tolist()]
        nodes.append(argument.astype(np.int64).reshape(aval.shape))
    outputs = [inner.as_numbers(x) for x in body(inner, nodes)]
    return Function(inputs=tuple(math.prod(a.shape) for a in avals), graph=inner, outputs=outputs)


def _row_invariant(x: Nodes) -> Nodes:
    """Return the nodes that are equal in every row, -1 for the others."""
    return np.where((x == x[:1]).all(0), x[0], -1)


def _loop_outputs(g: Graph, body: Function, rows: dict[int, Nodes], outputs: Sequence[Nodes]) -> list[Nodes]:
    """Return the stacked outputs of a loop; constants and unchanged inputs (`rows`) bypass the loop."""
    inner = body.graph
    results = []
    for out, nodes in zip(outputs, body.outputs, strict=True):
        source = inner.element(int(nodes[0])) if nodes.size else None
        whole = source is not None and source[0] == "in" and source[3] == 0 and (np.diff(nodes) == 1).all()
        out = rows[source[1]] if whole and rows.get(source[1], out[:, 1:]).shape == out.shape else out
        out = out.copy()
        for column in np.flatnonzero(inner.constant_mask(nodes)).tolist():
            out[:, column] = g.make(*inner.code[int(nodes[column])])
        results.append(out)
    return results


def _restore_types(g: Graph, nodes: Sequence[Nodes], outvars: Sequence[Any]) -> list[Nodes]:
    """Give flat nodes the shapes of variables; convert numbers to masks where the type is boolean."""
    return [
        (g.map("to_flag", x) if is_bool(v) else x).reshape(v.aval.shape) for x, v in zip(nodes, outvars, strict=True)
    ]


@rule("loop")
def _loop(g: Graph, eqn: Equation, *x: Nodes) -> list[Nodes]:
    p = eqn.params
    length, merges = p["length"], p["merges"]
    mapped = tuple(axis is not None for axis in p["axes"])
    along = [a if axis is None else np.moveaxis(a, axis, 0) for a, axis in zip(x, p["axes"], strict=True)]

    def run(inner: Graph, nodes: Sequence[Nodes]) -> list[Nodes]:
        return evaluate(inner, p["body"], p["results"], dict(zip(p["arguments"], nodes, strict=True)))

    if length == 1 or length * statement_count(p["body"]) <= MAX_INLINE_STATEMENTS:
        rows = [
            run(g, [np.asarray(a[i]) if m else a for a, m in zip(along, mapped, strict=True)]) for i in range(length)
        ]
        return [_merge_rows(g, column, merge) for column, merge in zip(zip(*rows, strict=True), merges, strict=True)]
    avals = [v.aval for v in p["arguments"]]
    body = build_function(g, avals, run, [_row_invariant(a) if m else a for a, m in zip(along, mapped, strict=True)])
    reductions = tuple(merge if isinstance(merge, str) else "" for merge in merges)
    sizes = [out.size * (1 if reduction else length) for out, reduction in zip(body.outputs, reductions, strict=True)]
    out = g.block(Map, along, sizes, function=body, length=length, mapped=mapped, reductions=reductions)
    rows = {k: a.reshape(length, -1) for k, (a, m) in enumerate(zip(along, mapped, strict=True)) if m}
    stacks = [k for k, reduction in enumerate(reductions) if not reduction]
    stacked = Function(inputs=(), graph=body.graph, outputs=[body.outputs[k] for k in stacks])
    for k, result in zip(
        stacks, _loop_outputs(g, stacked, rows, [out[k].reshape(length, -1) for k in stacks]), strict=True
    ):
        shape = eqn.outvars[k].aval.shape
        merge = merges[k]
        out[k] = np.moveaxis(result.reshape(length, *shape[:merge], *shape[merge + 1 :]), 0, merge)
    return _restore_types(g, out, eqn.outvars)


def _merge_rows(g: Graph, rows: Sequence[Nodes], merge: int | str) -> Nodes:
    """Stack the rows of one result along an axis, or reduce them by an operation."""
    if not isinstance(merge, str):
        return np.stack(rows, merge)
    out = rows[0]
    for row in rows[1:]:
        logical = any(g.is_mask(int(n)) for n in (*out.ravel()[:1], *row.ravel()[:1]))
        out = g.map({"min": "logical_and", "max": "logical_or"}[merge] if logical else merge, out, row)
    return out


@rule("scan")
def _scan(g: Graph, eqn: Equation, *x: Nodes) -> list[Nodes]:
    p = eqn.params
    body, length, consts, carry = p["jaxpr"], p["length"], p["num_consts"], p["num_carry"]
    shared, state, stacked = x[:consts], list(x[consts : consts + carry]), x[consts + carry :]
    if length == 0 or length == 1 or length * statement_count(body.equations) <= MAX_INLINE_STATEMENTS:
        rows = []
        for t in range(length)[:: -1 if p["reverse"] else 1]:
            out = interpret(g, body, [*shared, *state, *(np.asarray(a[t]) for a in stacked)])
            state = out[:carry]
            rows.append(out[carry:])
        rows = rows[:: -1 if p["reverse"] else 1]
        empty = [np.zeros(v.aval.shape, dtype=np.int64) for v in eqn.outvars[carry:]]
        return [*state, *(map(np.stack, zip(*rows, strict=True)) if rows else empty)]
    step, more, constants = _hoist_invariants(g, body, shared)
    known = [*constants, *shared, *[None] * carry, *map(_row_invariant, stacked)]
    avals = [*(v.aval for v in more), *body.inputs]
    step_function = build_function(g, avals, step, known)
    sizes = [out.size * (1 if k < carry else length) for k, out in enumerate(step_function.outputs)]
    options = {"length": length, "consts": consts + len(more), "carry": carry, "reverse": p["reverse"]}
    out = g.block(Scan, [*constants, *x], sizes, function=step_function, **options)
    tails = [o.reshape(length, -1) for o in out[carry:]]
    ys = Function(inputs=(), graph=step_function.graph, outputs=step_function.outputs[carry:])
    return _restore_types(g, [*out[:carry], *_loop_outputs(g, ys, {}, tails)], eqn.outvars)


@rule("while")
def _while(g: Graph, eqn: Equation, *x: Nodes) -> list[Nodes]:
    p = eqn.params
    tests, consts = p["cond_nconsts"], p["body_nconsts"]
    tested, shared, state = x[:tests], x[tests : tests + consts], x[tests + consts :]
    test, body = p["cond_jaxpr"], p["body_jaxpr"]
    first = g.constant_values(np.asarray(interpret(g, test, [*tested, *state])[0]))
    if first is not None and not first:
        return list(state)
    step, more, constants = _hoist_invariants(g, body, shared)
    condition = build_function(
        g,
        test.inputs,
        lambda inner, nodes: interpret(inner, test, nodes),
        [*tested, *[None] * len(state)],
    )
    avals = [*(v.aval for v in more), *body.inputs]
    step_function = build_function(g, avals, step, [*constants, *shared, *[None] * len(state)])
    sizes = [a.size for a in state]
    options = {"test": condition, "function": step_function, "tests": tests, "consts": consts + len(more)}
    out = g.block(While, [*tested, *constants, *shared, *state], sizes, **options)
    return _restore_types(g, out, eqn.outvars)


Step = Callable[[Graph, list[Nodes]], list[Nodes]]


def _hoist_invariants(g: Graph, body: Program, shared: Sequence[Nodes]) -> tuple[Step, list[Value], list[Nodes]]:
    """Hoist loop-invariant equations out of a loop.

    Args:
        g: Graph of the caller.
        body: Body of the loop.
        shared: Nodes of its constants in the caller.

    Returns:
        The remaining body, its additional constants (which come first), and their nodes in the caller.
    """
    arguments = [Value(aval) for aval in body.inputs]
    equations, outputs = inline_calls(body, arguments)
    fixed = set(arguments[: len(shared)])
    before, after = [], []
    for e in equations:
        same = e.name not in NOT_HOISTED and all(v in fixed or v.number is not None for v in e.invars)
        (before if same else after).append(e)
        if same:
            fixed.update(e.outvars)
    read = {v for e in after for v in e.invars} | set(outputs)
    more = [v for e in before for v in e.outvars if v in read]
    constants = evaluate(g, before, more, dict(zip(arguments, shared, strict=False)))

    def step(inner: Graph, nodes: list[Nodes]) -> list[Nodes]:
        return evaluate(inner, after, outputs, dict(zip([*more, *arguments], nodes, strict=True)))

    return step, more, constants


NOT_HOISTED = {"scan", "while", "agent_map"}  # loops are hoisted only as a part of an enclosing loop
