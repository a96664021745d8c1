"""Command that writes a new scenario: init."""

from __future__ import annotations

import enum
import shlex
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from colift.cli import common
from colift.cli.scenario import require_suffix, write_new

if TYPE_CHECKING:
    from colift.scenario.vehicle_import import VehicleOptions


class CoupledJointsOption(enum.StrEnum):
    """Treatment of coupled joints."""

    frozen = "frozen"
    independent = "independent"


class InertiaOption(enum.StrEnum):
    """Treatment of inertias that violate the triangle inequality."""

    strict = "strict"
    balanced = "balanced"


FrozenOption = Annotated[
    list[str] | None,
    typer.Option(
        "--frozen",
        metavar="JOINT",
        help="Joint of the file to fix besides rotors, fingers and joints that carry no tip; repeatable, or separated "
        "by commas. An empty name fixes none.",
    ),
]
TipsOption = Annotated[
    list[str] | None,
    typer.Option(
        "--tips",
        metavar="LINK",
        help="Link of the file that holds the payload; repeatable, or separated by commas; default: the last link "
        "of each arm.",
    ),
]
MimicOption = Annotated[
    CoupledJointsOption | None, typer.Option("--mimic", help="Treatment of joints that follow another one.")
]
BalanceOption = Annotated[
    InertiaOption | None,
    typer.Option("--inertia", help="Treatment of inertias that violate the triangle inequality; default: strict."),
]


def init(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File to write, such as my_team.yaml.")],
    agents: Annotated[
        int | None,
        typer.Option("--agents", help="Number of agents; default: the smallest team that can rotate the payload."),
    ] = None,
    arms: Annotated[
        int | None,
        typer.Option("--arms", help="Arms of each agent: 0 (the base holds the payload itself), 1 or 2; default: 2."),
    ] = None,
    urdf: Annotated[
        Path | None, typer.Option("--urdf", metavar="FILE", help="Read the agent's model from a URDF file instead.")
    ] = None,
    mjcf: Annotated[
        Path | None, typer.Option("--mjcf", metavar="FILE", help="Read the agent's model from an MJCF file instead.")
    ] = None,
    frozen: FrozenOption = None,
    tips: TipsOption = None,
    mimic: MimicOption = None,
    inertia: BalanceOption = None,
) -> None:
    """Write a commented scenario as a starting point.

    No file is overwritten. Run ``colift check`` after every edit of the file.
    """
    from colift.scenario import template

    require_suffix(file)
    if urdf is not None and mjcf is not None:
        common.fail(f"--mjcf {mjcf}: must be omitted with --urdf")
    name, vehicle = template.scenario_name(file), urdf or mjcf
    try:
        if vehicle is None:
            _refuse_without_file(frozen=frozen, tips=tips, mimic=mimic, inertia=inertia)
            arms = 2 if arms is None else arms
            agents = (2 if arms == 2 else 3) if agents is None else agents
            text, notes = template.scenario_template(name, agents, arms), ()
        else:
            if arms is not None:
                option = "--urdf" if mjcf is None else "--mjcf"
                common.fail(f"--arms {arms}: must be omitted with {option}, whose file defines the arms")
            choices = _options(frozen, tips, mimic, inertia)
            text, agents, notes = _from_vehicle(name, agents, vehicle, file.parent, choices, mjcf is not None)
        _write(file, text)
    except (ValueError, OSError) as error:
        common.fail(error)
    with common.guard_output():
        print("\n".join([*notes, f"{file}: {agents} agents; next: colift check {shlex.quote(str(file))}"]))


def _write(file: Path, text: str) -> None:
    """Write the scenario; end the command if the file exists."""
    if file.exists():
        common.fail(f"{file}: exists; it is not overwritten")
    write_new(file, text)


def _refuse_without_file(**options: object) -> None:
    """End the command if an option is given that applies to the vehicle of a file."""
    for name, value in options.items():
        if value is not None:
            common.fail(f"--{name}: must be used with --urdf or --mjcf")


def _options(
    frozen: list[str] | None, tips: list[str] | None, mimic: CoupledJointsOption | None, inertia: InertiaOption | None
) -> VehicleOptions:
    """Return the choices for the vehicle of a file."""
    from colift.scenario import vehicle_import

    return vehicle_import.VehicleOptions(
        frozen=None if frozen is None else tuple(filter(None, common.split_values(frozen))),
        tips=tuple(common.split_values(tips or [])),
        mimic=None if mimic is None else mimic.value,
        inertia="strict" if inertia is None else inertia.value,
    )


def _from_vehicle(
    name: str, agents: int | None, vehicle: Path, folder: Path, options: VehicleOptions, is_mjcf: bool
) -> tuple[str, int, tuple[str, ...]]:
    """Return text, number of agents and notes of a scenario with the vehicle of a file."""
    from colift.scenario import vehicle_import

    read = vehicle_import.from_mjcf_file if is_mjcf else vehicle_import.from_urdf_file
    generated = read(name, agents, vehicle, folder, options)
    return generated.text, generated.agents, generated.notes
