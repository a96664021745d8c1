"""Simulate, control, learn and certify cooperative transport of a rigid payload by aerial manipulators.

The map; each module imports only those below it:

    __main__    the command line
    study       C1, C2, C3 and the rivals of learning, certified flights; what is written of them
    view        figures and tables
    log         a flight as labelled NetCDF
    folder      where one run's results lie, and who may write there
    analyse     figures of merit, modes of the closed loop
    certify     ultimate bounds of the tracking errors (Theorem 1)
    scenario    YAML files to settings, settings to what a run starts from
    response    the closed loop to first order, from unknown forces to errors
    simulate    closes the loop: truth, sensors, flight software, updates
    fly         one tick on board; sees only measurements
    dynamics    the plant: accelerations, contact forces, a step on the grasp
    disturbance the truth's unknown forces
    control     the leader's wrench, the agents' realization
    allocate    contact forces from a wrench, internal forces
    estimate    states, contact forces and labels from measurements
    band        confidence bands of the frozen oracles, radii of their errors
    learn       features, data sets, frozen oracles
    sensor      what is measured, and the noise
    reference   where the payload should be
    gp          exact Gaussian processes for control loops
    grasp       constraints, grasp matrix, what a grasp can bear
    agent       one aerial manipulator
    urdf        an agent from a URDF file
    model       parameters and states
    so3, linalg, native, over, pytree   what they are written with
    interrupt   a request to end, read where work may end

Names that a script starts from are here as well: `colift.load("paper")`.
"""

import importlib
import os
import sys
from pathlib import Path
from typing import Any

_cache = Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "colift" / "jax"
# Float64 always, and compiled programs outlive the process: a second run starts in seconds. Set
# JAX_COMPILATION_CACHE_DIR to move them. JAX reads these when it is imported, which `--help` need not wait for.
_settings = {
    "JAX_ENABLE_X64": "True",
    "JAX_COMPILATION_CACHE_DIR": os.environ.get("JAX_COMPILATION_CACHE_DIR", str(_cache)),
    "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": os.environ.get("JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS", "0"),
}
if "jax" in sys.modules:
    _jax = sys.modules["jax"]
    _jax.config.update("jax_enable_x64", True)
    if _jax.config.jax_compilation_cache_dir is None:
        _jax.config.update("jax_compilation_cache_dir", _settings["JAX_COMPILATION_CACHE_DIR"])
        _jax.config.update("jax_persistent_cache_min_compile_time_secs", 0.0)
else:
    os.environ.update(_settings)

_HOME = {
    "Agent": "model",
    "Flight": "simulate",
    "GP": "gp",
    "Payload": "model",
    "Plan": "simulate",
    "Settings": "scenario",
    "State": "model",
    "Team": "model",
    "Tree": "model",
    "accelerate": "dynamics",
    "fly_plan": "simulate",
    "integrate": "dynamics",
    "linearize": "analyse",
    "load": "scenario",
    "plan": "study",
    "project": "dynamics",
    "summary": "analyse",
}
__all__ = list(_HOME)


def __getattr__(name: str) -> Any:
    """Public names are imported from their modules when they are first used."""
    if name not in _HOME:
        raise AttributeError(f"module 'colift' has no attribute {name!r}")
    return getattr(importlib.import_module(f"colift.{_HOME[name]}"), name)


def __dir__() -> list[str]:
    return sorted([*globals(), *_HOME])
