"""Report of a study as one HTML page: conclusion, warnings, run, metrics, figures, certificate, playback and settings.

The page requires no network access and no other file.
"""

from __future__ import annotations

import contextlib
import html
import os
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr
from rich.table import Table

from colift import scenario
from colift.analysis import conclusions, poses, result_files
from colift.analysis.study_metrics import STUDY_METRICS, format_value
from colift.closed_loop import log
from colift.runtime import atomic_write, bounded_read, run_directory
from colift.scenario import Scenario, differences
from colift.visualization import html_page, playback

PAGE_FILE = "report.html"
SUMMARY, CERTIFICATE = run_directory.SUMMARY_FILE, "certificate.json"
CONTENT_SECURITY_POLICY = f"{playback.CONTENT_SECURITY_POLICY}; frame-src 'self'"
CAPTIONS = {
    "figure_0_team": "Team at its initial state, and the whole path",
    "figure_1_tracking": "Figure 1. Position error and attitude error function",
    "figure_2_mismatch": "Figure 2. Wrench mismatch, force and moment",
    "figure_3_deviation": "Figure 3. Predictive standard deviations and true prediction errors",
    "figure_4_forces": "Figure 4. Estimated and true contact forces, and internal forces",
    "figure_5_rho_bar": "Figure 5. Error bounds and true prediction errors",
    "figure_6_certificate": "Figure 6. Certified and observed position error, and sources of conservatism",
    "figure_7_reaction": "Figure 7. Online correction: position error, forces, corrections, weight, number of samples",
    "figure_8_contact_forces": "Figure 8. External and internal part of the contact forces, payload frame",
    "figure_9_limits": "Figure 9. Errors, contact force, rotor effectiveness, and limits that act",
}
"""Caption of each figure file."""
PNG_BEGIN, PNG_END = b"\x89PNG\r\n\x1a\n", b"IEND\xaeB`\x82"
"""First and last bytes of a PNG image."""
FRAME_STYLE = """
iframe { width: 100%; height: 860px; border: 1px solid var(--line); }
@media (max-width: 700px) { iframe { height: 1500px; } }
"""
CONTACT_COLUMNS = {
    "peak, mean [N]": "largest and mean norm of the true contact force",
    "internal peak, mean [N]": "largest and mean norm of its internal part, which applies no wrench to the payload",
    "bias x, y, z [N]": "mean of the estimated minus the true force, payload frame",
    "error [N]": "RMS norm of the estimated minus the true force",
    "std [N]": "RMS norm of the stated standard deviation of the estimate; none for tip force sensors",
}
"""Columns of the table of contact forces, and their definitions."""


def write_report(
    out: Path,
    cases: Mapping[str, str],
    metrics_table: Callable[[dict[str, Any]], Table],
    certificate_table: Callable[[dict[str, Any]], tuple[Table, Sequence[str], Mapping[str, str]]],
) -> Path:
    """Write the report of a study to its folder.

    Logs that cannot be used raise `ValueError`. A folder that cannot be written, or that another process writes to,
    raises `OSError`.

    Args:
        out: Folder of the study.
        cases: Description of each case.
        metrics_table: Function that returns the table of a summary.
        certificate_table: Function that returns the table of a certificate, the sentences below it, and the
            definitions of its columns.

    Returns:
        Path of the report, `out/report.html`.

    Raises:
        ValueError: If the folder contains no summary, if logs and summary differ in run, or if a file is damaged.
    """
    if not os.path.lexists(out / SUMMARY):
        raise ValueError(f"{out} contains no {SUMMARY}; colift study writes it at the end of all flights")
    summary, flights = result_files.load_summary(out / SUMMARY), log.load_flights(out, cases)[1]
    run, first = str(summary.get("run")), next(iter(flights.values()))
    if first.attrs["run"] != run:
        raise ValueError(
            f"{out} contains flights of {first.attrs['run']} and a {SUMMARY} of {run}: run colift study again"
        )
    settings = poses.scenario_of_log(first)
    certificate = _load_certificate(out, run)
    with _report_damage(out / SUMMARY):
        warnings = collect_warnings(summary, None)
    if certificate is not None:
        with _report_damage(out / CERTIFICATE):
            warnings = collect_warnings(summary, certificate)
    with _report_damage(out / SUMMARY):
        parts = [
            _head(settings, summary),
            html_page.conclusion(conclusions.conclude_study(summary, warnings)),
            html_page.section("Warnings", _list(warnings)),
            html_page.section("Run", _run(summary, settings) + _omitted_plugins(first)),
            html_page.section(
                "Second half of the run",
                _table(metrics_table(summary))
                + html_page.column_meanings({metric.title: metric.meaning for metric in STUDY_METRICS})
                + "<h3>Cases</h3>"
                + html_page.definitions({name: cases[name] for name in flights}),
            ),
            *_contact_forces(summary),
            html_page.section("Figures", "".join(_figures(out, run, certificate is not None))),
        ]
    if certificate is not None:
        with _report_damage(out / CERTIFICATE):
            table, lines, columns = certificate_table(certificate)
            content = _table(table) + html_page.column_meanings(columns) + html_page.paragraphs(lines)
            parts.append(html_page.section("Certificate", content))
    page = html.escape(playback.build_page(flights, cases))
    parts.append(html_page.section("Playback", f'<iframe title="playback of the flights" srcdoc="{page}"></iframe>'))
    parts.append(html_page.section("Settings", _settings(settings)))
    text = html_page.document(
        f"{settings.name}: report", "\n".join(parts), CONTENT_SECURITY_POLICY, html_page.STYLE + FRAME_STYLE, run
    )
    with run_directory.stage_run_directory(out, run, (PAGE_FILE,)) as folder:
        atomic_write.write_atomic(folder.path / PAGE_FILE, text.encode())
    return out / PAGE_FILE


def _load_certificate(out: Path, run: str) -> dict[str, Any] | None:
    """Return the certificate of a run; None if the folder contains none, or that of another run."""
    path = out / CERTIFICATE
    if not os.path.lexists(path):
        return None
    certificate = result_files.load_certificate(path)
    return certificate if str(certificate.get("run")) == run else None


@contextlib.contextmanager
def _report_damage(path: Path) -> Generator[None]:
    """Raise ValueError with the name of a file if an entry is missing or has a wrong type."""
    try:
        yield
    except (KeyError, TypeError, AttributeError, IndexError, OverflowError) as error:
        reason = f"no entry {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"{path} is damaged: {reason}; run the command that writes it again") from error


def collect_warnings(summary: Mapping[str, Any], certificate: Mapping[str, Any] | None) -> list[tuple[bool, str]]:
    """Return the warnings at the top of a report.

    Args:
        summary: Content of `summary.json`.
        certificate: Content of `certificate.json`, or None.

    Returns:
        Pairs of severity and text. The severity is True if the warning invalidates a result.
    """
    warnings = [
        (True, f"{case} is incomplete: {x['termination_reason']}")
        for case, x in summary["cases"].items()
        if not x["complete"]
    ]
    if certificate is not None:
        warnings += [
            (True, f"certificate: {each['error']} is above a bound of {each['prediction_bound']}: {_excess(each)}")
            for each in certificate["violations"]
        ]
    warnings += [(False, text) for text in summary["warnings"]]
    for case, metrics in summary["cases"].items():
        warnings += [(False, f"{case}: {text}") for text in metrics["warnings"]]
        if ticks := metrics["saturated_ticks"]:
            warnings.append((False, f"{case}: thrust reached its limit at {ticks} ticks (sum over the agents)"))
        bodies = [metrics["error_bound"]["payload"], *metrics["error_bound"]["agents"]]
        maximum = max(max(body["violation_rate"].values()) for body in bodies)
        if maximum > 0:
            warnings.append(
                (False, f"{case}: a prediction error exceeds its bound (figure 5) {maximum:.1%} of the time")
            )
    if unproven := summary["error_bound_assumptions"]["unproven_assumptions"]:
        warnings.append(
            (
                False,
                f"the error bounds of figure 5 require unproven assumptions: {conclusions.list_assumptions(unproven)}",
            )
        )
    if certificate is not None:
        each = certificate["ultimate_bounds"].values()
        assumed = dict.fromkeys(name for bounds in each for name in bounds["unproven_assumptions"])
        if assumed:
            listed = conclusions.list_assumptions(assumed)
            warnings.append((False, f"the certificate requires unproven assumptions: {listed}"))
    return warnings


def _excess(each: Mapping[str, Any]) -> str:
    """Return a text with the observed error and its bound."""
    return f"observed {each['observed']:.4g}, bound {each['ultimate_bound']:.4g} (SI units)"


def setting_differences(settings: Scenario) -> list[tuple[str, str, str]] | None:
    """Compare a scenario with the shipped scenario of the same name.

    Args:
        settings: Scenario.

    Returns:
        Path, shipped value and present value of each setting that differs; None if no shipped scenario has this name.
    """
    if settings.name not in scenario.shipped_names():
        return None
    shipped = scenario.load_scenario(settings.name)
    return [
        (each.path, each.first, each.second)
        for each in differences.setting_differences(*(x.model_dump(mode="json") for x in (shipped, settings)))
    ]


# HTML -----------------------------------------------------------------------------------------------------------------


def _head(settings: Scenario, summary: Mapping[str, Any]) -> str:
    """Return title, description and version."""
    description = f"<p>{html.escape(settings.description)}</p>" if settings.description else ""
    version = html.escape(summary["version"])
    return f'<h1>{html.escape(settings.name)}</h1>{description}<p class="quiet">colift {version}</p>'


def _list(warnings: Sequence[tuple[bool, str]]) -> str:
    """Return the list of warnings."""
    if not warnings:
        return "<p>No warnings: all cases are complete and within their limits.</p>"
    items = (f"<li{' class=bad' * severe}>{html.escape(text)}</li>" for severe, text in warnings)
    return f'<ul id="warnings">{"".join(items)}</ul>'


def _run(summary: Mapping[str, Any], settings: Scenario) -> str:
    """Return the table of the run and the settings that differ from the shipped scenario."""
    slowest, margins = summary["slowest_mode"], summary.get("stability_margins")  # absent in early studies
    rows = {
        "command": summary["command"],
        "scenario": f"{settings.name}, seed {summary['seed']}, {settings.duration_s:g} s at {settings.control_Hz:g} Hz",
        "plant": summary["plant"],
        "faults": "; ".join(fault.describe() for fault in settings.faults) or "none",
        "slowest mode at rest": slowest["description"] if slowest else "not found",
        "margins at rest": margins["description"] if margins else "none",
        "versions": ", ".join(f"{name} {version}" for name, version in summary["versions"].items()),
        "run": f"{summary['run']}, settings {summary['settings_digest']}",
    }
    changed, name = setting_differences(settings), html.escape(settings.name)
    run = html_page.definitions(rows)
    if changed is None:
        return run + f"<p>{name} is not a shipped scenario; the last section contains its settings.</p>"
    if not changed:
        return run + f"<p>All settings are those of the shipped scenario {name}.</p>"
    header = ("setting", f"shipped scenario {settings.name}", "this run")
    return run + "<h3>Changed settings</h3>" + html_page.table(header, changed, words=True)


def _omitted_plugins(ds: xr.Dataset) -> str:
    """Return a sentence on the plugins of the scenario, which are not loaded."""
    names = ", ".join(html.escape(name) for name in poses.plugin_classes(ds))
    return f"<p>The run used plugins ({names}). This page omits their settings, since it loads no plugin.</p>" * bool(
        names
    )


def _table(table: Table) -> str:
    """Return a table of the terminal as HTML."""
    header = [str(column.header).strip() for column in table.columns]
    rows = zip(*([str(cell) for cell in column.cells] for column in table.columns), strict=True)
    return html_page.table(header, list(rows), title=str(table.title or ""))


def _contact_forces(summary: Mapping[str, Any]) -> Iterator[str]:
    """Return the table of contact forces; studies of earlier versions have none."""
    rows = [
        (case, contact, *_contact_cells(found))
        for case, metrics in summary["cases"].items()
        for contact, found in metrics.get("contact_forces", {}).items()
    ]
    if rows:
        header = ("case", "contact", "peak\nN", "mean\nN", "internal\npeak N", "internal\nmean N")
        header = (*header, "bias x\nN", "bias y\nN", "bias z\nN", "error\nN", "std\nN")
        content = html_page.table(header, rows, text_columns=2) + html_page.column_meanings(CONTACT_COLUMNS)
        yield html_page.section("Contact forces, second half of the run", content + _prior_table(summary))


def _prior_table(summary: Mapping[str, Any]) -> str:
    """Return the combinations of contact forces that rest on a prior; empty with tip force sensors."""
    given = {case: x for case, metrics in summary["cases"].items() if (x := metrics.get("contact_force_prior"))}
    if not given:
        return ""
    first = next(iter(given.values()))
    text = (
        "No sensor measures the contact forces. "
        f"The equations of motion have {first['unknowns']} unknowns, residuals and "
        f"contact forces, and leave {first['combinations']} combinations of them undetermined. These rest on the prior "
        "of the residuals."
    )
    rows = [
        (case, name, *(format_value(found[part][key], 1.0, ".2f") for key in ("std", "error_rms")))
        for case, found in given.items()
        for part, name in (("force", "net force [N]"), ("moment", "net moment [N m]"))
    ]
    return html_page.paragraphs([text]) + html_page.table(("case", "combination", "std", "error"), rows, text_columns=2)


def _contact_cells(found: Mapping[str, Any]) -> list[str]:
    """Return the numbers of one contact."""
    norms = [found[f"{name}_N"] for name in ("peak", "mean", "internal_peak", "internal_mean")]
    numbers = (*norms, *found["bias_N"], found["error_rms_N"], found.get("std_N"))
    return [format_value(x, 1.0, ".2f") for x in numbers]


def _figures(out: Path, run: str, certified: bool) -> Iterator[str]:
    """Return the figures of the run in the folder; raise OSError or ValueError if a file is no figure of colift."""
    for name, caption in CAPTIONS.items():
        file = out / f"{name}.png"
        if not os.path.lexists(file) or (name == "figure_6_certificate" and not certified):
            continue
        run_directory.refuse_foreign_files([file])
        if run_directory.read_run_id(file) == run:
            png = bounded_read.read_bytes(file, bounded_read.MAX_TABLE_BYTES)
            if not (png.startswith(PNG_BEGIN) and png.endswith(PNG_END)):
                raise ValueError(f"{file} is damaged: not a complete PNG image; run the command that writes it again")
            yield html_page.figure(png, caption)


def _settings(settings: Scenario) -> str:
    """Return the scenario file."""
    text = html.escape(scenario.to_yaml(settings))
    return f"<details><summary>scenario file with all settings</summary><pre>{text}</pre></details>"
