"""Vectorization of a function over the agents of a group that a code generator can intercept.

A code generator needs the function body once, independent of the number of agents, but `jax.vmap` replaces it by
batched operations. The code generator therefore sets `AGENT_MAP_TRACER` while it traces. Otherwise `vmap_agents` is
`jax.vmap`.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax

AGENT_MAP_TRACER = jax.make_user_context(None)
"""JAX context; within `with AGENT_MAP_TRACER(bind)` a call of `vmap_agents(f)` returns `bind(f, axes, args)`.

The context is part of the cache key of `jax.jit`, so functions that were traced outside of it are traced again.
"""


def vmap_agents(f: Callable[..., Any], in_axes: int | Sequence[int | None] | None = 0) -> Callable[..., Any]:
    """Vectorize a function over the agents of a group, as `jax.vmap`.

    The returned function raises ValueError if its mapped arguments have different lengths.

    Args:
        f: Function of one agent; its arguments are PyTrees.
        in_axes: For each argument, or for all: 0 to map its leading axis, None to share it.

    Returns:
        Function of all agents.
    """

    @functools.wraps(f)
    def mapped(*args: Any) -> Any:
        axes = (in_axes,) * len(args) if in_axes is None or isinstance(in_axes, int) else tuple(in_axes)
        leaves = (leaf for axis, arg in zip(axes, args, strict=True) if axis == 0 for leaf in jax.tree.leaves(arg))
        sizes = {leaf.shape[0] for leaf in leaves}
        if len(sizes) != 1:
            raise ValueError(
                f"vmap_agents: mapped arguments must have equal lengths of their leading axes, got {sorted(sizes)}"
            )
        bind = AGENT_MAP_TRACER.value
        return jax.vmap(f, in_axes=axes)(*args) if bind is None else bind(f, axes, args)

    return mapped
