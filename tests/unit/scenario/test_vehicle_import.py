"""`colift init` with a vehicle from a file: what it writes, what it prints, and what it refuses."""

from __future__ import annotations

import os
from pathlib import Path

import jax.numpy as jnp
import numpy as np
import pytest
from click.testing import Result
from typer.testing import CliRunner

from colift import scenario
from colift.cli.app import app
from colift.models import aerial_manipulator, mjcf_import
from colift.scenario import ScenarioError, team

LINK = """<link name="{name}"><inertial><origin xyz="{com}"/><mass value="{m}"/>
<inertia ixx="{a}" iyy="{a}" izz="{c}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>
<axis xyz="{axis}"/>{limit}</joint>"""


def link(name: str, m: float = 0.1, a: float = 3e-4, c: float = 1e-5, com: str = "0 0 -0.1") -> str:
    return LINK.format(name=name, m=m, a=a, c=c, com=com)


def joint(
    name: str, parent: str, child: str, axis: str = "1 0 0", xyz: str = "0 0 0", kind: str = "revolute", limit: str = ""
) -> str:
    if kind in ("revolute", "prismatic"):
        limit = limit or '<limit lower="-1.5" upper="1.5" effort="5" velocity="6"/>'
    return JOINT.format(name=name, parent=parent, child=child, axis=axis, xyz=xyz, kind=kind, limit=limit)


BASE = link("base", 2.0, 0.02, 0.035, "0 0 0")
ROTORS = "".join(
    link(f"uav/rotor_{k}", 0.01, 4e-5, 4.1e-5, "0 0 0")
    + joint(f"uav/rotor_{k}_joint", "base", f"uav/rotor_{k}", "0 0 1", f"{x} {y} 0.03", "continuous")
    for k, (x, y) in enumerate(((0.2, 0.2), (-0.2, 0.2), (-0.2, -0.2), (0.2, -0.2)))
)
ARM = (
    link("upper")
    + joint("shoulder", "base", "upper")
    + link("fore")
    + joint("el/bow", "upper", "fore", "0 1 0", "0 0 -0.2")
)
FINGERS = "".join(
    link(f"finger_{side}", 0.01, 1e-6, 1e-6, "0 0 0")
    + joint(f"finger_{side}", "fore", f"finger_{side}", f"0 {y} 0", f"0 {0.01 * y} -0.2", "prismatic")
    for side, y in (("left", 1), ("right", -1))
)


def init(folder: Path, robot: str, *options: str) -> tuple[Path, Result]:
    file = folder / "vehicle.urdf"
    file.write_text(f'<robot name="r">{robot}</robot>', encoding="utf-8")
    made = folder / "mine.yaml"
    return made, CliRunner().invoke(app, ["init", str(made), "--urdf", str(file), *options])


def test_rotors_and_fingers_are_fixed_and_reported(tmp_path: Path) -> None:
    made, done = init(tmp_path, BASE + ROTORS + ARM + FINGERS)
    assert done.exit_code == 0, done.stderr
    rotors, gripper, mapped, last = done.stdout.splitlines()
    assert rotors.startswith("rotors: uav/rotor_0_joint, ")
    assert gripper == "gripper: finger_left, finger_right fixed, the fingers are one tip (frozen)"
    assert mapped == "names of joints in results: el/bow is el-2f-bow"
    assert last == f"{made}: 3 agents; next: colift check {made}"
    settings = scenario.load_scenario(made)
    kind = settings.agent_types["vehicle"]
    assert [j.name for j in kind.joints] == ["shoulder", "el-2f-bow"]
    assert kind.joints[0].position_limits == (-1.5, 1.5)
    assert (kind.joints[0].max_speed_radps, kind.joints[0].max_torque_Nm) == (6.0, 5.0)
    (arm,) = kind.arms
    assert (arm.name, arm.joint) == ("hand_1", "el-2f-bow")
    np.testing.assert_allclose(arm.tip_position_m, [0, 0, -0.2])
    assert kind.base.mass_kg == pytest.approx(2.04)


def test_a_vehicle_without_an_arm_holds_with_its_base(tmp_path: Path) -> None:
    made, done = init(tmp_path, BASE + ROTORS)
    assert done.exit_code == 0, done.stderr
    assert "no arm found: the base holds the payload at [0.0, 0.0, -0." in done.stdout
    (arm,) = scenario.load_scenario(made).agent_types["vehicle"].arms
    assert arm.joint == "base"


@pytest.mark.parametrize(("lower", "rest"), [("0.4", 0.5), ("0", 0.1)])
def test_joints_rest_away_from_their_limits(tmp_path: Path, lower: str, rest: float) -> None:
    """The nominal position is within the limits, with a distance from them, also if zero is a limit."""
    limit = f'<limit lower="{lower}" upper="2.7" effort="5" velocity="2"/>'
    made, done = init(tmp_path, BASE + link("arm") + joint("arm", "base", "arm", limit=limit))
    assert done.stdout.startswith(f"joint arm rests at {rest}, within its limits {lower} to 2.7\n")
    (arm,) = scenario.load_scenario(made).agent_types["vehicle"].joints
    assert arm.nominal_position_rad == rest


def test_joints_of_links_without_inertia_are_named(tmp_path: Path) -> None:
    """The error contains the option or the setting that fixes the joints."""
    empty = '<link name="{0}"/>'
    cross = "".join(
        empty.format(f"cross_{k}")
        + joint(f"pan_{k}", "base", f"cross_{k}", "0 0 1")
        + link(f"arm_{k}")
        + joint(f"tilt_{k}", f"cross_{k}", f"arm_{k}")
        for k in range(2)
    )
    robot = BASE + cross + joint("waist", "arm_0", "end") + link("end")
    _, done = init(tmp_path, robot)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert (
        "link 'cross_0' has no <inertial>; every body requires mass and inertia: choose --frozen pan_0,pan_1"
        in done.stderr
    )
    made, done = init(tmp_path, robot, "--frozen", "pan_0,pan_1")
    assert done.exit_code == 0, done.stderr
    text = made.read_text(encoding="utf-8").replace('frozen: ["pan_0", "pan_1"]', "frozen: []")
    with pytest.raises(ScenarioError, match=r"choose `frozen: \[pan_0, pan_1\]`"):
        scenario.parse(text, str(made))


def test_a_payload_reaches_as_far_as_long_arms(tmp_path: Path) -> None:
    """The plate has the contacts within its edge, and the gust a wavelength above their distances."""
    long = link("arm", 0.3, 0.02, com="1 0 0") + joint("pan", "base", "arm", "0 1 0")
    hand = '<link name="hand"/>' + joint("hand", "arm", "hand", xyz="3 0 0", kind="fixed")
    made, done = init(tmp_path, BASE + long + hand)
    assert done.exit_code == 0, done.stderr
    settings = scenario.load_scenario(made)
    reach = np.linalg.norm([agent.contact_positions_m[0] for agent in settings.agents], axis=1).max()
    assert reach > 3
    radius = 2 * np.sqrt(settings.payload.inertia_kgm2[0][0] / settings.payload.mass_kg)
    assert radius > reach


def test_contacts_of_arms_that_reach_inward_are_apart(tmp_path: Path) -> None:
    back = link("arm", 0.1, com="-0.2 0 0") + joint("pan", "base", "arm", "0 1 0")
    hand = '<link name="hand"/>' + joint("hand", "arm", "hand", xyz="-0.6 0 0", kind="fixed")
    made, done = init(tmp_path, BASE + back + hand)
    assert done.exit_code == 0, done.stderr
    contacts = np.array([agent.contact_positions_m[0] for agent in scenario.load_scenario(made).agents])
    assert np.linalg.norm(contacts[0] - contacts[1]) > 0.5
    assert contacts[0, 0] > 0


def test_options_choose_joints_tips_and_treatments(tmp_path: Path) -> None:
    coupled = joint("el/bow", "upper", "fore", "0 1 0", "0 0 -0.2").replace(
        "</joint>", '<mimic joint="shoulder"/></joint>'
    )
    robot = BASE + ROTORS + link("upper") + joint("shoulder", "base", "upper") + link("fore") + coupled
    _, done = init(tmp_path, robot)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1)
    assert "choose --mimic frozen (fixed at the rest position of that joint) or --mimic independent" in done.stderr
    made, done = init(
        tmp_path, robot, "--mimic", "independent", "--tips", "upper", "--frozen", "el-2f-bow,uav/rotor_1_joint"
    )
    assert done.exit_code == 0, done.stderr
    kind = scenario.load_scenario(made).agent_types["vehicle"]
    assert [each.name for each in kind.joints] == ["shoulder"]
    assert kind.arms[0].joint == "shoulder"
    made.unlink()
    made, done = init(tmp_path, robot, "--mimic", "independent", "--tips", "upper", "--frozen", "")
    assert len(scenario.load_scenario(made).agent_types["vehicle"].joints) == 6


def test_a_balanced_inertia_is_reported(tmp_path: Path) -> None:
    flat = link("base", 2.0, 0.02, 0.06, "0 0 0")
    _, done = init(tmp_path, flat)
    assert done.exit_code == 2
    assert "0.06 > 0.04: choose --inertia balanced (the closest moments that satisfy it)" in done.stderr
    made, done = init(tmp_path, flat, "--inertia", "balanced")
    assert "principal moments 0.02, 0.02, 0.06 kg m^2 violate the triangle inequality: balanced to" in done.stdout
    assert "    inertia: balanced\n" in made.read_text(encoding="utf-8")
    scenario.load_scenario(made)


CHAIN = "".join(
    link(f"l{k}") + joint(f"j{k}", f"l{k - 1}" if k else "base", f"l{k}", xyz="0 0 -0.2") for k in range(20)
)
TWO_HANDS = "".join(link(f"h{k}") + joint(f"h{k}", "base", f"h{k}", xyz=f"0 {0.2 * k} 0") for k in range(2))


@pytest.mark.parametrize(
    ("robot", "options", "answer"),
    [
        (BASE + CHAIN, (), r"vehicle.urdf:"),
        (
            BASE + CHAIN,
            (),
            "20 joints move, up to 10 are possible: fix 10 more, for example the last ones: --frozen j10,j11,j12,",
        ),
        (BASE + TWO_HANDS, (), "2 joints are too few for 2 tips (links 'h0', 'h1'): 3 or more are required"),
        (BASE + ARM, ("--frozen", "elbow"), "--frozen: 'elbow' is not a joint that moves (shoulder, el/bow)"),
        (BASE + ARM, ("--tips", "hand"), "--tips: 'hand' is not a link of the file (base, upper, fore)"),
        (BASE.replace('"2.0"', '"200000"'), ("--agents", "3"), "the vehicle is outside of the range of a scenario"),
        (BASE + link("a" * 101) + joint("j" * 101, "base", "a" * 101), (), "needs more than 100 characters"),
    ],
)
def test_what_cannot_be_written_is_refused_in_one_line(
    robot: str, options: tuple[str, ...], answer: str, tmp_path: Path
) -> None:
    made, done = init(tmp_path, robot, *options)
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output
    assert answer in done.stderr
    assert not made.exists()


def test_options_for_a_file_need_one(tmp_path: Path) -> None:
    done = CliRunner().invoke(app, ["init", str(tmp_path / "t.yaml"), "--frozen", "a"])
    assert (done.exit_code, done.stderr) == (2, "--frozen: must be used with --urdf or --mjcf\n")


def test_odd_names_are_quoted(tmp_path: Path) -> None:
    """Names with quotes, control characters and characters beyond the basic plane."""
    odd = "a&quot;\\&#9;&#10;\U0001f600&#133;"
    made, done = init(tmp_path, BASE + link(odd) + joint(odd, "base", odd))
    assert done.exit_code == 0, done.stderr
    assert len(scenario.load_scenario(made).agent_types["vehicle"].joints) == 1


MJCF = """<mujoco><compiler angle="radian" inertiafromgeom="false"/>
<asset><mesh name="m" file="none.obj"/><material name="grey"/></asset>
<worldbody><geom type="plane" size="1 1 1" material="grey"/>
<body name="uav" pos="0 0 1"><freejoint/><geom type="mesh" mesh="m"/>
  <inertial pos="0 0 0.01" mass="2" diaginertia="0.02 0.02 0.035"/>
  <body name="upper" pos="0 0 -0.05" quat="0.7071067811865476 0 0 0.7071067811865476">
    <joint name="shoulder" type="hinge" axis="1 0 0" pos="0 0 0.01" range="-1 1" limited="true" damping="0.1"/>
    <inertial pos="0 0 -0.08" mass="0.15" diaginertia="3e-4 3e-4 3e-5"/>
    <body name="fore" pos="0 0 -0.16">
      <joint name="elbow" type="hinge" axis="0 1 0"/>
      <inertial pos="0.01 0 -0.07" mass="0.1" diaginertia="2e-4 2e-4 2e-5"/>
      <site name="tool_tip" pos="0 0 -0.14"/>
    </body></body></body></worldbody></mujoco>"""


def init_mjcf(folder: Path, text: str, *options: str) -> tuple[Path, Result]:
    file, made = folder / "vehicle.xml", folder / "mine.yaml"
    file.write_text(text, encoding="utf-8")
    return made, CliRunner().invoke(app, ["init", str(made), "--mjcf", str(file), *options])


def test_an_mjcf_vehicle_has_the_mass_matrix_of_mujoco(tmp_path: Path) -> None:
    mujoco = pytest.importorskip("mujoco")
    made, done = init_mjcf(tmp_path, MJCF)
    assert done.exit_code == 0, done.output
    settings = scenario.load_scenario(made)
    kind = settings.agent_types["vehicle"]
    assert [joint.name for joint in kind.joints] == ["shoulder", "elbow"]
    assert kind.joints[0].position_limits == (-1.0, 1.0)
    agent = team.agent_models(settings)["vehicle"]
    r = np.array([0.3, -0.7])
    found = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, jnp.asarray(r)))

    spec = mujoco.MjSpec.from_string(MJCF.replace('<geom type="mesh" mesh="m"/>', "").replace('file="none.obj"', MESH))
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:] = [0, 0, 0, 1, 0, 0, 0, *r]
    mujoco.mj_forward(model, data)
    full = np.zeros((model.nv, model.nv))
    mujoco.mj_fullM(model, data, full)
    lin, mixed, own = full[:3, :3], full[:3, 3:], full[3:, 3:]
    np.testing.assert_allclose(found.M_bar, own - mixed.T @ np.linalg.solve(lin, mixed), atol=1e-12)
    np.testing.assert_allclose(found.com_from_base, data.subtree_com[1], atol=1e-12)
    np.testing.assert_allclose(found.tip_from_com[0] + found.com_from_base, data.site("tool_tip").xpos, atol=1e-12)


@pytest.mark.parametrize("stated", ['diaginertia="0.02 0.02 0.06"', 'fullinertia="0.02 0.02 0.06 0 0 0"'])
def test_an_mjcf_inertia_is_balanced_as_asked(stated: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    flat = MJCF.replace('diaginertia="0.02 0.02 0.035"', stated)
    _, done = init_mjcf(tmp_path, flat)
    assert done.exit_code == 2
    assert "0.06 > 0.04: choose --inertia balanced" in done.stderr
    made, done = init_mjcf(tmp_path, flat, "--inertia", "balanced")
    assert "balanced to 0.02667, 0.02667, 0.05333" in done.stdout, done.stderr
    base = scenario.load_scenario(made).agent_types["vehicle"].base
    np.testing.assert_allclose(np.diag(base.inertia_kgm2), [0.08 / 3, 0.08 / 3, 0.16 / 3], rtol=1e-5)


@pytest.mark.parametrize("option", ['settotalmass="3"', 'boundmass="3"'])
def test_an_mjcf_inertia_that_the_compiler_scales_is_refused(option: str, tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    flat = MJCF.replace('diaginertia="0.02 0.02 0.035"', 'diaginertia="0.02 0.02 0.06"')
    _, done = init_mjcf(tmp_path, flat.replace("<compiler ", f"<compiler {option} "))
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output
    assert "body 'uav': the principal moments violate the triangle inequality" in done.stderr


def test_valid_mjcf_inertias_are_those_of_mujoco(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    made, done = init_mjcf(tmp_path, MJCF.replace("<compiler ", '<compiler boundinertia="0.05" '))
    assert done.exit_code == 0, done.output
    base = scenario.load_scenario(made).agent_types["vehicle"].base
    np.testing.assert_allclose(base.inertia_kgm2, 0.05 * np.eye(3), atol=1e-9)


def test_unread_properties_of_mjcf_joints_are_named(tmp_path: Path) -> None:
    pytest.importorskip("mujoco")
    _, done = init_mjcf(tmp_path, MJCF.replace('axis="0 1 0"', 'axis="0 1 0" armature="0.05" stiffness="2"'))
    assert "armature (add it to the inertia of the body) is not read: elbow\n" in done.stdout
    assert "stiffness is not read: elbow\n" in done.stdout


MESH = 'vertex="0 0 0 1 0 0 0 1 0 0 0 1"'


@pytest.mark.parametrize(
    ("written", "instead", "answer"),
    [
        (
            "<freejoint/>",
            "<freejoint/><inertial pos='0 0 0' mass='1' diaginertia='1 1 1'/></body><body name='other'><freejoint/>",
            "one vehicle is required: a body of the world with a free joint; found: ",
        ),
        ('type="hinge" axis="0 1 0"', 'type="ball"', "body 'fore' has a joint that is neither a hinge nor a slide"),
        (
            "</worldbody>",
            "</worldbody><equality><weld name='w' body1='fore' body2='uav'/></equality>",
            "'w' closes a loop",
        ),
        ("<mujoco>", "<mujoco><x/>", "MuJoCo: "),
        ('mass="0.15"', 'mass="nan"', ""),
        ('pos="0 0 -0.16"', 'pos="0 nan -0.16"', "'elbow' has a pose, axis or limit that is not finite or too large"),
        ('mass="0.1"', 'mass="1e300"', "body 'fore' has a mass or inertia that is not finite or too large"),
    ],
)
def test_an_mjcf_file_without_a_vehicle_is_refused(
    written: str, instead: str, answer: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("mujoco")
    monkeypatch.chdir(tmp_path)
    _, done = init_mjcf(tmp_path, MJCF.replace(written, instead, 1))
    assert (done.exit_code, done.stderr.count("\n")) == (2, 1), done.output
    assert answer in done.stderr
    assert sorted(file.name for file in tmp_path.iterdir()) == ["vehicle.xml"]  # neither a scenario nor a log of MuJoCo


def test_an_mjcf_mesh_with_material_may_define_the_inertia(tmp_path: Path) -> None:
    """Materials are removed, also from a mesh that defines the inertia of its body and from default classes."""
    pytest.importorskip("mujoco")
    text = MJCF.replace('inertiafromgeom="false"', "").replace('file="none.obj"', 'vertex="0 0 0 .1 0 0 0 .1 0 0 0 .1"')
    text = text.replace("<asset>", '<default><geom material="grey"/></default><asset>')
    text = text.replace(
        '<inertial pos="0.01 0 -0.07" mass="0.1" diaginertia="2e-4 2e-4 2e-5"/>',
        '<geom type="mesh" mesh="m" mass="0.1" material="grey"/>',
    )
    made, done = init_mjcf(tmp_path, text)
    assert done.exit_code == 0, done.stderr
    assert scenario.load_scenario(made).agent_types["vehicle"].joints[1].body.mass_kg == pytest.approx(0.1)


MESH_GEOM = '<geom type="mesh" mesh="m" mass="1"/></body></body></body></worldbody>'


@pytest.mark.parametrize(
    ("written", "instead", "pipe"),
    [
        (None, None, "vehicle.xml"),
        ("<asset>", '<include file="part.xml"/><asset>', "part.xml"),
        ("</body></body></body></worldbody>", MESH_GEOM, "none.obj"),
    ],
)
def test_mjcf_files_that_are_pipes_are_refused(
    written: str | None, instead: str | None, pipe: str, tmp_path: Path
) -> None:
    """MuJoCo would wait for a writer; the mesh has an influence on the inertia of its body."""
    pytest.importorskip("mujoco")
    text = MJCF if written is None or instead is None else MJCF.replace(written, instead, 1)
    text = text.replace('inertiafromgeom="false"', "").replace(
        '      <inertial pos="0.01 0 -0.07" mass="0.1" diaginertia="2e-4 2e-4 2e-5"/>\n', ""
    )
    (tmp_path / "vehicle.xml").write_text(text, encoding="utf-8")
    (tmp_path / pipe).unlink(missing_ok=True)
    os.mkfifo(tmp_path / pipe)
    with pytest.raises(OSError, match="a pipe, socket or device, not a regular file"):
        mjcf_import.read_mjcf(tmp_path / "vehicle.xml")
