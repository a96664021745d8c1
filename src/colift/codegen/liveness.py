"""Liveness analysis: find the nodes and array elements that the outputs of a function depend on.

The analysis includes loops and branches. The emitter writes no statement for an element that is not required.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from colift.codegen.blocks import Block, Branch, Function, Map, Nodes, Read, Scan, While, Write
from colift.codegen.graph import Graph

Masks = list[np.ndarray]  # one boolean mask per array


@dataclass(frozen=True)
class Liveness:
    """Required parts of a function.

    Attributes:
        nodes: Mask of the required nodes.
        used: Masks of the required elements of each input.
        required: Masks of the required elements of each output.
        calls: Required parts of each required block, by its index.
    """

    nodes: np.ndarray
    used: tuple[np.ndarray, ...]
    required: tuple[np.ndarray, ...]
    calls: dict[int, BlockLiveness]


@dataclass(frozen=True)
class BlockLiveness:
    """Required parts of a block.

    Attributes:
        functions: Required parts of each function that the block calls.
        used: Masks of the required elements of each input.
        required: Masks of the required elements of each output.
    """

    functions: tuple[Liveness, ...]
    used: tuple[np.ndarray, ...]
    required: tuple[np.ndarray, ...]


def analyze_liveness(function: Function, required: Sequence[np.ndarray]) -> Liveness:
    """Mark the parts of a function that some elements of its outputs depend on.

    Nodes are numbered in topological order, so one pass from the last node to the first suffices.

    Args:
        function: Function.
        required: Mask of each output.

    Returns:
        The required parts.
    """
    g = function.graph
    nodes = np.zeros(g.count, dtype=bool)
    for out, mask in zip(function.outputs, required, strict=True):
        nodes[out[mask]] = True
    calls: dict[int, BlockLiveness] = {}
    used = [np.zeros(size, dtype=bool) for size in function.inputs]
    above = g.count
    for start, size, kind, array, block in reversed(g.ranges):
        _mark_arguments(g, nodes, start + size, above)
        above = start
        if kind == "in":
            used[array] |= nodes[start : start + size]
        elif start == g.starts[block] and nodes[start : start + sum(g.blocks[block].outputs)].any():
            b = g.blocks[block]
            ends = start + np.cumsum(b.outputs)
            calls[block] = analyze_block(b, [nodes[end - n : end] for end, n in zip(ends, b.outputs, strict=True)])
            for arg, mask in zip(b.inputs, calls[block].used, strict=True):
                nodes[arg[mask]] = True
    _mark_arguments(g, nodes, 0, above)
    return Liveness(nodes=nodes, used=tuple(used), required=tuple(required), calls=calls)


def _mark_arguments(g: Graph, nodes: np.ndarray, start: int, stop: int) -> None:
    """Mark the arguments of the required expressions among the nodes from start to stop."""
    for node in range(stop - 1, start - 1, -1):
        if nodes[node]:
            for argument in g.arguments(node):
                nodes[argument] = True


def analyze_block(b: Block, required: Masks) -> BlockLiveness:
    """Mark the parts of a block that some elements of its outputs depend on.

    Args:
        b: Block.
        required: Mask of each output.

    Returns:
        The required parts.

    Raises:
        AssertionError: If the type of the block is unknown.
    """
    match b:
        case Map():
            functions, used = _map(b, required)
        case Scan():
            functions, used = _scan(b, required)
        case While():
            functions, used = _while(b, required)
        case Branch():
            functions = tuple(analyze_liveness(f, required) for f in b.branches)
            used = [
                np.ones(1, dtype=bool),
                *(np.any(masks, axis=0) for masks in zip(*(f.used for f in functions), strict=True)),
            ]
        case Read() | Write():
            functions, used = (), all_elements(b.inputs)
        case _:
            raise AssertionError(b)
    return BlockLiveness(functions=functions, used=tuple(used), required=tuple(required))


def _map(b: Map, required: Masks) -> tuple[tuple[Liveness, ...], Masks]:
    rows = [
        x if reduction else np.any(x.reshape(b.length, -1), axis=0)
        for x, reduction in zip(required, b.reductions, strict=True)
    ]
    found = analyze_liveness(b.function, rows)
    return (found,), [np.tile(u, b.length) if m else u for u, m in zip(found.used, b.mapped, strict=True)]


def _scan(b: Scan, required: Masks) -> tuple[tuple[Liveness, ...], Masks]:
    stacks = [np.any(x.reshape(b.length, -1), axis=0) for x in required[b.carry :]]
    found, state = _carry_liveness(b.function, required[: b.carry], stacks, b.consts)
    scanned = found.used[b.consts + b.carry :]
    return (found,), [*found.used[: b.consts], *state, *(np.tile(u, b.length) for u in scanned)]


def _while(b: While, required: Masks) -> tuple[tuple[Liveness, ...], Masks]:
    test = analyze_liveness(b.test, [np.ones(1, dtype=bool)])
    found, state = _carry_liveness(
        b.function, [x | t for x, t in zip(required, test.used[b.tests :], strict=True)], [], b.consts
    )
    return (test, found), [*test.used[: b.tests], *found.used[: b.consts], *state]


def _carry_liveness(f: Function, state: Masks, stacks: Masks, consts: int) -> tuple[Liveness, Masks]:
    """Find the fixed point of the required elements of a carry, at the next step and at the end."""
    while True:
        found = analyze_liveness(f, [*state, *stacks])
        again = [n | u for n, u in zip(state, found.used[consts : consts + len(state)], strict=True)]
        if all((n == a).all() for n, a in zip(state, again, strict=True)):
            return found, state
        state = again


def all_elements(arrays: Sequence[Nodes]) -> Masks:
    """Return masks that require every element of every array."""
    return [np.ones(x.size, dtype=bool) for x in arrays]


def writes_in_place(function: Function, live: Liveness, output: int, argument: int) -> bool:
    """Return whether an output may be stored in an input.

    This holds if one write block changes the input and nothing else reads the result of that block.

    Args:
        function: Function.
        live: Required parts of the function.
        output: Index of the output.
        argument: Index of the input.

    Returns:
        True if the output may share the memory of the input.
    """
    g, nodes = function.graph, function.outputs[output]
    element = g.element(int(nodes[0])) if nodes.size else None
    if element is None or element[0] != "out" or element[3] != 0 or not (np.diff(nodes) == 1).all():
        return False
    b = g.blocks[element[2]]
    if not isinstance(b, Write) or b.outputs[0] != nodes.size:
        return False
    base = g.element(int(b.inputs[0][0]))
    if base is None or base[:2] != ("in", argument) or base[3] != 0 or not (np.diff(b.inputs[0]) == 1).all():
        return False
    read = np.zeros(g.count, dtype=bool)
    for node in np.flatnonzero(live.nodes).tolist():
        if node in g.code:
            read[list(g.arguments(node))] = True
    for k, call in live.calls.items():
        for arg, mask in zip(g.blocks[k].inputs, call.used, strict=True):
            read[arg[mask]] = True
    for k, (out, mask) in enumerate(zip(function.outputs, live.required, strict=True)):
        if k != output:
            read[out[mask]] = True
    return not read[nodes].any()
