"""Tests of `colift migrate` and of former names on the command line."""

from __future__ import annotations

from pathlib import Path

import pytest
from typer.testing import CliRunner

from colift import scenario
from colift.cli import app as command_line
from colift.cli import common
from colift.cli.app import app
from colift.scenario.migration import migrate_text

OLD = """\
# a team
name: mine  # its name
like: paper
control: {look_ahead_s: 0.02}
"""


def invoke(*arguments: str) -> tuple[int, str, str]:
    result = CliRunner().invoke(app, list(arguments), catch_exceptions=False)
    return result.exit_code, result.stdout, result.stderr


@pytest.fixture
def old(tmp_path: Path) -> Path:
    file = tmp_path / "old.yaml"
    file.write_text(OLD)
    return file


def test_migrate_rewrites_in_place(old: Path):
    status, printed, _ = invoke("migrate", str(old))
    assert status == 0
    assert printed.splitlines()[0] == f"{old}: rewritten: schema 2, 3 changed lines"
    assert "  -like: paper" in printed
    assert "  +extends: paper" in printed
    assert old.read_text() == migrate_text(OLD)
    assert scenario.load_scenario(old).control.preview_step_s == 0.02
    assert invoke("migrate", str(old)) == (0, f"{old}: is of schema 2\n", "")
    assert [file.name for file in old.parent.iterdir()] == ["old.yaml"]


def test_migrate_to_another_file(old: Path):
    out = old.parent / "new.yaml"
    status, printed, _ = invoke("migrate", str(old), "--out", str(out), "--quiet")
    assert (status, printed) == (0, f"{old}: rewritten in {out}: schema 2, 3 changed lines\n")
    assert old.read_text() == OLD
    assert out.read_text() == migrate_text(OLD)


def test_migrate_check_writes_nothing(old: Path):
    new = old.parent / "new.yaml"
    new.write_text(migrate_text(OLD))
    status, printed, errors = invoke("migrate", "--check", "-q", str(old), str(new))
    assert (status, printed) == (1, f"{old}: needs migration: schema 2, 3 changed lines\n{new}: is of schema 2\n")
    assert errors == "1 of 2 files are not of schema 2: run colift migrate\n"
    assert old.read_text() == OLD
    assert invoke("migrate", "--check", str(new))[0] == 0


@pytest.mark.parametrize(
    ("text", "answer"),
    [
        ("a: [1", " line 1: not valid YAML"),
        ("- 1\n", " a scenario is a mapping of settings"),
        ("schema: 7\n", " schema: must be 1 or 2, got 7"),
        (b"\xff", "1: not UTF-8 text (byte 0)"),
        (None, " No such file or directory"),
        ("a: 2001-99-99\n", " not valid YAML: month must be"),
        ("a: 1\nb: !!set {x}\n", " line 2: tags are not used in a scenario"),
        ("a: 1\n" + "# long\n" * 300_000, " line 1: holds more than 2000000 characters"),
    ],
)
def test_migrate_reports_unreadable_files(text: str | bytes | None, answer: str, old: Path):
    bad = old.parent / "bad.yaml"
    if text is not None:
        bad.write_bytes(text if isinstance(text, bytes) else text.encode())
    status, _, errors = invoke("migrate", str(old), str(bad))
    assert (status, errors.count("\n")) == (2, 1)
    assert f"{bad}:{answer}" in errors
    assert old.read_text() == OLD


def test_an_anchor_with_a_second_value_is_migrated(recwarn: pytest.WarningsRecorder):
    """ruamel.yaml would print four lines for each of them."""
    assert migrate_text("a: &x 1\nb: &x 2\nc: *x\n") == "schema: 2\na: &x 1\nb: &x 2\nc: *x\n"
    assert not recwarn.list


def test_migrate_reports_unusable_options(old: Path):
    other = str(old.parent / "other.yaml")
    for arguments, answer in (
        ([str(old), str(old), "--out", other], "must be used with one FILE"),
        ([str(old), "--out", other, "--check"], "without --check"),
        ([str(old), "--out", str(old.parent / "x.txt")], "x.txt: must end in .yaml"),
        ([str(old.parent / "x.txt")], "x.txt: must end in .yaml"),
    ):
        status, _, errors = invoke("migrate", *arguments)
        assert (status, errors.count("\n")) == (2, 1)
        assert answer in errors


@pytest.mark.parametrize(("old_name", "new_name"), command_line.RENAMED_COMMANDS.items())
def test_renamed_command_is_reported(old_name: str, new_name: str):
    assert invoke(old_name, "x") == (2, "", f"no such command: `{old_name}` is now `{new_name}`\n")


def test_unknown_command_is_reported():
    status, _, errors = invoke("stduy", "paper")
    assert status == 2
    assert "Did you mean 'study'?" in errors


def test_cases_in_any_capitalization():
    assert common.parse_cases(["c3, ADAPTIVE", "C1,c3"]) == ("C3", "adaptive", "C1")


@pytest.mark.parametrize("command", [name for name, *_ in command_line.COMMANDS])
def test_help_of_every_command(command: str):
    status, printed, _ = invoke(command, "--help")
    assert status == 0
    assert "Usage" in printed
