"""Entry point of the command line ``colift`` and the table of its commands.

Heavy modules are imported by the commands that use them, so that ``--help`` and completion respond without delay.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import inspect
import io
import json
import signal
import sys
from collections.abc import Callable
from importlib.metadata import version
from typing import Annotated, Any

try:
    import typer
    from typer.core import TyperGroup

    from colift.cli import campaign, certify, common, export, init, scenario, study, view
    from colift.runtime import signals
except KeyboardInterrupt:  # `main` does not handle signals yet
    sys.stderr.write("interrupted\n")
    sys.exit(130)

GC_THRESHOLD = 100_000
"""Allocations between garbage collections. With Python's 700 they take a tenth of the time that JAX needs to trace."""

RENAMED_COMMANDS = {"new": "init", "show": "print-config", "view": "playback", "watch": "live", "attack": "falsify"}
"""Commands of earlier versions and their present names, for error messages."""

SCENARIOS, SIMULATION, ERROR_BOUNDS = "Scenarios", "Simulation", "Error bounds"  # groups in the help page
RESULTS, INSTALLATION = "Results", "Installation"


class ColiftGroup(TyperGroup):
    """Group of commands that reports the present name of a renamed command."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that the first argument names; end with a hint for a command of an earlier version."""
        if args[0] in RENAMED_COMMANDS and args[0] not in self.commands:
            common.fail(f"no such command: `{args[0]}` is now `{RENAMED_COMMANDS[args[0]]}`")
        return super().resolve_command(ctx, args)


app = typer.Typer(
    cls=ColiftGroup,
    help="Cooperative transport of a rigid payload by aerial manipulators: simulation, control, learning, bounds.",
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)
campaign_app = typer.Typer(help="Simulate and compare many flights of a scenario.", no_args_is_help=True)
export_app = typer.Typer(help="Export a scenario or its flights to another format.", no_args_is_help=True)


def doctor(as_json: common.JsonOption = False) -> None:
    """Report versions, compiler, caches and devices, and test the generated native code against JAX.

    Status 1: there is a problem.
    """
    from colift.cli.doctor import format_report, run_diagnostics

    found = run_diagnostics()
    with common.guard_output():
        for line in [json.dumps(found, indent=2)] if as_json else format_report(found):
            print(line)
    if found["problems"]:
        common.exit_with(common.EXIT_FAILED_CHECK)


def _examples(*commands: str) -> str:
    """Return example commands as the last paragraph of a help page."""
    return "\n".join(("Examples:", *(f"$ {command}" for command in commands)))


def _help(command: Callable[..., None]) -> str:
    """Return the docstring of a command with its paragraphs on one line each, so that the terminal wraps them."""
    paragraphs = (inspect.getdoc(command) or "").replace("``", "`").split("\n\n")
    return "\n\n".join(paragraph.replace("\n", " ") for paragraph in paragraphs)


COMMANDS = (
    ("list", scenario.list_scenarios, SCENARIOS, ()),
    (
        "print-config",
        scenario.print_config,
        SCENARIOS,
        ("colift print-config paper --set payload.mass_kg=2 > heavy.yaml",),
    ),
    (
        "init",
        init.init,
        SCENARIOS,
        ("colift init my_team.yaml --agents 3 --arms 1", "colift init my_team.yaml --urdf vehicle.urdf"),
    ),
    ("migrate", scenario.migrate, SCENARIOS, ("colift migrate my_team.yaml", "colift migrate --check *.yaml")),
    ("check", scenario.check, SCENARIOS, ("colift check my_team.yaml",)),
    ("draw", view.draw, SCENARIOS, ("colift draw my_team.yaml", "colift draw paper --set payload.mass_kg=2")),
    ("tune", scenario.tune, SCENARIOS, ("colift tune my_team.yaml --out tuned.yaml",)),
    (
        "study",
        study.study,
        SIMULATION,
        ("colift study paper", "colift study paper --case C1,C3,adaptive --held-out --out out/comparison"),
    ),
    ("run", study.run, SIMULATION, ("colift run paper --case C1 --duration 5",)),
    ("live", view.live, SIMULATION, ("colift live paper --case C3 --open",)),
    ("certify", certify.certify, ERROR_BOUNDS, ("colift certify certified --adversarial-test",)),
    (
        "falsify",
        certify.falsify,
        ERROR_BOUNDS,
        ("colift falsify certified --rounds 2", "colift falsify certified --trial worst_case_e_p:0"),
    ),
    (
        "playback",
        view.playback,
        RESULTS,
        ("colift playback out/paper --open", "colift playback out/paper --video flight.gif --case C1 --case C3"),
    ),
    ("report", view.report, RESULTS, ("colift report out/paper --open",)),
    ("compare", view.compare, RESULTS, ("colift compare out/paper out/paper-seed1 --case C1,C3 --open",)),
    ("browse", view.browse, RESULTS, ("colift browse --open",)),
)
"""Name, function, group in the help page and examples of every command."""
EXPORTS = {"mjcf": export.mjcf, "urdf": export.urdf, "csv": export.csv, "mcap": export.mcap, "c": export.c}
"""Commands of ``colift export``."""

for _name, _command, _panel, _commands in COMMANDS:
    _epilog = _examples(*_commands) if _commands else None
    app.command(_name, help=_help(_command), rich_help_panel=_panel, epilog=_epilog)(_command)
for _name, _command in EXPORTS.items():
    export_app.command(_name, help=_help(_command))(_command)
for _name, _command in campaign.COMMANDS.items():
    campaign_app.command(_name, help=_help(_command))(_command)
app.add_typer(campaign_app, name="campaign", rich_help_panel=SIMULATION)
app.add_typer(export_app, name="export", rich_help_panel=RESULTS)
app.command("doctor", help=_help(doctor), rich_help_panel=INSTALLATION)(doctor)


def _print_version(requested: bool) -> bool:
    """Print the version and exit on request."""
    if requested:
        typer.echo(version("colift"))
        raise typer.Exit
    return requested


@app.callback()
def _options(
    _version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    pass


def main() -> None:
    """Run the command line of ``colift``.

    Raises:
        OSError: If a command fails on a file without reporting it.
    """
    gc.set_threshold(GC_THRESHOLD)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")  # a character that cannot be encoded must not end a run
    try:
        with signals.handle_signals():
            try:
                app()
            finally:
                common.report_pending_interruption()
                atexit.register(gc.freeze)  # the interpreter collects garbage several times at its end: 0.7 s with JAX
    except OSError as error:
        if error.filename is not None:  # not an error of standard output, such as a full disk while help is printed
            raise
        common.discard_output()
        common.print_error(f"cannot print: {common.describe_error(error)}")
        sys.exit(common.EXIT_INCOMPLETE)
    finally:
        if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
            with contextlib.suppress(ValueError):  # not on the main thread
                signal.signal(signal.SIGINT, signal.SIG_DFL)  # all files are written: the interpreter may be stopped
