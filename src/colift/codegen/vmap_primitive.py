"""`colift.math.vmap.vmap_agents` as a primitive whose body stays in the jaxpr.

`jax.vmap` replaces a function by batched operations, which hides the loop over agents from the code generator. This
primitive keeps the function. Its value, derivatives and batching are those of `jax.vmap`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax

from colift.codegen import jax_internals
from colift.codegen.jax_internals import Program
from colift.math.vmap import AGENT_MAP_TRACER

agent_map_p = jax_internals.new_primitive("agent_map")


def trace(f: Callable[..., Any], tree: Any, leaves: Sequence[Any]) -> tuple[Any, Any]:
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
    program = Program.from_jaxpr(body)
    # closed-over values become shared arguments, because they may be tracers
    shared = (False,) * len(program.constants)
    results = agent_map_p.bind(*program.constants, *leaves, jaxpr=program.jaxpr, mapped=shared + maps)
    return jax.tree.unflatten(out, results)


def _vmapped(*args: Any, jaxpr: Any, mapped: tuple[bool, ...]) -> list[Any]:
    """Evaluate the primitive by `jax.vmap`."""
    body = functools.partial(jax_internals.evaluate_jaxpr, jaxpr)
    return jax.vmap(body, in_axes=tuple(0 if m else None for m in mapped))(*args)


def _jvp(primals: Sequence[Any], tangents: Sequence[Any], **params: Any) -> tuple[Any, Any]:
    f = functools.partial(_vmapped, **params)
    return jax.jvp(f, tuple(primals), jax_internals.dense_tangents(tangents))


def _batch(args: Sequence[Any], dims: Sequence[int | None], **params: Any) -> tuple[Any, Sequence[int]]:
    out = jax.vmap(functools.partial(_vmapped, **params), in_axes=tuple(dims))(*args)
    return out, [0] * len(out)


def _abstract(*args: Any, jaxpr: Any, mapped: tuple[bool, ...]) -> list[Any]:
    size = _size(args, mapped)
    return [jax_internals.abstract_array((size, *v.aval.shape), v.aval.dtype) for v in Program(jaxpr, ()).results]


def _size(args: Sequence[Any], mapped: Sequence[bool]) -> int:
    """Return the number of agents."""
    return next(a.shape[0] for a, m in zip(args, mapped, strict=True) if m)


jax_internals.define_primitive(agent_map_p, _vmapped, _abstract, _jvp, _batch, _vmapped)
