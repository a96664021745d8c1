"""Comparison of runs in several folders: standard metrics by case with ratios, and settings that differ."""

from __future__ import annotations

import dataclasses
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import xarray as xr

from colift.analysis import conclusions, poses, result_files
from colift.analysis.study_metrics import STUDY_METRICS
from colift.closed_loop import log
from colift.runtime import run_directory
from colift.scenario import Scenario, differences
from colift.scenario.migration import migrate_data

MAX_DIFFERENCES = 10
"""Largest number of settings that a comparison lists for one folder."""
MAX_VALUE = 60
"""Largest number of characters of a listed value."""


@dataclasses.dataclass(frozen=True)
class ComparedRun:
    """Run of a comparison.

    Attributes:
        name: Path of the folder, relative to the common parent of all folders.
        path: Folder.
        summary: Content of `summary.json`.
        flights: Log of each compared case.
        settings: Scenario, without plugins.
    """

    name: str
    path: Path
    summary: Mapping[str, Any]
    flights: Mapping[str, xr.Dataset]
    settings: Scenario


@dataclasses.dataclass(frozen=True)
class ComparedCase:
    """Metrics of one case of one run.

    Attributes:
        run: Name of the run.
        case: Case id.
        complete: True if the flight did not end early.
        values: Values of `STUDY_METRICS` by key; None if there is none.
        reference: Values of the case to which ratios refer; empty if the first run has no such case.
    """

    run: str
    case: str
    complete: bool
    values: Mapping[str, float | None]
    reference: Mapping[str, float | None]

    def ratio(self, key: str) -> str:
        """Return the ratio of a metric to that of the reference as text."""
        return conclusions.format_ratio(self.values[key], self.reference.get(key))


def load_runs(folders: Sequence[Path], cases: Sequence[str], required: Sequence[str] = ()) -> list[ComparedRun]:
    """Load the runs of several folders.

    Args:
        folders: Folders of studies.
        cases: Cases to compare, if present.
        required: Cases that at least one folder must contain.

    Returns:
        The runs in the order of the folders.

    Raises:
        ValueError: If there are fewer than two folders, if folders are equal, or if one cannot be used; the message has
            one line for each of them.
    """
    resolved = [folder.resolve() for folder in folders]
    faults = [f"{folder} is given twice" for k, folder in enumerate(folders) if resolved[k] in resolved[:k]]
    if len(folders) < 2:
        faults.append("a comparison requires two folders or more; colift report shows a single study")
    runs = []
    for folder, name in zip(folders, _names(resolved), strict=True):
        try:
            runs.append(_load_run(folder, name, cases))
        except (OSError, ValueError) as error:
            faults.append(_one_line(folder, error))
    found = {case for run in runs for case in run.flights}
    faults += [f"no folder contains case {case}" for case in required if runs and case not in found]
    if faults:
        raise ValueError("\n".join(dict.fromkeys(faults)))
    return runs


def compare_cases(runs: Sequence[ComparedRun]) -> list[ComparedCase]:
    """Return the metrics of all cases of all runs, with the reference of their ratios.

    The reference is the same case of the first run. If no further run shares a case with the first run, it is the first
    case of the first run.

    Args:
        runs: Runs; the first is the reference.

    Returns:
        Cases in the order of the first run, then further ones; runs in their order within a case.
    """
    values = {(run.name, case): _metrics(run, case) for run in runs for case in run.flights}
    own = {case: values[runs[0].name, case] for case in runs[0].flights}
    alone = next(iter(own.values())) if shared_case(runs) is None else {}
    return [
        ComparedCase(
            run=run.name,
            case=case,
            complete=bool(run.summary["cases"][case]["complete"]),
            values=values[run.name, case],
            reference=alone or own.get(case, {}),
        )
        for case in dict.fromkeys(case for run in runs for case in run.flights)
        for run in runs
        if case in run.flights
    ]


def shared_case(runs: Sequence[ComparedRun]) -> str | None:
    """Return the first case that the first run shares with another one; None if there is none."""
    return next((case for case in runs[0].flights if any(case in run.flights for run in runs[1:])), None)


def describe_reference(runs: Sequence[ComparedRun]) -> str:
    """State to which values the ratios of a comparison refer."""
    if shared_case(runs) is None:
        return f"Ratios refer to {next(iter(runs[0].flights))} of {runs[0].name}, since no case is in both."
    return f"Ratios refer to the same case of {runs[0].name}."


def differing_settings(runs: Sequence[ComparedRun]) -> dict[str, list[differences.SettingDifference]]:
    """Compare the scenario of each further run with that of the first.

    The settings of plugins are compared as text, since reading a log imports no module.

    Args:
        runs: Runs; the first is the reference.

    Returns:
        Settings that differ by the name of each further run.
    """
    logs = [next(iter(run.flights.values())) for run in runs]
    if any(poses.plugin_classes(ds) for ds in logs):
        data = [migrate_data(json.loads(ds.attrs["scenario_json"]), strict=False) for ds in logs]
    else:
        data = [run.settings.model_dump(mode="json") for run in runs]
    return {
        run.name: differences.setting_differences(data[0], other) for run, other in zip(runs[1:], data[1:], strict=True)
    }


def describe_differences(differing: Mapping[str, Sequence[differences.SettingDifference]], first: str) -> list[str]:
    """Describe the settings that differ, at most `MAX_DIFFERENCES` for each run.

    Args:
        differing: Settings that differ by run.
        first: Name of the first run.

    Returns:
        One line for each run.
    """
    lines = []
    for name, found in differing.items():
        listed = [f"{x.path} = {_short(x.second)} instead of {_short(x.first)}" for x in found[:MAX_DIFFERENCES]]
        if more := len(found) - len(listed):
            listed.append(f"{more} more")
        lines.append(f"{name} has the settings of {first}" + (f", except {'; '.join(listed)}" if listed else ""))
    return lines


def conclude_comparison(cases: Sequence[ComparedCase], differing: Mapping[str, Sequence[object]]) -> list[str]:
    """State the position errors of the case with the most runs, and whether the scenarios differ.

    Args:
        cases: Compared cases.
        differing: Settings that differ by run.

    Returns:
        Two sentences.
    """
    names = [each.case for each in cases]
    chosen = max(dict.fromkeys(names), key=lambda case: (names.count(case), case == "C3"))
    selected = [each for each in cases if each.case == chosen] if names.count(chosen) > 1 else list(cases)
    stated = []
    for k, each in enumerate(selected):
        error = each.values["e_p_rms_m"]
        text = "none" if error is None else f"{1e3 * error:.3g} mm"
        ratio = f" (ratio {each.ratio('e_p_rms_m')})" if k else ""
        stated.append(f"{text} in {each.run}{'' if names.count(chosen) > 1 else f' {each.case}'}{ratio}")
    what = f"of {chosen} " if names.count(chosen) > 1 else ""
    different = [name for name, found in differing.items() if found]
    settings = (
        f"The settings of {conclusions.join_words(different)} differ." if different else "All settings are equal."
    )
    return [f"The RMS position error {what}is {conclusions.join_words(stated)}.", settings]


def _load_run(folder: Path, name: str, cases: Sequence[str]) -> ComparedRun:
    """Load one run; raises ValueError or OSError if the folder cannot be used."""
    if not folder.is_dir():
        raise ValueError(f"{folder} is not a folder")
    path = folder / run_directory.SUMMARY_FILE
    if not os.path.lexists(path):
        raise ValueError(f"{folder} is not a run: it contains no {path.name}")
    summary = result_files.load_summary(path)
    try:
        names = {file.name for file in folder.iterdir()}
        present = [case for case in cases if case in summary["cases"] and f"{case}.nc" in names]
        if not present:
            raise ValueError(f"{folder} contains no log of {', '.join(cases)}")
        run, flights = log.load_flights(folder, present)
        if run != summary["run"]:
            raise ValueError(f"{folder} contains flights of {run} and a {path.name} of {summary['run']}")
        found = ComparedRun(name, folder, summary, flights, poses.scenario_of_log(flights[present[0]]))
        for case in present:
            _metrics(found, case)
    except (KeyError, TypeError, AttributeError, OverflowError) as error:
        reason = f"no entry {error}" if isinstance(error, KeyError) else str(error)
        raise ValueError(f"{path} is damaged: {reason}") from error
    return found


def _metrics(run: ComparedRun, case: str) -> dict[str, float | None]:
    """Return the standard metrics of a case; a missing entry raises KeyError, a value with a wrong type TypeError."""
    found = run.summary["cases"][case]
    for key in ("complete", *(metric.key for metric in STUDY_METRICS)):
        if key not in found:
            raise KeyError(key)
    values = {metric.key: found[metric.key] for metric in STUDY_METRICS}
    for key, value in values.items():
        if value is not None and not isinstance(value, int | float):
            raise TypeError(f"{key} of {case} is {value!r}, not a number")
    return {key: None if value is None else float(value) for key, value in values.items()}


def _names(folders: Sequence[Path]) -> list[str]:
    """Return short names of folders: their paths below their common parent."""
    if not folders:
        return []
    parent = os.path.commonpath([folder.parent for folder in folders])
    return [folder.relative_to(parent).as_posix() for folder in folders]


def _one_line(folder: Path, error: Exception) -> str:
    """Return an error in one line that contains the folder."""
    message = str(error)
    if isinstance(error, OSError) and error.strerror:
        message = error.strerror if error.filename is None else f"{error.filename}: {error.strerror}"
    line = " ".join(message.split())
    return line if str(folder) in line else f"{folder}: {line}"


def _short(text: str) -> str:
    """Return a value of limited length."""
    return text if len(text) <= MAX_VALUE else f"{text[: MAX_VALUE - 1]}…"
