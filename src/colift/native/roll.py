"""Loops over agents: what acts on each row of an array alone is gathered around every `over` into one loop.

Code around an `over` works on whole arrays, agents first. Unrolled, it would grow with the team; so equations that
keep the leading axis are taken by the row, and all that can run in one pass over the agents becomes one loop. What
joins agents (a sum over them) comes between two loops.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any

import jax
import jax.core
from jax.extend.core import primitives

from colift.native.equations import Equation, Value, flatten
from colift.native.graph import FOLD, LIBM

ELEMENTWISE = {
    *LIBM, *FOLD, "add_any", "rem", "square", "rsqrt", "logistic", "integer_pow", "sign", "round", "clamp", "is_finite",
    "lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not", "xor", "select_n", "convert_element_type",
    "stop_gradient", "copy",
}  # fmt: skip
REDUCE = {"reduce_sum", "reduce_prod", "reduce_max", "reduce_min", "reduce_and", "reduce_or", "argmax", "argmin"}

LOOP = SimpleNamespace(name="loop")


@dataclass(frozen=True)
class Rows:
    """How an equation acts on one row: its parameters then, and for each operand whether it is a `row`, the `whole`
    array, or the `only` row of one that has just one.
    """

    length: int
    params: dict[str, Any]
    operands: tuple[str, ...]


def by_row(e: Equation) -> Rows | None:
    """The equation on one row of its leading axis, None if it mixes rows."""
    p, name = e.params, e.primitive.name
    inputs, outputs = [v.aval.shape for v in e.invars], [v.aval.shape for v in e.outvars]
    if name == "over":
        return Rows(outputs[0][0], p, tuple("row" if m else "whole" for m in p["mapped"]))
    if not outputs or not all(outputs) or len({shape[0] for shape in outputs}) != 1:
        return None
    n = outputs[0][0]
    if name in ELEMENTWISE:
        kinds = tuple("whole" if not shape else "row" if shape[0] == n else "only" for shape in inputs)
        return Rows(n, p, kinds)  # lax stretches axes of length one
    if name == "broadcast_in_dim":
        dims = p["broadcast_dimensions"]
        lead = tuple(dims[:1]) == (0,)  # dimensions may be NumPy's integers
        operand = "whole" if not lead else "row" if inputs[0][0] == n else "only"
        params = {**p, "shape": p["shape"][1:], "broadcast_dimensions": tuple(d - 1 for d in dims[lead:])}
        return Rows(n, params, (operand,))
    if name == "dot_general":
        return _dot(e, n)
    if not inputs or any(shape[:1] != (n,) for shape in inputs[: 1 if name == "pad" else None]):
        return None
    params = _params(name, p, n)
    return (
        None if params is None else Rows(n, params, ("row", *["whole" if name == "pad" else "row"] * (len(inputs) - 1)))
    )


def _params(name: str, p: dict[str, Any], n: int) -> dict[str, Any] | None:
    """Parameters of shape operations and reductions on one row; all operands have the leading axis."""

    def less(axes: Sequence[int]) -> tuple[int, ...]:
        return tuple(a - 1 for a in axes)

    match name:
        case "reshape" if p["dimensions"] is None:
            return {**p, "new_sizes": p["new_sizes"][1:]}
        case "squeeze" | "rev" if 0 not in p["dimensions"]:
            return {**p, "dimensions": less(p["dimensions"])}
        case "transpose" if p["permutation"][0] == 0:
            return {**p, "permutation": less(p["permutation"][1:])}
        case "slice" if (p["start_indices"][0], p["limit_indices"][0], (p["strides"] or (1,))[0]) == (0, n, 1):
            cut = ("start_indices", "limit_indices", "strides")
            return {**p, **{key: p[key] and p[key][1:] for key in cut}}
        case "concatenate" if p["dimension"] != 0:
            return {**p, "dimension": p["dimension"] - 1}
        case "stack" | "unstack" | "split" | "cumsum" | "cumprod" | "cummax" | "cummin" if p["axis"] != 0:
            return {**p, "axis": p["axis"] - 1}
        case "pad" if tuple(p["padding_config"][0]) == (0, 0, 0):
            return {**p, "padding_config": p["padding_config"][1:]}
        case _ if name in REDUCE and 0 not in p["axes"]:
            return {**p, "axes": less(p["axes"])}
    return None


def _dot(e: Equation, n: int) -> Rows | None:
    """A product with the leading axis in its batch, or free in its left operand alone."""
    (ca, cb), (ba, bb) = e.params["dimension_numbers"]
    shapes = [v.aval.shape for v in e.invars]
    less = lambda axes: tuple(a - 1 for a in axes)  # noqa: E731
    if ba and ba[0] == bb[0] == 0:
        numbers, operands = ((less(ca), less(cb)), (less(ba[1:]), less(bb[1:]))), ("row", "row")
    elif not ba and 0 not in ca and shapes[0][0] == n:
        numbers, operands = ((less(ca), tuple(cb)), ((), ())), ("row", "whole")
    else:
        return None
    return Rows(n, {**e.params, "dimension_numbers": numbers}, operands)


def rolled(equations: Sequence[Equation]) -> dict[Equation, Rows]:
    """The `over`s, and the equations that are connected with them row by row."""
    forms = {e: form for e in equations if (form := by_row(e)) is not None}
    found: dict[Equation, Rows] = {}
    rowed: set[Value] = set()
    grows = True
    while grows:
        grows = False
        for e, form in forms.items():
            rows = [v for v, kind in zip(e.invars, form.operands, strict=True) if kind == "row"] + e.outvars
            if e not in found and (e.primitive.name == "over" or not rowed.isdisjoint(rows)):
                found[e] = form
                rowed.update(v for v in rows if v.number is None)
                grows = True
    return found


def roll(equations: Sequence[Equation], outputs: Sequence[Value]) -> list[Equation]:
    """The same computation with as few loops over agents as its dependences allow."""
    if not any(e.primitive.name == "over" for e in equations):
        return list(equations)
    forms = rolled(equations)
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
            group = list(_pass(left, forms, waiting))
            gone = set(group)
            left = [e for e in left if e not in gone]
            used = {v for e in left for v in e.invars} | set(outputs)
            steps.append(_loop([(e, forms[e]) for e in group], used))
            waiting.difference_update(v for e in group for v in e.outvars)
    return steps


def _pass(left: Sequence[Equation], forms: dict[Equation, Rows], waiting: set[Value]) -> Iterator[Equation]:
    """All that can run in one pass over the agents of the first loop that is left."""
    length = next(forms[e].length for e in left if e in forms)
    made: set[Value] = set()
    for e in left:
        form = forms.get(e)
        if form is not None and form.length == length:
            ready = (
                v not in waiting or (kind == "row" and v in made)
                for v, kind in zip(e.invars, form.operands, strict=True)
            )
            if all(ready):
                made.update(e.outvars)
                yield e


def _loop(group: Sequence[tuple[Equation, Rows]], used: set[Value]) -> Equation:
    """One loop of equations, taken by the row."""
    inner: dict[tuple[Value, str], Value] = {}  # what the body calls a value, by how it is read
    inputs: list[tuple[Value, Value, bool]] = []  # outside, inside, whether a row
    body: list[Equation] = []

    def read(v: Value, kind: str) -> Value:
        if v.number is not None and kind == "whole":
            return v
        if (v, kind) not in inner:
            shape = v.aval.shape[1:] if kind == "row" else v.aval.shape
            mine = Value(jax.core.ShapedArray(shape, v.aval.dtype))
            inputs.append((v, mine, kind == "row"))
            if kind == "only":
                row = Value(jax.core.ShapedArray(shape[1:], v.aval.dtype))
                body.append(Equation(primitives.squeeze_p, {"dimensions": (0,)}, [mine], [row]))
                mine = row
            inner[v, kind] = mine
        return inner[v, kind]

    for e, form in group:
        operands = [read(v, kind) for v, kind in zip(e.invars, form.operands, strict=True)]
        if e.primitive.name == "over":
            more, results = flatten(e.params["jaxpr"], operands, e.place)
            body += more
        else:
            results = [Value(jax.core.ShapedArray(v.aval.shape[1:], v.aval.dtype)) for v in e.outvars]
            body.append(replace(e, params=form.params, invars=operands, outvars=results))
        inner.update(((v, "row"), mine) for v, mine in zip(e.outvars, results, strict=True))
    outputs = [v for e, _ in group for v in e.outvars if v in used]
    params = {
        "length": group[0][1].length,
        "mapped": tuple(row for *_, row in inputs),
        "body": body,
        "arguments": [inside for _, inside, _ in inputs],
        "results": [inner[v, "row"] for v in outputs],
    }
    return Equation(LOOP, params, [v for v, *_ in inputs], outputs, group[0][0].place)
