"""Roles of joints: rotors, grippers, sensors and tips, on small vehicles with the features of public files."""

from __future__ import annotations

import numpy as np
import pytest

from colift.models import joint_roles, urdf_parser
from colift.models.joint_roles import JointRoles, TipProposal

INERTIAL = '<mass value="{m}"/><inertia ixx="{a}" iyy="{b}" izz="{c}" ixy="0" ixz="0" iyz="0"/>'


def link(
    name: str, m: float = 0.1, moments: tuple[float, float, float] = (1e-4, 1e-4, 5e-5), com: str = "0 0 0"
) -> str:
    a, b, c = moments
    inertial = INERTIAL.format(m=m, a=a, b=b, c=c)
    return f'<link name="{name}"><inertial><origin xyz="{com}"/>{inertial}</inertial></link>'


def joint(
    name: str, parent: str, child: str, kind: str = "revolute", axis: str = "1 0 0", xyz: str = "0 0 0", more: str = ""
) -> str:
    limit = '<limit lower="-1" upper="1" effort="1" velocity="1"/>' if kind in ("revolute", "prismatic") else ""
    limit = "" if "<limit" in more else limit
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><origin xyz="{xyz}"/>'
        f'<axis xyz="{axis}"/>{limit}{more}</joint>'
    )


def rotor(k: int, name: str = "rotor_{}", parent: str = "base", more: str = "", com: str = "0 0 0") -> str:
    own = name.format(k)
    return link(own, 0.006, (1e-6, 4e-5, 4.05e-5), com) + joint(
        f"{own}_joint", parent, own, "continuous", "0 0 1", f"{0.1 * k} 0.1 0", more
    )


def roles(*parts: str, **options: tuple[str, ...]) -> JointRoles:
    base = link("base", 1.5, (0.02, 0.02, 0.035))
    return joint_roles.classify(
        urdf_parser.parse_link_tree(f'<robot name="r">{base}{"".join(parts)}</robot>', "r"), **options
    )


ARM = (
    link("upper", com="0 0 -0.05"),
    joint("shoulder", "base", "upper"),
    link("fore", com="0 0 -0.05"),
    joint("elbow", "upper", "fore", axis="0 1 0", xyz="0 0 -0.1"),
)


@pytest.mark.parametrize("name", ["rotor_{}", "front_prop{}", "propeller_{}", "thrust{}", "uav/Rotor{}"])
def test_named_rotors_are_found(name: str) -> None:
    found = roles(*(rotor(k, name) for k in range(4)), *ARM)
    assert len(found.rotors) == 4
    assert found.tips == (TipProposal("fore"),)
    assert not found.rests_on_base


def test_alike_rotors_need_no_name() -> None:
    assert len(roles(*(rotor(k, "part_{}") for k in range(4))).rotors) == 4
    assert roles(*(rotor(k, "part_{}") for k in range(2))).rotors == ()  # could be an arm's waist
    assert roles(*(rotor(k, "part_{}", com="0.05 0 0") for k in range(4))).rotors == ()  # not balanced


def test_plugins_and_transmissions_name_drives() -> None:
    named = "<jointName>part_0_joint</jointName>"
    plugin = f"<gazebo><plugin name='m' filename='libgazebo_motor_model.so'>{named}</plugin></gazebo>"
    assert roles(rotor(0, "part_{}"), plugin).rotors == ("part_0_joint",)
    interface = "<joint name='part_{0}_joint'><hardwareInterface>{1}</hardwareInterface></joint>"
    driven = "<transmission name='t{0}'>" + interface + "</transmission>"
    assert roles(rotor(0, "part_{}"), driven.format(0, "RotorInterface")).rotors == ("part_0_joint",)
    servos = [driven.format(k, "hardware_interface/EffortJointInterface") for k in range(4)]
    assert roles(*(rotor(k, "part_{}") for k in range(4)), *servos).rotors == ()


def test_an_arm_with_a_rotor_s_name_but_limits_is_none() -> None:
    assert roles(link("prop_arm"), joint("prop_arm", "base", "prop_arm")).rotors == ()
    wide = '<limit lower="-1e16" upper="1e16" effort="1" velocity="1"/>'
    assert roles(link("prop"), joint("prop", "base", "prop", "revolute", "0 0 1", more=wide)).rotors == ("prop",)


def test_a_finger_pair_is_one_tip_between_the_fingers() -> None:
    left = link("left", 0.01) + joint("left", "fore", "left", "prismatic", "0 1 0", "0 0.02 -0.1")
    right = link("right", 0.01) + joint("right", "fore", "right", "prismatic", "0 -1 0", "0 -0.02 -0.1")
    found = roles(*ARM, left, right)
    assert found.grippers == (("left", "right"),)
    assert found.tips == (TipProposal("fore", (0.0, 0.0, -0.1)),)
    mimicking = link("jaw") + joint("jaw", "fore", "jaw", more='<mimic joint="left"/>')
    assert roles(*ARM, left, mimicking).grippers == (("jaw", "left"),)


def test_two_arms_on_a_waist_are_no_fingers() -> None:
    arms = [link(n, com="0 0 -0.1") + joint(n, "waist", n, xyz=f"0 {y} 0") for n, y in (("left", 0.1), ("right", -0.1))]
    found = roles(link("waist"), joint("waist", "base", "waist", axis="0 0 1"), *arms)
    assert (found.grippers, found.frozen) == ((), ())
    assert found.tips == (TipProposal("left"), TipProposal("right"))


def test_sensors_are_no_hands_and_their_joints_are_idle() -> None:
    gimbal = link("camera_link", 0.05) + joint("tilt", "base", "camera_link", axis="0 1 0")
    on_arm = '<link name="wrist_camera"/>' + joint("c", "fore", "wrist_camera", "fixed", xyz="0 0 -0.4")
    hand = '<link name="tool0"/>' + joint("t", "fore", "tool0", "fixed", xyz="0 0 -0.1")
    found = roles(*ARM, gimbal, on_arm, hand)
    assert found.idle == ("tilt",)
    assert found.tips == (TipProposal("tool0"),)


def test_a_tilt_unit_of_a_rotor_is_no_arm() -> None:
    units = [
        link(f"unit_{k}") + joint(f"unit_{k}", "base", f"unit_{k}") + rotor(k, parent=f"unit_{k}") for k in range(3)
    ]
    found = roles(*units)
    assert found.rests_on_base
    assert found.idle == ("unit_0", "unit_1", "unit_2")


def test_frozen_joints_of_the_user_join_those_that_are_found() -> None:
    parts = (*(rotor(k) for k in range(4)), *ARM)
    assert roles(*parts, tips=("base",)).idle == ("shoulder", "elbow")
    found = roles(*parts, frozen=("rotor_0_joint", "elbow"))
    assert (len(found.rotors), found.idle) == (4, ("elbow",))
    assert roles(*parts, frozen=()).frozen == ()


def test_tilted_rotors_without_names_are_found() -> None:
    tilted = [
        rotor(k, "m{}").replace('<axis xyz="0 0 1"/>', f'<axis xyz="{np.sin(k)} {np.cos(k)} 1.2"/>') for k in range(6)
    ]
    found = roles(*tilted, *ARM)
    assert (len(found.rotors), found.tips) == (6, (TipProposal("fore"),))


@pytest.mark.parametrize(
    ("kind", "axes", "limits"),
    [
        ("revolute", ("0 1 0", "0 -1 0"), ("-1 1", "-1 1")),
        ("revolute", ("0 1 0", "0 1 0"), ("0 0.8", "-0.8 0")),
        ("prismatic", ("1 0 0", "1 0 0"), ("0 0.03", "-0.03 0")),
    ],
)
def test_fingers_without_names_close_against_each_other(
    kind: str, axes: tuple[str, str], limits: tuple[str, str]
) -> None:
    def finger(name: str, axis: str, limit: str) -> str:
        lower, upper = limit.split()
        more = f'<limit lower="{lower}" upper="{upper}" effort="1" velocity="1"/>'
        return link(name, 0.01) + joint(name, "fore", name, kind, axis, "0 0 -0.1", more)

    found = roles(*ARM, *map(finger, ("left", "right"), axes, limits))
    assert found.grippers == (("left", "right"),)
    for pair, others in (
        (("left", "right"), (("0 1 0", "0 1 0"), ("-1 1.01", "-1.01 1"))),  # of one direction
        (("tool", "camera"), (("0 1 0", "0 -1 0"), ("-1 1", "-1 1"))),
    ):
        assert roles(*ARM, *map(finger, pair, *others)).grippers == ()
    heavy = [link(n) + joint(n, "fore", n, axis=axis) for n, axis in (("l", "0 1 0"), ("r", "0 -1 0"))]
    assert roles(*ARM, *heavy).grippers == ()


def test_each_of_three_fingers_is_listed_once() -> None:
    fingers = [
        link(n, 0.01) + joint(n, "fore", n, axis=axis) for n, axis in (("a", "0 1 0"), ("b", "0 -1 0"), ("c", "0 1 0"))
    ]
    assert roles(*ARM, *fingers).grippers == (("a", "b", "c"),)


def test_the_joint_of_a_gripper_s_body_is_no_finger() -> None:
    body = link("gripper_link") + joint("wrist", "fore", "gripper_link", axis="0 0 1", xyz="0 0 -0.1")
    fingers = [
        link(f"{n}_finger", 0.01) + joint(n, "gripper_link", f"{n}_finger", "prismatic", f"0 {s}1 0", f"0 {s}0.02 -0.1")
        for n, s in (("left", ""), ("right", "-"))
    ]
    found = roles(*ARM, body, *fingers)
    assert (found.grippers, found.frozen) == ((("left", "right"),), ("left", "right"))
    assert found.tips == (TipProposal("gripper_link", (0.0, 0.0, -0.1)),)
    knuckle = [body.replace("gripper_link", "knuckle"), *(each.replace("gripper_link", "knuckle") for each in fingers)]
    assert roles(*ARM, *knuckle).grippers == (("wrist", "left", "right"),)


def test_joints_without_a_range_are_fixed() -> None:
    locked = '<limit lower="0.5" upper="0.5" effort="1" velocity="1"/>'
    last = link("hand") + joint("wrist", "fore", "hand", xyz="0 0 -0.1", more=locked)
    found = roles(*ARM, last)
    assert found.idle == ("wrist",)
