"""CPU seconds of the parts of a study with full caches, of planning, and of flights in a batch.

The study is `colift study paper`, in a new process. The flights of a batch are C3 of `paper`, which learn, and C1 of
`campaigns/throughput.yaml` with planning and metrics.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
import types
from pathlib import Path
from typing import Any

from benchmarks import Outcome

ROOT = Path(__file__).parents[1]
LIMITS = {
    "feasibility": 1.5,
    "figures": 3.5,
    "fits": 1.5,
    "error bounds": 0.6,
    "imports, logs, planning, analysis": 4.0,
    "study": 13.0,
    "C1, flight of 2 s in a campaign": 0.15,
    "planning of 1000 experiments": 5.0,
}  # CPU s
REAL_TIME = 25.0  # times real time of C3 with updates in a batch
CAMPAIGN_FLIGHTS, LEARNING_FLIGHTS = 128, 8


def run(seconds: float) -> Outcome:
    """Measure each part in a new process, the study after one that fills the caches."""
    del seconds  # each part lasts as long as it lasts
    _child("study")
    figures = _child("study") | _child("campaign") | _child("learning")
    for name, value in figures.items():
        print(f"{name}: {value:.3g}")
    targets = {
        f"{name}: {figures[name]:.3g} CPU s, at most {most:g}": figures[name] <= most for name, most in LIMITS.items()
    }
    speed = figures["C3, flights that learn, times real time"]
    return Outcome(
        figures, targets | {f"C3 in a batch {speed:.3g} times real time, at least {REAL_TIME:g}": speed >= REAL_TIME}
    )


def _child(part: str) -> dict[str, float]:
    """Measure a part in a new process."""
    command = [sys.executable, "-m", "benchmarks.parts", part]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
    return json.loads(done.stdout.splitlines()[-1])


def cpu_time() -> float:
    """Return the CPU time of this process and its children [s]."""
    return sum(sum(resource.getrusage(who)[:2]) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))


def study() -> dict[str, float]:
    """Measure a study by part; the clock of its stages is replaced by the CPU time."""
    import colift
    from colift.analysis import feasibility
    from colift.closed_loop import flight
    from colift.scenario import experiment
    from colift.workflows import study as workflow

    cpu: Any = types.SimpleNamespace(perf_counter=time.process_time)
    flight.time, workflow.time = cpu, cpu
    scenario = colift.load_scenario("paper")
    experiments = experiment.make_experiments(scenario, ("C1", "C2", "C3"))
    start = time.process_time()
    preview = feasibility.assess_feasibility(scenario, experiments)
    found = {"feasibility": time.process_time() - start}
    with (
        tempfile.TemporaryDirectory() as folder,
        workflow.open_run_directory(scenario, Path(folder) / "out") as out,
    ):
        summary = workflow.run_study(scenario, out, experiments, preview)
    stages = [case["wall_time_s"] for case in summary["cases"].values()]
    parts = {"fits": "fit", "error bounds": "error_bounds", "control periods": "simulation"}
    found |= {"figures": summary["wall_time_s"]["figures"]}
    found |= {name: sum(one[stage] for one in stages) for name, stage in parts.items()}
    return found | {"imports, logs, planning, analysis": cpu_time() - sum(found.values()), "study": cpu_time()}


def campaign() -> dict[str, float]:
    """Measure planning, and flights of a campaign in one process, after the first batch."""
    from colift.campaigns import flights, sampling, spec
    from colift.scenario.experiment import make_experiment

    loaded = spec.load_campaign(ROOT / "campaigns" / "throughput.yaml")
    planned = sampling.plan_flights(loaded)

    def simulate(first: int, number: int) -> float:
        batch = tuple(planned[first : first + number])
        start = time.process_time()
        flights.run_batch(flights.Batch(loaded.settings_json, loaded.file, loaded.spec.duration_s, None, batch))
        return (time.process_time() - start) / number

    simulate(0, 8)
    found = {"C1, flight of 2 s in a campaign": simulate(8, CAMPAIGN_FLIGHTS)}
    start = time.process_time()
    for one in planned[:CAMPAIGN_FLIGHTS]:
        varied = (("seed", one.seed), *one.settings)
        make_experiment(spec.with_settings(loaded.settings_json, loaded.file, varied), one.case)
    return found | {"planning of 1000 experiments": 1000 * (time.process_time() - start) / CAMPAIGN_FLIGHTS}


def learning() -> dict[str, float]:
    """Measure flights of C3 that learn, in one group and singly, after the first ones."""
    import colift
    from colift.closed_loop import batch, flight
    from colift.scenario.experiment import make_experiment

    def experiments(first: int) -> list[flight.Experiment]:
        seeds = range(first, first + LEARNING_FLIGHTS)
        return [make_experiment(colift.load_scenario("paper", overrides={"seed": seed}), "C3") for seed in seeds]

    def compare(first: int) -> tuple[float, float]:
        given, start = experiments(first), time.process_time()
        kept = dict(batch.run_batch(given))
        middle = time.process_time()
        kept |= {-1: flight.run_experiment(given[0])}
        return (middle - start) / LEARNING_FLIGHTS, time.process_time() - middle

    compare(1000)
    together, single = compare(2000)
    return {
        "C3, flight of 20 s in a batch": together,
        "C3, single flight of 20 s": single,
        "C3, flights that learn, times real time": 20 / together,
    }


if __name__ == "__main__":
    print(json.dumps({"study": study, "campaign": campaign, "learning": learning}[sys.argv[1]]()))
