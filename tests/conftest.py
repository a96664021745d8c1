"""Strict test configuration: float64, no implicit promotion of dtype or rank, run-time checks of shapes and types."""

import ctypes
import dataclasses
import functools
import gc
import importlib.util
import logging
import os
import pkgutil
import resource
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import jax
import pytest
from jaxtyping import install_import_hook
from xdist.scheduler import LoadFileScheduling

os.environ.setdefault("MPLBACKEND", "Agg")
gc.set_threshold(200_000, 100, 100)  # traces are many objects, most of which are kept

jax.config.update("jax_numpy_dtype_promotion", "strict")
jax.config.update("jax_numpy_rank_promotion", "raise")


def register_dataclass(cls: type) -> type:
    """Register a dataclass with JAX such that `unflatten` bypasses `__init__` and its run-time checks.

    JAX puts axes, shapes and None where arrays were, and adds axes to them; a person's values are still checked.
    """
    fields = dataclasses.fields(cls)
    fixed = [field.name for field in fields if field.metadata.get("static")]
    leaves = [field.name for field in fields if field.name not in fixed]
    keys = [jax.tree_util.GetAttrKey(name) for name in leaves]

    def flatten(value: Any) -> tuple[list[Any], tuple[Any, ...]]:
        attributes = value.__dict__
        return [attributes[name] for name in leaves], tuple([attributes[name] for name in fixed])

    def flatten_with_keys(value: Any) -> tuple[list[tuple[jax.tree_util.GetAttrKey, Any]], tuple[Any, ...]]:
        children, structure = flatten(value)
        return list(zip(keys, children, strict=True)), structure

    def unflatten(structure: tuple[Any, ...], children: Any) -> Any:
        value = object.__new__(cls)
        value.__dict__.update(zip(leaves, children, strict=True))
        value.__dict__.update(zip(fixed, structure, strict=True))
        return value

    jax.tree_util.register_pytree_with_keys(cls, flatten_with_keys, unflatten, flatten)
    return cls


jax.tree_util.register_dataclass = register_dataclass

# Before any test module imports colift, beartype is installed for all its annotated functions, except in codegen:
# a million calls per flight, none of them with arrays, took twenty times as long.
PACKAGE = Path(next(iter(importlib.util.find_spec("colift").submodule_search_locations)))
MODULES = [f"colift.{module.name}" for module in pkgutil.iter_modules([str(PACKAGE)]) if module.name != "codegen"]
install_import_hook(MODULES, "beartype.beartype")

# Compilation makes first examples slow, so there is no deadline; the examples are equal in every run.
hypothesis.settings.register_profile("colift", deadline=None, derandomize=True, database=None, print_blob=True)
hypothesis.settings.load_profile("colift")


AS_SHIPPED = ("codegen", "build", "integers", "loops", "shipped_scenarios")
"""Files that test the code which the C compiler makes, or call it often."""

TEAMS = {  # files that share the compiled programs of one team run in one worker
    "paper": ("flight", "study", "feasibility", "controller", "paper_claims", "stability", "state_estimator"),
    "certified": ("certificate", "linearized_trajectory", "certification", "falsification"),
    "small": ("cli", "playback", "c_export", "preflight"),
    "as_shipped": AS_SHIPPED,
}


class TeamScheduling(LoadFileScheduling):
    """Scheduler that gives one worker a whole file, or all files that simulate the same team."""

    def _split_scope(self, nodeid: str) -> str:
        file = super()._split_scope(nodeid)
        name = Path(file).stem.removeprefix("test_")
        return next((team for team, files in TEAMS.items() if name in files), file)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> LoadFileScheduling | None:
    """Replace the scheduler of xdist under `--dist loadfile`."""
    return TeamScheduling(config, log) if config.getoption("dist") == "loadfile" else None


@pytest.fixture(scope="module")
def cases() -> Any:
    """Generated flights of all cases, for figures."""
    from tests.support import study_logs as made_up

    return made_up.cases()


@pytest.fixture
def style() -> Iterator[None]:
    """Matplotlib style of the library's figures."""
    import matplotlib as mpl

    from colift.visualization.style import STYLE

    with mpl.rc_context(STYLE):
        yield


@pytest.fixture(autouse=True, scope="module")
def _quick_compilation(request: pytest.FixtureRequest) -> Iterator[None]:
    """Disable optimization by gcc and XLA in test files other than `AS_SHIPPED`; numbers agree to rounding."""
    from colift.codegen import build

    levels = build.OPTIMIZED_FLAGS, build.QUICK_FLAGS
    quickly = Path(request.path).stem.removeprefix("test_") not in AS_SHIPPED
    if quickly:
        build.OPTIMIZED_FLAGS = build.QUICK_FLAGS = ("-O0",)
    was_quick = jax.config.values["jax_disable_most_optimizations"]
    if quickly != was_quick:  # tests compare bits, so no program of the other level may stay
        _clear_all_caches()
    jax.config.update("jax_disable_most_optimizations", quickly)
    build.build_environment.cache_clear()
    yield
    build.OPTIMIZED_FLAGS, build.QUICK_FLAGS = levels
    build.build_environment.cache_clear()


class Fallbacks(logging.Handler):
    """The warnings that a function without native code runs on JAX."""

    def __init__(self) -> None:
        super().__init__(logging.WARNING)
        self.found: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if "run on JAX, " in record.getMessage():
            self.found.append(record.getMessage())


@pytest.fixture(autouse=True)
def _native_code_exists(request: pytest.FixtureRequest) -> Iterator[None]:
    """Fail a test in which a function runs on JAX because the code generator does not support an operation."""
    log, fallbacks = logging.getLogger("colift.codegen"), Fallbacks()
    log.addHandler(fallbacks)
    yield
    log.removeHandler(fallbacks)
    if fallbacks.found and request.node.get_closest_marker("jax_fallback") is None:
        pytest.fail(fallbacks.found[0])


@pytest.fixture(autouse=True)
def _limit_memory() -> Iterator[None]:
    """Clear compiled programs after a test if the worker has exceeded its memory limit."""
    yield
    _clear_caches_above(max(FULL_GB, LEFT_GB[-1] + FULL_GB / 2))


def _clear_caches_above(gigabytes: float) -> None:
    if _resident_GB() > gigabytes:
        jax.clear_caches()
        for name, kept in (("colift.closed_loop.simulator", "_compiled"), ("colift.codegen", "_target")):
            if name in sys.modules:
                getattr(sys.modules[name], kept).cache_clear()
        gc.collect()
        if hasattr(LIBC, "malloc_trim"):  # glibc keeps what a compiler has freed
            LIBC.malloc_trim(0)
        LEFT_GB.append(_resident_GB())


def _clear_all_caches() -> None:
    """Clear compiled programs and the values that functions of the package and of the tests keep."""
    jax.clear_caches()
    for kept in gc.get_objects():
        if isinstance(kept, CachedFunction) and kept.__module__.startswith(("colift", "tests")):
            kept.cache_clear()


def _resident_GB() -> float:
    try:
        return int(Path("/proc/self/statm").read_text().split()[1]) * resource.getpagesize() / 2**30
    except OSError:  # not Linux: the peak value, in bytes on macOS
        return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 2**30


CachedFunction = type(functools.lru_cache(lambda: None))
LIBC = ctypes.CDLL(None)
MEMORY_GB = os.sysconf("SC_PHYS_PAGES") * resource.getpagesize() / 2**30
LEFT_GB = [0.0]  # after each clearing of caches
# The largest test adds 1.2 GB. Cleared programs are traced again, so they are cleared as late as memory allows.
FULL_GB = max(1.2, min(4.0, MEMORY_GB / 6))
if hasattr(LIBC, "mallopt"):
    LIBC.mallopt(-8, 2)  # M_ARENA_MAX: threads share two heaps and reuse freed memory
