"""Parser of URDF documents: XML with the line of every element, links, joints, and their limits.

Attributes that would change the model are read or refused: `quat_xyzw` of URDF 1.1 is read, unknown attributes of the
elements in `ATTRIBUTES` and unknown versions are refused. Geometry, damping, friction and extensions are not part of
the model; joints with damping or friction are listed in `LinkTree.damped`.
"""

from __future__ import annotations

import dataclasses
import re
from collections.abc import Iterator
from pathlib import Path
from typing import NoReturn
from xml.parsers import expat

import numpy as np
from scipy.spatial.transform import Rotation

from colift.models import link_tree
from colift.models.link_tree import Coupling, Link, LinkJoint, LinkTree
from colift.models.robot import ZERO, Body, JointLimits, Vector
from colift.runtime import bounded_read

MAX_NUMBER = 1e12  # largest number, so that products do not overflow
MAX_QUATERNION_ERROR = 1e-3  # of the norm
VERSIONS = ("1", "1.0", "1.1", "1.2")
JOINT_TYPES = (link_tree.REVOLUTE, link_tree.CONTINUOUS, link_tree.PRISMATIC, link_tree.FIXED)
ENTRIES = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")  # entries of an inertia
MIRRORED_ENTRIES = {"iyx": "ixy", "izx": "ixz", "izy": "iyz"}  # lower triangle, which some exporters also write
ATTRIBUTES = {  # attributes of the elements that define the model
    "origin": ("xyz", "rpy", "quat_xyzw"),
    "mass": ("value",),
    "inertia": (*ENTRIES, *MIRRORED_ENTRIES),
    "axis": ("xyz",),
    "parent": ("link",),
    "child": ("link",),
    "mimic": ("joint", "multiplier", "offset"),
    "limit": ("lower", "upper", "effort", "velocity", "acceleration", "deceleration", "jerk"),
}
UNLIMITED = 63.0  # rad or m, larger limits of position mean that there is none
SPEED_EFFORT_RANGE = 1e-6, 1e6  # rad/s, m/s, N m or N; other limits mean that there is none


def read_urdf(path: str | Path) -> LinkTree:
    """Read the links and joints of a URDF file; a file that cannot be read or is too large raises `OSError`.

    Args:
        path: File.

    Returns:
        Links and joints.

    Raises:
        ValueError: For the reasons of `parse_link_tree`.
    """
    return parse_link_tree(bounded_read.read_bytes(path, bounded_read.MAX_TEXT_BYTES), str(path))


def parse_link_tree(text: str | bytes, file: str) -> LinkTree:
    """Parse the links and joints of a URDF document.

    A `ValueError` is raised for a text that is not XML or has a DOCTYPE, for links that are not one tree, for joint
    types, versions and attributes that are not supported, and for negative masses. The message begins with
    `file:line:`. A root link without inertia that a floating joint connects to the vehicle is dropped.

    Args:
        text: XML document.
        file: File name, for messages.

    Returns:
        Links and joints.
    """
    robot = _xml(text, file)
    if robot.tag != "robot":
        _fail(robot, f"the first element must be <robot>, got <{robot.tag}>")
    if (version := robot.attributes.get("version", "1.0")) not in VERSIONS:
        _fail(robot, f"URDF version {version!r} is not supported; supported: {', '.join(VERSIONS)}")
    for element in robot.children:
        if element.tag.startswith("xacro:"):
            _fail(element, f"<{element.tag}> is a macro; expand the file with xacro first")
        if element.tag == "loop_joint" or element.tag.endswith((":joint", ":loop_joint")):
            _fail(element, f"<{element.tag}> closes a loop or is of an unknown type; links and joints must be a tree")
    links, joints = _elements_by_name(robot, "link"), _elements_by_name(robot, "joint")
    links, joints = _without_floating_root(links, joints)
    root = _check_tree(robot, links, joints)
    rotors, servos = _drives(robot)
    return LinkTree(
        file=file,
        root=root,
        links={name: Link(name=name, location=it.location, inertial=_inertial(it)) for name, it in links.items()},
        joints={name: _joint(element) for name, element in joints.items()},
        rotor_drives=rotors,
        servo_drives=servos,
        damped=tuple(_damped(joints)),
        notes=tuple(_placeholders(joints)),
    )


# XML, with the line of every element ----------------------------------------------------------------------------------


@dataclasses.dataclass
class _Element:
    """XML element with its location; `parent` is None for the document."""

    tag: str
    attributes: dict[str, str]
    location: str  # file:line
    children: list[_Element]
    parent: _Element | None = None
    text: str = ""

    def one(self, tag: str) -> _Element | None:
        """Return the child with a tag, or None; fail if there are several."""
        found = [child for child in self.children if child.tag == tag]
        if len(found) > 1:
            _fail(found[1], f"<{tag}> occurs twice in {self}")
        if found:
            _check_attributes(found[0], self)
        return found[0] if found else None

    def everywhere(self, tag: str) -> Iterator[_Element]:
        """Iterate over the elements with a tag at any depth."""
        pending = list(reversed(self.children))
        while pending:
            element = pending.pop()
            if element.tag == tag:
                yield element
            pending += reversed(element.children)

    def __str__(self) -> str:
        """Return tag and name, or the tag and the closest element around it that has a name, for messages."""
        if "name" in self.attributes:
            return f"{self.tag} {self.attributes['name']!r}"
        around = self.parent
        while around is not None and "name" not in around.attributes:
            around = around.parent
        return f"<{self.tag}>" if around is None or around.tag == "robot" else f"<{self.tag}> of {around}"


class _Doctype(ValueError):
    """The document contains a DOCTYPE."""


def _fail(element: _Element, message: str) -> NoReturn:
    """Raise `ValueError` with the location of an element."""
    raise ValueError(f"{element.location}: {message}")


def _check_attributes(element: _Element, owner: _Element) -> None:
    """Fail if an element that defines the model has an unknown attribute."""
    known: tuple[str, ...] = ATTRIBUTES.get(element.tag, ())
    for name in element.attributes if known else ():
        if name not in known and ":" not in name:
            _fail(
                element,
                f"{owner}: attribute {name!r} of <{element.tag}> is unknown and could change the model: remove it, or "
                f"use one of {', '.join(known)}",
            )


def _xml(text: str | bytes, file: str) -> _Element:
    """Parse the root element; a DOCTYPE is rejected, because entities could expand without limit."""
    parser, top = expat.ParserCreate(), _Element("", {}, file, [])
    open_elements = [top]

    def begin(tag: str, attributes: dict[str, str]) -> None:
        element = _Element(tag, attributes, f"{file}:{parser.CurrentLineNumber}", [], open_elements[-1])
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def characters(text: str) -> None:
        open_elements[-1].text += text

    def reject(*_: object) -> None:
        raise _Doctype(f"{file}:{parser.CurrentLineNumber}: a DOCTYPE is not allowed in a URDF file")

    parser.buffer_text = True
    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda _: open_elements.pop()
    parser.CharacterDataHandler = characters
    parser.StartDoctypeDeclHandler = reject
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise ValueError(f"{file}:{error.lineno}: not XML: {expat.ErrorString(error.code)}") from None
    except _Doctype:
        raise
    except (LookupError, ValueError) as error:  # unknown encoding, or an incomplete character
        raise ValueError(f"{file}:{parser.CurrentLineNumber}: not XML: {error}") from None
    return top.children[0]


def _attribute(element: _Element, name: str, owner: _Element) -> str:
    """Return a required attribute."""
    if name not in element.attributes:
        _fail(element, f"{owner}: <{element.tag}> has no {name!r}")
    return element.attributes[name]


def _numbers(element: _Element | None, name: str, count: int, default: Vector, owner: _Element) -> np.ndarray:
    """Return the `count` finite numbers of an attribute, or the default if element or attribute is absent."""
    if element is None or name not in element.attributes:
        return np.array(default, float)
    text = element.attributes[name]
    try:
        values = np.array([float(word) for word in text.split()])
    except ValueError:
        values = np.array([])
    cut = text if len(text) <= 60 else f"{text[:60]}..."
    if len(values) != count or not np.isfinite(values).all():
        expected = "a finite number" if count == 1 else f"{count} finite numbers"
        _fail(element, f"{owner}: {name!r} of <{element.tag}> must be {expected}, got {cut!r}")
    if np.abs(values).max() > MAX_NUMBER:
        _fail(element, f"{owner}: {name!r} of <{element.tag}> must be at most {MAX_NUMBER:g} in size, got {cut!r}")
    return values


# Tree -----------------------------------------------------------------------------------------------------------------


def _elements_by_name(robot: _Element, tag: str) -> dict[str, _Element]:
    """Return the elements with a tag, by name; fail if a name occurs twice."""
    found: dict[str, _Element] = {}
    for element in robot.children:
        if element.tag == tag:
            name = _attribute(element, "name", robot)
            if name in found:
                _fail(element, f"{element} occurs twice, first at {found[name].location}")
            found[name] = element
    return found


def _without_floating_root(
    links: dict[str, _Element], joints: dict[str, _Element]
) -> tuple[dict[str, _Element], dict[str, _Element]]:
    """Remove the floating joint between a world and the vehicle, and the links of the world.

    The world is the root link with the links that are fixed to it, all without inertia. The origin of the joint is a
    start pose.
    """
    floating = [joint for joint in joints.values() if joint.attributes.get("type") == "floating"]
    if len(floating) != 1:
        return links, joints
    (joint,) = floating
    ends = {
        name: {_link_of(other, end, links) for end in ("parent", "child")}
        for name, other in joints.items()
        if other is not joint
    }
    world, inner = {_link_of(joint, "parent", links)}, set[str]()
    while more := {name for name, pair in ends.items() if name not in inner and world & pair}:
        inner |= more
        world = world.union(*(ends[name] for name in more))
    fixed = all(joints[name].attributes.get("type") == link_tree.FIXED for name in inner)
    if not fixed or any(_inertial(links[name]) is not None for name in world):
        return links, joints
    return (
        {name: link for name, link in links.items() if name not in world},
        {name: other for name, other in joints.items() if name in ends and name not in inner},
    )


def _check_tree(robot: _Element, links: dict[str, _Element], joints: dict[str, _Element]) -> str:
    """Return the root link; fail unless the links are one tree of supported joints."""
    below: dict[str, list[str]] = {name: [] for name in links}
    holder: dict[str, _Element] = {}
    for joint in joints.values():
        parent, child = _link_of(joint, "parent", links), _link_of(joint, "child", links)
        if child in holder:
            _fail(
                joint,
                f"{joint}: link {child!r} is already the child of {holder[child]} at {holder[child].location}; "
                "closed loops of links are not supported",
            )
        _check_type(joint)
        holder[child] = joint
        below[parent].append(child)
    roots = [name for name in links if name not in holder]
    if not roots:
        _fail(robot, "no root link: every link is the child of a joint" if links else "the file has no links")
    if len(roots) > 1:
        _fail(links[roots[1]], f"one root link is allowed, found {len(roots)}: {', '.join(roots)}")
    reached, pending = set(), [roots[0]]
    while pending:
        name = pending.pop()
        reached.add(name)
        pending += below[name]
    for name, element in links.items():
        if name not in reached:
            _fail(element, f"{element} is in a cycle of joints: it is not connected to the root {roots[0]!r}")
    return roots[0]


def _link_of(joint: _Element, end: str, links: dict[str, _Element]) -> str:
    """Return the name of the parent or child link of a joint; fail if the file has no such link."""
    element = joint.one(end)
    if element is None:
        _fail(joint, f"{joint} has no <{end}>")
    name = _attribute(element, "link", joint)
    if name not in links:
        _fail(element, f"{joint}: {end} {name!r} is not a link; links: {', '.join(links)}")
    return name


def _check_type(joint: _Element) -> None:
    """Fail if the type of a joint is not supported."""
    kind = _attribute(joint, "type", joint)
    if kind not in JOINT_TYPES:
        _fail(joint, f"{joint}: type {kind!r} is not supported; allowed: {', '.join(JOINT_TYPES)}")


# Joints ---------------------------------------------------------------------------------------------------------------


def _origin(element: _Element, owner: _Element) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation and position [m] of the origin of an element.

    The rotation is that of `quat_xyzw`, or `R_z(yaw) R_y(pitch) R_x(roll)`.
    """
    origin = element.one("origin")
    position = _numbers(origin, "xyz", 3, ZERO, owner)
    if origin is not None and "quat_xyzw" in origin.attributes:
        if "rpy" in origin.attributes:
            _fail(origin, f"{owner}: <origin> states its rotation twice, as 'rpy' and as 'quat_xyzw'")
        quaternion = _numbers(origin, "quat_xyzw", 4, (), owner)
        if not abs(np.linalg.norm(quaternion) - 1) <= MAX_QUATERNION_ERROR:
            norm = np.linalg.norm(quaternion)
            _fail(origin, f"{owner}: 'quat_xyzw' of <origin> must be a unit quaternion, its norm is {norm:.6g}")
        return Rotation.from_quat(quaternion).as_matrix(), position
    (c_r, c_p, c_y), (s_r, s_p, s_y) = (f(_numbers(origin, "rpy", 3, ZERO, owner)) for f in (np.cos, np.sin))
    R_x = np.array([[1, 0, 0], [0, c_r, -s_r], [0, s_r, c_r]])
    R_y = np.array([[c_p, 0, s_p], [0, 1, 0], [-s_p, 0, c_p]])
    R_z = np.array([[c_y, -s_y, 0], [s_y, c_y, 0], [0, 0, 1]])
    return R_z @ R_y @ R_x, position


def _joint(joint: _Element) -> LinkJoint:
    """Make a joint from its element."""
    kind = joint.attributes["type"]
    rotation, position = _origin(joint, joint)
    fixed = kind == link_tree.FIXED
    return LinkJoint(
        name=joint.attributes["name"],
        kind=kind,
        parent=_end(joint, "parent"),
        child=_end(joint, "child"),
        rotation=rotation,
        position=position,
        axis=np.array([1.0, 0.0, 0.0]) if fixed else _axis(joint),
        limits=JointLimits() if fixed else _limits(joint),
        coupling=None if fixed else _coupling(joint),
        location=joint.location,
    )


def _end(joint: _Element, end: str) -> str:
    """Return the name of the parent or child link of a joint that `_check_tree` accepted."""
    element = joint.one(end)
    return "" if element is None else element.attributes["link"]


def _axis(joint: _Element) -> np.ndarray:
    """Return the unit vector of the axis of a joint; the default is the first axis."""
    element = joint.one("axis")
    axis = _numbers(element, "xyz", 3, (1.0, 0.0, 0.0), joint)
    length = np.linalg.norm(axis)
    if not length > 0:
        _fail(element or joint, f"{joint}: the axis must not be zero")
    return axis / length


def _coupling(joint: _Element) -> Coupling | None:
    """Return the coupling of a joint to another one; None if it has none."""
    element = joint.one("mimic")
    if element is None:
        return None
    return Coupling(
        joint=_attribute(element, "joint", joint),
        multiplier=float(_numbers(element, "multiplier", 1, (1.0,), joint)[0]),
        offset=float(_numbers(element, "offset", 1, (0.0,), joint)[0]),
        location=element.location,
    )


def _limits(joint: _Element) -> JointLimits:
    """Return the limits of a joint; values that mean "unlimited" in practice are omitted.

    Limits from 0 to 0 are the placeholder of exporters for no limits.
    """
    element, stated = joint.one("limit"), _stated_range(joint)
    if element is None:
        return JointLimits()
    least, most = SPEED_EFFORT_RANGE
    speed, effort = (abs(_numbers_or_zero(element, name, joint)) for name in ("velocity", "effort"))
    return JointLimits(
        position=stated if stated and 0 < max(map(abs, stated)) <= UNLIMITED else None,
        speed=speed if least <= speed < most else None,
        effort=effort if least <= effort < most else None,
    )


def _stated_range(joint: _Element) -> tuple[float, float] | None:
    """Return the smallest and the largest position that a joint states; None if it states none.

    A fixed or continuous joint has no position limits. A missing bound is 0 if the other one is stated, as the format
    defines.
    """
    element, kind = joint.one("limit"), joint.attributes["type"]
    if element is None or kind == link_tree.FIXED:
        return None
    lower, upper = (_numbers_or_zero(element, name, joint) for name in ("lower", "upper"))
    if kind == link_tree.CONTINUOUS or not {"lower", "upper"} & set(element.attributes):
        return None
    if lower > upper:
        _fail(element, f"{joint}: the lower limit {lower:g} exceeds the upper limit {upper:g}")
    return lower, upper


def _numbers_or_zero(element: _Element, name: str, owner: _Element) -> float:
    """Return a number of an element, 0 if it is absent; infinity is accepted."""
    if element.attributes.get(name, "").strip().lstrip("+-").lower() in ("inf", "infinity"):
        return MAX_NUMBER * (-1.0 if element.attributes[name].strip().startswith("-") else 1.0)
    if re.fullmatch(r"[+-]?[\d.]+[eE]\+?\d+", element.attributes.get(name, "").strip()):
        return float(np.clip(float(element.attributes[name]), -MAX_NUMBER, MAX_NUMBER))  # unlimited, such as 1e16
    return float(_numbers(element, name, 1, (0.0,), owner)[0])


def _drives(robot: _Element) -> tuple[frozenset[str], frozenset[str]]:
    """Return the joints that motor plugins or transmissions drive: rotors, and others."""
    rotors, servos = set(), set()
    for plugin in robot.everywhere("plugin"):
        words = f"{plugin.attributes.get('filename', '')} {plugin.attributes.get('name', '')}".lower()
        if "motor" in words or "rotor" in words:
            rotors |= {e.text.strip() for e in plugin.everywhere("jointName")}
    for transmission in robot.everywhere("transmission"):
        interfaces = " ".join(e.text for e in transmission.everywhere("hardwareInterface")).lower()
        driven = {name for e in transmission.everywhere("joint") if (name := e.attributes.get("name"))}
        (rotors if "rotor" in interfaces or "thrust" in interfaces else servos).update(driven)
    return frozenset(rotors), frozenset(servos - rotors)


def _placeholders(joints: dict[str, _Element]) -> Iterator[str]:
    """Yield a sentence on the joints whose limits are the placeholder for no limits."""
    names = [name for name, joint in joints.items() if _stated_range(joint) == (0.0, 0.0)]
    if names:
        yield f"limits from 0 to 0 are read as no limits: {', '.join(names)}"


def _damped(joints: dict[str, _Element]) -> Iterator[str]:
    """Yield the joints with damping or friction."""
    for name, joint in joints.items():
        dynamics = joint.one("dynamics")
        values = [_numbers(dynamics, key, 1, (0.0,), joint)[0] for key in ("damping", "friction")]
        if joint.attributes["type"] != link_tree.FIXED and any(values):
            yield name


# Inertia --------------------------------------------------------------------------------------------------------------


def _inertial(link: _Element) -> Body | None:
    """Read mass and inertia of a link in its frame, without a check of physical consistency; None if absent."""
    inertial = link.one("inertial")
    if inertial is None:
        return None
    m = _entry(inertial, "mass", "value", link)
    xx, yy, zz, xy, xz, yz = (_entry(inertial, "inertia", name, link) for name in ENTRIES)
    _check_symmetry(inertial, link)
    R, com = _origin(inertial, link)
    J = link_tree.symmetric(R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T)
    if m < 0:
        _fail(inertial, f"{link}: mass {m:g} kg is negative")
    return Body(mass=m, com=com, inertia=J) if m > 0 or J.any() else None


def _check_symmetry(inertial: _Element, link: _Element) -> None:
    """Fail if an entry below the diagonal of an inertia is stated and differs from the one above it."""
    stated = inertial.one("inertia")
    for name, mirrored in MIRRORED_ENTRIES.items():
        if stated is None or name not in stated.attributes:
            continue
        below, above = (_entry(inertial, "inertia", each, link) for each in (name, mirrored))
        if abs(below - above) > 1e-9 * max(abs(below), abs(above)):
            _fail(stated, f"{link}: the inertia is not symmetric: {name} is {below:g}, {mirrored} is {above:g}")


def _entry(inertial: _Element, tag: str, name: str, link: _Element) -> float:
    """Read a required number of an inertial element."""
    element = inertial.one(tag)
    if element is None:
        _fail(inertial, f"{link}: <inertial> has no <{tag}>")
    _attribute(element, name, link)
    return float(_numbers(element, name, 1, (), link)[0])
