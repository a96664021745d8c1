"""Tables of results on a terminal.

A table that is wider than the terminal is printed in parts. Greek letters are spelled out where they cannot be encoded.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE_HEAD
from rich.console import Console
from rich.table import Column, Table

from colift.analysis.study_metrics import STUDY_METRICS
from colift.analysis.study_metrics import format_value as format_cell

if TYPE_CHECKING:
    from colift.analysis.comparison import ComparedCase
    from colift.workflows.falsification import FalsificationTrial


ERROR_UNITS = {"e_p": (1e3, "mm"), "e_v": (1e3, "mm/s"), "e_R": (1e3, "1e-3"), "e_omega": (1e3, "mrad/s")}
"""Factor from SI units to the printed unit, and the printed unit, by tracking error."""
BOUND_KIND_LABELS = {"a_priori": "any", "a_posteriori": "this"}
"""Labels of the kinds of bounds: for any run in the tube, or along the simulated run."""
CERTIFICATE_COLUMNS = {
    "bound": "method of the bound of the prediction error; observed and nominal errors in the first rows",
    "run": "any: bound for all runs from the initial state; this: bound along the simulated run",
    "e_p, e_v, e_R, e_ω": "largest norm of the errors of position, velocity, attitude and angular velocity",
    "e_p / obs.": "bound of the position error divided by the observed error",
    "status": "assumed: the bound requires unproven assumptions; exceeded: an observed error is larger",
}
"""Columns of the table of a certificate, and their definitions."""
ASCII_GREEK = str.maketrans({"Ψ": "Psi", "Δ": "d", "λ": "lam", "σ": "sigma", "ω": "omega"})
"""Greek letters spelled out."""


# Results --------------------------------------------------------------------------------------------------------------


def study_table(summary: Mapping[str, Any]) -> Table:
    """Return the metrics of all cases over the second half of the run.

    Args:
        summary: Content of ``summary.json``.

    Returns:
        A table with one row for each case.
    """
    table = Table(
        title=f"{summary['scenario']}, seed {summary['seed']}: second half of the run",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("case\n", no_wrap=True)
    for metric in STUDY_METRICS:
        table.add_column(f"{metric.heading}\n{metric.unit}", justify="right", no_wrap=True)
    for case, found in summary["cases"].items():
        table.add_row(case, *(metric.format(found[metric.key]) for metric in STUDY_METRICS))
    return table


def comparison_table(cases: Sequence[ComparedCase]) -> Table:
    """Return the metrics of all cases of several runs, each with its ratio to the reference in brackets.

    Args:
        cases: Compared cases.

    Returns:
        A table with one row for each case of each run.
    """
    table = Table(title="second half of the run (ratio)", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    table.add_column("case\n", no_wrap=True)
    table.add_column("run\n", no_wrap=True)
    for metric in STUDY_METRICS:
        table.add_column(f"{metric.heading}\n{metric.unit}", justify="right", no_wrap=True)
    for each in cases:
        cells = (f"{metric.format(each.values[metric.key])} ({each.ratio(metric.key)})" for metric in STUDY_METRICS)
        table.add_row(each.case, each.run, *cells)
    return table


def held_out_table(summary: Mapping[str, Any]) -> Table:
    """Return the RMS position errors on held-out trajectories beside those on the training trajectory.

    Args:
        summary: Content of ``summary.json`` of a study with held-out trajectories.

    Returns:
        A table with one row for each case.
    """
    found = summary["held_out"]
    paths = list(next(iter(found.values())))
    table = Table(title="e_p, mm, final model, frozen", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in ("case", "training", *paths):
        table.add_column(heading, justify="left" if heading == "case" else "right", no_wrap=True)
    for case, held_out in found.items():
        errors_m = [summary["cases"][case]["e_p_rms_m"], *(held_out[path]["e_p_rms_m"] for path in paths)]
        table.add_row(case, *("stopped" if e is None else f"{1e3 * e:.1f}" for e in errors_m))
    return table


def certificate_table(summary: Mapping[str, Any]) -> Table:
    """Return observed errors and error bounds of a certificate.

    A bound that does not exist has no row.

    Args:
        summary: Content of ``certificate.json``.

    Returns:
        A table with rows for observed errors and for every bound by kind.
    """
    first, last = summary["window_s"]
    table = Table(
        title=f"{summary['scenario']}, seed {summary['seed']}: largest errors from {first:.1f} to {last:.1f} s",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )
    table.add_column("bound\n", no_wrap=True)
    table.add_column("run\n", no_wrap=True)
    for error, (_, unit) in ERROR_UNITS.items():
        table.add_column(f"{error.replace('omega', 'ω')}\n{unit}", justify="right", no_wrap=True)
    table.add_column("e_p / \nobs.", justify="right", no_wrap=True)
    table.add_column("status\n", no_wrap=True)
    for label, key in (
        ("observed", "observed"),
        ("nominal", "nominal_error"),
        ("nonlinear part", "linearization_error"),
    ):
        if summary[key]:
            table.add_row(
                label, "", *(_format_size(summary[key][e], scale) for e, (scale, _) in ERROR_UNITS.items()), "", ""
            )
    exceeded = {
        (each["prediction_bound"], each["kind"]) for each in summary["violations"] if each["run"] == "simulation"
    }
    for name, bounds in summary["ultimate_bounds"].items():
        for kind, label in BOUND_KIND_LABELS.items():
            if has_bound(bounds[kind]):
                status = "exceeded" if (name, kind) in exceeded else bounds["status"]
                cells = [_format_size(bounds[kind][e], scale) for e, (scale, _) in ERROR_UNITS.items()]
                ratio = format_cell(bounds["bound_over_observed"][kind]["e_p"], 1.0, ".2g")
                table.add_row(name, label, *cells, ratio, status)
    return table


def has_bound(bounds: Mapping[str, float | None]) -> bool:
    """Return whether the bound of any error exists."""
    return any(bound is not None for bound in bounds.values())


def falsification_table(trials: Sequence[FalsificationTrial], name: str) -> Table:
    """Return the ratio of observed error and bound for every trial.

    Args:
        trials: Completed trials.
        name: Name of the scenario.

    Returns:
        A table with one row for each trial.
    """
    table = Table(title=f"{name}: observed / bound", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("trial", no_wrap=True)
    for error in ERROR_UNITS:
        table.add_column(error.replace("omega", "ω"), justify="right", no_wrap=True)
    table.add_column("out of interval", justify="right", no_wrap=True)
    for trial in trials:
        outside = f"{trial.num_components_outside} of {trial.num_components}" if trial.observed_over_bound else ""
        ratios = (format_cell(trial.observed_over_bound.get(error), 1.0, ".3f") for error in ERROR_UNITS)
        table.add_row(trial.name, *ratios, outside)
    return table


# Cells and output -----------------------------------------------------------------------------------------------------


def _format_size(value: float | None, scale: float) -> str:
    """Format with three digits, and with all digits up to 1e5 because an exponent would widen the column."""
    whole = value is not None and 1e3 <= value * scale < 1e5
    return format_cell(value, scale, ".0f" if whole else ".3g")


def print_table(table: Table, num_repeated: int = 1) -> None:
    """Print a table; one that is wider than the terminal in parts below each other.

    Args:
        table: Table to print.
        num_repeated: Number of first columns that every part repeats.
    """
    width = Console().width
    parts: list[list[Column]] = []
    for column in table.columns[num_repeated:]:
        if not parts or _width(_select(table, [*table.columns[:num_repeated], *parts[-1], column])) > width:
            parts.append([])
        parts[-1].append(column)
    for k, columns in enumerate(parts):
        part = _select(table, [*table.columns[:num_repeated], *columns])
        part.title = None if k else table.title
        console = Console(width=max(width, _width(part)), emoji=False, markup=False)
        with console.capture() as captured:  # rich would end the process if the pipe is closed
            console.print(part)
        print(captured.get(), end="", flush=True)


def _select(table: Table, columns: Sequence[Column]) -> Table:
    """Return a table of some columns."""
    part = Table(box=table.box, padding=table.padding, pad_edge=table.pad_edge)
    encoding = Console().encoding
    for column in columns:
        part.add_column(_replace_unencodable(str(column.header), encoding), justify=column.justify, no_wrap=True)
    for cells in zip(*(column.cells for column in columns), strict=True):
        part.add_row(*cells)
    return part


def _replace_unencodable(text: str, encoding: str) -> str:
    """Spell out Greek letters that an encoding does not contain."""
    try:
        text.encode(encoding)
    except UnicodeEncodeError:
        return text.translate(ASCII_GREEK)
    return text


def _width(table: Table) -> int:
    """Return the width of a table on a terminal of sufficient width."""
    console = Console(width=10_000, emoji=False, markup=False)
    return console.measure(table).maximum
