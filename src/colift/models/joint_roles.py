"""Roles of joints and links of a robot file: rotors, fingers of grippers, sensors, and links that can hold a payload.

Files describe propellers, fingers and sensor gimbals as joints like those of an arm. The rules distinguish them by
kinematics, inertia, names, motor plugins and transmissions. Every result is a proposal that the user can replace.
"""

from __future__ import annotations

import dataclasses
import itertools
import re
from collections.abc import Iterator

import numpy as np

from colift.models.link_tree import (
    CONTINUOUS,
    FIXED,
    PRISMATIC,
    LinkJoint,
    LinkTree,
    Skeleton,
    frozen_joint_position,
    merge_links,
    skeleton,
)
from colift.models.robot import Joint

ROTOR_NAME = re.compile(r"rotor|thrust|propell|airscrew|(?<![a-z])(props?|blades?|fans?)(?![a-z])", re.IGNORECASE)
FINGER_NAME = re.compile(r"finger|gripper|jaw|claw|knuckle|thumb|pincer|(?<![a-z])grip(?![a-z])", re.IGNORECASE)
HOLDER_NAME = re.compile(r"gripper|(?<![a-z])grip(?![a-z])", re.IGNORECASE)  # also of the body that carries fingers
SENSOR_NAME = re.compile(
    r"sensor|camera|gimbal|lidar|laser|sonar|imu|gps|gnss|baro|magnetom|optical|depth|realsense|hokuyo|velodyne|antenna"
    r"|odometry|battery|processor|(?<![a-z])(bat|cam|cog|led|zed|d435i?|t265|gyro|landing|gear|skid|leg)s?(?![a-z])",
    re.IGNORECASE,
)
HAND_NAME = re.compile(
    r"hand|tool|tcp|end_?eff|gripp|hook|magnet|suction|flange|(?<![a-z])(ee|eef|tip|grip|payload|attach)(?![a-z])",
    re.IGNORECASE,
)
MIN_ROTOR_RANGE = 2 * np.pi  # rad, a smaller range of positions excludes a rotor
MAX_NAMED_MASS_RATIO = 0.2  # mass of a rotor with a name, over the mass of the file
MAX_ROTOR_MASS_RATIO = 0.05  # mass of a rotor without a name, over the mass of the file
MAX_ROTOR_INERTIA_RATIO = 0.05  # largest moment of such a rotor over that of the base
MIN_ALIKE_ROTORS = 3  # rotors without a name that are alike; fewer could be joints of an arm
HOOK_RATIO, DEFAULT_RADIUS = 0.65, 0.15  # depth of a hook over the radius of gyration of the base; m
MASS_TOLERANCE = 0.01  # relative difference of alike rotors
PARALLEL = 0.9  # cosine of the angle between the axes of fingers
MAX_FINGER_MASS_RATIO = 0.05  # mass of a finger without a name, over the mass of the file


@dataclasses.dataclass(frozen=True)
class TipProposal:
    """Point that can hold a payload, in the frame of a link."""

    link: str  # name of the link
    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m


@dataclasses.dataclass(frozen=True)
class JointRoles:
    """Roles of the joints of a file.

    Attributes:
        rotors: Joints of rotors.
        grippers: Joints of the fingers of each gripper.
        idle: Other joints that do not move: chosen by the user, without a range, or without a tip, such as gimbals.
        tips: Points that can hold a payload.
        rests_on_base: True if no arm was found, so that the base holds the payload.
    """

    rotors: tuple[str, ...]
    grippers: tuple[tuple[str, ...], ...]
    idle: tuple[str, ...]
    tips: tuple[TipProposal, ...]
    rests_on_base: bool

    @property
    def frozen(self) -> tuple[str, ...]:
        """Joints that are not part of an arm."""
        return (*self.rotors, *(joint for group in self.grippers for joint in group), *self.idle)


def classify(tree: LinkTree, frozen: tuple[str, ...] | None = None, tips: tuple[str, ...] = ()) -> JointRoles:
    """Find rotors, grippers, idle joints and tips.

    Args:
        tree: Links and joints.
        frozen: Joints that the user freezes besides those that are found; empty to freeze none; None for a proposal.
        tips: Links that hold the payload; empty for a proposal.

    Returns:
        The roles.
    """
    find = frozen is None or len(frozen) > 0
    rotors = tuple(joint.name for joint in _rotors(tree)) if find else ()
    grippers = tuple(_grippers(tree, set(rotors))) if find else ()
    fingers = {joint for group in grippers for joint in group}
    locked = tuple(joint.name for joint in tree.moving if find and joint.limits.leave_no_range)
    stated = tuple(name for name in dict.fromkeys((*(frozen or ()), *locked)) if name not in {*rotors, *fingers})
    fixed = {name: frozen_joint_position(tree, name, {}) for name in {*rotors, *fingers, *stated}}
    found = skeleton(tree, fixed)
    proposals, on_base = tuple(TipProposal(link) for link in tips), False
    if not tips:
        proposals = tuple(_arm_tips(tree, found, grippers, rotors))
        on_base = not proposals
        proposals = proposals or (_base_tip(tree, found, grippers),)
    carriers = {0}
    for proposal in proposals:
        body = found.placements[proposal.link].body
        while body:
            carriers.add(body)
            body = found.joints[body - 1].parent
    idle = tuple(joint.name for k, joint in enumerate(found.joints) if find and k + 1 not in carriers)
    return JointRoles(rotors=rotors, grippers=grippers, idle=(*stated, *idle), tips=proposals, rests_on_base=on_base)


# Rotors ---------------------------------------------------------------------------------------------------------------


def _subtree(tree: LinkTree, link: str) -> tuple[list[str], list[LinkJoint]]:
    """Return the links below and including a link, and the joints between them."""
    links, joints, pending = [], [], [link]
    while pending:
        name = pending.pop()
        links.append(name)
        joints += tree.joints_below[name]
        pending += [joint.child for joint in tree.joints_below[name]]
    return links, joints


def _mass(tree: LinkTree, links: list[str]) -> float:
    """Compute the mass of links [kg]."""
    return sum(body.mass for name in links if (body := tree.links[name].inertial) is not None)


def _rotors(tree: LinkTree) -> list[LinkJoint]:
    """Return the joints of rotors.

    A rotor is a leaf that turns without limits. It is driven by a motor plugin or a rotor transmission, or it has the
    name of a rotor and little mass. Otherwise several alike leaves on the base must be light and balanced.
    """
    total, certain, alike = _mass(tree, list(tree.links)), [], []
    for joint in tree.moving:
        links, below = _subtree(tree, joint.child)
        if not _turns_freely(joint) or any(other.kind != FIXED for other in below):
            continue
        share = _mass(tree, links) / total if total > 0 else 0.0
        named = any(ROTOR_NAME.search(name) for name in (joint.name, joint.child))
        if joint.name in tree.rotor_drives or (named and share < MAX_NAMED_MASS_RATIO):
            certain.append(joint)
        elif joint.name not in tree.servo_drives and share < MAX_ROTOR_MASS_RATIO and _is_balanced(tree, joint):
            alike.append(joint)
    masses = {joint.name: _mass(tree, _subtree(tree, joint.child)[0]) for joint in alike}
    return certain + [
        joint
        for joint in alike
        if sum(abs(m - masses[joint.name]) <= MASS_TOLERANCE * m for m in masses.values()) >= MIN_ALIKE_ROTORS
    ]


def _turns_freely(joint: LinkJoint) -> bool:
    """Return whether a joint turns by a revolution or more."""
    limits = joint.limits.position
    wide = limits is None or limits[1] - limits[0] >= MIN_ROTOR_RANGE
    return joint.kind != PRISMATIC and (joint.kind == CONTINUOUS or wide)


def _is_balanced(tree: LinkTree, joint: LinkJoint) -> bool:
    """Return whether a joint on the base turns a light and balanced body."""
    found = skeleton(tree, {})
    body, base = tree.links[joint.child].inertial, merge_links(tree, found.members[0], found.placements)
    if found.placements[joint.parent].body != 0 or body is None or base is None:
        return False
    lever = np.linalg.norm(np.cross(body.com, joint.axis))
    radius = np.sqrt(np.abs(body.inertia).max() / max(body.mass, 1e-12))
    light = np.abs(body.inertia).max() < MAX_ROTOR_INERTIA_RATIO * np.abs(base.inertia).max()
    return bool(light and lever <= 0.1 * radius)


# Grippers -------------------------------------------------------------------------------------------------------------


def _grippers(tree: LinkTree, taken: set[str]) -> Iterator[tuple[str, ...]]:
    """Yield the joints of the fingers of each gripper.

    Fingers are the joints below one body whose names, or those of the links they move, are names of fingers; or a pair
    of leaves that close against each other. A joint that moves the body of several fingers is not one of them.
    """
    found = skeleton(tree, dict.fromkeys(taken, 0.0))
    groups: list[tuple[str, ...]] = []  # from the last body to the first, because those of fingers come after others
    for body in reversed(range(len(found.members))):
        starts = [joint for joint in found.joints if joint.parent == body]
        fingers: list[str] = []
        for start in starts:
            joints = [tree.joints[start.name], *_subtree(tree, tree.joints[start.name].child)[1]]
            moving = [joint.name for joint in joints if joint.kind != FIXED and joint.name not in taken]
            if all(_has_finger_name(tree, name) for name in moving) and not _moves_gripper(tree, moving, groups):
                fingers += moving
        paired = dict.fromkeys(name for pair in _pairs(tree, found, body) for name in pair)
        fingers += [name for name in paired if name not in fingers]
        if fingers:
            groups = [*(group for group in groups if not set(group) <= set(fingers)), tuple(fingers)]
    yield from reversed(groups)


def _has_finger_name(tree: LinkTree, name: str) -> bool:
    """Return whether a joint, or the link that it moves, has the name of a finger."""
    return any(FINGER_NAME.search(text) for text in (name, tree.joints[name].child))


def _moves_gripper(tree: LinkTree, chain: list[str], groups: list[tuple[str, ...]]) -> bool:
    """Return whether the first joint of a chain moves several fingers, and has no name of a single finger."""
    first = [HOLDER_NAME.sub("", text) for text in (chain[0], tree.joints[chain[0]].child)]
    several = any(len(group) > 1 and set(group) < set(chain) for group in groups)
    return several and not any(FINGER_NAME.search(text) for text in first)


def _pairs(tree: LinkTree, found: Skeleton, body: int) -> Iterator[tuple[str, str]]:
    """Yield pairs of leaves on one body that close against each other, see `_oppose`."""
    parents = {joint.parent for joint in found.joints}
    leaves = [joint for k, joint in enumerate(found.joints) if joint.parent == body and k + 1 not in parents]
    for a, b in itertools.combinations(leaves, 2):
        if _oppose(tree, a, b):
            yield a.name, b.name


def _oppose(tree: LinkTree, a: Joint, b: Joint) -> bool:
    """Return whether one of two leaves follows the other, or both are fingers that move in opposite directions.

    Fingers without names are light and alike, and carry neither a sensor nor a hand. Parallel axes have opposite
    directions if each range is mostly on another side of zero. Leaves that rotate on the base are arms.
    """
    couplings = tree.joints[a.name].coupling, tree.joints[b.name].coupling
    if {a.name, b.name} & {coupling.joint for coupling in couplings if coupling is not None}:
        return True
    children = [tree.joints[each.name].child for each in (a, b)]
    masses = [_mass(tree, _subtree(tree, child)[0]) for child in children]
    others = any(kind.search(child) for kind in (SENSOR_NAME, HAND_NAME) for child in children)
    light = max(masses) < MAX_FINGER_MASS_RATIO * _mass(tree, list(tree.links)) and min(masses) > 0.5 * max(masses)
    if others or not light or a.prismatic != b.prismatic or (a.parent == 0 and not a.prismatic):
        return False
    cosine = (a.rotation @ a.axis) @ (b.rotation @ b.axis)
    sides = {_side(a), _side(b)}
    return bool(cosine < -PARALLEL or (cosine > PARALLEL and sides == {-1, 1}))


def _side(joint: Joint) -> int:
    """Return the sign of the side on which three quarters or more of the range of a joint lie; 0 if there is none."""
    lower, upper = joint.limits.position or (-1.0, 1.0)
    return int(np.sign(lower + upper)) if abs(lower + upper) >= 0.5 * (upper - lower) else 0


# Tips -----------------------------------------------------------------------------------------------------------------


def _arm_tips(
    tree: LinkTree, found: Skeleton, grippers: tuple[tuple[str, ...], ...], rotors: tuple[str, ...]
) -> Iterator[TipProposal]:
    """Yield the tip of the last body of each chain; bodies that consist of sensors or carry a rotor have none."""
    parents = {joint.parent for joint in found.joints} | {
        found.placements[tree.joints[name].child].body for name in rotors
    }
    for body in range(1, len(found.members)):
        links = [name for name in found.members[body] if not SENSOR_NAME.search(name)]
        moved = found.joints[body - 1].name
        if body in parents or not links or SENSOR_NAME.search(moved):
            continue
        on_gripper = _gripper_tip(tree, found, grippers, body)
        if on_gripper is not None:
            yield on_gripper
            continue
        hands = [name for name in links if HAND_NAME.search(name)] or links
        yield TipProposal(max(hands, key=lambda link: float(np.linalg.norm(found.placements[link].position))))


def _gripper_tip(
    tree: LinkTree, found: Skeleton, grippers: tuple[tuple[str, ...], ...], body: int
) -> TipProposal | None:
    """Return the point between the fingers of a gripper on a body, in the frame of the link that carries them."""
    for group in grippers:
        carrier = tree.joints[group[0]].parent
        if found.placements[carrier].body != body:
            continue
        last = [name for name in group if not any(tree.joints[o].name in group for o in _moved_joints(tree, name))]
        ends = [_finger_end(tree, found, tree.joints[name].child) for name in last or group]
        placement = found.placements[carrier]
        offset = placement.rotation.T @ (np.mean(ends, axis=0) - placement.position)
        x, y, z = (float(f"{value:.6f}") + 0.0 for value in offset)
        return TipProposal(carrier, (x, y, z))
    return None


def _moved_joints(tree: LinkTree, name: str) -> list[str]:
    """Return the names of the joints below a joint."""
    return [joint.name for joint in _subtree(tree, tree.joints[name].child)[1]]


def _finger_end(tree: LinkTree, found: Skeleton, link: str) -> np.ndarray:
    """Return the link origin of a finger that is farthest from the origin of its body [m, frame of the body]."""
    links, _ = _subtree(tree, link)
    return max((found.placements[name].position for name in links), key=lambda p: float(np.linalg.norm(p)))


def _base_tip(tree: LinkTree, found: Skeleton, grippers: tuple[tuple[str, ...], ...]) -> TipProposal:
    """Return the tip of a vehicle without an arm: a gripper, a link with the name of a hand, or a point below the base.

    The point is `HOOK_RATIO` radii of gyration below the origin of the root link, as the hook of `init --arms 0`.
    """
    on_gripper = _gripper_tip(tree, found, grippers, 0)
    if on_gripper is not None:
        return on_gripper
    hands = [name for name in found.members[0] if HAND_NAME.search(name) and not SENSOR_NAME.search(name)]
    hands = [name for name in hands if not ROTOR_NAME.search(name)]
    if hands:
        return TipProposal(max(hands, key=lambda link: float(np.linalg.norm(found.placements[link].position))))
    body = merge_links(tree, found.members[0], found.placements)
    radius = DEFAULT_RADIUS if body is None else np.sqrt(np.abs(body.inertia).max() / body.mass)
    return TipProposal(tree.root, (0.0, 0.0, -float(f"{HOOK_RATIO * radius:.3g}")))
