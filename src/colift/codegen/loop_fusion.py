"""Loops over agents, and over the points of large arrays: what acts at each index of an axis alone is one loop.

Code around an `over` works on whole arrays, agents first. Unrolled, it would grow with the team; so would a product of
large arrays with their size. Equations that keep an axis, or reduce it, are taken one index at a time, and all that can
run in one pass over it becomes one loop. What reductions agents (a sum over them) comes between two loops, unless they are
many. Loops hold loops: a body is treated alike.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from types import SimpleNamespace

import jax
import jax.core
from jax.extend.core import primitives

from colift.codegen.axis_analysis import AxisForm, operand_axis_form, reduced_axis_form, result_axis_form
from colift.codegen.equations import Equation, Value, inline_calls, statement_count

LOOP = SimpleNamespace(name="loop")
LARGE_EQUATION = 1000  # statements: an equation of more is a loop if it has an axis that is MIN_LOOP_LENGTH
MIN_LOOP_LENGTH = 16


def find_axis_forms(equations: Sequence[Equation]) -> dict[Equation, AxisForm]:
    """The `over`s and the large equations, and all that is connected with them index by index."""
    neighbours = defaultdict(list)
    for e in equations:
        for v in (*e.invars, *e.outvars):
            neighbours[v].append(e)
    found: dict[Equation, AxisForm] = {}
    axes: dict[Value, int] = {}  # along which a value is gone through
    waiting: list[Value] = []

    def take(e: Equation, form: AxisForm) -> None:
        mine = [*zip(e.invars, form.operands, strict=True), *zip(e.outvars, form.results, strict=bool(form.results))]
        mine = [(v, a) for v, a in mine if a is not None and v.aval.shape[a] == form.length and v.number is None]
        if e in found or any(axes.get(v, a) != a for v, a in mine):
            return
        found[e] = form
        for v, a in mine:
            if v not in axes:
                axes[v] = a
                waiting.append(v)

    def spread() -> None:
        while waiting:
            v = waiting.pop()
            for e in neighbours[v]:
                if e not in found and (form := _axis_form(e, v, axes[v])) is not None:
                    take(e, form)

    for e in equations:
        if e.primitive.name == "agent_map" and (form := result_axis_form(e, 0)) is not None:
            take(e, form)
    spread()
    for e in sorted(equations, key=lambda e: -statement_count([e])):
        if e not in found and statement_count([e]) > LARGE_EQUATION and (form := _longest_axis_form(e)) is not None:
            take(e, form)
            spread()
    return found


def _axis_form(e: Equation, v: Value, axis: int) -> AxisForm | None:
    """The equation along an axis of one of its values; few indices are joined by no loop."""
    if any(v is out for out in e.outvars):
        return result_axis_form(e, axis)
    form = operand_axis_form(e, next(k for k, x in enumerate(e.invars) if x is v), axis)
    return None if form is None or (form.reduction and form.length < MIN_LOOP_LENGTH) else form


def _longest_axis_form(e: Equation) -> AxisForm | None:
    """The equation along the longest axis it can be taken along, of its results rather than its operands."""
    forms = [result_axis_form(e, k) for k in range(max((v.aval.ndim for v in e.outvars), default=0))]
    forms += [reduced_axis_form(e, k, a) for k, v in enumerate(e.invars) for a in range(v.aval.ndim)]
    return max(
        (f for f in forms if f is not None and f.length >= MIN_LOOP_LENGTH), key=lambda f: f.length, default=None
    )


def fuse_loops(equations: Sequence[Equation], outputs: Sequence[Value]) -> list[Equation]:
    """The same computation with as few loops as its dependences allow."""
    forms = find_axis_forms(equations)
    if not forms:
        return list(equations)
    waiting = {v for e in equations for v in e.outvars}
    left, steps = list(equations), []
    while left:
        rest = []
        for e in left:
            if e in forms or not waiting.isdisjoint(e.invars):
                rest.append(e)
            else:
                steps.append(e)
                waiting.difference_update(e.outvars)
        left = rest
        if left:
            group = list(_loop_members(left, forms, waiting))
            gone = set(group)
            left = [e for e in left if e not in gone]
            used = {v for e in left for v in e.invars} | set(outputs)
            steps.append(_loop([(e, forms[e]) for e in group], used))
            waiting.difference_update(v for e in group for v in e.outvars)
    return steps


def _loop_members(left: Sequence[Equation], forms: dict[Equation, AxisForm], waiting: set[Value]) -> Iterator[Equation]:
    """All that can run in one pass over the axis of the first loop that is left and ready."""
    ready = (e for e in left if e in forms and waiting.isdisjoint(e.invars))
    length = forms[next(ready)].length
    made: dict[Value, int] = {}
    for e in left:
        form = forms.get(e)
        if form is not None and form.length == length:
            known = (v not in waiting or made.get(v, -1) == a for v, a in zip(e.invars, form.operands, strict=True))
            if all(known):
                made.update(zip(e.outvars, form.results, strict=bool(form.results)))
                yield e


def _loop(group: Sequence[tuple[Equation, AxisForm]], used: set[Value]) -> Equation:
    """One loop of equations, taken one index at a time."""
    length = group[0][1].length
    inner: dict[tuple[Value, int | None], Value] = {}  # what the body calls a value, by the axis it is read along
    inputs: list[tuple[Value, Value, int | None]] = []  # outside, inside, the axis
    body: list[Equation] = []

    def less(v: Value, axis: int) -> Value:
        shape = v.aval.shape
        return Value(jax.core.ShapedArray((*shape[:axis], *shape[axis + 1 :]), v.aval.dtype))

    def read(v: Value, axis: int | None) -> Value:
        if axis is None and v.number is not None:
            return v
        if (v, axis) not in inner:
            only = axis is not None and v.aval.shape[axis] != length  # lax stretches axes of length one
            mine = Value(v.aval) if axis is None or only else less(v, axis)
            inputs.append((v, mine, None if only else axis))
            if only:
                one = less(v, axis)
                body.append(Equation(primitives.squeeze_p, {"dimensions": (axis,)}, [mine], [one]))
                mine = one
            inner[v, axis] = mine
        return inner[v, axis]

    made: dict[Value, tuple[Value, int | str]] = {}  # inside, and the axis or how it is joined
    for e, form in group:
        operands = [read(v, axis) for v, axis in zip(e.invars, form.operands, strict=True)]
        merges = [form.reduction] * len(e.outvars) if form.reduction else form.results
        if e.primitive.name == "agent_map":
            more, results = inline_calls(e.params["jaxpr"], operands, e.source_location)
            body += more
        else:
            results = [
                Value(v.aval) if isinstance(a, str) else less(v, a) for v, a in zip(e.outvars, merges, strict=True)
            ]
            body.append(replace(e, params=form.params, invars=operands, outvars=results))
        for v, mine, merge in zip(e.outvars, results, merges, strict=True):
            made[v] = mine, merge
            if not isinstance(merge, str):
                inner[v, merge] = mine
    outputs = [v for e, _ in group for v in e.outvars if v in used]
    params = {
        "length": length,
        "axes": tuple(axis for *_, axis in inputs),
        "body": body,
        "arguments": [inside for _, inside, _ in inputs],
        "results": [made[v][0] for v in outputs],
        "merges": tuple(made[v][1] for v in outputs),
    }
    return Equation(LOOP, params, [v for v, *_ in inputs], outputs, group[0][0].source_location)
