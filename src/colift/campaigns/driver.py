"""Simulation of all flights of a campaign whose rows are missing, and the table of its rows."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path

import pandas as pd

from colift.campaigns import statistics
from colift.campaigns.engines import Engine, Outcome
from colift.campaigns.flights import Batch, Cell, lost_row
from colift.campaigns.sampling import PlannedFlight, plan_flights
from colift.campaigns.spec import STOPPING_SAMPLES, LoadedCampaign, StoppingRule
from colift.campaigns.store import COMPLETION_COLUMNS, Store
from colift.runtime import signals

MAX_ATTEMPTS = 3
"""Attempts with a batch whose worker ends, before the batch is divided."""
POLL_PERIOD = 0.25
"""Longest time between two checks for an interruption [s]."""


@dataclasses.dataclass(frozen=True)
class Progress:
    """State of a campaign.

    Attributes:
        planned: Number of flights of the specification.
        stored: Number of rows at the start.
        simulated: Number of rows since then.
        ended_early: Number of these flights with a reason for an early end.
        lost: Number of these flights that ended their worker.
        stopped_at: Number of samples at which the stopping rule is satisfied; None before.
    """

    planned: int
    stored: int
    simulated: int = 0
    ended_early: int = 0
    lost: int = 0
    stopped_at: int | None = None

    @property
    def missing(self) -> int:
        """Number of flights without a row; 0 after the stopping rule."""
        return 0 if self.stopped_at is not None else self.planned - self.stored - self.simulated


def read_progress(
    campaign: LoadedCampaign, store: Store, columns: Collection[str] = ()
) -> tuple[Progress, pd.DataFrame]:
    """Return the state of a campaign and columns of `campaign_table`, from one reading of its files.

    OSError is raised if the folder cannot be read.

    Args:
        campaign: Specification with its scenario.
        store: Folder of its rows.
        columns: Columns of the table.
    """
    planned, rule = plan_flights(campaign), campaign.spec.until
    table = store.read({*COMPLETION_COLUMNS, *columns, *_columns_of(rule)})
    done = store.complete_ids(table, campaign.spec.keep == "signals")
    stored = sum(flight.id in done for flight in planned)
    stopped_at = _stopping_sample(rule, planned, _values_in(table, rule))
    return Progress(len(planned), stored, stopped_at=stopped_at), _rows_until(stopped_at, planned, table)


def campaign_table(campaign: LoadedCampaign, store: Store, columns: Collection[str] | None = None) -> pd.DataFrame:
    """Return the rows of a campaign in the order of its samples and cases.

    Rows of other campaigns in the same folder, and those after the sample at which the stopping rule is satisfied, are
    omitted. OSError is raised if the folder cannot be read.

    Args:
        campaign: Specification with its scenario.
        store: Folder of its rows.
        columns: Columns to read; None: all.
    """
    planned, rule = plan_flights(campaign), campaign.spec.until
    table = store.read(None if columns is None else {"id", *columns, *_columns_of(rule)})
    return _rows_until(_stopping_sample(rule, planned, _values_in(table, rule)), planned, table)


def _rows_until(last: int | None, planned: Sequence[PlannedFlight], table: pd.DataFrame) -> pd.DataFrame:
    """Return the rows of planned flights in their order, up to the sample at which the stopping rule is satisfied.

    The samples are numbered as planned: those of a stored row may result from a specification with fewer seeds, grid
    values or draws.
    """
    positions = {identifier: k for k, identifier in enumerate(table["id"])}
    stored = [flight for flight in planned if flight.id in positions and (last is None or flight.sample < last)]
    rows = table.iloc[[positions[flight.id] for flight in stored]].reset_index(drop=True)
    return rows.assign(sample=[flight.sample for flight in stored]) if "sample" in rows else rows


def run_campaign(
    campaign: LoadedCampaign,
    store: Store,
    engine: Engine,
    report: Callable[[Progress], None] = lambda _progress: None,
) -> Progress:
    """Simulate all flights whose rows are missing.

    One batch compiles the programs before the others of its structure are sent. A batch whose worker ends is repeated;
    after `MAX_ATTEMPTS` it is divided, until the flight that ends its worker has a row with the reason.

    Args:
        campaign: Specification with its scenario.
        store: Folder of the rows, which this process has locked.
        engine: Workers; they are closed at the end.
        report: Function called with the progress.

    Returns:
        The state at the end.

    Raises:
        OSError: If a file cannot be written, or if the folder contains rows of another version.
        Interrupted: On a request to end; all rows until then are stored.
    """
    planned = plan_flights(campaign)
    done = store.stored_ids(campaign.spec.keep == "signals")
    missing = [flight for flight in planned if flight.id not in done]
    progress = Progress(len(planned), len(planned) - len(missing))
    with signals.on_exit(engine.close):
        values = _stored_values(campaign, store)
        progress = dataclasses.replace(progress, stopped_at=_stopping_sample(campaign.spec.until, planned, values))
        if missing and progress.stopped_at is None:
            progress = _Run(campaign, store, engine, planned, values).simulate(missing, progress, report)
    return progress


class _Run:
    """Batches that wait, and those that are simulated."""

    def __init__(
        self,
        campaign: LoadedCampaign,
        store: Store,
        engine: Engine,
        planned: Sequence[PlannedFlight],
        values: dict[str, float],
    ) -> None:
        self.campaign, self.store, self.engine, self.planned = campaign, store, engine, planned
        self.values = values  # metric of the stopping rule by flight
        self.waiting: list[Batch] = []
        self.running: Counter[str] = Counter()  # batches by structure
        self.compiled: set[str] = set()  # structures with a completed batch
        self.attempts: Counter[Batch] = Counter()

    def simulate(
        self, missing: Sequence[PlannedFlight], progress: Progress, report: Callable[[Progress], None]
    ) -> Progress:
        """Simulate flights until all have rows or the stopping rule is satisfied."""
        size, parallel = self.engine.batch_size(len(missing)), self.engine.slots() > 1
        self.waiting = list(make_batches(self.campaign, self.store.logs, missing, size, parallel))
        self.engine.prepare(len(self.waiting))
        report(progress)
        while (self.waiting or self.running.total()) and progress.stopped_at is None:
            signals.raise_if_interrupted()
            self.engine.submit(list(self._next_batches()))
            for outcome in self.engine.poll(POLL_PERIOD):
                progress = self._handle(outcome, progress)
            report(progress)
        return progress

    def _next_batches(self) -> Iterator[Batch]:
        """Remove batches from the queue and yield them; the first batch of a structure precedes the others."""
        free = self.engine.slots() - self.running.total()
        for batch in list(self.waiting):
            if free < 1:
                return
            structure = structure_key(batch.flights[0])
            idle = not self.running.total() or (bool(self.compiled) and not self.running[structure])
            if structure in self.compiled or idle:
                self.waiting.remove(batch)
                self.running[structure] += 1
                free -= 1
                yield batch

    def _handle(self, outcome: Outcome, progress: Progress) -> Progress:
        """Store the rows of a batch, or repeat or divide it."""
        batch = outcome.batch
        structure = structure_key(batch.flights[0])
        self.running[structure] -= 1
        rows, lost = outcome.rows, 0
        if rows is None:
            self.attempts[batch] += 1
            if outcome.retry and self.attempts[batch] < MAX_ATTEMPTS:
                self.waiting.insert(0, batch)
                return progress
            if len(batch.flights) > 1:
                middle = len(batch.flights) // 2
                halves = batch.flights[:middle], batch.flights[middle:]
                self.waiting[:0] = [dataclasses.replace(batch, flights=half) for half in halves]
                return progress
            rows, lost = [lost_row(batch.flights[0], outcome.reason)], 1
        else:
            self.compiled.add(structure)
        self.store.add(rows)
        rule = self.campaign.spec.until
        if rule is not None:
            self.values |= {str(row["id"]): _number(row.get(rule.metric)) for row in rows}
        return dataclasses.replace(
            progress,
            simulated=progress.simulated + len(rows),
            ended_early=progress.ended_early + sum(bool(row["termination_reason"]) for row in rows),
            lost=progress.lost + lost,
            stopped_at=_stopping_sample(rule, self.planned, self.values),
        )


def make_batches(
    campaign: LoadedCampaign, logs: Path, flights: Sequence[PlannedFlight], size: int, parallel: bool
) -> Iterator[Batch]:
    """Divide flights into batches of one structure, in the order of their samples.

    Args:
        campaign: Specification with its scenario.
        logs: Folder for the logs of single flights.
        flights: Flights in the order of their samples.
        size: Largest number of flights of one batch.
        parallel: Whether several batches are simulated at a time; a single flight of a structure then precedes them.

    Yields:
        The batches.
    """
    groups: dict[str, list[PlannedFlight]] = {}
    for flight in flights:
        groups.setdefault(structure_key(flight), []).append(flight)
    divided = []
    for group in groups.values():
        first = [group[:1]] if parallel and len(group) > 1 else []
        rest = group[len(first) :]
        divided += [*first, *(rest[k : k + size] for k in range(0, len(rest), size))]
    log_folder = str(logs) if campaign.spec.keep == "signals" else None
    for part in sorted(divided, key=lambda part: part[0].sample):
        yield Batch(campaign.settings_json, campaign.file, campaign.spec.duration_s, log_folder, tuple(part))


def structure_key(flight: PlannedFlight) -> str:
    """Return a text that is equal for flights with the same compiled program: case and settings that are no floats."""
    fixed = [(path, value) for path, value in flight.settings if not isinstance(value, float)]
    return repr((flight.case, fixed))


def _stored_values(campaign: LoadedCampaign, store: Store) -> dict[str, float]:
    """Return the metric of the stopping rule by flight; empty without a rule."""
    rule = campaign.spec.until
    return {} if rule is None else _values_in(store.read({"id", *_columns_of(rule)}), rule)


def _columns_of(rule: StoppingRule | None) -> tuple[str, ...]:
    """Return the columns that a stopping rule requires."""
    return () if rule is None else (rule.metric,)


def _values_in(table: pd.DataFrame, rule: StoppingRule | None) -> dict[str, float]:
    """Return the metric of the stopping rule by flight; empty without a rule."""
    if rule is None:
        return {}
    values = table.get(rule.metric, pd.Series(math.nan, index=table.index))
    return dict(zip(table["id"], values.astype(float), strict=True))


def _stopping_sample(
    rule: StoppingRule | None, planned: Sequence[PlannedFlight], values: Mapping[str, float]
) -> int | None:
    """Return the smallest number of samples that satisfies the stopping rule; None if there is none yet."""
    if rule is None:
        return None
    series: dict[str, list[float]] = {}
    for sample, flights in itertools.groupby(planned, lambda flight: flight.sample):
        for flight in flights:
            if flight.id not in values:
                return None
            series.setdefault(flight.case, []).append(values[flight.id])
        if (sample + 1) % STOPPING_SAMPLES == 0:
            widths = [statistics.mean_half_width(each, rule.confidence) for each in series.values()]
            if max(widths) <= rule.half_width:
                return sample + 1
    return None


def _number(cell: Cell) -> float:
    """Return a cell as a number; NaN if it is none."""
    return float(cell) if isinstance(cell, int | float) else math.nan
