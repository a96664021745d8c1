"""Growth with the number of agents: time per step and agent of one team and of 16 teams, and compile time.

N agents in a row hold one payload. Inputs are the thrust that carries the weight. A step is 0.1 ms, so that the team
stays near its initial state; the cost of a step depends on neither.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import jax
import jax.numpy as jnp

from benchmarks import Outcome, plant, ratios, rounds
from colift import codegen

AGENTS = (2, 4, 8, 16, 32, 64)
DT = 1e-4  # s
STEPS = 1000  # of one agent


def prepare_rollout(agents: int, samples: int) -> tuple[Callable[[], object], int, float]:
    """Return a run, its number of steps times agents, and the seconds to trace, emit, compile and run it once."""
    leaves, tree = jax.tree.flatten(plant.supported_team(agents))
    steps = max(STEPS // agents // samples, 10)
    run = codegen.compile(
        lambda *x: jax.tree.leaves(plant.rollout(steps)(*jax.tree.unflatten(tree, x), jnp.array(DT))), threads=1
    )
    args = leaves if samples == 1 else [jnp.repeat(x[None], samples, 0) for x in leaves]
    run = jax.jit(run if samples == 1 else jax.vmap(run))
    start = time.perf_counter()
    jax.block_until_ready(run(*args))
    took = time.perf_counter() - start
    return lambda: jax.block_until_ready(run(*args)), steps * agents * samples, took


def run(seconds: float) -> Outcome:
    """Measure ratios to N = 4."""
    figures, targets, slowest = {}, {}, 0.0
    for samples in (1, 16):
        made = {str(n): prepare_rollout(n, samples) for n in AGENTS}
        times = rounds({n: (once, pieces) for n, (once, pieces, _) in made.items()}, seconds, time.process_time)
        to_4 = ratios(times, "4")
        print(f"{samples} at once: us a step and agent, ratio to N = 4, seconds to compile and run once")
        rows = {}
        for n, t in times.items():
            rows[n] = {
                "time_per_step_and_agent_us": float(jnp.median(t)) * 1e6,
                "ratio_to_4": to_4[n],
                "compile_time_s": made[n][2],
            }
            print(f"  N = {n:<3} {rows[n]['time_per_step_and_agent_us']:>8.3g} {to_4[n]:>8.3g}x {made[n][2]:>8.3g} s")
        slowest = max(slowest, made["64"][2])
        worst = max(to_4, key=to_4.__getitem__)
        targets[f"{samples} at once: at most {to_4[worst]:.2f}x of N = 4 (at N = {worst}), within 1.3x"] = (
            to_4[worst] <= 1.3
        )
        figures[f"{samples} at once"] = rows
    targets[f"N = 64 compiles in {slowest:.1f} s, within 20 s"] = slowest <= 20
    return Outcome(figures, targets)
