"""Commands that simulate flights and compare them: study and run."""

from __future__ import annotations

import functools
import json
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from colift.cli import common, tables
from colift.cli import progress as progress_module

if TYPE_CHECKING:
    from colift.analysis.feasibility import FeasibilityReport
    from colift.closed_loop.flight import Experiment
    from colift.runtime.run_directory import RunDirectory
    from colift.scenario import Scenario

PREPARATION = (("team", 1.0), ("linearization", 3.0))
"""Steps before the flights with their shares of the time."""
OUTPUT_TIME = 15.0
"""Estimated time for logs and figures after the flights [s]."""


CALIBRATION = ("contact_forces.kind=least_squares", "contact_forces.calibration_s=10")
"""Settings of the option `--calibrate`; settings of `--set` come after them."""


def study(
    name: common.ScenarioArgument,
    out: common.OutOption = None,
    overrides: common.OverridesOption = None,
    duration: common.DurationOption = None,
    seed: common.SeedOption = None,
    baselines: Annotated[
        bool,
        typer.Option(
            "--baselines",
            help="Also simulate the baselines: integral, disturbance_observer, parametric, regression, label_feedback, "
            "gp_label_feedback, and true_residual.",
        ),
    ] = False,
    cases: Annotated[
        list[str] | None,
        typer.Option(
            "--case",
            help="Case to simulate; repeatable, or separated by commas; default: C1, C2 and C3.",
            autocompletion=common.complete_case,
        ),
    ] = None,
    held_out: Annotated[
        bool,
        typer.Option(
            "--held-out",
            help="Also simulate each case with its last learned model, frozen, on trajectories without training data.",
        ),
    ] = False,
    calibrate: Annotated[
        bool,
        typer.Option(
            "--calibrate",
            help="Estimate the contact forces without tip force sensors, after a calibration flight of 10 s without "
            "payload; the same as --set contact_forces.kind=least_squares --set contact_forces.calibration_s=10.",
        ),
    ] = False,
    engine: common.EngineOption = None,
    replace: common.ReplaceOption = False,
    quiet: common.QuietOption = False,
    as_json: common.JsonOption = False,
) -> None:
    """Simulate a scenario in several cases and compare them.

    The cases of the paper are C1 (no learning), C2 (payload learning) and C3 (payload and agent learning). The case
    adaptive adds online model updates and feedback correction.

    Writes one NetCDF log for each case, figures as PDF and PNG, tables of length scales, and summary.json. Cases that
    the folder already contains are kept if all settings are equal. Status 1: a flight ended early.
    """
    from colift.scenario.cases import BASELINES, PAPER_CASES

    requested = list(PAPER_CASES) if cases is None else common.parse_cases(cases)
    selected = dict.fromkeys([*requested, *(BASELINES if baselines else ())])
    if calibrate:
        overrides = [*CALIBRATION, *(overrides or ())]
    read = functools.partial(common.load_settings, name, overrides, duration, seed, engine)
    folder = common.results_folder(out, overrides, duration, seed, engine)
    _simulate(read, tuple(selected), folder, replace, quiet, as_json, held_out=held_out)


def run(
    name: common.ScenarioArgument,
    case: common.CaseOption = "C3",
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for the results; default: out/SCENARIO-CASE, with the options given."),
    ] = None,
    overrides: common.OverridesOption = None,
    duration: common.DurationOption = None,
    seed: common.SeedOption = None,
    engine: common.EngineOption = None,
    replace: common.ReplaceOption = False,
    quiet: common.QuietOption = False,
    as_json: common.JsonOption = False,
) -> None:
    """Simulate a scenario in one case and write the same files as ``colift study``."""
    case = common.parse_case(case)
    read = functools.partial(common.load_settings, name, overrides, duration, seed, engine)
    folder = common.results_folder(out, overrides, duration, seed, engine, f"-{case}")
    _simulate(read, (case,), folder, replace, quiet, as_json)


def _simulate(
    read: Callable[[], Scenario],
    cases: tuple[str, ...],
    out: Callable[[Scenario], Path],
    replace: bool,
    quiet: bool,
    as_json: bool,
    held_out: bool = False,
) -> None:
    """Simulate cases of a scenario, write the results and print them.

    Args:
        read: Function that returns the settings.
        cases: Identifiers of the cases.
        out: Function of the settings that returns the folder for the results.
        replace: Remove earlier results from the folder.
        quiet: Print only warnings and results.
        as_json: Print the summary as JSON instead of tables.
        held_out: Simulate held-out trajectories as well.
    """
    from colift.analysis import feasibility
    from colift.scenario import experiment
    from colift.workflows import generalization

    with common.open_results(read, out, replace) as (settings, folder):
        with common.show_progress(f"preparing {settings.name}", quiet, PREPARATION) as progress:
            progress("team")
            experiments = experiment.make_experiments(settings, cases)
            held_out_experiments = generalization.held_out_experiments(settings, cases) if held_out else {}
            progress("linearization at equilibrium")
            feasibility_report = feasibility.assess_feasibility(settings, experiments)
        with common.guard_output():
            print_feasibility(feasibility_report, quiet or as_json)
        summary = _run_with_progress(settings, folder, experiments, feasibility_report, held_out_experiments, quiet)
    with common.guard_output(f"; the results are in {folder.target}"):
        if as_json:
            print(json.dumps(summary, indent=2))
        else:
            print_study(summary, folder.target)
    if any(not summary["cases"][case]["complete"] for case in cases):
        common.exit_with(common.EXIT_INCOMPLETE)


def _run_with_progress(
    settings: Scenario,
    folder: RunDirectory,
    experiments: Mapping[str, Experiment],
    feasibility_report: FeasibilityReport,
    held_out: Mapping[str, Mapping[str, Experiment]],
    quiet: bool,
) -> dict[str, Any]:
    """Run a study and show its progress."""
    from colift.workflows import generalization
    from colift.workflows.study import run_study

    flights = dict.fromkeys(experiments, "")
    if held_out:
        flights |= generalization.titles(flights)
    with common.show_progress(f"simulating {settings.name}", quiet, tail=OUTPUT_TIME) as progress:
        return run_study(
            settings,
            folder,
            experiments,
            feasibility_report,
            flight_progress(flights, settings.duration_s, progress),
            held_out,
        )


def flight_progress(
    flights: Collection[str], duration: float, report: progress_module.Report
) -> Callable[[str, float], None]:
    """Return a function that reports the progress of several flights of equal duration.

    Args:
        flights: Names of the flights.
        duration: Duration of a flight [s].
        report: Function that takes the step and the completed share of all flights.

    Returns:
        Function of the flight and the simulated time [s].
    """
    simulated: dict[str, float] = {}

    def progress(case: str, t: float) -> None:
        if case not in simulated:  # an earlier flight may have ended early
            simulated.update(dict.fromkeys(simulated, duration))
        simulated[case] = min(t, duration)
        share = sum(simulated.values()) / (duration * len(flights))
        if t < duration:
            report(f"{case}, {t:.1f} of {duration:g} s", share)
        elif len(simulated) < len(flights):
            report(f"{case}, error bounds and log", share)
        else:
            report(f"{case}, error bounds, logs and figures", share)

    return progress


def print_feasibility(report: FeasibilityReport, warnings_only: bool) -> None:
    """Print the verdict of the preflight check, and properties of the linearized closed loop, before the flights."""
    if not report.check.passed:
        common.print_warning(f"warning: {report.check.format_verdict()}")
    elif not warnings_only:
        print(report.check.format_verdict(), flush=True)
    if not warnings_only and report.modes is not None and report.modes.stable:
        print(f"slowest mode at equilibrium on the reference: {report.modes.describe_slowest()}", flush=True)
    if not warnings_only and report.margins is not None:
        print(report.margins.describe(), flush=True)
    for text in report.warnings:
        common.print_warning(f"warning: {text}")


def print_study(summary: Mapping[str, Any], folder: Path) -> None:
    """Print incomplete cases, the tables of a study, its warnings and the folder of its results."""
    for case, found in summary["cases"].items():
        if not found["complete"]:
            common.print_error(f"{case} is incomplete: {found['termination_reason']}")
    tables.print_table(tables.study_table(summary))
    if "held_out" in summary:
        tables.print_table(tables.held_out_table(summary))
    for case, found in summary["cases"].items():
        for text in found["warnings"]:
            common.print_warning(f"warning: {case}: {text}")
    for text in summary.get("comparison_warnings", ()):
        common.print_warning(f"warning: {text}")
    print(f"results in {folder}")
