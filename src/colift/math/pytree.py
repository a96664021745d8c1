"""The one dialect of data class: frozen, keyword-only, registered with JAX as a PyTree."""

from __future__ import annotations

import dataclasses
from typing import Any, TypeVar, dataclass_transform

import jax

T = TypeVar("T")


def static(**kwargs: Any) -> Any:
    """A field that is part of the structure (hashable, compared at trace time), not a leaf."""
    return dataclasses.field(metadata={"static": True}, **kwargs)


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(static,))
def pytree(cls: type[T]) -> type[T]:
    """Turn a class body of annotated fields into an immutable PyTree.

    Fields made by `static` go into the tree's structure; all others are leaves or subtrees.
    """
    return jax.tree_util.register_dataclass(dataclasses.dataclass(frozen=True, kw_only=True)(cls))
