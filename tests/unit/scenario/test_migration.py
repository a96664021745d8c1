"""Migration of scenarios of schema 1: values, comments, removed settings and refusals."""

from __future__ import annotations

import importlib
import inspect
import json
from pathlib import Path

import pytest
import xarray as xr

from colift import scenario
from colift.analysis import poses
from colift.scenario import Scenario, ScenarioError
from colift.scenario.former_settings import CONSTANTS, MOVED, PAIRS, remedy
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


def former_structure(data: dict) -> dict:
    """Undo the moves of settings, which keep their names of schema 2."""
    for present, (force, moment, _) in PAIRS.items():
        section = data[present.partition(".")[0]]
        values = section.pop(present.partition(".")[2])
        section[force.partition(".")[2]], section[moment.partition(".")[2]] = values
    for old, new in MOVED.items():
        (*old_sections, old_name), (*new_sections, new_name) = old.split("."), new.split(".")
        holder = data
        for name in new_sections:
            holder = holder.get(name, {})
        if new_name in holder and not old.startswith("certificate"):
            target = data
            for name in old_sections:
                target = target.setdefault(name, {})
            target[old_name] = holder.pop(new_name)
    for body in ("payload", "agents"):
        assert data["learning"][body].pop("signal_std") == data["learning"][body].pop("noise_std") == {}
    return data


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


def test_a_file_of_schema_1_is_refused_with_the_command():
    """A file of schema 1 is refused with the command that migrates it."""
    with pytest.raises(ScenarioError, match=r"schema: must be 2; the file states none. `colift migrate old.yaml`"):
        scenario.parse(text_of("outdoors"), "old.yaml")


def test_plain_data_of_schema_1_state_the_same_scenario():
    """Names only: values such as `balanced` are covered by the files."""
    data = to_schema_1(former_structure(json.loads(SAMPLE.model_dump_json(exclude_none=True))))
    assert "start" in data
    assert data["innovation"] == {"renew_s": 1, "refit_s": 10}
    assert data["learning"]["payload"]["force_noise_N"] == 0.1
    assert (data["baselines"]["observer_Hz"], data["baselines"]["ridge_moment"]) == (0.5, 0.3)
    assert "capacity" in data["learning"]
    assert Scenario.model_validate_json(json.dumps(migrate_data(data))) == SAMPLE


def test_the_scenario_in_a_log_of_schema_1_is_read():
    data = to_schema_1(former_structure(json.loads(SAMPLE.model_dump_json(exclude_none=True))))
    data["learning"] |= {"restarts": 7, "max_iterations": 300, "lengthscale_bounds": [0.1, 30.0]}
    data["innovation"] |= {"doubt": 10.0, "enough": 150, "hold_s": 0.7}
    data["limits"] |= {"grip": 0.01}
    log = xr.Dataset(attrs={"scenario_json": json.dumps(data)})
    assert poses.scenario_of_log(log) == SAMPLE


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("control.look_ahead_s", "control.preview_step_s"),
        ("innovation.renew_s", "learning.update_period_s"),
        ("learning.agents.joint_noise_Nm", "learning.agents.noise_std.joint_torque_Nm"),
        ("baselines.observer_moment_Hz", "baselines.dob_Hz"),
        ("agent_types.two_arms.joints.left.rest_rad", "agent_types.two_arms.joints.left.nominal_position_rad"),
        ("payload.mass_kg", "payload.mass_kg"),
    ],
)
def test_a_path_is_renamed(old, new):
    assert migrate_path(old) == new


@pytest.mark.parametrize(("section", "name"), REMOVED)
def test_a_removed_setting_is_dropped_with_its_former_default(section, name):
    default, _ = REMOVED[section, name]
    value = "null" if default is None else json.dumps(default)
    migrated = migrate_text(f"name: a  # its name\n{section}:\n  {name}: {value}\n  other: 1\n")
    assert name not in migrated
    assert "other: 1" in migrated
    assert "# its name" in migrated


@pytest.mark.parametrize(("section", "name"), REMOVED)
def test_a_removed_setting_with_another_value_is_refused(section, name):
    _, field = REMOVED[section, name]
    with pytest.raises(ScenarioError) as error:
        migrate_text(f"name: a\n{section}:\n  {name}: 77\n")
    assert str(error.value).startswith(f"line 3: {section}.{name}: 77 cannot be migrated")
    assert str(error.value).endswith("no parameter replaces it" if field is None else f"set {field} in Python")


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
        ("a: [1", "line 1: not valid YAML"),
        ("- 1", "a scenario is a mapping of settings"),
        ("schema: 3\nname: a", "schema: must be 1 or 2, got 3"),
        ("schema: true", "schema: must be 1 or 2, got True"),
        pytest.param(f"schema: 0x{'f' * 5000}", "schema: must be 1 or 2, got a whole number of 20000", id="long"),
        ("a:  # one\n|\n  b: 1\n\n\nc: 1", "a comment cannot be kept, remove it: overlap in comment"),
    ],
)
def test_what_cannot_be_migrated_is_refused_in_one_line(text, message):
    with pytest.raises(ScenarioError) as error:
        migrate_text(text)
    assert str(error.value).startswith(message)
    assert "\n" not in str(error.value)


def migrated(text: str) -> str:
    """Lines of a migrated text below the schema."""
    return migrate_text(text).removeprefix("schema: 2\n")


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (
            "learning:\n  agents: {force_N: 1, joint_Nm: 3, joint_noise_Nm: 4}  # a\n\n# next\nb: 1\n",
            "learning:\n  agents: {signal_std: {force_N: 1, joint_torque_Nm: 3}, noise_std: {joint_torque_Nm: 4}} # a"
            "\n\n# next\nb: 1\n",
        ),
        (
            "learning:\n  payload:\n    force_N: 1  # c\n    force_noise_N: 2  # d\n    lengthscale: 3\n",
            "learning:\n  payload:\n    signal_std:\n      force_N: 1 # c\n    noise_std:\n      force_N: 2      # d\n"
            "    lengthscale: 3\n",
        ),
        ("innovation:\n  renew_s: 2  # r\n", "learning:\n  update_period_s: 2 # r\n"),
        ("like: paper\ninnovation: {refit_s: 2} # r\n", "extends: paper\nlearning: {refit_period_s: 2} # r\n"),
        ("innovation: {hold_s: 0.2}\nlearning: {capacity: 9}\n", "learning: {max_samples: 9}\n"),
        (
            "innovation: {renew_s: 2, hold_s: 0.2}\nlearning: {capacity: 9}\n",
            "learning: {update_period_s: 2, max_samples: 9}\n",
        ),
        ("baselines: {ridge: 1, K_i: 2}\n", "baselines: {ridge_alpha: 1, position_integral_gain: 2}\n"),
        ("baselines:\n  ridge: 1  # f\n  ridge_moment: 2  # m\n", "baselines:\n  ridge_alpha: [1, 2] # f # m\n"),
        ("baselines: {observer_moment_Hz: 2}\n", "baselines: {dob_Hz: [0.5, 2]}\n"),
        (
            "like: paper\nbaselines: {observer_Hz: 2, observer_moment_Hz: 2}\n",
            "extends: paper\nbaselines: {dob_Hz: 2}\n",
        ),
        ("baselines: {observer_moment_Hz: null}\n", "baselines: {}\n"),
        ("learning: {samples: rig}\n", "learning: {rig_label_error: 0.1}\n"),
        ("learning: {samples: estimated, rig_error: 0.3}\n", "learning: {}\n"),
        ("learning: {rig_error: 0.3}\n", "learning: {}\n"),
        ("like: certified\nlearning: {rig_error: 0.3}\n", "extends: certified\nlearning: {rig_label_error: 0.3}\n"),
        (
            "like: certified\nlearning: {samples: estimated}\n",
            "extends: certified\nlearning: {rig_label_error: null}\n",
        ),
        ("learning: 5\ninnovation: {renew_s: 2}\n", "learning: 5\nonline_correction: {update_period_s: 2}\n"),
        (
            "learning:\n  payload: &p {force_N: 1}\n  agents: {<<: *p, joint_Nm: 3}\n",
            "learning:\n  payload: {signal_std: {force_N: 1}}\n"
            "  agents: {signal_std: {force_N: 1, joint_torque_Nm: 3}}\n",
        ),
    ],
)
def test_settings_are_moved_with_their_comments(old: str, new: str):
    assert migrated(old) == new


@pytest.mark.parametrize(("stated", "other"), [("observer_Hz", "observer_moment_Hz"), ("ridge_moment", "ridge")])
def test_half_of_a_pair_is_refused_in_an_extending_file(stated: str, other: str):
    """The base of the file may state the other half."""
    with pytest.raises(ScenarioError) as error:
        migrate_text(f"like: paper\nbaselines: {{{stated}: 2}}\n")
    message = "cannot be migrated, because the file extends another one: state"
    assert str(error.value) == f"baselines.{stated}: {message} {other} as well"


@pytest.mark.parametrize(
    ("change", "message"),
    [
        *(
            (f"{path}=1", f"{path}: is no longer a setting: {remedy(field)}")
            for path, (_, field) in CONSTANTS.items()
            if not path.startswith("online_correction")
        ),
        ("learning.payload.force_noise_std_N=1", "is now learning.payload.noise_std.force_N"),
        ("certificate.agent_label_error.force_error_N=1", "is now certificate.agent_label_error.force_N"),
        ("baselines.dob_moment_Hz=1", "is now baselines.dob_Hz, [force, moment]"),
        (
            "learning.label_source=onboard",
            "is now learning.rig_label_error; without it, labels are from onboard sensors",
        ),
        (
            "online_correction.refit_period_s=1",
            "online_correction: is no longer a section; refit_period_s is now learning.refit_period_s",
        ),
        (
            "online_correction.hold_time_s=1",
            "online_correction: is no longer a section; hold_time_s is no longer a setting: remove it; no parameter "
            "replaces it",
        ),
    ],
)
def test_a_former_setting_is_refused_with_its_present_place(change: str, message: str):
    with pytest.raises(ScenarioError) as error:
        scenario.load_scenario("certified", [change])
    assert message in str(error.value)


@pytest.mark.parametrize("path", [path for path, (_, field) in CONSTANTS.items() if field])
def test_the_field_that_replaces_a_setting_exists(path: str):
    field = CONSTANTS[path][1]
    assert field is not None
    kind, name, _, where = field.removeprefix("the ").split(" ")
    module, _, owner = where.rpartition(".")
    replaced_by = getattr(importlib.import_module(module), owner)
    names = inspect.signature(replaced_by).parameters
    assert kind in ("field", "argument")
    assert name in names
