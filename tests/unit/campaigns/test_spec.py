"""Specifications of campaigns: messages with file, line, key, value and allowed values."""

from __future__ import annotations

from pathlib import Path

import pytest

from colift.campaigns import spec
from colift.scenario import ScenarioError
from tests.support import small_team

MISTAKES = {
    "scenario: papr": (1, "scenario", "'papr'", "did you mean 'paper'?"),
    "scenario: paper\ncases: [C9]": (2, "cases", "must be one of C1, C2", "'C9'"),
    "scenario: paper\nsamples: 0": (2, "samples", "at least 1", "got 0"),
    "scenario: paper\ncolour: 3": (2, "colour", "known: scenario, cases", ""),
    "scenario: paper\nseeds: []": (2, "seeds", "at least 1", "got 0 values"),
    "scenario: paper\nvary: {payload.mass_kg: {kind: unifrm, low: 1, high: 2}}": (
        2,
        "vary payload.mass_kg",
        "uniform",
        "",
    ),
    "scenario: paper\nvary: {payload.mass_kg: {kind: uniform, low: 2, high: 1}}": (
        2,
        "high must exceed low",
        "2 and 1",
        "",
    ),
    "scenario: paper\nvary:\n  payload.mass_kg: [1.0, -2]": (3, "vary payload.mass_kg [kg]", "from 1e-6", "got -2"),
    "scenario: paper\nvary: {payload.mas_kg: [1.0]}": (2, "vary payload.mas_kg", "did you mean 'mass_kg'?", ""),
    "scenario: paper\nvary: {learning.end_s: [25]}": (2, "vary learning.end_s", "must not exceed duration_s = 20", ""),
    "scenario: paper\nvary: {seed: [1, 2]}": (2, "vary seed", "`seeds`", ""),
    "scenario: paper\noverrides: {payload.mass_kg: heavy}": (2, "overrides payload.mass_kg [kg]", "number", "'heavy'"),
    "scenario: paper\noverrides: {agents.middle.type: x}": (2, "overrides agents.middle.type", "'front', 'rear'", ""),
    "scenario: paper\nuntil: {metric: e_p, half_width: 1}\nsamples: 32": (2, "until.metric", "e_p_rms_m", "got 'e_p'"),
    "scenario: paper\nsampling: saltelli\nvary: {control.K_p: [4, 5]}": (2, "sampling", "no grid", ""),
    "scenario: paper\n- 3": (2, "not valid YAML", "", ""),
    "scenario: paper\nvary: {payload.mass_kg: 1.5}": (2, "vary payload.mass_kg", "a list of values", "got 1.5"),
    "scenario: paper\nvary: {payload.mass_kg: {low: 1, high: 2}}": (2, "grid, uniform, log_uniform or normal", "", ""),
    "scenario: paper\nvary: {control.K_p: [4, 4.0]}": (2, "vary control.K_p", "4 occurs twice", ""),
    "scenario: paper\nvary: {control.K_p: [1000000, 1.0e+6]}": (2, "vary control.K_p", "1000000 occurs twice", ""),
    "scenario: paper\nseeds: [3, 3]": (2, "seeds", "3 occurs twice", ""),
    "scenario: paper\ncases: [C1, C1]": (2, "cases", '"C1" occurs twice', ""),
    "scenario: paper\nseeds: [1, 2]\nsamples: 5": (3, "samples", "must be 1", "got 5"),
    f"scenario: paper\nsamples: {spec.MAX_FLIGHTS}": (2, "samples", "at most 1000000 flights", "got 3000000"),
    "scenario: paper\nuntil: {metric: e_p_rms_m, half_width: 1}": (2, "until", "at least 32 samples", "got 1"),
    "scenario: paper\noverrides: {agents.0.yaw_deg: 5}\nvary: {agents.front.yaw_deg: [2, 3]}": (
        3,
        "vary agents.front.yaw_deg",
        "replaces agents.0.yaw_deg in `overrides`",
        "",
    ),
}


@pytest.mark.parametrize("text", MISTAKES)
def test_error_states_line_key_value_and_allowed(text: str, tmp_path: Path):
    path = tmp_path / "campaign.yaml"
    path.write_text(text)
    line, *parts = MISTAKES[text]
    with pytest.raises(ScenarioError) as caught:
        spec.load_campaign(path)
    message = str(caught.value)
    assert message.startswith(f"{path}:{line}:")
    assert "\n" not in message
    assert all(part in message for part in parts), message


def test_all_errors_of_a_file_are_listed(tmp_path: Path):
    path = tmp_path / "campaign.yaml"
    path.write_text("scenario: paper\noverrides: {payload.mass_kg: -1, payload.mas_kg: 3}\n")
    with pytest.raises(ScenarioError) as caught:
        spec.load_campaign(path)
    assert str(caught.value).count("\n") == 1


def test_parts_of_a_varied_setting_are_not_varied(tmp_path: Path):
    path = tmp_path / "campaign.yaml"
    whole, part = "initial_state.position_error_m", "initial_state.position_error_m.0"
    path.write_text(f"scenario: paper\nvary:\n  {whole}: [[0, 0, 0]]\n  {part}: [1]\n")
    with pytest.raises(ScenarioError, match=f"^{path}:4: vary {part}: is also varied by {whole}$"):
        spec.load_campaign(path)


def test_scenario_is_no_specification(tmp_path: Path):
    path = small_team.write(tmp_path / "light.yaml")
    with pytest.raises(ScenarioError, match=f"^{path}:1: this file is a scenario.*`scenario: light.yaml`$"):
        spec.load_campaign(path)


def test_faults_after_the_end_are_refused(tmp_path: Path):
    fault = {"kind": "thrust", "who": small_team.NAMES[0], "to": 0.5, "start_s": 1.5}
    small_team.write(tmp_path / "light.yaml", faults=small_team.faults(fault))
    path = tmp_path / "campaign.yaml"
    path.write_text("scenario: light.yaml\nduration_s: 1\n")
    message = rf"^{path}:2: duration_s, with 1.0: faults\[0\].start_s \[s\]: must be less than duration_s = 1, got 1.5$"
    with pytest.raises(ScenarioError, match=message):
        spec.load_campaign(path)


def test_missing_and_special_files_are_refused(tmp_path: Path):
    for path in (tmp_path / "none.yaml", tmp_path):
        with pytest.raises(ScenarioError, match=f"^{path}: cannot be read"):
            spec.load_campaign(path)


def test_different_values_are_not_repeated():
    """Seven digits, and numbers inside of lists and sections."""
    assert spec._repeated([1234567.0, 1234568.0, True, "1", 1, [4, 5], [5, 4], None]) == []
    assert spec._repeated([[4], [4.0], {"a": 1}, {"a": 1.0}]) == ["[4]", '{"a": 1}']


@pytest.mark.parametrize("order", [1, -1])
def test_overrides_apply_together_in_any_order(tmp_path: Path, order: int):
    path = tmp_path / "campaign.yaml"
    lines = ["  allocation.contact.max_force_N: 20", "  allocation.kind: constrained"][::order]
    path.write_text("\n".join(["scenario: paper", "overrides:", *lines]))
    allocation = spec.load_campaign(path).scenario.allocation
    assert allocation.kind == "constrained"
    assert allocation.contact.max_force_N == 20


def test_a_shorter_flight_may_end_before_the_last_update(tmp_path: Path):
    path = tmp_path / "campaign.yaml"
    path.write_text("scenario: paper\nduration_s: 1\n")
    assert spec.load_campaign(path).spec.duration_s == 1


def test_overrides_reach_the_scenario(tmp_path: Path):
    path = tmp_path / "campaign.yaml"
    path.write_text("scenario: paper\noverrides: {payload.mass_kg: 2.5, sensors.position_m: 0.001}\n")
    found = spec.load_campaign(path)
    assert found.scenario.payload.mass_kg == 2.5
    assert found.scenario.sensors.position_m == 0.001
    changed = spec.with_settings(found.settings_json, found.file, (("disturbances.stream.std_m", 0.5), ("seed", 7)))
    assert changed.payload.mass_kg == 2.5
    assert changed.disturbances[2].std_m == 0.5
    assert changed.seed == 7
