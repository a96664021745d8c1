"""A study as one page to read, send and keep: what was run, what to beware of, table, figures, certificate, playback.

The page needs no network and no other file.
"""

from __future__ import annotations

import base64
import html
import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.table import Table

from colift import scenario
from colift.analysis import poses
from colift.closed_loop import log
from colift.runtime import atomic_write, run_directory
from colift.scenario import Scenario
from colift.visualization import playback

PAGE = "report.html"
SUMMARY, CERTIFICATE = "summary.json", "certificate.json"
POLICY = f"{playback.POLICY}; frame-src 'self'"
CAPTIONS = {
    "figure_0_team": "The team at its start, and the whole path",
    "figure_1_tracking": "Figure 1. Position error and attitude error function",
    "figure_2_mismatch": "Figure 2. Wrench mismatch, force and moment apart",
    "figure_3_deviation": "Figure 3. Predictive deviations, and the errors that they stand for",
    "figure_4_forces": "Figure 4. Contact forces as estimated, over the truth, and internal forces",
    "figure_5_rho_bar": "Figure 5. Radii over the true errors of prediction",
    "figure_6_certificate": "Figure 6. Certified radius and observed error of position, and where the slack comes from",
    "figure_7_reaction": "Figure 7. Memory and reflex: the error, what labels say beyond the map, what is used, points",
}
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
figure { margin: 1.2em 0; } figure img { display: block; width: 100%; background: #fff; }
iframe { width: 100%; height: 760px; border: 1px solid var(--line); }
"""


def write_report(
    out: Path,
    cases: Mapping[str, str],
    merits: Callable[[dict[str, Any]], Table],
    radii: Callable[[dict[str, Any]], tuple[Table, Sequence[str]]],
) -> Path:
    """Write the page of a folder's study, `out/report.html`; return its path. `cases`: names, and what they are.

    merits: the table of a summary; radii: that of a certificate, and sentences below it. Raises ValueError where the
    folder holds no study, or logs that are not of one run or do not hold their scenario; OSError where the page cannot
    be written or another process writes to the folder.
    """
    if not (out / SUMMARY).is_file():
        raise ValueError(f"{out} holds no {SUMMARY}, which colift study writes when its flights have ended")
    summary, found = json.loads((out / SUMMARY).read_text()), log.load_flights(out, cases)[1]
    run, first = summary["run"], next(iter(found.values()))
    if first.attrs["run"] != run:
        raise ValueError(
            f"{out} holds flights of {first.attrs['run']} and a {SUMMARY} of {run}: run colift study again"
        )
    told = poses.scenario_of_log(first)
    certified = None
    if (out / CERTIFICATE).is_file() and run_directory.read_run_id(out / CERTIFICATE) == run:
        certified = json.loads((out / CERTIFICATE).read_text())
    parts = [
        _head(told, summary),
        _section("Beware", _list(collect_warnings(summary, certified))),
        _section("What was run", _run(summary, told)),
        _section("Second half of the run", _table(merits(summary)) + _words({name: cases[name] for name in found})),
        _section("Figures", "".join(_figures(out, run, certified is not None))),
    ]
    if certified is not None:
        table, said = radii(certified)
        parts.append(_section("Certificate", _table(table) + "".join(f"<p>{html.escape(line)}</p>" for line in said)))
    inside = html.escape(playback.build_page(found, cases))
    parts.append(_section("Playback", f'<iframe title="the flights, played" srcdoc="{inside}"></iframe>'))
    parts.append(_section("Settings", _settings(told)))
    with run_directory.lock_run_directory(out, run, (PAGE,)):
        atomic_write.write_atomic(out / PAGE, _document(told.name, "\n".join(parts)).encode())
    return out / PAGE


def collect_warnings(summary: Mapping[str, Any], certified: Mapping[str, Any] | None) -> list[tuple[bool, str]]:
    """What a reader must know before the figures, in sentences, each with whether a result is spoiled by it."""
    said = [
        (True, f"{case} is incomplete: {x['stopped']}") for case, x in summary["cases"].items() if not x["complete"]
    ]
    if certified is not None:
        said += [
            (True, f"certificate: {each['error']} is above a radius of {each['bound']}: {_over(each)}")
            for each in certified["exceeded"]
        ]
    said += [(False, text) for text in summary["warnings"]]
    for case, found in summary["cases"].items():
        said += [(False, f"{case}: {text}") for text in found["warnings"]]
        if found["saturated_ticks"]:
            said.append((False, f"{case}: thrust met its limit at {found['saturated_ticks']} ticks, agents together"))
        bodies = [found["bound"]["payload"], *found["bound"]["agents"]]
        most = max(max(body["exceeded_share"].values()) for body in bodies)
        if most > 0:
            said.append(
                (False, f"{case}: an error of prediction is above its radius (figure 5) {most:.1%} of the time")
            )
    if summary["bound"]["assumed"]:
        said.append((False, f"radii of figure 5 rest on what is not shown: {', '.join(summary['bound']['assumed'])}"))
    if certified is not None:
        assumed = dict.fromkeys(name for radii in certified["radii"].values() for name in radii["assumed"])
        said += [(False, f"the certificate rests on what is not shown: {', '.join(assumed)}")] if assumed else []
    return said


def _over(each: Mapping[str, Any]) -> str:
    return f"observed {each['observed']:.4g}, radius {each['radius']:.4g} (SI units)"


def setting_differences(told: Scenario) -> list[tuple[str, str, str]] | None:
    """Settings that are not as in the shipped scenario of the same name: where, there, here; None if there is none."""
    if told.name not in scenario.shipped_names():
        return None
    shipped, here = (_leaves(each.model_dump(mode="json")) for each in (scenario.load_scenario(told.name), told))
    said = lambda x, where: json.dumps(x[where]) if where in x else "absent"  # noqa: E731
    return [
        (where, said(shipped, where), said(here, where))
        for where in dict.fromkeys([*shipped, *here])
        if said(shipped, where) != said(here, where)
    ]


def _leaves(value: Any, place: str = "") -> dict[str, Any]:
    """Settings by their path, as `--set` takes it; what is null is absent."""
    if isinstance(value, dict):
        items = value.items()
    elif isinstance(value, list) and any(isinstance(item, dict | list) for item in value):
        items = enumerate(value)
    else:
        return {} if value is None else {place: value}
    found: dict[str, Any] = {}
    for name, item in items:
        found |= _leaves(item, f"{place}.{name}" if place else str(name))
    return found


# HTML -----------------------------------------------------------------------------------------------------------------


def _head(told: Scenario, summary: Mapping[str, Any]) -> str:
    described = f"<p>{html.escape(told.description)}</p>" if told.description else ""
    return f'<h1>{html.escape(told.name)}</h1>{described}<p class="quiet">colift {html.escape(summary["version"])}</p>'


def _section(title: str, content: str) -> str:
    return f"<section><h2>{html.escape(title)}</h2>\n{content}</section>"


def _list(said: Sequence[tuple[bool, str]]) -> str:
    if not said:
        return "<p>nothing: every case flew to its end within its limits.</p>"
    items = (f"<li{' class=bad' * bad}>{html.escape(text)}</li>" for bad, text in said)
    return f'<ul id="warnings">{"".join(items)}</ul>'


def _run(summary: Mapping[str, Any], told: Scenario) -> str:
    """What was run, and what of it is not as shipped."""
    slowest, margins = summary["slowest_mode"], summary.get("margins")  # a study of before has none
    rows = {
        "command": summary["command"],
        "scenario": f"{told.name}, seed {summary['seed']}, {told.duration_s:g} s at {told.control_Hz:g} Hz",
        "plant": summary["plant"],
        "slowest mode at rest": slowest["says"] if slowest else "not found",
        "margins at rest": margins["says"] if margins else "none",
        "versions": ", ".join(f"{name} {given}" for name, given in summary["versions"].items()),
        "run": f"{summary['run']}, settings {summary['settings']}",
    }
    found = setting_differences(told)
    if found is None:
        return _words(rows) + f"<p>{html.escape(told.name)} is not a shipped scenario; its settings are at the end.</p>"
    if not found:
        return _words(rows) + f"<p>Settings are those of the shipped scenario {html.escape(told.name)}.</p>"
    cells = "".join(
        f"<tr>{''.join(f'<td>{html.escape(each)}</td>' for each in difference)}</tr>" for difference in found
    )
    head = f"<tr><th>setting</th><th>{html.escape(told.name)} as shipped</th><th>here</th></tr>"
    return _words(rows) + f'<h3>Not as shipped</h3><div class="wide"><table class="words">{head}{cells}</table></div>'


def _words(rows: Mapping[str, str]) -> str:
    cells = "".join(f"<tr><th>{html.escape(name)}</th><td>{html.escape(x)}</td></tr>" for name, x in rows.items())
    return f'<table class="words">{cells}</table>'


def _table(table: Table) -> str:
    """A table as the terminal has it."""
    head = "".join(
        f"<th>{html.escape(str(column.header).strip())}</th>".replace("\n", "<br>") for column in table.columns
    )
    rows = zip(*(column.cells for column in table.columns), strict=True)
    body = "".join(f"<tr>{''.join(f'<td>{html.escape(str(cell))}</td>' for cell in row)}</tr>" for row in rows)
    title = f'<p class="quiet">{html.escape(str(table.title))}</p>' if table.title else ""
    return f'{title}<div class="wide"><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>'


def _figures(out: Path, run: str, certified: bool) -> Iterator[str]:
    """The figures of the run that the folder holds."""
    for name, caption in CAPTIONS.items():
        file = out / f"{name}.png"
        if file.is_file() and run_directory.read_run_id(file) == run and (certified or name != "figure_6_certificate"):
            data = base64.b64encode(file.read_bytes()).decode()
            picture = f'<img alt="{caption}" src="data:image/png;base64,{data}">'
            yield f"<figure>{picture}<figcaption>{caption}</figcaption></figure>\n"


def _settings(told: Scenario) -> str:
    text = html.escape(scenario.to_yaml(told))
    return f"<details><summary>all of them, as a scenario file</summary><pre>{text}</pre></details>"


def _document(title: str, content: str) -> str:
    return (
        '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        f'<meta http-equiv="Content-Security-Policy" content="{POLICY}">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n<link rel="icon" href="data:,">\n'
        f"<title>{html.escape(title)}: report</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        f"{content}\n</body>\n</html>\n"
    )
