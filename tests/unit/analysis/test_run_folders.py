"""Tests of the search for runs: complete, damaged and foreign folders."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path

import pytest

from colift.analysis import run_folders
from tests.support.summaries import SUMMARY, metrics, written

CASES = ("C1", "C3")


def make(folder: Path, cases: dict, **changed: object) -> Path:
    folder.mkdir(parents=True)
    written(folder, cases, **changed)
    return folder


def test_runs_are_found_at_any_depth(tmp_path):
    make(tmp_path / "b" / "deep", {"C1": metrics(e_p_rms_m=0.2, e_R_rms=None)}, seed=7)
    make(tmp_path / "a", {"C3": metrics(complete=False)})
    make(tmp_path / ".a.12.new", {"C3": metrics()})  # hidden folder of a study that runs
    (tmp_path / "notes").mkdir()
    (tmp_path / "loop").symlink_to(tmp_path)
    first, second = run_folders.find_runs(tmp_path, CASES)
    assert (first.path, second.path) == (tmp_path / "a", tmp_path / "b" / "deep")
    assert (second.scenario, second.seed, second.damage) == ("sample", 7, "")
    (case,) = second.cases
    assert (case.case, case.complete, case.position_error) == ("C1", True, 0.2)
    assert math.isnan(case.attitude_error)
    assert not first.cases[0].complete
    assert second.modified == pytest.approx((second.path / "summary.json").stat().st_mtime)


def test_certificate_without_study_is_a_run(tmp_path):
    content = {"schema": 2, "scenario": "certified", "seed": 3, "run": "colift-run-0123456789ab", "observed": {}}
    (tmp_path / "certificate.json").write_text(json.dumps(content))
    (found,) = run_folders.find_runs(tmp_path, CASES)
    assert (found.scenario, found.seed, found.cases, found.damage) == ("certified", 3, (), "")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("{", "summary.json:1: not JSON"),
        ("[]", "must contain a JSON object"),
        ("[" * 100_000, "nested too deeply"),
        (json.dumps({"cases": {}, "schema": 9}), "schema 9"),
        (json.dumps(SUMMARY | {"cases": {"C1": {}}}), "no entry 'complete'"),
        (json.dumps(SUMMARY | {"cases": []}), "damaged"),
        (json.dumps(SUMMARY | {"cases": {"C1": metrics(e_p_rms_m="<b>")}}), "e_p_rms_m is '<b>', not a number"),
        (json.dumps(SUMMARY | {"cases": {"C1": metrics(e_p_rms_m=10**400)}}), "damaged"),
        (json.dumps(SUMMARY | {"cases": {}, "seed": "1"}), "seed is '1', not a whole number"),
    ],
)
def test_damaged_summary_has_a_reason_in_one_line(tmp_path, text, reason):
    (tmp_path / "summary.json").write_text(text)
    (found,) = run_folders.find_runs(tmp_path, CASES)
    assert reason in found.damage
    assert "\n" not in found.damage
    assert str(tmp_path) not in found.damage


def test_unfinished_study_and_pipes_have_a_reason(tmp_path):
    for name in ("logs", "pipe", "link"):
        (tmp_path / name).mkdir()
    (tmp_path / "logs" / "C1.nc").write_bytes(b"")
    os.mkfifo(tmp_path / "pipe" / "summary.json")
    (tmp_path / "link" / "summary.json").symlink_to("nowhere")
    reasons = {run.path.name: run.damage for run in run_folders.find_runs(tmp_path, CASES)}
    assert reasons == {
        "link": "No such file or directory",
        "logs": "contains logs, but no summary.json: its study did not end",
        "pipe": "a pipe, socket or device, not a regular file",
    }


def test_search_is_bounded(tmp_path, monkeypatch):
    monkeypatch.setattr(run_folders, "MAX_FOLDERS", 2)
    (tmp_path / "a" / "b").mkdir(parents=True)
    with pytest.raises(OSError, match="more than 2 folders"):
        run_folders.find_runs(tmp_path, CASES)
    with pytest.raises(FileNotFoundError):
        run_folders.find_runs(tmp_path / "missing", CASES)


def test_a_pipe_as_log_is_a_study_without_summary(tmp_path):
    os.mkfifo(tmp_path / "C1.nc")
    (found,) = run_folders.find_runs(tmp_path, CASES)
    assert found.damage == "contains logs, but no summary.json: its study did not end"
