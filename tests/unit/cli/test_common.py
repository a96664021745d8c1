"""Output of the command line on terminals of some width."""

import pytest

from colift.cli import common

LINES = ["thrust    smallest margin in hover 49.6% of 40 N (agent_1), on the reference 48.4%", "passed"]


@pytest.mark.parametrize("columns", ["40", "72"])
def test_long_lines_are_broken_with_an_indent(columns, monkeypatch, capsys):
    monkeypatch.setenv("COLUMNS", columns)
    common.print_wrapped(LINES, 10)
    printed = capsys.readouterr().out.splitlines()
    assert len(printed) > 2
    assert all(len(line) <= int(columns) for line in printed)
    assert all(line.startswith(" " * 10) for line in printed[1:-1])
    assert " ".join(line.strip() for line in printed[:-1]) == LINES[0]
    assert printed[-1] == "passed"


def test_without_a_terminal_lines_are_whole(monkeypatch, capfd):
    monkeypatch.delenv("COLUMNS", raising=False)
    common.print_wrapped(LINES, 10)
    assert capfd.readouterr().out.splitlines() == LINES
