"""Commands of ``colift campaign``: run, status, table, compare and export."""

from __future__ import annotations

import contextlib
import json
import os
import time
from collections.abc import Callable, Generator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from colift.cli import campaign_tables, common, tables
from colift.runtime import signals

if TYPE_CHECKING:
    import pandas as pd

    from colift.campaigns.driver import Progress
    from colift.campaigns.engines import Engine
    from colift.campaigns.spec import LoadedCampaign
    from colift.campaigns.store import Store
    from colift.cli.progress import Report

DASK_PREFIX = "dask://"
"""Beginning of the address of a Dask cluster."""
SpecArgument = Annotated[Path, typer.Argument(metavar="SPEC", help="YAML file that specifies the campaign.")]
OutOption = Annotated[Path | None, typer.Option("--out", help="Folder of the rows; default: out/campaign-SPEC.")]
FileOption = Annotated[Path | None, typer.Option("--csv", metavar="FILE", help="Also write the rows as CSV.")]


def run(
    path: SpecArgument,
    out: OutOption = None,
    jobs: Annotated[
        int | None, typer.Option("--jobs", "-j", min=1, max=1024, help="Number of processes; default: one per core.")
    ] = None,
    engine: Annotated[
        str | None,
        typer.Option(
            "--engine", metavar="dask://ADDRESS", help="Simulate on a Dask cluster, such as dask://host:8786."
        ),
    ] = None,
    slurm: Annotated[
        str | None, typer.Option("--slurm", metavar="PARTITION", help="Simulate in SLURM jobs of a partition.")
    ] = None,
    quiet: common.QuietOption = False,
) -> None:
    """Simulate all flights of a campaign whose rows are missing.

    The command stores one row per flight. A repeated command simulates only what is missing: after an interruption, or
    after more samples in SPEC. Status 1: some flights ended their worker.
    """
    from colift.campaigns import driver, store

    if sum(option is not None for option in (jobs, engine, slurm)) > 1:
        common.fail("--jobs, --engine and --slurm exclude each other")
    with _reported_errors():
        campaign = _load(path)
        folder = _folder(path, out)
        with (
            store.open_store(folder) as opened,
            common.show_progress(f"campaign {campaign.name}", quiet) as progress,
        ):
            workers = _engine(opened, jobs, engine, slurm)
            try:
                found = driver.run_campaign(campaign, opened, workers, _reporter(progress))
            except signals.Interrupted:
                common.report_interruption(f"the same command continues; the rows are in {folder / 'parts'}")
                raise
    with common.guard_output(f"; the rows are in {folder}"):
        if not quiet:
            print(_describe(found))
            print(f"rows in {folder / 'parts'}")
    if found.lost:
        common.print_error(f"{found.lost} flights ended their worker: colift campaign table {path}")
        common.exit_with(common.EXIT_INCOMPLETE)


def status(path: SpecArgument, out: OutOption = None, as_json: common.JsonOption = False) -> None:
    """Print the number of stored and missing flights of a campaign. Status 1: flights are missing."""
    from colift.campaigns import driver

    with _reported_errors():
        campaign = _load(path)
        found, rows = driver.read_progress(campaign, _store(path, out), ("cpu_s",))
    ended = rows["termination_reason"].str.split(":").str[0] if len(rows) else rows["termination_reason"]
    counts = {
        "planned": found.planned,
        "stored": found.stored,
        "missing": found.missing,
        "ended_early": int((ended != "").sum()),
        "refused": int((ended == "refused").sum()),
        "lost": int((ended == "lost").sum()),
        "cpu_s": float(rows["cpu_s"].sum()) if "cpu_s" in rows else 0.0,
    }
    with common.guard_output():
        if as_json:
            print(json.dumps(counts | {"stopped_at_sample": found.stopped_at}, indent=2))
        else:
            print(_describe(found))
            ended_early, refused, lost = (counts[name] for name in ("ended_early", "refused", "lost"))
            print(f"{ended_early} ended early: {refused} with refused settings, {lost} with the end of their worker")
            print(f"{counts['cpu_s']:.1f} s of processor time; rows in {_store(path, out).parts}")
    if found.missing:
        common.exit_with(common.EXIT_INCOMPLETE)


def table(
    path: SpecArgument,
    out: OutOption = None,
    file: FileOption = None,
    lines: Annotated[
        int, typer.Option("--lines", "-n", min=1, help="Largest number of flights that are printed.")
    ] = 50,
) -> None:
    """Print one line per flight: varied settings, metrics, and the reason if the flight ended early."""
    rows, campaign = _rows(path, out)
    if file is not None:
        _write(rows, file, "csv")
    with common.guard_output():
        tables.print_table(campaign_tables.flight_table(rows.head(lines), campaign.name), num_repeated=2)
        if len(rows) > lines:
            print(f"{lines} of {len(rows)} flights; --lines prints more, --csv FILE writes all")


def compare(path: SpecArgument, out: OutOption = None) -> None:
    """Compare the cases of a campaign sample by sample, and draw the comparison.

    The tables contain medians and ratios with BCa bootstrap intervals, Wilcoxon tests with Holm's correction, fractions
    of flights with Clopper-Pearson intervals, and Sobol indices if the sampling is saltelli. All intervals have a
    confidence of 95 %. The first case of SPEC is the reference. The figure is comparison.pdf and .png in the folder.
    """
    from colift.analysis.study_metrics import STUDY_METRICS
    from colift.campaigns import statistics
    from colift.visualization import campaign_figures

    rows, campaign = _rows(path, out)
    found = statistics.compare_cases(rows, [metric.key for metric in STUDY_METRICS if metric.key in rows])
    fractions = (*statistics.complete_flights(rows), *statistics.orderings(rows), *statistics.claims(rows))
    with _reported_errors():
        errors = statistics.by_sample(rows, statistics.ERROR_METRIC)
        figure, _ = campaign_figures.plot_comparison(errors, _folder(path, out) / "comparison")
    with common.guard_output(f"; the figure is {figure}"):
        tables.print_table(campaign_tables.comparison_table(found, campaign.name), num_repeated=2)
        tables.print_table(campaign_tables.fraction_table(fractions))
        if campaign.spec.sampling == "saltelli":
            tables.print_table(campaign_tables.sobol_table(rows, campaign))
        print(f"figure in {figure}")


def export(
    path: SpecArgument,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File to write: .csv or .parquet.")],
    out: OutOption = None,
) -> None:
    """Write all rows of a campaign as one file."""
    suffix = file.suffix.removeprefix(".")
    if suffix not in ("csv", "parquet"):
        common.fail(f"{file}: must end with .csv or .parquet")
    rows, _ = _rows(path, out)
    _write(rows, file, suffix)
    with common.guard_output():
        print(f"{len(rows)} rows in {file}")


COMMANDS: dict[str, Callable[..., None]] = {
    "run": run,
    "status": status,
    "table": table,
    "compare": compare,
    "export": export,
}
"""Commands of ``colift campaign``."""


@contextlib.contextmanager
def _reported_errors() -> Generator[None]:
    """Print an error of a specification or a file as one line, and end the command."""
    from colift.scenario import ScenarioError

    try:
        yield
    except (ScenarioError, OSError) as error:
        common.fail(error)


def _load(path: Path) -> LoadedCampaign:
    """Load a specification."""
    from colift.campaigns import spec

    return spec.load_campaign(path)


def _folder(path: Path, out: Path | None) -> Path:
    """Return the folder of a campaign."""
    return Path("out") / f"campaign-{path.stem}" if out is None else out


def _store(path: Path, out: Path | None) -> Store:
    """Return the store of a campaign for reading."""
    from colift.campaigns import store

    return store.Store(_folder(path, out))


def _rows(path: Path, out: Path | None) -> tuple[pd.DataFrame, LoadedCampaign]:
    """Return the rows of a campaign and its specification; end the command if there are no rows."""
    from colift.campaigns import driver

    with _reported_errors():
        campaign = _load(path)
        rows = driver.campaign_table(campaign, _store(path, out))
    if rows.empty:
        common.fail(f"{_folder(path, out)} contains no rows of {path}: colift campaign run {path}")
    return rows, campaign


def _engine(opened: Store, jobs: int | None, address: str | None, partition: str | None) -> Engine:
    """Return the engine that the options select."""
    from colift.campaigns import engines, flights

    if partition is not None:
        return engines.SlurmEngine(partition, opened.folder / "slurm")
    if address is not None:
        if not address.startswith(DASK_PREFIX):
            common.fail(f"--engine {address}: must be {DASK_PREFIX}ADDRESS, such as {DASK_PREFIX}host:8786")
        return engines.DaskEngine(f"tcp://{address.removeprefix(DASK_PREFIX)}")
    return engines.LocalEngine(jobs or os.cpu_count() or 1, modules=flights.WORKER_MODULES)


def _reporter(progress: Report) -> Callable[[Progress], None]:
    """Return a function that shows the state of a campaign with its throughput."""
    begin = time.monotonic()

    def report(found: Progress) -> None:
        done, total = found.simulated, found.planned - found.stored
        rate = done / max(time.monotonic() - begin, 1e-9)
        lost = f", {found.lost} lost" if found.lost else ""
        speed = f", {rate:.2g} flights/s" if done else ""
        progress(f"{done} of {total} flights{speed}{lost}", done / total if total else 1.0)

    return report


def _describe(found: Progress) -> str:
    """Describe the state of a campaign in one line."""
    text = f"{found.stored + found.simulated} of {found.planned} flights stored"
    if found.simulated:
        text += f" ({found.simulated} new, {found.ended_early} ended early)"
    return text if found.stopped_at is None else f"{text}; the rule `until` is satisfied at {found.stopped_at} samples"


def _write(rows: pd.DataFrame, file: Path, suffix: str) -> None:
    """Write a table as CSV or Parquet."""
    from colift.campaigns import store
    from colift.runtime import atomic_write

    with _reported_errors():
        atomic_write.write_atomic(file, store.encode(rows, suffix))
