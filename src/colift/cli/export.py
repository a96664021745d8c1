"""Commands that export scenarios and flights to other formats: mjcf, urdf, csv, mcap and c."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from colift.cli import common
from colift.runtime import signals

if TYPE_CHECKING:
    import xarray as xr

    from colift.scenario import Scenario

CODE_SHARE = 0.3
"""Share of the code generation in the time of `colift export c`."""
FlightsArgument = Annotated[
    Path, typer.Argument(metavar="OUT", help="Folder that `colift study` or `colift run` has written.")
]


def mjcf(
    name: common.ScenarioArgument,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="File to write; default: standard output.")
    ] = None,
    overrides: common.OverridesOption = None,
) -> None:
    """Export the true team in its initial state as an MJCF model for MuJoCo (docs/plant.md)."""
    from colift import scenario
    from colift.models import mjcf
    from colift.runtime import atomic_write
    from colift.scenario import initial_states, team

    try:
        settings = common.load_settings(name, overrides)
        truth, _ = team.team(settings)
        names = (team.agent_names(settings), team.joint_names(settings), team.contact_names(settings))
        text = mjcf.to_mjcf(truth, initial_states.initial_state(settings, truth), *names)
        if out is not None:
            atomic_write.write_atomic(out, text.encode())
    except (scenario.ScenarioError, ValueError, OSError) as error:
        common.fail(error)
    with common.guard_output():
        print(text if out is None else f"{settings.name} is in {out}", end="" if out is None else "\n")


def urdf(
    name: common.ScenarioArgument,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Folder to write; default: out/SCENARIO-urdf.")
    ] = None,
    overrides: common.OverridesOption = None,
) -> None:
    """Export each agent type of the true team as a URDF file with its contact points as links."""
    from colift import scenario
    from colift.models import urdf
    from colift.runtime import atomic_write
    from colift.scenario import team

    try:
        settings = common.load_settings(name, overrides)
        folder = out or Path("out") / f"{settings.name}-urdf"
        folder.mkdir(parents=True, exist_ok=True)
        models = team.agent_models(settings)
        for kind, agent in models.items():
            stated = settings.agent_types[kind]
            joints, arms = [joint.name for joint in stated.joints], [arm.name for arm in stated.arms]
            atomic_write.write_atomic(folder / f"{kind}.urdf", urdf.to_urdf(kind, agent, joints, arms).encode())
    except (scenario.ScenarioError, OSError) as error:
        common.fail(error)
    with common.guard_output():
        print(f"{', '.join(f'{kind}.urdf' for kind in models)} of {settings.name}: in {folder}")


def csv(out: FlightsArgument) -> None:
    """Export the flights of a folder as CSV files in the same folder.

    A row is a control period. A column is a signal with its unit.
    """
    from colift.closed_loop import log

    _export_flights(out, "csv", lambda ds: log.to_csv(ds).encode())


def mcap(out: FlightsArgument) -> None:
    """Export the flights of a folder as ROS 2 bags in the same folder (extra mcap).

    The bags contain poses, wrenches, joint states and transforms.
    """
    try:
        from colift.integrations import ros2_bag
    except ModuleNotFoundError as error:
        common.fail(error)

    _export_flights(out, "mcap", ros2_bag.to_mcap)


def _export_flights(out: Path, kind: str, convert: Callable[[xr.Dataset], bytes]) -> None:
    """Write each flight of a folder in another format, under the name of its case.

    Args:
        out: Folder that holds the logs.
        kind: Suffix of the files to write.
        convert: Function that returns the content of a file.
    """
    from colift.closed_loop import log
    from colift.runtime import atomic_write, run_directory
    from colift.scenario.cases import ALL_CASES

    try:
        run, found = log.load_flights(out, tuple(ALL_CASES))
        files = {f"{case}.{kind}": ds for case, ds in found.items()}
        with (
            run_directory.stage_run_directory(out, run, tuple(files)) as folder,
            common.show_progress(f"exporting {out}", announce=False) as progress,
        ):
            for k, (file, ds) in enumerate(files.items()):
                progress(file, k / len(files))
                atomic_write.write_atomic(folder.path / file, convert(ds))
    except (ValueError, OSError) as error:
        common.fail(error)
    with common.guard_output():
        print(f"{', '.join(files)}: in {out}")


def c(
    name: common.ScenarioArgument,
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FOLDER", help="Folder to write; default: out/SCENARIO-c.")
    ] = None,
    case: common.CaseOption = "C3",
    overrides: common.OverridesOption = None,
    duration: common.DurationOption = None,
    seed: common.SeedOption = None,
    ticks: Annotated[int, typer.Option("--ticks", min=1, help="Control periods of the flight to replay.")] = 2000,
) -> None:
    """Export the controller as C99 code with its learned model and a replay test.

    A flight is simulated first, in which the model is learned. The code allocates no memory, starts no threads and
    depends on the math library only. It is built with CMake. It has not been tested on hardware. The code is yours.
    """
    from colift import codegen, scenario

    signals.raise_if_interrupted()
    case = common.parse_case(case)
    try:
        settings = common.load_settings(name, overrides, duration, seed)
        folder = out or Path("out") / f"{settings.name}-c"
        _write_c(settings, case, ticks, folder)
    except (scenario.ScenarioError, codegen.CompilerError, codegen.UnsupportedPrimitive, OSError) as error:
        common.fail(error)
    with common.guard_output():
        print(f"{case} of {settings.name} is in {folder}: cmake -S {folder} -B build && cmake --build build &&")
        print(f"build/replay {folder}/flight.bin")


def _write_c(settings: Scenario, case: str, ticks: int, folder: Path) -> None:
    """Simulate a flight and write the controller with its learned model as C code.

    Args:
        settings: Scenario.
        case: Identifier of the case.
        ticks: Number of control periods to replay.
        folder: Folder to write.
    """
    from colift.closed_loop.flight import run_experiment
    from colift.integrations import c_export
    from colift.scenario import experiment

    with common.show_progress(f"exporting {case} of {settings.name} as C") as progress:
        progress("team")
        flight_experiment = experiment.make_experiment(settings, case)

        def report_flight(t: float) -> None:
            share = (1 - CODE_SHARE) * t / settings.duration_s
            progress(f"simulation of the flight, {t:.1f} of {settings.duration_s:g} s", share)

        flight = run_experiment(flight_experiment, report_flight)
        if flight.termination_reason:
            common.fail(f"{case} is incomplete, so there is no model to export: {flight.termination_reason}")
        progress("code generation", 1 - CODE_SHARE)
        description = f"{settings.name}, {case}, seed {settings.seed}"
        c_export.export_c(flight_experiment, flight.model, ticks, folder, description)
