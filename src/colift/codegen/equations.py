"""A jaxpr as one flat list of equations: calls are opened, so that what they hold can be arranged anew."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import jax
import jax.core
import numpy as np
from jax.extend import core, source_info_util

CALLS = {"jit", "custom_jvp_call", "custom_vjp_call", "remat2"}


@dataclass(frozen=True, eq=False)
class Value:
    """What an equation reads or makes; `number` where it is known now."""

    aval: Any
    number: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Equation:
    """One primitive applied, with the fields of JAX's own."""

    primitive: Any
    params: dict[str, Any]
    invars: list[Value]
    outvars: list[Value]
    source_location: str = ""  # in the user's code


def constant(number: Any, aval: Any = None) -> Value:
    """A value known now."""
    number = np.asarray(number)
    return Value(jax.core.ShapedArray(number.shape, number.dtype) if aval is None else aval, number)


def inline_calls(
    jaxpr: core.Jaxpr, args: Sequence[Value], source_location: str = ""
) -> tuple[list[Equation], list[Value]]:
    """The equations of a jaxpr applied to values (its constants first), and the values it returns."""
    env: dict[core.Var, Value] = dict(zip((*jaxpr.constvars, *jaxpr.invars), args, strict=True))

    def read(v: Any) -> Value:
        return constant(v.val, v.aval) if isinstance(v, core.Literal) else env[v]

    equations = []
    for eqn in jaxpr.eqns:
        inputs = [read(v) for v in eqn.invars]
        here = (
            source_info_util.summarize(eqn.source_info) or source_location
        )  # JAX's own functions know no source_location of the user's
        if eqn.primitive.name in CALLS or eqn.primitive.name == "native":
            inner = eqn.params["jaxpr"] if "jaxpr" in eqn.params else eqn.params["call_jaxpr"]
            if eqn.primitive.name == "native":
                inner = jax.make_jaxpr(functools.partial(evaluate_with_jax, jaxpr=inner))(*(v.aval for v in eqn.invars))
            if isinstance(inner, core.ClosedJaxpr):
                inputs = [*map(constant, inner.consts), *inputs]
                inner = inner.jaxpr
            more, outputs = inline_calls(inner, inputs, here)
            equations += more
        else:
            outputs = [Value(v.aval) for v in eqn.outvars]
            equations.append(Equation(eqn.primitive, eqn.params, inputs, outputs, here))
        env.update(zip(eqn.outvars, outputs, strict=True))
    return equations, [read(v) for v in jaxpr.outvars]


def evaluate_with_jax(*args: Any, jaxpr: core.ClosedJaxpr, threads: int = 1) -> list[Any]:  # noqa: ARG001  as the primitive's
    """The value of a native function by JAX: leading axes beyond its own are batches, of length one where shared."""
    f = core.jaxpr_as_fun(jaxpr)
    for axis in reversed(range(batch_axes(args, jaxpr))):
        f = _mapped(f, [np.shape(x)[axis] != 1 for x in args])
    return f(*args)


def _mapped(f: Callable[..., Any], own: Sequence[bool]) -> Callable[..., Any]:
    def g(*args: Any) -> Any:
        if not any(own):
            return [x[None] for x in f(*(a[0] for a in args))]
        return jax.vmap(f, in_axes=[0 if o else None for o in own])(
            *(a if o else a[0] for a, o in zip(args, own, strict=True))
        )

    return g


def batch_axes(args: Sequence[Any], jaxpr: core.ClosedJaxpr) -> int:
    """How many leading axes the arguments have beyond the function's own."""
    return next((np.ndim(a) - v.ndim for a, v in zip(args, jaxpr.in_avals, strict=True)), 0)


MOVING = {  # no statement of C
    "reshape", "squeeze", "transpose", "rev", "broadcast_in_dim", "iota", "slice", "split", "concatenate", "stack",
    "unstack", "tile", "pad", "convert_element_type", "gather", "dynamic_slice", "dynamic_update_slice", "scatter",
    "copy", "stop_gradient",
}  # fmt: skip


def statement_count(equations: Sequence[Any]) -> int:
    """About how many statements of C equations become."""
    total = 0
    for e in equations:
        name = e.primitive.name
        if inner := [*core.jaxprs_in_params(e.params)]:
            length = e.params["length"] if name == "scan" else e.outvars[0].aval.shape[0] if name == "agent_map" else 1
            total += length * sum(statement_count(jaxpr.eqns) for jaxpr in inner)
        elif name == "dot_general":
            (contracted, _), _ = e.params["dimension_numbers"]
            shape = e.invars[0].aval.shape
            total += math.prod(e.outvars[0].aval.shape) * math.prod(shape[k] for k in contracted)
        elif name.startswith("reduce"):
            total += math.prod(e.invars[0].aval.shape)
        elif name not in MOVING:
            total += sum(math.prod(v.aval.shape) for v in e.outvars)
    return total
