"""The command line: `colift study paper`, and what else a person asks of a scenario.

Heavy modules are imported by the commands that need them, so that `--help` answers at once.
"""

from __future__ import annotations

import contextlib
import dataclasses
import enum
import functools
import io
import json
import math
import os
import shlex
import signal
import sys
import time
from collections.abc import Callable, Generator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

try:
    import typer
    from rich.console import Console
    from rich.table import Table

    from colift.cli import tables
    from colift.runtime import signals
except KeyboardInterrupt:  # `main` does not yet take signals
    sys.exit(130)

app = typer.Typer(
    help="Cooperative transport of a rigid payload by aerial manipulators: simulate, control, learn, certify.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
export = typer.Typer(help="Write a scenario in the format of another program.", no_args_is_help=True)
app.add_typer(export, name="export")
errors = Console(stderr=True, soft_wrap=True, highlight=False)

EXIT_USAGE, EXIT_INCOMPLETE, EXIT_VIOLATION, EXIT_FAILED_CHECK = 2, 1, 1, 1
PROGRESS_PERIOD = 5.0  # s, between two lines that say how far a flight is, where no bar can


def _fail(message: str) -> typer.Exit:
    errors.print(message, style="red", markup=False)
    return typer.Exit(EXIT_USAGE)


def _show_version(requested: bool) -> bool:
    if requested:
        typer.echo(version("colift"))
        raise typer.Exit
    return requested


def _scenario_names(incomplete: str) -> list[str]:
    from colift import scenario

    return [name for name in scenario.shipped_names() if name.startswith(incomplete)]


def _case_names(incomplete: str) -> list[str]:
    from colift.scenario import experiment

    return [name for name in experiment.ALL_CASES if name.startswith(incomplete)]


def _setting_paths(ctx: typer.Context, incomplete: str) -> list[str]:
    from colift import scenario

    try:
        settings = scenario.load_scenario(ctx.params.get("name") or "paper").model_dump(mode="json")
    except scenario.ScenarioError:
        return []
    return [f"{path}=" for path in _leaves(settings) if path.startswith(incomplete)]


def _leaves(given: Any, prefix: str = "") -> list[str]:
    """The paths of settings that have a value, as `--set` takes them; entries of lists by their names, if they have."""
    if isinstance(given, dict):
        named = {str(key): value for key, value in given.items()}
    elif isinstance(given, list) and given and isinstance(given[0], dict):
        named = {each.get("name", str(k)): each for k, each in enumerate(given)}
    else:
        return [prefix]
    return [path for key, value in named.items() for path in _leaves(value, f"{prefix}.{key}" if prefix else key)]


ScenarioName = Annotated[
    str,
    typer.Argument(metavar="SCENARIO", help="A shipped scenario, or a YAML file.", autocompletion=_scenario_names),
]
OutFolder = Annotated[Path | None, typer.Option("--out", help="Folder for the results; by default out/SCENARIO.")]
Seed = Annotated[
    int | None,
    typer.Option("--seed", min=0, max=2**63 - 1, help="Seed of all noise, 63 bits; by default the scenario's."),
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="PATH=VALUE",
        help="Another value than the scenario's, as payload.mass_kg=2; may be repeated.",
        autocompletion=_setting_paths,
    ),
]
Duration = Annotated[
    float | None, typer.Option("--duration", metavar="SECONDS", help="Length of a run; by default the scenario's.")
]
Case = Annotated[str, typer.Option("--case", help="Which pilot: C1, C2, C3 or a rival.", autocompletion=_case_names)]
Json = Annotated[bool, typer.Option("--json", help="Print the same as JSON, for programs.")]
Quiet = Annotated[bool, typer.Option("--quiet", "-q", help="Say nothing but warnings and results.")]


class Engine(enum.StrEnum):
    """What moves the team in truth."""

    RIGID = "rigid"
    MUJOCO = "mujoco"


def _settings(
    name: str,
    changes: Sequence[str] | None,
    duration: float | None = None,
    seed: int | None = None,
    engine: Engine | None = None,
) -> Any:
    """The settings of a scenario with what is given changed; raises ScenarioError as `scenario.load`."""
    from colift import scenario

    given = {"duration_s": duration, "seed": seed}
    options = [f"{setting}={value}" for setting, value in given.items() if value is not None]
    requested = [*(changes or ()), *options]
    try:
        settings = scenario.load_scenario(name, requested)
    except scenario.ScenarioError as error:
        early = [] if duration is None else _ending_early(name, changes or (), duration)
        if not early:
            raise scenario.ScenarioError(_as_given(str(error), duration)) from None
        try:
            settings = scenario.load_scenario(name, [*requested, *early])
        except scenario.ScenarioError as still:
            raise scenario.ScenarioError(_as_given(str(still), duration)) from None
    if engine is not None and settings.physics.kind != engine:
        settings = settings.model_copy(update={"physics": {"kind": engine.value}})
    return settings


def _as_given(mistakes: str, duration: float | None) -> str:
    """The same, by the options that were given."""
    named = mistakes.replace("--set duration_s", "--duration").replace("--set seed", "--seed")
    if duration is None:
        return named
    lines = named.replace(f"duration_s = {duration:g}", f"--duration {duration:g}").splitlines()
    wrong = any(line.startswith("--duration") for line in lines)  # then nothing else is to be held against it
    return "\n".join(line for line in lines if not (wrong and f"exceed --duration {duration:g}" in line))


def _ending_early(name: str, changes: Sequence[str], duration: float) -> list[str]:
    """What to set so that learning ends with a run that is shorter than it, which is said; nothing where it is not."""
    from colift import scenario

    try:
        learning = scenario.load_scenario(name, changes).learning
    except scenario.ScenarioError:  # what is wrong with it is said already
        return []
    if not learning.start_s + 1 / learning.sample_Hz <= duration < learning.end_s:
        return []
    times = [t for t in learning.update_times_s if t < duration]
    said = f"learning ends with the run, at {duration:g} s (learning.end_s is {learning.end_s:g})"
    if not times:
        said = f"nothing is learned in {duration:g} s: the first update is at {learning.update_times_s[0]:g} s"
    errors.print(f"warning: {said}", style="yellow", markup=False)
    return [f"learning.end_s={duration}", f"learning.update_times_s={times or [duration]}"]


@contextlib.contextmanager
def _opened(read: Callable[[], Any], out: Path | None, kept: str, suffix: str = "") -> Generator[tuple[Any, Any]]:
    """The settings that are read, and their folder, this process's alone in the block; by default out/NAME + suffix.

    What a person can mend, and a request to end, end the block with a line: of the latter with what is `kept`.
    """
    from colift import codegen, scenario
    from colift.runtime import run_directory
    from colift.workflows.study import CERTIFICATE_FILES, STUDY_FILES, open_run_directory

    signals.raise_if_interrupted()
    try:
        settings = read()
        with open_run_directory(settings, out or Path("out") / f"{settings.name}{suffix}") as folder:
            if run_directory.stale_files(folder, STUDY_FILES + CERTIFICATE_FILES):
                errors.print(f"{folder.path} holds results of another run: they are replaced", markup=False)
            try:
                yield settings, folder
            except signals.Interrupted:
                files = run_directory.list_files(folder.path, STUDY_FILES + CERTIFICATE_FILES)
                there = any(
                    run_directory.read_run_id(file) == folder.run_id for file in files
                )  # what has not ended has left nothing
                said = f"{kept} {folder.path}" if there else f"nothing was written to {folder.path}"
                errors.print(f"interrupted; {said}", style="yellow", markup=False)
                raise
    except (scenario.ScenarioError, codegen.CompilerError, OSError) as error:
        raise _fail(_one_line(error)) from None


def _one_line(error: Exception) -> str:
    """What went wrong; of a file, its name and the sentence without the number that the system has for it."""
    if not isinstance(error, OSError) or not error.strerror:
        return str(error)
    return error.strerror if error.filename is None else f"{error.filename}: {error.strerror}"


@contextlib.contextmanager
def _printed(where: str) -> Generator[None]:
    """What the block prints is read or said to be lost; a reader who has gone, as under `| head -1`, is no failure."""
    try:
        yield
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:
        _print_nowhere()
    except OSError as error:
        _print_nowhere()
        errors.print(f"cannot print: {_one_line(error)}{where}", style="red", markup=False)
        raise typer.Exit(EXIT_INCOMPLETE) from None


def _print_nowhere() -> None:
    """Python writes what is left in its buffer when it ends, and would fail again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextlib.contextmanager
def _stages(doing: str, quiet: bool = False) -> Generator[Callable[[str], None]]:
    """What is being done, and at which stage: on a line that changes, or, where it cannot, on a line each."""
    if quiet:
        yield lambda _stage: signals.raise_if_interrupted()
        return
    with errors.status(doing, spinner="line") as status:

        def say(stage: str) -> None:
            signals.raise_if_interrupted()
            if errors.is_terminal:
                status.update(f"{doing}: {stage}")
            else:
                errors.print(f"{doing}: {stage}", markup=False)

        if not errors.is_terminal:
            errors.print(doing, markup=False)
        yield say


@app.callback()
def _options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


@app.command("list")
def list_(as_json: Json = False) -> None:
    """List the shipped scenarios."""
    from colift import scenario

    found = {name: scenario.load_scenario(name).description for name in scenario.shipped_names()}
    with _printed(""):
        if as_json:
            print(json.dumps(found, indent=2))
        else:
            print("\n".join(f"{name:16} {description}" for name, description in found.items()))


@app.command()
def show(name: ScenarioName, changes: Changes = None, as_json: Json = False) -> None:
    """Print a scenario: a shipped one as it is written, another, or one that is changed, with every setting."""
    from colift import scenario

    try:
        as_written = name in scenario.shipped_names() and not changes
        if as_json:
            text = _settings(name, changes).model_dump_json(indent=2) + "\n"
        else:
            text = scenario.shipped_text(name) if as_written else scenario.to_yaml(_settings(name, changes))
    except scenario.ScenarioError as error:
        raise _fail(str(error)) from None
    with _printed(""):
        print(text, end="")


@app.command()
def doctor(as_json: Json = False) -> None:
    """Say what colift runs on: versions, compiler, caches, GPU; and whether native code computes what JAX does."""
    from colift.cli.doctor import format_report, run_diagnostics

    found = run_diagnostics()
    with _printed(""):
        for line in [json.dumps(found, indent=2)] if as_json else format_report(found):
            print(line)
    if found["problems"]:
        raise typer.Exit(EXIT_FAILED_CHECK)


def _write_new(file: Path, text: str) -> None:
    """Raises OSError where there is such a file."""
    with file.open("x", encoding="utf-8") as opened:
        opened.write(text)


@app.command()
def new(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="The file to write, as my_team.yaml.")],
    agents: Annotated[int, typer.Option("--agents", help="How many.")] = 2,
    arms: Annotated[
        int | None, typer.Option("--arms", help="Of each: 0 (it holds the payload itself), 1 or 2; by default 2.")
    ] = None,
    urdf: Annotated[
        Path | None, typer.Option("--urdf", metavar="FILE", help="Read the vehicle from a URDF file instead.")
    ] = None,
) -> None:
    """Write a commented scenario to begin with; `colift check` says whether it, or what becomes of it, is sound."""
    from colift import scenario
    from colift.scenario import template

    try:
        if file.suffix not in scenario.SUFFIXES:
            raise _fail(f"{file}: must end in {' or '.join(scenario.SUFFIXES)}")
        if urdf is not None and arms is not None:
            raise _fail(f"--arms {arms}: must be left out with --urdf, whose file says which arms there are")
        name = template.scenario_name(file)
        if urdf is None:
            text = template.scenario_template(name, agents, 2 if arms is None else arms)
        else:
            text = template.from_urdf(name, agents, urdf, file.parent)
        if file.exists():
            raise _fail(f"{file}: exists; it is not overwritten")
        _write_new(file, text)
    except (ValueError, OSError) as error:
        raise _fail(_one_line(error)) from None
    with _printed(""):
        print(f"{file}: {agents} agents; next: colift check {shlex.quote(str(file))}")


@app.command()
def check(name: ScenarioName, changes: Changes = None, quiet: Quiet = False, as_json: Json = False) -> None:
    """Build a scenario, linearize its loop, and say whether it is sound and what to change where it is not.

    Mass, contacts, thrust, joints, slowest mode, delay margin. Status 0: sound; 1: something is bad; 2: not read.
    """
    from colift import scenario
    from colift.analysis import preflight

    signals.raise_if_interrupted()
    try:
        settings = _settings(name, changes)
        with _stages(f"checking {settings.name}", quiet) as say:
            found = preflight.run_preflight(settings, say)
    except (scenario.ScenarioError, OSError) as error:
        raise _fail(_one_line(error)) from None
    with _printed(""):
        if as_json:
            print(json.dumps(found.summary, indent=2))
        else:
            for line in found.format_report():
                print(line)
    if not found.passed:
        raise typer.Exit(EXIT_FAILED_CHECK)


@app.command()
def tune(
    name: ScenarioName,
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The scenario to write; it must not exist yet.")],
    changes: Changes = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Choose a scenario's gains: what disturbs dies out soon, also with commands that come late, and moves little.

    Prints modes and margins before and after, and writes the scenario with the gains found; no file is overwritten.
    Takes some minutes; ended early, by Ctrl-C, it writes the best gains so far.
    """
    from colift import scenario
    from colift.analysis import gain_tuning

    signals.raise_if_interrupted()
    try:
        if out.suffix not in scenario.SUFFIXES:
            raise _fail(f"--out {out}: must end in {' or '.join(scenario.SUFFIXES)}")
        if out.exists():
            raise _fail(f"--out {out}: exists; it is not overwritten")
        if not (out.parent.is_dir() and os.access(out.parent, os.W_OK)):
            raise _fail(f"--out {out}: the folder {out.parent} is not there, or cannot be written to")
        settings, written = _settings(name, changes), None
        if not changes and name in scenario.shipped_names():
            written = scenario.shipped_text(name)
        elif not changes:
            written = Path(name).expanduser().read_text(encoding="utf-8-sig")
        best: list[Any] = []
        try:
            with _stages(f"tuning {settings.name}", quiet) as say:
                before, after, spent = gain_tuning.tune(settings, say, best.append)
                best.append(after)
                say("flights with both")
                old, new = gain_tuning.summary_values(before), gain_tuning.summary_values(after)
        except signals.Interrupted:
            if best:
                _write_new(out, gain_tuning.to_yaml(best[-1].settings, written, str(out)))
            said = f"the best gains so far are in {out}" if best else f"there is nothing to write to {out} yet"
            errors.print(f"interrupted; {said}", style="yellow", markup=False)
            raise
        _write_new(out, gain_tuning.to_yaml(after.settings, written, str(out)))
    except (scenario.ScenarioError, ValueError, OSError) as error:
        raise _fail(_one_line(error)) from None
    with _printed(""):
        if as_json:
            found = {"before": old, "after": new, **spent._asdict()}
            print(json.dumps(found | {"control": after.settings.model_dump(mode="json")["control"]}, indent=2))
        else:
            said = gain_tuning.format_report(before, after, old, new, spent)
            print("\n".join([*said, f"{settings.name} with these gains is in {out}"]))


ByEngine = Annotated[
    Engine | None,
    typer.Option("--engine", help="Our rigid contacts, or MuJoCo (extra mujoco); by default the scenario's."),
]


@app.command()
def study(
    name: ScenarioName,
    out: OutFolder = None,
    changes: Changes = None,
    duration: Duration = None,
    seed: Seed = None,
    baselines: Annotated[
        bool,
        typer.Option(
            "--baselines",
            help="Also fly the rivals: I (integral), DOB (observer), P (parametric), F (filtered labels), "
            "R (regression), H (C3 and filtered labels), O (residuals known).",
        ),
    ] = False,
    cases: Annotated[
        str | None, typer.Option("--cases", help="Which cases to fly, as C1,C3,C4; by default C1, C2 and C3.")
    ] = None,
    held_out: Annotated[
        bool,
        typer.Option(
            "--heldout",
            help="Also fly the map that each case ended with, frozen, on paths that it has not seen.",
        ),
    ] = False,
    engine: ByEngine = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Fly a scenario under C1 (no learning), C2 (payload) and C3 (payload and agents), and compare them.

    C4, which goes on learning and reacts, is flown where `--cases` names it.

    Writes one NetCDF file a case, figures 1 to 5 as PDF and PNG, the table of length-scales and summary.json.
    """
    from colift.scenario import experiment

    requested = list(experiment.PAPER_CASES) if cases is None else [case.strip() for case in cases.split(",")]
    for case in requested:
        _require_known(case, "--cases")
    wanted = dict.fromkeys([*requested, *(experiment.BASELINES if baselines else ())])
    read = functools.partial(_settings, name, changes, duration, seed, engine)
    _fly(read, tuple(wanted), out, quiet, as_json, held_out=held_out)


@app.command()
def run(
    name: ScenarioName,
    case: Case = "C3",
    out: Annotated[Path | None, typer.Option("--out", help="Folder for results; by default out/SCENARIO-CASE.")] = None,
    changes: Changes = None,
    duration: Duration = None,
    seed: Seed = None,
    engine: ByEngine = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Fly a scenario under one case, and save it as `study` does."""
    _require_known(case)
    read = functools.partial(_settings, name, changes, duration, seed, engine)
    _fly(read, (case,), out, quiet, as_json, f"-{case}")


def _require_known(case: str, option: str = "--case") -> None:
    from colift.scenario import experiment

    if case not in experiment.ALL_CASES:
        raise _fail(f"{option} {case}: must be one of {', '.join(experiment.ALL_CASES)}")


def _fly(
    read: Callable[[], Any],
    cases: tuple[str, ...],
    out: Path | None,
    quiet: bool,
    as_json: bool,
    suffix: str = "",
    held_out: bool = False,
) -> None:
    """Fly the cases of the settings that are read, save and print them; the folder is named after them and `suffix`."""
    from colift.analysis import feasibility
    from colift.scenario import experiment
    from colift.workflows import generalization

    with _opened(read, out, "the cases that had ended are in", suffix) as (settings, folder):
        with _stages(f"preparing {settings.name}", quiet) as say:
            ready = experiment.make_experiments(settings, cases)
            heldout = generalization.heldout_experiments(settings, cases) if held_out else {}
            say("its loop at rest")
            ahead = feasibility.assess_feasibility(settings, ready)
        with _printed(""):
            _report_outlook(ahead, quiet or as_json)
        summary = _with_progress(settings, folder, ready, ahead, heldout, quiet)
    with _printed(f"; the results are in {folder.path}"):
        if as_json:
            print(json.dumps(summary, indent=2))
        else:
            _report(summary, folder.path)
    if any(not found["complete"] for found in summary["cases"].values()):
        raise typer.Exit(EXIT_INCOMPLETE)


def _report_outlook(preview: Any, warnings_only: bool) -> None:
    """What is known before the flights."""
    if not warnings_only and preview.modes is not None and preview.modes.stable:
        print(f"slowest mode at rest on the reference: {preview.modes.describe_slowest()}", flush=True)
    if not warnings_only and preview.margins is not None:
        print(preview.margins.describe(), flush=True)
    for text in preview.warnings:
        errors.print(f"warning: {text}", style="yellow", markup=False)


def _with_progress(
    settings: Any, folder: Any, ready: dict[str, Any], preview: Any, heldout: dict[str, Any], quiet: bool
) -> dict[str, Any]:
    """Fly with a bar a case; where bars cannot be drawn, with a line every few seconds; where it is quiet, neither."""
    from colift.scenario import experiment
    from colift.workflows import generalization
    from colift.workflows import study as study_module

    known = {case: experiment.ALL_CASES[case] for case in ready}
    if heldout:
        known |= generalization.titles(known)
    if quiet:
        return study_module.run_study(settings, folder, ready, preview, heldout=heldout)
    if not errors.is_terminal:
        return study_module.run_study(settings, folder, ready, preview, _lines(known, settings.duration_s), heldout)
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:5.1f} of {task.total:g} s"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=errors) as bars:
        tasks = {
            case: bars.add_task(f"{case:3} {what}", total=settings.duration_s, start=False)
            for case, what in known.items()
        }

        def progress(case: str, t: float) -> None:
            if t == 0.0:
                bars.start_task(tasks[case])
            bars.update(tasks[case], completed=t)

        return study_module.run_study(settings, folder, ready, preview, progress, heldout)


def _lines(known: dict[str, str], duration: float) -> Callable[[str, float], None]:
    """Progress in lines: one when a case begins, then at most one in `EVERY`."""
    said = -math.inf

    def progress(case: str, t: float) -> None:
        nonlocal said
        context = time.monotonic()
        if t == 0.0:
            errors.print(f"{case}: {known[case]}, {duration:g} s to fly", markup=False)
        elif context - said >= PROGRESS_PERIOD or t >= duration:
            errors.print(f"{case}: {t:.1f} of {duration:g} s", markup=False)
        else:
            return
        said = context

    return progress


COLUMNS = (  # heading, unit, key in the summary, scale, format
    ("e_p", "mm", "e_p_rms_m", 1e3, ".1f"),
    ("e_R", "mrad", "e_R_rms", 1e3, ".1f"),
    ("Ψ", "1e-6", "Psi_mean", 1e6, ".1f"),
    ("ΔW", "N", "delta_W_force_rms_N", 1.0, ".2f"),
    ("ΔW", "N m", "delta_W_moment_rms_Nm", 1.0, ".2f"),
    ("e_λ", "N", "e_lam_rms_N", 1.0, ".2f"),
    ("σ_L", "N", "sigma_L_force_mean", 1.0, ".2f"),
    ("σ_A", "N", "sigma_A_force_mean", 1.0, ".2f"),
    ("λ", "max N", "lam_max_N", 1.0, ".1f"),
    ("u", "max N", "thrust_max_N", 1.0, ".1f"),
)


def _report(summary: dict[str, Any], folder: Path) -> None:
    """What failed, then the one table at the end."""
    for case, found in summary["cases"].items():
        if not found["complete"]:
            errors.print(f"{case} is incomplete: {found['stopped']}", style="red", markup=False)
    tables.show(_merits_table(summary))
    if "heldout" in summary:
        tables.show(_heldout_table(summary))
    for case, found in summary["cases"].items():
        for text in found["warnings"]:
            errors.print(f"warning: {case}: {text}", style="yellow", markup=False)
    print(f"results in {folder}")


def _merits_table(summary: dict[str, Any]) -> Any:
    """Second half of the run, RMS, mean or largest."""
    from rich.box import SIMPLE_HEAD

    table = Table(
        title=f"{summary['scenario']}, seed {summary['seed']}: second half of the run",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("case\n", no_wrap=True)
    for heading, unit, *_ in COLUMNS:
        table.add_column(f"{heading}\n{unit}", justify="right", no_wrap=True)
    for case, found in summary["cases"].items():
        table.add_row(case, *(tables.cell(found[key], scale, spec) for _, _, key, scale, spec in COLUMNS))
    return table


def _heldout_table(summary: dict[str, Any]) -> Any:
    """RMS position errors on paths that no map has seen, beside those on the path that it was learned on."""
    from rich.box import SIMPLE_HEAD

    found = summary["heldout"]
    paths = list(next(iter(found.values())))
    table = Table(title="e_p, mm, with the map of the end, frozen", box=SIMPLE_HEAD, padding=(0, 1, 0, 0))
    for heading in ("case", "learned on", *paths):
        table.add_column(heading, justify="left" if heading == "case" else "right", no_wrap=True)
    for case, there in found.items():
        errors_m = [summary["cases"][case]["e_p_rms_m"], *(there[path]["e_p_rms_m"] for path in paths)]
        table.add_row(case, *("stopped" if e is None else f"{1e3 * e:.1f}" for e in errors_m))
    return table


@app.command()
def certify(
    name: ScenarioName,
    out: OutFolder = None,
    changes: Changes = None,
    duration: Duration = None,
    seed: Seed = None,
    adversary: Annotated[
        bool, typer.Option("--adversary", help="Also fly the worst unknown forces that norm and data allow.")
    ] = False,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Bound the ultimate tracking errors of a scenario under C3, beside what is observed (docs/certificate.md).

    Flies the scenario and its twin, whose world obeys the learned means. Writes certificate.json and figure 6.
    Status 1 if an observed error is above its radius.
    """
    from colift.workflows import certification

    read = functools.partial(_settings, name, changes, duration, seed)
    with _opened(read, out, "no certificate was written to") as (settings, folder):
        try:
            with _stages(f"certifying {settings.name}", quiet) as say:
                made = certification.certify(settings, progress=say)
                against = certification.test_with_adversary(made, progress=say) if adversary else None
                summary = certification.save_certificate(settings, made, against, folder, say)
        except ValueError as error:
            raise _fail(str(error)) from None
    with _printed(f"; the results are in {folder.path}"):
        if as_json:
            print(json.dumps(summary, indent=2))
        else:
            _report_certificate(summary, folder.path)
    if summary["exceeded"]:
        raise typer.Exit(EXIT_VIOLATION)


@app.command()
def attack(
    name: ScenarioName,
    out: OutFolder = None,
    changes: Changes = None,
    duration: Duration = None,
    seed: Seed = None,
    rounds: Annotated[
        int, typer.Option("--rounds", min=1, help="Rounds; in each, every kind of try is drawn anew.")
    ] = 1,
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="TRY", help="Only this try, as 'worst e_p 0'; repeatable.")
    ] = None,
    quiet: Quiet = False,
    as_json: Json = False,
) -> None:
    """Search for a violation of a printed radius (docs/certificate.md, "The attack").

    Flies unknown forces that keep norm and labels against the radii for any run of the scenario under C3, and other
    seeds, updates, starts, paths, noise, rates and thrust limits against their own. Prints the worst ratio of each
    error and how to repeat it; writes attack.json, try by try. Status 1 if a radius is exceeded.
    """
    from colift.runtime import atomic_write
    from colift.workflows import falsification

    read = functools.partial(_settings, name, changes, duration, seed)
    done: list[Any] = []
    held: Any = None
    with _opened(read, out, "the tries that had ended are in", "-attack") as (settings, folder):
        requested = only or falsification.trial_names(settings, rounds)
        try:
            with _stages(f"attacking {settings.name}", quiet) as say:
                for one in falsification.falsify(settings, requested, say):
                    done.append(one)
                    held = atomic_write.write_json_atomic(
                        _tried(folder.run_id, settings, done), folder.path / "attack.json"
                    )
        except ValueError as error:
            raise _fail(str(error)) from None
    given = [word for change in changes or () for word in ("--set", change)]
    given += [] if duration is None else ["--duration", f"{duration:g}"]
    with _printed(f"; the results are in {folder.path}"):
        if as_json:
            print(json.dumps(held, indent=2))
        else:
            _report_attack(done, name, given, settings.seed, folder.path)
    if any(one.is_violated for one in done):
        raise typer.Exit(EXIT_VIOLATION)


def _tried(run: str, settings: Any, done: Sequence[Any]) -> dict[str, Any]:
    """What `attack.json` holds."""
    tries = [dataclasses.asdict(one) for one in done]
    return {"run": run, "scenario": settings.name, "seed": settings.seed, "version": version("colift"), "tries": tries}


def _report_attack(done: Sequence[Any], name: str, given: Sequence[str], seed: int, folder: Path) -> None:
    """A row for each try, then the worst ratio of each error and how to repeat it."""
    from rich.box import SIMPLE_HEAD

    table = Table(title=f"{name}: observed over radius", box=SIMPLE_HEAD, padding=(0, 1, 0, 0), pad_edge=False)
    table.add_column("try", no_wrap=True)
    for error in SCALES:
        table.add_column(error.replace("omega", "ω"), justify="right", no_wrap=True)
    table.add_column("beyond span", justify="right", no_wrap=True)
    for one in done:
        left = f"{one.violations} of {one.num_components}" if one.ratios else ""
        table.add_row(one.name, *(tables.cell(one.ratios.get(error), 1.0, ".3f") for error in SCALES), left)
    tables.show(table)
    for one in done:
        if one.message:
            print(f"{one.name}: {one.message}")
    for error in SCALES:
        held = [one for one in done if error in one.ratios]
        if held:
            worst = max(held, key=lambda one: one.ratios[error])
            print(f"{error}: worst {worst.ratios[error]:.3f}, colift {_again(worst, name, given, seed)}")
    held, broken = [one for one in done if one.ratios], [one.name for one in done if one.is_violated]
    print(f"{len(broken)} of {len(held)} tries that have radii break one{': ' if broken else ''}{', '.join(broken)}")
    print(f"results in {folder}")


def _again(one: Any, name: str, given: Sequence[str], seed: int) -> str:
    """The command that repeats a try of the attack on a scenario with such changes and seed."""
    seeds = [change for change in one.changes if change.startswith("seed=")]
    others = [change for change in one.changes if change not in seeds]
    sets = [*given, *(word for change in others for word in ("--set", change))]
    only = [] if one.changes else ["--only", one.name]
    number = seeds[0].removeprefix("seed=") if seeds else str(seed)
    return shlex.join(["certify" if one.changes else "attack", name, *sets, "--seed", number, *only])


Results = Annotated[Path, typer.Argument(metavar="OUT", help="A folder that `colift study` wrote.")]
Open = Annotated[bool, typer.Option("--open", help="Open it in a browser.")]


@app.command()
def view(
    out: Results,
    show: Open = False,
    picture: Annotated[
        Path | None, typer.Option("--picture", metavar="FILE", help="Write a picture instead: PNG, PDF or SVG.")
    ] = None,
    at: Annotated[float, typer.Option("--at", metavar="SECONDS", help="When, in the flight, the picture is.")] = 0.0,
    film: Annotated[
        Path | None, typer.Option("--film", metavar="FILE", help="Write a film instead: GIF, or MP4 by ffmpeg.")
    ] = None,
    speed: Annotated[float, typer.Option("--speed", min=0.1, max=20, help="Of the film, to the flight's.")] = 1.0,
    case: Annotated[
        list[str] | None,
        typer.Option("--case", help="In a picture or film; may be repeated.", autocompletion=_case_names),
    ] = None,
) -> None:
    """Play the flights of a study: one page, OUT/view.html, which needs no network (docs/playback.md)."""
    from colift.scenario import experiment
    from colift.visualization import playback

    known = experiment.ALL_CASES
    try:
        if picture or film:
            _draw(out, case or ["C3"], known, picture, at, film, speed)
            return
        page = playback.write(out, known)
    except (ValueError, OSError) as error:
        raise _fail(_one_line(error)) from None
    _tell(f"the flights are in {page}", page, show)


def _draw(
    out: Path, cases: list[str], known: dict[str, str], still: Path | None, at: float, film: Path | None, speed: float
) -> None:
    """Write a picture or a film of some cases; raises as `picture.still` and `picture.film`."""
    from colift.closed_loop import log
    from colift.visualization import rendering

    for case in cases:
        _require_known(case)
    _, found = log.load_flights(out, known)
    if missing := [case for case in cases if case not in found]:
        raise ValueError(f"{out} holds {', '.join(found)}, not {', '.join(missing)}: choose by --case")
    seen = [rendering.render_data(found[case], f"{case}: {known[case]}") for case in cases]
    if still:
        rendering.render_image(seen, at, still)
    if film:
        with _stages(f"drawing {film}"):
            rendering.render_video(seen, film, speed)
    with _printed(""):
        print(f"{', '.join(cases)}: {', '.join(str(file) for file in (still, film) if file)}")


def _tell(said: str, page: Path, show: bool) -> None:
    """Say where a page is, and open it if that is asked."""
    import webbrowser

    with _printed(""):
        print(said)
    if show and not webbrowser.open(page.resolve().as_uri()):
        raise _fail("there is no browser to open it in")


@app.command()
def report(out: Results, show: Open = False) -> None:
    """Write a study as one page to read: OUT/report.html, which needs no network (docs/playback.md).

    What was run, what to beware of, the table, the figures, the certificate if there is one, and the flights, played.
    """
    from colift.scenario import experiment
    from colift.visualization.report import write_report

    try:
        page = write_report(
            out, experiment.ALL_CASES, _merits_table, lambda made: (_radii_table(made), _rests_on(made))
        )
    except (ValueError, OSError) as error:
        raise _fail(_one_line(error)) from None
    _tell(f"the report is {page}", page, show)


@app.command()
def watch(
    name: ScenarioName,
    case: Case = "C3",
    changes: Changes = None,
    duration: Duration = None,
    seed: Seed = None,
    show: Open = False,
) -> None:
    """Fly one case and see it while it flies: a page that this computer alone can open, until Ctrl-C.

    Nothing is written; `colift run` and `colift view` keep a flight.
    """
    import webbrowser

    from colift import codegen, scenario
    from colift.scenario import experiment
    from colift.visualization import live_view

    def ready(address: str) -> None:
        with _printed(""):
            print(f"{case} of {settings.name}: {address} (Ctrl-C ends it)", flush=True)
        if show:
            webbrowser.open(address)

    signals.raise_if_interrupted()
    _require_known(case)
    try:
        settings = _settings(name, changes, duration, seed)
        told = experiment.ALL_CASES[case]
        with live_view.serve_live_flight(
            settings, experiment.make_experiment(settings, case), case, told, ready
        ) as flight:
            with _printed(""):
                print(
                    f"the flight has ended{': ' if flight.termination_reason else ''}{flight.termination_reason}",
                    flush=True,
                )
            while True:  # a reader may still look at it
                signals.raise_if_interrupted()
                time.sleep(0.1)
    except (scenario.ScenarioError, codegen.CompilerError, OSError) as error:
        raise _fail(_one_line(error)) from None


@export.command("mjcf")
def _export_mjcf(
    name: ScenarioName,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="File to write; by default standard output.")
    ] = None,
    changes: Changes = None,
) -> None:
    """The true team at its start as an MJCF model, which MuJoCo opens and simulates (docs/plant.md)."""
    from colift import scenario
    from colift.models import mjcf
    from colift.runtime import atomic_write
    from colift.scenario import initial_states, team

    try:
        settings = _settings(name, changes)
        truth, _ = team.team(settings)
        names = (team.agent_names(settings), team.joint_names(settings), team.contact_names(settings))
        text = mjcf.to_mjcf(truth, initial_states.initial_state(settings, truth), *names)
        if out is not None:
            atomic_write.write_atomic(out, text.encode())
    except (scenario.ScenarioError, OSError) as error:
        raise _fail(_one_line(error)) from None
    with _printed(""):
        print(text if out is None else f"{settings.name} is in {out}", end="" if out is None else "\n")


@export.command("urdf")
def _export_urdf(
    name: ScenarioName,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Folder to write; by default out/SCENARIO-urdf.")
    ] = None,
    changes: Changes = None,
) -> None:
    """Each type of agent of the true team as a URDF file, its contact points as links."""
    from colift import scenario
    from colift.models import urdf
    from colift.runtime import atomic_write
    from colift.scenario import team

    try:
        settings = _settings(name, changes)
        folder = out or Path("out") / f"{settings.name}-urdf"
        folder.mkdir(parents=True, exist_ok=True)
        for kind, agent in team.agent_models(settings).items():
            told = settings.agent_types[kind]
            text = urdf.to_urdf(kind, agent, [joint.name for joint in told.joints], [arm.name for arm in told.arms])
            atomic_write.write_atomic(folder / f"{kind}.urdf", text.encode())
    except (scenario.ScenarioError, OSError) as error:
        raise _fail(_one_line(error)) from None
    with _printed(""):
        print(f"{', '.join(f'{kind}.urdf' for kind in team.agent_models(settings))} of {settings.name}: in {folder}")


Flown = Annotated[Path, typer.Argument(metavar="OUT", help="A folder that `colift study` or `colift run` wrote.")]


@export.command("csv")
def _export_csv(out: Flown) -> None:
    """The flights of a folder as CSV beside them: a row a tick, every signal a column with its unit."""
    from colift.closed_loop import log

    _write_beside(out, "csv", lambda ds: log.to_csv(ds).encode())


@export.command("mcap")
def _export_mcap(out: Flown) -> None:
    """The flights of a folder as ROS 2 bags beside them: poses, wrenches, joint states, /tf (the extra mcap)."""
    try:
        from colift.integrations import ros2_bag
    except ModuleNotFoundError as error:
        raise _fail(str(error)) from None

    _write_beside(out, "mcap", ros2_bag.to_mcap)


def _write_beside(out: Path, kind: str, document: Callable[[Any], bytes]) -> None:
    """Each flight of a folder in another format, under its case's name."""
    from colift.closed_loop import log
    from colift.runtime import atomic_write, run_directory
    from colift.scenario import experiment

    try:
        run, found = log.load_flights(out, tuple(experiment.ALL_CASES))
        files = {f"{case}.{kind}": ds for case, ds in found.items()}
        with run_directory.lock_run_directory(out, run, tuple(files)):
            for file, ds in files.items():
                signals.raise_if_interrupted()
                atomic_write.write_atomic(out / file, document(ds))
    except (ValueError, OSError) as error:
        raise _fail(_one_line(error)) from None
    with _printed(""):
        print(f"{', '.join(files)}: in {out}")


@export.command("c")
def _export_c(
    name: ScenarioName,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Folder to write; by default out/SCENARIO-c.")
    ] = None,
    case: Case = "C3",
    changes: Changes = None,
    duration: Duration = None,
    seed: Seed = None,
    ticks: Annotated[int, typer.Option("--ticks", min=1, help="Ticks of the flight to replay.")] = 2000,
) -> None:
    """The pilot's tick as C99, with what it learns in a flight that is flown first, and a replay to check it by.

    No allocation, no threads, nothing but the math library; cmake builds it. Not flown on hardware. The code is yours.
    """
    from colift import codegen, scenario
    from colift.closed_loop.flight import run_experiment
    from colift.integrations import c_export
    from colift.scenario import experiment

    signals.raise_if_interrupted()
    try:
        settings = _settings(name, changes, duration, seed)
        _require_known(case)
        folder = out or Path("out") / f"{settings.name}-c"
        with _stages(f"{settings.name}, {case}, as C") as say:
            flight_experiment = experiment.make_experiment(settings, case)
            say("the flight that it learns in")
            flight = run_experiment(flight_experiment)
            if flight.termination_reason:
                raise _fail(f"{case} is incomplete, so there is nothing to take along: {flight.termination_reason}")
            say("the code")
            c_export.export_c(
                flight_experiment, flight.model, ticks, folder, f"{settings.name}, {case}, seed {settings.seed}"
            )
    except (scenario.ScenarioError, codegen.CompilerError, codegen.UnsupportedPrimitive, OSError) as error:
        raise _fail(_one_line(error)) from None
    with _printed(""):
        print(f"{case} of {settings.name} is in {folder}: cmake -S {folder} -B build && cmake --build build &&")
        print(f"build/replay {folder}/flight.bin")


SCALES = {"e_p": (1e3, "mm"), "e_v": (1e3, "mm/s"), "e_R": (1e3, "1e-3"), "e_omega": (1e3, "mrad/s")}
RADIUS_KIND_LABELS = {
    "tube": "any",
    "run": "this",
}  # of a radius: for any run in the tube, or for the one that was flown


def _report_certificate(found: dict[str, Any], folder: Path) -> None:
    """Errors above a radius first; then radii by bound beside what was observed, and where the slack of e_p comes from.

    A bound without a radius, or a reasoning without one, has no row.
    """
    for line in _broken(found["exceeded"]):
        errors.print(line, style="red", markup=False)
    tables.show(_radii_table(found), lead=2)
    for line in _rests_on(found):
        print(line)
    if found["adversary"]:
        print(f"radius / worst unknown that fits the data: {found['adversary']['radius_over_adversary']:.3f}")
    print("\nradius of e_p by reasoning, mm:")
    for cause, radius in found["slack_m"].items():
        if radius is not None:
            print(f"  {tables.cell(radius, 1e3, '.3g'):>8}  {cause}")
    print(f"results in {folder}")


def _rests_on(found: dict[str, Any]) -> list[str]:
    """What the radii that there are assume, and which there are not."""
    shown = [
        bound
        for bound, radii in found["radii"].items()
        if any(_has_radius(radii[where]) for where in RADIUS_KIND_LABELS)
    ]
    return [*_assumes({bound: found["radii"][bound]["assumed"] for bound in shown}), *_missing(found)]


def _broken(exceeded: list[dict[str, Any]]) -> list[str]:
    """A line for every error of a flight that is above a radius, with all such radii."""
    lines: dict[tuple[str, str], str] = {}
    for each in exceeded:
        scale, unit = SCALES[each["error"]]
        run = "the adversary's run" if each["flight"] == "adversary" else "this run"
        start = f"{each['error']} of {run} is above its radius: observed {each['observed'] * scale:.4g} {unit}, radius"
        line = lines.get((run, each["error"]), "")
        radius = f"{each['radius'] * scale:.4g} {unit} ({each['bound']}, {RADIUS_KIND_LABELS[each['of']]} run)"
        lines[run, each["error"]] = f"{line}, {radius}" if line else f"{start} {radius}"
    return list(lines.values())


def _has_radius(radii: dict[str, float | None]) -> bool:
    return any(radius is not None for radius in radii.values())


def _radii_table(found: dict[str, Any]) -> Any:
    from rich.box import SIMPLE_HEAD

    first, last = found["window_s"]
    table = Table(
        title=f"{found['scenario']}, seed {found['seed']}: greatest errors from {first:.1f} to {last:.1f} s",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )
    table.add_column("radius by\n", no_wrap=True)
    table.add_column("run\n", no_wrap=True)
    for error, (_, unit) in SCALES.items():
        table.add_column(f"{error.replace('omega', 'ω')}\n{unit}", justify="right", no_wrap=True)
    table.add_column("e_p,\nx seen", justify="right", no_wrap=True)
    table.add_column("is\n", no_wrap=True)
    for label, of in (("observed", "observed"), ("floor", "floor"), ("not of 1st order", "beyond_first_order")):
        if found[of]:
            table.add_row(label, "", *(_size(found[of][e], scale) for e, (scale, _) in SCALES.items()), "", "")
    broken = {(each["bound"], each["of"]) for each in found["exceeded"] if each["flight"] == "this"}
    for bound, radii in found["radii"].items():
        for where, label in RADIUS_KIND_LABELS.items():
            if _has_radius(radii[where]):
                status = "exceeded" if (bound, where) in broken else radii["status"]
                cells = [_size(radii[where][e], scale) for e, (scale, _) in SCALES.items()]
                ratio = tables.cell(radii["tightness"][where]["e_p"], 1.0, ".2g")
                table.add_row(bound, label, *cells, ratio, status)
    return table


def _size(value: float | None, scale: float) -> str:
    """With three digits, and all before the point: an exponent would take room from the columns beside it."""
    whole = value is not None and 1e3 <= value * scale < 1e5
    return tables.cell(value, scale, ".0f" if whole else ".3g")


def _assumes(names: dict[str, list[str]]) -> list[str]:
    """What all bounds assume, then what some assume in addition."""
    common = [name for name in next(iter(names.values()), []) if all(name in each for each in names.values())]
    lines = [f"assumed: {', '.join(common)}"] if common else []
    for bound, each in names.items():
        own = [name for name in each if name not in common]
        lines += [f"assumed by {bound} also: {', '.join(own)}"] if own else []
    return lines


def _missing(found: dict[str, Any]) -> list[str]:
    """Which radii there are not, and why; what the two kinds of run are."""
    lines = [f"{bound}: left out, {why}" for bound, why in found["left_out"].items()]
    if found["no_tube"]:
        some = any(_has_radius(radii["run"]) for radii in found["radii"].values())
        return [*lines, f"no radius{' for any run' if some else ''}: {found['no_tube']}"]
    return [*lines, "any run: known before it is flown; this: on the path it took"]


def main() -> None:
    """Entry point of the `colift` command."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # what a terminal has no letter for must not end a run
    try:
        with signals.handle_signals():
            app()
    except OSError as error:
        if error.filename is not None:  # not of standard output, as the help's is on a full disk
            raise
        _print_nowhere()
        errors.print(f"cannot print: {_one_line(error)}", style="red", markup=False)
        sys.exit(EXIT_INCOMPLETE)
    finally:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            with contextlib.suppress(ValueError):  # not on the main thread
                signal.signal(signal.SIGINT, signal.SIG_DFL)  # all is written: the interpreter may be cut short
