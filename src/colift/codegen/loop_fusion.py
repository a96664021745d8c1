"""Loop fusion: form loops over agents and over the axes of large arrays, as few as dependences allow.

Unrolled code would grow with the number of agents and with the size of arrays. Equations that act at each index of an
axis independently, or reduce the axis, become the body of one loop. Reductions over few agents stay outside; they
separate two loops. Loop bodies are treated in the same way, so loops nest.

References:
    Kennedy, McKinley, *Maximizing loop parallelism and improving data locality via loop fusion and distribution*, 1993.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace

from colift.codegen.axis_analysis import AxisForm, operand_axis_form, reduced_axis_form, result_axis_form
from colift.codegen.equations import Equation, Value, inline_calls, statement_count
from colift.codegen.jax_internals import abstract_array

LARGE_EQUATION = 1000  # statements; a larger equation becomes a loop if it has an axis of MIN_LOOP_LENGTH or more
MIN_LOOP_LENGTH = 16  # indices; shorter axes are unrolled


def find_axis_forms(equations: Sequence[Equation]) -> dict[Equation, AxisForm]:
    """Find the equations that become parts of loops.

    The search starts at maps over agents and at large equations. It continues along shared values as long as an
    equation acts on the same axis.

    Args:
        equations: Equations in order of evaluation.

    Returns:
        The form at one index for each equation that becomes a part of a loop.
    """
    users = defaultdict(list)
    for e in equations:
        for v in (*e.invars, *e.outvars):
            users[v].append(e)
    found: dict[Equation, AxisForm] = {}
    axes: dict[Value, int] = {}  # loop axis of each value
    pending: list[Value] = []

    def add(e: Equation, form: AxisForm) -> None:
        mapped = [*zip(e.invars, form.operands, strict=True), *zip(e.outvars, form.results, strict=bool(form.results))]
        mapped = [(v, a) for v, a in mapped if a is not None and v.aval.shape[a] == form.length and v.number is None]
        if e in found or any(axes.get(v, a) != a for v, a in mapped):
            return
        found[e] = form
        for v, a in mapped:
            if v not in axes:
                axes[v] = a
                pending.append(v)

    def spread() -> None:
        while pending:
            v = pending.pop()
            for e in users[v]:
                if e not in found and (form := _axis_form(e, v, axes[v])) is not None:
                    add(e, form)

    for e in equations:
        if e.name == "agent_map" and (form := result_axis_form(e, 0)) is not None:
            add(e, form)
    spread()
    for e in sorted(equations, key=lambda e: -statement_count([e])):
        if e not in found and statement_count([e]) > LARGE_EQUATION and (form := _longest_axis_form(e)) is not None:
            add(e, form)
            spread()
    return found


def _axis_form(e: Equation, v: Value, axis: int) -> AxisForm | None:
    """Rewrite an equation along an axis of one of its values; short reductions are excluded."""
    if any(v is out for out in e.outvars):
        return result_axis_form(e, axis)
    form = operand_axis_form(e, next(k for k, x in enumerate(e.invars) if x is v), axis)
    return None if form is None or (form.reduction and form.length < MIN_LOOP_LENGTH) else form


def _longest_axis_form(e: Equation) -> AxisForm | None:
    """Rewrite an equation along its longest suitable axis; axes of results take precedence over reduced axes."""
    forms = [result_axis_form(e, k) for k in range(max((v.aval.ndim for v in e.outvars), default=0))]
    forms += [reduced_axis_form(e, k, a) for k, v in enumerate(e.invars) for a in range(v.aval.ndim)]
    return max(
        (f for f in forms if f is not None and f.length >= MIN_LOOP_LENGTH), key=lambda f: f.length, default=None
    )


def fuse_loops(equations: Sequence[Equation], outputs: Sequence[Value]) -> list[Equation]:
    """Replace equations by loops, as few as their dependences allow.

    Args:
        equations: Equations in order of evaluation.
        outputs: Values that are used after the equations.

    Returns:
        Equivalent equations in order of evaluation; a loop is an equation with the name `loop`.
    """
    forms = find_axis_forms(equations)
    if not forms:
        return list(equations)
    pending = {v for e in equations for v in e.outvars}
    left, steps = list(equations), []
    while left:
        rest = []
        for e in left:
            if e in forms or not pending.isdisjoint(e.invars):
                rest.append(e)
            else:
                steps.append(e)
                pending.difference_update(e.outvars)
        left = rest
        if left:
            group = list(_loop_members(left, forms, pending))
            fused = set(group)
            left = [e for e in left if e not in fused]
            used = {v for e in left for v in e.invars} | set(outputs)
            steps.append(_loop([(e, forms[e]) for e in group], used))
            pending.difference_update(v for e in group for v in e.outvars)
    return steps


def _loop_members(left: Sequence[Equation], forms: dict[Equation, AxisForm], pending: set[Value]) -> Iterator[Equation]:
    """Iterate over the equations that can run in the same loop as the first equation that is ready."""
    ready = (e for e in left if e in forms and pending.isdisjoint(e.invars))
    length = forms[next(ready)].length
    made: dict[Value, int] = {}
    for e in left:
        form = forms.get(e)
        if form is not None and form.length == length:
            known = (v not in pending or made.get(v, -1) == a for v, a in zip(e.invars, form.operands, strict=True))
            if all(known):
                made.update(zip(e.outvars, form.results, strict=bool(form.results)))
                yield e


def _loop(group: Sequence[tuple[Equation, AxisForm]], used: set[Value]) -> Equation:
    """Make one loop of equations and their forms; `used` are the values that are used outside of the loop."""
    length = group[0][1].length
    inner: dict[tuple[Value, int | None], Value] = {}  # value inside the body, by loop axis
    inputs: list[tuple[Value, Value, int | None]] = []  # value outside, value inside, axis
    body: list[Equation] = []

    def less(v: Value, axis: int) -> Value:
        shape = v.aval.shape
        return Value(abstract_array((*shape[:axis], *shape[axis + 1 :]), v.aval.dtype))

    def read(v: Value, axis: int | None) -> Value:
        if axis is None and v.number is not None:
            return v
        if (v, axis) not in inner:
            only = axis is not None and v.aval.shape[axis] != length  # lax broadcasts axes of length one
            inner_value = Value(v.aval) if axis is None or only else less(v, axis)
            inputs.append((v, inner_value, None if only else axis))
            if only:
                one = less(v, axis)
                body.append(Equation("squeeze", {"dimensions": (axis,)}, [inner_value], [one]))
                inner_value = one
            inner[v, axis] = inner_value
        return inner[v, axis]

    made: dict[Value, tuple[Value, int | str]] = {}  # value inside, and its axis or reduction
    for e, form in group:
        operands = [read(v, axis) for v, axis in zip(e.invars, form.operands, strict=True)]
        merges = [form.reduction] * len(e.outvars) if form.reduction else form.results
        if e.name == "agent_map":
            more, results = inline_calls(e.params["jaxpr"], operands, e.source_location)
            body += more
        else:
            results = [
                Value(v.aval) if isinstance(a, str) else less(v, a) for v, a in zip(e.outvars, merges, strict=True)
            ]
            body.append(replace(e, params=form.params, invars=operands, outvars=results))
        for v, inner_value, merge in zip(e.outvars, results, merges, strict=True):
            made[v] = inner_value, merge
            if not isinstance(merge, str):
                inner[v, merge] = inner_value
    outputs = [v for e, _ in group for v in e.outvars if v in used]
    params = {
        "length": length,
        "axes": tuple(axis for *_, axis in inputs),
        "body": body,
        "arguments": [inside for _, inside, _ in inputs],
        "results": [made[v][0] for v in outputs],
        "merges": tuple(made[v][1] for v in outputs),
    }
    return Equation("loop", params, [v for v, *_ in inputs], outputs, group[0][0].source_location)
