"""Flat list of the equations of a jaxpr, with nested calls inlined.

Inlining makes the equations of nested functions available to `loop_fusion`, which reorders them.
"""

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
    """Variable of an equation.

    Attributes:
        aval: Shape and type.
        number: Value, if it is known at compile time.
    """

    aval: Any
    number: np.ndarray | None = None


@dataclass(frozen=True, eq=False)
class Equation:
    """Application of a primitive, with the fields of `jax.extend.core.JaxprEqn`.

    Attributes:
        primitive: Primitive of JAX, or an object with a `name`.
        params: Parameters of the primitive.
        invars: Operands.
        outvars: Results.
        source_location: File and line in the user's code; "" if unknown.
    """

    primitive: Any
    params: dict[str, Any]
    invars: list[Value]
    outvars: list[Value]
    source_location: str = ""


def constant(number: Any, aval: Any = None) -> Value:
    """Make a value that is known at compile time.

    Args:
        number: Array or scalar.
        aval: Shape and type; default: those of `number`.

    Returns:
        The value.
    """
    number = np.asarray(number)
    return Value(jax.core.ShapedArray(number.shape, number.dtype) if aval is None else aval, number)


def inline_calls(
    jaxpr: core.Jaxpr, args: Sequence[Value], source_location: str = ""
) -> tuple[list[Equation], list[Value]]:
    """List the equations of a jaxpr applied to values.

    Args:
        jaxpr: Jaxpr; nested calls are inlined.
        args: Values of its constants, then of its arguments.
        source_location: Location of the enclosing equation, used where JAX reports none.

    Returns:
        The equations and the values of the outputs.
    """
    env: dict[core.Var, Value] = dict(zip((*jaxpr.constvars, *jaxpr.invars), args, strict=True))

    def read(v: Any) -> Value:
        return constant(v.val, v.aval) if isinstance(v, core.Literal) else env[v]

    equations = []
    for eqn in jaxpr.eqns:
        inputs = [read(v) for v in eqn.invars]
        # JAX reports no user location for its own functions
        here = source_info_util.summarize(eqn.source_info) or source_location
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
    """Evaluate a native function with JAX.

    Args:
        *args: Arguments; leading axes beyond those of the function are batch axes, of length one if shared.
        jaxpr: The function.
        threads: Not used; a parameter of the native primitive.

    Returns:
        The results.
    """
    f = core.jaxpr_as_fun(jaxpr)
    for axis in reversed(range(batch_axes(args, jaxpr))):
        f = _mapped(f, [np.shape(x)[axis] != 1 for x in args])
    return f(*args)


def _mapped(f: Callable[..., Any], mapped: Sequence[bool]) -> Callable[..., Any]:
    """Map `f` over the first axis of the arguments that own it; the others have length one there."""

    def g(*args: Any) -> Any:
        if not any(mapped):
            return [x[None] for x in f(*(a[0] for a in args))]
        return jax.vmap(f, in_axes=[0 if o else None for o in mapped])(
            *(a if o else a[0] for a, o in zip(args, mapped, strict=True))
        )

    return g


def batch_axes(args: Sequence[Any], jaxpr: core.ClosedJaxpr) -> int:
    """Count the leading axes of the arguments beyond those of the function.

    Args:
        args: Arguments, all with the same number of batch axes.
        jaxpr: The function.

    Returns:
        Number of batch axes.
    """
    return next((np.ndim(a) - v.ndim for a, v in zip(args, jaxpr.in_avals, strict=True)), 0)


LAYOUT_PRIMITIVES = {  # primitives that emit no C statements
    "reshape", "squeeze", "transpose", "rev", "broadcast_in_dim", "iota", "slice", "split", "concatenate", "stack",
    "unstack", "tile", "pad", "convert_element_type", "gather", "dynamic_slice", "dynamic_update_slice", "scatter",
    "copy", "stop_gradient",
}  # fmt: skip


def statement_count(equations: Sequence[Any]) -> int:
    """Estimate the number of C statements of unrolled equations.

    Args:
        equations: Equations of this module or of JAX.

    Returns:
        Approximate number of statements.
    """
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
        elif name not in LAYOUT_PRIMITIVES:
            total += sum(math.prod(v.aval.shape) for v in e.outvars)
    return total
