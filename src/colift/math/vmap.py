"""One function over the agents of a group: `jax.vmap`, but for a back end that writes code.

Such a back end wants the body once, however many agents a group has, and `vmap` leaves no trace of it. So while it
traces, it says how the map is to be kept; at any other time the map is `vmap`, and nothing of JAX's internals is here.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from typing import Any

import jax

AGENT_MAP_TRACER = jax.make_user_context(None)
"""While `kept_by(keep)` holds, `over(f)` is `keep(f, axes, args)`; what `jax.jit` traced before is not reused."""


def vmap_agents(f: Callable[..., Any], in_axes: int | Sequence[int | None] | None = 0) -> Callable[..., Any]:
    """`jax.vmap(f, in_axes)`, where an argument (any PyTree) is mapped over its leading axis (0) or shared (None)."""

    @functools.wraps(f)
    def mapped(*args: Any) -> Any:
        axes = (in_axes,) * len(args) if in_axes is None or isinstance(in_axes, int) else tuple(in_axes)
        own = (leaf for axis, arg in zip(axes, args, strict=True) if axis == 0 for leaf in jax.tree.leaves(arg))
        sizes = {leaf.shape[0] for leaf in own}
        if len(sizes) != 1:
            raise ValueError(f"over: mapped arguments must share one leading axis, got lengths {sorted(sizes)}")
        keep = AGENT_MAP_TRACER.value
        return jax.vmap(f, in_axes=axes)(*args) if keep is None else keep(f, axes, args)

    return mapped
