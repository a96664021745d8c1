"""`tune` writes its best gains so far when it is interrupted: 20 signals at random times, in separate processes.

SIGINT, SIGTERM and SIGHUP are sent in turn, at random times between the installation of the signal handlers and the end
of a search with a small budget. The file must then be a complete scenario whose first line states that the search is
not complete. Five further processes are killed; their file must be absent or complete.
"""

from __future__ import annotations

import functools
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from colift import scenario
from colift.cli.scenario import INCOMPLETE_SEARCH
from colift.runtime import signals
from evidence import collect, interrupts
from tests.support import small_team

RUNS = ("src",)  # in child processes
SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
INTERRUPTS, KILLS = 20, 5
ALLOWED = 3 * signals.GRACE_PERIOD  # s, from the signal to the end; the machine may be busy with other things
TUNE = """
import signal
signal.signal(signal.SIGINT, signal.default_int_handler)  # ignored in a shell's background, which colift respects
signal.signal(signal.SIGHUP, signal.SIG_DFL)
from colift.analysis import gain_tuning
gain_tuning.MAX_LINEARIZATIONS, gain_tuning.MAX_SIMULATIONS = 24, 10
from colift.cli.app import main
main()
"""


def _begin(place: Path) -> subprocess.Popen[str]:
    """Start a search and wait until it handles signals."""
    learning = {"update_times_s": (0.5,), "start_s": 0.1, "end_s": 0.5, "max_samples": 8}
    learning = small_team.SAMPLE.learning.model_copy(update=learning)
    file = small_team.write(place / "small.yaml", duration_s=1.0, learning=learning)
    run = subprocess.Popen(
        [sys.executable, "-c", TUNE, "tune", str(file), "--out", str(place / "tuned.yaml"), "-q"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
        env=dict(os.environ),
    )
    interrupts.wait_for_handlers(run)
    return run


@functools.cache
def _duration() -> float:
    """Return the duration [s] of an undisturbed search with cached programs."""
    took = 0.0
    for _ in range(2):
        with tempfile.TemporaryDirectory() as place:
            run, began = _begin(Path(place)), time.monotonic()
            _, errors = run.communicate()
            took = time.monotonic() - began
            if run.returncode or (Path(place) / "tuned.yaml").read_text().startswith(INCOMPLETE_SEARCH):
                raise RuntimeError(f"tune, undisturbed, ends with {run.returncode}: {errors}")
    return took


def run_trial(item: str) -> dict[str, Any]:
    """Return signal, time, and the faults of one trial.

    Args:
        item: Kind and number.
    """
    kind, _, k = item.rpartition(" ")
    number = signal.SIGKILL if kind == "kill" else SIGNALS[int(k) % len(SIGNALS)]
    share = random.Random(item).uniform(0, 1)
    while True:
        with tempfile.TemporaryDirectory() as place:
            run, began = _begin(Path(place)), time.monotonic()
            try:
                run.wait(share * _duration())
            except subprocess.TimeoutExpired:
                at, out = round(time.monotonic() - began, 2), Path(place) / "tuned.yaml"
                result = {"signal": number.name, "signal_time_s": at, **_end(run, number, out)}
                complete = out.exists() and not out.read_text().startswith(INCOMPLETE_SEARCH)
                if number == signal.SIGKILL or not (
                    complete and interrupts.had_ended(run.returncode, number, result["exit_time_s"], out)
                ):
                    return result
        share *= 0.8  # it had ended: the machine is faster than when the whole search was timed


def _end(run: subprocess.Popen[str], number: signal.Signals, out: Path) -> dict[str, Any]:
    """Send the signal and return the time to the end, the last message, and the faults."""
    run.send_signal(number)
    requested = time.monotonic()
    _, errors = run.communicate(timeout=120)
    took = time.monotonic() - requested
    faults = []
    if run.returncode != (-number if number == signal.SIGKILL else 128 + number):
        faults.append(f"status {run.returncode}")
    if "Traceback" in errors or took > ALLOWED:
        faults.append(f"ends after {took:.1f} s with {errors[-1000:]}")
    if out.exists():
        try:
            scenario.load_scenario(out)
        except scenario.ScenarioError as error:
            faults.append(f"the file is not a scenario: {error}")
        if not out.read_text().startswith(INCOMPLETE_SEARCH):
            faults.append("the file does not state that the search is not complete")
    elif number != signal.SIGKILL:
        faults.append("there is no file")
    changed = out.exists() and scenario.load_scenario(out).control != small_team.settings().control
    return {
        "exit_time_s": round(took, 2),
        "last_message": errors.splitlines()[-1:],
        "gains_changed": changed,
        "faults": faults,
    }


def main() -> bool:
    """Interrupt all searches; each must write its best gains."""
    items = [*(f"interrupt {k}" for k in range(INTERRUPTS)), *(f"kill {k}" for k in range(KILLS))]
    found = collect("handover", items, run_trial)
    good = sum(not found[f"interrupt {k}"]["faults"] for k in range(INTERRUPTS))
    changed = sum(found[item]["gains_changed"] for item in items)
    print(f"{good} of {INTERRUPTS} interrupts leave a complete scenario; {changed} of all files have changed gains")
    for item in items:
        for fault in found[item]["faults"]:
            print(f"{item}: {fault}")
    return not any(found[item]["faults"] for item in items)


if __name__ == "__main__":
    main()
