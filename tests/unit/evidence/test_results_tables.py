"""Tables of the results pages."""

from __future__ import annotations

import re
import sys
from pathlib import Path

import numpy as np
import pytest

from evidence import ROOT, __main__, status

sys.path.insert(0, str(ROOT / "docs"))
import results_tables

PAGES = sorted((ROOT / "docs" / "results").glob("*.md"))
MARKED = [path for path in status.pages(ROOT) if results_tables.MARKER.search(path.read_text())]


@pytest.mark.parametrize("path", PAGES, ids=[path.stem for path in PAGES])
def test_page_has_all_its_tables(path: Path):
    """Each marker becomes a table with rows, and the page states how the results were computed."""
    text = results_tables.fill(path.read_text())
    assert "<!-- table" not in text
    for table in re.findall(r"(?:^\|.*\n?)+", text, re.MULTILINE):
        lines = table.strip().splitlines()
        assert len(lines) > 2
        assert len({line.replace(r"\|", "").count("|") for line in lines}) == 1
    assert ".provenance -->" in path.read_text()


def test_each_table_and_each_result_is_on_a_page():
    """No table is unused, no stored result is missing."""
    used = {name for path in status.pages(ROOT) for name in results_tables.MARKER.findall(path.read_text())}
    assert {name for name in results_tables.TABLES if not name.endswith(".readme")} <= used
    quoted = {name for path in PAGES for name in status.quoted(path.read_text())}
    # decision 0061 describes the proof of the renaming, docs/versions.md that of the environments, and decisions 0018,
    # 0019, 0023 and 0029 those of damaged, interrupted and invalid files, decision 0063 the replay of correctors, and
    # docs/sensors.md the comparison of contact forces
    described = {
        "contact_force_rivals",
        "environments",
        "renaming",
        "damage",
        "file_faults",
        "fuzz",
        "handover",
        "replay",
        "sanitizers",
    }
    assert quoted | described == set(__main__.module_names())


@pytest.mark.parametrize("path", [path for path in MARKED if path not in PAGES], ids=lambda path: path.name)
def test_committed_tables_are_up_to_date(path: Path):
    """`python docs/results_tables PAGE` would change nothing."""
    assert results_tables.main(["--check", str(path)]) == 0


def test_bounds_table_has_baseline_and_nominal_error():
    """The table of bounds contains the bound of split-conformal prediction and the nominal error."""
    text = results_tables.fill((ROOT / "docs" / "results" / "certificate.md").read_text())
    ratio = {row.split(" | ")[0][2:]: float(row.split(" | ")[2]) for row in text.splitlines() if " of 16 |" in row}
    assert ratio["split-conformal prediction"] < ratio["optimal recovery (this project)"]
    assert "nominal error over observed error" in text


@pytest.mark.parametrize(
    ("x", "text"),
    [
        (0, "0"),
        (46.0, "46"),
        (0.12345, "0.123"),
        (1.2345, "1.23"),
        (123.45, "123"),
        (1.26e-14, "1.26e-14"),
        (2e-10, "2e-10"),
        (3.2e5 + 0.5, "3.2e5"),
        (np.inf, "none"),
    ],
)
def test_numbers_have_three_significant_digits(x, text):
    """Whole numbers keep all digits."""
    assert results_tables.number(x) == text


def test_table_is_replaced_between_its_markers(monkeypatch):
    """Filling a page twice gives one table."""
    monkeypatch.setitem(results_tables.TABLES, "a.b", lambda: "| x |")
    once = results_tables.fill("Before.\n\n<!-- table: a.b -->\n\nAfter.", keep=True)
    assert once == "Before.\n\n<!-- table: a.b -->\n\n| x |\n\n<!-- end -->\n\nAfter."
    assert results_tables.fill(once, keep=True) == once
    assert results_tables.fill(once) == "Before.\n\n| x |\n\nAfter."
    with pytest.raises(KeyError, match=r"no table a\.c"):
        results_tables.fill("<!-- table: a.c -->")
