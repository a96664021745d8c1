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

from colift.codegen.jax_internals import Program, is_literal, programs_in


def jaxpr_digest(jaxpr: Any) -> str:
    """Hash the equations, the constants, the version of JAX and the files of this package.

    Constants enter by their bytes, because the text of a jaxpr omits digits of arrays.

    Args:
        jaxpr: Traced function, of JAX.

    Returns:
        Hexadecimal SHA-256 hash.
    """
    found = hashlib.sha256()
    for part in (jax.__version__, _package(), str(jaxpr)):
        found.update(part.encode() + b"\0")
    program = Program.from_jaxpr(jaxpr)
    for value in (*program.constants, *_constants(program)):
        array = np.asarray(value)
        found.update(f"{array.dtype} {array.shape} ".encode() + array.tobytes())
    return found.hexdigest()


def _constants(program: Program) -> Iterator[Any]:
    """Iterate over the literals and the constants of nested jaxprs."""
    for e in program.equations:
        yield from (v.val for v in e.invars if is_literal(v))
        for inner in programs_in(e.params):
            yield from inner.constants
            yield from _constants(inner)
        for param in e.params.values():
            yield from (
                x for x in (param if isinstance(param, (tuple, list)) else (param,)) if isinstance(x, np.ndarray)
            )


@functools.cache
def _package() -> str:
    """Hash the files of this package, which determine the emitted code."""
    files = sorted(
        (file for file in resources.files("colift.codegen").iterdir() if file.is_file()), key=lambda f: f.name
    )
    return hashlib.sha256(b"\0".join(file.name.encode() + file.read_bytes() for file in files)).hexdigest()
