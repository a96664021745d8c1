"""Campaigns of the smallest team, and workers that compute rows without a flight or end before."""

from __future__ import annotations

import json
import os
import signal
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from colift.campaigns import driver, engines, spec, store
from colift.campaigns.flights import MAX_BATCH, Batch, Row, identity, run_batch
from tests.support import small_team

VARIED = {
    "payload.mass_kg": {"kind": "uniform", "low": 1.4, "high": 1.6},
    "control.K_p": {"kind": "log_uniform", "low": 4.0, "high": 6.0},
    "initial_state.position_error_m.0": {"kind": "normal", "mean": 0.0, "std": 0.05},
}
FATAL_SAMPLE = 5


def write(folder: Path, **changes: Any) -> Path:
    """Write the specification of a campaign of 12 flights, and its scenario."""
    small_team.write(folder / "light.yaml")
    content = {"scenario": "light.yaml", "cases": ["C1"], "samples": 12, "duration_s": 0.2, "vary": VARIED} | changes
    path = folder / "campaign.yaml"
    path.write_text(json.dumps(content))
    return path


def quick_rows(batch: Batch) -> list[Row]:
    """Return rows whose metric is a function of the settings."""
    rows = []
    for planned in batch.flights:
        numbers = [value for _, value in planned.settings if isinstance(value, float)]
        found: Row = {"complete": True, "termination_reason": "", "warnings": "", "e_p_rms_m": sum(numbers)}
        rows.append(identity(planned) | found | {"cpu_s": time.process_time(), "worker": str(os.getpid())})
    return rows


def slow_rows(batch: Batch) -> list[Row]:
    """Return the rows after a while."""
    time.sleep(0.3)
    return quick_rows(batch)


def rows_or_death(batch: Batch) -> list[Row]:
    """End the process by a signal if the batch contains a certain sample."""
    if any(planned.sample == FATAL_SAMPLE for planned in batch.flights):
        os.kill(os.getpid(), signal.SIGKILL)
    return quick_rows(batch)


def rows_or_error(batch: Batch) -> list[Row]:
    """Raise an exception if the batch contains a certain sample."""
    if any(planned.sample == FATAL_SAMPLE for planned in batch.flights):
        raise ZeroDivisionError("division by zero")
    return quick_rows(batch)


class InlineEngine:
    """Engine that computes batches in this process."""

    def __init__(self, task: Callable[[Batch], list[Row]] = run_batch) -> None:
        self.task, self.batches = task, list[Batch]()
        self.computed = 0

    def slots(self) -> int:
        return 1

    def batch_size(self, flights: int) -> int:
        return MAX_BATCH

    def prepare(self, batches: int) -> None:
        pass

    def submit(self, batches: Sequence[Batch]) -> None:
        self.batches += batches

    def poll(self, timeout: float) -> list[engines.Outcome]:
        batches, self.batches = self.batches, []
        self.computed += sum(len(batch.flights) for batch in batches)
        return [engines.Outcome(batch, self.task(batch)) for batch in batches]

    def close(self) -> None:
        pass


def run(path: Path, out: Path, engine: engines.Engine) -> driver.Progress:
    """Run a campaign."""
    with store.open_store(out) as opened:
        return driver.run_campaign(spec.load_campaign(path), opened, engine)


def numbers(path: Path, out: Path) -> list[dict[str, Any]]:
    """Return the table of a campaign without the columns that differ between two runs."""
    table = driver.campaign_table(spec.load_campaign(path), store.Store(out))
    return table.drop(columns=["cpu_s", "wall_s", "worker"], errors="ignore").to_dict("records")
