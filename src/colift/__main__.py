"""The command line: `colift study paper`, and what else a person asks of a scenario.

Heavy modules are imported by the commands that need them, so that `--help` answers at once.
"""

from __future__ import annotations

import sys
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console

app = typer.Typer(
    help="Cooperative transport of a rigid payload by aerial manipulators: simulate, control, learn, certify.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
errors = Console(stderr=True, soft_wrap=True, highlight=False)

BAD_INPUT, INCOMPLETE, INTERRUPTED = 2, 1, 130


def _fail(message: str) -> typer.Exit:
    errors.print(message, style="red", markup=False)
    return typer.Exit(BAD_INPUT)


def _show_version(asked: bool) -> bool:
    if asked:
        typer.echo(version("colift"))
        raise typer.Exit
    return asked


def _scenario_names(incomplete: str) -> list[str]:
    from colift import scenario

    return [name for name in scenario.names() if name.startswith(incomplete)]


@app.callback()
def _options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


@app.command()
def scenarios() -> None:
    """List the shipped scenarios."""
    from colift import scenario

    for name in scenario.names():
        typer.echo(f"{name:16} {scenario.load(name).description}")


@app.command()
def study(
    name: Annotated[
        str,
        typer.Argument(metavar="SCENARIO", help="A shipped scenario, or a YAML file.", autocompletion=_scenario_names),
    ],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; by default out/SCENARIO.")] = None,
    seed: Annotated[int | None, typer.Option(min=0, help="Seed of all noise; by default the scenario's.")] = None,
    baselines: Annotated[
        bool,
        typer.Option(
            "--baselines", help="Also fly the rivals: I (integral), DOB (observer), P (parametric), O (floor)."
        ),
    ] = False,
) -> None:
    """Fly a scenario under C1 (no learning), C2 (payload) and C3 (payload and agents), and compare them.

    Writes one NetCDF file a case, figures 1 to 5 as PDF and PNG, the table of length-scales and summary.json.
    """
    from colift import scenario

    try:
        settings = scenario.load(name)
    except scenario.ScenarioError as error:
        raise _fail(str(error)) from None
    if seed is not None:
        settings = settings.model_copy(update={"seed": seed})
    folder = out if out is not None else Path("out") / settings.name
    from colift import study as flights

    try:
        flights.prepare(folder)
    except OSError as error:
        raise _fail(f"cannot write to {folder}: {error.strerror or error}") from None
    cases = tuple(flights.CASES | (flights.BASELINES if baselines else {}))
    try:
        with errors.status(f"preparing {settings.name}"):
            ready = flights.plans(settings, cases)
        summary = _with_progress(settings, folder, ready)
    except scenario.ScenarioError as error:
        raise _fail(str(error)) from None
    except OSError as error:
        raise _fail(str(error)) from None
    except KeyboardInterrupt:
        errors.print(f"interrupted; the cases that had ended are in {folder}", style="yellow", markup=False)
        raise typer.Exit(INTERRUPTED) from None
    _report(summary, folder)
    if any(not case["complete"] for case in summary["cases"].values()):
        raise typer.Exit(INCOMPLETE)


def _with_progress(settings: Any, folder: Path, ready: dict[str, Any]) -> dict[str, Any]:
    from rich.progress import BarColumn, Progress, TextColumn, TimeElapsedColumn

    from colift import study as flights

    known = flights.CASES | flights.BASELINES
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn("{task.completed:5.1f} of {task.total:g} s"),
        TimeElapsedColumn(),
    )
    with Progress(*columns, console=errors) as bars:
        tasks = {
            case: bars.add_task(f"{case:3} {known[case]}", total=settings.duration_s, start=False) for case in ready
        }

        def progress(case: str, t: float) -> None:
            if t == 0.0:
                bars.start_task(tasks[case])
            bars.update(tasks[case], completed=t)

        return flights.run(settings, folder, ready, progress)


COLUMNS = (  # heading, unit, key in the summary, scale, format
    ("e_p", "mm", "e_p_rms_m", 1e3, ".1f"),
    ("e_R", "mrad", "e_R_rms", 1e3, ".1f"),
    ("Ψ", "1e-6", "Psi_mean", 1e6, ".0f"),
    ("ΔW", "N", "delta_W_force_rms_N", 1.0, ".2f"),
    ("ΔW", "N m", "delta_W_moment_rms_Nm", 1.0, ".2f"),
    ("e_λ", "N", "e_lam_rms_N", 1.0, ".2f"),
    ("σ_L", "", "sigma_L_mean", 1.0, ".2f"),
    ("σ_A", "", "sigma_A_mean", 1.0, ".2f"),
    ("λ", "max N", "lam_max_N", 1.0, ".1f"),
    ("u", "max N", "thrust_max_N", 1.0, ".1f"),
)


def _cell(value: float, scale: float, spec: str) -> str:
    return format(value * scale, spec if abs(value * scale) < 1e5 else ".0e")


def _report(summary: dict[str, Any], folder: Path) -> None:
    """The one table at the end: second half of the run, RMS, mean or largest."""
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

    table = Table(
        title=f"{summary['scenario']}, seed {summary['seed']}: second half of the run",
        box=SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
    )
    table.add_column("case\n", no_wrap=True)
    for heading, unit, *_ in COLUMNS:
        table.add_column(f"{heading}\n{unit}", justify="right", no_wrap=True)
    for case, found in summary["cases"].items():
        table.add_row(case, *(_cell(found[key], scale, spec) for _, _, key, scale, spec in COLUMNS))
    Console().print(table)
    for case, found in summary["cases"].items():
        if not found["complete"]:
            errors.print(f"{case} is incomplete: {found['stopped']}", style="red", markup=False)
    mode = summary["slowest_mode"]
    if mode["stable"]:
        typer.echo(f"slowest mode at the start: {mode['says']}")
    else:
        errors.print(f"warning: unstable at the start state: {mode['says']}", style="yellow", markup=False)
    typer.echo(f"results in {folder}")


def main() -> None:
    """Entry point of the `colift` command."""
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
