"""Diagnostics of an installation: versions, compiler, caches, devices, and a test of native code against JAX."""

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
"""Packages whose versions are reported."""
TOLERANCE = 1e-12
"""Largest accepted difference of native code and JAX, relative to the largest entry: rounding in another order."""


def run_diagnostics() -> dict[str, Any]:
    """Examine the installation and test native code.

    Returns:
        Findings by name. The entry ``problems`` is a list of sentences, empty if everything works.
    """
    problems: list[str] = []
    system = f"{platform.system()} {platform.release()}, {platform.machine()}, {build.available_cores()} processors"
    return {
        "python": platform.python_version(),
        "system": system,
        "packages": {name: _version(name) for name in PACKAGES},
        "compiler": _compiler(problems),
        "caches": {name: _cache(name, problems) for name in ("jax", "native")},
        "gpu": [str(device) for device in jax.devices() if device.platform != "cpu"] or None,
        "self_test": _self_test(problems),
        "problems": problems,
    }


def format_report(diagnostics: dict[str, Any]) -> list[str]:
    """Format the findings for a terminal.

    Args:
        diagnostics: Findings of `run_diagnostics`.

    Returns:
        One line for each finding and each problem.
    """
    versions = ", ".join(f"{name} {number or 'none'}" for name, number in diagnostics["packages"].items())
    lines = [
        _line("python", f"{diagnostics['python']}, {diagnostics['system']}"),
        _line("packages", versions),
        _line("compiler", diagnostics["compiler"] or "none"),
    ]
    for name, stored in diagnostics["caches"].items():
        text = f"{stored['folder']}: {stored['files']} files, {stored['MB']} MB" if stored else "none"
        lines.append(_line(f"{name} cache", text))
    lines.append(_line("gpu", ", ".join(diagnostics["gpu"]) if diagnostics["gpu"] else "none; none is used"))
    lines.append(_line("self-test", diagnostics["self_test"]))
    return [*lines, *(f"problem: {problem}" for problem in diagnostics["problems"])]


def _line(label: str, text: str) -> str:
    return f"{label:10} {text}"


def _version(package: str) -> str | None:
    try:
        return version(package)
    except PackageNotFoundError:
        return None


def _compiler(problems: list[str]) -> str | None:
    """Return the command and the version of the C compiler; report a missing or failing one."""
    try:
        command = build.compiler()
        if command is None:
            problems.append(
                "no C compiler was found (cc, gcc, clang or $CC): flights run in JAX, about four times slower"
            )
            return None
        return f"{' '.join(command)}: {build.build_environment().splitlines()[1]}"
    except build.CompilerError as error:
        problems.append(str(error))
        return None


def _cache(name: str, problems: list[str]) -> dict[str, Any] | None:
    """Return folder, number of files and size of a cache; report one that is not available."""
    try:
        folder = cache.cache_directory(name)
    except cache.CacheUnavailable as error:
        problems.append(f"compiled code cannot be stored: {error}")
        return None
    if name == "jax" and (configured := jax.config.values["jax_compilation_cache_dir"]):
        folder = Path(configured)  # set by JAX's own environment variable
    sizes = [entry.stat().st_size for entry in os.scandir(folder) if entry.is_file()] if folder.is_dir() else []
    return {"folder": str(folder), "files": len(sizes), "MB": round(sum(sizes) / 1e6, 1)}


def _self_test(problems: list[str]) -> str:
    """Compare native code with JAX on a loop of matrix products; report a failure or a difference."""
    A = jnp.asarray(np.random.default_rng(0).normal(size=(6, 6)))
    expected, start = np.asarray(jax.jit(_sample)(A)), time.perf_counter()
    try:
        codegen.kernel(jax.make_jaxpr(_sample)(A))  # raises an error where `compile` uses JAX instead
        found = np.asarray(jax.jit(codegen.compile(_sample))(A))
    except (codegen.UnsupportedPrimitive, build.CompilerError, OSError) as error:
        problems.append(f"native code does not work: {error}")
        return "failed"
    difference = float(np.abs(found - expected).max() / np.abs(expected).max())
    if not difference <= TOLERANCE:
        problems.append(
            f"native code differs from JAX by {difference:.2g} of the largest entry: clear the native cache"
        )
        return "failed"
    return f"native code agrees with JAX within {difference:.1g}, {time.perf_counter() - start:.2f} s"


def _sample(A: jax.Array) -> jax.Array:
    """Evaluate the function of the self-test."""

    def body(_: Any, x: jax.Array) -> jax.Array:
        return jnp.tanh(A @ x) + x.T

    return jax.lax.fori_loop(0, 10, body, A) @ A.T
