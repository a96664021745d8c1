"""What of a function is needed: results nobody reads are not computed, through calls and loops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from colift.codegen.blocks import Block, Branch, Function, Nodes, Over, Read, Scan, While, Write
from colift.codegen.graph import Graph

Masks = list[np.ndarray]  # of bool, one an array


@dataclass(frozen=True)
class Live:
    """What of a function is needed for some of its outputs."""

    nodes: np.ndarray  # of bool
    used: tuple[np.ndarray, ...]  # elements of each input
    needed: tuple[np.ndarray, ...]  # elements of each output
    calls: dict[int, Call]  # by block


@dataclass(frozen=True)
class Call:
    """What of a block is needed."""

    functions: tuple[Live, ...]
    used: tuple[np.ndarray, ...]  # elements of each of the block's inputs
    needed: tuple[np.ndarray, ...]  # elements of each of the block's outputs


def live(function: Function, needed: Sequence[np.ndarray]) -> Live:
    """Walk back from the needed elements of the outputs. Nodes are numbered in topological order."""
    g = function.graph
    nodes = np.zeros(g.count, dtype=bool)
    for out, mask in zip(function.outputs, needed, strict=True):
        nodes[out[mask]] = True
    calls: dict[int, Call] = {}
    used = [np.zeros(size, dtype=bool) for size in function.inputs]
    above = g.count
    for start, size, kind, array, block in reversed(g.ranges):
        _spread(g, nodes, start + size, above)
        above = start
        if kind == "in":
            used[array] |= nodes[start : start + size]
        elif start == g.starts[block] and nodes[start : start + sum(g.blocks[block].outputs)].any():
            b = g.blocks[block]
            ends = start + np.cumsum(b.outputs)
            calls[block] = call(b, [nodes[end - n : end] for end, n in zip(ends, b.outputs, strict=True)])
            for arg, mask in zip(b.inputs, calls[block].used, strict=True):
                nodes[arg[mask]] = True
    _spread(g, nodes, 0, above)
    return Live(nodes=nodes, used=tuple(used), needed=tuple(needed), calls=calls)


def _spread(g: Graph, nodes: np.ndarray, start: int, stop: int) -> None:
    """Mark the arguments of the expressions needed among the nodes from start to stop."""
    for node in range(stop - 1, start - 1, -1):
        if nodes[node]:
            for argument in g.arguments(node):
                nodes[argument] = True


def call(b: Block, outside: Masks) -> Call:
    """What of a block is needed for some elements of its outputs."""
    match b:
        case Over():
            functions, used = _over(b, outside)
        case Scan():
            functions, used = _scan(b, outside)
        case While():
            functions, used = _while(b, outside)
        case Branch():
            functions = tuple(live(f, outside) for f in b.branches)
            used = [
                np.ones(1, dtype=bool),
                *(np.any(masks, axis=0) for masks in zip(*(f.used for f in functions), strict=True)),
            ]
        case Read() | Write():
            functions, used = (), all_of(b.inputs)
        case _:
            raise AssertionError(b)
    return Call(functions=functions, used=tuple(used), needed=tuple(outside))


def _over(b: Over, outside: Masks) -> tuple[tuple[Live, ...], Masks]:
    rows = [x if join else np.any(x.reshape(b.length, -1), axis=0) for x, join in zip(outside, b.joins, strict=True)]
    found = live(b.function, rows)
    return (found,), [np.tile(u, b.length) if m else u for u, m in zip(found.used, b.mapped, strict=True)]


def _scan(b: Scan, outside: Masks) -> tuple[tuple[Live, ...], Masks]:
    stacks = [np.any(x.reshape(b.length, -1), axis=0) for x in outside[b.carry :]]
    found, state = _carried(b.function, outside[: b.carry], stacks, b.consts)
    scanned = found.used[b.consts + b.carry :]
    return (found,), [*found.used[: b.consts], *state, *(np.tile(u, b.length) for u in scanned)]


def _while(b: While, outside: Masks) -> tuple[tuple[Live, ...], Masks]:
    test = live(b.test, [np.ones(1, dtype=bool)])
    found, state = _carried(
        b.function, [x | t for x, t in zip(outside, test.used[b.tests :], strict=True)], [], b.consts
    )
    return (test, found), [*test.used[: b.tests], *found.used[: b.consts], *state]


def _carried(f: Function, state: Masks, stacks: Masks, consts: int) -> tuple[Live, Masks]:
    """What a step needs so that the carry has what is needed of it, next and at the end."""
    while True:
        found = live(f, [*state, *stacks])
        again = [n | u for n, u in zip(state, found.used[consts : consts + len(state)], strict=True)]
        if all((n == a).all() for n, a in zip(state, again, strict=True)):
            return found, state
        state = again


def all_of(arrays: Sequence[Nodes]) -> Masks:
    """Every element of every array needed."""
    return [np.ones(x.size, dtype=bool) for x in arrays]


def in_place(function: Function, need: Live, output: int, argument: int) -> bool:
    """Whether an output is an input written to once, by a block that nothing else reads."""
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
    for node in np.flatnonzero(need.nodes).tolist():
        if node in g.code:
            read[list(g.arguments(node))] = True
    for k, call in need.calls.items():
        for arg, mask in zip(g.blocks[k].inputs, call.used, strict=True):
            read[arg[mask]] = True
    for k, (out, mask) in enumerate(zip(function.outputs, need.needed, strict=True)):
        if k != output:
            read[out[mask]] = True
    return not read[nodes].any()
