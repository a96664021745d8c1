"""`colift.math.vmap.vmap_agents` as a primitive whose body stays in the jaxpr.

`jax.vmap` replaces a function by batched operations, which hides the loop over agents from the code generator. This
primitive keeps the function. Its value, derivatives and batching are those of `jax.vmap`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax
import jax.core
from jax.extend import core
from jax.interpreters import ad, batching, mlir

from colift.math.vmap import AGENT_MAP_TRACER

agent_map_p = core.Primitive("agent_map")
agent_map_p.multiple_results = True


def trace(f: Callable[..., Any], tree: Any, leaves: Sequence[Any]) -> tuple[core.ClosedJaxpr, Any]:
    """Trace a function; maps over agents remain equations of the jaxpr.

    Args:
        f: Function of PyTrees.
        tree: Tree structure of the argument tuple.
        leaves: Arrays or abstract values of the arguments.

    Returns:
        The jaxpr of the leaves, and the tree structure of the result.
    """
    out = None

    def flat(*x: Any) -> list[Any]:
        nonlocal out
        values, out = jax.tree.flatten(f(*jax.tree.unflatten(tree, x)))
        return values

    with AGENT_MAP_TRACER(_bind_agent_map):
        return jax.make_jaxpr(flat)(*leaves), out


def _bind_agent_map(f: Callable[..., Any], axes: Sequence[int | None], args: Sequence[Any]) -> Any:
    """Bind the primitive for a map of `f` over agents; `axes` is 0 or None for each argument."""
    leaves, tree = jax.tree.flatten(args)
    maps = tuple(axis == 0 for axis, arg in zip(axes, args, strict=True) for _ in jax.tree.leaves(arg))
    one = [
        jax.ShapeDtypeStruct(leaf.shape[1:] if m else leaf.shape, leaf.dtype)
        for leaf, m in zip(leaves, maps, strict=True)
    ]
    body, out = trace(f, tree, one)
    # closed-over values become shared arguments, because they may be tracers
    shared = (False,) * len(body.consts)
    results = agent_map_p.bind(*body.consts, *leaves, jaxpr=body.jaxpr, mapped=shared + maps)
    return jax.tree.unflatten(out, results)


def _vmapped(*args: Any, jaxpr: core.Jaxpr, mapped: tuple[bool, ...]) -> list[Any]:
    """Evaluate the primitive by `jax.vmap`."""

    def body(*args: Any) -> list[Any]:
        consts = len(jaxpr.constvars)
        return jax.core.eval_jaxpr(jaxpr, args[:consts], *args[consts:])

    return jax.vmap(body, in_axes=tuple(0 if m else None for m in mapped))(*args)


def _jvp(primals: Sequence[Any], tangents: Sequence[Any], **params: Any) -> tuple[Any, Any]:
    return jax.jvp(functools.partial(_vmapped, **params), tuple(primals), tuple(map(ad.instantiate_zeros, tangents)))


def _batch(args: Sequence[Any], dims: Sequence[int | None], **params: Any) -> tuple[Any, Sequence[int]]:
    out = jax.vmap(functools.partial(_vmapped, **params), in_axes=tuple(dims))(*args)
    return out, [0] * len(out)


agent_map_p.def_impl(_vmapped)
agent_map_p.def_abstract_eval(
    lambda *args, jaxpr, mapped: [
        jax.core.ShapedArray((_size(args, mapped), *v.aval.shape), v.aval.dtype) for v in jaxpr.outvars
    ]
)
mlir.register_lowering(agent_map_p, mlir.lower_fun(_vmapped, multiple_results=True))
ad.primitive_jvps[agent_map_p] = _jvp
batching.primitive_batchers[agent_map_p] = _batch


def _size(args: Sequence[Any], mapped: Sequence[bool]) -> int:
    """Return the number of agents."""
    return next(a.shape[0] for a, m in zip(args, mapped, strict=True) if m)
