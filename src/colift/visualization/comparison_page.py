"""Comparison of runs as one HTML page and one figure: metrics with ratios, tracking errors over time, settings."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path

from matplotlib.figure import Figure

from colift.analysis import comparison
from colift.analysis.comparison import ComparedRun
from colift.analysis.study_metrics import STUDY_METRICS
from colift.runtime import atomic_write, run_directory
from colift.visualization import html_page, study_figures, style

PAGE_FILE, FIGURE_FILE = "comparison.html", "figure_comparison"
MAX_LABEL = 44
"""Largest number of characters of the name of a run in the figure."""


def write_comparison(runs: Sequence[ComparedRun], out: Path, descriptions: Mapping[str, str]) -> list[Path]:
    """Write the page, and the figure as PDF and PNG.

    Args:
        runs: Runs; the first is the reference of the ratios.
        out: Folder for the files; it is created.
        descriptions: Description of each case.

    Returns:
        Paths of the page and of the figure.

    Raises:
        OSError: If the folder cannot be written, or if a file of one of these names was not written by colift.
    """
    page, figures = out / PAGE_FILE, [out / f"{FIGURE_FILE}.{kind}" for kind in ("pdf", "png")]
    out.mkdir(parents=True, exist_ok=True)
    run_directory.refuse_foreign_files([page, *figures])
    compared = repr([(run.name, run.summary["run"], list(run.flights)) for run in runs])
    identifier = run_directory.run_id(version("colift"), compared)
    with style.style_context():
        files = style.save_figure(plot_comparison(runs), out / FIGURE_FILE, identifier)
    text = build_page(runs, descriptions, files[1].read_bytes(), identifier)
    atomic_write.write_atomic(page, text.encode(errors="replace"))
    return [page, *files]


def plot_comparison(runs: Sequence[ComparedRun]) -> Figure:
    """Plot position error and attitude error function of all cases of all runs over time.

    Cases differ in color and runs in dash pattern; if there is one case, runs differ in both.

    Args:
        runs: Runs with their logs.

    Returns:
        The figure.
    """
    cases = list(dict.fromkeys(case for run in runs for case in run.flights))
    markers = [look.marker for look in style.LINE_STYLES.values()]
    logs, styles = {}, {}
    for k, run in enumerate(runs):
        for case, ds in run.flights.items():
            name = f"{_label(run.name)}: {case}"
            logs[name] = ds
            look = style.style_of(case)._replace(dashes=style.DASH_PATTERNS[k % len(style.DASH_PATTERNS)])
            if len(cases) == 1:
                color = style.AGENT_COLORS[k % len(style.AGENT_COLORS)]
                look = look._replace(color=color, marker=markers[k % len(markers)])
            styles[name] = look
    return study_figures.plot_tracking_error(logs, {}, styles)


def build_page(runs: Sequence[ComparedRun], descriptions: Mapping[str, str], png: bytes, identifier: str = "") -> str:
    """Build the text of the page.

    Args:
        runs: Runs; the first is the reference of the ratios.
        descriptions: Description of each case.
        png: Figure of the tracking errors.
        identifier: Identifier by which colift recognizes the file.

    Returns:
        HTML text.
    """
    cases, differing = comparison.compare_cases(runs), comparison.differing_settings(runs)
    names = [run.name for run in runs]
    settings = comparison.describe_differences(differing, names[0])
    header = ("case", "run", *(f"{metric.heading}\n{metric.unit}" for metric in STUDY_METRICS))
    rows = [
        (
            each.case + " (ended early)" * (not each.complete),
            each.run,
            *(f"{metric.format(each.values[metric.key])}\n×{each.ratio(metric.key)}" for metric in STUDY_METRICS),
        )
        for each in cases
    ]
    columns = {
        "case, run": "case of the study, and folder of the run",
        **{metric.title: metric.meaning for metric in STUDY_METRICS},
        "×": f"ratio to the reference. {comparison.describe_reference(runs)}",
    }
    parts = [
        f"<h1>Comparison of {html.escape(', '.join(names))}</h1>",
        html_page.conclusion(comparison.conclude_comparison(cases, differing)),
        html_page.section("Settings", html_page.paragraphs(f"{line}." for line in settings)),
        html_page.section(
            "Second half of the run", html_page.table(header, rows, text_columns=2) + html_page.column_meanings(columns)
        ),
        html_page.section(
            "Tracking errors over time", html_page.figure(png, "Position error and attitude error function of all runs")
        ),
        html_page.section("Runs", html_page.definitions({run.name: _describe_run(run) for run in runs})),
        html_page.section("Cases", html_page.definitions(_case_descriptions(cases, descriptions))),
        f'<p class="quiet">colift {html.escape(version("colift"))}</p>',
    ]
    return html_page.document(f"Comparison of {', '.join(names)}", "\n".join(parts), run=identifier)


def _case_descriptions(cases: Sequence[comparison.ComparedCase], descriptions: Mapping[str, str]) -> dict[str, str]:
    """Return the descriptions of the compared cases."""
    return {each.case: descriptions[each.case] for each in cases}


def _describe_run(run: ComparedRun) -> str:
    """Return scenario, seed, version, run and command."""
    summary = run.summary
    return (
        f"{summary['scenario']}, seed {summary['seed']}, colift {summary['version']}, {summary['run']}: "
        f"{summary['command']}"
    )


def _label(name: str) -> str:
    """Return a name for the legend: limited length, no formula, no leading underscore, which matplotlib would omit."""
    short = name if len(name) <= MAX_LABEL else f"{name[: MAX_LABEL // 2]}…{name[-MAX_LABEL // 2 :]}"
    return (f"./{short}" if short.startswith("_") else short).replace("$", r"\$")
