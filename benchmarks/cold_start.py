"""Cold start: time from process start to the first step, with empty and full caches; wall-clock and CPU seconds.

The CPU time includes the compiler; its difference to the wall-clock time shows the load of the machine. Caches are
those of JAX, of the native back end and of Python (pip compiles the bytecode of packages at installation, uv does not).
A start with full caches is the fastest of three.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks import Outcome

LIMITS = {"empty": 12.0, "full": 4.0}  # s
REPEATS = {"empty": 1, "full": 3}  # the least counts: other programs only add
SCRIPT = """
import jax, jax.numpy as jnp
from colift import codegen
from colift.models.state import AgentInput, zero_residual
from colift.simulation import contact_dynamics
from tests.support import random_teams as teams
team, z = teams.reference_team(2), teams.reference_guess(2)
u = (AgentInput(u=jnp.zeros(2), tau=jnp.zeros((2, 3)), tau_r=jnp.zeros((2, 3))),)
rk4 = lambda team, z, u, dt: contact_dynamics.rkmk4_step(team, z, u, lambda _z, _t: zero_residual(team), dt)
step = lambda team, z, u, dt: contact_dynamics.project_to_constraints(team, rk4(team, z, u, dt))
by = codegen.compile if "{back_end}" == "native" else (lambda f: f)
jax.block_until_ready(jax.jit(by(step))(team, z, u, jnp.array(1e-3)))
"""


def run(seconds: float) -> Outcome:
    """Measure import, trace, code generation, compilation and one step; also with JAX's own back end."""
    del seconds  # one start is one start
    figures: dict[str, dict[str, dict[str, float]]] = {}
    for back_end in ("native", "JAX"):
        figures[back_end] = {}
        with tempfile.TemporaryDirectory() as cache:
            env = {**os.environ, "XDG_CACHE_HOME": cache}
            for switched_off in ("JAX_COMPILATION_CACHE_DIR", "PYTHONDONTWRITEBYTECODE"):
                env.pop(switched_off, None)
            for caches in LIMITS:
                command = [sys.executable, "-c", SCRIPT.replace("{back_end}", back_end)]
                starts = [_start(command, env) for _ in range(REPEATS[caches])]
                figures[back_end][caches] = min(starts, key=lambda took: took["wall_time_s"])
                print(
                    f"{back_end}, caches {caches}: {{wall_time_s:.2f}} s, CPU {{cpu_time_s:.2f}} s".format(
                        **figures[back_end][caches]
                    )
                )
    return Outcome(
        figures,
        {
            f"{back_end}, caches {caches}: {took['wall_time_s']:.1f} s, under {LIMITS[caches]:g} s": took["wall_time_s"]
            < LIMITS[caches]
            for back_end, found in figures.items()
            for caches, took in found.items()
        },
    )


def _start(command: list[str], env: dict[str, str]) -> dict[str, float]:
    start, before = time.perf_counter(), _cpu()
    subprocess.run(command, check=True, env=env, cwd=Path(__file__).resolve().parents[1])
    return {"wall_time_s": time.perf_counter() - start, "cpu_time_s": _cpu() - before}


def _cpu() -> float:
    """Return CPU seconds of the ended child processes."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime
