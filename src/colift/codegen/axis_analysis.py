"""Axis analysis of jaxpr equations: rewrite an equation so that it acts at one index of an axis.

A rewrite exists if each index of a result's axis depends on one index of one axis of each operand. It also exists if
the equation reduces over an axis. `loop_fusion` forms loops from the rewritten equations.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from colift.codegen.equations import Equation
from colift.codegen.graph import FOLD, LIBM

ELEMENTWISE = {
    *LIBM, *FOLD, "add_any", "rem", "square", "rsqrt", "logistic", "integer_pow", "sign", "round", "clamp", "is_finite",
    "lt", "le", "gt", "ge", "eq", "ne", "and", "or", "not", "xor", "select_n", "convert_element_type",
    "stop_gradient", "copy",
}  # fmt: skip
REDUCTIONS = {
    "reduce_sum": "add", "reduce_prod": "mul", "reduce_max": "max", "reduce_min": "min", "reduce_and": "min",
    "reduce_or": "max",
}  # fmt: skip
REDUCE = {*REDUCTIONS, "argmax", "argmin"}
CUMULATIVE = {"cumsum", "cumprod", "cummax", "cummin"}


@dataclass(frozen=True)
class AxisForm:
    """Form of an equation at one index of an axis.

    Attributes:
        length: Length of the axis.
        params: Parameters of the equation at one index.
        operands: Axis of each operand; None if the operand is used whole.
        results: Axis of each result; empty for a reduction.
        reduction: Operation that combines the values of all indices; "" if the results have the axis.
    """

    length: int
    params: dict[str, Any]
    operands: tuple[int | None, ...]
    results: tuple[int, ...]
    reduction: str = ""


def _drop_axis(axes: Iterable[int | np.integer], axis: int) -> tuple[int, ...]:
    """Renumber axes after one of them is removed."""
    return tuple(int(a) - int(a > axis) for a in axes if a != axis)


def _drop_entry(shape: Sequence[Any], axis: int) -> tuple[Any, ...]:
    """Remove the entry of one axis."""
    return (*shape[:axis], *shape[axis + 1 :])


def result_axis_form(e: Equation, axis: int) -> AxisForm | None:
    """Rewrite an equation at one index of an axis of its results.

    Args:
        e: Equation.
        axis: Axis of every result.

    Returns:
        The form at one index; None if the equation mixes indices of the axis or its results differ in length.
    """
    shapes = [v.aval.shape for v in e.outvars]
    if any(len(s) <= axis for s in shapes) or len({s[axis] for s in shapes}) != 1 or e.name not in _AXIS_RULES:
        return None
    found = _AXIS_RULES[e.name](e, axis)
    if found is None:
        return None
    params, operands = found
    return AxisForm(shapes[0][axis], params, tuple(operands), (axis,) * len(shapes))


RuleResult = tuple[dict[str, Any], Sequence[int | None]] | None


def _elementwise(e: Equation, axis: int) -> RuleResult:
    return e.params, [axis if v.aval.shape else None for v in e.invars]


def _agent_map(e: Equation, axis: int) -> RuleResult:
    return (e.params, [0 if m else None for m in e.params["mapped"]]) if axis == 0 else None


def _broadcast(e: Equation, axis: int) -> RuleResult:
    dims = [int(d) for d in e.params["broadcast_dimensions"]]
    params = {**e.params, "shape": _drop_entry(e.params["shape"], axis), "broadcast_dimensions": _drop_axis(dims, axis)}
    return params, [dims.index(axis) if axis in dims else None]


def _reshape(e: Equation, axis: int) -> RuleResult:
    """Rule of reshape: an axis is kept if its length and the number of elements before it are kept."""
    before, after = e.invars[0].aval.shape, e.outvars[0].aval.shape
    lead = math.prod(after[:axis])
    same = [k for k, n in enumerate(before) if n == after[axis] and math.prod(before[:k]) == lead]
    if e.params["dimensions"] is not None or not same or 0 in before:
        return None
    return {**e.params, "new_sizes": _drop_entry(after, axis)}, same[-1:]


def _squeeze(e: Equation, axis: int) -> RuleResult:
    reduced_axes = [d % e.invars[0].aval.ndim for d in e.params["dimensions"]]
    operand_axis = [k for k in range(e.invars[0].aval.ndim) if k not in reduced_axes][axis]
    return {**e.params, "dimensions": _drop_axis(reduced_axes, operand_axis)}, [operand_axis]


def _transpose(e: Equation, axis: int) -> RuleResult:
    operand_axis = int(e.params["permutation"][axis])
    left = [p for k, p in enumerate(e.params["permutation"]) if k != axis]
    return {**e.params, "permutation": tuple(int(p) - (p > operand_axis) for p in left)}, [operand_axis]


def _rev(e: Equation, axis: int) -> RuleResult:
    mixes = axis in e.params["dimensions"]
    return None if mixes else ({**e.params, "dimensions": _drop_axis(e.params["dimensions"], axis)}, [axis])


def _slice(e: Equation, axis: int) -> RuleResult:
    p = e.params
    stride = p["strides"][axis] if p["strides"] else 1
    if (p["start_indices"][axis], p["limit_indices"][axis], stride) != (0, e.invars[0].aval.shape[axis], 1):
        return None
    cut = ("start_indices", "limit_indices", "strides")
    return {**p, **{key: p[key] and _drop_entry(p[key], axis) for key in cut}}, [axis]


def _other_axis_rule(name: str) -> Callable[[Equation, int], RuleResult]:
    """Return the rule of an equation that mixes the axis given by its parameter `name` and keeps all others."""

    def rows(e: Equation, axis: int) -> RuleResult:
        mixed = e.params[name]
        return None if mixed == axis else ({**e.params, name: mixed - (mixed > axis)}, [axis] * len(e.invars))

    return rows


def _stack(e: Equation, axis: int) -> RuleResult:
    new_axis = e.params["axis"]
    operand_axis = axis - (axis > new_axis)
    return (
        None
        if axis == new_axis
        else ({**e.params, "axis": new_axis - (new_axis > axis)}, [operand_axis] * len(e.invars))
    )


def _unstack(e: Equation, axis: int) -> RuleResult:
    reduced_axes = e.params["axis"]
    operand_axis = axis + (axis >= reduced_axes)
    return {**e.params, "axis": reduced_axes - (reduced_axes > operand_axis)}, [operand_axis]


def _pad(e: Equation, axis: int) -> RuleResult:
    config = e.params["padding_config"]
    return (
        ({**e.params, "padding_config": _drop_entry(config, axis)}, [axis, None])
        if tuple(config[axis]) == (0, 0, 0)
        else None
    )


def _reduce(e: Equation, axis: int) -> RuleResult:
    axes = e.params["axes"]
    operand_axis = [k for k in range(e.invars[0].aval.ndim) if k not in axes][axis]
    return {**e.params, "axes": _drop_axis(axes, operand_axis)}, [operand_axis]


def _dot(e: Equation, axis: int) -> RuleResult:
    """Rule of products: a batch axis, or an axis that only one operand has."""
    (ca, cb), (ba, bb) = e.params["dimension_numbers"]
    free = [
        [k for k in range(v.aval.ndim) if k not in (*c, *b)]
        for v, c, b in zip(e.invars, (ca, cb), (ba, bb), strict=True)
    ]
    if axis < len(ba):
        a, b = int(ba[axis]), int(bb[axis])
    elif axis < len(ba) + len(free[0]):
        a, b = free[0][axis - len(ba)], None
    else:
        a, b = None, free[1][axis - len(ba) - len(free[0])]
    return _without(e, a, b), [a, b]


def _without(e: Equation, a: int | None, b: int | None) -> dict[str, Any]:
    """Return the parameters of a product after one axis of each operand is removed."""
    (ca, cb), (ba, bb) = e.params["dimension_numbers"]
    left, right = (
        lambda axes, own=own: tuple(map(int, axes)) if own is None else _drop_axis(axes, own) for own in (a, b)
    )
    return {**e.params, "dimension_numbers": ((left(ca), right(cb)), (left(ba), right(bb)))}


_AXIS_RULES: dict[str, Callable[[Equation, int], RuleResult]] = {
    **dict.fromkeys(ELEMENTWISE, _elementwise),
    **dict.fromkeys(REDUCE, _reduce),
    **dict.fromkeys((*CUMULATIVE, "split"), _other_axis_rule("axis")),
    "agent_map": _agent_map, "broadcast_in_dim": _broadcast, "reshape": _reshape, "squeeze": _squeeze,
    "transpose": _transpose,
    "rev": _rev, "slice": _slice, "concatenate": _other_axis_rule("dimension"), "stack": _stack, "unstack": _unstack,
    "pad": _pad, "dot_general": _dot,
}  # fmt: skip


def reduced_axis_form(e: Equation, operand: int, axis: int) -> AxisForm | None:
    """Rewrite a reduction or contraction at one index of the axis that it reduces.

    Args:
        e: Equation.
        operand: Index of the operand.
        axis: Axis of the operand.

    Returns:
        The form at one index; None for other equations and for integers, whose partial sums are checked in order.
    """
    name = e.name
    integers = np.issubdtype(e.outvars[0].aval.dtype, np.integer)
    length = e.invars[operand].aval.shape[axis]
    if name in REDUCTIONS and axis in e.params["axes"] and (not integers or REDUCTIONS[name] in ("max", "min")):
        return AxisForm(length, {**e.params, "axes": _drop_axis(e.params["axes"], axis)}, (axis,), (), REDUCTIONS[name])
    if name == "dot_general" and not integers:
        contracted, _ = e.params["dimension_numbers"]
        if axis in contracted[operand]:
            at = list(map(int, contracted[operand])).index(axis)
            a, b = int(contracted[0][at]), int(contracted[1][at])
            return AxisForm(length, _without(e, a, b), (a, b), (), "add")
    return None


def operand_axis_form(e: Equation, operand: int, axis: int) -> AxisForm | None:
    """Rewrite an equation at one index of an axis of one of its operands.

    Args:
        e: Equation.
        operand: Index of the operand.
        axis: Axis of the operand.

    Returns:
        The form at one index; None if no rewrite exists.
    """
    for k in range(max((v.aval.ndim for v in e.outvars), default=0)):
        found = result_axis_form(e, k)
        if found is not None and found.operands[operand] == axis and e.invars[operand].aval.shape[axis] == found.length:
            return found
    return reduced_axis_form(e, operand, axis)
