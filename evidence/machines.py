"""Numerical tests with other linear algebra, other vector instructions and in other orders.

Each run executes the tests of `FOLDERS`. OpenBLAS is limited to the kernels of one processor, XLA to one instruction
set, and the test files are shuffled. The result contains counts of passed and failed tests, time, and the memory of the
largest process. Without AVX-512 its setting is omitted.
"""

from __future__ import annotations

import os
import random
import re
import resource
import subprocess
import sys
import tempfile
import time
from typing import Any

from evidence import ROOT, _cpuinfo, collect

RUNS = ("src", "tests", "examples", "evidence", "benchmarks")  # which one run starts
FOLDERS = (  # of the tests with numbers that depend on rounding
    *("oracles", "properties"),
    *(f"unit/{name}" for name in ("analysis", "certification", "closed_loop", "codegen", "gp", "math", "models")),
    *(f"unit/{name}" for name in ("onboard", "simulation", "trajectories")),
)
BLAS = ("Nehalem", "Haswell", "Zen", "SkylakeX")
INSTRUCTIONS = ("SSE4_2", "AVX2")
WORKER_MB = 2500  # a laptop has 8 to 16 GB, and two workers run
LIMIT_S = 7200


def has_avx512() -> bool:
    """Return whether this processor has AVX-512."""
    return any("avx512f" in line for line in _cpuinfo())


def settings() -> list[str]:
    """Return `OpenBLAS kernels, XLA instructions` of all runs on this processor; the instruction sets alternate."""
    kernels = [blas for blas in BLAS if has_avx512() or blas != "SkylakeX"]
    return [f"{blas} {INSTRUCTIONS[i % len(INSTRUCTIONS)]}" for i, blas in enumerate(kernels)]


def flags(isa: str) -> str:
    """Return XLA's flags for an instruction set; none if it is the largest of the processor."""
    held = [f"--xla_cpu_max_isa={isa}"] if has_avx512() or isa != "AVX2" else []
    return " ".join([*os.environ.get("XLA_FLAGS", "").split(), *held])


def run(setting: str) -> dict[str, Any]:
    """Run the numerical tests with one setting, with files shuffled by the index of the setting."""
    blas, isa = setting.split()
    paths = [path for folder in FOLDERS for path in (ROOT / "tests" / folder).rglob("test_*.py")]
    files = sorted(path.relative_to(ROOT).as_posix() for path in paths)
    order = settings().index(setting)
    random.Random(order).shuffle(files)
    began = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "pytest", "-n", "2", "--dist", "loadfile", "-p", "no:cacheprovider"]
        done = subprocess.run(
            [*command, f"--basetemp={folder}/made", "-q", *files],
            cwd=ROOT,
            env=os.environ | {"OPENBLAS_CORETYPE": blas, "XLA_FLAGS": flags(isa)},
            capture_output=True,
            text=True,
            check=False,
            timeout=LIMIT_S,
        )
    counts = {what: int(n) for n, what in re.findall(r"(\d+) (passed|failed|errors?|skipped)", done.stdout[-500:])}
    print(f"  {counts}, {time.perf_counter() - began:.0f} s", flush=True)
    return {
        "order": order,
        "status": done.returncode,
        **counts,
        "failures": re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE),
        "wall_time_s": round(time.perf_counter() - began),
        # the largest of all processes so far: of this run, or of one before
        "largest_process_MB": resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss // 1024,
    }


def main() -> bool:
    """Run the tests with every setting; all must pass, and no worker may exceed the memory limit."""
    found = collect("machines", settings(), run)
    for setting, one in found.items():
        print(
            f"{setting:<16} order {one['order']}: {one.get('passed', 0)} passed, {len(one['failures'])} failed, "
            f"{one['wall_time_s']} s, largest process {one['largest_process_MB']} MB"
        )
    return all(one["status"] == 0 and one["largest_process_MB"] <= WORKER_MB for one in found.values())


if __name__ == "__main__":
    main()
