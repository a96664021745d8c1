# ruff: noqa: ARG001  every rule takes the graph and the equation
"""Rules of indexing: the positions are numbers, or a choice among all that are possible."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from colift.native.equations import Equation
from colift.native.graph import Graph, Nodes
from colift.native.interpret import UnsupportedPrimitive, choose, exact, rule


def _each(
    g: Graph, columns: Sequence[Nodes], ranges: Sequence[int], pick: Callable[[list[np.ndarray]], Nodes]
) -> Callable[[Sequence[Callable[[Nodes], Nodes]]], Nodes]:
    """`pick(indices)` for index columns of nodes; `spread[k]` brings column k to the shape of the result.

    A column that is not constant is tried at every value in its range, out of range being the nearest.
    """
    numbers = [g.numbers(column) for column in columns]
    free = [k for k, value in enumerate(numbers) if value is None]

    def build(spread: Sequence[Callable[[Nodes], Nodes]]) -> Nodes:
        def level(fixed: list[np.ndarray | None], rest: list[int]) -> Nodes:
            if not rest:
                return pick([np.asarray(v, dtype=np.int64) for v in fixed])
            k, *others = rest
            cases = []
            for value in range(ranges[k]):
                at = list(fixed)
                at[k] = np.full(columns[k].shape, value)
                cases.append(level(at, others))
            return choose(g, spread[k](columns[k]), cases)

        return level(list(numbers), free)

    return build


@rule("dynamic_slice")
def _dynamic_slice(g: Graph, eqn: Equation, a: Nodes, *start: Nodes) -> Nodes:
    sizes = eqn.params["slice_sizes"]
    room = [n - size for n, size in zip(a.shape, sizes, strict=True)]

    def pick(at: list[np.ndarray]) -> Nodes:
        low = [int(np.clip(i, 0, r)) for i, r in zip(at, room, strict=True)]
        return a[tuple(slice(i, i + size) for i, size in zip(low, sizes, strict=True))]

    return _each(g, start, [r + 1 for r in room], pick)([lambda i: i] * len(start))


@rule("dynamic_update_slice")
def _dynamic_update_slice(g: Graph, eqn: Equation, a: Nodes, update: Nodes, *start: Nodes) -> Nodes:
    room = [n - size for n, size in zip(a.shape, update.shape, strict=True)]

    def pick(at: list[np.ndarray]) -> Nodes:
        low = [int(np.clip(i, 0, r)) for i, r in zip(at, room, strict=True)]
        out = a.copy()
        out[tuple(slice(i, i + size) for i, size in zip(low, update.shape, strict=True))] = update
        return out

    return _each(g, start, [r + 1 for r in room], pick)([lambda i: i] * len(start))


def _windows(
    shape: Sequence[int],
    index: Sequence[np.ndarray],
    index_map: Sequence[int | np.integer],
    window: Sequence[int],
    dropped: Sequence[int | np.integer],
    batching: Sequence[tuple[int | np.integer, int | np.integer]],
) -> tuple[list[np.ndarray], np.ndarray]:
    """Operand coordinates `(points..., window...)` of all windows of a gather or scatter, and which fit inside.

    `window` has one size an operand axis, `dropped` are the axes that the result does not have.
    """
    points = index[0].shape if index else ()
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
    columns = [indices[..., k] for k in range(indices.shape[-1])]
    points = indices.ndim - 1
    batching = [*zip(d.operand_batching_dims, d.start_indices_batching_dims, strict=True)]
    dropped = (*d.collapsed_slice_dims, *d.operand_batching_dims)
    rank = eqn.outvars[0].aval.ndim
    order = [k for k in range(rank) if k not in d.offset_dims] + list(d.offset_dims)
    back = np.argsort(order)
    outside = g.constants(np.asarray(p["fill_value"] if fill else 0, eqn.outvars[0].aval.dtype))

    def pick(at: list[np.ndarray]) -> Nodes:
        coordinates, fits = _windows(a.shape, at, d.start_index_map, sizes, dropped, batching)
        out = np.asarray(a[tuple(coordinates)])
        if fill and not fits.all():
            out = np.where(fits.reshape(*fits.shape, *[1] * (out.ndim - points)), out, outside)
        return out.transpose(back)

    def spread(column: Nodes) -> Nodes:
        return np.broadcast_to(
            column.reshape((*column.shape, *[1] * (rank - points))),
            [eqn.outvars[0].aval.shape[k] for k in order],
        ).transpose(back)

    ranges = [a.shape[axis] - sizes[axis] + 1 for axis in d.start_index_map]
    out = _each(g, columns, ranges, pick)([spread] * len(columns))
    if fill:
        for column, count in zip(columns, ranges, strict=True):
            if g.numbers(column) is None:
                low, high = g.constants(np.array(0.0)), g.constants(np.array(count - 1.0))
                inside = g.map("logical_and", g.map("le", low, column), g.map("le", column, high))
                out = g.map("select", spread(inside), out, outside)
    return out


SCATTER = {"scatter": None, "scatter-add": "add", "scatter-mul": "mul", "scatter-min": "min", "scatter-max": "max"}


@rule(*SCATTER)
def _scatter(g: Graph, eqn: Equation, a: Nodes, indices: Nodes, updates: Nodes) -> Nodes:
    p = eqn.params
    d, op = p["dimension_numbers"], SCATTER[eqn.primitive.name]
    numbers = g.numbers(indices)
    if numbers is None:
        raise UnsupportedPrimitive("native: a scatter needs constant indices")
    at = np.asarray(numbers, dtype=np.int64)
    order = [k for k in range(updates.ndim) if k not in d.update_window_dims] + list(d.update_window_dims)
    updates = updates.transpose(order)
    dropped = (*d.inserted_window_dims, *d.operand_batching_dims)
    widths = iter(updates.shape[at.ndim - 1 :])
    window = [1 if axis in dropped else next(widths) for axis in range(a.ndim)]
    coordinates, fits = _windows(
        a.shape,
        [at[..., k] for k in range(at.shape[-1])],
        d.scatter_dims_to_operand_dims,
        window,
        dropped,
        [*zip(d.operand_batching_dims, d.scatter_indices_batching_dims, strict=True)],
    )
    out = a.copy()
    for point in np.ndindex(updates.shape):
        if fits[point[: at.ndim - 1]] or p["mode"].name == "CLIP":
            where = tuple(int(c[point]) for c in coordinates)
            one = updates[point]
            out[where] = one if op is None else exact(g, eqn, g.map(op, out[where], one))
    return out
