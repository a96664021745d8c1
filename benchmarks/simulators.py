"""Other simulators: CPU time of a step of MJX and RotorPy compared with a native step of the reference team.

- MJX (MuJoCo in JAX) simulates the team of `one_team`, with RK4 and steps of 1 ms on the CPU.
- RotorPy simulates one multirotor with motor lag and drag, without arms, payload and contacts, in the same step. By
  default it integrates with the adaptive method RK45 of SciPy; the second row has one step of this method.

The native steps are RK4 with the projection onto the grasp, for one team, and 64 teams in one thread. A batch of teams
in MJX is not measured: its compiled program did not end within five minutes on two cores.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np

from benchmarks import Outcome, microseconds, peers, plant, ratios, rounds, table
from colift import codegen

STEPS, MJX_STEPS, TEAMS, TEAM_STEPS = 200, 50, 64, 5
OMITTED = {
    "mujoco.mjx": "MJX is not installed; `./dev peers` adds it",
    "rotorpy": "RotorPy is not installed; `./dev peers` adds it",
    "crazyflow": "crazyflow: its release 0.4 excludes the locked version of JAX",
}

Contender = tuple[Callable[[], object], int]


def run(seconds: float) -> Outcome:
    """Measure all installed simulators on one core."""
    team, z, (inputs,) = plant.hover(2)
    nudge = jnp.array([[0.02, 0.05, 0.01], [0.0, 0.03, -0.01]])  # N m, as in `one_team`
    case = team, z, (replace(inputs, tau=inputs.tau + nudge),)
    absent = [name for name in OMITTED if not installed(name)]
    one, many = native(case)
    contenders = {"native": one, f"native, {TEAMS} teams": many}
    if "mujoco.mjx" not in absent:
        contenders |= mjx_steps(case)
    if "rotorpy" not in absent:
        contenders |= rotorpy_steps()
    times = rounds(contenders, seconds, time.process_time)
    table("CPU time of a step", "a step and system", times, "native")
    return Outcome(
        figures={"time_per_step_us": microseconds(times), "ratio_to_native": ratios(times, "native")},
        omitted=tuple(OMITTED[name] for name in absent),
    )


def installed(name: str) -> bool:
    """Return whether a module is installed."""
    try:
        return importlib.util.find_spec(name) is not None
    except ModuleNotFoundError:
        return False


def native(case: plant.Case) -> tuple[Contender, Contender]:
    """Return the steps of one team, and those of many teams in one thread."""
    args = (*case, jnp.array(plant.DT))
    one = jax.jit(codegen.compile(plant.rollout(STEPS), threads=1))
    batch = jax.tree.map(lambda x: jnp.repeat(x[None], TEAMS, 0), args)
    many = jax.jit(jax.vmap(codegen.compile(plant.rollout(TEAM_STEPS), threads=1)))
    return (
        (lambda: jax.block_until_ready(one(*args)), STEPS),
        (lambda: jax.block_until_ready(many(*batch)), TEAMS * TEAM_STEPS),
    )


def mjx_steps(case: plant.Case) -> dict[str, Contender]:
    """Return the steps of MJX for one team."""
    from mujoco import mjx

    model = peers.mujoco_team(case[0])
    data = peers.mujoco_state(model, case)
    model_x, data_x = mjx.put_model(model), mjx.put_data(model, data)

    def rollout(data: mjx.Data) -> mjx.Data:
        return jax.lax.scan(lambda d, _: (mjx.step(model_x, d), None), data, None, MJX_STEPS)[0]

    one = jax.jit(rollout)
    return {"MJX RK4": (lambda: jax.block_until_ready(one(data_x)), MJX_STEPS)}


def rotorpy_steps() -> dict[str, Contender]:
    """Return the steps of RotorPy for one multirotor."""
    from rotorpy.vehicles import hummingbird_params, multirotor

    speed = np.sqrt(0.5 * 9.81 / 4 / hummingbird_params.quad_params["k_eta"])  # rad/s in hover
    state = {
        "x": np.zeros(3),
        "v": np.zeros(3),
        "q": np.array([0.0, 0.0, 0.0, 1.0]),
        "w": np.array([0.1, 0.05, 0.0]),
        "wind": np.zeros(3),
        "rotor_speeds": np.full(4, speed),
    }
    control = {"cmd_motor_speeds": np.full(4, speed)}

    def steps(**settings: object) -> Contender:
        vehicle = multirotor.Multirotor(hummingbird_params.quad_params, integrator_kwargs=settings or None)

        def run() -> None:
            current = state
            for _ in range(STEPS):
                current = vehicle.step(current, control, plant.DT)

        return run, STEPS

    single = {"method": "RK45", "rtol": 1.0, "atol": 1.0, "first_step": plant.DT}
    return {"RotorPy, one multirotor": steps(), "RotorPy, one multirotor, one RK45 step": steps(**single)}
