"""Settings, options and commands that advice names exist."""

from __future__ import annotations

import inspect
import re
import shlex

import pytest
import typer

from colift import scenario
from colift.analysis import (
    bound_axis_checks,
    headings,
    joint_limits,
    learning_benefit,
    loop_checks,
    preflight,
    remedies,
)
from colift.cli.app import app
from colift.scenario import Scenario, structure, termination, vehicle_import
from colift.scenario.from_urdf import AgentTypeFromUrdf

MODULES = (
    *(bound_axis_checks, headings, joint_limits, learning_benefit, loop_checks, preflight, remedies),
    *(structure, termination),
)
SOURCES = [inspect.getsource(m) for m in MODULES]
SECTIONS = "sensors|control|learning|payload|reference|termination|agent_types|agents"


def names() -> set[str]:
    schemas = [Scenario.model_json_schema(), AgentTypeFromUrdf.model_json_schema()]
    sections = [section for schema in schemas for section in (schema, *schema["$defs"].values())]
    return {name for section in sections for name in section.get("properties", {})}


def texts(source: str) -> list[str]:
    """The string literals of a module without its docstrings."""
    return re.findall(r'"([^"\n]*)"', re.sub(r'""".*?"""', "", source, flags=re.DOTALL))


def test_settings_that_advice_names_exist() -> None:
    words = " ".join(text for source in SOURCES for text in texts(source))
    paths = re.findall(rf"\b(?:{SECTIONS})(?:\.\{{[^}}]*\}}|\.\w+)*\.([A-Za-z_]\w*)", words)
    paths += [name for found in re.findall(rf"\((?:{SECTIONS}): (\w+)\)", words) for name in (found,)]
    assert {"tip_force_bias_N", "posture_bandwidth", "contact_positions_m", "thrust_max_N"} <= set(paths)
    assert not {path for path in paths if path not in names()} - {"name", "position", "joints"}


def test_options_and_commands_that_advice_names_exist() -> None:
    commands = typer.main.get_command(app).commands
    words = " ".join(text for source in SOURCES for text in texts(source))
    assert set(re.findall(r"`colift (\w+)", words)) <= set(commands)
    options = {option for parameter in commands["init"].params for option in parameter.opts}
    words = " ".join(texts(inspect.getsource(vehicle_import)))
    found = set(re.findall(r"--[a-z]+", words))
    assert {"--frozen", "--tips", "--agents"} <= found <= options
    assert {"--mimic", "--inertia"} <= options


@pytest.mark.parametrize("from_file", [False, True])
def test_the_path_of_a_nominal_position_can_be_set(from_file: bool, tmp_path) -> None:
    from tests.unit.scenario import test_vehicle_import as vehicles

    if from_file:
        name, _ = vehicles.init(tmp_path, vehicles.BASE + vehicles.ARM)
        kind = "vehicle"
    else:
        name, kind = "paper", "two_arms"
    settings = scenario.load_scenario(name)
    joint = settings.agent_types[kind].joints[1]
    path = joint_limits.nominal_position_path(settings, kind, joint)
    changed = scenario.load_scenario(name, [f"{path}=0.321"])
    assert changed.agent_types[kind].joints[1].nominal_position_rad == 0.321


def test_lists_of_gains_are_typed_as_one_word() -> None:
    """Equal gains are one number; a list is quoted. The typed option yields the proposed scenario."""
    for gains in ([3.5, 3.5, 3.5], [3.5, 3.0, 2.5]):
        option, changed = remedies.control_change(scenario.load_scenario("paper"), "K_p", gains)
        flag, override = shlex.split(option)
        assert flag == "--set"
        assert scenario.load_scenario("paper", [override]).control == changed.control
