"""Links and joints of a robot file, and their reduction to the bodies and joints of the model.

A file format is read into a `LinkTree`. `reduce_tree` fixes the frozen joints and merges links that are rigidly
connected. The physical consistency of bodies is checked, not that of links, because files contain placeholder links.
Joints are numbered depth-first, children in the order of the file.
"""

from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Collection, Mapping
from types import MappingProxyType
from typing import Literal

import numpy as np
from scipy.spatial.transform import Rotation

from colift.models import validation
from colift.models.robot import Body, Joint, JointLimits, Placement, Robot

FIXED, REVOLUTE, CONTINUOUS, PRISMATIC = "fixed", "revolute", "continuous", "prismatic"
CoupledJoints = Literal["frozen", "independent"]
InertiaRule = Literal["strict", "balanced"]
ZERO_POSITIONS: Mapping[str, float] = MappingProxyType({})


class ChoiceRequiredError(ValueError):
    """A file that can be read if the user makes a choice.

    Attributes:
        problem: Sentence with the location.
        option: Parameter of `reduce_tree` that makes the choice.
        choices: Values of the parameter with their meaning; names of joints are separated by commas.
    """

    def __init__(self, problem: str, option: str, choices: Mapping[str, str]):
        super().__init__(problem, option, choices)
        self.problem, self.option, self.choices = problem, option, choices

    def __str__(self) -> str:
        """Return the problem and the choices as parameters of a Python call."""
        return self.advise(lambda option, value: f"{option}={value.split(',') if option == 'frozen' else value!r}")

    def advise(self, form: Callable[[str, str], str]) -> str:
        """Return the problem and the choices.

        Args:
            form: Text of an option with a value, as the user has to write it.

        Returns:
            One sentence.
        """
        choices = (f"{form(self.option, value)} ({meaning})" for value, meaning in self.choices.items())
        return f"{self.problem}: choose {' or '.join(choices)}"


@dataclasses.dataclass(frozen=True)
class Link:
    """Link of a file; `inertial` is in the frame of the link."""

    name: str  # name in the file
    location: str  # location for messages
    inertial: Body | None


@dataclasses.dataclass(frozen=True)
class Coupling:
    """Position of a coupled joint: `multiplier position + offset`, with the position of another joint."""

    joint: str  # the joint that is followed
    multiplier: float  # factor on the position of the other joint
    offset: float  # rad or m
    location: str  # location for messages


@dataclasses.dataclass(frozen=True)
class LinkJoint:
    """Joint of a file; its frame at position zero is the frame of the child link."""

    name: str  # name in the file
    kind: str  # FIXED, REVOLUTE, CONTINUOUS or PRISMATIC
    parent: str  # name of the link
    child: str  # name of the link
    rotation: np.ndarray  # joint frame at position zero to parent frame
    position: np.ndarray  # m, joint origin in the parent frame
    axis: np.ndarray  # unit vector, joint frame
    limits: JointLimits  # limits stated in the file
    coupling: Coupling | None  # None for an independent joint
    location: str  # location for messages

    @property
    def label(self) -> str:
        """Name for messages."""
        return f"joint {self.name!r}"


@dataclasses.dataclass(frozen=True)
class LinkTree:
    """Tree of links; the root link is the base of the agent.

    Attributes:
        file: File name, for messages.
        root: Name of the root link.
        links: Links by name.
        joints: Joints by name.
        rotor_drives: Joints that the file declares as drives of rotors.
        servo_drives: Joints that the file declares as driven, but not as drives of rotors.
        damped: Joints with damping or friction, which are not part of the model.
        notes: Sentences on other contents of the file that the model does not have.
    """

    file: str
    root: str
    links: Mapping[str, Link]
    joints: Mapping[str, LinkJoint]
    rotor_drives: frozenset[str] = frozenset()
    servo_drives: frozenset[str] = frozenset()
    damped: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @functools.cached_property
    def joints_below(self) -> Mapping[str, tuple[LinkJoint, ...]]:
        """Joints by the name of their parent link, in the order of the file."""
        below: dict[str, list[LinkJoint]] = {name: [] for name in self.links}
        for joint in self.joints.values():
            below[joint.parent].append(joint)
        return {name: tuple(joints) for name, joints in below.items()}

    @property
    def moving(self) -> tuple[LinkJoint, ...]:
        """Joints that are not fixed."""
        return tuple(joint for joint in self.joints.values() if joint.kind != FIXED)


@dataclasses.dataclass(frozen=True)
class Skeleton:
    """Kinematics of a tree without inertias.

    Attributes:
        joints: Movable joints.
        placements: Pose of each link in its body, by name.
        members: Names of the links of each body, the first one defines its frame.
    """

    joints: tuple[Joint, ...]
    placements: Mapping[str, Placement]
    members: tuple[tuple[str, ...], ...]


def skeleton(tree: LinkTree, frozen: Mapping[str, float]) -> Skeleton:
    """Compute the bodies and joints of a tree.

    Args:
        tree: Links and joints.
        frozen: Positions of frozen joints by name [rad, m].

    Returns:
        Kinematics with the frozen joints fixed.
    """
    members: list[list[str]] = [[]]
    joints: list[Joint] = []
    placements: dict[str, Placement] = {}
    base = Placement(body=0, rotation=np.eye(3), position=np.zeros(3))
    pending: list[tuple[str, LinkJoint | None, Placement]] = [(tree.root, None, base)]
    while pending:
        name, joint, placement = pending.pop()
        if joint is not None:
            placement = _joint_frame(joint, placement)
            if joint.name in frozen:
                placement = _displaced(joint, placement, frozen[joint.name])
            elif joint.kind != FIXED:
                joints.append(
                    Joint(
                        name=joint.name,
                        parent=placement.body,
                        prismatic=joint.kind == PRISMATIC,
                        position=placement.position,
                        rotation=placement.rotation,
                        axis=joint.axis,
                        limits=joint.limits,
                    )
                )
                placement = Placement(body=len(joints), rotation=np.eye(3), position=np.zeros(3))
                members.append([])
        placements[name] = placement
        members[placement.body].append(name)
        pending += [(below.child, below, placement) for below in reversed(tree.joints_below[name])]
    return Skeleton(joints=tuple(joints), placements=placements, members=tuple(map(tuple, members)))


def reduce_tree(
    tree: LinkTree,
    mimic: CoupledJoints | None = None,
    nominal_positions: Mapping[str, float] = ZERO_POSITIONS,
    frozen: Collection[str] = (),
    inertia: InertiaRule = "strict",
) -> Robot:
    """Fix frozen joints and merge rigidly connected links.

    Coupled joints without a choice, moved bodies without inertia, and bodies that violate the triangle inequality
    raise `ChoiceRequiredError`, which is a `ValueError`.

    Args:
        tree: Links and joints.
        mimic: Treatment of coupled joints: "frozen" fixes them at `multiplier position + offset`, where `position` is
            that of the joint they depend on; "independent" makes them independent joints; None refuses them.
        nominal_positions: Positions of joints by name [rad, m], for frozen joints and for joints that frozen joints
            depend on; default: 0.
        frozen: Names of joints to fix: a coupled joint as with `mimic="frozen"`, another one at its nominal position.
        inertia: "strict" refuses bodies whose principal moments violate the triangle inequality; "balanced" replaces
            the moments by the closest ones that satisfy it.

    Returns:
        The robot.

    Raises:
        ValueError: If a frozen joint is unknown, a coupling is invalid, or a body is not physically consistent.
    """
    found = skeleton(tree, _frozen_positions(tree, mimic, nominal_positions, frozen))
    changes: list[str] = []
    try:
        bodies = tuple(_body(tree, names, found.placements, inertia, changes) for names in found.members)
    except ChoiceRequiredError:
        raise
    except ValueError as error:
        if not (light := _joints_without_inertia(tree, found)):
            raise ValueError(f"{error}: correct it in the file") from None
        meaning = "the joints of all links without mass or inertia, in addition to other frozen joints"
        raise ChoiceRequiredError(str(error), "frozen", {light: meaning}) from None
    return Robot(file=tree.file, bodies=bodies, joints=found.joints, links=found.placements, changes=tuple(changes))


def _joint_frame(joint: LinkJoint, parent: Placement) -> Placement:
    """Return the frame of a joint at position zero in its parent body."""
    R, p = joint.rotation, joint.position
    return Placement(body=parent.body, rotation=parent.rotation @ R, position=parent.position + parent.rotation @ p)


def _displaced(joint: LinkJoint, at: Placement, position: float) -> Placement:
    """Return the frame of a joint at a position [rad, m]; `R = exp(position axis)` for a rotational joint."""
    if joint.kind == PRISMATIC:
        return dataclasses.replace(at, position=at.position + position * at.rotation @ joint.axis)
    return dataclasses.replace(at, rotation=at.rotation @ Rotation.from_rotvec(position * joint.axis).as_matrix())


# Frozen and coupled joints --------------------------------------------------------------------------------------------


def _frozen_positions(
    tree: LinkTree, mimic: CoupledJoints | None, nominal_positions: Mapping[str, float], frozen: Collection[str]
) -> dict[str, float]:
    """Return the positions of frozen joints [rad, m], by name."""
    known = {joint.name for joint in tree.moving}
    for name in frozen:
        if name not in known:
            raise ValueError(
                f"{tree.file}: frozen joint {name!r} is not a joint that moves; joints: {', '.join(sorted(known))}"
            )
    fixed = set(frozen)
    for joint in tree.moving:
        if joint.coupling is None or joint.name in fixed:
            continue
        if mimic is None:
            raise ChoiceRequiredError(
                f"{joint.coupling.location}: {joint.label} depends on another joint (<mimic>), which the model does "
                "not support",
                "mimic",
                {
                    "frozen": "fixed at the rest position of that joint",
                    "independent": "an independent joint",
                },
            )
        if mimic == "frozen":
            fixed.add(joint.name)
    return {
        joint.name: frozen_joint_position(tree, joint.name, nominal_positions)
        for joint in tree.moving
        if joint.name in fixed
    }


def frozen_joint_position(tree: LinkTree, name: str, nominal_positions: Mapping[str, float]) -> float:
    """Compute the position of a frozen joint: `multiplier position + offset` along a chain of coupled joints.

    Args:
        tree: Links and joints.
        name: Name of the joint.
        nominal_positions: Positions of joints by name [rad, m]; default: 0.

    Returns:
        The position [rad, m].

    Raises:
        ValueError: If a joint depends on an unknown joint, or on itself.
    """
    chain, gain, offset = [name], 1.0, 0.0
    while True:
        joint = tree.joints[chain[-1]]
        if joint.coupling is None or joint.kind == FIXED:
            return float(gain * nominal_positions.get(chain[-1], 0.0) + offset)
        followed = joint.coupling.joint
        if followed not in tree.joints:
            raise ValueError(f"{joint.coupling.location}: {joint.label} depends on {followed!r}, which is not a joint")
        if followed in chain:
            raise ValueError(f"{joint.coupling.location}: {joint.label} depends on itself through {', '.join(chain)}")
        offset += gain * joint.coupling.offset
        gain *= joint.coupling.multiplier
        chain.append(followed)


# Inertia --------------------------------------------------------------------------------------------------------------


def merge_links(tree: LinkTree, names: Collection[str], placements: Mapping[str, Placement]) -> Body | None:
    """Merge links to a body: `m = sum m_i`, center of mass, `J = sum J_i + m_i (d^2 I - d d^T)` about it.

    Args:
        tree: Links and joints.
        names: Names of the links.
        placements: Pose of each link in the body, by name.

    Returns:
        The body, without a check of physical consistency; None if it has no mass.
    """
    some = [(body, placements[name]) for name in names if (body := tree.links[name].inertial) is not None]
    m = np.array([body.mass for body, _ in some])
    if not m.sum() > 0:
        return None
    s = np.array([placement.position + placement.rotation @ body.com for body, placement in some])
    com = m @ s / m.sum()
    J = sum(
        symmetric(placement.rotation @ body.inertia @ placement.rotation.T)
        + body.mass * (d @ d * np.eye(3) - np.outer(d, d))
        for (body, placement), d in zip(some, s - com, strict=True)
    )
    return Body(mass=float(m.sum()), com=com, inertia=np.asarray(J))


def _body(
    tree: LinkTree,
    names: tuple[str, ...],
    placements: Mapping[str, Placement],
    rule: InertiaRule,
    changes: list[str],
) -> Body:
    """Merge links to a body and check that it is physically consistent."""
    first = tree.links[names[0]]
    with_inertia = [name for name in names if tree.links[name].inertial is not None]
    if not with_inertia:
        also = f", nor do the links fixed to it: {', '.join(names[1:])}" if names[1:] else ""
        raise ValueError(
            f"{first.location}: link {first.name!r} has no <inertial>{also}; every body requires mass and inertia"
        )
    others = ", ".join(name for name in with_inertia if name != first.name)
    whole = f"{first.location}: link {first.name!r}" + (f" with the links fixed to it ({others})" if others else "")
    body = merge_links(tree, names, placements)
    if body is None:
        raise ValueError(f"{whole}: mass 0 kg is not positive")
    return dataclasses.replace(body, inertia=_checked_inertia(whole, body.mass, body.inertia, rule, changes))


def _checked_inertia(body: str, mass: float, J: np.ndarray, rule: InertiaRule, changes: list[str]) -> np.ndarray:
    """Return an inertia that satisfies the triangle inequality; append a sentence if it was changed."""
    moments, axes = np.linalg.eigh(J)
    if not (moments[0] > 0 and moments[2] > (moments[0] + moments[1]) * (1 + 1e-9)):
        validation.validate_inertia(body, mass, J)
        return J
    if rule == "strict":
        try:
            validation.validate_inertia(body, mass, J)
        except ValueError as error:
            meaning = "the closest moments that satisfy it"
            raise ChoiceRequiredError(str(error), "inertia", {"balanced": meaning}) from None
    new = balanced_moments(moments)
    balanced = symmetric(axes @ np.diag(new) @ axes.T)
    validation.validate_inertia(body, mass, balanced)
    before, after = (", ".join(f"{x:.4g}" for x in values) for values in (moments, new))
    changes.append(f"{body}: principal moments {before} kg m^2 violate the triangle inequality: balanced to {after}")
    return balanced


def balanced_moments(moments: np.ndarray) -> np.ndarray:
    """Project principal moments onto the triangle inequality: the closest `(a, b, c)` with `c <= a + b`.

    `d = (c - a - b) / 3` is added to a and b and subtracted from c.

    Args:
        moments: Principal moments in ascending order [kg m^2].

    Returns:
        The closest moments [kg m^2]; unchanged if they satisfy the inequality.
    """
    excess = max(float(moments[2] - moments[0] - moments[1]), 0.0) / 3
    return moments + excess * np.array([1.0, 1.0, -1.0])


def _joints_without_inertia(tree: LinkTree, found: Skeleton) -> str:
    """Return the joints that move a body without mass or inertia; empty if the base has none either."""
    bodies = [merge_links(tree, names, found.placements) for names in found.members]
    empty = [k for k, body in enumerate(bodies) if body is None or not np.linalg.eigvalsh(body.inertia)[0] > 0]
    return "" if 0 in empty else ",".join(found.joints[k - 1].name for k in empty)


def symmetric(J: np.ndarray) -> np.ndarray:
    """Remove asymmetry due to rounding.

    Args:
        J: Matrix.

    Returns:
        `(J + J^T) / 2`.
    """
    return (J + J.T) / 2
