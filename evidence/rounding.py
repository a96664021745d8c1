"""Metrics under other rounding:

C2 and C3 with other kernels of BLAS and XLA, each in a child process. The processor determines the order of sums in
OpenBLAS and XLA. Here they use the order of another processor, so the differences of the metrics are due to rounding.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from threadpoolctl import threadpool_info

from colift import scenario
from colift.analysis import metrics
from colift.closed_loop.flight import run_experiment
from colift.scenario import experiment
from evidence import collect

SEEDS = (0, 3)
CASES = ("C2", "C3")
BLAS = ("Nehalem", "Haswell", "Zen")  # and SkylakeX where the processor has AVX-512
XLA = ("default", "SSE4_2")  # and AVX2 where it is not the default
FIGURES = ("e_p_rms_m", "e_R_rms", "Psi_mean", "delta_W_rms")
LIMIT = 0.03  # of the median, between the least and the greatest over all settings


def items() -> list[str]:
    """Return seed, OpenBLAS core type and XLA instruction set of each flight, the most different settings first."""
    wide = "avx512f" in Path("/proc/cpuinfo").read_text(encoding="utf-8")
    # builds of OpenBLAS without kernels for a core take another's: one flight is enough
    cores = list({kernels(core): core for core in reversed((*BLAS, *["SkylakeX"] * wide))}.values())[::-1]
    sets = (*XLA, *["AVX2"] * wide)
    pairs = sorted(product(range(len(cores)), range(len(sets))), key=lambda pair: (pair[0] - pair[1]) % len(sets))
    return [f"{seed} {cores[i]} {sets[k]}" for i, k in pairs for seed in SEEDS]


def kernels(core: str) -> str:
    """Return the architecture that OpenBLAS uses for a core type."""
    code = "import scipy.linalg, threadpoolctl; print({x.get('architecture') for x in threadpoolctl.threadpool_info()})"
    env = {**os.environ, "OPENBLAS_CORETYPE": core}
    return subprocess.run([sys.executable, "-c", code], env=env, check=True, capture_output=True, text=True).stdout


def run_item(item: str) -> dict[str, Any]:
    """Return the metrics of one item, simulated in a process with its settings."""
    seed, core, isa = item.split()
    flags = [f for f in os.environ.get("XLA_FLAGS", "").split() if "xla_cpu_max_isa" not in f]
    flags += [] if isa == "default" else [f"--xla_cpu_max_isa={isa}"]
    env = {**os.environ, "OPENBLAS_CORETYPE": core, "XLA_FLAGS": " ".join(flags)}
    code = f"from evidence import rounding; rounding.print_metrics({seed})"
    done = subprocess.run([sys.executable, "-c", code], env=env, check=True, capture_output=True, text=True)
    return json.loads(done.stdout.splitlines()[-1])


def print_metrics(seed: int) -> None:
    """Simulate the cases of one seed with the settings of this process and print the metrics as JSON on the last
    line.
    """
    settings = scenario.load_scenario("paper").model_copy(update={"seed": seed})
    found: dict[str, Any] = {
        "blas": sorted({lib["architecture"] for lib in threadpool_info() if "architecture" in lib})
    }
    for case in CASES:
        one = experiment.make_experiment(settings, case)
        flight = run_experiment(one)
        merit = metrics.summary(flight, one.world.team, one.controller.team)
        found[case] = {name: merit[name] for name in FIGURES}
    print(json.dumps(found))


def main() -> bool:
    """Simulate all items; no metric of a seed and a case may vary by more than `LIMIT`."""
    flown, worst = collect("rounding", items(), run_item), 0.0
    print("seed  case  figure           least     greatest   spread")
    for seed, case, name in product(SEEDS, CASES, FIGURES):
        values = np.array([found[case][name] for item, found in flown.items() if item.split()[0] == str(seed)])
        spread = float(np.ptp(values) / np.median(values))
        worst = max(worst, spread)
        print(f"{seed:>4}  {case:>4}  {name:<13} {values.min():11.6g} {values.max():11.6g}   {spread:.1e}")
    return worst <= LIMIT


if __name__ == "__main__":
    main()
