"""Import of an agent from a URDF file, and export to URDF.

The root link is the base of the agent; thrust acts along its third axis. Links that are connected by fixed joints form
one body. The physical consistency of bodies is checked, not that of links, because files contain placeholder links.
Joints are numbered depth-first, children in the order of the file.

The model has no coupled joints (`<mimic>`); an option selects whether such joints are frozen or independent. Geometry,
limits, damping, friction, transmissions and extensions are ignored.

Example:
    >>> from colift.models import urdf
    >>> text = '''<robot name="drone"><link name="base"><inertial><mass value="1"/>
    ... <inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>'''
    >>> robot = urdf.parse_urdf(text, "drone.urdf")
    >>> urdf.make_agent(robot, [("base", (0.0, 0.0, -0.1))], [(0.5, 0.0, 0.0)], thrust_max=20.0).mass.tolist()
    [1.0]
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Literal, NoReturn
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement
from xml.parsers import expat

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from colift.models import validation
from colift.models.parameters import AerialManipulator, KinematicTree

CONTINUOUS, PRISMATIC = "continuous", "prismatic"
JOINT_TYPES = {"revolute": False, CONTINUOUS: False, PRISMATIC: True}  # whether the joint is prismatic
UNLIMITED = 1e6  # m, m/s and N, limits that the format requires for a prismatic joint
Vector = Sequence[float] | np.ndarray
Mimic = Literal["frozen", "independent"]
ZERO, ZERO_POSITIONS = (0.0, 0.0, 0.0), MappingProxyType({})
MAX_NUMBER = 1e12  # largest number, so that products do not overflow
MAX_BYTES = 16 * 2**20  # largest file; a robot with a hundred links has about 1 MiB


@dataclasses.dataclass(frozen=True)
class Body:
    """Rigid body: a link and the links connected to it by fixed joints, in the frame of the first link."""

    mass: float  # kg
    com: np.ndarray  # m, center of mass
    inertia: np.ndarray  # kg m^2, about the center of mass


@dataclasses.dataclass(frozen=True)
class Joint:
    """Movable joint; its frame at position zero is the frame of the body that it moves."""

    name: str  # name in the file
    parent: int  # index of the parent body
    prismatic: bool  # whether the joint translates
    position: np.ndarray  # m, joint origin in the parent frame
    rotation: np.ndarray  # joint frame at position zero to parent frame
    axis: np.ndarray  # unit vector, joint frame


@dataclasses.dataclass(frozen=True)
class Placement:
    """Pose of a link in the frame of its body: `x_body = rotation x_link + position`."""

    body: int  # index of the body
    rotation: np.ndarray  # link frame to body frame
    position: np.ndarray  # m, link origin in the body frame


@dataclasses.dataclass(frozen=True)
class Robot:
    """Kinematics and inertias of a URDF file; joint k moves body k + 1, body 0 is the base.

    Attributes:
        file: File name, for messages.
        bodies: Rigid bodies.
        joints: Movable joints.
        links: Pose of each link, by its name.
    """

    file: str
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    links: Mapping[str, Placement]

    def tip(self, link: str, offset: Vector = ZERO) -> tuple[int, np.ndarray]:
        """Locate a point of a link.

        Args:
            link: Name of the link.
            offset: Point in the link frame [m].

        Returns:
            Index of the body, and the point in the body frame [m].

        Raises:
            ValueError: If the file has no such link, or the offset is not a vector.
        """
        if link not in self.links:
            raise ValueError(f"{self.file}: tip {link!r} is not a link; links: {', '.join(self.links)}")
        at = self.links[link]
        return at.body, at.position + at.rotation @ _vector(f"{self.file}: the offset of tip {link!r}", offset)


def _vector(name: str, values: Vector) -> np.ndarray:
    """Validate a vector; `name` is its name in messages."""
    vector = np.asarray(values, float)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{name} must be three finite numbers, m, got {np.asarray(values).tolist()}")
    return vector


def load_urdf(
    path: str | Path, mimic: Mimic | None = None, nominal_positions: Mapping[str, float] = ZERO_POSITIONS
) -> Robot:
    """Read a URDF file.

    A file that cannot be read raises `OSError`.

    Args:
        path: File.
        mimic: Treatment of coupled joints, see `parse_urdf`.
        nominal_positions: Positions for frozen joints, see `parse_urdf`.

    Returns:
        The robot.

    Raises:
        ValueError: If the file is too large, or for the reasons of `parse_urdf`.
    """
    with Path(path).open("rb") as file:
        text = file.read(MAX_BYTES + 1)
    if len(text) > MAX_BYTES:
        raise ValueError(f"{path}:1: the file is larger than {MAX_BYTES // 2**20} MiB, the maximum for URDF files")
    return parse_urdf(text, str(path), mimic, nominal_positions)


def parse_urdf(
    text: str | bytes, file: str, mimic: Mimic | None = None, nominal_positions: Mapping[str, float] = ZERO_POSITIONS
) -> Robot:
    """Parse a URDF document.

    The parser raises `ValueError` for a text that is not XML or has a DOCTYPE, and for links that are not one tree. It
    rejects unsupported joint types, and coupled joints if `mimic` is None. It rejects negative masses and unphysical
    inertias (`validation.validate_inertia`). The message begins with `file:line:`.

    Args:
        text: XML document.
        file: File name, for messages.
        mimic: Treatment of coupled joints (`<mimic>`): "frozen" fixes them at `multiplier position + offset`, where
            `position` is that of the joint they depend on; "independent" makes them independent joints.
        nominal_positions: Position of each joint that frozen joints depend on [rad, m], by name; default: 0.

    Returns:
        The robot.
    """
    robot = _xml(text, file)
    if robot.tag != "robot":
        _fail(robot, f"the first element must be <robot>, got <{robot.tag}>")
    for element in robot.children:
        if element.tag.startswith("xacro:"):
            _fail(element, f"<{element.tag}> is a macro; expand the file with xacro first")
    links, all_joints = _elements_by_name(robot, "link"), _elements_by_name(robot, "joint")
    root, below = _tree(robot, links, all_joints)
    frozen = _frozen_positions(all_joints, mimic, nominal_positions)
    body_links: list[list[tuple[_Element, Placement]]] = [[]]  # links of each body
    joints: list[Joint] = []
    placements: dict[str, Placement] = {}
    base = Placement(body=0, rotation=np.eye(3), position=np.zeros(3))
    pending: list[tuple[str, _Element | None, Placement]] = [(root, None, base)]
    while pending:
        name, joint, placement = pending.pop()
        if joint is not None:
            placement = _joint_frame(joint, placement)
            if joint.attributes["name"] in frozen:
                placement = _displaced(_joint(joint, placement), placement, frozen[joint.attributes["name"]])
            elif joint.attributes["type"] != "fixed":
                joints.append(_joint(joint, placement))
                placement = Placement(body=len(joints), rotation=np.eye(3), position=np.zeros(3))
                body_links.append([])
        placements[name] = placement
        body_links[placement.body].append((links[name], placement))
        pending += [(child, element, placement) for child, element in reversed(below[name])]
    return Robot(file=file, bodies=tuple(_body(parts) for parts in body_links), joints=tuple(joints), links=placements)


def make_agent(
    robot: Robot, tips: Sequence[str | tuple[str, Vector]], contact: Sequence[Vector] | np.ndarray, thrust_max: float
) -> AerialManipulator:
    """Make the parameters of an agent.

    Args:
        robot: Kinematics and inertias.
        tips: One link per arm; its origin is the tip, or a point given by an offset in the link frame [m].
        contact: Attachment point of each arm, payload frame [m].
        thrust_max: Maximum thrust [N].

    Returns:
        Parameters of one agent; `parameters.stack_agents` adds the axis of a group.

    Raises:
        ValueError: If a tip is not a link, the numbers of tips and contacts differ, or a value is invalid.
    """
    if len(tips) != len(contact) or not tips:
        raise ValueError(
            f"{robot.file}: {len(tips)} tips for {len(contact)} contacts; the numbers must be equal and at least 1"
        )
    attached = np.array([_vector(f"{robot.file}: contact {i}", c) for i, c in enumerate(contact)])
    if not 0 < thrust_max < np.inf:
        raise ValueError(f"{robot.file}: thrust_max {thrust_max:g} N is not positive and finite")
    carriers, points = zip(*(robot.tip(t) if isinstance(t, str) else robot.tip(*t) for t in tips), strict=True)
    joints = robot.joints
    return AerialManipulator(
        tree=KinematicTree(
            parents=tuple(j.parent for j in joints),
            prismatic=tuple(j.prismatic for j in joints),
            tip_bodies=tuple(carriers),
        ),
        mass=jnp.array([body.mass for body in robot.bodies]),
        com=jnp.array([body.com for body in robot.bodies]),
        inertia=jnp.array([body.inertia for body in robot.bodies]),
        joint_position=jnp.array([j.position for j in joints], float).reshape(-1, 3),
        joint_rotation=jnp.array([j.rotation for j in joints], float).reshape(-1, 3, 3),
        joint_axis=jnp.array([j.axis for j in joints], float).reshape(-1, 3),
        tip_position=jnp.array(points),
        contact_position=jnp.array(attached),
        thrust_max=jnp.array(thrust_max, float),
    )


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


# XML, with the line of every element ----------------------------------------------------------------------------------


@dataclasses.dataclass
class _Element:
    """XML element with its location."""

    tag: str
    attributes: dict[str, str]
    location: str  # file:line
    children: list[_Element]

    def one(self, tag: str) -> _Element | None:
        """Return the child with a tag, or None; fail if there are several."""
        found = [child for child in self.children if child.tag == tag]
        if len(found) > 1:
            _fail(found[1], f"<{tag}> occurs twice in {self}")
        return found[0] if found else None

    def __str__(self) -> str:
        """Return tag and name, for messages."""
        return f"{self.tag} {self.attributes['name']!r}" if "name" in self.attributes else f"<{self.tag}>"


class _Doctype(ValueError):
    """The document contains a DOCTYPE."""


def _fail(element: _Element, message: str) -> NoReturn:
    """Raise `ValueError` with the location of an element."""
    raise ValueError(f"{element.location}: {message}")


def _xml(text: str | bytes, file: str) -> _Element:
    """Parse the root element; a DOCTYPE is rejected, because entities could expand without limit."""
    parser, top = expat.ParserCreate(), _Element("", {}, file, [])
    open_elements = [top]

    def begin(tag: str, attributes: dict[str, str]) -> None:
        element = _Element(tag, attributes, f"{file}:{parser.CurrentLineNumber}", [])
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def reject(*_: object) -> None:
        raise _Doctype(f"{file}:{parser.CurrentLineNumber}: a DOCTYPE is not allowed in a URDF file")

    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda _: open_elements.pop()
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


# Links and joints -----------------------------------------------------------------------------------------------------


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


def _tree(
    robot: _Element, links: dict[str, _Element], joints: dict[str, _Element]
) -> tuple[str, dict[str, list[tuple[str, _Element]]]]:
    """Return the root link and the children of each link with their joints; fail unless the links are one tree."""
    below: dict[str, list[tuple[str, _Element]]] = {name: [] for name in links}
    holder: dict[str, _Element] = {}
    for joint in joints.values():
        parent, child = _link_of(joint, "parent", links), _link_of(joint, "child", links)
        if child in holder:
            _fail(joint, f"{joint}: link {child!r} is already the child of {holder[child]} at {holder[child].location}")
        _check_type(joint)
        holder[child] = joint
        below[parent].append((child, joint))
    roots = [name for name in links if name not in holder]
    if not roots:
        _fail(robot, "no root link: every link is the child of a joint" if links else "the file has no links")
    if len(roots) > 1:
        _fail(links[roots[1]], f"one root link is allowed, found {len(roots)}: {', '.join(roots)}")
    reached = list(_below(roots[0], below))
    for name, element in links.items():
        if name not in reached:
            _fail(element, f"{element} is in a cycle of joints: it is not connected to the root {roots[0]!r}")
    return roots[0], below


def _below(root: str, below: dict[str, list[tuple[str, _Element]]]) -> Iterator[str]:
    """Iterate over the links that are connected to the root."""
    pending = [root]
    while pending:
        name = pending.pop()
        yield name
        pending += [child for child, _ in below[name]]


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
    kind, known = _attribute(joint, "type", joint), (*JOINT_TYPES, "fixed")
    if kind not in known:
        _fail(joint, f"{joint}: type {kind!r} is not supported; allowed: {', '.join(known)}")


def _origin(element: _Element, owner: _Element) -> tuple[np.ndarray, np.ndarray]:
    """Return rotation `R_z(yaw) R_y(pitch) R_x(roll)` and position [m] of the origin of an element."""
    origin = element.one("origin")
    (c_r, c_p, c_y), (s_r, s_p, s_y) = (f(_numbers(origin, "rpy", 3, ZERO, owner)) for f in (np.cos, np.sin))
    R_x = np.array([[1, 0, 0], [0, c_r, -s_r], [0, s_r, c_r]])
    R_y = np.array([[c_p, 0, s_p], [0, 1, 0], [-s_p, 0, c_p]])
    R_z = np.array([[c_y, -s_y, 0], [s_y, c_y, 0], [0, 0, 1]])
    return R_z @ R_y @ R_x, _numbers(origin, "xyz", 3, ZERO, owner)


def _joint_frame(joint: _Element, parent: Placement) -> Placement:
    """Return the frame of a joint at position zero in its parent body."""
    R, p = _origin(joint, joint)
    return Placement(body=parent.body, rotation=parent.rotation @ R, position=parent.position + parent.rotation @ p)


def _joint(joint: _Element, at: Placement) -> Joint:
    """Make a joint from its element and its frame."""
    element = joint.one("axis")
    axis = _numbers(element, "xyz", 3, (1.0, 0.0, 0.0), joint)
    length = np.linalg.norm(axis)
    if not length > 0:
        _fail(element or joint, f"{joint}: the axis must not be zero")
    return Joint(
        name=joint.attributes["name"],
        parent=at.body,
        prismatic=JOINT_TYPES[joint.attributes["type"]],
        position=at.position,
        rotation=at.rotation,
        axis=axis / length,
    )


# Coupled joints -------------------------------------------------------------------------------------------------------


def _frozen_positions(joints: dict[str, _Element], mimic: Mimic | None, rest: Mapping[str, float]) -> dict[str, float]:
    """Return the positions of frozen coupled joints [rad, m], by name; empty if they are independent."""
    followers = {
        name: element
        for name, joint in joints.items()
        if joint.attributes["type"] != "fixed" and (element := joint.one("mimic")) is not None
    }
    for name, element in followers.items():
        if mimic is None:
            _fail(
                element,
                f"{joints[name]} depends on another joint (<mimic>), which the model does not support: choose mimic "
                "'frozen' (fixed at the rest position of that joint) or 'independent' (an independent joint)",
            )
    return {name: _held_at(name, joints, rest) for name in followers if mimic == "frozen"}


def _held_at(name: str, joints: dict[str, _Element], rest: Mapping[str, float]) -> float:
    """Compute the position `multiplier position + offset` along a chain of coupled joints."""
    chain, gain, offset = [name], 1.0, 0.0
    while (element := joints[chain[-1]].one("mimic")) is not None and joints[chain[-1]].attributes["type"] != "fixed":
        joint = joints[chain[-1]]
        followed = _attribute(element, "joint", joint)
        if followed not in joints:
            _fail(element, f"{joint} depends on {followed!r}, which is not a joint")
        if followed in chain:
            _fail(element, f"{joint} depends on itself through {', '.join(chain)}")
        offset += gain * _numbers(element, "offset", 1, (0.0,), joint)[0]
        gain *= _numbers(element, "multiplier", 1, (1.0,), joint)[0]
        chain.append(followed)
    return float(gain * rest.get(chain[-1], 0.0) + offset)


def _displaced(joint: Joint, at: Placement, position: float) -> Placement:
    """Return the frame of a joint at a position [rad, m]; `R = exp(position axis)` for a rotational joint."""
    if joint.prismatic:
        return dataclasses.replace(at, position=at.position + position * at.rotation @ joint.axis)
    return dataclasses.replace(at, rotation=at.rotation @ Rotation.from_rotvec(position * joint.axis).as_matrix())


# Inertia --------------------------------------------------------------------------------------------------------------

ENTRIES = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def _inertial(link: _Element) -> Body | None:
    """Read mass and inertia of a link in its frame, without a check of physical consistency; None if absent."""
    inertial = link.one("inertial")
    if inertial is None:
        return None
    m = _entry(inertial, "mass", "value", link)
    xx, yy, zz, xy, xz, yz = (_entry(inertial, "inertia", name, link) for name in ENTRIES)
    R, com = _origin(inertial, link)
    J = _symmetric(R @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ R.T)
    if m < 0:
        _fail(inertial, f"{link}: mass {m:g} kg is negative")
    return Body(mass=m, com=com, inertia=J) if m > 0 or J.any() else None


def _entry(inertial: _Element, tag: str, name: str, link: _Element) -> float:
    """Read a required number of an inertial element."""
    element = inertial.one(tag)
    if element is None:
        _fail(inertial, f"{link}: <inertial> has no <{tag}>")
    _attribute(element, name, link)
    return float(_numbers(element, name, 1, (), link)[0])


def _body(parts: list[tuple[_Element, Placement]]) -> Body:
    """Merge links to a body: `m = sum m_i`, center of mass, `J = sum J_i + m_i (d^2 I - d d^T)` about it."""
    first, _ = parts[0]
    inertials = [(link, _inertial(link), placement) for link, placement in parts]
    with_mass = [(body, placement) for _, body, placement in inertials if body is not None]
    if not with_mass:
        names = ", ".join(link.attributes["name"] for link, _ in parts[1:])
        also = f", nor do the links fixed to it: {names}" if names else ""
        _fail(first, f"{first} has no <inertial>{also}; every body requires mass and inertia")
    names = ", ".join(link.attributes["name"] for link, body, _ in inertials[1:] if body is not None)
    whole = f"{first.location}: {first}" + (f" with the links fixed to it ({names})" if names else "")
    m = np.array([body.mass for body, _ in with_mass])
    validation.validate_mass(whole, m.sum())
    s = np.array([placement.position + placement.rotation @ body.com for body, placement in with_mass])
    com = m @ s / m.sum()
    J = sum(
        _symmetric(placement.rotation @ body.inertia @ placement.rotation.T)
        + body.mass * (d @ d * np.eye(3) - np.outer(d, d))
        for (body, placement), d in zip(with_mass, s - com, strict=True)
    )
    validation.validate_inertia(whole, float(m.sum()), J)
    return Body(mass=float(m.sum()), com=com, inertia=J)


def _symmetric(J: np.ndarray) -> np.ndarray:
    """Remove asymmetry due to rounding."""
    return (J + J.T) / 2
