"""Tests of scenario templates: they are valid, and `check` passes."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from colift import scenario
from colift.analysis import preflight, remedies
from colift.cli.app import app
from colift.models import grasp
from colift.onboard.control import bound_tips
from colift.scenario import controllers, initial_states, team, template

VEHICLE = """<robot name="two hands">
  <link name="base"><inertial><mass value="1.5"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.035" ixy="0" ixz="0" iyz="0"/></inertial></link>
  {arms}
</robot>
"""
ARM = """<link name="{name}"><inertial><origin xyz="0 0 -0.05"/><mass value="0.1"/>
    <inertia ixx="1e-4" iyy="1e-4" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="{name} hand"/>
  <joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/><origin xyz="{x} 0 0"/>
    <axis xyz="0 1 0"/><limit lower="-2" upper="2" effort="5" velocity="5"/></joint>
  <joint name="{name} wrist" type="fixed"><parent link="{name}"/><child link="{name} hand"/>
    <origin xyz="0 0 -0.1"/></joint>
"""


def test_template_passes_the_preflight_check(tmp_path: Path):
    """The smallest team; `./dev evidence starts` has larger ones and simulates them."""
    agents, arms = 3, 0
    file = tmp_path / "my_team.yaml"
    written = CliRunner().invoke(app, ["init", str(file), "--agents", str(agents), "--arms", str(arms)])
    assert written.exit_code == 0, written.stderr
    assert written.stdout == f"{file}: {agents} agents; next: colift check {file}\n"
    settings = scenario.load_scenario(file)
    assert (settings.name, len(settings.agents)) == ("my_team", agents)
    found = preflight.run_preflight(settings)
    assert found.passed, "\n".join(found.format_report())


@pytest.mark.parametrize("arms", [0, 1, 2])
@pytest.mark.parametrize("agents", [2, 3, 5, 12])
def test_vehicles_are_apart_and_on_their_contacts(agents: int, arms: int):
    if arms < 2 and agents < 3:
        with pytest.raises(ValueError, match=rf"--agents 2: must be from 3 to 100 with --arms {arms}"):
            template.scenario_template("t", agents, arms)
        return
    settings = scenario.parse(template.scenario_template("t", agents, arms), "t.yaml")
    places = np.array([np.mean(agent.contact_positions_m, axis=0) for agent in settings.agents])
    apart = np.linalg.norm(places[:, None] - places, axis=2) + 10 * np.eye(agents)
    assert apart.min() > (1.0 if arms == 2 else 0.49)
    values = grasp.grasp_matrix_singular_values(team.team(settings)[0], length=0.5)
    assert values[0] < 6 * values[-1]


@pytest.mark.parametrize(("agents", "arms"), [(1, 2), (0, 2), (101, 1), (3, 3), (3, -1)])
def test_impossible_team_is_refused_in_one_line(agents: int, arms: int, tmp_path: Path):
    file = tmp_path / "t.yaml"
    done = CliRunner().invoke(app, ["init", str(file), "--agents", str(agents), "--arms", str(arms)])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "must be" in done.stderr
    assert not file.exists()


def test_no_file_is_overwritten_and_suffix_is_yaml(tmp_path: Path):
    file = tmp_path / "mine.yaml"
    file.write_text("mine")
    done = CliRunner().invoke(app, ["init", str(file)])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert done.stderr == f"{file}: exists; it is not overwritten\n"
    assert file.read_text() == "mine"
    assert CliRunner().invoke(app, ["init", str(tmp_path / "mine")]).exit_code == 2
    assert CliRunner().invoke(app, ["init", str(tmp_path / "none" / "mine.yaml")]).exit_code == 2


@pytest.mark.parametrize(("stem", "name"), [("team", "team"), ("my team", "my_team"), ("2nd", "_2nd"), ("Ä", "_")])
def test_any_file_name_gives_a_scenario_name(stem: str, name: str):
    assert template.scenario_name(Path("there") / f"{stem}.yaml") == name
    assert scenario.parse(template.scenario_template(name, 2, 2), "t.yaml").name == name


def urdf(folder: Path, *arms: str) -> Path:
    file = folder / "vehicle.urdf"
    file.write_text(VEHICLE.format(arms="".join(arms)))
    return file


def test_urdf_vehicle_has_its_tips_on_the_plate(tmp_path: Path):
    upper = ARM.format(name="upper", parent="base", x=0.1)
    file = urdf(tmp_path, upper, ARM.format(name="lower", parent="upper", x=0.05))
    made = tmp_path / "teams" / "mine.yaml"
    made.parent.mkdir()
    done = CliRunner().invoke(app, ["init", str(made), "--agents", "3", "--urdf", str(file)])
    assert done.exit_code == 0, done.stderr
    assert 'urdf: "../vehicle.urdf"' in made.read_text()
    settings = scenario.load_scenario(made)
    assert [arm.name for arm in settings.agent_types["vehicle"].arms] == ["hand_1"]
    truth, _ = team.team(settings)
    z = initial_states.equilibrium_state(settings, truth)
    assert np.abs(np.asarray(z.agents[0].r)).max() < 1e-6


def test_planar_arms_lie_along_the_tangent(tmp_path: Path):
    """The tip is 0.15 m ahead of the base. The contacts stay on a circle, and yaw acts by the joints alone."""
    upper = ARM.format(name="upper", parent="base", x=0.1)
    file = urdf(tmp_path, upper, ARM.format(name="lower", parent="upper", x=0.05))
    made = tmp_path / "mine.yaml"
    done = CliRunner().invoke(app, ["init", str(made), "--urdf", str(file)])
    assert done.stdout.startswith("the joints move the tips in one plane: the headings are turned by 90 deg")
    settings = scenario.load_scenario(made)
    assert [agent.yaw_deg for agent in settings.agents] == [90, 210, 330]
    for agent, deg in zip(settings.agents, (0, 120, 240), strict=True):
        ((x, y, _),) = agent.contact_positions_m
        assert np.degrees(np.arctan2(y, x)) % 360 == pytest.approx(deg, abs=1e-2)
    truth, _ = team.team(settings)
    assert bound_tips.yaw_zero(controllers.agents_in_hover(settings, truth)) > 50


def test_arms_about_two_axes_keep_outward_headings(tmp_path: Path):
    upper = ARM.format(name="upper", parent="base", x=0.0)
    lower = ARM.format(name="lower", parent="upper", x=0.0).replace('xyz="0 1 0"', 'xyz="1 0 0"')
    made = tmp_path / "mine.yaml"
    done = CliRunner().invoke(app, ["init", str(made), "--urdf", str(urdf(tmp_path, upper, lower))])
    assert "turned" not in done.stdout
    assert [agent.yaw_deg for agent in scenario.load_scenario(made).agents] == [0, 120, 240]


def test_straight_arms_are_bent(tmp_path: Path):
    """The paper's vehicle as a URDF file: both arms are vertical at zero, where their tips cannot follow the
    payload.
    """
    assert CliRunner().invoke(app, ["export", "urdf", "paper", "--out", str(tmp_path)]).exit_code == 0
    made = tmp_path / "mine.yaml"
    done = CliRunner().invoke(app, ["init", str(made), "--urdf", str(tmp_path / "two_arms.urdf"), "--agents", "2"])
    assert done.exit_code == 0, done.stderr
    settings = scenario.load_scenario(made)
    assert [joint.nominal_position_rad for joint in settings.agent_types["vehicle"].joints] == [0.0, 1.2, -1.2]
    truth, _ = team.team(settings)
    z = initial_states.equilibrium_state(settings, truth)
    np.testing.assert_allclose(np.asarray(z.agents[0].r)[0], [0.0, 1.2, -1.2], atol=1e-3)
    assert all(condition < 20 for condition in remedies.grasp_jacobian_conditions(settings, truth, z).values())


def test_joints_stay_at_zero_if_no_bend_helps(tmp_path: Path):
    """Two planar arms about one axis: no joint motion separates their tips sideways."""
    hands = [ARM.format(name=name, parent="base", x=x) for name, x in (("ahead", 0.1), ("behind", -0.1))]
    lower = [ARM.format(name=f"{name} lower", parent=name, x=0.0) for name in ("ahead", "behind")]
    made = tmp_path / "mine.yaml"
    file = urdf(tmp_path, *hands, *lower)
    done = CliRunner().invoke(app, ["init", str(made), "--agents", "2", "--urdf", str(file)])
    assert done.exit_code == 0, done.stderr
    assert "    # nominal_position_rad" in made.read_text()


@pytest.mark.parametrize(
    ("arguments", "answer"),
    [
        (["--agents", "2"], "--agents 2: each holds the payload at 1, and three contacts are needed"),
        (["--agents", "3", "--arms", "1"], "--arms 1: must be omitted with --urdf"),
        (["--agents", "101"], "--agents 101: must be at most 100"),
    ],
)
def test_options_incompatible_with_urdf_are_refused(arguments: list[str], answer: str, tmp_path: Path):
    made = tmp_path / "mine.yaml"
    done = CliRunner().invoke(app, ["init", str(made), "--urdf", str(urdf(tmp_path)), *arguments])
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert answer in done.stderr


def test_invalid_urdf_file_is_reported_with_its_place(tmp_path: Path):
    bad = tmp_path / "bad.urdf"
    bad.write_text("<robot>")
    for file, answer in ((bad, "bad.urdf:1"), (tmp_path / "none.urdf", "none.urdf")):
        done = CliRunner().invoke(app, ["init", str(tmp_path / "mine.yaml"), "--urdf", str(file)])
        assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
        assert answer in done.stderr
