"""Tests of agents from URDF: against Pinocchio's reader on random trees, and every refusal."""

from __future__ import annotations

import dataclasses
import re
from pathlib import Path
from types import SimpleNamespace

import jax
import numpy as np
import pinocchio as pin
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from colift import scenario
from colift.models import aerial_manipulator, link_tree, urdf, urdf_parser
from colift.models.parameters import AerialManipulator
from colift.runtime import bounded_read
from colift.scenario import ScenarioError, team
from tests.support import pinocchio_team
from tests.support import random_teams as teams


def words(values: np.ndarray) -> str:
    return " ".join(repr(float(x)) for x in values)


def link(rng: np.random.Generator, name: str, mass: float) -> str:
    """Return a link with an inertial about a random point and attitude, or without one for zero mass."""
    if mass == 0:
        return f'<link name="{name}"/>'
    J = teams.inertia(rng, mass, 0.1)
    axes = [("xyz"[i] + "xyz"[k], i, k) for i in range(3) for k in range(i, 3)]
    entries = " ".join(f'i{a}="{float(J[i, k])!r}"' for a, i, k in axes)
    return (
        f'<link name="{name}"><inertial><origin xyz="{words(0.1 * rng.normal(size=3))}" '
        f'rpy="{words(rng.uniform(-3, 3, 3))}"/><mass value="{mass!r}"/>'
        f"<inertia {entries}/></inertial>"
        "<visual><geometry><box size='1 1 1'/></geometry></visual></link>"
    )


def random_urdf(rng: np.random.Generator, links: int) -> tuple[str, list[str]]:
    """Return a random tree of links, joints and names in random order, and the links of its tips."""
    names = [f"{letter}{i}" for i, letter in enumerate(rng.permutation(list("abcdefghijklmnop"))[:links])]
    kinds = ["revolute", "continuous", "prismatic", "fixed"]
    parts = [link(rng, names[0], 1.5)]
    for i in range(1, links):
        kind = kinds[rng.integers(4)]
        massless = kind == "fixed" and rng.uniform() < 0.5
        parts.append(link(rng, names[i], 0.0 if massless else float(rng.uniform(0.05, 0.3))))
        limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else ""
        axis = "" if rng.uniform() < 0.2 else f'<axis xyz="{words(rng.normal(size=3))}"/>'
        parts.append(
            f'<joint name="joint {rng.integers(10**6)}" type="{kind}"><parent link="{names[rng.integers(i)]}"/>'
            f'<child link="{names[i]}"/><origin xyz="{words(0.2 * rng.normal(size=3))}" '
            f'rpy="{words(rng.uniform(-3, 3, 3))}"/>{axis}{limit}</joint>'
        )
    tips = [names[i] for i in rng.choice(links, size=2, replace=False)]
    return (
        f'<?xml version="1.0"?>\n<robot name="r">{"".join(parts[k] for k in rng.permutation(len(parts)))}</robot>',
        tips,
    )


@pytest.mark.parametrize("seed", range(20))
def test_mass_matrix_and_tips_equal_pinocchio(seed: int) -> None:
    rng = np.random.default_rng(seed)
    text, tips = random_urdf(rng, int(rng.integers(2, 11)))
    robot = urdf.parse_urdf(text, "r.urdf")
    offset = 0.1 * rng.normal(size=3)
    agent = urdf.make_agent(robot, [tips[0], (tips[1], offset)], np.zeros((2, 3)).tolist(), 50.0)
    state = teams.agent_state(rng, agent.tree)
    model = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    data = model.createData()
    assert {j.name for j in robot.joints} == set(model.names) - {"universe", "root_joint"}

    index = np.array([model.joints[model.getJointId(j.name)].idx_v for j in robot.joints], int)
    q, v = pin.neutral(model), np.zeros(model.nv)
    for joint, r in zip(robot.joints, np.asarray(state.r), strict=True):
        at = model.joints[model.getJointId(joint.name)]
        q[at.idx_q : at.idx_q + at.nq] = [np.cos(r), np.sin(r)] if at.nq == 2 else [r]
    full = pin.crba(model, data, q)
    full = np.triu(full) + np.triu(full, 1).T
    order = np.concatenate([[3, 4, 5], index]).astype(int)
    lin, mixed = full[:3, :3], full[:3][:, order]
    expected = full[np.ix_(order, order)] - mixed.T @ np.linalg.solve(lin, mixed)
    reduced = jax.jit(lambda a, r: aerial_manipulator.centroidal_model(a, aerial_manipulator.forward_kinematics(a, r)))(
        agent, state.r
    )
    np.testing.assert_allclose(reduced.M_bar, expected, atol=1e-9 * np.abs(expected).max())
    np.testing.assert_allclose(reduced.mass, pin.computeTotalMass(model), rtol=1e-12)

    pin.framesForwardKinematics(model, data, q)
    com = pin.centerOfMass(model, data, q, v)
    np.testing.assert_allclose(reduced.com_from_base, com, atol=1e-9)
    for found, name, at in zip(
        np.asarray(reduced.tip_from_com + reduced.com_from_base[None]), tips, (np.zeros(3), offset), strict=True
    ):
        frame = data.oMf[model.getFrameId(name, pin.FrameType.BODY)]
        np.testing.assert_allclose(found, frame.act(at), atol=1e-9)


# Merging and refusals ------------------------------------------------------------------------------------------------

TWO_ARMS = """<robot name="two arms">
  <link name="base"><inertial><mass value="1.5"/>
    <inertia ixx="0.02" iyy="0.02" izz="0.035" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="arm"><inertial><origin xyz="0 0 -0.15"/><mass value="0.12"/>
    <inertia ixx="9e-4" iyy="9e-4" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="tool"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="arm"/><origin xyz="0 0.08 0"/><axis xyz="2 0 0"/>
    <limit lower="-2" upper="2" effort="5" velocity="5"/></joint>
  <joint name="wrist" type="fixed"><parent link="arm"/><child link="tool"/><origin xyz="0 0 -0.3"/></joint>
</robot>
"""


def test_fixed_links_are_merged_and_axes_normalized() -> None:
    """Fixed links are merged into their body, and axes are normalized."""
    robot = urdf.parse_urdf(TWO_ARMS, "two.urdf")
    assert (len(robot.bodies), [j.name for j in robot.joints]) == (2, ["shoulder"])
    np.testing.assert_array_equal(robot.joints[0].axis, [1, 0, 0])
    body, point = robot.tip("tool", [0.0, 0.0, -0.1])
    assert body == 1
    np.testing.assert_allclose(point, [0, 0, -0.4])


def test_point_mass_may_be_fixed_to_a_body() -> None:
    heavy = '<link name="tool"><inertial><mass value="0.1"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>'
    robot = urdf.parse_urdf(TWO_ARMS.replace('<link name="tool"/>', heavy + "</inertial></link>"), "two.urdf")
    arm, d = robot.bodies[1], 0.15
    assert arm.mass == pytest.approx(0.22)
    np.testing.assert_allclose(arm.com, [0, 0, -(0.12 * 0.15 + 0.1 * 0.3) / 0.22])
    lift = 0.12 * 0.1 / 0.22 * d**2  # reduced mass times squared distance
    np.testing.assert_allclose(arm.inertia, np.diag([9e-4 + lift, 9e-4 + lift, 1e-5]), atol=1e-18)


# A link that is unphysical alone, as part of a body that is physical.
PLACEHOLDERS = [
    '<mass value="0"/><inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/>',
    '<mass value="1e-6"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0" iyz="0"/>',
    '<mass value="0.001"/><inertia ixx="1e-6" iyy="1e-6" izz="9e-6" ixy="0" ixz="0" iyz="0"/>',
    '<mass value="0.001"/><inertia ixx="1e-6" iyy="1e-6" izz="1e-6" ixy="2e-6" ixz="0" iyz="0"/>',
    '<mass value="0.02"/><inertia ixx="-1e-7" iyy="1e-6" izz="1e-6" ixy="0" ixz="0" iyz="0"/>',
]


@pytest.mark.parametrize("placeholder", PLACEHOLDERS)
@pytest.mark.parametrize("seed", range(2))
def test_bodies_are_validated_after_merging(placeholder: str, seed: int) -> None:
    rng = np.random.default_rng(seed)
    at = f'<origin xyz="{words(0.1 * rng.normal(size=3))}" rpy="{words(rng.uniform(-3, 3, 3))}"/>'
    heavy = f'<link name="tool"><inertial>{at}{placeholder}</inertial></link>'
    text = TWO_ARMS.replace('<link name="tool"/>', heavy)
    with pytest.raises(ValueError, match="link 'tool': "):
        urdf.parse_urdf(text.replace('name="wrist" type="fixed"', 'name="wrist" type="continuous"'), "two.urdf")
    body = urdf.parse_urdf(text, "two.urdf").bodies[1]
    expected = pin.buildModelFromXML(text, pin.JointModelFreeFlyer()).inertias[2]
    np.testing.assert_allclose(body.mass, expected.mass, rtol=1e-12)
    np.testing.assert_allclose(body.com, expected.lever, atol=1e-12)
    np.testing.assert_allclose(body.inertia, expected.inertia, atol=1e-12 * np.abs(expected.inertia).max())


def test_unphysical_merged_links_are_refused() -> None:
    """Links whose merged inertia is not physical are refused with all their names."""
    flat = '<mass value="0.001"/><inertia ixx="1e-6" iyy="1e-6" izz="9" ixy="0" ixz="0" iyz="0"/>'
    text = TWO_ARMS.replace('<link name="tool"/>', f'<link name="tool"><inertial>{flat}</inertial></link>')
    reported = r"^two\.urdf:4: link 'arm' with the links fixed to it \(tool\): inertia violates the triangle inequality"
    with pytest.raises(ValueError, match=reported):
        urdf.parse_urdf(text, "two.urdf")


# Mimic joints ---------------------------------------------------------------------------------------------------------


def with_mimic_joints(rng: np.random.Generator, links: int) -> tuple[str, dict[str, tuple[str, float, float]]]:
    """Return a random tree in which about half of the joints mimic another, without a cycle."""
    text, _ = random_urdf(rng, links)
    moving = re.findall(r'<joint name="([^"]*)" type="(?!fixed)', text)
    follows = {}
    for i, name in enumerate(moving[1:], 1):
        if rng.uniform() < 0.5:
            follows[name] = (moving[int(rng.integers(i))], float(rng.uniform(-2, 2)), float(rng.uniform(-1, 1)))
    for name, (followed, multiplier, offset) in follows.items():
        mimic = f'<mimic joint="{followed}" multiplier="{multiplier!r}" offset="{offset!r}"/>'
        text = re.sub(rf'(<joint name="{name}" .*?)(</joint>)', rf"\1{mimic}\2", text, count=1)
    return text, follows


@pytest.mark.parametrize("seed", range(12))
def test_frozen_joints_equal_pinocchio_reduced_model(seed: int) -> None:
    rng = np.random.default_rng(seed)
    text, follows = with_mimic_joints(rng, 9)
    full = pin.buildModelFromXML(text, pin.JointModelFreeFlyer())
    moving = [name for name in full.names if name not in ("universe", "root_joint")]
    rest = {name: float(rng.uniform(-1, 1)) for name in moving if name not in follows}
    robot = urdf.parse_urdf(text, "r.urdf", "frozen", rest)
    assert {joint.name for joint in robot.joints} == set(moving) - set(follows)

    held = dict(rest)
    for name, (followed, multiplier, offset) in follows.items():  # the mimicked joint comes first
        held[name] = multiplier * held[followed] + offset
    q = pin.neutral(full)
    for name in follows:
        at = full.joints[full.getJointId(name)]
        q[at.idx_q : at.idx_q + at.nq] = [np.cos(held[name]), np.sin(held[name])] if at.nq == 2 else [held[name]]
    reduced = pin.buildReducedModel(full, [full.getJointId(name) for name in follows], q)
    names = ["root_joint", *(joint.name for joint in robot.joints)]
    for name, body in zip(names, robot.bodies, strict=True):
        expected = reduced.inertias[reduced.getJointId(name)]
        np.testing.assert_allclose(body.mass, expected.mass, rtol=1e-12)
        np.testing.assert_allclose(body.com, expected.lever, atol=1e-12)
        np.testing.assert_allclose(body.inertia, expected.inertia, atol=1e-12)
    for joint in robot.joints:
        at = reduced.jointPlacements[reduced.getJointId(joint.name)]
        np.testing.assert_allclose(joint.position, at.translation, atol=1e-12)
        np.testing.assert_allclose(joint.rotation, at.rotation, atol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_independent_mode_ignores_mimic_tags(seed: int) -> None:
    text, follows = with_mimic_joints(np.random.default_rng(seed), 9)
    free = urdf.parse_urdf(re.sub("<mimic [^>]*/>", "", text), "r.urdf")
    found = urdf.parse_urdf(text, "r.urdf", "independent")
    assert set(follows) <= {joint.name for joint in found.joints}
    for a, b in zip(
        jax.tree.leaves((found.bodies, found.joints)), jax.tree.leaves((free.bodies, free.joints)), strict=True
    ):
        assert repr(a) == repr(b)


CIRCLES = [
    ("shoulder", r"joint 'shoulder' depends on itself through shoulder"),
    ("elbow", r"joint 'shoulder' depends on 'elbow', which is not a joint"),
]


@pytest.mark.parametrize(("followed", "answer"), CIRCLES)
def test_mimicked_joint_must_exist(followed: str, answer: str) -> None:
    text = TWO_ARMS.replace("<limit", f'<mimic joint="{followed}"/><limit')
    with pytest.raises(ValueError, match=rf"^two\.urdf:9: {answer}"):
        urdf.parse_urdf(text, "two.urdf", "frozen")


def test_fixed_joint_cannot_mimic() -> None:
    text = TWO_ARMS.replace("<limit", '<mimic joint="wrist" multiplier="5" offset="0.5"/><limit')
    text = text.replace(
        '<joint name="wrist" type="fixed">', '<joint name="wrist" type="fixed"><mimic joint="shoulder"/>'
    )
    (base,) = urdf.parse_urdf(text, "two.urdf", "frozen", {"wrist": 3.0}).bodies
    assert base.mass == pytest.approx(1.62)
    assert len(urdf.parse_urdf(text, "two.urdf", "independent").joints) == 1


MASS, INERTIA = '<mass value="0.12"/>', 'ixx="9e-4" iyy="9e-4" izz="1e-5"'
LONE = '<link name="x"/>'
EXTRA = LONE + '<joint name="j" type="fixed"><parent link="{}"/><child link="{}"/></joint></robot>'
REFUSED = [
    ("</robot>", "", r"two\.urdf:12: not XML: no element found"),
    ("<robot", '<!DOCTYPE r [<!ENTITY a "aa">]>\n<robot', r"two\.urdf:1: a DOCTYPE is not allowed"),
    ('<robot name="two arms">', '<robot name="x"><xacro:macro name="m"/>', "<xacro:macro> is a macro; expand the file"),
    ('name="tool"', 'name="arm"', r"two\.urdf:6: link 'arm' occurs twice, first at two\.urdf:4"),
    (
        'type="revolute"',
        'type="floating"',
        r"two\.urdf:7: joint 'shoulder': type 'floating' is not supported; allowed:",
    ),
    ('type="revolute"', 'type="planar"', "type 'planar' is not supported; allowed: revolute, continuous, prismatic"),
    ('type="revolute"', "", r"two\.urdf:7: joint 'shoulder': <joint> has no 'type'"),
    (
        "<limit",
        '<mimic joint="wrist"/><limit',
        r"two\.urdf:9: joint 'shoulder' depends on another joint \(<mimic>\).*: "
        r"choose mimic='frozen' .* or mimic='independent' ",
    ),
    ('xyz="2 0 0"', 'xyz="0 0 0"', r"two\.urdf:8: joint 'shoulder': the axis must not be zero"),
    ('xyz="2 0 0"', 'xyz="2 0"', "'xyz' of <axis> must be 3 finite numbers, got '2 0'"),
    ('xyz="2 0 0"', 'xyz="2 0 nan"', "'xyz' of <axis> must be 3 finite numbers, got '2 0 nan'"),
    ('xyz="0 0.08 0"', 'rpy="0 a 0"', "'rpy' of <origin> must be 3 finite numbers, got '0 a 0'"),
    ('<parent link="base"/>', "", "joint 'shoulder' has no <parent>"),
    ('<parent link="base"/>', '<parent link="bas"/>', "parent 'bas' is not a link; links: base, arm, tool"),
    ('xyz="0 0.08 0"', 'xyz="0 1e13 0"', "'xyz' of <origin> must be at most 1e\\+12 in size, got '0 1e13 0'"),
    (MASS, "", r"two\.urdf:4: link 'arm': <inertial> has no <mass>"),
    (MASS, '<mass value="-0.12"/>', r"two\.urdf:4: link 'arm': mass -0\.12 kg is negative"),
    (MASS, '<mass value="0"/>', r"link 'arm': mass 0 kg is not positive"),
    (MASS, MASS * 2, "<mass> occurs twice in <inertial>"),
    (INERTIA, 'ixx="9e-4" iyy="9e-4" izz="2e-3"', r"link 'arm': inertia violates the triangle inequality.*kg m\^2"),
    (INERTIA, 'ixx="9e-4" iyy="9e-4" izz="-1e-5"', r"link 'arm': inertia is not positive definite: .*-1e-05"),
    (INERTIA, 'ixx="0" iyy="0" izz="0"', r"two\.urdf:4: link 'arm': inertia is not positive definite"),
    (INERTIA, 'ixx="9e-4" iyy="9e-4"', r"link 'arm': <inertia> has no 'izz'"),
    (
        '<child link="tool"/>',
        '<child link="arm"/>',
        r"joint 'wrist': link 'arm' is already the child of joint 'shoulder'",
    ),
    ("</robot>", '<link name="alone"/></robot>', "one root link is allowed, found 2: base, alone"),
    ("</robot>", EXTRA.format("x", "base").replace('"x"', '"tool"', 1), "'tool' occurs twice"),
    ('<parent link="base"/>', '<parent link="tool"/>', "link 'arm' is in a cycle of joints"),
    ("</robot>", EXTRA.format("x", "x"), r"link 'x' is in a cycle of joints: it is not connected to the root 'base'"),
    ("<inertial><origin", "<x><origin", "not XML: mismatched tag"),
]


@pytest.mark.parametrize(("original", "replacement", "answer"), REFUSED)
def test_errors_state_the_line(original: str, replacement: str, answer: str) -> None:
    assert original in TWO_ARMS
    with pytest.raises(ValueError, match=r"^two\.urdf:\d+: ") as e:
        urdf.parse_urdf(TWO_ARMS.replace(original, replacement, 1), "two.urdf")
    assert re.search(answer, str(e.value)), e.value
    assert "\n" not in str(e.value)


def test_massless_body_and_cycle_are_refused() -> None:
    """A moving body without inertia and a cycle without a root are refused."""
    bare = re.sub("<link name=.arm.>.*?</link>", '<link name="arm"/>', TWO_ARMS, flags=re.DOTALL)
    with pytest.raises(ValueError, match=r"link 'arm' has no <inertial>, nor do the links fixed to it: tool"):
        urdf.parse_urdf(bare, "two.urdf")
    ring = TWO_ARMS.replace("</robot>", EXTRA.format("tool", "base").replace(LONE, ""))
    with pytest.raises(ValueError, match="no root link: every link is the child of a joint"):
        urdf.parse_urdf(ring, "two.urdf")
    with pytest.raises(ValueError, match="the file has no links"):
        urdf.parse_urdf("<robot name='x'/>", "two.urdf")


@pytest.mark.parametrize(
    ("tip", "contact", "thrust", "answer"),
    [
        (("tool", [0.0, 0.0]), [0.0, 0.0, 0.0], 50.0, r"the offset of tip 'tool' must be three finite numbers, m, got"),
        ("tool", [0.0, 0.0], 50.0, r"contact 0 must be three finite numbers, m, got \[0.0, 0.0\]"),
        ("tool", [0.0, 0.0, np.nan], 50.0, r"contact 0 must be three finite numbers, m, got \[0.0, 0.0, nan\]"),
        ("tool", [0.0, 0.0, 0.0], -1.0, r"thrust_max -1 N is not positive and finite"),
        ("tool", [0.0, 0.0, 0.0], np.nan, r"thrust_max nan N is not positive and finite"),
    ],
)
def test_tips_contacts_and_thrust_are_validated(tip, contact, thrust: float, answer: str) -> None:
    with pytest.raises(ValueError, match=rf"^two\.urdf: {answer}"):
        urdf.make_agent(urdf.parse_urdf(TWO_ARMS, "two.urdf"), [tip], [contact], thrust)


def test_too_large_or_undecodable_file_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OSError, match="not a regular file"):
        urdf.load_urdf("/dev/zero")
    large = tmp_path / "large.urdf"
    with large.open("wb") as file:
        file.truncate(bounded_read.MAX_TEXT_BYTES + 1)
    with pytest.raises(OSError, match="larger than 16 MiB"):
        urdf.load_urdf(large)
    for encoding in ("nothing", "utf-7", "big5", "utf-16"):
        with pytest.raises(ValueError, match=r"^r\.urdf:1: "):
            urdf.parse_urdf(f'<?xml version="1.0" encoding="{encoding}"?><robot name="x"/>'.encode(), "r.urdf")
    with pytest.raises(ValueError, match=r"^r\.urdf:1: "):
        urdf.parse_urdf('<robot name="\ud800"/>', "r.urdf")


def test_tips_must_be_links_and_match_contacts() -> None:
    robot = urdf.parse_urdf(TWO_ARMS, "two.urdf")
    with pytest.raises(ValueError, match=r"two\.urdf: tip 'tol' is not a link; links: base, arm, tool"):
        urdf.make_agent(robot, ["tol"], [[0.0, 0.0, 0.0]], 50.0)
    with pytest.raises(ValueError, match="1 tips for 2 contacts"):
        urdf.make_agent(robot, ["tool"], [[0.0, 0.0, 0.0]] * 2, 50.0)


# Scenario files -------------------------------------------------------------------------------------------------------

SAMPLE = (Path(__file__).parents[2] / "support" / "sample_scenario.yaml").read_text(encoding="utf-8")
NUMBERS = SAMPLE[SAMPLE.index("  two_arms:") : SAMPLE.index("agents:\n")]
FROM_URDF = """  two_arms:
    urdf: vehicles/two.urdf
    thrust_max_N: 50
    tips: [left_hand, {link: right, name: right, tip_position_m: [0, 0, -0.3]}]
    nominal_position_rad: {left: 1.2, right: -1.2}
"""
ARM = """<link name="{0}"><inertial><origin xyz="0 0 -0.15"/><mass value="0.12"/>
  <inertia ixx="9e-4" iyy="9e-4" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="{0}" type="continuous"><parent link="waist"/><child link="{0}"/><origin xyz="0 {1} 0"/></joint>
"""
SAME = f"""<robot name="two arms">
<link name="base"><inertial><mass value="1.5"/>
  <inertia ixx="0.02" iyy="0.02" izz="0.035" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="waist"><inertial><mass value="0.1"/>
  <inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="waist" type="continuous"><parent link="base"/><child link="waist"/><axis xyz="0 0 1"/></joint>
{ARM.format("left", 0.08)}{ARM.format("right", -0.08)}
<link name="left_hand"/>
<joint name="left_wrist" type="fixed">
  <parent link="left"/><child link="left_hand"/><origin xyz="0 0 -0.3" rpy="0.1 0.2 0.3"/></joint>
</robot>
"""


@pytest.fixture
def scenario_file(tmp_path: Path) -> Path:
    """A scenario whose agent type is read from a URDF file beside it."""
    (tmp_path / "vehicles").mkdir()
    (tmp_path / "vehicles" / "two.urdf").write_text(SAME, encoding="utf-8")
    text = SAMPLE.replace(NUMBERS, FROM_URDF + "\n").replace("/left", "/left_hand")
    path = tmp_path / "mine.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_scenario_from_urdf_equals_explicit_numbers(scenario_file: Path) -> None:
    settings, plain = scenario.load_scenario(scenario_file), scenario.parse(SAMPLE, "sample.yaml")
    for ours, expected in zip(team.team(settings), team.team(plain), strict=True):
        assert jax.tree.structure(ours) == jax.tree.structure(expected)
        for a, b in zip(jax.tree.leaves(ours), jax.tree.leaves(expected), strict=True):
            np.testing.assert_allclose(a, b, atol=1e-15)
    assert team.joint_names(settings) == team.joint_names(plain)
    assert team.contact_names(settings)[:2] == ("front/left_hand", "front/right")
    np.testing.assert_array_equal(team.nominal_posture(settings)[0], team.nominal_posture(plain)[0])


@pytest.mark.parametrize("seed", range(5))
def test_scenario_and_python_read_equal_agents(seed: int, scenario_file: Path) -> None:
    rng = np.random.default_rng(seed)
    text, tips = random_urdf(rng, 8)
    text = re.sub("joint (\\d)", "joint-\\1", text)  # names in a scenario contain no blanks
    (scenario_file.parent / "vehicles" / "two.urdf").write_text(text, encoding="utf-8")
    reported = scenario_file.read_text(encoding="utf-8")
    kind = FROM_URDF.replace("left_hand, {link: right, name: right", f"{tips[0]}, {{link: {tips[1]}, name: right")
    reported = reported.replace(FROM_URDF, re.sub("    nominal_position.*\n", "", kind)).replace(
        "/left_hand", f"/{tips[0]}"
    )
    truth, _ = team.team(scenario.parse(reported, str(scenario_file)))
    robot = urdf.load_urdf(scenario_file.parent / "vehicles" / "two.urdf")
    agent = urdf.make_agent(
        robot, [tips[0], (tips[1], [0.0, 0.0, -0.3])], np.asarray(truth.agent_groups[0].contact_position[1]), 50.0
    )
    assert agent.tree == truth.agent_groups[0].tree
    for a, b in zip(jax.tree.leaves(agent), jax.tree.leaves(truth.agent_groups[0]), strict=True):
        np.testing.assert_allclose(a, b[1], atol=1e-14)


WRONG_ENTRY = [
    ("vehicles/two.urdf", "two.urdf", "agent_types.two_arms.urdf: 'two.urdf' cannot be read: No such file"),
    ("left_hand,", "left_hnd,", "tips[0]: 'left_hnd' is not a link of the file (base, waist, "),
    ("left_hand,", "left_hnd,", "did you mean 'left_hand'?"),
    ("{left: 1.2", "{lefft: 1.2", "nominal_position_rad.lefft: 'lefft' is not a joint that turns (waist, left, right)"),
    (
        "nominal_position_rad: {left: 1.2, right: -1.2}",
        "nominal_position_m: {left: 1}",
        "'left' is not a joint that slides (there are none)",
    ),
    ("thrust_max_N: 50", "thrust_max_N: 0", "two_arms.thrust_max_N [N]: must be from 1e-5 to 1e6 (the weight"),
    ("    thrust_max_N: 50\n", "", "two_arms.thrust_max_N [N]: is required"),
    ("thrust_max_N: 50", "thrust_mx_N: 50", "is not a setting here; did you mean 'thrust_max_N'?"),
    (
        "tips: [left_hand, ",
        "tips: [",
        "agents[0].contact_positions_m [m]: must hold one contact for each of the 1 arms",
    ),
    ("tip_position_m: [0, 0, -0.3]", "tip_position_m: [0, 0]", "tips[1].tip_position_m[2] [m]: is missing"),
]


@pytest.mark.parametrize(("given", "instead", "answer"), WRONG_ENTRY)
def test_errors_of_an_entry_state_their_place(given: str, instead: str, answer: str, scenario_file: Path) -> None:
    text = scenario_file.read_text(encoding="utf-8")
    assert given in text
    with pytest.raises(ScenarioError) as refused:
        scenario.parse(text.replace(given, instead, 1), str(scenario_file))
    lines = str(refused.value).splitlines()
    assert any(answer in line for line in lines), lines
    assert all(re.match(rf"{scenario_file}:\d+: \S", line) for line in lines)
    assert not any("two_arms.base" in line for line in lines), "no further error of settings that the file would state"


def test_scenario_selects_the_mode_of_mimic_joints(scenario_file: Path) -> None:
    text = SAME.replace('<child link="right"/>', '<child link="right"/><mimic joint="left" multiplier="-1"/>')
    (scenario_file.parent / "vehicles" / "two.urdf").write_text(text, encoding="utf-8")
    reported = scenario_file.read_text(encoding="utf-8")
    with pytest.raises(ScenarioError, match=r"two_arms\.urdf: .*two\.urdf:\d+: joint 'right' depends on another joint"):
        scenario.load_scenario(scenario_file)
    with pytest.raises(
        ScenarioError, match="mimic_joints: must be one of frozen, independent, got 'forzen'; did you mean 'frozen'"
    ):
        scenario.parse(reported.replace("    tips:", "    mimic_joints: forzen\n    tips:"), str(scenario_file))
    free = scenario.parse(reported.replace("    tips:", "    mimic_joints: independent\n    tips:"), str(scenario_file))
    assert team.joint_names(free)[:3] == ("front/waist", "front/left", "front/right")
    frozen = reported.replace("    tips:", "    mimic_joints: frozen\n    tips:").replace(", right: -1.2}", "}")
    (kind,) = scenario.parse(frozen, str(scenario_file)).agent_types.values()
    assert [joint.name for joint in kind.joints] == ["waist", "left"]
    hand = next(arm for arm in kind.arms if arm.name == "right")
    # held at -1.2 rad about x, where `left` rests at 1.2
    np.testing.assert_allclose(hand.tip_position_m, [0, -0.08 - 0.3 * np.sin(1.2), -0.3 * np.cos(1.2)], atol=1e-12)
    assert hand.joint == "waist"


@pytest.mark.parametrize(
    ("original", "replacement", "answer"),
    [
        ('value="1.5"', 'value="9e9"', "urdf: vehicles/two.urdf: base.mass_kg [kg]: must be from 1e-6 to 100000"),
        ('value="1.5"', 'value="-1.5"', "two.urdf:2: link 'base': mass -1.5 kg is negative"),
        ('name="waist" type', f'name="{"w" * 101}" type', "two.urdf:6: joint: name 'www"),
        ('"left_hand"', f'"{"h" * 101}"', "cannot name an arm: give the tip a `name`"),
    ],
)
def test_urdf_errors_are_reported_with_scenario_errors(
    original: str, replacement: str, answer: str, scenario_file: Path
) -> None:
    (scenario_file.parent / "vehicles" / "two.urdf").write_text(SAME.replace(original, replacement), encoding="utf-8")
    text = scenario_file.read_text(encoding="utf-8").replace(
        "left_hand,", f"{replacement.strip(chr(34))}," * ("h" * 9 in replacement) or "left_hand,"
    )
    with pytest.raises(ScenarioError) as refused:
        scenario.parse(text.replace("K_p: 5", "K_p: -5"), str(scenario_file))
    first, second = str(refused.value).splitlines()
    assert "agent_types.two_arms." in first
    assert answer in first
    assert "control.K_p" in second


# Export --------------------------------------------------------------------------------------------------------------


def named(agent: AerialManipulator) -> tuple[list[str], list[str]]:
    return [f"j{k}" for k in range(agent.tree.joints)], [f"a{b}" for b in range(agent.tree.arms)]


@pytest.mark.parametrize("tree", range(len(teams.TREES)))
def test_urdf_round_trip(tree: int) -> None:
    """Joints are in the depth-first order of the file and are identified by name."""
    agent = teams.agent(np.random.default_rng(tree), teams.TREES[tree])
    joints, arms = named(agent)
    robot = urdf.parse_urdf(urdf.to_urdf("one", agent, joints, arms), "one.urdf")
    order = [joints.index(joint.name) for joint in robot.joints]
    assert sorted(order) == list(range(len(joints)))
    body = {0: 0} | {k + 1: i + 1 for i, k in enumerate(order)}
    back = urdf.make_agent(
        robot, [f"{arm}_tip" for arm in arms], np.asarray(agent.contact_position), float(agent.thrust_max)
    )
    assert back.tree.parents == tuple(body[agent.tree.parents[k]] for k in order)
    assert back.tree.prismatic == tuple(agent.tree.prismatic[k] for k in order)
    assert back.tree.tip_bodies == tuple(body[tip] for tip in agent.tree.tip_bodies)
    bodies = [0, *(k + 1 for k in order)]
    for field in ("mass", "com", "inertia"):
        np.testing.assert_allclose(getattr(back, field), getattr(agent, field)[np.array(bodies)], atol=1e-15)
    for field in ("joint_position", "joint_rotation", "joint_axis"):
        np.testing.assert_allclose(getattr(back, field), getattr(agent, field)[np.array(order, int)], atol=1e-15)
    np.testing.assert_allclose(back.tip_position, agent.tip_position, atol=1e-15)


@pytest.mark.parametrize("tree", range(len(teams.TREES)))
def test_pinocchio_reads_the_written_agent(tree: int) -> None:
    """Mass matrix, center of mass and tips equal those of the same numbers without a file."""
    rng = np.random.default_rng(tree)
    agent = teams.agent(rng, teams.TREES[tree])
    joints, arms = named(agent)
    model = pin.buildModelFromXML(urdf.to_urdf("one", agent, joints, arms), pin.JointModelFreeFlyer())
    alone = pinocchio_team.FreeAgent(
        SimpleNamespace(**{f.name: getattr(agent, f.name) for f in dataclasses.fields(agent)})
    )
    state = teams.agent_state(rng, agent.tree)
    q_alone, v_alone = alone.coordinates(state)
    q, v = pin.neutral(model), np.zeros(model.nv)
    q[:7], v[:6] = q_alone[:7], v_alone[:6]
    for k, name in enumerate(joints):
        at = model.joints[model.getJointId(name)]
        r = float(state.r[k])
        q[at.idx_q : at.idx_q + at.nq] = [np.cos(r), np.sin(r)] if at.nq == 2 else [r]
        v[at.idx_v] = state.r_dot[k]
    data = model.createData()
    pin.framesForwardKinematics(model, data, q)
    pin.framesForwardKinematics(alone.model, alone.data, q_alone)
    for arm, tip in zip(arms, alone.tips, strict=True):
        found = data.oMf[model.getFrameId(f"{arm}_tip", pin.FrameType.BODY)].translation
        np.testing.assert_allclose(found, alone.data.oMf[tip].translation, atol=1e-12)
    energy = pin.computeKineticEnergy(model, data, q, v)
    np.testing.assert_allclose(energy, pin.computeKineticEnergy(alone.model, alone.data, q_alone, v_alone), rtol=1e-12)
    np.testing.assert_allclose(
        pin.centerOfMass(model, data, q), pin.centerOfMass(alone.model, alone.data, q_alone), atol=1e-12
    )


@given(
    st.floats(-3.2, 3.2), st.floats(-1, 1), st.floats(-3.2, 3.2), st.sampled_from([0.0, 1e-16, 1e-12, 1e-8, 1e-3, 1.0])
)
def test_roll_pitch_yaw_round_trip(roll: float, lean: float, yaw: float, by: float) -> None:
    """Also near vertical pitch, where roll and yaw describe the same rotation."""
    R = Rotation.from_euler("ZYX", [yaw, np.pi / 2 - lean * by, roll]).as_matrix()
    back = Rotation.from_euler("xyz", urdf.rpy(R)).as_matrix()
    np.testing.assert_allclose(back, R, atol=5e-16 * 4)


def test_wrong_number_of_names_is_refused() -> None:
    agent = teams.agent(np.random.default_rng(0), teams.CHAIN)
    with pytest.raises(ValueError, match="one: 2 names for 3 joints, 1 for 1 arms"):
        urdf.to_urdf("one", agent, ["a", "b"], ["c"])


# Attributes, versions, limits and frozen joints -----------------------------------------------------------------------

TURNED = """<robot name="r" version="1.1"><link name="base"><inertial>
  <origin xyz="0 0 0" quat_xyzw="0 0 0.7071067811865476 0.7071067811865476"/><mass value="1"/>
  <inertia ixx="0.01" ixy="0" ixz="0" iyy="0.02" iyz="0" izz="0.025"/></inertial></link>
<link name="arm"><inertial><mass value="0.1"/><inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/>
</inertial></link>
<joint name="elbow" type="revolute"><origin xyz="0.1 0 -0.1" quat_xyzw="0 0 0.7071067811865476 0.7071067811865476"/>
<parent link="base"/><child link="arm"/><limit lower="-1" upper="2" effort="3" velocity="4"/></joint></robot>"""


def test_quaternions_of_urdf_1_1_are_read() -> None:
    robot = urdf.parse_urdf(TURNED, "r.urdf")
    np.testing.assert_allclose(robot.bodies[0].inertia, np.diag([0.02, 0.01, 0.025]), atol=1e-15)
    np.testing.assert_allclose(robot.joints[0].rotation, [[0, -1, 0], [1, 0, 0], [0, 0, 1]], atol=1e-15)


def test_limits_are_read() -> None:
    assert urdf.parse_urdf(TURNED, "r.urdf").joints[0].limits == urdf.JointLimits((-1.0, 2.0), 4.0, 3.0)
    for unlimited in ('lower="-1e16" upper="1e16" effort="inf"', 'effort="0" velocity="0"'):
        text = re.sub("<limit [^/]*/>", f"<limit {unlimited}/>", TURNED)
        assert urdf.parse_urdf(text, "r.urdf").joints[0].limits == urdf.JointLimits()
    one_sided = re.sub("<limit [^/]*/>", '<limit upper="2"/>', TURNED)
    assert urdf.parse_urdf(one_sided, "r.urdf").joints[0].limits.position == (0.0, 2.0)


def test_limits_from_zero_to_zero_are_a_placeholder() -> None:
    tree = urdf_parser.parse_link_tree(re.sub("<limit [^/]*/>", '<limit lower="0" upper="0"/>', TURNED), "r.urdf")
    assert tree.joints["elbow"].limits == urdf.JointLimits()
    assert tree.notes == ("limits from 0 to 0 are read as no limits: elbow",)
    assert urdf_parser.parse_link_tree(TURNED, "r.urdf").notes == ()


@pytest.mark.parametrize(
    ("written", "instead", "answer"),
    [
        ('version="1.1"', 'version="2.0"', "URDF version '2.0' is not supported; supported: 1, 1.0"),
        ('quat_xyzw="0 0 0.7071067811865476', 'quat_xyzw="0 0 0.8', "must be a unit quaternion, its norm is 1.06"),
        ('xyz="0.1 0 -0.1"', 'rpy="0 0 1"', "states its rotation twice, as 'rpy' and as 'quat_xyzw'"),
        ('xyz="0.1 0 -0.1"', 'xyz="0.1 0 -0.1" scale="2"', "attribute 'scale' of <origin> is unknown"),
        ('<mass value="1"/>', '<mass value="1" unit="g"/>', "<inertial> of link 'base': attribute 'unit' of <mass>"),
        ('iyz="0"', 'iyz="0" iyx="1e-4"', "link 'base': the inertia is not symmetric: iyx is 0.0001, ixy is 0"),
        ('lower="-1"', 'lower="3"', "joint 'elbow': the lower limit 3 exceeds the upper limit 2"),
        ("</robot>", '<loop_joint name="l"/></robot>', "<loop_joint> closes a loop"),
    ],
)
def test_attributes_that_change_the_model_are_refused(written: str, instead: str, answer: str) -> None:
    assert written in TURNED
    with pytest.raises(ValueError, match=rf"^r\.urdf:\d+: .*({answer})"):
        urdf.parse_urdf(TURNED.replace(written, instead, 1), "r.urdf")


def test_a_full_inertia_matrix_is_read() -> None:
    full = TURNED.replace(
        'ixy="0" ixz="0" iyy="0.02" iyz="0"', 'ixy="1e-3" iyx="1e-3" ixz="0" iyy="0.02" iyz="0" izy="0"'
    )
    assert full != TURNED
    half = full.replace(' iyx="1e-3"', "").replace(' izy="0"', "")
    np.testing.assert_array_equal(
        urdf.parse_urdf(full, "r.urdf").bodies[0].inertia, urdf.parse_urdf(half, "r.urdf").bodies[0].inertia
    )


def test_an_empty_floating_root_is_dropped() -> None:
    rooted = TURNED.replace(
        "</robot>",
        '<link name="world"/><joint name="root" type="floating"><parent link="world"/><child link="base"/></joint>'
        "</robot>",
    )
    robot = urdf.parse_urdf(rooted, "r.urdf")
    assert list(robot.links) == ["base", "arm"]
    marked = rooted.replace(
        '<link name="world"/>',
        '<link name="map"/><link name="world"/><link name="mark"/>'
        '<joint name="a" type="fixed"><parent link="map"/><child link="world"/></joint>'
        '<joint name="b" type="fixed"><parent link="world"/><child link="mark"/></joint>',
    )
    assert list(urdf.parse_urdf(marked, "r.urdf").links) == ["base", "arm"]
    heavy = rooted.replace(
        '<link name="world"/>',
        '<link name="world"><inertial><mass value="1"/>'
        '<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>',
    )
    with pytest.raises(ValueError, match="joint 'root': type 'floating' is not supported"):
        urdf.parse_urdf(heavy, "r.urdf")


def test_frozen_joints_are_fixed_at_their_positions() -> None:
    robot = urdf.parse_urdf(TURNED, "r.urdf", nominal_positions={"elbow": np.pi / 2}, frozen=["elbow"])
    assert (len(robot.joints), robot.links["arm"].body) == (0, 0)
    np.testing.assert_allclose(robot.links["arm"].rotation[:, 1], [0, 0, 1], atol=1e-15)
    with pytest.raises(ValueError, match=r"r\.urdf: frozen joint 'e' is not a joint that moves; joints: elbow"):
        urdf.parse_urdf(TURNED, "r.urdf", frozen=["e"])


def test_a_balanced_inertia_is_the_closest_physical_one() -> None:
    flat = TURNED.replace('izz="0.025"', 'izz="0.06"')
    with pytest.raises(ValueError, match=r"0\.01, 0\.02, 0\.06 kg m\^2, and 0\.06 > 0\.03: choose inertia='balanced'"):
        urdf.parse_urdf(flat, "r.urdf")
    robot = urdf.parse_urdf(flat, "r.urdf", inertia="balanced")
    np.testing.assert_allclose(robot.bodies[0].inertia, np.diag([0.03, 0.02, 0.05]), atol=1e-15)
    (change,) = robot.changes
    assert "link 'base': principal moments 0.01, 0.02, 0.06 kg m^2" in change
    assert change.endswith("balanced to 0.02, 0.03, 0.05")
    rng = np.random.default_rng(0)
    others = rng.uniform(1e-3, 0.1, (2000, 3))
    others = others[others[:, 2] <= others[:, :2].sum(1)]
    target = np.array([0.01, 0.02, 0.06])
    closest = np.linalg.norm(others - target, axis=1).min()
    assert np.linalg.norm(link_tree.balanced_moments(target) - target) <= closest


def test_settings_of_a_scenario_name_what_they_are(scenario_file: Path) -> None:
    """The advice of a refusal names settings of the scenario."""
    file = scenario_file.parent / "vehicles" / "two.urdf"
    file.write_text(SAME.replace('izz="0.035"', 'izz="0.1"'), encoding="utf-8")
    with pytest.raises(ScenarioError, match="choose `inertia: balanced`"):
        scenario.load_scenario(scenario_file)
    text = scenario_file.read_text(encoding="utf-8").replace(
        "    thrust_max_N: 50\n", "    thrust_max_N: 50\n    inertia: balanced\n"
    )
    settings = scenario.parse(text, str(scenario_file))
    assert settings.agent_types["two_arms"].base.inertia_kgm2[2][2] == pytest.approx(0.08)
    file.write_text(
        SAME.replace('<child link="right"/>', '<child link="right"/><mimic joint="left"/>'), encoding="utf-8"
    )
    with pytest.raises(ScenarioError, match=r"choose `mimic_joints: frozen` .* or `mimic_joints: independent`"):
        scenario.load_scenario(scenario_file)


def test_a_frozen_joint_of_a_scenario_is_not_in_the_team(scenario_file: Path) -> None:
    file = scenario_file.parent / "vehicles" / "two.urdf"
    rotor = ARM.format("rotor/1", 0.2).replace('"waist"', '"base"')
    file.write_text(SAME.replace("</robot>", rotor + "</robot>"), encoding="utf-8")
    text = scenario_file.read_text(encoding="utf-8")
    assert "front/rotor-2f-1" in team.joint_names(scenario.parse(text, str(scenario_file)))
    for name in ("rotor/1", "rotor-2f-1"):
        frozen = text.replace("    thrust_max_N: 50\n", f"    thrust_max_N: 50\n    frozen: [{name}]\n")
        assert "front/rotor-2f-1" not in team.joint_names(scenario.parse(frozen, str(scenario_file)))
    with pytest.raises(ScenarioError, match=r"frozen\[0\]: 'rotor' is not a joint that moves .*did you mean"):
        scenario.parse(frozen.replace("[rotor-2f-1]", "[rotor]"), str(scenario_file))
