# ruff: noqa: ARG001  every rule has the arguments graph and equation
"""Rules of elementwise primitives."""

from __future__ import annotations

import numpy as np

from colift.codegen.equations import Equation
from colift.codegen.graph import Graph, Nodes
from colift.codegen.interpret import check_integer, is_bool, is_integer, rule, select_case
from colift.codegen.jax_internals import UnsupportedPrimitive


@rule("stop_gradient", "copy", "device_put", "optimization_barrier")
def _same(g: Graph, eqn: Equation, *x: Nodes) -> list[Nodes]:
    return list(x)


@rule("add_any")
def _add_any(g: Graph, eqn: Equation, a: Nodes, b: Nodes) -> Nodes:
    return check_integer(g, eqn, g.map("add", a, b))


@rule("div")
def _div(g: Graph, eqn: Equation, a: Nodes, b: Nodes) -> Nodes:
    quotient = g.map("div", a, b)
    return check_integer(g, eqn, g.map("trunc", quotient)) if is_integer(eqn.invars[0]) else quotient


@rule("rem")
def _rem(g: Graph, eqn: Equation, a: Nodes, b: Nodes) -> Nodes:
    x, y = g.constant_values(a), g.constant_values(b)
    if x is not None and y is not None:
        with np.errstate(invalid="ignore"):  # division by zero
            return check_integer(g, eqn, g.constants(np.fmod(x, y)))
    return check_integer(g, eqn, g.map("fmod", a, b))


@rule("square")
def _square(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    return check_integer(g, eqn, g.map("mul", a, a))


@rule("rsqrt")
def _rsqrt(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    return g.map("div", g.constants(np.ones(())), g.map("sqrt", a))


@rule("logistic")
def _logistic(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    one = g.constants(np.ones(()))
    return g.map("div", one, g.map("add", one, g.map("exp", g.map("neg", a))))


@rule("integer_pow")
def _integer_pow(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    out = np.asarray(np.frompyfunc(lambda x: g.integer_pow(x, eqn.params["y"]), 1, 1)(a), dtype=np.int64)
    return check_integer(g, eqn, out)  # no intermediate integer exceeds the result, so one check suffices


@rule("pow")
def _pow(g: Graph, eqn: Equation, a: Nodes, b: Nodes) -> Nodes:
    def one(x: int, y: int) -> int:
        power = g.value(y)
        if power is not None and power == round(power) and abs(power) <= 32:
            return g.integer_pow(x, round(power))
        return g.make("pow", x, y)

    return np.asarray(np.frompyfunc(one, 2, 1)(a, b), dtype=np.int64)


@rule("sign")
def _sign(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    return g.map("sign", a)


@rule("round")
def _round(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    if eqn.params["rounding_method"].name == "TO_NEAREST_EVEN":
        return g.map("rint", a)
    half = g.constants(np.array(0.5))
    return g.map("mul", g.map("sign", a), g.map("floor", g.map("add", g.map("abs", a), half)))


@rule("clamp")
def _clamp(g: Graph, eqn: Equation, low: Nodes, x: Nodes, high: Nodes) -> Nodes:
    return g.map("min", g.map("max", x, low), high)


@rule("is_finite")
def _is_finite(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    return g.map("lt", g.map("abs", a), g.constants(np.array(np.inf)))


@rule("lt", "le", "gt", "ge", "eq", "ne")
def _compare(g: Graph, eqn: Equation, a: Nodes, b: Nodes) -> Nodes:
    a, b = g.map("to_number", a), g.map("to_number", b)
    name = eqn.name
    if name in ("gt", "ge"):
        a, b, name = b, a, {"gt": "lt", "ge": "le"}[name]
    return g.map(name, a, b)


@rule("and", "or", "not", "xor")
def _logic(g: Graph, eqn: Equation, *x: Nodes) -> Nodes:
    if not is_bool(eqn.invars[0]):
        raise UnsupportedPrimitive(f"codegen: bitwise '{eqn.name}' of integers is not supported")
    return g.map("logical_" + eqn.name, *x)


@rule("select_n")
def _select_n(g: Graph, eqn: Equation, index: Nodes, *cases: Nodes) -> Nodes:
    if is_bool(eqn.invars[0]):
        return g.map("select", index, cases[1], cases[0])
    return select_case(g, index, cases)


@rule("convert_element_type")
def _convert(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    to = eqn.outvars[0]
    if is_bool(to):
        return g.map("to_mask", a)
    if not is_integer(to) and to.aval.dtype != np.float64:
        raise UnsupportedPrimitive(f"codegen: arrays must be float64, integer or boolean, got {to.aval.dtype}")
    a, of = g.map("to_number", a), eqn.invars[0]
    if not is_integer(to) or is_bool(of) or of.aval.dtype == to.aval.dtype:
        return a
    return check_integer(g, eqn, a if is_integer(of) else g.map("trunc", a))
