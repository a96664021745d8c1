"""Fingerprint of a jaxpr, the key of compiled code in the cache.

The fingerprint is computed before code generation, so a cached library is loaded without emitting its source.
"""

from __future__ import annotations

import functools
import hashlib
from collections.abc import Iterator
from importlib import resources
from typing import Any

import jax
import numpy as np
from jax.extend import core


def jaxpr_digest(jaxpr: core.ClosedJaxpr) -> str:
    """Hash the equations, the constants, the version of JAX and the files of this package.

    Constants enter by their bytes, because the text of a jaxpr omits digits of arrays.

    Args:
        jaxpr: Traced function.

    Returns:
        Hexadecimal SHA-256 hash.
    """
    found = hashlib.sha256()
    for part in (jax.__version__, _package(), str(jaxpr)):
        found.update(part.encode() + b"\0")
    for value in (*jaxpr.consts, *_constants(jaxpr.jaxpr)):
        array = np.asarray(value)
        found.update(f"{array.dtype} {array.shape} ".encode() + array.tobytes())
    return found.hexdigest()


def _constants(jaxpr: core.Jaxpr) -> Iterator[Any]:
    """Iterate over the literals and the constants of nested jaxprs."""
    for eqn in jaxpr.eqns:
        yield from (v.val for v in eqn.invars if isinstance(v, core.Literal))
        for param in eqn.params.values():
            for inner in param if isinstance(param, (tuple, list)) else (param,):
                if isinstance(inner, core.ClosedJaxpr):
                    yield from inner.consts
                    yield from _constants(inner.jaxpr)
                elif isinstance(inner, core.Jaxpr):
                    yield from _constants(inner)
                elif isinstance(inner, np.ndarray):
                    yield inner


@functools.cache
def _package() -> str:
    """Hash the files of this package, which determine the emitted code."""
    files = sorted(
        (file for file in resources.files("colift.codegen").iterdir() if file.is_file()), key=lambda f: f.name
    )
    return hashlib.sha256(b"\0".join(file.name.encode() + file.read_bytes() for file in files)).hexdigest()
