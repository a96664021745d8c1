"""Migration of scenarios of schema 1: values, comments, removed settings and refusals."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import xarray as xr

from colift import scenario
from colift.analysis import poses
from colift.scenario import Scenario, ScenarioError
from colift.scenario.migration import REMOVED, RENAMED, migrate_data, migrate_path, migrate_text

DATA = Path(__file__).parent / "data" / "schema_1"
NAMES = sorted(path.stem for path in DATA.glob("*.yaml"))
SAMPLE = scenario.load_scenario(Path(__file__).parents[2] / "support" / "sample_scenario.yaml")


def text_of(name: str) -> str:
    return (DATA / f"{name}.yaml").read_text(encoding="utf-8")


def comments(text: str) -> list[str]:
    return [line.split("#", 1)[1].strip() for line in text.splitlines() if "#" in line]


def to_schema_1(data: object, section: str = "") -> object:
    """Rename the settings of plain data back to schema 1."""
    if isinstance(data, dict):
        old = {new: name for name, new in RENAMED.get(section, {}).items()}
        return {old.get(key, key): to_schema_1(value, below(section, old.get(key, key))) for key, value in data.items()}
    return [to_schema_1(entry, f"{section}.*") for entry in data] if isinstance(data, list) else data


def below(section: str, key: str) -> str:
    path = f"{section}.{key}" if section else key
    is_renamed = any(name == path or name.startswith(f"{path}.") for name in RENAMED)
    return path if is_renamed or not section else f"{section}.*"


@pytest.mark.parametrize("name", NAMES)
def test_migrated_file_equals_the_shipped_scenario(name):
    """All settings are equal except the description."""
    migrated = scenario.parse(migrate_text(text_of(name)), "old.yaml")
    assert migrated == scenario.load_scenario(name).model_copy(update={"description": migrated.description})


@pytest.mark.parametrize("name", NAMES)
def test_comments_and_their_order_are_kept(name):
    assert comments(migrate_text(text_of(name))) == comments(text_of(name))


@pytest.mark.parametrize("name", NAMES)
def test_migration_is_idempotent(name):
    migrated = migrate_text(text_of(name))
    assert migrate_text(migrated) == migrated


def test_schema_1_file_is_refused_with_the_command():
    """A file of schema 1 is refused with the command that migrates it."""
    with pytest.raises(ScenarioError, match=r"schema: must be 2; the file states none. `colift migrate old.yaml`"):
        scenario.parse(text_of("outdoors"), "old.yaml")


def test_migrated_plain_data_equal_the_scenario():
    """Names only: values such as `balanced` are covered by the files."""
    data = to_schema_1(json.loads(SAMPLE.model_dump_json(exclude_none=True)))
    assert "start" in data
    assert "capacity" in data["learning"]
    assert Scenario.model_validate_json(json.dumps(migrate_data(data))) == SAMPLE


def test_scenario_in_a_schema_1_log_is_read():
    data = to_schema_1(json.loads(SAMPLE.model_dump_json(exclude_none=True)))
    data["learning"] |= {"restarts": 7, "max_iterations": 300, "lengthscale_bounds": [0.1, 30.0]}
    data["innovation"] |= {"doubt": 10.0, "enough": 150}
    log = xr.Dataset(attrs={"scenario_json": json.dumps(data)})
    assert poses.scenario_of_log(log) == SAMPLE


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("control.look_ahead_s", "control.preview_step_s"),
        ("innovation.renew_s", "online_correction.update_period_s"),
        ("agent_types.two_arms.joints.left.rest_rad", "agent_types.two_arms.joints.left.nominal_position_rad"),
        ("payload.mass_kg", "payload.mass_kg"),
    ],
)
def test_setting_path_is_renamed(old, new):
    assert migrate_path(old) == new


@pytest.mark.parametrize(("section", "name"), REMOVED)
def test_removed_setting_with_its_default_is_dropped(section, name):
    default, _ = REMOVED[section, name]
    value = "null" if default is None else json.dumps(default)
    migrated = migrate_text(f"name: a  # its name\n{section}:\n  {name}: {value}\n  other: 1\n")
    assert name not in migrated
    assert "other: 1" in migrated
    assert "# its name" in migrated


@pytest.mark.parametrize(("section", "name"), REMOVED)
def test_removed_setting_with_another_value_is_refused(section, name):
    _, field = REMOVED[section, name]
    with pytest.raises(ScenarioError) as error:
        migrate_text(f"name: a\n{section}:\n  {name}: 77\n")
    assert str(error.value).startswith(f"line 3: {section}.{name}: 77 cannot be migrated")
    assert str(error.value).endswith(f"set the field {field} in Python")


def test_all_removed_settings_are_reported():
    with pytest.raises(ScenarioError) as error:
        migrate_data({"learning": {"restarts": 2, "max_iterations": 5}, "control": {"haste": 3}})
    assert [line.partition(":")[0] for line in str(error.value).splitlines()] == [
        "learning.restarts",
        "learning.max_iterations",
        "control.haste",
    ]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a: [1", "not valid YAML"),
        ("- 1", "a scenario is a mapping of settings"),
        ("schema: 3\nname: a", "schema: must be 1 or 2, got 3"),
    ],
)
def test_unmigratable_text_is_refused_in_one_line(text, message):
    with pytest.raises(ScenarioError) as error:
        migrate_text(text)
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)
