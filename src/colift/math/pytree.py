"""Decorator for immutable dataclasses that JAX treats as PyTrees; all data types of the project use it."""

from __future__ import annotations

import dataclasses
import functools
from typing import Any, TypeVar, dataclass_transform

import jax
import jax.numpy as jnp
import numpy as np

T = TypeVar("T")
MAX_SHARED_BYTES = 4096
"""Largest array of `transfer` that equal arrays share [bytes]; all of them together take at most 4 MB."""


def transfer(x: np.ndarray | np.generic) -> jax.Array:
    """Convert a NumPy array to one of JAX; equal small arrays are one object.

    A transfer takes 20 us, and most arrays of experiments that differ in some numbers are equal.

    Args:
        x: Array or number on the host.

    Returns:
        The array, without a weak type.
    """
    if x.nbytes > MAX_SHARED_BYTES:
        return jax.device_put(x)
    return _transferred(x.dtype, x.shape, x.tobytes())


@functools.lru_cache(maxsize=1024)
def _transferred(dtype: np.dtype, shape: tuple[int, ...], content: bytes) -> jax.Array:
    with jax.ensure_compile_time_eval():  # the result outlives a trace in which it is made
        return jax.device_put(np.frombuffer(content, dtype).reshape(shape))


def static(**kwargs: Any) -> Any:
    """Declare a field that belongs to the tree structure instead of the leaves.

    Its value must be hashable. Functions are compiled again for another value.

    Args:
        **kwargs: Arguments of `dataclasses.field`, such as `default`.

    Returns:
        The field specifier.
    """
    return dataclasses.field(metadata={"static": True}, **kwargs)


def constant(default: float) -> Any:
    """Declare a field whose default is a number, such as a constant of an algorithm.

    Args:
        default: Default value, in the unit of the field.

    Returns:
        The field specifier; the default is a float64 array without weak type.
    """
    return dataclasses.field(default_factory=lambda: jnp.asarray(np.array(default, dtype=float)))


@dataclass_transform(kw_only_default=True, frozen_default=True, field_specifiers=(static, constant))
def pytree(cls: type[T]) -> type[T]:
    """Convert a class with annotated fields to a frozen, keyword-only dataclass that is a JAX PyTree.

    Fields declared with `static` belong to the tree structure; all others are leaves or subtrees.

    Args:
        cls: Class to be converted.

    Returns:
        The dataclass.

    Example:
        ::

            @pytree
            class Spring:
                stiffness: Float[Array, ""]  # N/m
                exponent: int = static(default=1)
    """
    return jax.tree_util.register_dataclass(dataclasses.dataclass(frozen=True, kw_only=True)(cls))
