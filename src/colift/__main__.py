"""The command line: `colift study paper`, and what else a person asks of a scenario.

Heavy modules are imported by the commands that need them, so that `--help` answers at once.
"""

from __future__ import annotations

import math
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

BAD_INPUT, INCOMPLETE, EXCEEDED, INTERRUPTED = 2, 1, 1, 130


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


ScenarioName = Annotated[
    str,
    typer.Argument(metavar="SCENARIO", help="A shipped scenario, or a YAML file.", autocompletion=_scenario_names),
]
OutFolder = Annotated[Path | None, typer.Option("--out", help="Folder for the results; by default out/SCENARIO.")]
Seed = Annotated[
    int | None,
    typer.Option("--seed", min=0, max=2**63 - 1, help="Seed of all noise, 63 bits; by default the scenario's."),
]


def _opened(name: str, out: Path | None, seed: int | None) -> tuple[Any, Path]:
    """The settings of a scenario, under that seed if one is given, and its folder, which can be written to."""
    from colift import scenario

    try:
        settings = scenario.load(name)
    except scenario.ScenarioError as error:
        raise _fail(str(error)) from None
    if seed is not None:
        settings = settings.model_copy(update={"seed": seed})
    folder = out or Path("out") / settings.name
    from colift import study as flights

    try:
        flights.prepare(folder)
    except OSError as error:
        raise _fail(f"cannot write to {folder}: {error.strerror or error}") from None
    return settings, folder


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
    name: ScenarioName,
    out: OutFolder = None,
    seed: Seed = None,
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
    settings, folder = _opened(name, out, seed)
    from colift import scenario
    from colift import study as flights

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


def _cell(value: float | None, scale: float, spec: str) -> str:
    if value is None or not math.isfinite(value):
        return "none"
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


@app.command()
def certify(
    name: ScenarioName,
    out: OutFolder = None,
    seed: Seed = None,
    adversary: Annotated[
        bool, typer.Option("--adversary", help="Also fly the worst unknown forces that norm and data allow.")
    ] = False,
) -> None:
    """Bound the ultimate tracking errors of a scenario under C3, beside what is observed (docs/certificate.md).

    Flies the scenario and its twin, whose world obeys the learned means. Writes certificate.json and figure 6.
    Status 1 if an observed error is above its radius.
    """
    settings, folder = _opened(name, out, seed)
    from colift import scenario
    from colift import study as flights

    try:
        with errors.status(f"certifying {settings.name}") as status:
            say = lambda what: status.update(f"certifying {settings.name}: {what}")  # noqa: E731
            made = flights.certify(settings, progress=say)
            against = flights.challenge(made, progress=say) if adversary else None
            summary = flights.save_certificate(settings, made, against, folder, say)
    except (scenario.ScenarioError, OSError, ValueError) as error:
        raise _fail(str(error)) from None
    except KeyboardInterrupt:
        errors.print("interrupted; nothing was written", style="yellow", markup=False)
        raise typer.Exit(INTERRUPTED) from None
    _report_certificate(summary, folder)
    if summary["exceeded"]:
        raise typer.Exit(EXCEEDED)


SCALES = {"e_p": (1e3, "mm"), "e_v": (1e3, "mm/s"), "e_R": (1e3, "1e-3"), "e_omega": (1e3, "mrad/s")}
WHERE = {"tube": "any", "run": "this"}  # of a radius: for any run in the tube, or for the one that was flown


def _report_certificate(found: dict[str, Any], folder: Path) -> None:
    """Errors above a radius first; then radii by bound beside what was observed, and where the slack of e_p comes from.

    A bound without a radius, or a reasoning without one, has no row.
    """
    for line in _broken(found["exceeded"]):
        errors.print(line, style="red", markup=False)
    Console().print(_radii_table(found))
    shown = [bound for bound, radii in found["radii"].items() if any(_has_radius(radii[where]) for where in WHERE)]
    for line in (*_assumes({bound: found["radii"][bound]["assumed"] for bound in shown}), *_missing(found)):
        typer.echo(line)
    if found["adversary"]:
        typer.echo(f"radius / worst unknown that fits the data: {found['adversary']['radius_over_adversary']:.3f}")
    typer.echo("\nradius of e_p by reasoning, mm:")
    for cause, radius in found["slack_m"].items():
        if radius is not None:
            typer.echo(f"  {_cell(radius, 1e3, '.3g'):>8}  {cause}")
    typer.echo(f"results in {folder}")


def _broken(exceeded: list[dict[str, Any]]) -> list[str]:
    """A line for every error of a flight that is above a radius, with all such radii."""
    lines: dict[tuple[str, str], str] = {}
    for each in exceeded:
        scale, unit = SCALES[each["error"]]
        run = "the adversary's run" if each["flight"] == "adversary" else "this run"
        start = f"{each['error']} of {run} is above its radius: observed {each['observed'] * scale:.4g} {unit}, radius"
        line = lines.get((run, each["error"]), "")
        radius = f"{each['radius'] * scale:.4g} {unit} ({each['bound']}, {WHERE[each['of']]} run)"
        lines[run, each["error"]] = f"{line}, {radius}" if line else f"{start} {radius}"
    return list(lines.values())


def _has_radius(radii: dict[str, float | None]) -> bool:
    return any(radius is not None for radius in radii.values())


def _radii_table(found: dict[str, Any]) -> Any:
    from rich.box import SIMPLE_HEAD
    from rich.table import Table

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
    for row in ("observed", "floor"):
        table.add_row(row, "", *(_cell(found[row][e], scale, ".3g") for e, (scale, _) in SCALES.items()), "", "")
    broken = {(each["bound"], each["of"]) for each in found["exceeded"] if each["flight"] == "this"}
    for bound, radii in found["radii"].items():
        for where, label in WHERE.items():
            if _has_radius(radii[where]):
                status = "exceeded" if (bound, where) in broken else radii["status"]
                cells = [_cell(radii[where][e], scale, ".3g") for e, (scale, _) in SCALES.items()]
                ratio = _cell(radii["tightness"][where]["e_p"], 1.0, ".2g")
                table.add_row(bound, label, *cells, ratio, status)
    return table


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
    try:
        app()
    except KeyboardInterrupt:
        sys.exit(INTERRUPTED)


if __name__ == "__main__":
    main()
