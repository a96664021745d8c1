"""Test suite on each supported Python with the oldest and the newest allowed versions of all packages.

`uv` selects the versions from pyproject.toml: the lowest allowed version of every direct dependency, or the newest
version of every package. Only wheels are installed, so the lowest version is the lowest with a wheel for that Python.
Each environment is made in a temporary folder, and the suite runs as with `./dev test`. Python versions that `uv` does
not find and cannot install are reported and not stored.

    python -m evidence.environments PYTHON oldest|newest FOLDER      makes one environment in a folder
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from evidence import ROOT, collect

RUNS = ("src", "tests", "examples", "evidence", "benchmarks")  # in processes of other environments
PYTHONS = ("3.11", "3.12", "3.13", "3.14")
RESOLUTIONS = {"oldest": "lowest-direct", "newest": "highest"}
NAMED = ("jax", "jaxlib", "numpy", "scipy", "pydantic", "mujoco", "pin", "matplotlib", "h5py", "xarray", "pytest")
LIMIT_S = 4 * 3600
UV = (sys.executable, "-m", "uv")


def environments() -> list[str]:
    """The environments, those at the ends of the supported range first."""
    ends = ["3.11 oldest", "3.14 newest"]
    return [*ends, *(one for one in (f"{p} {which}" for p in PYTHONS for which in RESOLUTIONS) if one not in ends)]


def interpreter(python: str) -> str | None:
    """The interpreter of a Python version, installed by `uv` if it is not found; None if that fails."""
    for command in ("find", "install", "find"):
        done = subprocess.run([*UV, "python", command, python], capture_output=True, text=True, check=False)
        if command == "find" and done.returncode == 0:
            return done.stdout.strip()
    return None


def make(python: str, which: str, folder: Path) -> dict[str, str]:
    """Make an environment with colift and the test dependencies; the versions of its packages."""
    pins, made = folder / "pins.txt", folder / "venv"
    path = interpreter(python)
    if path is None:
        raise SystemExit(f"Python {python} was not found and could not be installed")
    selected = ["--group", "run", "--group", "test", "--resolution", RESOLUTIONS[which], "--output-file", str(pins)]
    for words in (
        ["pip", "compile", "--python", path, "--no-build", "--no-header", "--no-annotate", "pyproject.toml", *selected],
        ["venv", "--python", path, str(made)],
        ["pip", "sync", "--python", str(made), str(pins)],
        ["pip", "install", "--python", str(made), "--no-deps", "--editable", "."],
    ):
        subprocess.run([*UV, "--quiet", *words], cwd=ROOT, check=True)
    return dict(re.findall(r"^([\w.-]+)==([^\s;]+)", pins.read_text(), re.MULTILINE))


def run(environment: str) -> dict[str, Any]:
    """The suite in one environment."""
    python, which = environment.split()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        versions = make(python, which, folder)
        command = [str(folder / "venv" / "bin" / "python"), "-m", "pytest", "-n", "2", "--dist", "loadfile", "-q"]
        began = time.perf_counter()
        done = subprocess.run(
            [*command, "-p", "no:cacheprovider", f"--basetemp={folder / 'made'}"],
            cwd=ROOT,
            env={key: value for key, value in os.environ.items() if key not in ("PYTHONPATH", "VIRTUAL_ENV")},
            capture_output=True,
            text=True,
            check=False,
            timeout=LIMIT_S,
        )
    counts = {what: int(n) for n, what in re.findall(r"(\d+) (passed|failed|errors?|skipped)", done.stdout[-500:])}
    return {
        "status": done.returncode,
        "passed_tests": counts.pop("passed", 0),
        **counts,
        "failures": re.findall(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE),
        "wall_time_s": round(time.perf_counter() - began),
        "versions": {name: versions[name] for name in NAMED if name in versions},
    }


def main() -> bool:
    """Run the suite in every environment whose Python exists here; holds if all exist and no test fails."""
    missing = [python for python in PYTHONS if interpreter(python) is None]
    found = collect("environments", [one for one in environments() if one.split()[0] not in missing], run)
    for environment, one in found.items():
        versions = ", ".join(f"{name} {version}" for name, version in list(one["versions"].items())[:4])
        print(f"{environment}: {one['passed_tests']} passed, {len(one['failures'])} failed; {versions}")
    for python in missing:
        print(f"Python {python} was not found and could not be installed")
    return not missing and all(one["status"] == 0 for one in found.values())


if __name__ == "__main__":
    make(sys.argv[1], sys.argv[2], Path(sys.argv[3]))
