"""Tables on terminals of any width and alphabet."""

from __future__ import annotations

import re

import pytest
from rich.console import Console
from rich.table import Table

from colift.cli.tables import STUDY_METRICS, format_cell, print_table


def shown(columns: int, encoding: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> str:
    """A table of long numbers, as it is printed on a terminal so wide."""
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
def test_a_terminal_of_any_width_crops_no_digit(
    columns: int, encoding: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
):
    said = shown(columns, encoding, capsys, monkeypatch)
    said.encode(encoding)
    assert "…" not in said
    for i, row in enumerate(NUMBERS):
        found = [line for line in said.splitlines() if re.search(rf"\bC{i}\b", line)]
        assert re.findall(r"\d+\.\d", " ".join(found)) == row
    if columns >= 20:
        assert max(map(len, said.splitlines())) <= columns


def test_what_is_no_number_is_said():
    assert [format_cell(x, 1e3, ".1f") for x in (0.0123, 1e9, None, float("nan"))] == ["12.3", "1e+12", "none", "none"]
