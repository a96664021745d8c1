"""Work-precision diagram: CPU time of a simulated second over the error of the payload position, against MuJoCo.

The motion is that of `one_team`: the reference team with hover inputs and a small change. The reference solution is
that of colift with steps of 31 us. Half as many steps change it by less than 1e-13 m. The error is the distance of the
payload from it after 0.5 s. Steps of colift are RK4 with the projection onto the grasp.

MuJoCo has three integrators and two softnesses of its `connect` constraints: its default, and the stiffest that it
permits, with an impedance of 0.9999 and a time constant of two steps. Its error with the default does not decrease with
the step. With the stiffest constraints it converges to the same reference solution.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from benchmarks import Outcome, peers, plant, rounds
from colift import codegen
from colift.models import mjcf

DURATION = 0.5  # s
REFERENCE_STEPS = 16000
COLIFT_STEPS = (5, 10, 20, 50, 100, 250, 500)
MUJOCO_STEPS = (62, 125, 250, 500, 1000, 2000, 4000)  # 8 ms to 0.125 ms
INTEGRATORS = {"RK4": "RK4", "Euler": "EULER", "implicitfast": "IMPLICITFAST"}  # names of MuJoCo's constants
ERRORS = (1e-7, 1e-9)  # m, at which times are compared
OWN_STEP = 500  # steps of 1 ms
LEAST_TIME = 0.05  # CPU time of one measurement of a point [s]
LEAST_SECONDS = 30.0  # duration of all rounds together

Series = dict[str, list[dict[str, Any]]]


def run(seconds: float) -> Outcome:
    """Measure all points in alternating rounds; the fastest round of a point counts."""
    team, z, (inputs,) = plant.hover(2)
    nudge = jnp.array([[0.02, 0.05, 0.01], [0.0, 0.03, -0.01]])  # N m, as in `one_team`
    case = team, z, (replace(inputs, tau=inputs.tau + nudge),)
    reference, coarser = (colift_end(case, steps)() for steps in (REFERENCE_STEPS, REFERENCE_STEPS // 2))
    programs = {"colift": [(n, colift_end(case, n)) for n in COLIFT_STEPS]}
    for name in INTEGRATORS:
        for softness in ("default", "stiff"):
            programs[f"MuJoCo {name}, {softness}"] = [(n, mujoco_end(case, name, softness, n)) for n in MUJOCO_STEPS]
    series = measure(programs, reference, max(seconds, LEAST_SECONDS))
    for name, points in series.items():
        print(name)
        for one in points:
            print(f"  step {one['step_s']:.2e} s  error {one['error_m']:.2e} m  {one['cpu_us_per_s']:.4g} us a second")
    ratios = {f"{error:g} m": time_at(series, "MuJoCo", error) / time_at(series, "colift", error) for error in ERRORS}
    same_step = {
        name: next(one for one in points if one["steps"] == OWN_STEP)["cpu_us_per_s"]
        / next(one for one in series["colift"] if one["steps"] == OWN_STEP)["cpu_us_per_s"]
        for name, points in series.items()
    }
    for name, ratio in ratios.items():
        print(f"at an error of {name}: MuJoCo takes {ratio:.3g} times as long")
    print("at a step of 1 ms: " + ", ".join(f"{name} {ratio:.3g}" for name, ratio in same_step.items()))
    return Outcome(
        figures={
            "series": series,
            "reference_difference_m": float(np.linalg.norm(reference - coarser)),
            "time_ratio_at_error": ratios,
            "time_ratio_at_step_of_1_ms": same_step,
        }
    )


def colift_end(case: plant.Case, steps: int) -> Callable[[], np.ndarray]:
    """Return a function that simulates the motion with colift and returns the payload position at the end [m]."""
    compiled = jax.jit(codegen.compile(plant.rollout(steps), threads=1))
    args = (*case, jnp.array(DURATION / steps))
    return lambda: np.asarray(jax.block_until_ready(compiled(*args)).payload.p)


def mujoco_end(case: plant.Case, integrator: str, softness: str, steps: int) -> Callable[[], np.ndarray]:
    """Return the same function of MuJoCo."""
    model = peers.mujoco_team(case[0])
    data = peers.mujoco_state(model, case)
    model.opt.timestep = DURATION / steps
    model.opt.tolerance = 1e-14
    model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{INTEGRATORS[integrator]}")  # ty: ignore[missing-attribute]
    if softness == "stiff":
        stiffest = mjcf.stiffest_contact(model.opt.timestep)
        model.eq_solref[:] = [stiffest.time_constant, 1.0]
        model.eq_solimp[:, :2] = stiffest.impedance
    start = data.qpos.copy()

    def end() -> np.ndarray:
        data.qpos, data.qvel, data.time = start, 0.0, 0.0
        mujoco.mj_step(model, data, steps)
        return data.qpos[-7:-4].copy()

    return end


def measure(
    programs: dict[str, list[tuple[int, Callable[[], np.ndarray]]]], reference: np.ndarray, seconds: float
) -> Series:
    """Return the error and the CPU time of a simulated second of each point, by program."""
    series: Series = {}
    contenders: dict[str, tuple[Callable[[], object], int]] = {}
    for name, points in programs.items():
        series[name] = []
        for steps, end in points:
            error = float(np.linalg.norm(end() - reference))
            series[name].append({"steps": steps, "step_s": DURATION / steps, "error_m": error})
            contenders[f"{name} {steps}"] = repeated(end)
    times = rounds(contenders, seconds, time.process_time)
    for name, points in series.items():
        for point in points:
            point["cpu_us_per_s"] = 1e6 * float(times[f"{name} {point['steps']}"].min()) / DURATION
    return series


def repeated(end: Callable[[], np.ndarray]) -> tuple[Callable[[], object], int]:
    """Return a function that calls another one so often that it takes `LEAST_TIME`, and the number of calls."""

    def repeat(calls: int) -> None:
        for _ in range(calls):
            end()

    calls = 1
    while True:
        start = time.process_time()
        repeat(calls)
        if time.process_time() - start >= LEAST_TIME:
            return functools.partial(repeat, calls), calls
        calls *= 2


def time_at(series: Mapping[str, Sequence[Mapping[str, Any]]], name: str, error: float) -> float:
    """Return the CPU time of the fastest series of a program at an error, interpolated between logarithms.

    Values beyond the last point continue the line of the last two.
    """
    found = []
    for one, points in series.items():
        if not one.startswith(name):
            continue
        x, y = (np.log([p[key] for p in points]) for key in ("error_m", "cpu_us_per_s"))
        after = next((i for i in range(1, len(x)) if x[i] <= np.log(error)), None)
        if after is None:  # not reached: by the last two points, if they converge
            after = len(x) - 1
            if x[after] > x[after - 1] - np.log(1.5):
                continue
        slope = (y[after] - y[after - 1]) / (x[after] - x[after - 1])
        found.append(float(np.exp(y[after] + slope * (np.log(error) - x[after]))))
    return min(found)
