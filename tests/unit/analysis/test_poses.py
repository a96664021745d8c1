"""Scenario and base positions from a log; no plugin that the log names is imported."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr

from colift.analysis import poses
from colift.closed_loop import log_upgrade
from tests.support import old_logs
from tests.support import random_logs as flights
from tests.support import small_team as light

PLUGIN = {"kind": "plugin", "class_path": "executed_by_log:Part", "settings": {}}


def log_with(**changes: Any) -> xr.Dataset:
    data = json.loads(light.settings().model_dump_json(exclude_none=True)) | changes
    p_d = ("time", "axis"), np.array([[1.0, 2.0, 3.0]])
    return xr.Dataset({"p_d": p_d}, attrs={"scenario_json": json.dumps(data)})


@pytest.mark.parametrize(
    "changes",
    [
        {"disturbances": [PLUGIN | {"name": "own", "acts_on": "payload"}]},
        {"sensors": {"models": [PLUGIN | {"channels": ["joint_position"]}]}},
        {"actuators": PLUGIN},
        {"physics": PLUGIN},
        {"reference": PLUGIN},
        {"plugins": {"payload_controller": {"class_path": PLUGIN["class_path"]}}},
    ],
)
def test_no_plugin_of_a_log_is_imported(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, changes: dict[str, Any]):
    (tmp_path / "executed_by_log.py").write_text(f"open({str(tmp_path / 'executed')!r}, 'w')")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    ds = log_with(**changes)
    settings = poses.scenario_of_log(ds)
    assert settings.payload == light.settings().payload
    assert poses.plugin_classes(ds) == [PLUGIN["class_path"]]
    assert "executed_by_log" not in sys.modules
    assert not (tmp_path / "executed").exists()


def test_a_plugin_in_another_place_is_refused(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr(poses, "_without_plugins", lambda data, ds: data)
    with pytest.raises(ValueError, match="executed_by_log is not imported, because a log names it"):
        poses.scenario_of_log(log_with(actuators=PLUGIN))


def test_a_reference_plugin_becomes_its_first_position():
    assert poses.scenario_of_log(log_with(reference=PLUGIN)).reference.center_m == (1.0, 2.0, 3.0)


def test_base_positions_are_read_from_the_log():
    ds = flights.dataset(np.random.default_rng(1))
    ds.p_base[:] = 7.0
    np.testing.assert_array_equal(poses.base_positions(ds, flights.PAPER.team), ds.p_base)


def test_base_positions_of_older_logs_are_computed():
    shape, rng = flights.MIXED, np.random.default_rng(2)
    rows, sigma = flights.rows(rng, shape), flights.sigma(rng, shape)
    old = log_upgrade.upgrade(old_logs.schema_2(rows, sigma, shape, scenario_json=old_logs.scenario_json(shape)))
    assert "p_base" not in old
    new = flights.dataset(np.random.default_rng(2), shape)
    np.testing.assert_array_equal(new.x, old.x)
    np.testing.assert_array_equal(poses.base_positions(old, shape.team), new.p_base)
