"""No file operation that fails, and no `kill -9`, loses results: each operation of four commands in turn.

A library in C, loaded before the C library, lets the n-th file operation below the folder of the results fail with "no
space left on device", or ends the process there. Further processes are killed at random times. Afterwards the folder
contains all earlier or all new results, and the next command removes the remaining hidden files.

Each command first runs once without faults. Its flights, bounds and figures are then stored, so that the repetitions
take a second; reading, staging, writing and exchange of folders run as always.
"""

from __future__ import annotations

import ctypes
import dataclasses
import functools
import json
import os
import random
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from typer.testing import CliRunner

from colift import scenario
from colift.analysis import gain_tuning
from colift.cli import common
from colift.cli.app import app
from colift.runtime import atomic_write
from colift.visualization import playback
from colift.workflows import certification, study
from evidence import collect
from tests.support import small_team

RUNS = ("src",)  # commands import their modules when they run
COMMANDS = ("study", "certify", "report", "tune")
RANDOM_KILLS = 50  # of each command
SOURCE = "file_faults.c"


def _small_scenario(folder: Path) -> Path:
    """Write a scenario of 0.4 s of flight and one update."""
    learning = {"update_times_s": (0.2,), "start_s": 0.05, "end_s": 0.2, "max_samples": 8}
    settings = small_team.SAMPLE.learning.model_copy(update=learning)
    return small_team.write(folder / "small.yaml", duration_s=0.4, learning=settings)


@functools.cache
def _setup() -> tempfile.TemporaryDirectory[str]:
    """Return a folder with the library, a scenario, and results of C3 with certificate and report."""
    work = tempfile.TemporaryDirectory()
    folder = Path(work.name)
    source = Path(__file__).with_name(SOURCE)
    library = folder / "faults.so"
    subprocess.run(["cc", "-shared", "-fPIC", "-O1", "-w", "-o", str(library), str(source), "-ldl"], check=True)
    file = str(_small_scenario(folder))
    out = ["--out", str(folder / "earlier")]
    for words in (["study", file, "--case", "C3", *out, "-q"], ["certify", file, *out, "-q"], ["report", out[1]]):
        done = CliRunner().invoke(app, words, catch_exceptions=False)
        assert done.exit_code == 0, done.output
    return work


def run_command(command: str) -> dict[str, Any]:
    """Return the number of operations, failures and kills of a command, and the faults.

    Args:
        command: One of `COMMANDS`.
    """
    folder = _setup().name
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-m", "evidence.file_faults", command, folder],
        env=os.environ | {"LD_PRELOAD": f"{folder}/faults.so"},
        stdout=subprocess.PIPE,
        text=True,
        check=True,
    )
    return json.loads(done.stdout.splitlines()[-1])


# Process with the library ---------------------------------------------------------------------------------------------

FAULTS = ctypes.CDLL(None)


def _arm(folder: Path | None, number: int = 0, kill: bool = False) -> None:
    """Let an operation below a folder fail or end the process; operations are counted from now on."""
    FAULTS.fault_arm(os.fsencode(folder or ""), ctypes.c_long(number), int(kill))


def _store(module: ModuleType, name: str) -> None:
    """Replace a function by one that returns the result of its first call."""
    original, results = getattr(module, name), []

    @functools.wraps(original)
    def stored(*args: Any, **kwargs: Any) -> Any:
        if not results:
            results.append(original(*args, **kwargs))
        return results[0]

    setattr(module, name, stored)


def _store_files(module: ModuleType, name: str, argument: int) -> None:
    """Replace a function that writes files by one that writes the files of its first call again.

    Args:
        module: Module of the function.
        name: Name of the function, which returns the paths of the files.
        argument: Index of the argument with the path: a folder, or a file without suffix.
    """
    original = getattr(module, name)
    files: list[tuple[str, bytes]] = []

    @functools.wraps(original)
    def stored(*args: Any, **kwargs: Any) -> Any:
        folder = Path(args[argument])
        folder = folder if folder.is_dir() else folder.parent
        if not files:
            files.extend((path.name, path.read_bytes()) for path in original(*args, **kwargs))
        for file, content in files:
            atomic_write.write_atomic(folder / file, content)
        return [folder / file for file, _ in files]

    setattr(module, name, stored)


def _store_computations(command: str) -> None:
    """Store what a command computes when it runs for the first time."""
    from colift.analysis import contact_forces, feasibility, metrics
    from colift.scenario import experiment
    from colift.visualization import certificate_figures, lengthscale_table, study_figures

    _store(common, "load_settings")
    if command == "study":
        for module, name in (
            (experiment, "make_experiments"),
            (feasibility, "assess_feasibility"),
            (study, "run_experiment"),
            (study, "flight_dataset"),
            (metrics, "summary"),
            (contact_forces, "contact_force_statistics"),
            (study.grasp, "contact_points"),
            (study, "_bound_assumptions"),
            (study, "_summary_header"),
        ):
            _store(module, name)
        _store_files(study_figures, "write_figures", 2)
        _store_files(lengthscale_table, "write_lengthscale_table", 1)
    elif command == "certify":
        _store(certification, "certify")
        _store(certification, "_summarize")
        _store(certification.agent_iss, "agent_iss_constants")
        _store(certification.conservatism, "nominal_mismatch")
        _store(certification.conservatism, "conservatism_breakdown")
        _store_files(certificate_figures, "plot_certificate", 2)
    elif command == "report":
        _store(playback, "build_page")
    else:
        _store_search()


def _store_search() -> None:
    """Replace the search of `tune` by three improvements of the initial gains."""
    loops: list[gain_tuning.LoopDesign] = []

    def tune(settings: scenario.Scenario, progress: Callable[[str], None], improved: Callable[..., None]) -> Any:
        if not loops:
            loops.append(gain_tuning.linearize_scenario(settings))
            for k in (1, 2, 3):
                scaled = gain_tuning.scale_gains(settings, np.full(6, 0.02 * k))
                loops.append(dataclasses.replace(loops[0], settings=scaled))
        for loop in loops:
            improved(loop)
            progress("search")
        return loops[0], loops[-1], gain_tuning.EvaluationBudget(4, 0)

    gain_tuning.tune = tune
    gain_tuning.summary_values = lambda _loop: {}
    gain_tuning.format_report = lambda *_: ["report"]


class _Trials:
    """Repetitions of a command with faults."""

    def __init__(self, command: str, folder: Path) -> None:
        self.command, self.folder = command, folder
        self.place = folder / f"trials-{command}"
        self.out = self.place / ("tuned.yaml" if command == "tune" else "out")
        words = {"study": ["--case", "C1"], "certify": [], "tune": []}
        target = ["--out", str(self.out), "-q"]
        self.words = (
            ["report", str(self.out)]
            if command == "report"
            else [command, str(folder / "small.yaml"), *words[command], *target]
        )
        self.earlier = self._contents(folder / "earlier") if command != "tune" else {}
        self.new: dict[str, bytes] = {}
        self.warnings: set[str] = set()  # lines of an undisturbed command

    def prepare(self) -> None:
        """Copy the earlier results to the folder of the trial."""
        _arm(None)
        shutil.rmtree(self.place, ignore_errors=True)
        self.place.mkdir()
        if self.command != "tune":
            shutil.copytree(self.folder / "earlier", self.out)

    def invoke(self) -> Any:
        """Run the command in this process."""
        return CliRunner().invoke(app, self.words)

    def count_errors(self, done: Any) -> int:
        """Return the number of lines on standard error that an undisturbed command does not print."""
        return len([line for line in done.stderr.splitlines() if line not in self.warnings])

    def faults(self) -> list[str]:
        """Return the faults of the files after an injected fault, and after the next command."""
        _arm(None)
        wrong = []
        found = self._contents(self.out)
        if self.command == "tune":
            if self.out.exists() and scenario.load_scenario(self.out).name != "sample":
                wrong.append("the scenario is another one")
            self.out.unlink(missing_ok=True)
        elif found != self.earlier and not self._is_new(found):
            wrong.append(f"neither the earlier nor the new results: {sorted(found)}")
        done = self.invoke()
        if done.exit_code or (self.command != "tune" and not self._is_new(self._contents(self.out))):
            wrong.append(f"the next command ends with {done.exit_code}: {done.output[-300:]}")
        left = sorted(path.name for path in self.place.iterdir() if not path.name.endswith(".part"))
        if left != [self.out.name]:
            wrong.append(f"files are left: {left}")
        return wrong

    def _is_new(self, found: dict[str, bytes]) -> bool:
        """Return whether files are the new results; the times in a summary differ."""
        if found.keys() != self.new.keys():
            return False
        same = [name for name, content in found.items() if content == self.new[name]]
        others = [json.loads(found[name]) for name in found.keys() - set(same) if name == "summary.json"]
        return len(same) + len(others) == len(found) and all({"C1", "C3"} <= each["cases"].keys() for each in others)

    @staticmethod
    def _contents(folder: Path) -> dict[str, bytes]:
        """Return the content of the files in a folder."""
        return {path.name: path.read_bytes() for path in folder.iterdir()} if folder.is_dir() else {}


def _fail_each(trials: _Trials, operations: int) -> list[str]:
    """Let each operation fail in turn; the command ends with one line, or without an effect of the failure."""
    wrong = []
    for number in range(1, operations + 1):
        trials.prepare()
        _arm(trials.place, number)
        done = trials.invoke()
        _arm(None)
        if done.exception is not None and not isinstance(done.exception, SystemExit):
            wrong.append(f"failure of operation {number}: {type(done.exception).__name__}: {done.exception}")
        elif done.exit_code not in (0, 2) or trials.count_errors(done) != (done.exit_code == 2):
            wrong.append(f"failure of operation {number}: status {done.exit_code}: {done.stderr[-300:]}")
        wrong += [f"failure of operation {number}: {each}" for each in trials.faults()]
    return wrong


def _kill(trials: _Trials, number: int, delay: float | None) -> tuple[bool, list[str]]:
    """Kill a child at an operation or after a time [s]; return whether it was killed, and the faults."""
    trials.prepare()
    child = os.fork()
    if not child:
        null = os.open(os.devnull, os.O_WRONLY)
        os.dup2(null, 1)
        os.dup2(null, 2)
        _arm(trials.place, number, kill=True)
        trials.invoke()
        os._exit(0)
    if delay is not None:
        time.sleep(delay)
        os.kill(child, signal.SIGKILL)
    deadline = time.monotonic() + 60
    while not (ended := os.waitpid(child, os.WNOHANG))[0]:
        time.sleep(0.002)
        if time.monotonic() > deadline:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)
            return False, ["the process does not end"]
    return os.WIFSIGNALED(ended[1]), trials.faults()


def _run_trials(command: str, folder: Path) -> dict[str, Any]:
    """Run a command with all faults."""
    trials = _Trials(command, folder)
    _store_computations(command)
    for _ in range(2):  # the first computes, the second has the number of operations of a repetition
        trials.prepare()
        _arm(trials.place)
        done = trials.invoke()
        operations = FAULTS.fault_count()
        assert done.exit_code == 0, done.output
        trials.new, trials.warnings = trials._contents(trials.out), set(done.stderr.splitlines())
    trials.prepare()
    began = time.monotonic()
    trials.invoke()
    duration = time.monotonic() - began
    wrong = _fail_each(trials, operations)
    killed, rng = 0, random.Random(command)
    points: list[tuple[int, float | None]] = [(number, None) for number in range(1, operations + 1)]
    points += [(0, rng.uniform(0, duration)) for _ in range(RANDOM_KILLS)]
    for number, delay in points:
        was_killed, faults = _kill(trials, number, delay)
        killed += was_killed
        at = f"kill at operation {number}" if delay is None else f"kill after {delay:.3f} s"
        wrong += [f"{at}: {each}" for each in faults]
    shutil.rmtree(trials.place, ignore_errors=True)
    return {"operations": operations, "duration_s": round(duration, 2), "killed": killed, "faults": wrong[:40]}


def main() -> bool:
    """Run all commands; none may lose results."""
    found = collect("file_faults", COMMANDS, run_command)
    for command in COMMANDS:
        one = found[command]
        counts = f"{one['operations']} failing operations, {one['killed']} kills, {len(one['faults'])} faults"
        print(f"{command}: {counts}")
        for fault in one["faults"]:
            print(f"  {fault}")
    return not any(found[command]["faults"] for command in COMMANDS)


if __name__ == "__main__":
    print(json.dumps(_run_trials(sys.argv[1], Path(sys.argv[2]))))
