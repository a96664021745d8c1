"""Tests of the figure of limits and faults."""

from __future__ import annotations

import json

import numpy as np
import pytest
import xarray as xr

from colift.visualization import axes, limit_figures
from tests.support.study_logs import TOLD

OTHERS = ("tilt_limited", "friction_limited", "force_limited", "slack_roll_pitch", "slack_xy")

pytestmark = pytest.mark.usefixtures("style")


@pytest.fixture
def limited(cases):
    """Flight with an allocation within limits, a fault from 8 s to 11 s, and a thrust at its limit from 9 s to 10 s."""
    ds = cases["C3"].copy(deep=True).drop_vars(OTHERS)
    settings = json.loads(ds.attrs["scenario_json"])
    settings["faults"] = [{"kind": "thrust", "who": "front", "to": 0.5, "start_s": 8, "end_s": 11}]
    acts = ((ds.time >= 9) & (ds.time < 10)).values
    of_agents = {"dims": ("time", "agent"), "data": np.repeat(acts[:, None], ds.sizes["agent"], axis=1)}
    ds["thrust_limited"] = xr.DataArray(of_agents["data"], dims=of_agents["dims"])
    ds["effectiveness"] = xr.DataArray(1 - 0.5 * of_agents["data"], dims=of_agents["dims"])
    ds["slack_z"] = xr.DataArray(0.2 * acts, dims="time")
    ds["slack_yaw"] = xr.DataArray(0.05 * acts, dims="time")
    ds["thrust_saturated"][:] = 0
    return ds.assign_attrs(scenario_json=json.dumps(settings))


def test_only_flights_with_limits_or_faults_have_the_figure(cases, limited):
    assert limit_figures.shows_limits(limited)
    assert limit_figures.shows_limits(limited.drop_vars("slack_z"))  # it has a fault
    assert not limit_figures.shows_limits(cases["C3"].drop_vars("slack_z"))


def test_bars_show_when_limits_act_and_bands_show_faults(limited):
    figure = limit_figures.plot_limits({"C3": limited}, TOLD)
    error, attitude, force, effectiveness, limits = figure.axes
    np.testing.assert_allclose(error.lines[0].get_ydata(), axes.norm(limited.e_p), rtol=1e-12)
    assert force.lines[0].get_ydata().max() == pytest.approx(np.linalg.norm(limited.lam, axis=-1).max())
    assert len(effectiveness.lines) == limited.sizes["agent"]
    assert [label.get_text() for label in limits.get_yticklabels()] == ["thrust limit", "yaw slack", "z slack"]
    drawn = [path.get_extents() for bar in limits.collections for path in bar.get_paths()]
    assert [round(box.y0 + 0.35) for box in drawn] == [0, 2]  # the slack of yaw is below the threshold
    for box in drawn:
        assert (box.x0, box.x1) == pytest.approx((9, 10), abs=0.051)
    for ax in (error, attitude, limits):
        (band,) = ax.patches
        assert (band.get_x(), band.get_x() + band.get_width()) == (8, 11)
    assert [text.get_text() for text in figure.legends[0].get_texts()] == [*limited.agent.values, "fault"]
