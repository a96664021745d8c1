"""Ctrl-C and SIGTERM end a run at any point: 40 and 8 trials, in separate processes.

The runs are short commands. The times of the signals are distributed over a whole run: imports, compilation, flights,
fits, figures and writing. They count from the installation of the signal handlers; before that the interpreter itself
starts.
"""

from __future__ import annotations

import functools
import json
import os
import re
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import h5py
import matplotlib.image

import colift.scenario
from colift.runtime import run_directory, signals
from evidence import collect

RUNS = ("src",)  # in child processes
ALLOWED = 2 * signals.GRACE_PERIOD  # s, from the signal to the end; the machine may be busy with other things
LAST_STEP = 0.5  # s, the interpreter ends within this time after everything is written
SCENARIOS = Path(colift.scenario.__file__).parent / "library"
COLIFT = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a shell's background, which colift respects
from colift.cli.app import main
main()
"""


class TrialKind(NamedTuple):
    """One kind of trial; the signals are distributed over the time `over` [s], by default over a whole run."""

    signal: signal.Signals
    command: str
    cached: bool  # whether compiled programs are
    number: int
    over: float | None = None


TRIES = {
    "study": TrialKind(signal.SIGINT, "study", True, 28),
    "study, nothing compiled": TrialKind(signal.SIGINT, "study", False, 6, 60.0),
    "certify": TrialKind(signal.SIGINT, "certify", True, 6, 60.0),
    "study, SIGTERM": TrialKind(signal.SIGTERM, "study", True, 8),
}


@functools.cache
def _working_folder() -> tempfile.TemporaryDirectory[str]:
    """Return a folder with a scenario of 1.5 s of flight and two updates, and with the shipped `certified`."""
    work = tempfile.TemporaryDirectory()
    text = (SCENARIOS / "paper.yaml").read_text()
    for key, value in (
        ("duration_s", "1.5"),
        ("  end_s", "1"),
        ("  update_times_s", "[0.5, 1]"),
    ):
        text, found = re.subn(rf"(?m)^({key}:).*", rf"\1 {value}", text)
        assert found == 1, key
    (Path(work.name) / "study.yaml").write_text(text)
    (Path(work.name) / "certify.yaml").write_text((SCENARIOS / "certified.yaml").read_text())
    return work


def begin(command: str, out: Path, cached: bool) -> subprocess.Popen[str]:
    """Start a command and wait until it handles signals."""
    work = Path(_working_folder().name)
    environment = dict(os.environ) if cached else os.environ | {"JAX_COMPILATION_CACHE_DIR": f"{out}-compiled"}
    run = subprocess.Popen(
        [sys.executable, "-c", COLIFT, command, str(work / f"{command}.yaml"), "--out", str(out)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    )
    wait_for_handlers(run)
    return run


def wait_for_handlers(run: subprocess.Popen[str]) -> None:
    """Wait until a process handles SIGTERM or has ended."""
    handled = 1 << (signal.SIGTERM - 1)
    while run.poll() is None:
        caught = re.search(r"SigCgt:\s*(\w+)", Path(f"/proc/{run.pid}/status").read_text())
        if caught and int(caught[1], 16) & handled:
            return
        time.sleep(0.01)


@functools.cache
def undisturbed_duration(command: str) -> float:
    """Return the duration [s] of an undisturbed run with cached programs."""
    for _ in range(2):
        with tempfile.TemporaryDirectory() as out:
            run, began = begin(command, Path(out) / "out", cached=True), time.monotonic()
            _, output = run.communicate()
            took = time.monotonic() - began
        if run.returncode:
            raise RuntimeError(f"{command}, undisturbed, ends with {run.returncode}: {output}")
    return took


def run_trial(item: str) -> dict[str, Any]:
    """Return the result of one trial: signal, end of the process and remaining files."""
    kind, _, k = item.rpartition(" ")
    tries = TRIES[kind]
    at = (int(k) + 0.5) / tries.number * (tries.over or undisturbed_duration(tries.command))
    while True:
        with tempfile.TemporaryDirectory() as place:
            out = Path(place) / "out"
            run, began = begin(tries.command, out, tries.cached), time.monotonic()
            try:
                run.wait(at)
            except subprocess.TimeoutExpired:
                signal_time = round(time.monotonic() - began, 2)
                result = _interrupted(run, tries.signal, out)
                if not had_ended(run.returncode, tries.signal, result["exit_time_s"], out):
                    return result | {"signal_time_s": signal_time}
        at *= 0.8  # it had ended: the machine is faster than when the whole run was timed


def had_ended(status: int, number: signal.Signals, exit_time: float, out: Path) -> bool:
    """Return whether a run had written its output and handled no signals any more when it was sent one."""
    return status in (0, -number) and exit_time < LAST_STEP and out.exists()


def _interrupted(run: subprocess.Popen[str], number: signal.Signals, out: Path) -> dict[str, Any]:
    run.send_signal(number)
    requested = time.monotonic()
    _, output = run.communicate(timeout=60)
    took = time.monotonic() - requested
    return {
        "exit_time_s": round(took, 2),
        "last_message": output.splitlines()[-1:],
        "remaining_files": sorted(path.name for path in out.iterdir()) if out.exists() else [],
        "failures": [*_wrong(run.returncode, 128 + number, output, took), *_broken(out)],
    }


def _wrong(status: int, expected: int, output: str, took: float) -> list[str]:
    wrong = []
    if status != expected:
        wrong.append(f"status {status}")
    if "Traceback" in output or "Exception" in output:
        wrong.append(f"says {output[-2000:]}")
    if took > ALLOWED:
        wrong.append(f"took {took:.1f} s")
    return wrong


def _broken(out: Path) -> list[str]:
    """Return files that are incomplete, name no run, or should have been removed."""
    wrong = []
    for path in out.iterdir() if out.exists() else ():
        try:
            _read(path)
        except (OSError, ValueError) as error:
            wrong.append(f"{path.name}: {error}")
    return wrong


def _read(path: Path) -> None:
    """Read a file completely; raise ValueError or OSError if it is incomplete."""
    if path.name.startswith("."):
        raise ValueError("should have been cleared up")
    if run_directory.read_run_id(path) is None:
        raise ValueError("names no run")
    content = path.read_bytes()
    if path.suffix == ".nc":
        with h5py.File(path) as file:
            file["time"][:]
    elif path.suffix == ".json":
        json.loads(content)
    elif path.suffix == ".png":
        matplotlib.image.imread(path)
    elif not content.endswith(b"%%EOF\n" if path.suffix == ".pdf" else b"\n"):
        raise ValueError("ends early")


def main() -> bool:
    """Interrupt all runs; every one must end in time, with the status of its signal and without partial files."""
    items = [f"{kind} {k}" for kind, tries in TRIES.items() for k in range(tries.number)]
    found = collect("interrupts", items, run_trial)
    for kind, tries in TRIES.items():
        each = [found[f"{kind} {k}"] for k in range(tries.number)]
        clean, longest = sum(not one["failures"] for one in each), max(one["exit_time_s"] for one in each)
        print(f"{kind}: {clean} of {tries.number} end cleanly, after {longest:.1f} s at most")
    for item in items:
        for wrong in found[item]["failures"]:
            print(f"{item}: {wrong}")
    return not any(found[item]["failures"] for item in items)


if __name__ == "__main__":
    main()
