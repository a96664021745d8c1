"""Index of all runs below a folder as one HTML page with a sortable table.

The page reads no logs and makes no network request. Its script is identified by its digest in the security policy, so
that no text of a result file can run as a script.
"""

from __future__ import annotations

import html
import math
import os
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from urllib.parse import quote

from colift.analysis.run_folders import RunFolder, find_runs
from colift.analysis.study_metrics import format_value
from colift.runtime import atomic_write, run_directory
from colift.visualization import html_page

PAGE_FILE = "index.html"
PAGES = ("report.html", "playback.html", "certificate.json")
"""Files of a run to which the page links."""
COLUMNS = {
    "folder": "folder of the run; links to report and playback, if colift report and colift playback have run",
    "cases": "simulated cases; the table sorts by their number",
    "e_p [mm]": "RMS norm of the position error in the second half, by case; the table sorts by the smallest",
    "e_R [mrad]": "RMS norm of the attitude error in the second half, by case; the table sorts by the smallest",
    "scenario, seed": "name of the scenario and seed of all random numbers",
    "date": "time at which the summary was written, UTC",
}
"""Definitions of the columns."""
STYLE = (
    html_page.STYLE
    + """
#runs td { vertical-align: top; white-space: nowrap; }
#runs td, #runs th { text-align: left; } #runs .number { text-align: right; }
#runs th button { all: unset; cursor: pointer; font-weight: 600; white-space: nowrap; }
#runs th button:focus-visible { outline: 2px solid var(--link); outline-offset: 2px; }
#runs th button::after { content: " ↕"; color: var(--quiet); font-weight: normal; }
#runs th[aria-sort=ascending] button::after { content: " ↑"; }
#runs th[aria-sort=descending] button::after { content: " ↓"; }
#runs td:first-child a { margin-right: 0.6em; }
#runs td:first-child { white-space: normal; min-width: 9em; overflow-wrap: anywhere; }
#runs .bad { white-space: normal; font-weight: normal; }
#filter { font: inherit; color: inherit; background: var(--paper); border: 1px solid var(--line); border-radius: 4px;
  padding: 4px 8px; max-width: 100%; box-sizing: border-box; }
"""
)
SCRIPT = """
"use strict";
const table = document.getElementById("runs"), body = table.tBodies[0], heads = [...table.tHead.rows[0].cells];
const value = (row, k) => row.cells[k].dataset.sort ?? row.cells[k].textContent;
function compare(a, b, numeric) {
  if (a === "" || b === "") return (a === "") - (b === "");
  return numeric ? Number(a) - Number(b) : a.localeCompare(b, "en", { numeric: true });
}
heads.forEach((head, k) => {
  const button = head.querySelector("button");
  if (!button) return;
  button.addEventListener("click", () => {
    const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    heads.forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
    const rows = [...body.rows];
    const missing = rows.filter((row) => value(row, k) === "");
    const known = rows.filter((row) => value(row, k) !== "");
    known.sort((a, b) => sign * compare(value(a, k), value(b, k), head.dataset.kind === "number"));
    body.append(...known, ...missing);
  });
});
const filter = document.getElementById("filter"), count = document.getElementById("count");
filter.addEventListener("input", () => {
  const words = filter.value.toLowerCase().split(/\\s+/).filter(Boolean);
  let shown = 0;
  for (const row of body.rows) {
    row.hidden = !words.every((word) => row.textContent.toLowerCase().includes(word));
    shown += !row.hidden;
  }
  count.textContent = `${shown} of ${body.rows.length} shown`;
});
"""


def write_index(folder: Path, cases: Mapping[str, str]) -> tuple[Path, list[RunFolder]]:
    """Write the index page of all runs below a folder.

    Args:
        folder: Folder to search, to which `index.html` is written.
        cases: Description of each case.

    Returns:
        Path of the page, and the runs.

    Raises:
        ValueError: If there is no run below the folder.
        OSError: If the folder cannot be read or written, or if its `index.html` was not written by colift.
    """
    runs = find_runs(folder, cases)
    if not runs:
        raise ValueError(f"{folder} contains no run: colift study or colift run writes one")
    page = folder / PAGE_FILE
    run_directory.refuse_foreign_files([page])
    atomic_write.write_atomic(page, build_index(folder, runs).encode(errors="replace"))
    return page, runs


def build_index(folder: Path, runs: Sequence[RunFolder]) -> str:
    """Build the text of the index page.

    Args:
        folder: Folder of the page; links are relative to it.
        runs: Runs below the folder.

    Returns:
        HTML text.
    """
    damaged = sum(bool(run.damage) for run in runs)
    number = "1 run" if len(runs) == 1 else f"{len(runs)} runs"
    sentences = [f"{folder} contains {number}."]
    if damaged:
        sentences.append(f"{damaged} cannot be read; the table states the reason.")
    heads = (
        _head("folder", order=' aria-sort="ascending"'),
        _head("cases", "number"),
        _head("e_p [mm]", "number"),
        _head("e_R [mrad]", "number"),
        _head("scenario, seed"),
        _head("date"),
    )
    rows = "\n".join(_row(folder, run) for run in runs)
    content = (
        f"<h1>Runs in {html.escape(str(folder))}</h1>{html_page.conclusion(sentences)}"
        '<p><label>Filter <input id="filter" type="search" placeholder="words in any column"></label> '
        '<span id="count" class="quiet" role="status"></span></p>'
        f'<div class="wide"><table id="runs"><thead><tr>{"".join(heads)}</tr></thead><tbody>\n{rows}\n</tbody></table>'
        f"</div>{html_page.column_meanings(COLUMNS)}"
        f'<p class="quiet">colift {html.escape(version("colift"))}; colift browse writes the page again.</p>'
        f"<script>{SCRIPT}</script>"
    )
    identifier = run_directory.run_id(version("colift"), repr([(str(run.path), run.run) for run in runs]))
    title = f"{folder}: runs"
    return html_page.document(title, content, html_page.script_policy(SCRIPT), STYLE, identifier)


def _head(name: str, kind: str = "text", order: str = "") -> str:
    """Return a column head that sorts the table."""
    return f'<th scope="col" data-kind="{kind}"{order}><button type="button">{html.escape(name)}</button></th>'


def _row(folder: Path, run: RunFolder) -> str:
    """Return the row of a run."""
    name = run.path.relative_to(folder).as_posix()
    reason = f'<div class="bad">damaged: {html.escape(run.damage)}</div>' if run.damage else ""
    identity = f"{run.scenario}, {run.seed}" if run.scenario else ""
    names = [html.escape(each.case) + (_ended_early() if not each.complete else "") for each in run.cases]
    if not run.cases and not run.damage:
        names = ["certificate"]
    return (
        f'<tr><td data-sort="{html.escape(name)}">{html.escape(name)}{reason}{_links(run.path, name)}</td>'
        f'<td data-sort="{len(run.cases) or ""}">{"<br>".join(names)}</td>'
        f"{_error_cell([each.position_error for each in run.cases], '.1f')}"
        f"{_error_cell([each.attitude_error for each in run.cases], '.1f')}"
        f"<td>{html.escape(identity)}</td>{_date_cell(run.modified)}</tr>"
    )


def _ended_early() -> str:
    """Return the mark of a case that ended early."""
    return ' <span class="bad">(ended early)</span>'


def _date_cell(modified: float | None) -> str:
    """Return the cell of a date, in UTC."""
    if modified is None:
        return '<td data-sort=""></td>'
    text = time.strftime("%Y-%m-%d %H:%M", time.gmtime(modified))
    return f'<td data-sort="{text}">{text}</td>'


def _error_cell(errors: Sequence[float], spec: str) -> str:
    """Return the cell of an error by case, in thousandths; the table sorts by the smallest."""
    known = [error for error in errors if math.isfinite(error)]
    key = repr(min(known)) if known else ""
    return f'<td class="number" data-sort="{key}">{"<br>".join(format_value(e, 1e3, spec) for e in errors)}</td>'


def _links(path: Path, name: str) -> str:
    """Return relative links to the pages of a run that exist."""
    found = [page for page in PAGES if (path / page).is_file()]
    prefix = "" if name == os.curdir else f"{quote(os.fsencode(name))}/"
    # a colon in the first part of a relative address would be read as the end of a protocol name
    links = " ".join(f'<a href="./{prefix}{page}">{page.split(".")[0]}</a>' for page in found)
    return f"<div>{links}</div>" if links else ""
