"""Simulate, control, learn and certify cooperative transport of a rigid payload by aerial manipulators.

The map; each module imports only those below it:

    __main__    the command line
    tune        gains by gradients of the loop's modes and of a flight
    checkup     whether a scenario is sound before it is flown, and what to change where it is not
    doctor      what colift runs on
    environment a team as a Gymnasium environment
    hil         a team in lockstep with autopilots
    node        the pilot's tick as a ROS 2 node
    bag         a flight as a ROS 2 bag
    attack      a search for what breaks a certificate
    certification  a scenario certified: flights, certificate, challenge, file
    results     the flights of a study, and what is written of them
    heldout     paths that no map has seen
    report      a study as one page
    watch       a flight seen while it flies
    view        figures of a study
    prediction  figures of what is predicted beside what is so
    spread      figures of merit over seeds
    tightness   figures of radii beside what is observed
    lengthscales  the table of what was learned
    playback    flights as a page that plays them
    picture     flights as pictures and films
    panel       axes, marks and signals of a study's figures
    scene       what is seen of a flight
    export      the pilot's tick as C
    starter     a scenario to begin with
    study       C1, C2, C3 and their rivals: the plan of each
    outlook     what is known of a scenario before it is flown
    look        how figures look
    log         a flight as labelled NetCDF
    folder      where one run's results lie, and who may write there
    analyse     figures of merit, modes of the closed loop
    certify     ultimate bounds of the tracking errors (Theorem 1)
    scenario    YAML files to settings, settings to what a run starts from
    response    the closed loop to first order, from unknown forces to errors
    simulate    closes the loop of a world and a pilot: ticks, updates
    deviation   how far predictions may be off: posteriors, data sheets, radii
    world       the truth that a flight meets: plant, unknown forces, actuators, sensors
    engine      MuJoCo as the plant
    fly         the pilot and its parts; sees only measurements
    school      what is learned on the ground meanwhile
    dynamics    our plant: accelerations, contact forces, a step on the grasp
    mjcf        a team as a MuJoCo model
    disturbance the truth's unknown forces
    sensor      what sensors make of the truth, and the noise
    actuator    what vehicles make of commands
    control     the leader's wrench, the agents' realization
    allocate    contact forces from a wrench, internal forces
    estimate    states, contact forces and labels from measurements
    band        confidence bands of the frozen oracles, radii of their errors
    place       means of mass, drag and thrust beside GPs of the place
    learn       features, data sets, recorders, frozen oracles
    balance     the equations of motion, backwards
    measurement what sensors say: all that flies ever sees
    reference   where the payload should be
    gp          exact Gaussian processes for control loops
    grasp       constraints, grasp matrix, what a grasp can bear
    agent       one aerial manipulator
    urdf        an agent from a URDF file, and as one
    model       parameters and states
    so3, linalg, lowpass, native, over, pytree, disk, tables   what they are written with
    px4         PX4's frames, units and thrust
    cache       where what is compiled is kept
    interrupt   a request to end, read where work may end

Names that a script starts from are here as well: `colift.load("paper")`.
"""

import importlib
import logging
import os
import sys
import warnings
from typing import Any

from colift.runtime import cache


def _programs() -> dict[str, str]:
    """JAX's settings by which compiled programs outlive the process: a second run starts in seconds.

    Where they cannot be kept one line says so, and JAX is not to try: it would warn for every program. The user's own
    `JAX_COMPILATION_CACHE_DIR` is the user's.
    """
    always = {"JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0"}
    if "JAX_COMPILATION_CACHE_DIR" in os.environ:
        return always
    lost, settings = None, {}
    try:
        folder = cache.folder("jax")
        settings = {"JAX_COMPILATION_CACHE_DIR": str(folder)} | always
        if not os.access(folder, os.W_OK | os.X_OK):  # what it has is read; what takes less than for ever is not kept
            lost, settings["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = f"{folder}: only read", "inf"
    except cache.Unwritable as error:
        lost = str(error)
    if lost:
        logging.getLogger(__name__).warning("compiled programs cannot be kept (%s): each start compiles its own", lost)
    return settings


# Float64 always. JAX reads these when it is imported, which `--help` need not wait for.
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

# XLA's YNNPACK kernels, as of jaxlib 0.10.2, read memory that nobody wrote and sum wrongly in float64
# (docs/decisions/0020). XLA reads its flags once, when the first device is asked for; a person's own word stands.
_YNN = "--xla_cpu_experimental_ynn_fusion_type="
if _YNN not in os.environ.get("XLA_FLAGS", ""):
    if "jax" in sys.modules and sys.modules["jax"]._src.xla_bridge.backends_are_initialized():
        warnings.warn(
            "JAX was in use before colift was imported, so XLA's faulty YNNPACK kernels stay on: results may be wrong "
            f"or NaN (docs/decisions/0020). Import colift first, or start Python with XLA_FLAGS={_YNN}",
            RuntimeWarning,
            stacklevel=2,
        )
    os.environ["XLA_FLAGS"] = f"{_YNN} {os.environ.get('XLA_FLAGS', '')}".strip()

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
    "dataset": "results",
    "fly_plan": "simulate",
    "integrate": "dynamics",
    "linearize": "response",
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
