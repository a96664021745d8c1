"""Tables of the results pages, generated from `evidence/results` and `benchmarks/results`.

A page contains the marker ``<!-- table: NAME -->``; the documentation build replaces it by the table of that name. The
name begins with the results that the table uses, as in ``certified+rivals.tightness``, so that
``./dev evidence status`` finds the pages that quote a result. Keys of stored results are those of today
(`evidence/renamed.json`). Limits are read from the evidence modules, so no figure is typed here.

In a page that is read without a build, such as the README, the table stands between the marker and ``<!-- end -->``.
``python docs/results_tables README.md`` rewrites it, ``--check`` fails where it is out of date.
"""

from __future__ import annotations

import ast
import functools
import re
import sys
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
if str(ROOT) not in sys.path:
    sys.path.insert(0, str(ROOT))

MARKER = re.compile(r"<!-- table: (\S+) -->(?:\n.*?<!-- end -->)?", re.DOTALL)
CASES = {
    "C1": "no learning",
    "C2": "payload learning",
    "C3": "payload and agent learning",
    "adaptive": "GPs updated online, corrected by a Kalman filter",
    "integral": "C1 with integral action",
    "disturbance_observer": "low-pass filter of the unexplained wrench",
    "parametric": "identified rigid-body parameters",
    "regression": "ridge regression on stated basis functions",
    "label_feedback": "label feedback without a model",
    "label_feedback tuned_lead": "label feedback at its best lead time",
    "gp_label_feedback": "C3 with label feedback",
    "true_residual": "exact residual at the estimated state",
}
NUMBER = re.compile(r"(-|none|[-+]?\d[\d.e+-]*( \(.*\)| of \d+)?)$")  # also with its range, or a count
ERRORS = {"e_p": "position", "e_v": "velocity", "e_R": "attitude", "e_omega": "angular velocity"}

Cell = str | int | float | bool | None
Table = Callable[[], str]
TABLES: dict[str, Table] = {}


def table(results: str) -> Callable[[Table], Table]:
    """Register a function that returns a table under ``RESULT[+RESULT ...].FUNCTION``."""

    def register(function: Table) -> Table:
        TABLES[f"{results}.{function.__name__}"] = function
        return function

    return register


def markdown(header: Sequence[str], rows: Iterable[Sequence[Cell]]) -> str:
    """Return a Markdown table; numbers get three significant digits, and columns of numbers are right-aligned."""
    body = [[text(cell) for cell in row] for row in rows]
    columns = list(zip(*body, strict=True)) or [()] * len(header)
    lines = [header, ["---:" if column and all(map(NUMBER.match, column)) else "---" for column in columns], *body]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def text(cell: Cell) -> str:
    """Return a cell as text: yes or no, three significant digits, a dash where there is nothing."""
    if cell is None:
        return "-"
    if isinstance(cell, bool | np.bool_):
        return "yes" if cell else "**no**"
    if isinstance(cell, int | np.integer):
        return str(cell)
    return cell if isinstance(cell, str) else number(float(cell))


def number(x: float, digits: int = 3) -> str:
    """Return a number with some significant digits, or all of a whole number; no exponent from 0.001 to 100 000."""
    if not np.isfinite(x):
        return "none"
    if x == round(x) and abs(x) < 1e5:
        return str(round(x))
    if not 1e-3 <= abs(x) < 1e5:
        mantissa, exponent = f"{x:.{digits - 1}e}".split("e")
        return f"{mantissa.rstrip('0').rstrip('.')}e{int(exponent)}"
    before = int(np.floor(np.log10(abs(x)))) + 1
    return f"{x:.{max(0, digits - before)}f}"


def spread(values: Sequence[float], scale: float = 1.0) -> str:
    """Return median and range of values; a single value is returned alone, and flights that ended early are counted."""
    x = scale * np.array(values, dtype=float)
    if not np.isfinite(x).all():
        return f"{(~np.isfinite(x)).sum()} of {len(x)} ended early"
    return number(x[0]) if len(x) == 1 else f"{number(np.median(x))} ({number(x.min())} to {number(x.max())})"


class MissingResult(LookupError):
    """A result is not stored: it has not been computed with the present code."""


@functools.cache
def record(name: str) -> dict[str, Any]:
    """Return a stored result under the names of today.

    Raises:
        MissingResult: If the result is not stored.
    """
    import evidence
    from evidence import status

    if not status.has_result(name):
        raise MissingResult(name)
    return evidence.stored(name)


def items(name: str) -> dict[str, Any]:
    """Return the items of a stored result."""
    return record(name)["items"]


def count_faults(each: Iterable[dict[str, Any]]) -> int:
    """Return the number of faults of items."""
    return sum(len(one["faults"]) for one in each)


@functools.cache
def limits(name: str) -> dict[str, Any]:
    """Return the literal constants of an evidence module, without importing it."""
    found: dict[str, Any] = {}
    for node in ast.parse((ROOT / "evidence" / f"{name}.py").read_text()).body:
        if not isinstance(node, ast.Assign | ast.AnnAssign) or node.value is None:
            continue
        for target in node.targets if isinstance(node, ast.Assign) else [node.target]:
            try:
                value = ast.literal_eval(node.value)
            except ValueError:
                continue
            if isinstance(target, ast.Tuple):
                found |= {one.id: each for one, each in zip(target.elts, value, strict=True)}  # ty: ignore
            elif isinstance(target, ast.Name):
                found[target.id] = value
    return found


def targets(asked: Iterable[Any]) -> str:
    """Return a table of targets: what is measured, the limit, and whether it is met; NaN was not computed."""
    header = ("target", "measured", "limit", "met", "spread")
    rows = []
    for one in asked:
        computed = not np.isnan(one.measured)
        measured = f"{number(one.measured)} {one.unit}".strip() if computed else "not computed"
        rows.append((one.description, measured, one.limit, one.met if computed else None, one.note or None))
    return markdown(header, rows)


def provenance(name: str) -> tuple[str, ...]:
    """Return how a result was computed: command, date, commit, machine, and the recomputed item of its stamp."""
    try:
        made = record(name)
    except MissingResult:
        return f"`./dev evidence {name}`", "none", *"----"
    origin = made.get("computed", made)
    replay = made.get("replayed")
    stamp = f"{replay['item']!r}, {replay['date']}: {'equal' if replay['equal'] else 'different'}" if replay else "-"
    commit = (origin["commit"] or "none")[:10]
    return f"`{made['command']}`", str(len(made["items"])), origin["date"], f"`{commit}`", made["machine"], stamp


def made(*names: str) -> str:
    """Return the provenance of results as a table."""
    header = ("result", "command", "items", "date", "commit", "machine", "item replayed")
    return markdown(header, ((f"`{name}`", *provenance(name)) for name in names))


def render(name: str) -> str:
    """Return the table of a name, or the command that computes its results if one is not stored.

    Raises:
        KeyError: If there is no such table.
    """
    results, _, kind = name.partition(".")
    if kind == "provenance":
        return made(*results.split("+"))
    if name not in TABLES:
        raise KeyError(f"no table {name}; there are {', '.join(sorted(TABLES))}")
    try:
        return TABLES[name]()
    except MissingResult as missing:
        command = "bench" if results == "benchmarks" else "evidence"
        return f"There is no result for the present code. `./dev {command} {missing}` computes it."


def fill(page: str, keep: bool = False) -> str:
    """Return a page with its tables.

    Args:
        page: The page's text.
        keep: Whether markers stay around the tables, so that the page can be filled again.
    """

    def put(found: re.Match[str]) -> str:
        made = render(found[1])
        return f"<!-- table: {found[1]} -->\n\n{made}\n\n<!-- end -->" if keep else made

    return MARKER.sub(put, page)


def setup(app: Any) -> dict[str, bool]:
    """Register with Sphinx: markers are replaced when a page is read."""

    def read(app: Any, name: str, source: list[str]) -> None:
        del app, name
        source[0] = fill(source[0])

    app.connect("source-read", read)
    return {"parallel_read_safe": True}


def main(arguments: Sequence[str]) -> int:
    """Rewrite the tables of pages, or with `--check` state which are out of date."""
    check, stale = "--check" in arguments, 0
    for name in arguments:
        if name == "--check":
            continue
        path = Path(name)
        before = path.read_text()
        after = fill(before, keep=True)
        stale += before != after
        if before != after:
            print(f"{name}: {'is out of date' if check else 'rewritten'}")
        if not check:
            path.write_text(after)
    return 1 if check and stale else 0


from results_tables import certificate, learning, performance, plant, robustness, summary, teams  # noqa: E402, F401
