"""Report of a study as one HTML page: warnings, run, metrics, figures, certificate, playback and settings.

The page requires no network access and no other file.
"""

from __future__ import annotations

import base64
import contextlib
import html
import json
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr
from rich.table import Table

from colift import scenario
from colift.analysis import poses, result_files
from colift.closed_loop import log
from colift.runtime import atomic_write, run_directory
from colift.scenario import Scenario
from colift.visualization import playback

PAGE_FILE = "report.html"
SUMMARY, CERTIFICATE = "summary.json", "certificate.json"
CONTENT_SECURITY_POLICY = f"{playback.CONTENT_SECURITY_POLICY}; frame-src 'self'"
CAPTIONS = {
    "figure_0_team": "Team at its initial state, and the whole path",
    "figure_1_tracking": "Figure 1. Position error and attitude error function",
    "figure_2_mismatch": "Figure 2. Wrench mismatch, force and moment",
    "figure_3_deviation": "Figure 3. Predictive standard deviations and true prediction errors",
    "figure_4_forces": "Figure 4. Estimated and true contact forces, and internal forces",
    "figure_5_rho_bar": "Figure 5. Error bounds and true prediction errors",
    "figure_6_certificate": "Figure 6. Certified and observed position error, and sources of conservatism",
    "figure_7_reaction": "Figure 7. Online correction: position error, innovations, gains, number of samples",
}
"""Caption of each figure file."""
STYLE = """
:root { color-scheme: light dark; --text: #22262b; --quiet: #5c646d; --line: #d3d8dd; --paper: #fff; --bad: #b3261e; }
@media (prefers-color-scheme: dark) {
  :root { --text: #e4e7ea; --quiet: #a2abb4; --line: #363c43; --paper: #15181c; --bad: #ff8a80; }
}
body { max-width: 1080px; margin: 0 auto; padding: 16px; background: var(--paper); color: var(--text);
  font: 15px/1.5 system-ui, sans-serif; overflow-wrap: anywhere; }
h1 { margin: 0; } h2 { margin: 1.6em 0 0.4em; }
.quiet, figcaption { color: var(--quiet); } .bad { color: var(--bad); font-weight: 600; }
.wide { overflow-x: auto; } pre { overflow-x: auto; font-size: 13px; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; }
th, td { padding: 3px 9px; border-bottom: 1px solid var(--line); text-align: right; vertical-align: bottom; }
.wide td, .wide th { white-space: nowrap; } .wide .words td { white-space: normal; min-width: 7em; }
th:first-child, td:first-child, .words td, .words th { text-align: left; overflow-wrap: normal; }
.words th { font-weight: normal; color: var(--quiet); vertical-align: top; white-space: nowrap; }
.words td { overflow-wrap: anywhere; } .wide + .words { margin-top: 1.2em; }
figure { margin: 1.2em 0; } figure img { display: block; width: 100%; background: #fff; }
iframe { width: 100%; height: 860px; border: 1px solid var(--line); }
@media (max-width: 700px) { iframe { height: 1500px; } .words th { white-space: normal; }
  figure { overflow-x: auto; } figure img { width: 700px; max-width: none; } }
"""


def write_report(
    out: Path,
    cases: Mapping[str, str],
    metrics_table: Callable[[dict[str, Any]], Table],
    certificate_table: Callable[[dict[str, Any]], tuple[Table, Sequence[str]]],
) -> Path:
    """Write the report of a study to its folder.

    Logs that cannot be used raise `ValueError`. A folder that cannot be written, or that another process writes to,
    raises `OSError`.

    Args:
        out: Folder of the study.
        cases: Description of each case.
        metrics_table: Function that returns the table of a summary.
        certificate_table: Function that returns the table of a certificate and the sentences below it.

    Returns:
        Path of the report, `out/report.html`.

    Raises:
        ValueError: If the folder contains no summary, if logs and summary differ in run, or if a file is damaged.
    """
    if not (out / SUMMARY).is_file():
        raise ValueError(f"{out} contains no {SUMMARY}; colift study writes it at the end of all flights")
    summary, flights = result_files.load_summary(out / SUMMARY), log.load_flights(out, cases)[1]
    run, first = str(summary.get("run")), next(iter(flights.values()))
    if first.attrs["run"] != run:
        raise ValueError(
            f"{out} contains flights of {first.attrs['run']} and a {SUMMARY} of {run}: run colift study again"
        )
    settings = poses.scenario_of_log(first)
    certificate = None
    if (out / CERTIFICATE).is_file() and run_directory.read_run_id(out / CERTIFICATE) == run:
        certificate = result_files.load_certificate(out / CERTIFICATE)
    descriptions = _definitions({name: cases[name] for name in flights})
    with _report_damage(out / SUMMARY):
        parts = [
            _head(settings, summary),
            _section("Warnings", _list(collect_warnings(summary, None))),
            _section("Run", _run(summary, settings) + _omitted_plugins(first)),
            _section("Second half of the run", _table(metrics_table(summary)) + descriptions),
            _section("Figures", "".join(_figures(out, run, certificate is not None))),
        ]
    if certificate is not None:
        with _report_damage(out / CERTIFICATE):
            parts[1] = _section("Warnings", _list(collect_warnings(summary, certificate)))
            table, lines = certificate_table(certificate)
            notes = "".join(f"<p>{html.escape(line)}</p>" for line in lines)
            parts.append(_section("Certificate", _table(table) + notes))
    page = html.escape(playback.build_page(flights, cases))
    parts.append(_section("Playback", f'<iframe title="playback of the flights" srcdoc="{page}"></iframe>'))
    parts.append(_section("Settings", _settings(settings)))
    with run_directory.stage_run_directory(out, run, (PAGE_FILE,)) as folder:
        atomic_write.write_atomic(folder.path / PAGE_FILE, _document(settings.name, "\n".join(parts)).encode())
    return out / PAGE_FILE


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
        warnings.append((False, f"the error bounds of figure 5 require unproven assumptions: {', '.join(unproven)}"))
    if certificate is not None:
        each = certificate["ultimate_bounds"].values()
        assumed = dict.fromkeys(name for bounds in each for name in bounds["unproven_assumptions"])
        warnings += [(False, f"the certificate requires unproven assumptions: {', '.join(assumed)}")] if assumed else []
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
    shipped, here = (
        _leaves(each.model_dump(mode="json")) for each in (scenario.load_scenario(settings.name), settings)
    )
    text = lambda values, path: json.dumps(values[path]) if path in values else "absent"  # noqa: E731
    return [
        (path, text(shipped, path), text(here, path))
        for path in dict.fromkeys([*shipped, *here])
        if text(shipped, path) != text(here, path)
    ]


def _leaves(value: Any, path: str = "") -> dict[str, Any]:
    """Return settings by their path, in the form of `--set`; null values are omitted."""
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        items = enumerate(value)
    else:
        return {} if value is None else {path: value}
    leaves: dict[str, Any] = {}
    for name, item in items:
        leaves |= _leaves(item, f"{path}.{name}" if path else str(name))
    return leaves


# HTML -----------------------------------------------------------------------------------------------------------------


def _head(settings: Scenario, summary: Mapping[str, Any]) -> str:
    """Return title, description and version."""
    description = f"<p>{html.escape(settings.description)}</p>" if settings.description else ""
    version = html.escape(summary["version"])
    return f'<h1>{html.escape(settings.name)}</h1>{description}<p class="quiet">colift {version}</p>'


def _section(title: str, content: str) -> str:
    """Return a section with its title."""
    return f"<section><h2>{html.escape(title)}</h2>\n{content}</section>"


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
        "slowest mode at rest": slowest["description"] if slowest else "not found",
        "margins at rest": margins["description"] if margins else "none",
        "versions": ", ".join(f"{name} {version}" for name, version in summary["versions"].items()),
        "run": f"{summary['run']}, settings {summary['settings_digest']}",
    }
    differences, name = setting_differences(settings), html.escape(settings.name)
    if differences is None:
        return _definitions(rows) + f"<p>{name} is not a shipped scenario; the last section contains its settings.</p>"
    if not differences:
        return _definitions(rows) + f"<p>All settings are those of the shipped scenario {name}.</p>"
    cells = "".join(
        f"<tr>{''.join(f'<td>{html.escape(each)}</td>' for each in difference)}</tr>" for difference in differences
    )
    head = f"<tr><th>setting</th><th>shipped scenario {name}</th><th>this run</th></tr>"
    return (
        _definitions(rows)
        + f'<h3>Changed settings</h3><div class="wide"><table class="words">{head}{cells}</table></div>'
    )


def _omitted_plugins(ds: xr.Dataset) -> str:
    """Return a sentence on the plugins of the scenario, which are not loaded."""
    names = ", ".join(html.escape(name) for name in poses.plugin_classes(ds))
    return f"<p>The run used plugins ({names}). This page omits their settings, since it loads no plugin.</p>" * bool(
        names
    )


def _definitions(rows: Mapping[str, str]) -> str:
    """Return a table with a name and a text in each row."""
    cells = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(x)}</td></tr>" for name, x in rows.items())
    return f'<table class="words">{cells}</table>'


def _table(table: Table) -> str:
    """Return a table of the terminal as HTML."""
    head = "".join(
        f"<th>{html.escape(str(column.header).strip())}</th>".replace("\n", "<br>") for column in table.columns
    )
    rows = zip(*(column.cells for column in table.columns), strict=True)
    body = "".join(f"<tr>{''.join(f'<td>{html.escape(str(cell))}</td>' for cell in row)}</tr>" for row in rows)
    title = f'<p class="quiet">{html.escape(str(table.title))}</p>' if table.title else ""
    return f'{title}<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _figures(out: Path, run: str, certified: bool) -> Iterator[str]:
    """Return the figures of the run in the folder."""
    for name, caption in CAPTIONS.items():
        file = out / f"{name}.png"
        if file.is_file() and run_directory.read_run_id(file) == run and (certified or name != "figure_6_certificate"):
            data = base64.b64encode(file.read_bytes()).decode()
            image = f'<img alt="{caption}" src="data:image/png;base64,{data}">'
            yield f"<figure>{image}<figcaption>{caption}</figcaption></figure>\n"


def _settings(settings: Scenario) -> str:
    """Return the scenario file."""
    text = html.escape(scenario.to_yaml(settings))
    return f"<details><summary>scenario file with all settings</summary><pre>{text}</pre></details>"


def _document(title: str, content: str) -> str:
    """Return the HTML document."""
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{CONTENT_SECURITY_POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
        f"<title>{html.escape(title)}: report</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"{content}\n</body>\n</html>\n"
    )
