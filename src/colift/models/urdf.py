"""Import of an agent from a URDF file, and export to URDF.

The root link is the base of the agent; thrust acts along its third axis. Links that are connected by fixed joints form
one body. The physical consistency of bodies is checked, not that of links, because files contain placeholder links.
Joints are numbered depth-first, children in the order of the file.

The model has no coupled joints (`<mimic>`); an option selects whether such joints are frozen or independent. Limits of
position, speed and effort are read; the model does not enforce them. Geometry, damping and friction are not read.

See Also:
    colift.models.urdf_parser: reading of the document.
    colift.models.link_tree: reduction to bodies and joints.

Example:
    >>> from colift.models import urdf
    >>> text = '''<robot name="drone"><link name="base"><inertial><mass value="1"/>
    ... <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'''
    >>> robot = urdf.parse_urdf(text, "drone.urdf")
    >>> urdf.make_agent(robot, [("base", (0.0, 0.0, -0.1))], [(0.5, 0.0, 0.0)], thrust_max=20.0).mass.tolist()
    [1.0]
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from pathlib import Path
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

import jax
import numpy as np

from colift.models.link_tree import (
    CONTINUOUS,
    PRISMATIC,
    ZERO_POSITIONS,
    CoupledJoints,
    InertiaRule,
    reduce_tree,
)
from colift.models.parameters import AerialManipulator
from colift.models.robot import Body, Joint, JointLimits, Placement, Robot, make_agent
from colift.models.urdf_parser import parse_link_tree, read_urdf

__all__ = [
    "Body",
    "Joint",
    "JointLimits",
    "Placement",
    "Robot",
    "load_urdf",
    "make_agent",
    "parse_urdf",
    "rpy",
    "to_urdf",
]

UNLIMITED = 1e6  # m, m/s and N, limits that the format requires for a prismatic joint


def load_urdf(
    path: str | Path,
    mimic: CoupledJoints | None = None,
    nominal_positions: Mapping[str, float] = ZERO_POSITIONS,
    frozen: Collection[str] = (),
    inertia: InertiaRule = "strict",
) -> Robot:
    """Read a URDF file.

    A file that cannot be read or is too large raises `OSError`; a file that is not valid raises `ValueError`.

    Args:
        path: File.
        mimic: Treatment of coupled joints, see `link_tree.reduce_tree`.
        nominal_positions: Positions for frozen joints, see `link_tree.reduce_tree`.
        frozen: Names of joints to fix, see `link_tree.reduce_tree`.
        inertia: Treatment of bodies that violate the triangle inequality, see `link_tree.reduce_tree`.

    Returns:
        The robot.
    """
    return reduce_tree(read_urdf(path), mimic, nominal_positions, frozen, inertia)


def parse_urdf(
    text: str | bytes,
    file: str,
    mimic: CoupledJoints | None = None,
    nominal_positions: Mapping[str, float] = ZERO_POSITIONS,
    frozen: Collection[str] = (),
    inertia: InertiaRule = "strict",
) -> Robot:
    """Parse a URDF document.

    A `ValueError` is raised for the reasons of `urdf_parser.parse_link_tree` and `link_tree.reduce_tree`. Its message
    begins with `file:line:`.

    Args:
        text: XML document.
        file: File name, for messages.
        mimic: Treatment of coupled joints (`<mimic>`), see `link_tree.reduce_tree`.
        nominal_positions: Positions for frozen joints, see `link_tree.reduce_tree`.
        frozen: Names of joints to fix, see `link_tree.reduce_tree`.
        inertia: Treatment of bodies that violate the triangle inequality, see `link_tree.reduce_tree`.

    Returns:
        The robot.
    """
    return reduce_tree(parse_link_tree(text, file), mimic, nominal_positions, frozen, inertia)


def to_urdf(name: str, agent: AerialManipulator, joints: Sequence[str], arms: Sequence[str]) -> str:
    """Write an agent as a URDF document; `parse_urdf` returns the same parameters to rounding.

    The root link is `base`. Joint `j` moves link `j_link`; the tip of arm `a` is the origin of link `a_tip`. The model
    has no joint limits, so rotational joints are continuous and prismatic joints have the limits `UNLIMITED`. The
    format has no elements for thrust and payload contacts.

    Args:
        name: Name of the robot.
        agent: Parameters of one agent, without the axis of a group.
        joints: Names of the joints.
        arms: Names of the arms.

    Returns:
        The XML document.

    Raises:
        ValueError: If the numbers of names and of joints or arms differ.
    """
    tree = agent.tree
    if (len(joints), len(arms)) != (tree.joints, tree.arms):
        raise ValueError(f"{name}: {len(joints)} names for {tree.joints} joints, {len(arms)} for {tree.arms} arms")
    agent, links = jax.tree.map(np.asarray, agent), ["base", *(f"{joint}_link" for joint in joints)]
    robot = Element("robot", name=name)
    for i, link in enumerate(links):
        inertial = SubElement(SubElement(robot, "link", name=link), "inertial")
        SubElement(inertial, "origin", xyz=_text(agent.com[i]), rpy="0 0 0")
        SubElement(inertial, "mass", value=_text(agent.mass[i]))
        J = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
        SubElement(inertial, "inertia", {entry: _text(agent.inertia[i][at]) for entry, at in J.items()})
    for k, (joint, parent) in enumerate(zip(joints, tree.parents, strict=True)):
        at = (agent.joint_position[k], rpy(agent.joint_rotation[k]))
        moving = _add_joint(
            robot, joint, PRISMATIC if tree.prismatic[k] else CONTINUOUS, links[parent], links[k + 1], *at
        )
        SubElement(moving, "axis", xyz=_text(agent.joint_axis[k]))
        if tree.prismatic[k]:
            SubElement(
                moving,
                "limit",
                lower=_text(-UNLIMITED),
                upper=_text(UNLIMITED),
                effort=_text(UNLIMITED),
                velocity=_text(UNLIMITED),
            )
    for arm, carrier, tip in zip(arms, tree.tip_bodies, agent.tip_position, strict=True):
        SubElement(robot, "link", name=f"{arm}_tip")
        _add_joint(robot, f"{arm}.tip", "fixed", links[carrier], f"{arm}_tip", tip, np.zeros(3))
    ET.indent(robot)
    return f'<?xml version="1.0"?>\n{ET.tostring(robot, encoding="unicode")}\n'


def _add_joint(
    robot: Element, name: str, kind: str, parent: str, child: str, xyz: np.ndarray, angles: np.ndarray
) -> Element:
    """Add a joint with its parent, child and origin."""
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "origin", xyz=_text(xyz), rpy=_text(angles))
    return joint


def rpy(R: np.ndarray) -> np.ndarray:
    """Compute roll, pitch and yaw of `R = R_z(yaw) R_y(pitch) R_x(roll)`.

    The angles reproduce R to rounding, also at a pitch of 90 degrees.

    Args:
        R: Rotation matrix.

    Returns:
        The angles [rad].
    """
    yaw = np.arctan2(R[1, 0], R[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw])


def _text(numbers: object) -> str:
    """Format numbers with all digits."""
    return " ".join(repr(float(x)) for x in np.atleast_1d(np.asarray(numbers, dtype=float)))
