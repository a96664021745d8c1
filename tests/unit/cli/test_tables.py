"""Tests of tables on terminals of any width and encoding."""

from __future__ import annotations

import re

import pytest
from rich.console import Console
from rich.table import Table

from colift.cli.tables import STUDY_METRICS, format_cell, print_table


def printed_table(
    columns: int, encoding: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> str:
    """Return a table of long numbers as printed on a terminal of the given width."""
    monkeypatch.setenv("COLUMNS", str(columns))
    monkeypatch.setattr(Console, "encoding", encoding)
    table = Table(title="numbers")
    table.add_column("case\n")
    for metric in STUDY_METRICS:
        table.add_column(f"{metric.heading}\n{metric.unit}", justify="right")
    for i in range(3):
        table.add_row(f"C{i}", *NUMBERS[i])
    print_table(table)
    return capsys.readouterr().out


NUMBERS = [[f"{(i + 2) * 7919**k % 99991 / 10:.1f}" for k in range(1, len(STUDY_METRICS) + 1)] for i in range(3)]


@pytest.mark.parametrize("encoding", ["utf-8", "cp1252", "ascii"])
@pytest.mark.parametrize("columns", [1, 20, 40, 60, 80, 200])
def test_narrow_terminals_crop_no_digit(
    columns: int, encoding: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    text = printed_table(columns, encoding, capsys, monkeypatch)
    text.encode(encoding)
    assert "…" not in text
    for i, row in enumerate(NUMBERS):
        found = [line for line in text.splitlines() if re.search(rf"\bC{i}\b", line)]
        assert re.findall(r"\d+\.\d", " ".join(found)) == row
    if columns >= 20:
        assert max(map(len, text.splitlines())) <= columns


def test_missing_numbers_are_printed_as_none():
    assert [format_cell(x, 1e3, ".1f") for x in (0.0123, 1e9, None, float("nan"))] == ["12.3", "1e+12", "none", "none"]
