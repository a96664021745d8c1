"""Logs of schemas 1 to 3 are read as logs of schema 4; newer ones are refused."""

import numpy as np
import pytest
import xarray as xr

from colift.closed_loop import log, log_checks, log_upgrade
from tests.support import old_logs
from tests.support import random_logs as flights


def made(shape, **attrs):
    """A random flight: today's log of it, and what older versions wrote."""
    rng = np.random.default_rng(4)
    rows, sigma = flights.rows(rng, shape), flights.sigma(rng, shape)
    stated = {"termination_reason": "limit", "refits": "2 s", "update_times_s": [0.02, 0.05], "T_end_s": 0.05}
    attrs = {"scenario_json": old_logs.scenario_json(shape)} | stated | attrs
    new = log.dataset(rows, team=shape.team, sigma=sigma, attrs=attrs, **shape.names)
    return new, old_logs.schema_2(rows, sigma, shape, **attrs)


@pytest.mark.parametrize("shape", [flights.PAPER, flights.MIXED])
@pytest.mark.parametrize("schema", [1, 2])
def test_older_logs_are_read_as_those_of_today(shape, schema, tmp_path):
    """All but the base positions, which depend on the parameters of the team, and signals of the corrector."""
    new, old = made(shape)
    log.save(old if schema == 2 else old_logs.schema_1(old), tmp_path / "C3.nc")
    found = log.load(tmp_path / "C3.nc")
    lacking = ["p_base", *(name for name in new if str(name).startswith(log_checks.CORRECTOR))]
    xr.testing.assert_identical(found.drop_attrs(deep=False), new.drop_vars(lacking).drop_attrs(deep=False))
    for name, x in found.variables.items():
        assert x.attrs == new[name].attrs, name
    assert found.attrs["schema"] == 4
    assert found.attrs["Conventions"] == "CF-1.11"
    dropped = "fresh, trust_x" if schema == 1 else "correction_weight, model_gain_x"
    assert found.attrs["history"] == f"upgraded from schema {schema} without {dropped}"
    assert (found.attrs["termination_reason"], found.attrs["refits"]) == ("limit", "2 s")


def test_logs_of_the_innovation_filter_are_read(tmp_path):
    """The innovation as applied is the correction; signals without a present meaning are dropped and named."""
    new, _ = made(flights.MIXED)
    log.save(old_logs.schema_3(new), tmp_path / "C3.nc")
    found = log.load(tmp_path / "C3.nc")
    lacking = [name for name in new if str(name).startswith(log_checks.CORRECTOR)]
    xr.testing.assert_identical(found.drop_attrs(deep=False), new.drop_vars(lacking).drop_attrs(deep=False))
    for name, x in found.variables.items():
        assert x.attrs == new[name].attrs, name
    expected = new.attrs["history"] + "; upgraded from schema 3 without correction_weight, model_gain_x"
    assert found.attrs["history"] == expected


def test_logs_of_today_are_returned_as_they_are():
    new, _ = made(flights.PAPER)
    assert log_upgrade.upgrade(new) is new


def test_without_a_scenario_all_joints_are_revolute():
    _, old = made(flights.MIXED)
    del old.attrs["scenario_json"]
    found = log_upgrade.upgrade(old)
    assert "r_prismatic" not in found
    assert found.joint.values.tolist() == flights.MIXED.names["joints"]


def test_logs_of_a_newer_schema_are_refused(tmp_path):
    new, _ = made(flights.PAPER)
    log.save(new.assign_attrs(schema=5), tmp_path / "C3.nc")
    with pytest.raises(ValueError, match=r"C3\.nc: the log has schema 5; .* update colift"):
        log.load(tmp_path / "C3.nc")
