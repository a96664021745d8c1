"""Rules of sums, products, extrema, cumulative operations and tensor contractions."""

from __future__ import annotations

import functools
import itertools
import math
from collections.abc import Callable

import numpy as np

from colift.codegen.equations import Equation
from colift.codegen.graph import Graph, Nodes
from colift.codegen.interpret import check_integer, rule


def _step(g: Graph, eqn: Equation, op: str) -> Callable[[Nodes, Nodes], Nodes]:
    """Return an operation of two operands whose integer results are range-checked."""
    return lambda x, y: check_integer(g, eqn, g.map(op, x, y))


REDUCE = {  # operation, and its identity element, the reduction of an empty axis
    "reduce_sum": ("add", 0.0),
    "reduce_prod": ("mul", 1.0),
    "reduce_max": ("max", -np.inf),
    "reduce_min": ("min", np.inf),
    "reduce_and": ("logical_and", True),
    "reduce_or": ("logical_or", False),
}


@rule(*REDUCE)
def _reduce(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    op, empty = REDUCE[eqn.name]
    for axis in sorted(eqn.params["axes"], reverse=True):
        if a.shape[axis] == 0:
            a = np.broadcast_to(g.constants(np.asarray(empty)), a.shape[:axis] + a.shape[axis + 1 :])
        else:
            a = functools.reduce(_step(g, eqn, op), np.moveaxis(a, axis, 0))
    return np.asarray(a)


CUMULATIVE = {"cumsum": "add", "cumprod": "mul", "cummax": "max", "cummin": "min"}


@rule(*CUMULATIVE)
def _cumulative(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    axis, step = eqn.params["axis"], -1 if eqn.params["reverse"] else 1
    rows = np.moveaxis(a, axis, 0)[::step]
    out = itertools.accumulate(rows, _step(g, eqn, CUMULATIVE[eqn.name]))
    return np.moveaxis(np.stack(list(out))[::step], 0, axis)


@rule("argmax", "argmin")
def _argmax(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    (axis,) = eqn.params["axes"]
    rows = np.moveaxis(g.map("to_number", a), axis, 0)
    best, where = rows[0], np.broadcast_to(g.constants(np.array(0.0)), rows[0].shape)
    for k, row in enumerate(rows[1:], start=1):
        is_better = g.map("lt", best, row) if eqn.name == "argmax" else g.map("lt", row, best)
        first_nan = g.map("logical_and", g.map("ne", row, row), g.map("eq", best, best))
        better = g.map("logical_or", is_better, first_nan)
        best = g.map("select", better, row, best)
        where = g.map("select", better, g.constants(np.array(float(k))), where)
    return where


@rule("dot_general")
def _dot_general(g: Graph, eqn: Equation, a: Nodes, b: Nodes) -> Nodes:
    (ca, cb), (ba, bb) = eqn.params["dimension_numbers"]
    fa = [k for k in range(a.ndim) if k not in (*ca, *ba)]
    fb = [k for k in range(b.ndim) if k not in (*cb, *bb)]
    batch = [a.shape[k] for k in ba]
    out = (*batch, *(a.shape[k] for k in fa), *(b.shape[k] for k in fb))
    inner = math.prod(a.shape[k] for k in ca)
    left = a.transpose([*ba, *fa, *ca]).reshape(*batch, math.prod(a.shape[k] for k in fa), 1, inner)
    right = b.transpose([*bb, *fb, *cb]).reshape(*batch, 1, math.prod(b.shape[k] for k in fb), inner)
    if inner == 0:
        return np.broadcast_to(g.constants(np.zeros(())), out)
    add, mul = _step(g, eqn, "add"), _step(g, eqn, "mul")
    products = (mul(left[..., k], right[..., k]) for k in range(inner))
    return functools.reduce(add, products).reshape(out)
