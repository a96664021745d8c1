"""Tests of the comparison of runs: ratios, settings that differ, folders that are no runs."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from colift import scenario
from colift.analysis import comparison
from colift.closed_loop import log
from tests.support import playback_logs as played
from tests.support.summaries import metrics, written

CASES = ("C1", "C2", "C3")


def make(folder: Path, errors: dict[str, float], *overrides: str) -> Path:
    """Write a run with random logs."""
    folder.mkdir()
    settings = scenario.load_scenario("paper", overrides) if overrides else played.PAPER
    for case in errors:
        log.save(played.random_log(settings=settings).assign_attrs(case=case), folder / f"{case}.nc")
    written(folder, {case: metrics(e_p_rms_m=e) for case, e in errors.items()}, seed=settings.seed)
    return folder


@pytest.fixture
def runs(tmp_path):
    a = make(tmp_path / "a", {"C1": 0.4, "C3": 0.01})
    b = make(tmp_path / "b", {"C1": 0.2, "C2": 0.1}, "seed=5", "payload.mass_kg=1.7")
    return comparison.load_runs([a, b], CASES)


def test_ratios_refer_to_the_same_case_of_the_first_run(runs):
    found = [(each.case, each.run, each.ratio("e_p_rms_m")) for each in comparison.compare_cases(runs)]
    assert found == [("C1", "a", "1.00"), ("C1", "b", "0.50"), ("C3", "a", "1.00"), ("C2", "b", "none")]
    assert comparison.describe_reference(runs) == "Ratios refer to the same case of a."


def test_ratios_without_a_common_case_refer_to_the_first_case(tmp_path):
    runs = comparison.load_runs([make(tmp_path / "x", {"C1": 0.4}), make(tmp_path / "y", {"C3": 0.1})], CASES)
    first, second = comparison.compare_cases(runs)
    assert (first.ratio("e_p_rms_m"), second.ratio("e_p_rms_m")) == ("1.00", "0.25")
    assert comparison.describe_reference(runs) == "Ratios refer to C1 of x, since no case is in both."
    assert comparison.conclude_comparison([first, second], {"y": []}) == [
        "The RMS position error is 400 mm in x C1 and 100 mm in y C3 (ratio 0.25).",
        "All settings are equal.",
    ]


def test_differing_settings_are_listed_by_path(runs, monkeypatch):
    differing = comparison.differing_settings(runs)
    assert comparison.describe_differences(differing, "a") == [
        "b has the settings of a, except seed = 5 instead of 0; payload.mass_kg = 1.7 instead of 1.5"
    ]
    monkeypatch.setattr(comparison, "MAX_DIFFERENCES", 1)
    assert comparison.describe_differences(differing, "a") == [
        "b has the settings of a, except seed = 5 instead of 0; 1 more"
    ]
    assert comparison.conclude_comparison(comparison.compare_cases(runs), differing) == [
        "The RMS position error of C1 is 400 mm in a and 200 mm in b (ratio 0.50).",
        "The settings of b differ.",
    ]


def test_settings_of_plugins_are_compared_as_text(runs):
    """No module is imported: the plugin that the logs name does not exist."""
    for run, gain in zip(runs, (1, 2), strict=True):
        for ds in run.flights.values():
            plugin = f'{{"class_path":"missing:Gust","init_args":{{"gain":{gain}}}}}'
            text = ds.attrs["scenario_json"].replace('"disturbances":[', f'"disturbances":[{plugin},')
            ds.attrs["scenario_json"] = text
    (found,) = comparison.differing_settings(runs).values()
    assert ("disturbances.0.init_args.gain", "1", "2") in found


def test_a_pipe_as_summary_is_named(tmp_path):
    os.mkfifo(make(tmp_path / "a", {}) / "pipe")
    (tmp_path / "a" / "pipe").replace(tmp_path / "a" / "summary.json")
    with pytest.raises(ValueError, match=r"summary\.json: a pipe, socket or device, not a regular file"):
        comparison.load_runs([tmp_path / "a", tmp_path / "b"], CASES)


def test_folders_that_are_no_runs_have_one_line_each(tmp_path):
    names = ("good", "empty", "damaged", "shortened", "foreign")
    good, empty, damaged, shortened, foreign = (tmp_path / name for name in names)
    make(good, {"C1": 0.1})
    empty.mkdir()
    make(damaged, {"C1": 0.1})
    written(damaged, {"C1": metrics(e_p_rms_m="x")})
    make(shortened, {"C1": 0.1})
    written(shortened, {"C1": {key: value for key, value in metrics().items() if key != "complete"}})
    make(foreign, {"C1": 0.1})
    written(foreign, {"C1": metrics()}, run="colift-run-ba9876543210")
    folders = [good, empty, damaged, shortened, foreign, tmp_path / "missing", good]
    with pytest.raises(ValueError, match="given twice") as caught:
        comparison.load_runs(folders, CASES, ("C3",))
    lines = str(caught.value).splitlines()
    expected = (
        "given twice",
        "contains no summary.json",
        "is damaged",
        "no entry 'complete'",
        "contains flights of",
        "is not a folder",
    )
    assert len(lines) == 7
    for line, part in zip(lines, (*expected, "no folder contains case C3"), strict=True):
        assert part in line
    with pytest.raises(ValueError, match="two folders"):
        comparison.load_runs([good], CASES)
