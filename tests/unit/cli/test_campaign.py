"""Commands of `colift campaign`."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
import pytest
from typer.testing import CliRunner, Result

from colift.campaigns import engines
from colift.campaigns.flights import Batch, Row
from colift.cli import common
from colift.cli.app import app
from colift.runtime import run_directory, signals
from tests.support import campaigns


def invoke(*arguments: str | Path) -> Result:
    return CliRunner().invoke(app, ["campaign", *map(str, arguments)], catch_exceptions=False)


@pytest.fixture
def path(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Specification of a campaign whose rows are computed without a flight."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(engines, "LocalEngine", lambda _jobs, modules: campaigns.InlineEngine(campaigns.quick_rows))
    return campaigns.write(tmp_path, cases=["C1", "C3"], samples=5)


def test_campaign_from_run_to_export(path: Path):
    assert invoke("status", path).exit_code == 1
    assert invoke("table", path).exit_code == 2
    ran = invoke("run", path, "--jobs", "1", "--quiet")
    assert ran.exit_code == 0, ran.stderr
    assert "10 of 10 flights" in invoke("run", path).stdout
    found = invoke("status", path, "--json")
    assert found.exit_code == 0
    assert json.loads(found.stdout)["stored"] == 10
    shown = invoke("table", path, "--csv", "rows.csv")
    assert "payload.mass_kg" in shown.stdout
    assert len(pd.read_csv("rows.csv")) == 10
    assert "flights; --lines" not in shown.stdout
    assert "3 of 10 flights; --lines prints more" in invoke("table", path, "-n", "3").stdout
    compared = invoke("compare", path)
    assert compared.exit_code == 0, compared.stderr
    assert "C3 < C1" in compared.stdout
    assert Path("out/campaign-campaign/comparison.pdf").exists()
    assert invoke("export", path, "all.csv").exit_code == 0
    assert Path("all.csv").read_bytes() == Path("rows.csv").read_bytes()


def test_errors_are_one_line_with_status_2(path: Path, tmp_path: Path):
    unknown = tmp_path / "unknown.yaml"
    unknown.write_text("scenario: papr\n")
    occupied = tmp_path / "file"
    occupied.write_text("")
    for arguments, message in (
        (("run", unknown), "unknown.yaml:1: scenario: there is no scenario 'papr'"),
        (("run", path, "--jobs", "2", "--slurm", "long"), "exclude each other"),
        (("run", path, "--engine", "ray://host"), "must be dask://ADDRESS"),
        (("run", path, "--out", occupied), "it is a file, not a folder"),
        (("export", path, "rows.txt"), "must end with .csv or .parquet"),
    ):
        found = invoke(*arguments, *(() if arguments[0] == "export" else ("--quiet",)))
        assert found.exit_code == 2
        assert message in found.stderr
        assert found.stderr.count("\n") == 1


def test_flights_that_ended_early_are_counted(path: Path, monkeypatch: pytest.MonkeyPatch):
    def rows(batch: Batch) -> list[Row]:
        reasons = ("", "refused: mass", "lost: signal 9", "signal u is not finite")
        found = zip(campaigns.quick_rows(batch), reasons * len(batch.flights), strict=False)
        return [row | {"complete": not reason, "termination_reason": reason} for row, reason in found]

    monkeypatch.setattr(engines, "LocalEngine", lambda _jobs, modules: campaigns.InlineEngine(rows))
    campaigns.write(path.parent, samples=4)
    assert "4 of 4 flights stored (4 new, 3 ended early)" in invoke("run", path).stdout
    assert "3 ended early: 1 with refused settings, 1 with the end of their worker" in invoke("status", path).stdout


def test_interrupted_run_states_how_it_continues(path: Path, monkeypatch: pytest.MonkeyPatch):
    def interrupted(_batch: Batch) -> list[Row]:
        raise signals.Interrupted

    notes: list[str] = []
    monkeypatch.setattr(common, "report_interruption", notes.append)
    monkeypatch.setattr(engines, "LocalEngine", lambda _jobs, modules: campaigns.InlineEngine(interrupted))
    with pytest.raises(signals.Interrupted):
        invoke("run", path)
    assert notes == ["the same command continues; the rows are in out/campaign-campaign/parts"]


def test_second_run_on_a_folder_is_refused(path: Path, tmp_path: Path):
    with run_directory.lock_directory(tmp_path / "out"):
        found = invoke("run", path, "--out", tmp_path / "out", "--quiet")
    assert found.exit_code == 2
    assert "is in use" in found.stderr
