"""One team on one core:

RK4 steps per CPU second and drift compared with MuJoCo and Pinocchio. The reference team (two agents with two arms and
three joints: 24 velocities, 12 constraints) starts at rest under hover inputs plus a small change, with steps of 1 ms.
A step of colift is RK4 and the projection onto the grasp; all team parameters are arguments and not constants of the
code. MuJoCo uses its RK4, Euler and implicitfast integrators with `connect` constraints at default stiffness.
Pinocchio's time is four calls of its constrained forward dynamics from Python, without an update of the state.
"""

from __future__ import annotations

import time
from dataclasses import replace

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from benchmarks import Outcome, microseconds, peers, plant, ratios, rounds, table
from colift import codegen
from colift.models import grasp

STEPS = 500


def run(seconds: float) -> Outcome:
    """Measure CPU seconds on one core, and the largest constraint error of each at the end."""
    team, z, (inputs,) = plant.hover(2)
    nudge = jnp.array([[0.02, 0.05, 0.01], [0.0, 0.03, -0.01]])  # N m: so that it moves
    case = team, z, (replace(inputs, tau=inputs.tau + nudge),)
    args = (*case, jnp.array(plant.DT))
    ours = jax.jit(codegen.compile(plant.rollout(STEPS), threads=1))
    called = codegen.compile(plant.step, threads=1)
    looped = jax.jit(
        lambda team, z, u, dt: jax.lax.scan(lambda z, _: (called(team, z, u, dt), None), z, None, STEPS)[0]
    )
    by_jax = jax.jit(plant.rollout(STEPS))
    model = peers.mujoco_team(team)
    data = peers.mujoco_state(model, case)
    start = np.concatenate([data.qpos, data.qvel])

    def by_mujoco(integrator: str = "RK4") -> None:
        model.opt.integrator = getattr(mujoco.mjtIntegrator, f"mjINT_{integrator}")  # ty: ignore[missing-attribute]
        data.qpos, data.qvel, data.time = start[: model.nq], start[model.nq :], 0.0
        mujoco.mj_step(model, data, STEPS)

    evaluations = peers.pinocchio_evaluations(case)
    contenders = {
        "native": (lambda: jax.block_until_ready(ours(*args)), STEPS),
        "native step in an XLA loop": (lambda: jax.block_until_ready(looped(*args)), STEPS),
        "JAX": (lambda: jax.block_until_ready(by_jax(*args)), STEPS),
        "MuJoCo RK4": (by_mujoco, STEPS),
        "MuJoCo Euler": (lambda: by_mujoco("EULER"), STEPS),
        "MuJoCo implicitfast": (lambda: by_mujoco("IMPLICITFAST"), STEPS),
        "Pinocchio, 4 evaluations": (lambda: [evaluations() for _ in range(50)], 50),
    }
    times = rounds(contenders, seconds, time.process_time)
    table("CPU time of a step", "a step", times, "native")
    end = ours(*args)
    by_mujoco()
    mujoco.mj_forward(model, data)
    gaps = {
        "native": float(jnp.abs(grasp.constraint_residual(team, end)).max()),
        "JAX": float(jnp.abs(grasp.constraint_residual(team, by_jax(*args))).max()),
        "MuJoCo RK4": float(np.abs(data.efc_pos[: data.ne]).max()),
    }
    apart = float(np.linalg.norm(np.asarray(end.payload.p) - data.qpos[-7:-4]))
    print(f"largest gap after {STEPS} steps, m: " + ", ".join(f"{name} {gap:.2g}" for name, gap in gaps.items()))
    print(f"payloads end {apart:.2g} m apart (MuJoCo's constraints are compliant)")
    faster, by_jax_ratio = ratios(times, "native")["MuJoCo RK4"], ratios(times, "JAX")["MuJoCo RK4"]
    return Outcome(
        figures={
            "time_per_step_us": microseconds(times),
            "ratio_to_native": ratios(times, "native"),
            "steps_per_cpu_second": {name: 1e6 / t for name, t in microseconds(times).items()},
            "contact_gap_m": gaps,
            "payload_distance_m": apart,
        },
        targets={
            f"native {faster:.2f}x MuJoCo's RK4, at least 5x": faster >= 5,
            f"JAX {by_jax_ratio:.2f}x MuJoCo's RK4, at least 0.7x": by_jax_ratio >= 0.7,
        },
    )
