"""Commands on scenario files: list, print-config, migrate, check and tune."""

from __future__ import annotations

import difflib
import json
import os
import re
import threading
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from colift.cli import common
from colift.runtime import bounded_read, signals

NAME_WIDTH = 16  # characters of the names in `colift list`
SUBJECT_WIDTH = 10  # characters before the findings in `colift check`

INCOMPLETE_SEARCH = "# colift tune: the search is not complete; these are the best gains so far.\n"
"""First line of a scenario file whose search was interrupted."""
MAX_WRITE_TIME = 2.0
"""Longest time that a thread waits for another one that writes the file [s]."""
CHECK_SCHEDULE = (("team", 1.0), ("linearization at equilibrium", 3.0), ("linearization at equilibrium, true", 3.0))
"""Steps of `colift check` with their shares of the time; a search for corrections follows."""
EVALUATIONS = re.compile(r"(\d+) of at most (\d+) (linearizations|simulations)")
"""Number of evaluations in the steps of `colift tune`."""
LINEARIZATION_SHARE = 0.4
"""Share of the linearizations in the time of `colift tune`; the simulations follow."""

if TYPE_CHECKING:
    from colift.analysis.findings import Finding
    from colift.analysis.gain_tuning import EvaluationBudget, LoopDesign
    from colift.scenario import Scenario


def list_scenarios(as_json: common.JsonOption = False) -> None:
    """List the shipped scenarios."""
    from colift import scenario

    found = {name: scenario.shipped_description(name) for name in scenario.shipped_names()}
    with common.guard_output():
        if as_json:
            print(json.dumps(found, indent=2))
        else:
            lines = [f"{name:{NAME_WIDTH}} {description}" for name, description in found.items()]
            common.print_wrapped(lines, NAME_WIDTH + 1)


def print_config(
    name: common.ScenarioArgument, overrides: common.OverridesOption = None, as_json: common.JsonOption = False
) -> None:
    """Print the settings of a scenario.

    A shipped scenario is printed as it is written. A file, or a scenario with overrides, is printed with all settings.
    """
    from colift import scenario

    try:
        as_written = name in scenario.shipped_names() and not overrides
        if as_json:
            text = common.load_settings(name, overrides).model_dump_json(indent=2) + "\n"
        elif as_written:
            text = scenario.shipped_text(name)
        else:
            text = scenario.to_yaml(common.load_settings(name, overrides))
    except scenario.ScenarioError as error:
        common.fail(error)
    with common.guard_output():
        print(text, end="")


def require_suffix(file: Path) -> None:
    """End the command if the name of a file is not that of a scenario."""
    from colift import scenario

    if file.suffix not in scenario.SUFFIXES:
        common.fail(f"{file}: must end in {' or '.join(scenario.SUFFIXES)}")


def write_new(file: Path, text: str) -> None:
    """Write a file that must not exist yet, atomically; fail with OSError if it exists."""
    from colift.runtime import atomic_write

    atomic_write.write_atomic(file, text.encode(), new=True)


# Migration ------------------------------------------------------------------------------------------------------------


def migrate(
    files: Annotated[list[Path], typer.Argument(metavar="FILE...", help="Scenario files of schema 1.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", metavar="FILE", help="File to write instead of the original; for one FILE only."),
    ] = None,
    check_only: Annotated[
        bool, typer.Option("--check", help="Print the changes and write nothing. Status 1: a file needs migration.")
    ] = False,
    quiet: common.QuietOption = False,
) -> None:
    """Rewrite scenario files of an earlier schema in the current one.

    Settings are renamed; numbers and comments are kept. Each file is replaced as a whole, and the changed lines are
    printed. If one file cannot be read, none is written.
    """
    from colift.runtime import atomic_write
    from colift.scenario.migration import SCHEMA

    signals.raise_if_interrupted()
    if out is not None and (len(files) > 1 or check_only):
        common.fail(f"--out {out}: must be used with one FILE and without --check")
    texts = _migrated_texts(files, out)
    outdated = 0
    for file, (old, new) in texts.items():
        target = out or file
        outdated += old != new
        try:
            if not check_only and (old != new or out is not None):
                atomic_write.write_atomic(target.resolve(), new.encode())  # a link keeps pointing to the file
        except OSError as error:
            common.fail(error)
        with common.guard_output():
            for line in _migration_report(file, target, old, new, check_only, quiet):
                print(line)
    if check_only and outdated:
        common.print_error(f"{outdated} of {len(texts)} files are not of schema {SCHEMA}: run colift migrate")
        common.exit_with(common.EXIT_FAILED_CHECK)


def _migrated_texts(files: list[Path], out: Path | None) -> dict[Path, tuple[str, str]]:
    """Return the old and the new text of every file; end the command after all errors are reported."""
    from colift import scenario
    from colift.scenario.migration import migrate_text

    texts: dict[Path, tuple[str, str]] = {}
    errors = []
    for file in files:
        invalid = [path for path in (file, out) if path is not None and path.suffix not in scenario.SUFFIXES]
        try:
            if invalid:
                errors.append(f"{invalid[0]}: must end in {' or '.join(scenario.SUFFIXES)}")
                continue
            old = bounded_read.read_text(file)
            texts[file] = old, migrate_text(old)
        except OSError as error:
            errors.append(common.describe_error(error))
        except scenario.ScenarioError as error:
            errors.append(f"{file}: {error}")
        except ValueError as error:  # not UTF-8 text
            errors.append(str(error))
    if errors:
        common.fail("\n".join(errors))
    return texts


def _migration_report(file: Path, target: Path, old: str, new: str, check_only: bool, quiet: bool) -> list[str]:
    """Return the lines that describe the migration of one file."""
    from colift.scenario.migration import SCHEMA

    if old == new:
        return [f"{file}: is of schema {SCHEMA}{'' if target == file else f'; copied to {target}'}"]
    changes = list(difflib.unified_diff(old.splitlines(), new.splitlines(), lineterm="", n=0))[2:]
    lines = [line for line in changes if not line.startswith("@@")]
    added = sum(line.startswith("+") for line in lines)
    state = "needs migration" if check_only else f"rewritten in {target}" if target != file else "rewritten"
    head = f"{file}: {state}: schema {SCHEMA}, {added} changed lines"
    return [head] if quiet else [head, *(f"  {line}" for line in lines)]


# Checks and gains -----------------------------------------------------------------------------------------------------


def check(
    name: common.ScenarioArgument,
    overrides: common.OverridesOption = None,
    quiet: common.QuietOption = False,
    as_json: common.JsonOption = False,
) -> None:
    """Check a scenario before it is simulated and suggest corrections.

    Checks mass, contacts, thrust, joints, bound axes, and modes and margins of the linearized closed loop. Each finding
    is printed as soon as it is known. The last line is the verdict: sound, weak or unsound. Status 0: sound or weak.
    Status 1: unsound. Status 2: the scenario cannot be read.
    """
    from colift import scenario
    from colift.analysis import preflight

    signals.raise_if_interrupted()
    try:
        settings = common.load_settings(name, overrides)
        with common.show_progress(f"checking {settings.name}", quiet, CHECK_SCHEDULE) as progress:

            def report(finding: Finding) -> None:
                if not as_json:
                    with progress.paused(), common.guard_output():
                        common.print_wrapped(finding.format_lines(), SUBJECT_WIDTH)

            found = preflight.run_preflight(settings, progress, report=report)
    except (scenario.ScenarioError, OSError) as error:
        common.fail(error)
    with common.guard_output():
        print(json.dumps(found.summary, indent=2) if as_json else found.format_verdict())
    if not found.passed:
        common.exit_with(common.EXIT_FAILED_CHECK)


def tune(
    name: common.ScenarioArgument,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="Scenario file to write; it must not exist yet.")],
    overrides: common.OverridesOption = None,
    quiet: common.QuietOption = False,
    as_json: common.JsonOption = False,
) -> None:
    """Optimize the gains of a scenario for decay rate, delay margin and disturbance rejection.

    Prints modes and margins before and after, and writes the scenario with the optimized gains. No file is
    overwritten. The search takes some minutes. The file contains the best gains so far during the search and after
    Ctrl-C; its first line then states that the search is not complete.
    """
    from colift import scenario

    try:
        _require_writable(out)
        settings, written = common.load_settings(name, overrides), None
        if not overrides and name in scenario.shipped_names():
            written = scenario.shipped_text(name)
        elif not overrides:
            written = bounded_read.read_text(Path(name).expanduser())
        best = BestGains(settings, written, out)
        before, after, budget, values = _search_gains(settings, best, quiet)
    except (scenario.ScenarioError, ValueError, OSError) as error:
        common.fail(error)
    _print_tuning(before, after, budget, values, out, as_json)


def _print_tuning(
    before: LoopDesign,
    after: LoopDesign,
    budget: EvaluationBudget,
    values: tuple[Values, Values],
    out: Path,
    as_json: bool,
) -> None:
    """Print the values of the designs before and after the search."""
    from colift.analysis import gain_tuning

    with common.guard_output():
        if as_json:
            found = {"before": values[0], "after": values[1], **budget._asdict()}
            print(json.dumps(found | {"control": after.settings.model_dump(mode="json")["control"]}, indent=2))
        else:
            report = gain_tuning.format_report(before, after, *values, budget)
            print("\n".join([*report, f"{after.settings.name} with these gains is in {out}"]))


def _require_writable(out: Path) -> None:
    """End the command if a scenario file cannot be created at a path."""
    from colift import scenario

    if out.suffix not in scenario.SUFFIXES:
        common.fail(f"--out {out}: must end in {' or '.join(scenario.SUFFIXES)}")
    if out.exists():
        common.fail(f"--out {out}: exists; it is not overwritten")
    if not (out.parent.is_dir() and os.access(out.parent, os.W_OK)):
        common.fail(f"--out {out}: the folder {out.parent} does not exist or is not writable")


Values = dict[str, float | str]  # values of a design, for the report


class BestGains:
    """Scenario file of `tune`, which contains the best gains of the search so far.

    Each improvement replaces the file atomically. A request to end writes the last improvement, or the initial gains. A
    forced termination writes them by `save_if_interrupted` in another thread.
    """

    def __init__(self, settings: Scenario, written: str | None, out: Path) -> None:
        """Start with the initial gains; nothing is written.

        Args:
            settings: Scenario with the initial gains.
            written: Text of its file, into which the gains are inserted; None if overrides apply.
            out: File to write; it must not exist.
        """
        self.initial, self.best, self.written, self.out = settings, settings, written, out
        self._saved: str | None = None
        self._lock = threading.Lock()  # the main thread may be writing when the process is terminated

    def update(self, loop: LoopDesign) -> None:
        """Replace the file by the gains of an improved loop."""
        self.best = loop.settings
        self.save()

    def save(self, complete: bool = False) -> None:
        """Write the best gains, atomically.

        Args:
            complete: Whether the search has ended.

        Raises:
            OSError: If the file cannot be written, or if another program has created it.
        """
        from colift.runtime import atomic_write

        text = ("" if complete else INCOMPLETE_SEARCH) + self._text()
        if not self._lock.acquire(timeout=MAX_WRITE_TIME):
            return  # the other thread writes the same gains
        try:
            if text != self._saved:
                new = self._saved is None
                atomic_write.write_atomic(self.out, text.encode(), after_interrupt=True, new=new)
                self._saved = text
        finally:
            self._lock.release()

    def save_if_interrupted(self) -> None:
        """Write the best gains if the process is requested to end and the search is not complete."""
        if signals.is_interrupted() and (self._saved is None or self._saved.startswith(INCOMPLETE_SEARCH)):
            self.save()

    def _text(self) -> str:
        """Return the text of the scenario with the best gains."""
        from colift import scenario

        if self.best == self.initial:  # the search may not have begun
            return scenario.to_yaml(self.initial) if self.written is None else self.written
        from colift.analysis import gain_tuning

        return gain_tuning.to_yaml(self.best, self.written, str(self.out))


def _search_gains(
    settings: Scenario, best: BestGains, quiet: bool
) -> tuple[LoopDesign, LoopDesign, EvaluationBudget, tuple[Values, Values]]:
    """Optimize gains; on a request to end, write the best gains so far and propagate it.

    Args:
        settings: Scenario whose gains are optimized.
        best: File of the best gains.
        quiet: Print no progress.

    Returns:
        The design before and after, the number of evaluations, and the values of both designs for the report.

    Raises:
        Interrupted: If the process is requested to end.
    """
    with signals.on_exit(best.save_if_interrupted):
        try:
            from colift.analysis import gain_tuning

            with common.show_progress(f"tuning {settings.name}", quiet, limit=True) as progress:
                before, after, budget = gain_tuning.tune(
                    settings, lambda step: progress(step, tuning_share(step)), best.update
                )
                best.update(after)
                progress("flights with both")
                values = gain_tuning.summary_values(before), gain_tuning.summary_values(after)
                best.save(complete=True)
        except signals.Interrupted:
            best.save()
            common.report_interruption(f"the best gains so far are in {best.out}")
            raise
    return before, after, budget, values


def tuning_share(step: str) -> float | None:
    """Return the completed share of `colift tune` from the number of evaluations in a step; None if it has none."""
    found = EVALUATIONS.search(step)
    if found is None:
        return None
    share = int(found[1]) / int(found[2])
    if found[3] == "linearizations":
        return LINEARIZATION_SHARE * share
    return LINEARIZATION_SHARE + (1 - LINEARIZATION_SHARE) * share
