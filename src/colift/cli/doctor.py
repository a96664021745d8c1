"""What colift runs on: versions, compiler, caches, devices, and whether native code computes what JAX does."""

from __future__ import annotations

import os
import platform
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from colift import codegen
from colift.codegen import build
from colift.runtime import cache

PACKAGES = ("colift", "jax", "jaxlib", "numpy", "scipy", "pydantic", "h5netcdf", "clarabel", "mujoco")
TOLERANCE = 1e-12  # of the largest entry: what a sum in another order may differ


def run_diagnostics() -> dict[str, Any]:
    """All of it, by name; `problems` lists in sentences what is not as it should be."""
    problems: list[str] = []
    return {
        "python": platform.python_version(),
        "system": f"{platform.system()} {platform.release()}, {platform.machine()}, {build.available_cores()} processors",
        "packages": {name: _version(name) for name in PACKAGES},
        "compiler": _compiler(problems),
        "caches": {name: _cache(name, problems) for name in ("jax", "native")},
        "gpu": [str(device) for device in jax.devices() if device.platform != "cpu"] or None,
        "self_test": _self_test(problems),
        "problems": problems,
    }


def format_report(found: dict[str, Any]) -> list[str]:
    """The same as a person reads it."""
    said = [f"{'python':10} {found['python']}, {found['system']}"]
    said += [f"{'packages':10} " + ", ".join(f"{name} {given or 'none'}" for name, given in found["packages"].items())]
    said += [f"{'compiler':10} {found['compiler'] or 'none'}"]
    for name, kept in found["caches"].items():
        said.append(
            f"{name + ' cache':10} " + (f"{kept['folder']}: {kept['files']} files, {kept['MB']} MB" if kept else "none")
        )
    said += [f"{'gpu':10} {', '.join(found['gpu']) if found['gpu'] else 'none; none is used'}"]
    said += [f"{'self-test':10} {found['self_test']}"]
    return [*said, *(f"problem: {each}" for each in found["problems"])]


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _compiler(problems: list[str]) -> str | None:
    """The C compiler's command and what it calls itself."""
    try:
        command = build.compiler()
        if command is None:
            problems.append("no C compiler (cc, gcc, clang or $CC): flights are some four times slower, by JAX")
            return None
        return f"{' '.join(command)}: {build.build_environment().splitlines()[1]}"
    except build.CompilerError as error:
        problems.append(str(error))
        return None


def _cache(name: str, problems: list[str]) -> dict[str, Any] | None:
    """Folder, number of files and size."""
    try:
        folder = cache.cache_directory(name)
    except cache.CacheUnavailable as error:
        problems.append(f"what is compiled cannot be kept: {error}")
        return None
    if name == "jax" and (named := jax.config.values["jax_compilation_cache_dir"]):
        folder = Path(named)  # by a variable of JAX's own
    sizes = [entry.stat().st_size for entry in os.scandir(folder) if entry.is_file()] if folder.is_dir() else []
    return {"folder": str(folder), "files": len(sizes), "MB": round(sum(sizes) / 1e6, 1)}


def _self_test(problems: list[str]) -> str:
    """Native code against JAX, on a few products, a solution and a loop."""
    A = jnp.asarray(np.random.default_rng(0).normal(size=(6, 6)))
    expected, began = np.asarray(jax.jit(_sample)(A)), time.perf_counter()
    try:
        found = np.asarray(jax.jit(codegen.compile(_sample))(A))
    except (codegen.UnsupportedPrimitive, build.CompilerError, OSError) as error:
        problems.append(f"native code does not work: {error}")
        return "failed"
    off = float(np.abs(found - expected).max() / np.abs(expected).max())
    if not off <= TOLERANCE:
        problems.append(f"native code differs from JAX by {off:.2g} of the largest entry: clear the native cache")
        return "failed"
    return f"native code agrees with JAX within {off:.1g}, {time.perf_counter() - began:.2f} s"


def _sample(A: jax.Array) -> jax.Array:
    def body(_: Any, x: jax.Array) -> jax.Array:
        return jnp.tanh(A @ x) + x.T

    return jax.lax.fori_loop(0, 10, body, A) @ A.T
