"""`python -m benchmarks [NAME ...]`: run all benchmarks, or those named, and write one JSON file each.

The status is 1 if a target is missed, 2 for a name that does not exist.
"""

from __future__ import annotations

import argparse
import ast
import datetime as dt
import importlib
import os
import shlex
import shutil
import subprocess
import sys
import tempfile
import time
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from benchmarks import NAMES, Outcome, status

HERE = Path(__file__).parent
PACKAGES = (
    "colift",
    "jax",
    "jaxlib",
    "numpy",
    "scipy",
    "mujoco",
    "pin",
    "scikit-learn",
    "gpytorch",
    "torch",
    "mujoco-mjx",
    "rotorpy",
)


def title(name: str) -> str:
    """Return the first line of a benchmark's docstring without importing it."""
    docstring = ast.get_docstring(ast.parse((HERE / f"{name}.py").read_text()))
    return (docstring or "").splitlines()[0]


def versions() -> dict[str, str]:
    """Return the versions of Python, the C compiler and the installed packages."""
    found = {"python": sys.version.split()[0]}
    compiler = os.environ.get("CC") or next(filter(shutil.which, ("cc", "gcc", "clang")), None)
    if compiler:
        output = subprocess.run([compiler, "--version"], capture_output=True, text=True, check=True).stdout
        found["compiler"] = output.splitlines()[0]
    for package in PACKAGES:
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "absent"
    return found


def record(name: str, outcome: Outcome, seconds: float, took: float, folder: Path) -> Path:
    """Write the result of a benchmark atomically."""
    from colift.runtime.atomic_write import write_json_atomic
    from evidence import files_behind, head, machine, uncommitted

    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{name}.json"
    files = files_behind(HERE / f"{name}.py")
    content: dict[str, Any] = {
        "benchmark": name,
        "description": title(name),
        "date": dt.date.today().isoformat(),
        "command": shlex.join(["python", "-m", "benchmarks", name, "--seconds", f"{seconds:g}"]),
        "machine": machine(),
        "load_average": os.getloadavg()[0],  # load by other programs
        "versions": versions(),
        "commit": head(),
        "uncommitted": uncommitted(files),
        "files": files,
        "wall_time_s": round(took, 1),
        "targets": outcome.targets,
        "omitted": list(outcome.omitted),
        "figures": outcome.figures,
    }
    write_json_atomic(content, path)
    return path


def main(arguments: list[str]) -> int:
    listing = "\n".join(f"  {name:<14} {title(name)}" for name in NAMES)
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks",
        description="Measure against peers: ratios in one run, and one JSON file a benchmark.",
        epilog=f"benchmarks:\n{listing}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("names", nargs="*", metavar="NAME", help="all of them if none is named")
    parser.add_argument("--list", action="store_true", help="list the benchmarks and stop")
    parser.add_argument("--status", action="store_true", help="print which results are behind and stop")
    parser.add_argument("--seconds", type=float, default=4.0, help="time for each comparison, s (default 4)")
    parser.add_argument("--results", type=Path, default=HERE / "results", help="folder for the JSON files")
    options = parser.parse_args(arguments)
    if unknown := [name for name in options.names if name not in NAMES]:
        print(f"no benchmark {', '.join(unknown)}; there are {', '.join(NAMES)}", file=sys.stderr)
        return 2
    if options.list:
        print(listing)
        return 0
    if options.status:
        return status.main(options.results)
    missed = []
    for name in options.names or NAMES:
        print(f"== {name}: {title(name)}", flush=True)
        start = time.perf_counter()
        outcome = importlib.import_module(f"benchmarks.{name}").run(options.seconds)
        for sentence in outcome.omitted:
            print(f"left out: {sentence}")
        for sentence, met in outcome.targets.items():
            print("met   " if met else "MISSED", sentence)
        missed += [sentence for sentence, met in outcome.targets.items() if not met]
        print(
            f"-> {record(name, outcome, options.seconds, time.perf_counter() - start, options.results)}\n", flush=True
        )
    print(f"{len(missed)} targets missed" + "".join(f"\n  {sentence}" for sentence in missed))
    return 1 if missed else 0


if __name__ == "__main__":
    # Caches start empty, so that compile times are measured; the variables are set before JAX is imported.
    with tempfile.TemporaryDirectory() as cache:
        os.environ["XDG_CACHE_HOME"] = cache
        os.environ.pop("JAX_COMPILATION_CACHE_DIR", None)
        try:
            exit_status = main(sys.argv[1:])
        except KeyboardInterrupt:
            print("interrupted; the benchmarks that had ended have their files", file=sys.stderr)
            exit_status = 130
    sys.exit(exit_status)
