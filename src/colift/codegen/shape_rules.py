# ruff: noqa: ARG001  every rule has the arguments graph and equation
"""Rules of primitives that only move elements; they permute node arrays and emit no code."""

from __future__ import annotations

import numpy as np

from colift.codegen.equations import Equation
from colift.codegen.graph import Graph, Nodes
from colift.codegen.interpret import rule


@rule("reshape")
def _reshape(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    return a.reshape(eqn.params["new_sizes"])


@rule("squeeze")
def _squeeze(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    return a.reshape(eqn.outvars[0].aval.shape)


@rule("transpose")
def _transpose(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    return a.transpose(eqn.params["permutation"])


@rule("rev")
def _rev(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    return np.flip(a, eqn.params["dimensions"])


@rule("broadcast_in_dim")
def _broadcast_in_dim(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    shape, dims = eqn.params["shape"], eqn.params["broadcast_dimensions"]
    kept = [1] * len(shape)
    for d, size in zip(dims, a.shape, strict=True):
        kept[d] = size
    return np.broadcast_to(a.reshape(kept), shape)


@rule("iota")
def _iota(g: Graph, eqn: Equation) -> Nodes:
    shape, d = eqn.params["shape"], eqn.params["dimension"]
    kept = [size if k == d else 1 for k, size in enumerate(shape)]
    return np.broadcast_to(g.constants(np.arange(shape[d], dtype=float)).reshape(kept), shape)


@rule("slice")
def _slice(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    p = eqn.params
    strides = p["strides"] or (1,) * a.ndim
    return a[tuple(map(slice, p["start_indices"], p["limit_indices"], strides))]


@rule("split")
def _split(g: Graph, eqn: Equation, a: Nodes) -> list[Nodes]:
    return np.split(a, np.cumsum(eqn.params["sizes"])[:-1], axis=eqn.params["axis"])


@rule("concatenate")
def _concatenate(g: Graph, eqn: Equation, *x: Nodes) -> Nodes:
    return np.concatenate(x, axis=eqn.params["dimension"])


@rule("stack")
def _stack(g: Graph, eqn: Equation, *x: Nodes) -> Nodes:
    return np.stack(x, axis=eqn.params["axis"])


@rule("unstack")
def _unstack(g: Graph, eqn: Equation, a: Nodes) -> list[Nodes]:
    return list(np.moveaxis(a, eqn.params["axis"], 0))


@rule("tile")
def _tile(g: Graph, eqn: Equation, a: Nodes) -> Nodes:
    return np.tile(a, eqn.params["reps"])


@rule("pad")
def _pad(g: Graph, eqn: Equation, a: Nodes, value: Nodes) -> Nodes:
    config = eqn.params["padding_config"]
    inner = [max(0, size + (size - 1) * gap) for size, (_, _, gap) in zip(a.shape, config, strict=True)]
    grown = [size + max(low, 0) + max(high, 0) for size, (low, high, _) in zip(inner, config, strict=True)]
    out = np.full(grown, value)
    out[tuple(slice(max(low, 0), max(low, 0) + n, gap + 1) for n, (low, _, gap) in zip(inner, config, strict=True))] = a
    return out[tuple(slice(max(-low, 0), n - max(-high, 0)) for n, (low, high, _) in zip(grown, config, strict=True))]
