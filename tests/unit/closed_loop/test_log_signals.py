"""Units of the log's variables, and the helpers that put split signals together again."""

import runpy
from pathlib import Path

import numpy as np
import pint
import pytest
import xarray as xr

from colift.closed_loop import log, log_signals
from tests.support import random_logs as flights

UREG = pint.UnitRegistry()


def test_pint_reads_every_unit():
    for name, spec in log_signals.SPECS.items():
        assert isinstance(UREG.Unit(spec.units), pint.Unit), name


def test_pint_reads_every_unit_of_a_dataset():
    """Coordinates too: a quantity can be made of every variable that has a unit."""
    ds = flights.dataset(np.random.default_rng(1), flights.MIXED)
    units = {name: UREG.Unit(x.attrs["units"]) for name, x in ds.variables.items() if "units" in x.attrs}
    assert set(ds.data_vars) <= set(units)
    power = ds.tau.values[:, 0] * units["tau"] @ (ds.omega.values[0, 0] * units["omega"])
    assert power.check("[power]")
    assert UREG.Quantity(1, units["W_d_moment"]).check("[energy]")
    assert units["time"] == UREG.second


@pytest.mark.parametrize(
    ("part", "whole", "dimension"),
    [("r", "r_dot", "1/[time]"), ("r_prismatic", "r_dot_prismatic", "1/[time]"), ("r", "tau_r", "[energy]")],
)
def test_units_of_joint_variables(part, whole, dimension):
    of = {name: UREG.Unit(spec.units) for name, spec in log_signals.SPECS.items()}
    assert (1 * of[whole] / of[part]).check(dimension)


def test_dimensions_are_known_and_no_variable_has_two_units():
    known = {"axis", "body_axis", "quaternion", "agent", "joint", "prismatic_joint", "contact", "eta_index"}
    for name, spec in log_signals.SPECS.items():
        assert set(spec.dims) <= known, name
        assert "(" not in spec.units, name
        assert ("1 m" in spec.long_name) == (name in ("sigma_L", "sigma_A", "rho_bar_L", "rho_bar_j", *ADDED)), name


ADDED = ("sigma_A_moment", "rho_bar_j_moment")
"""Moments with forces of prismatic joints."""


def test_parts_are_stacked_with_names():
    ds = flights.dataset(np.random.default_rng(2))
    stacked = log.stack_parts(ds, "delta_W")
    np.testing.assert_array_equal(stacked.sel(component="F_y"), ds.delta_W_force.sel(axis="y"))
    np.testing.assert_array_equal(stacked.sel(component="tau_z"), ds.delta_W_moment.sel(axis="z"))
    acceleration = log.stack_parts(ds.isel(time=slice(3, 9)), "a_L")
    np.testing.assert_array_equal(acceleration[:, 3:], ds.alpha_L[3:9])
    assert acceleration.time.values.tolist() == ds.time.values[3:9].tolist()
    with pytest.raises(KeyError):
        log.stack_parts(ds, "p")


def test_all_joints_are_in_team_order():
    ds = flights.dataset(np.random.default_rng(3), flights.MIXED)
    joints = log.all_joints(ds, "tau_r")
    assert joints.joint.values.tolist() == flights.MIXED.names["joints"]
    np.testing.assert_array_equal(joints.sel(joint=ds.joint.values), ds.tau_r)
    np.testing.assert_array_equal(joints.sel(joint=ds.prismatic_joint.values), ds.tau_r_prismatic)
    assert log.all_joints(ds, "sigma_f_r").dims == ("time_sigma", "joint")
    with pytest.raises(KeyError, match="p is not a joint signal"):
        log.all_joints(ds, "p")


def test_a_team_without_joints_has_no_joint_variables():
    ds = flights.dataset(np.random.default_rng(3), flights.Shape(groups=((3, 0, 1),)))
    assert not {"r", "r_prismatic", "joint", "prismatic_joint"} & set(ds.variables)
    assert log.all_joints(ds, "r").shape == (ds.sizes["time"], 0)
    assert isinstance(log.all_joints(ds, "rho_f_r"), xr.DataArray)


def test_a_team_of_prismatic_joints_only():
    ds = flights.dataset(np.random.default_rng(3), flights.MIXED)
    only = ds.drop_vars([name for name, x in ds.variables.items() if "joint" in x.dims])
    np.testing.assert_array_equal(log.all_joints(only, "r"), ds.r_prismatic)


def test_the_reference_page_lists_every_variable():
    docs = Path(__file__).parents[3] / "docs"
    page = (docs / "log_variables.md").read_text(encoding="utf-8")
    told = runpy.run_path(str(docs / "log_variables.py"))["tables"]()
    assert page.partition("<!-- variables -->\n")[2].strip() == told.strip(), "run docs/log_variables.py"
