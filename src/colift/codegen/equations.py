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
import numpy as np

from colift.codegen import jax_internals
from colift.codegen.jax_internals import Program, programs_in


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
    """Application of a primitive.

    Attributes:
        name: Name of the primitive.
        params: Parameters of the primitive.
        invars: Operands.
        outvars: Results.
        source_location: File and line in the user's code; "" if unknown.
        evaluate: Evaluates the equation with JAX; None for equations that do not come from JAX.
    """

    name: str
    params: dict[str, Any]
    invars: list[Value]
    outvars: list[Value]
    source_location: str = ""
    evaluate: Callable[..., list[Any]] | None = None


def constant(number: Any, aval: Any = None) -> Value:
    """Make a value that is known at compile time.

    Args:
        number: Array or scalar.
        aval: Shape and type; default: those of `number`.

    Returns:
        The value.
    """
    number = np.asarray(number)
    return Value(jax_internals.abstract_array(number.shape, number.dtype) if aval is None else aval, number)


def inline_calls(
    program: Program, args: Sequence[Value], source_location: str = ""
) -> tuple[list[Equation], list[Value]]:
    """List the equations of a program applied to values.

    Args:
        program: Program; nested calls are inlined.
        args: Values of its inputs that are not constants.
        source_location: Location of the enclosing equation, used where JAX reports none.

    Returns:
        The equations and the values of the outputs.
    """
    values = [*map(constant, program.constants), *args]
    env: dict[Any, Value] = dict(zip(program.variables, values, strict=True))

    def read(v: Any) -> Value:
        return constant(v.val, v.aval) if jax_internals.is_literal(v) else env[v]

    equations = []
    for e in program.equations:
        inputs = [read(v) for v in e.invars]
        here = e.source_location or source_location  # JAX reports no user location for its own functions
        if (inner := _called(e)) is not None:
            more, outputs = inline_calls(inner, inputs, here)
            equations += more
        else:
            outputs = [Value(v.aval) for v in e.outvars]
            equations.append(Equation(e.name, e.params, inputs, outputs, here, e.evaluate))
        env.update(zip(e.outvars, outputs, strict=True))
    return equations, [read(v) for v in program.results]


def _called(e: jax_internals.TracedEquation) -> Program | None:
    """Return the program that an equation calls; None if it is not a call."""
    if e.name == "native":
        f = functools.partial(evaluate_with_jax, jaxpr=e.eqn.params["jaxpr"])
        return Program.from_jaxpr(jax.make_jaxpr(f)(*(v.aval for v in e.invars)))
    return jax_internals.called_program(e)


def evaluate_with_jax(*args: Any, jaxpr: Any, threads: int = 1) -> list[Any]:  # noqa: ARG001  as the primitive's
    """Evaluate a native function with JAX.

    Args:
        *args: Arguments; leading axes beyond those of the function are batch axes, of length one if shared.
        jaxpr: The function, a jaxpr of JAX with its constants.
        threads: Not used; a parameter of the native primitive.

    Returns:
        The results.
    """
    f = jax_internals.as_function(jaxpr)
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


def batch_axes(args: Sequence[Any], jaxpr: Any) -> int:
    """Count the leading axes of the arguments beyond those of the function.

    Args:
        args: Arguments, all with the same number of batch axes.
        jaxpr: The function, a jaxpr of JAX with its constants.

    Returns:
        Number of batch axes.
    """
    return next((np.ndim(a) - v.ndim for a, v in zip(args, Program.from_jaxpr(jaxpr).inputs, strict=True)), 0)


LAYOUT_PRIMITIVES = {  # primitives that emit no C statements
    "reshape", "squeeze", "transpose", "rev", "broadcast_in_dim", "iota", "slice", "split", "concatenate", "stack",
    "unstack", "tile", "pad", "convert_element_type", "gather", "dynamic_slice", "dynamic_update_slice", "scatter",
    "copy", "stop_gradient",
}  # fmt: skip


def statement_count(equations: Sequence[Any]) -> int:
    """Estimate the number of C statements of unrolled equations.

    Args:
        equations: Equations of this module or of a program.

    Returns:
        Approximate number of statements.
    """
    total = 0
    for e in equations:
        name = e.name
        if inner := [*programs_in(e.params)]:
            length = e.params["length"] if name == "scan" else e.outvars[0].aval.shape[0] if name == "agent_map" else 1
            total += length * sum(statement_count(program.equations) for program in inner)
        elif name == "dot_general":
            (contracted, _), _ = e.params["dimension_numbers"]
            shape = e.invars[0].aval.shape
            total += math.prod(e.outvars[0].aval.shape) * math.prod(shape[k] for k in contracted)
        elif name.startswith("reduce"):
            total += math.prod(e.invars[0].aval.shape)
        elif name not in LAYOUT_PRIMITIVES:
            total += sum(math.prod(v.aval.shape) for v in e.outvars)
    return total
