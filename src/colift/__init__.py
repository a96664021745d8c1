"""Simulation, control, learning and certification of cooperative payload transport by aerial manipulators.

Layers, top to bottom; a package imports only packages of lower layers, and packages of one layer are independent:

    cli                        command line
    workflows                  studies, certification, falsification, generalization
    visualization, integrations  figures, playback, reports; Gymnasium, ROS 2, PX4, C code
    analysis, certification    metrics, stability, gain tuning, preflight check; error bounds of Theorem 1
    scenario                   YAML files, their schema, and the experiments built from them
    closed_loop                simulator, flights, logs, termination, linearization
    onboard, simulation        controller, estimation, learning; plant, disturbances, sensors, actuators
    models, trajectories, gp, codegen  team and its equations; references; Gaussian processes; C from jaxprs
    math, runtime              SO(3), linear algebra, filters, PyTrees; cache, signals, files

``onboard`` and ``simulation`` are independent: onboard code never imports the simulated truth.
"""

import importlib
import logging
import os
import sys
import warnings
from typing import Any

from colift.runtime import cache


def _programs() -> dict[str, str]:
    """Return the settings of JAX's persistent cache of compiled programs, which shortens the start of later runs.

    If the cache is unavailable, one warning is logged and JAX does not use it, because it would warn for every program.
    A `JAX_COMPILATION_CACHE_DIR` of the user is not changed.
    """
    always = {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return always
    lost, settings = None, {}
    try:
        folder = cache.cache_directory("jax")
        settings = {"JAX_COMPILATION_CACHE_DIR": str(folder)} | always
        if not os.access(folder, os.W_OK | os.X_OK):  # existing entries are read; no entry is added
            lost, settings["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = f"{folder}: only read", "inf"
    except cache.CacheUnavailable as error:
        lost = str(error)
    if lost:
        logging.getLogger(__name__).warning("compiled programs cannot be kept (%s): each start compiles its own", lost)
    return settings


# JAX reads these variables at its import; colift imports it only when required, so that `--help` is fast.
os.environ["JAX_ENABLE_X64"] = "True"
for _name, _value in _programs().items():
    os.environ.setdefault(_name, _value)
if "jax" in sys.modules:
    _jax = sys.modules["jax"]
    _jax.config.update("jax_enable_x64", True)
    if _jax.config.jax_compilation_cache_dir is None and "JAX_COMPILATION_CACHE_DIR" in os.environ:
        _jax.config.update("jax_compilation_cache_dir", os.environ["JAX_COMPILATION_CACHE_DIR"])
        _least = float(os.environ["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"])
        _jax.config.update("jax_persistent_cache_min_compile_time_secs", _least)

# XLA's YNNPACK kernels, as of jaxlib 0.10.2, read uninitialized memory and compute wrong sums in float64
# (docs/decisions/0020). XLA reads its flags once, before the first use of a device; a flag of the user has priority.
_YNN = "--xla_cpu_experimental_ynn_fusion_type="
if _YNN not in os.environ.get("XLA_FLAGS", ""):
    if "jax" in sys.modules and importlib.import_module("colift.codegen.jax_internals").backends_are_initialized():
        warnings.warn(
            "JAX was in use before colift was imported, so XLA's faulty YNNPACK kernels stay on: results may be wrong "
            f"or NaN (docs/decisions/0020). Import colift first, or start Python with XLA_FLAGS={_YNN}",
            RuntimeWarning,
            stacklevel=2,
        )
    os.environ["XLA_FLAGS"] = f"{_YNN} {os.environ.get('XLA_FLAGS', '')}".strip()

_HOME = {
    "AerialManipulator": "models.parameters",
    "Experiment": "workflows.python_api",
    "Flight": "workflows.python_api",
    "KinematicTree": "models.parameters",
    "Payload": "models.parameters",
    "Scenario": "scenario",
    "ScenarioError": "scenario",
    "State": "models.state",
    "Study": "workflows.python_api",
    "Team": "models.parameters",
    "load_scenario": "workflows.python_api",
    "make_experiment": "workflows.python_api",
    "run_batch": "workflows.python_api",
    "run_experiment": "workflows.python_api",
    "run_study": "workflows.python_api",
}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Import a public name from its module on first use."""
    if name not in _HOME:
        raise AttributeError(f"module 'colift' has no attribute {name!r}")
    return getattr(importlib.import_module(f"colift.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*_HOME, "__version__"] if "__version__" in globals() else _HOME)
