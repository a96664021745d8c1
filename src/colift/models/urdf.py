"""An agent from a URDF file, and as one: a tree of links and joints as base, joints and tips.

The root link is the base: its frame is the agent's, thrust along its third axis. Links that fixed joints hold together
are one body, and it is the body that must be physical, not each link of it: files hold placeholders. Joints are
numbered depth-first, children in the order of the file. The equations have no joint that follows another (`<mimic>`):
a choice says whether such joints are frozen or independent. Shapes, limits, damping, friction, transmissions and
extensions are not part of the equations, and are not read.
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

TURNS, SLIDES = "continuous", "prismatic"
TYPES = {"revolute": False, TURNS: False, SLIDES: True}  # whether it slides
UNLIMITED = 1e6  # m, m/s and N: of a sliding joint without limits
Vector = Sequence[float] | np.ndarray
Mimic = Literal["frozen", "independent"]
ZERO, NO_REST = (0.0, 0.0, 0.0), MappingProxyType({})
MAX_NUMBER = 1e12  # of a number, whose products must not overflow
MAX_BYTES = 16 * 2**20  # of a file; robots of a hundred links take one


@dataclasses.dataclass(frozen=True)
class Body:
    """A rigid body: a link and all that fixed joints hold to it, in that link's frame."""

    mass: float  # kg
    com: np.ndarray  # m
    inertia: np.ndarray  # kg m^2, about the centre of mass


@dataclasses.dataclass(frozen=True)
class Joint:
    """A joint that moves; its frame at rest is the body's that it moves."""

    name: str
    parent: int  # body
    prismatic: bool
    position: np.ndarray  # m, joint origin in the parent's frame
    rotation: np.ndarray  # joint frame at rest, to the parent's frame
    axis: np.ndarray  # unit vector, joint frame


@dataclasses.dataclass(frozen=True)
class Placement:
    """Where the frame of a link is: `x_body = rotation x_link + position`."""

    body: int
    rotation: np.ndarray
    position: np.ndarray  # m


@dataclasses.dataclass(frozen=True)
class Robot:
    """What a URDF file says of the equations of motion; joint k moves body k + 1, body 0 is the base."""

    file: str
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    links: Mapping[str, Placement]

    def tip(self, link: str, offset: Vector = ZERO) -> tuple[int, np.ndarray]:
        """The body that carries a point of a link, given in the link's frame, and the point in the body's frame, m.

        Raises `ValueError` for a link that the file does not have, with those it has, and an offset that is no vector.
        """
        if link not in self.links:
            raise ValueError(f"{self.file}: tip {link!r} is not a link; links: {', '.join(self.links)}")
        at = self.links[link]
        return at.body, at.position + at.rotation @ _vector(f"{self.file}: the offset of tip {link!r}", offset)


def _vector(what: str, given: Vector) -> np.ndarray:
    vector = np.asarray(given, float)
    if vector.shape != (3,) or not np.isfinite(vector).all():
        raise ValueError(f"{what} must be three finite numbers, m, got {np.asarray(given).tolist()}")
    return vector


def load_urdf(path: str | Path, mimic: Mimic | None = None, rest: Mapping[str, float] = NO_REST) -> Robot:
    """The robot of a URDF file; raises `OSError` where it cannot be read, and `ValueError` as `parse` does."""
    with Path(path).open("rb") as file:
        text = file.read(MAX_BYTES + 1)
    if len(text) > MAX_BYTES:
        raise ValueError(f"{path}:1: is larger than {MAX_BYTES // 2**20} MiB, which no URDF file is")
    return parse_urdf(text, str(path), mimic, rest)


def parse_urdf(text: str | bytes, file: str, mimic: Mimic | None = None, rest: Mapping[str, float] = NO_REST) -> Robot:
    """The robot that a text describes; `file` names it in messages.

    `mimic` says what becomes of joints that follow another one: `frozen`, fixed at `multiplier rest + offset`, the
    followed joint at its `rest` position, rad or m, 0 where left out; or `independent`, each a joint of its own.

    Raises `ValueError` as `file:line: ...` for what is not XML, has a DOCTYPE, is not one tree of links, holds a joint
    that is not revolute, continuous, prismatic or fixed, a joint that follows another where `mimic` is None, a negative
    mass, or a body that no rigid body is (`model.check_body`) when its links are merged.
    """
    robot = _xml(text, file)
    if robot.tag != "robot":
        _fail(robot, f"the first element must be <robot>, got <{robot.tag}>")
    for element in robot.children:
        if element.tag.startswith("xacro:"):
            _fail(element, f"<{element.tag}> is a macro; expand the file with xacro first")
    links, all_joints = _named(robot, "link"), _named(robot, "joint")
    root, below = _tree(robot, links, all_joints)
    frozen = _frozen(all_joints, mimic, rest)
    held: list[list[tuple[_Element, Placement]]] = [[]]  # of each body: its links
    joints: list[Joint] = []
    places: dict[str, Placement] = {}
    base = Placement(body=0, rotation=np.eye(3), position=np.zeros(3))
    ahead: list[tuple[str, _Element | None, Placement]] = [(root, None, base)]
    while ahead:
        name, joint, place = ahead.pop()
        if joint is not None:
            place = _placed(joint, place)
            if joint.attributes["name"] in frozen:
                place = _moved(_joint(joint, place), place, frozen[joint.attributes["name"]])
            elif joint.attributes["type"] != "fixed":
                joints.append(_joint(joint, place))
                place = Placement(body=len(joints), rotation=np.eye(3), position=np.zeros(3))
                held.append([])
        places[name] = place
        held[place.body].append((links[name], place))
        ahead += [(child, element, place) for child, element in reversed(below[name])]
    return Robot(file=file, bodies=tuple(_body(parts) for parts in held), joints=tuple(joints), links=places)


def agent(
    robot: Robot, tips: Sequence[str | tuple[str, Vector]], contact: Sequence[Vector] | np.ndarray, thrust_max: float
) -> AerialManipulator:
    """One agent, without the leading axis of a group (`model.stack` adds it).

    `tips` are links, each with an offset in its own frame, m, where the tip is not its origin: one arm each. `contact`
    are the attachments `c` in the payload's frame, m; `thrust_max` is in N. Raises `ValueError` for a tip that is not a
    link, where tips and contacts differ in number, and for a contact or a thrust that cannot be.
    """
    if len(tips) != len(contact) or not tips:
        raise ValueError(f"{robot.file}: {len(tips)} tips for {len(contact)} contacts; as many as contacts, at least 1")
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
    """An agent, without a group's leading axis, as the URDF file that `parse` reads back, to rounding.

    The root link is `base`; joint `j` moves link `j_link`, and the tip of arm `a` is the origin of link `a_tip`. The
    equations have no limits: joints that turn are continuous, those that slide have the limits that the format demands,
    so far out (`FAR`) that none is met. Thrust and contacts with the payload have no place in the format. Raises
    ValueError unless there are as many names as there are joints and arms.
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
        moving = _add_joint(robot, joint, SLIDES if tree.prismatic[k] else TURNS, links[parent], links[k + 1], *at)
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
    joint = SubElement(robot, "joint", name=name, type=kind)
    SubElement(joint, "parent", link=parent)
    SubElement(joint, "child", link=child)
    SubElement(joint, "origin", xyz=_text(xyz), rpy=_text(angles))
    return joint


def rpy(R: np.ndarray) -> np.ndarray:
    """Roll, pitch, yaw of `R = R_z(yaw) R_y(pitch) R_x(roll)`, rad; to rounding also where the pitch is upright."""
    yaw = np.arctan2(R[1, 0], R[0, 0])
    c, s = np.cos(yaw), np.sin(yaw)
    pitch = np.arctan2(-R[2, 0], c * R[0, 0] + s * R[1, 0])
    roll = np.arctan2(s * R[0, 2] - c * R[1, 2], c * R[1, 1] - s * R[0, 1])
    return np.array([roll, pitch, yaw])


def _text(numbers: object) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(x)) for x in np.atleast_1d(np.asarray(numbers, dtype=float)))


# XML, with the line of every element ----------------------------------------------------------------------------------


@dataclasses.dataclass
class _Element:
    tag: str
    attributes: dict[str, str]
    place: str  # file:line
    children: list[_Element]

    def one(self, tag: str) -> _Element | None:
        """The child of a name, which stands at most once."""
        found = [child for child in self.children if child.tag == tag]
        if len(found) > 1:
            _fail(found[1], f"<{tag}> stands twice in {self}")
        return found[0] if found else None

    def __str__(self) -> str:
        return f"{self.tag} {self.attributes['name']!r}" if "name" in self.attributes else f"<{self.tag}>"


class _Doctype(ValueError):
    pass


def _fail(at: _Element, sentence: str) -> NoReturn:
    raise ValueError(f"{at.place}: {sentence}")


def _xml(text: str | bytes, file: str) -> _Element:
    """The first element; a DOCTYPE, which could make entities expand without end, is refused."""
    parser, top = expat.ParserCreate(), _Element("", {}, file, [])
    open_elements = [top]

    def begin(tag: str, given: dict[str, str]) -> None:
        element = _Element(tag, given, f"{file}:{parser.CurrentLineNumber}", [])
        open_elements[-1].children.append(element)
        open_elements.append(element)

    def refuse(*_: object) -> None:
        raise _Doctype(f"{file}:{parser.CurrentLineNumber}: a DOCTYPE is not allowed in a URDF file")

    parser.StartElementHandler = begin
    parser.EndElementHandler = lambda _: open_elements.pop()
    parser.StartDoctypeDeclHandler = refuse
    try:
        parser.Parse(text, True)
    except expat.ExpatError as error:
        raise ValueError(f"{file}:{error.lineno}: not XML: {expat.ErrorString(error.code)}") from None
    except _Doctype:
        raise
    except (LookupError, ValueError) as error:  # of the encoding that the file names, or of half a character
        raise ValueError(f"{file}:{parser.CurrentLineNumber}: not XML: {error}") from None
    return top.children[0]


def _attribute(element: _Element, name: str, of: _Element) -> str:
    if name not in element.attributes:
        _fail(element, f"{of}: <{element.tag}> has no {name!r}")
    return element.attributes[name]


def _numbers(element: _Element | None, name: str, count: int, default: Vector, of: _Element) -> np.ndarray:
    """So many finite numbers of an attribute, or the default where element or attribute is absent."""
    if element is None or name not in element.attributes:
        return np.array(default, float)
    given = element.attributes[name]
    try:
        values = np.array([float(word) for word in given.split()])
    except ValueError:
        values = np.array([])
    cut = given if len(given) <= 60 else f"{given[:60]}..."
    if len(values) != count or not np.isfinite(values).all():
        wanted = "a finite number" if count == 1 else f"{count} finite numbers"
        _fail(element, f"{of}: {name!r} of <{element.tag}> must be {wanted}, got {cut!r}")
    if np.abs(values).max() > MAX_NUMBER:
        _fail(element, f"{of}: {name!r} of <{element.tag}> must be at most {MAX_NUMBER:g} in size, got {cut!r}")
    return values


# Links and joints -----------------------------------------------------------------------------------------------------


def _named(robot: _Element, tag: str) -> dict[str, _Element]:
    found: dict[str, _Element] = {}
    for element in robot.children:
        if element.tag == tag:
            name = _attribute(element, "name", robot)
            if name in found:
                _fail(element, f"{element} stands twice, first at {found[name].place}")
            found[name] = element
    return found


def _tree(
    robot: _Element, links: dict[str, _Element], joints: dict[str, _Element]
) -> tuple[str, dict[str, list[tuple[str, _Element]]]]:
    """The root link, and below each link its children with the joints to them; refuses what is not one tree."""
    below: dict[str, list[tuple[str, _Element]]] = {name: [] for name in links}
    holder: dict[str, _Element] = {}
    for joint in joints.values():
        parent, child = _link_of(joint, "parent", links), _link_of(joint, "child", links)
        if child in holder:
            _fail(joint, f"{joint}: link {child!r} has a parent already, by {holder[child]} at {holder[child].place}")
        _check_type(joint)
        holder[child] = joint
        below[parent].append((child, joint))
    roots = [name for name in links if name not in holder]
    if not roots:
        _fail(robot, "no root: every link is the child of a joint" if links else "there are no links")
    if len(roots) > 1:
        _fail(links[roots[1]], f"one root link is allowed, found {len(roots)}: {', '.join(roots)}")
    reached = list(_below(roots[0], below))
    for name, element in links.items():
        if name not in reached:
            _fail(element, f"{element} is in a cycle of joints: it does not hang on the root {roots[0]!r}")
    return roots[0], below


def _below(root: str, below: dict[str, list[tuple[str, _Element]]]) -> Iterator[str]:
    ahead = [root]
    while ahead:
        name = ahead.pop()
        yield name
        ahead += [child for child, _ in below[name]]


def _link_of(joint: _Element, end: str, links: dict[str, _Element]) -> str:
    element = joint.one(end)
    if element is None:
        _fail(joint, f"{joint} has no <{end}>")
    name = _attribute(element, "link", joint)
    if name not in links:
        _fail(element, f"{joint}: {end} {name!r} is not a link; links: {', '.join(links)}")
    return name


def _check_type(joint: _Element) -> None:
    kind, known = _attribute(joint, "type", joint), (*TYPES, "fixed")
    if kind not in known:
        _fail(joint, f"{joint}: type {kind!r} is not supported; allowed: {', '.join(known)}")


def _origin(element: _Element, of: _Element) -> tuple[np.ndarray, np.ndarray]:
    """Rotation `R_z(yaw) R_y(pitch) R_x(roll)` and position of an element's origin."""
    origin = element.one("origin")
    (c_r, c_p, c_y), (s_r, s_p, s_y) = (f(_numbers(origin, "rpy", 3, ZERO, of)) for f in (np.cos, np.sin))
    R_x = np.array([[1, 0, 0], [0, c_r, -s_r], [0, s_r, c_r]])
    R_y = np.array([[c_p, 0, s_p], [0, 1, 0], [-s_p, 0, c_p]])
    R_z = np.array([[c_y, -s_y, 0], [s_y, c_y, 0], [0, 0, 1]])
    return R_z @ R_y @ R_x, _numbers(origin, "xyz", 3, ZERO, of)


def _placed(joint: _Element, parent: Placement) -> Placement:
    """A joint's frame at rest in the body that carries it."""
    R, p = _origin(joint, joint)
    return Placement(body=parent.body, rotation=parent.rotation @ R, position=parent.position + parent.rotation @ p)


def _joint(joint: _Element, at: Placement) -> Joint:
    element = joint.one("axis")
    axis = _numbers(element, "xyz", 3, (1.0, 0.0, 0.0), joint)
    length = np.linalg.norm(axis)
    if not length > 0:
        _fail(element or joint, f"{joint}: the axis must not be zero")
    return Joint(
        name=joint.attributes["name"],
        parent=at.body,
        prismatic=TYPES[joint.attributes["type"]],
        position=at.position,
        rotation=at.rotation,
        axis=axis / length,
    )


# Joints that follow another -------------------------------------------------------------------------------------------


def _frozen(joints: dict[str, _Element], mimic: Mimic | None, rest: Mapping[str, float]) -> dict[str, float]:
    """Where each joint that follows another is held, by name, rad or m; none where they are independent."""
    followers = {
        name: element
        for name, joint in joints.items()
        if joint.attributes["type"] != "fixed" and (element := joint.one("mimic")) is not None
    }
    for name, element in followers.items():
        if mimic is None:
            _fail(
                element,
                f"{joints[name]} follows another (<mimic>), which the equations do not have: choose mimic "
                "'frozen' (it is fixed where the joint it follows rests) or 'independent' (it moves on its own)",
            )
    return {name: _held_at(name, joints, rest) for name in followers if mimic == "frozen"}


def _held_at(name: str, joints: dict[str, _Element], rest: Mapping[str, float]) -> float:
    """`multiplier rest + offset`, along the chain of joints that follow up to one that does not."""
    chain, gain, offset = [name], 1.0, 0.0
    while (element := joints[chain[-1]].one("mimic")) is not None and joints[chain[-1]].attributes["type"] != "fixed":
        joint = joints[chain[-1]]
        followed = _attribute(element, "joint", joint)
        if followed not in joints:
            _fail(element, f"{joint} follows {followed!r}, which is not a joint")
        if followed in chain:
            _fail(element, f"{joint} follows itself, by way of {', '.join(chain)}")
        offset += gain * _numbers(element, "offset", 1, (0.0,), joint)[0]
        gain *= _numbers(element, "multiplier", 1, (1.0,), joint)[0]
        chain.append(followed)
    return float(gain * rest.get(chain[-1], 0.0) + offset)


def _moved(joint: Joint, at: Placement, by: float) -> Placement:
    """A joint's frame as it is moved by a position, rad or m; `R = exp(by axis)` where it turns."""
    if joint.prismatic:
        return dataclasses.replace(at, position=at.position + by * at.rotation @ joint.axis)
    return dataclasses.replace(at, rotation=at.rotation @ Rotation.from_rotvec(by * joint.axis).as_matrix())


# Inertia --------------------------------------------------------------------------------------------------------------

ENTRIES = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")


def _inertial(link: _Element) -> Body | None:
    """A link's own mass and inertia, in its own frame, physical or not; None where there is none."""
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
    element = inertial.one(tag)
    if element is None:
        _fail(inertial, f"{link}: <inertial> has no <{tag}>")
    _attribute(element, name, link)
    return float(_numbers(element, name, 1, (), link)[0])


def _body(parts: list[tuple[_Element, Placement]]) -> Body:
    """Links held together: `m = sum m_i`, centre of mass, `J = sum J_i + m_i (d^2 I - d d^T)` about it."""
    first, _ = parts[0]
    own = [(link, _inertial(link), place) for link, place in parts]
    some = [(body, place) for _, body, place in own if body is not None]
    if not some:
        names = ", ".join(link.attributes["name"] for link, _ in parts[1:])
        also = f", nor have the links fixed to it: {names}" if names else ""
        _fail(first, f"{first} has no <inertial>{also}; a body that moves needs mass and inertia")
    names = ", ".join(link.attributes["name"] for link, body, _ in own[1:] if body is not None)
    whole = f"{first.place}: {first}" + (f" with what is fixed to it ({names})" if names else "")
    m = np.array([body.mass for body, _ in some])
    validation.validate_mass(whole, m.sum())
    s = np.array([place.position + place.rotation @ body.com for body, place in some])
    com = m @ s / m.sum()
    J = sum(
        _symmetric(place.rotation @ body.inertia @ place.rotation.T) + body.mass * (d @ d * np.eye(3) - np.outer(d, d))
        for (body, place), d in zip(some, s - com, strict=True)
    )
    validation.validate_inertia(whole, float(m.sum()), J)
    return Body(mass=float(m.sum()), com=com, inertia=J)


def _symmetric(J: np.ndarray) -> np.ndarray:
    """Without the asymmetry of rounding."""
    return (J + J.T) / 2
