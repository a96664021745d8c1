"""Simulation of a batch of flights: settings in, one row of metrics per flight out.

A batch is plain data, so that any engine can send it to another process or computer.
"""

from __future__ import annotations

import dataclasses
import functools
import json
import os
import platform
import socket
import time
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from pydantic import JsonValue

from colift.campaigns import spec
from colift.campaigns.sampling import PlannedFlight
from colift.runtime import signals
from colift.scenario import Scenario, ScenarioError

if TYPE_CHECKING:
    from colift.closed_loop.flight import Experiment, FlightResult

MAX_BATCH = 32
"""Largest number of flights of one batch."""
WORKER_MODULES = (
    "colift.analysis.metrics",
    "colift.closed_loop.batch",
    "colift.scenario.experiment",
    "colift.workflows.study",
)
"""Modules that `run_batch` imports; they load JAX, which the driver does not."""
SETTING_PREFIX = "settings."
"""Prefix of the columns of the varied settings."""
NOT_STORED = ("complete", "termination_reason", "warnings", "update_times_s")
"""Entries of `metrics.summary` that are no numbers of a row."""
Cell = float | int | bool | str | None
Row = dict[str, Cell]
"""Row of a flight by column: identity, varied settings, end, metrics, computation time, worker and versions."""


@dataclasses.dataclass(frozen=True)
class Batch:
    """Flights that one task simulates; they share their compiled program, see `colift.closed_loop.batch`.

    Attributes:
        scenario: Settings of the scenario as JSON.
        file: Path of the scenario file, beside which user-defined parts are searched.
        duration: Duration of the flights [s]; None: that of the scenario.
        log_folder: Folder for the logs; None: no logs.
        flights: Flights of the batch.
    """

    scenario: str
    file: str
    duration: float | None
    log_folder: str | None
    flights: tuple[PlannedFlight, ...]


def run_batch(batch: Batch) -> list[Row]:
    """Simulate the flights of a batch.

    A flight that ended early, and one whose settings allow no flight, have a row with the reason. OSError is raised
    if a log cannot be written.

    Args:
        batch: Flights with their scenario.

    Returns:
        One row per flight, in the order of the batch.
    """
    from colift.closed_loop.batch import run_batch as simulate  # here, because only workers require JAX
    from colift.closed_loop.part_checks import PartError
    from colift.scenario.experiment import make_experiment

    cpu, wall = time.process_time(), time.perf_counter()
    found: dict[int, Row] = {}
    plans: list[_Plan] = []
    for k, planned in enumerate(batch.flights):
        signals.raise_if_interrupted()
        try:
            settings = spec.with_settings(batch.scenario, batch.file, (("seed", planned.seed), *planned.settings))
            experiment = make_experiment(settings, planned.case)
        except (ScenarioError, PartError) as error:
            found[k] = {"complete": False, "termination_reason": f"refused: {str(error).splitlines()[0]}"}
            continue
        if batch.duration is not None:
            experiment = dataclasses.replace(experiment, duration=batch.duration)
        plans.append(_Plan(k, settings, experiment))
    for i, result in simulate([plan.experiment for plan in plans]):
        found[plans[i].index] = _metrics(plans[i], result, batch)
    number = len(batch.flights)
    cost = {"cpu_s": (time.process_time() - cpu) / number, "wall_s": (time.perf_counter() - wall) / number}
    shared = cost | {"worker": f"{socket.gethostname()}:{os.getpid()}"}
    return [identity(planned) | found[k] | shared for k, planned in enumerate(batch.flights)]


class _Plan(NamedTuple):
    """Flight of a batch whose settings are valid: its position, settings and experiment."""

    index: int
    settings: Scenario
    experiment: Experiment


def identity(planned: PlannedFlight) -> Row:
    """Return the columns of a row that are independent of the result of the flight."""
    settings: Row = {f"{SETTING_PREFIX}{path}": _cell(value) for path, value in planned.settings}
    named: Row = {"id": planned.id, "sample": planned.sample, "case": planned.case, "seed": planned.seed}
    return named | settings | {"version": version("colift"), "versions": _versions()}


def lost_row(planned: PlannedFlight, reason: str) -> Row:
    """Return the row of a flight that ended its worker.

    Args:
        planned: Flight.
        reason: Cause of the end, such as ``signal 9``.
    """
    return identity(planned) | {"complete": False, "termination_reason": f"lost: {reason}"}


def log_file(folder: Path, identifier: str) -> Path:
    """Return the file of the log of a flight."""
    return folder / f"{identifier[:16]}.nc"


def _metrics(plan: _Plan, result: FlightResult, batch: Batch) -> Row:
    """Return end and metrics of a flight; save its log if the batch requires it."""
    from colift.analysis import metrics
    from colift.closed_loop import log
    from colift.workflows import study

    planned, experiment = batch.flights[plan.index], plan.experiment
    if batch.log_folder is not None:
        dataset = study.flight_dataset(plan.settings, planned.case, result, experiment)
        path = log_file(Path(batch.log_folder), planned.id)
        path.parent.mkdir(exist_ok=True)
        log.save(dataset, path)
    found = metrics.summary(result, experiment.world.team, experiment.controller.team)
    end: Row = {"complete": found["complete"], "termination_reason": found["termination_reason"]}
    numbers = _flatten({key: value for key, value in found.items() if key not in NOT_STORED})
    return end | {"warnings": "; ".join(found["warnings"])} | numbers


def _flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Cell]:
    """Return nested numbers by dotted names."""
    flat: dict[str, Cell] = {}
    for key, value in values.items():
        name = f"{prefix}{key}"
        if isinstance(value, list | tuple):
            value = {str(k): entry for k, entry in enumerate(value)}
        if isinstance(value, Mapping):
            flat |= _flatten(value, f"{name}.")
        else:
            flat[name] = None if value is None else float(value)
    return flat


def _cell(value: JsonValue) -> Cell:
    """Return a setting as the cell of a table: numbers as they are, other values as JSON."""
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    return float(value) if is_number else json.dumps(value)


@functools.cache
def _versions() -> str:
    """Return the versions of the packages that determine the numbers of a row."""
    packages = ", ".join(f"{name} {version(name)}" for name in ("colift", "jax", "jaxlib", "numpy", "scipy"))
    return f"python {platform.python_version()}, {packages}"
