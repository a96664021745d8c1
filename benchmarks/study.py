"""The paper's study, `colift study paper`, with empty and full caches: wall-clock seconds in total and by case."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from benchmarks import Outcome


def run(seconds: float) -> Outcome:
    """Measure two runs in child processes."""
    del seconds  # a study lasts as long as it lasts
    figures: dict[str, dict[str, object]] = {}
    with tempfile.TemporaryDirectory() as folder:
        env = {**os.environ, "XDG_CACHE_HOME": f"{folder}/cache"}
        env.pop("JAX_COMPILATION_CACHE_DIR", None)
        for caches in ("empty", "full"):
            out = Path(folder) / caches
            command = [sys.executable, "-m", "colift", "study", "paper", "--out", str(out)]
            start = time.perf_counter()
            subprocess.run(command, check=True, env=env, capture_output=True)
            took = time.perf_counter() - start
            summary = json.loads((out / "summary.json").read_text())
            cases = {name: case["wall_time_s"] for name, case in summary["cases"].items()}
            figures[caches] = {"total_time_s": took, "cases": cases, **summary["wall_time_s"]}
            print(f"caches {caches}: {took:.1f} s in all")
            for name, wall in cases.items():
                print(f"  {name}: " + ", ".join(f"{part} {s:.1f} s" for part, s in wall.items()))
    return Outcome(figures)
