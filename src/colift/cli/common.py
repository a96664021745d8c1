"""Options, error handling and progress output that the commands share.

Modules of the library are imported inside functions, so that only the commands that use them import them.
"""

from __future__ import annotations

import contextlib
import enum
import hashlib
import os
import re
import shutil
import sys
import textwrap
import webbrowser
from collections.abc import Callable, Generator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer
from rich.console import Console

from colift.cli import progress
from colift.runtime import signals

if TYPE_CHECKING:
    from colift.runtime.run_directory import RunDirectory
    from colift.scenario import Scenario

EXIT_INCOMPLETE = 1
"""Exit status if a run ended early or its output could not be printed."""
EXIT_VIOLATION = 1
"""Exit status if an observed error exceeds its certified bound."""
EXIT_FAILED_CHECK = 1
"""Exit status if a check found a problem."""
MAX_FOLDER_CHANGES = 80
"""Longest description of changed settings in the name of a folder; a longer one is replaced by a digest."""
EXIT_USAGE = 2
"""Exit status if a command line, a scenario or a folder cannot be used."""

error_console = Console(stderr=True, soft_wrap=True, highlight=False, emoji=False)
"""Console for errors, warnings and progress; results are printed to standard output."""


# Messages -------------------------------------------------------------------------------------------------------------


def print_error(message: str) -> None:
    """Print a message in red to standard error."""
    error_console.print(message, style="red", markup=False)


def print_warning(message: str) -> None:
    """Print a message in yellow to standard error."""
    error_console.print(message, style="yellow", markup=False)


def print_status(message: str) -> None:
    """Print a message to standard error."""
    error_console.print(message, markup=False)


_interruption_reported: list[bool] = []


def report_interruption(note: str = "") -> None:
    """Print one line on a request to end the process, at the first call only.

    Args:
        note: Text after the first word, such as the state of the results.
    """
    if not _interruption_reported:
        _interruption_reported.append(True)
        print_warning(f"interrupted; {note}" if note else "interrupted")


def report_pending_interruption() -> None:
    """Print one line if the process is requested to end and nothing has been printed about it."""
    try:
        signals.raise_if_interrupted()
    except signals.Interrupted:
        report_interruption()


def exit_with(status: int) -> NoReturn:
    """End the command with an exit status."""
    raise typer.Exit(status)


def fail(message: str | Exception) -> NoReturn:
    """Print an error and end the command with `EXIT_USAGE`."""
    print_error(describe_error(message) if isinstance(message, Exception) else message)
    raise typer.Exit(EXIT_USAGE) from None


def describe_error(error: Exception) -> str:
    """Return the message of an exception; for an error of the system, the file and its message without the number."""
    if not isinstance(error, OSError) or not error.strerror:
        return str(error)
    return error.strerror if error.filename is None else f"{error.filename}: {error.strerror}"


def print_wrapped(lines: Sequence[str], indent: int) -> None:
    """Print lines, broken at the width of the terminal; without a terminal each line is printed whole.

    Args:
        lines: Lines of text.
        indent: Number of spaces before continuation lines.
    """
    width = shutil.get_terminal_size((0, 0)).columns  # 0 if the output is not a terminal and COLUMNS is not set
    for line in lines:
        if len(line) <= width or width <= 2 * indent:
            print(line)
        else:
            print(textwrap.fill(line, width, subsequent_indent=" " * indent, break_on_hyphens=False))


@contextlib.contextmanager
def guard_output(note: str = "") -> Generator[None]:
    """Handle failures to print to standard output within the block.

    A closed pipe, as in ``colift list | head -1``, is not a failure. Any other failure is reported and ends the
    command with `EXIT_INCOMPLETE`.

    Args:
        note: Text that follows the error message, such as the folder that holds the results.

    Yields:
        Nothing.
    """
    try:
        yield
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:
        discard_output()
    except OSError as error:
        discard_output()
        print_error(f"cannot print: {describe_error(error)}{note}")
        exit_with(EXIT_INCOMPLETE)


def discard_output() -> None:
    """Redirect standard output to the null device, because Python writes its buffer once more when it ends."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextlib.contextmanager
def show_progress(
    activity: str,
    quiet: bool = False,
    schedule: progress.Schedule = (),
    limit: bool = False,
    tail: float = 0.0,
    announce: bool = True,
) -> Generator[progress.Display]:
    """Show an activity with its current step, elapsed time and time left on standard error.

    On a terminal, one line is updated. Elsewhere, a line is printed at the start and every `progress.LINE_PERIOD`.

    Args:
        activity: Description of the activity.
        quiet: Print nothing.
        schedule: Steps in their order with their shares of the time.
        limit: True if the time left is at most the estimate.
        tail: Estimated time after the completed share has become 1 [s].
        announce: Whether a plain line is printed at the start; False for commands that are short in general.

    Yields:
        Function that takes the name of the step that begins and the completed share. It raises `signals.Interrupted`
        on a request to end.
    """
    if quiet:
        yield _NoDisplay()
        return
    with progress.show_activity(error_console, activity, schedule, limit, tail, announce) as shown:
        yield shown


class _NoDisplay:
    """Report that raises Interrupted on a request to end and prints nothing."""

    def __call__(self, step: str, share: float | None = None) -> None:
        del step, share
        signals.raise_if_interrupted()

    def paused(self) -> contextlib.AbstractContextManager[None]:
        return contextlib.nullcontext()


def print_page(message: str, page: Path, open_browser: bool) -> None:
    """Print the location of a page and open it in a browser on request."""
    with guard_output():
        print(message)
    if open_browser and not webbrowser.open(page.resolve().as_uri()):
        fail("no browser was found to open the page")


# Completion in a shell ------------------------------------------------------------------------------------------------


def complete_scenario(incomplete: str) -> list[str]:
    """Return the shipped scenarios that begin with a text."""
    from colift import scenario

    return [name for name in scenario.shipped_names() if name.startswith(incomplete)]


def complete_case(incomplete: str) -> list[str]:
    """Return the cases that begin with a text."""
    from colift.scenario import cases

    return [name for name in cases.ALL_CASES if name.startswith(incomplete)]


def complete_setting(ctx: typer.Context, incomplete: str) -> list[str]:
    """Return the settings of the scenario on the command line that begin with a text."""
    from colift import scenario

    try:
        settings = scenario.load_scenario(ctx.params.get("name") or "paper").model_dump(mode="json")
    except scenario.ScenarioError:
        return []
    return [f"{path}=" for path in setting_paths(settings) if path.startswith(incomplete)]


def setting_paths(value: Any, prefix: str = "") -> list[str]:
    """List the paths of all settings as ``--set`` takes them.

    Args:
        value: Settings as plain data.
        prefix: Path of ``value`` itself.

    Returns:
        Dotted paths of all leaves. Entries of lists are identified by their names, or by their index without a name.
    """
    if isinstance(value, dict):
        entries = {str(key): entry for key, entry in value.items()}
    elif isinstance(value, list) and value and isinstance(value[0], dict):
        entries = {entry.get("name", str(k)): entry for k, entry in enumerate(value)}
    else:
        return [prefix]
    return [
        path for key, entry in entries.items() for path in setting_paths(entry, f"{prefix}.{key}" if prefix else key)
    ]


# Options --------------------------------------------------------------------------------------------------------------


class Engine(enum.StrEnum):
    """Plant model that simulates the true team."""

    RIGID = "rigid"
    MUJOCO = "mujoco"


ScenarioArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENARIO",
        help="Name of a shipped scenario, or path of a YAML file.",
        autocompletion=complete_scenario,
    ),
]
OverridesOption = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Override a setting of the scenario, such as payload.mass_kg=2; repeatable.",
        autocompletion=complete_setting,
    ),
]
OutOption = Annotated[
    Path | None,
    typer.Option("--out", help="Folder for the results; default: out/SCENARIO, with the options that change it."),
]
ReplaceOption = Annotated[
    bool,
    typer.Option("--replace", help="Remove earlier results from the folder, also of another run."),
]
SeedOption = Annotated[
    int | None,
    typer.Option("--seed", min=0, max=2**63 - 1, help="Seed of all random numbers; default: as in the scenario."),
]
DurationOption = Annotated[
    float | None,
    typer.Option(
        "--duration", metavar="SECONDS", help="Duration of the simulated flight; default: as in the scenario."
    ),
]
CaseOption = Annotated[
    str,
    typer.Option(
        "--case",
        help="Case to simulate: C1 (no learning), C2 (payload learning), C3 (payload and agent learning), adaptive, "
        "or a baseline.",
        autocompletion=complete_case,
    ),
]
EngineOption = Annotated[
    Engine | None,
    typer.Option(
        "--engine", help="Plant model: rigid contacts, or MuJoCo (extra mujoco); default: as in the scenario."
    ),
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print the results as JSON.")]
QuietOption = Annotated[bool, typer.Option("--quiet", "-q", help="Print only warnings and results.")]
OpenOption = Annotated[bool, typer.Option("--open", help="Open the page in a browser.")]


def parse_case(name: str, option: str = "--case") -> str:
    """Return the identifier of a case that is given in any capitalization; end the command if there is no such case."""
    from colift.scenario import cases

    try:
        return cases.case_id(name)
    except KeyError:
        fail(f"{option} {name}: must be one of {', '.join(cases.ALL_CASES)}")


def parse_cases(names: Sequence[str], option: str = "--case") -> tuple[str, ...]:
    """Return the identifiers of cases without duplicates.

    Args:
        names: Values of a repeatable option; each is one case or several, separated by commas.
        option: Name of the option for error messages.

    Returns:
        Identifiers in the order of their first mention.
    """
    return tuple(dict.fromkeys(parse_case(name, option) for name in split_values(names)))


def split_values(values: Sequence[str]) -> list[str]:
    """Split the values of a repeatable option at commas."""
    return [part.strip() for value in values for part in value.split(",")]


# Scenarios and folders ------------------------------------------------------------------------------------------------


def load_settings(
    name: str,
    overrides: Sequence[str] | None,
    duration: float | None = None,
    seed: int | None = None,
    engine: Engine | None = None,
) -> Scenario:
    """Load a scenario and apply the options of the command line.

    Args:
        name: Shipped scenario or path of a file.
        overrides: Settings as ``PATH=VALUE``.
        duration: Duration of the simulated flight [s]. Learning that would end later is shortened with a warning.
        seed: Seed of all random numbers.
        engine: Plant model.

    Returns:
        Validated settings.

    Raises:
        ScenarioError: If the scenario or an option is invalid.
    """
    from colift import scenario

    given = {"duration_s": duration, "seed": seed}
    options = [f"{setting}={value}" for setting, value in given.items() if value is not None]
    requested = [*(overrides or ()), *options]
    try:
        settings = scenario.load_scenario(name, requested)
    except scenario.ScenarioError as error:
        shortened = [] if duration is None else _shortened_learning(name, overrides or (), duration)
        if not shortened:
            raise scenario.ScenarioError(_with_option_names(str(error), duration)) from None
        try:
            settings = scenario.load_scenario(name, [*requested, *shortened])
        except scenario.ScenarioError as second:
            raise scenario.ScenarioError(_with_option_names(str(second), duration)) from None
    if engine is not None and settings.physics.kind != engine:
        settings = settings.model_copy(update={"physics": {"kind": engine.value}})
    return settings


def results_folder(
    out: Path | None,
    overrides: Sequence[str] | None = None,
    duration: float | None = None,
    seed: int | None = None,
    engine: Engine | None = None,
    suffix: str = "",
) -> Callable[[Scenario], Path]:
    """Return a function of the settings that returns the folder for the results of a command.

    Without ``--out`` its name consists of the name of the scenario and the options that change the run, so that results
    of different runs have different folders.

    Args:
        out: Folder from the command line.
        overrides: Settings as ``PATH=VALUE``.
        duration: Duration of the simulated flight [s].
        seed: Seed of all random numbers.
        engine: Plant model.
        suffix: Text that follows the name of the scenario, such as ``-falsification``.
    """
    parts = [] if seed is None else [f"seed{seed}"]
    parts += [] if duration is None else [f"{duration:g}s"]
    parts += [] if engine is None else [engine.value]
    changes = "-".join([*parts, *(re.sub(r"[^\w.=+-]+", "_", override) for override in overrides or ())])
    if len(changes) > MAX_FOLDER_CHANGES:
        changes = hashlib.sha256(repr((*parts, *(overrides or ()))).encode()).hexdigest()[:12]
    default = lambda settings: Path("out") / "-".join(filter(None, (f"{settings.name}{suffix}", changes)))  # noqa: E731
    return default if out is None else lambda _settings: out


def _with_option_names(message: str, duration: float | None) -> str:
    """Replace names of settings in an error message by the options that set them."""
    named = message.replace("--set duration_s", "--duration").replace("--set seed", "--seed")
    if duration is None:
        return named
    lines = named.replace(f"duration_s = {duration:g}", f"--duration {duration:g}").splitlines()
    # an invalid duration is the only error: settings that exceed it are valid for another duration
    invalid = any(line.startswith("--duration") for line in lines)
    return "\n".join(line for line in lines if not (invalid and f"exceed --duration {duration:g}" in line))


def _shortened_learning(name: str, overrides: Sequence[str], duration: float) -> list[str]:
    """Return the overrides that end learning with a shorter flight, with a warning; none if learning fits into it."""
    from colift import scenario

    try:
        learning = scenario.load_scenario(name, overrides).learning
    except scenario.ScenarioError:  # already reported
        return []
    if not learning.start_s + 1 / learning.sample_Hz <= duration < learning.end_s:
        return []
    times = [t for t in learning.update_times_s if t < duration]
    message = f"learning ends with the run, at {duration:g} s (learning.end_s is {learning.end_s:g})"
    if not times:
        message = f"nothing is learned in {duration:g} s: the first update is at {learning.update_times_s[0]:g} s"
    print_warning(f"warning: {message}")
    return [f"learning.end_s={duration}", f"learning.update_times_s={times or [duration]}"]


@contextlib.contextmanager
def open_results(
    read: Callable[[], Scenario], out: Callable[[Scenario], Path], replace: bool, keep_on_interrupt: bool = False
) -> Generator[tuple[Scenario, RunDirectory]]:
    """Read the settings and open their folder for results, with exclusive access within the block.

    Errors that a user can correct end the command with one line. A request to end does so as well and propagates.

    Args:
        read: Function that returns the settings.
        out: Function that returns the folder for the results.
        replace: Remove earlier results from the folder.
        keep_on_interrupt: Keep the files that are complete after a request to end.

    Yields:
        The settings and the folder.

    Raises:
        Interrupted: If the process is requested to end.
    """
    from colift import codegen, scenario
    from colift.runtime import run_directory
    from colift.workflows.study import CERTIFICATE_FILES, STUDY_FILES, open_run_directory

    signals.raise_if_interrupted()
    try:
        settings = read()
        with open_run_directory(settings, out(settings), replace, keep_on_interrupt) as folder:
            if folder.replaced:
                print_status(
                    f"{folder.target} contains {folder.replaced}: they are removed when the new ones are complete"
                )
            try:
                yield settings, folder
            except signals.Interrupted:
                kept = keep_on_interrupt and not folder.replaced
                kept = kept and run_directory.written_files(folder, STUDY_FILES + CERTIFICATE_FILES)
                note = "completed parts are in" if kept else "nothing was written to"
                report_interruption(f"{note} {folder.target}")
                raise
    except (scenario.ScenarioError, codegen.CompilerError, OSError) as error:
        fail(error)
