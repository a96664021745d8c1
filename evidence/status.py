"""`./dev evidence status`: results that are older than their code, and pages that quote them.

A page quotes a result where it contains one of two markers, which HTML comments hide from readers:

- ``<!-- evidence: NAME [NAME ...] -->``: the page states figures of these results in its own text or tables;
- ``<!-- table: NAME[+NAME ...].TABLE -->``: a table that `docs/results_tables` generates from these results. Tables of
  benchmarks, NAME `benchmarks`, are not checked here but by `./dev bench --status`.

The exit status is 1 where a page quotes a result that is older than its code, and 2 for an unknown name. A missing
result is an error for the first marker only: a generated table states that there is no result.
"""

from __future__ import annotations

import re
import sys
from collections.abc import Iterator
from pathlib import Path

import evidence

MAX_NAMED_FILES = 5  # changed files that are named
MARKER = re.compile(r"<!--\s*(evidence|table):\s*(.*?)\s*-->")
BUILT = {"_build", "_generated"}  # folders of pages that are made


def pages(root: Path) -> Iterator[Path]:
    """Yield the README and all pages of the documentation."""
    yield from filter(Path.is_file, [root / "README.md"])
    yield from sorted(path for path in (root / "docs").rglob("*.md") if not BUILT & set(path.parts))


def quoted(text: str, only: str | None = None) -> set[str]:
    """Return the names of the results that a page quotes by its markers, or by one kind of marker."""
    found: set[str] = set()
    for kind, names in MARKER.findall(text):
        if only not in (None, kind):
            continue
        found |= set(re.split(r"[\s,]+", names) if kind == "evidence" else names.partition(".")[0].split("+"))
    return found - {"benchmarks"}


def has_result(name: str) -> bool:
    """Return whether a result is stored, current or not."""
    return (evidence.RESULTS / f"{name}.json").exists()


def state(name: str) -> tuple[bool, str]:
    """Return whether a result is up to date, and a line that states why or why not."""
    if not has_result(name):
        return False, "no result yet"
    record, changed = evidence.stored(name), evidence.changed_files(name)
    at = f"{record['date']} at {(record.get('commit') or 'no commit')[:10]}"
    if replay := record.get("replayed"):
        at += f", {replay_text(replay)}"
    if not changed:
        return True, f"{at}: nothing changed since"
    changed.sort(key=lambda path: not path.startswith("evidence/"))
    more = f" and {len(changed) - MAX_NAMED_FILES} more" * (len(changed) > MAX_NAMED_FILES)
    return False, f"{at}: since then changed: {', '.join(changed[:MAX_NAMED_FILES])}{more}"


def replay_text(replay: dict) -> str:
    """Return a description of the recomputed item."""
    apart = f" to {replay['relative_difference']:.1e}" if replay.get("relative_difference") else ""
    shown = f"equal{apart}" if replay["equal"] else "different"
    return f"item {replay['item']!r} replayed {replay['date']}: {shown}"


def main(arguments: list[str], names: list[str]) -> int:
    """Print the state of each result, then each page that quotes an outdated one.

    Args:
        arguments: Names of results; all where empty.
        names: The names of all results.

    Returns:
        The exit status.
    """
    if unknown := [name for name in arguments if name not in names]:
        print(f"no result {', '.join(unknown)}; there are {', '.join(names)}", file=sys.stderr)
        return 2
    states = {name: state(name) for name in arguments or names}
    width = max(12, *map(len, states))
    for name, (_, line) in states.items():
        print(f"{name:<{width}} {line}")
    bad = 0
    for page in pages(evidence.ROOT):
        where = page.relative_to(evidence.ROOT).as_posix()
        text = page.read_text()
        own_figures = quoted(text, only="evidence")
        for name in sorted(quoted(text)):
            if name not in names:
                print(f"{where}: quotes {name}, which is not a result")
                bad += 1
            elif name in states and not states[name][0] and (has_result(name) or name in own_figures):
                print(f"{where}: quotes {name}, which is older than its code or missing")
                bad += 1
    return 1 if bad else 0
