"""Tests of the figure of a team without a flight."""

from __future__ import annotations

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

from colift import scenario
from colift.cli.app import app
from colift.runtime import run_directory
from colift.scenario import initial_states, team
from colift.visualization import team_figure
from tests.support import playback_logs as played


@pytest.fixture(scope="module")
def settings() -> scenario.Scenario:
    return played.short_flight()


def test_forces_in_hover_carry_the_weight(settings):
    """Contact forces carry the payload, and thrusts carry the whole team."""
    truth, _ = team.team(settings)
    tracks = team_figure.scenario_data(settings).signals
    g = -np.asarray(truth.gravity)
    weight = float(truth.payload.mass) * g
    np.testing.assert_allclose(tracks["lam"][0].sum(0), weight, atol=1e-9)
    agents = sum(float(np.asarray(group.mass).sum()) for group in truth.agent_groups)
    assert tracks["u"].sum() >= (weight[2] + agents * g[2]) * (1 - 1e-9)


def test_poses_are_those_of_the_initial_state(settings):
    truth, _ = team.team(settings)
    z, data = initial_states.initial_state(settings, truth, moving=False), team_figure.scenario_data(settings)
    np.testing.assert_allclose(data.signals["p"][0], z.payload.p)
    tips = data.signals["nodes"][0][[node == "tip" for node in data.shape["nodes"]]]
    at = np.array([contact["at_m"] for contact in data.shape["contacts"]])
    np.testing.assert_allclose(tips, np.asarray(z.payload.p) + at @ np.asarray(z.payload.R).T, atol=1e-9)
    assert data.signals["p_d"].shape == (team_figure.PATH_POINTS, 3)


def test_figure_states_names_forces_and_key(settings):
    data = team_figure.scenario_data(settings)
    figure = team_figure.plot_team(data, values=True)
    texts = [text.get_text() for text in figure.axes[0].texts]
    assert texts[0] == f"{data.shape['agents'][0]['name']}\n{data.signals['u'][0, 0]:.3g} N"
    key = [text.get_text() for text in figure.legends[0].get_texts()]
    assert key[0] == f"thrust, {data.arrow_scales['thrust']:g} N per m"
    assert not any("disturbance" in text for text in key)  # none is drawn


def test_draw_writes_pdf_and_png_and_replaces_its_own(tmp_path):
    command = ["draw", "hover", "--out", str(tmp_path / "d")]
    files = [tmp_path / "d" / f"team.{kind}" for kind in ("pdf", "png")]
    for overrides in ([], ["--set", "payload.mass_kg=1.6"]):
        result = CliRunner().invoke(app, [*command, *overrides], catch_exceptions=False)
        assert (result.exit_code, result.stdout) == (0, f"the team is drawn in {files[0]} and {files[1]}\n")
    assert len({run_directory.read_run_id(file) for file in files}) == 1
    with Image.open(files[1]) as image:
        assert image.width > 2000
    files[0].write_bytes(b"mine")
    result = CliRunner().invoke(app, command)
    assert (result.exit_code, result.stderr.count("\n")) == (2, 1)
    assert files[0].read_bytes() == b"mine"
