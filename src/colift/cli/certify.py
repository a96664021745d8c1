"""Commands on error bounds: certify and falsify."""

from __future__ import annotations

import dataclasses
import functools
import json
import os
import shlex
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from colift.cli import common, tables
from colift.cli import progress as progress_module

if TYPE_CHECKING:
    from colift.runtime.run_directory import RunDirectory
    from colift.scenario import Scenario
    from colift.workflows.falsification import FalsificationTrial

CERTIFICATION_SCHEDULE = (
    ("linearization of the closed loop at rest", 10.0),
    ("simulation", 30.0),
    ("nominal trajectory", 60.0),
    ("tube until", 65.0),
    ("error bounds along the path of the tube", 7.0),
    ("optimal recovery along the path of the tube", 35.0),
    ("error bounds along the path of the run", 6.0),
    ("optimal recovery along the path of the run", 30.0),
    ("input-to-state stability", 20.0),
)
"""Steps of `colift certify` with their shares of the time, measured with `certified`."""
ADVERSARIAL_STEP = (("adversarial test", 230.0),)
"""Step of ``--adversarial-test`` with its share of the time."""
FALSIFICATION_FILE = "falsification.json"


def certify(
    name: common.ScenarioArgument,
    out: common.OutOption = None,
    overrides: common.OverridesOption = None,
    duration: common.DurationOption = None,
    seed: common.SeedOption = None,
    adversarial_test: Annotated[
        bool,
        typer.Option(
            "--adversarial-test",
            help="Also simulate the worst residual forces that RKHS norm and training data allow.",
        ),
    ] = False,
    replace: common.ReplaceOption = False,
    quiet: common.QuietOption = False,
    as_json: common.JsonOption = False,
) -> None:
    """Compute ultimate bounds of the tracking errors in case C3 and compare them with the observed errors.

    Simulates the scenario and its nominal trajectory, along which the residual forces equal the learned means. Writes
    certificate.json and figure 6 (docs/certificate.md). Status 1: an observed error exceeds its bound.
    """
    from colift.workflows import certification

    read = functools.partial(common.load_settings, name, overrides, duration, seed)
    results = common.results_folder(out, overrides, duration, seed)
    with common.open_results(read, results, replace) as (settings, folder):
        try:
            schedule = CERTIFICATION_SCHEDULE[:-1] + ADVERSARIAL_STEP * adversarial_test + CERTIFICATION_SCHEDULE[-1:]
            with common.show_progress(f"certifying {settings.name}", quiet, schedule) as progress:
                made = certification.certify(settings, progress=progress)
                worst = certification.run_adversarial_test(made, progress=progress) if adversarial_test else None
                summary = certification.save_certificate(settings, made, worst, folder, progress)
        except ValueError as error:
            common.fail(error)
    with common.guard_output(f"; the results are in {folder.target}"):
        if as_json:
            print(json.dumps(summary, indent=2))
        else:
            print_certificate(summary, folder.target)
    if summary["violations"]:
        common.exit_with(common.EXIT_VIOLATION)


def falsify(
    name: common.ScenarioArgument,
    out: Annotated[
        Path | None, typer.Option("--out", help="Folder for the results; default: out/SCENARIO-falsification.")
    ] = None,
    overrides: common.OverridesOption = None,
    duration: common.DurationOption = None,
    seed: common.SeedOption = None,
    rounds: Annotated[
        int, typer.Option("--rounds", min=1, help="Number of rounds; each draws one trial of every kind.")
    ] = 1,
    trials: Annotated[
        list[str] | None,
        typer.Option(
            "--trial",
            metavar="KIND:NUMBER",
            help="Run only this trial, such as worst_case_e_p:0; repeatable, or separated by commas.",
        ),
    ] = None,
    replace: common.ReplaceOption = False,
    quiet: common.QuietOption = False,
    as_json: common.JsonOption = False,
) -> None:
    """Search for flights that violate a certified error bound.

    Simulates residual forces that satisfy the RKHS norm and the labels, and compares the errors with the a priori
    bounds in case C3. Flights with other seeds, updates, initial states, trajectories, noise, rates and thrust limits
    are compared with their own bounds.

    Prints the largest ratio of every error and the command that reproduces it. Writes falsification.json
    (docs/certificate.md); trials of an earlier command with the same settings are kept. After Ctrl-C the file contains
    the completed trials, and its entry ``pending`` lists the others. Status 1: a bound is violated.
    """
    from colift.workflows import falsification

    read = functools.partial(common.load_settings, name, overrides, duration, seed)
    completed: list[FalsificationTrial] = []
    summary: Any = None
    results = common.results_folder(out, overrides, duration, seed, suffix="-falsification")
    with common.open_results(read, results, replace, keep_on_interrupt=True) as (settings, folder):
        requested = common.split_values(trials) if trials else falsification.trial_names(settings, rounds)
        earlier = _read_trials(folder)
        try:
            with common.show_progress(f"falsifying the bounds of {settings.name}", quiet) as progress:
                for trial in falsification.falsify(settings, requested, trial_progress(requested, progress)):
                    completed.append(trial)
                    summary = _save_trials(folder, settings, earlier, completed, requested)
        except ValueError as error:
            common.fail(error)
    options = [word for override in overrides or () for word in ("--set", override)]
    options += [] if duration is None else ["--duration", f"{duration:g}"]
    with common.guard_output(f"; the results are in {folder.target}"):
        if as_json:
            print(json.dumps(summary, indent=2))
        else:
            print_falsification(completed, name, options, settings.seed, folder.target)
    if any(trial.is_violated for trial in completed):
        common.exit_with(common.EXIT_VIOLATION)


def trial_progress(trials: Sequence[str], report: progress_module.Report) -> Callable[[str], None]:
    """Return a function of the steps of all trials that reports them with the completed share.

    Args:
        trials: Names of the trials in their order; a step with such a name begins the trial.
        report: Function that takes the step and the completed share.
    """
    current = ""

    def progress(step: str) -> None:
        nonlocal current
        current = step if step in trials else current
        number = trials.index(current) if current else 0
        name = current if step == current else f"{current}: {step}"
        report(f"trial {number + 1} of {len(trials)}, {name}", number / len(trials))

    return progress


def _read_trials(folder: RunDirectory) -> dict[str, Any]:
    """Return trials and pending trials of an earlier command with the same settings.

    Raises:
        OSError: If the file is damaged.
    """
    from colift.runtime import bounded_read

    path, shown = folder.path / FALSIFICATION_FILE, folder.target / FALSIFICATION_FILE
    if not os.path.lexists(path):
        return {"trials": [], "pending": []}
    try:
        found = bounded_read.read_json(path)
        trials = {str(row["name"]): row for row in found["trials"]}
        return {"trials": list(trials.values()), "pending": [str(name) for name in found.get("pending", [])]}
    except (OSError, ValueError, KeyError, TypeError) as error:
        reason = str(error).replace(str(folder.path), str(folder.target))
        raise OSError(f"{shown}: the earlier trials are damaged ({reason}); remove them by --replace") from None


def _save_trials(
    folder: RunDirectory,
    settings: Scenario,
    earlier: Mapping[str, Any],
    completed: Sequence[FalsificationTrial],
    requested: Sequence[str],
) -> dict[str, Any]:
    """Write the trials of an earlier command and those until now, and the names of the trials that are pending.

    Args:
        folder: Folder of the results.
        settings: Scenario.
        earlier: Trials and pending trials of an earlier command.
        completed: Completed trials.
        requested: Names of the requested trials.

    Returns:
        The content of the file.
    """
    from colift.analysis import result_files
    from colift.runtime import atomic_write

    rows = {row["name"]: row for row in [*earlier["trials"], *map(dataclasses.asdict, completed)]}
    pending = [name for name in dict.fromkeys([*earlier["pending"], *requested]) if name not in rows]
    content = {
        "schema": result_files.SCHEMA,
        "run": folder.run_id,
        "scenario": settings.name,
        "seed": settings.seed,
        "version": version("colift"),
        "pending": pending,
        "trials": list(rows.values()),
    }
    return atomic_write.write_json_atomic(content, folder.path / FALSIFICATION_FILE)


def print_falsification(
    trials: Sequence[FalsificationTrial], name: str, options: Sequence[str], seed: int, folder: Path
) -> None:
    """Print a row for each trial, then the largest ratio of each error with the command that reproduces it.

    Args:
        trials: Completed trials.
        name: Scenario as given on the command line.
        options: Overrides and duration as given on the command line.
        seed: Seed of the scenario.
        folder: Folder of the results.
    """
    tables.print_table(tables.falsification_table(trials, name))
    for trial in trials:
        if trial.message:
            print(f"{trial.name}: {trial.message}")
    for error in tables.ERROR_UNITS:
        compared = [trial for trial in trials if error in trial.observed_over_bound]
        if compared:
            worst = max(compared, key=lambda trial: trial.observed_over_bound[error])
            command = _repeat_command(worst, name, options, seed)
            print(f"{error}: worst {worst.observed_over_bound[error]:.3f}, colift {command}")
    compared = [trial for trial in trials if trial.observed_over_bound]
    violated = [trial.name for trial in trials if trial.is_violated]
    names = f": {', '.join(violated)}" if violated else ""
    print(f"{len(violated)} of {len(compared)} trials that have bounds violate one{names}")
    print(f"results in {folder}")


def _repeat_command(trial: FalsificationTrial, name: str, options: Sequence[str], seed: int) -> str:
    """Return the words after ``colift`` that reproduce a trial."""
    seeds = [override for override in trial.overrides if override.startswith("seed=")]
    others = [override for override in trial.overrides if override not in seeds]
    sets = [*options, *(word for override in others for word in ("--set", override))]
    selection = [] if trial.overrides else ["--trial", trial.name]
    number = seeds[0].removeprefix("seed=") if seeds else str(seed)
    return shlex.join(["certify" if trial.overrides else "falsify", name, *sets, "--seed", number, *selection])


def print_certificate(summary: Mapping[str, Any], folder: Path) -> None:
    """Print violated bounds, the table of bounds with the observed errors, and the conservatism of the position bound.

    Args:
        summary: Content of ``certificate.json``.
        folder: Folder of the results.
    """
    for line in _violations(summary["violations"]):
        common.print_error(line)
    tables.print_table(tables.certificate_table(summary), num_repeated=2)
    for line in certificate_notes(summary):
        print(line)
    if summary["adversarial_test"]:
        ratio = summary["adversarial_test"]["bound_over_observed"]
        print(f"bound / error under the worst residual forces consistent with the data: {ratio:.3f}")
    print("\nbound of e_p by method, mm:")
    for method, bound in summary["conservatism_m"].items():
        if bound is not None:
            print(f"  {tables.format_cell(bound, 1e3, '.3g'):>8}  {method}")
    print(f"results in {folder}")


def certificate_notes(summary: Mapping[str, Any]) -> list[str]:
    """Return sentences on the assumptions of the bounds that exist and on those that do not exist.

    Args:
        summary: Content of ``certificate.json``.

    Returns:
        One line for each statement.
    """
    existing = [
        name
        for name, bounds in summary["ultimate_bounds"].items()
        if any(tables.has_bound(bounds[kind]) for kind in tables.BOUND_KIND_LABELS)
    ]
    unproven = {name: summary["ultimate_bounds"][name]["unproven_assumptions"] for name in existing}
    return [*_assumptions(unproven), *_missing(summary)]


def _violations(violations: Sequence[Mapping[str, Any]]) -> list[str]:
    """Return a line for every error of a flight that exceeds a bound, with all such bounds."""
    lines: dict[tuple[str, str], str] = {}
    for each in violations:
        scale, unit = tables.ERROR_UNITS[each["error"]]
        run = "the adversarial run" if each["run"] == "adversarial_test" else "this run"
        start = f"{each['error']} of {run} exceeds its bound: observed {each['observed'] * scale:.4g} {unit}, bound"
        line = lines.get((run, each["error"]), "")
        kind = tables.BOUND_KIND_LABELS[each["kind"]]
        bound = f"{each['ultimate_bound'] * scale:.4g} {unit} ({each['prediction_bound']}, {kind} run)"
        lines[run, each["error"]] = f"{line}, {bound}" if line else f"{start} {bound}"
    return list(lines.values())


def _assumptions(names: Mapping[str, Sequence[str]]) -> list[str]:
    """Return a line with the assumptions of all bounds and a line for each bound with additional ones."""
    from colift.analysis import conclusions

    common_names = [name for name in next(iter(names.values()), []) if all(name in each for each in names.values())]
    lines = [f"assumed: {conclusions.list_assumptions(common_names)}"] if common_names else []
    for bound, each in names.items():
        additional = [name for name in each if name not in common_names]
        lines += [f"assumed by {bound} also: {conclusions.list_assumptions(additional)}"] if additional else []
    return lines


def _missing(summary: Mapping[str, Any]) -> list[str]:
    """Return the reasons for bounds that do not exist, and the meaning of the two kinds of bounds."""
    lines = [f"{name}: not available, {reason}" for name, reason in summary["unavailable_bounds"].items()]
    if summary["tube_failure"]:
        some = any(tables.has_bound(bounds["a_posteriori"]) for bounds in summary["ultimate_bounds"].values())
        return [*lines, f"no bound{' for any run' if some else ''}: {summary['tube_failure']}"]
    return [*lines, "any run: bound a priori, before the flight; this run: bound along the simulated trajectory"]
