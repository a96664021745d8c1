"""Rules of slices, gathers and scatters.

Constant indices permute node arrays and emit no code. Indices that are computed at run time become blocks that read or
write windows of an array.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from colift.codegen.blocks import Read, Window, Write
from colift.codegen.equations import Equation
from colift.codegen.graph import INTEGER_RANGES, Graph, Nodes
from colift.codegen.interpret import check_integer, is_integer, rule


def _flat(shape: Sequence[int], coordinates: Sequence[np.ndarray]) -> np.ndarray:
    """Convert coordinates to indices of the flat array."""
    strides = [math.prod(shape[k + 1 :]) for k in range(len(shape))]
    return np.asarray(sum((c * s for c, s in zip(coordinates, strides, strict=True)), np.zeros((), dtype=np.int64)))


def _window(
    shape: Sequence[int],
    points: tuple[int, ...],
    index_map: Sequence[int | np.integer],
    window: Sequence[int],
    dropped: Sequence[int | np.integer],
    batching: Sequence[tuple[int | np.integer, int | np.integer]],
    *,
    drops: bool,
) -> Window:
    """Describe the windows for indices that are unknown at compile time: the windows at index zero, and the strides."""
    zero = [np.zeros(points, dtype=np.int64) for _ in index_map]
    coordinates, _ = _windows(shape, zero, index_map, window, dropped, batching, points)
    at = np.broadcast_to(_flat(shape, coordinates), (*points, *coordinates[0].shape[len(points) :])) if shape else 0
    at = np.asarray(at).reshape(math.prod(points), -1)
    return Window(
        base=at[:, 0],
        offset=at[0] - at[0, 0],
        stride=tuple(math.prod(shape[int(k) + 1 :]) for k in index_map),
        max_index=tuple(shape[int(k)] - window[int(k)] for k in index_map),
        drops=drops,
    )


def _read(g: Graph, a: Nodes, indices: Nodes, window: Window, fill_value: float) -> Nodes:
    """Add a block that reads windows of an array; return one row per window."""
    (out,) = g.block(Read, [a, indices], [window.base.size * window.offset.size], window=window, fill_value=fill_value)
    return out.reshape(window.base.size, window.offset.size)


@rule("dynamic_slice")
def _dynamic_slice(g: Graph, eqn: Equation, a: Nodes, *start: Nodes) -> Nodes:
    sizes = eqn.params["slice_sizes"]
    at = np.array([int(i) for i in start], dtype=np.int64)
    numbers = g.constant_values(at)
    if numbers is not None:
        low = np.clip(numbers, 0, np.subtract(a.shape, sizes)).astype(int)
        return a[tuple(slice(i, i + size) for i, size in zip(low, sizes, strict=True))]
    window = _window(a.shape, (1,), range(a.ndim), sizes, (), (), drops=False)
    out = _read(g, a, at, window, 0.0).reshape(sizes)
    return g.map("to_flag", out) if eqn.outvars[0].aval.dtype == bool else out


@rule("dynamic_update_slice")
def _dynamic_update_slice(g: Graph, eqn: Equation, a: Nodes, update: Nodes, *start: Nodes) -> Nodes:
    if not update.size:
        return a
    at = np.array([int(i) for i in start], dtype=np.int64)
    numbers = g.constant_values(at)
    if numbers is not None:
        low = np.clip(numbers, 0, np.subtract(a.shape, update.shape)).astype(int)
        out = a.copy()
        out[tuple(slice(i, i + size) for i, size in zip(low, update.shape, strict=True))] = update
        return out
    window = _window(a.shape, (1,), range(a.ndim), update.shape, (), (), drops=False)
    return _write(g, eqn, a, at, update, window, "")


def _write(g: Graph, eqn: Equation, a: Nodes, at: Nodes, updates: Nodes, window: Window, reduction: str) -> Nodes:
    """Add a block that writes windows of an array, one row of `updates` per window; return the new array."""
    out = eqn.outvars[0]
    check = out.aval.dtype.name if reduction in ("add", "mul") and is_integer(out) else ""
    assert not check or check in INTEGER_RANGES
    inputs = [a, at, updates]
    (new,) = g.block(Write, inputs, [a.size], window=window, reduction=reduction, check=check)
    return (g.map("to_flag", new) if out.aval.dtype == bool else new).reshape(a.shape)


def _windows(
    shape: Sequence[int],
    index: Sequence[np.ndarray],
    index_map: Sequence[int | np.integer],
    window: Sequence[int],
    dropped: Sequence[int | np.integer],
    batching: Sequence[tuple[int | np.integer, int | np.integer]],
    points: tuple[int, ...],
) -> tuple[list[np.ndarray], np.ndarray]:
    """Compute the operand coordinates of all windows of a gather or scatter, and whether each window fits.

    Args:
        shape: Shape of the operand.
        index: Index of every window, one array for each entry of `index_map`.
        index_map: Operand axis of each index.
        window: Size of a window along each operand axis.
        dropped: Operand axes that the result does not have.
        batching: Pairs of operand axis and batch axis of the indices.
        points: Shape of the set of windows.

    Returns:
        One array per operand axis, with the axes `(points..., window...)`, and a mask of the windows that fit.
    """
    start = [np.zeros(points, dtype=np.int64) for _ in shape]
    for axis, column in zip(index_map, index, strict=True):
        start[axis] = column
    for axis, batch in batching:
        start[axis] = np.broadcast_to(
            np.arange(points[batch]).reshape([-1 if k == batch else 1 for k in range(len(points))]), points
        )
    fits = np.ones(points, dtype=bool)
    kept = [axis for axis in range(len(shape)) if axis not in dropped]
    coordinates = []
    for axis, (size, width) in enumerate(zip(shape, window, strict=True)):
        fits &= (start[axis] >= 0) & (start[axis] <= size - width)
        low = np.clip(start[axis], 0, size - width).reshape((*points, *[1] * len(kept)))
        if axis in kept:
            low = low + np.arange(width).reshape([-1 if k == axis else 1 for k in kept])
        coordinates.append(np.broadcast_to(low, (*points, *[window[k] for k in kept])))
    return coordinates, fits


@rule("gather")
def _gather(g: Graph, eqn: Equation, a: Nodes, indices: Nodes) -> Nodes:
    p = eqn.params
    d, sizes, fill = p["dimension_numbers"], p["slice_sizes"], p["mode"].name == "FILL_OR_DROP"
    points = indices.shape[:-1]
    batching = [*zip(d.operand_batching_dims, d.start_indices_batching_dims, strict=True)]
    dropped = (*d.collapsed_slice_dims, *d.operand_batching_dims)
    order = [k for k in range(eqn.outvars[0].aval.ndim) if k not in d.offset_dims] + list(d.offset_dims)
    kept = [sizes[k] for k in range(a.ndim) if k not in dropped]
    numbers = g.constant_values(indices)
    fill_value = _fill_value(eqn) if fill else 0.0
    if numbers is None:
        window = _window(a.shape, points, d.start_index_map, sizes, dropped, batching, drops=fill)
        out = _read(g, a, indices, window, float(fill_value)).reshape((*points, *kept))
        out = g.map("to_flag", out) if eqn.outvars[0].aval.dtype == bool else out
    else:
        columns = [numbers[..., k].astype(np.int64) for k in range(indices.shape[-1])]
        coordinates, fits = _windows(a.shape, columns, d.start_index_map, sizes, dropped, batching, points)
        out = np.asarray(a[tuple(coordinates)])
        if fill and not fits.all():
            fits = fits.reshape((*points, *[1] * len(kept)))
            out = np.where(fits, out, g.constants(np.asarray(fill_value, eqn.outvars[0].aval.dtype)))
    return out.transpose(np.argsort(order))


def _fill_value(eqn: Equation) -> Any:
    """Return the value that a gather returns for a window that does not fit."""
    given, dtype = eqn.params["fill_value"], eqn.outvars[0].aval.dtype
    if given is not None:
        return given
    if not np.issubdtype(dtype, np.integer):
        return np.nan if np.issubdtype(dtype, np.floating) else True
    info = np.iinfo(dtype)
    return int(info.max if info.min == 0 else info.min)


SCATTER = {"scatter": "", "scatter-add": "add", "scatter-mul": "mul", "scatter-min": "min", "scatter-max": "max"}


@rule(*SCATTER)
def _scatter(g: Graph, eqn: Equation, a: Nodes, indices: Nodes, updates: Nodes) -> Nodes:
    if not updates.size:
        return a
    p = eqn.params
    d, op = p["dimension_numbers"], SCATTER[eqn.name]
    points, drops = indices.shape[:-1], p["mode"].name != "CLIP"
    updates = updates.transpose(
        [k for k in range(updates.ndim) if k not in d.update_window_dims] + list(d.update_window_dims)
    )
    dropped = (*d.inserted_window_dims, *d.operand_batching_dims)
    batching = [*zip(d.operand_batching_dims, d.scatter_indices_batching_dims, strict=True)]
    widths = iter(updates.shape[len(points) :])
    sizes = [1 if axis in dropped else next(widths) for axis in range(a.ndim)]
    numbers = g.constant_values(indices)
    if numbers is None:
        where = d.scatter_dims_to_operand_dims
        window = _window(a.shape, points, where, sizes, dropped, batching, drops=drops)
        return _write(g, eqn, a, indices, updates, window, op)
    columns = [numbers[..., k].astype(np.int64) for k in range(indices.shape[-1])]
    coordinates, fits = _windows(a.shape, columns, d.scatter_dims_to_operand_dims, sizes, dropped, batching, points)
    out = a.copy()
    for point in np.ndindex(updates.shape):
        if fits[point[: len(points)]] or not drops:
            where = tuple(int(c[point]) for c in coordinates)
            one = updates[point]
            out[where] = check_integer(g, eqn, g.map(op, out[where], one)) if op else one
    return out
