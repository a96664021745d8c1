"""Export of a team as an MJCF document, the XML format of MuJoCo; MuJoCo is not required.

Payload and bases are free bodies; joints are hinges and slides. A contact is a `connect` constraint between a site of
the payload and a site of the tip body. Geoms are for display only and do not collide.

MuJoCo's constraints are soft: contact forces satisfy `(A + S) lam = a_ref - a_0` with `A = J M^-1 J^T`. `a_0` is the
relative acceleration at the contacts without contact forces. `a_ref = -2 r_dot / (d T) - r / (d T)^2` stabilizes the
position error r. The softness S is about `(1 - d) / d` times the diagonal of A. T and d are the
first parameters of `solref` and `solimp`; the constraint is rigid in the limit T to 0, d to 1.

See Also:
    docs/decisions/0025-contact-settings-of-the-mujoco-plant.md: the reasons for the settings.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from typing import NamedTuple
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element, SubElement

import jax
import jax.numpy as jnp
import numpy as np
from scipy.spatial.transform import Rotation

from colift.models import aerial_manipulator, grasp
from colift.models.parameters import AerialManipulator, KinematicTree, Team, agent_names
from colift.models.state import AgentState, State

TIMESTEP = 5e-4  # s
IMPEDANCE = 0.9999  # d, the maximum in MuJoCo
MIN_ARM_LENGTH = 1e-3  # m, shorter arms are not displayed
ROTORS = ((1, 1), (1, -1), (-1, 1), (-1, -1))  # signs of the corners of the base, for display


Numbers = np.ndarray | jax.Array
Scalar = float | jax.Array


class ContactSoftness(NamedTuple):
    """Softness of contact constraints.

    Attributes:
        time_constant: T [s]; MuJoCo uses at least two timesteps.
        impedance: d, in (0, 1).
    """

    time_constant: float
    impedance: float = IMPEDANCE


def stiffest_contact(timestep: float) -> ContactSoftness:
    """Return the stiffest contact that MuJoCo supports.

    Args:
        timestep: Timestep of MuJoCo [s].

    Returns:
        The softness.
    """
    return ContactSoftness(time_constant=2 * timestep)


RIGID_CONTACT = stiffest_contact(TIMESTEP)


class _Part(NamedTuple):
    """One agent and the names of its elements."""

    name: str
    agent: AerialManipulator
    state: AgentState
    joints: tuple[str, ...]
    contacts: tuple[str, ...]


def joint_names(team: Team, names: Sequence[str] = ()) -> tuple[str, ...]:
    """Return one name per joint, `<agent>/joint <k>`, in team order.

    Args:
        team: Team.
        names: Names of the agents in team order; default: `agent 1`, `agent 2`, ...

    Returns:
        The names.
    """
    counts = [group.tree.joints for size, group in zip(team.sizes, team.agent_groups, strict=True) for _ in range(size)]
    each = zip(agent_names(team, names), counts, strict=True)
    return tuple(f"{name}/joint {k + 1}" for name, n in each for k in range(n))


def to_mjcf(
    team: Team,
    state: State,
    names: Sequence[str] = (),
    joints: Sequence[str] = (),
    contacts: Sequence[str] = (),
    timestep: float = TIMESTEP,
    softness: ContactSoftness = RIGID_CONTACT,
) -> str:
    """Write a team as an MJCF document; the state is the keyframe `start`.

    An agent has the actuator `<agent> thrust` (N, along the third axis of the base). It has `<agent> torque x`, `y` and
    `z` (N m, base frame), and one actuator per joint with the name of the joint. All quantities are in SI units and
    radians. A wrong number of names raises `ValueError`.

    Args:
        team: Team.
        state: State of the team.
        names: Names of the agents in team order; default: `parameters.agent_names`.
        joints: Names of the joints in team order; default: `joint_names`.
        contacts: Names of the contacts in team order; default: `grasp.contact_names`.
        timestep: Timestep of MuJoCo [s].
        softness: Softness of the contacts.

    Returns:
        The XML document.

    Raises:
        ValueError: If a contact bears moments.
    """
    if team.zero_contact_moments is not None:
        raise ValueError("MJCF: contacts of type soft_finger or rigid are not supported (agent_types: arms: contact)")
    parts = tuple(_parts(team, state, names, joints, contacts))
    root = Element("mujoco", model="colift")
    SubElement(root, "compiler", angle="radian", inertiafromgeom="false")
    option = SubElement(root, "option", timestep=_text(timestep), gravity=_text(team.gravity), integrator="RK4")
    option.attrib |= {"solver": "Newton", "tolerance": "1e-14", "jacobian": "dense"}
    SubElement(option, "flag", contact="disable")
    default = SubElement(root, "default")
    SubElement(default, "geom", contype="0", conaffinity="0", mass="0", rgba="0.55 0.6 0.65 1")
    SubElement(default, "site", size="0.008", rgba="0.85 0.3 0.2 1")
    d = softness.impedance
    SubElement(default, "equality", solref=_text([softness.time_constant, 1]), solimp=_text([d, d, 1, 0.5, 2]))
    _add_bodies(SubElement(root, "worldbody"), team, state, parts)
    equality = SubElement(root, "equality")
    for contact in (contact for part in parts for contact in part.contacts):
        SubElement(equality, "connect", name=contact, site1=f"payload/{contact}", site2=contact)
    _add_actuators(SubElement(root, "actuator"), parts)
    qpos, qvel = _coordinates(state, parts)
    SubElement(SubElement(root, "keyframe"), "key", name="start", qpos=_text(qpos), qvel=_text(qvel))
    ET.indent(root)
    return ET.tostring(root, encoding="unicode") + "\n"


def _parts(
    team: Team, team_state: State, names: Sequence[str], joints: Sequence[str], contacts: Sequence[str]
) -> Iterator[_Part]:
    """Iterate over the agents with the names of their joints and contacts."""
    name = iter(agent_names(team, names))
    remaining_joints = iter(_names_or_default("joints", joints, joint_names(team, names)))
    remaining_contacts = iter(_names_or_default("contacts", contacts, grasp.contact_names(team, names)))
    for group, state in zip(team.agent_groups, team_state.agents, strict=True):
        for j in range(len(state.r)):
            agent, q = jax.tree.map(lambda x, j=j: np.asarray(x)[j], (group, state))
            moving = tuple(itertools.islice(remaining_joints, agent.tree.joints))
            yield _Part(next(name), agent, q, moving, tuple(itertools.islice(remaining_contacts, agent.tree.arms)))


def _names_or_default(kind: str, names: Sequence[str], default: tuple[str, ...]) -> Sequence[str]:
    """Return the given names, or the default names if there are none."""
    if names and len(names) != len(default):
        raise ValueError(f"{kind}: {len(names)} given for {len(default)}: {list(names)}")
    return names or default


# Bodies ---------------------------------------------------------------------------------------------------------------


def _add_bodies(world: Element, team: Team, state: State, parts: tuple[_Part, ...]) -> None:
    """Add payload and agents to the world."""
    mass, inertia = float(team.payload.mass), np.asarray(team.payload.inertia)
    body = SubElement(world, "body", name="payload", pos=_text(state.payload.p), quat=_quaternion(state.payload.R))
    SubElement(body, "freejoint", name="payload")
    _add_inertia(body, mass, np.zeros(3), inertia)
    _add_box(body, mass, np.zeros(3), inertia)
    for part in parts:
        for contact, at in zip(part.contacts, part.agent.contact_position, strict=True):
            SubElement(body, "site", name=f"payload/{contact}", pos=_text(at))
    for part in parts:
        _add_agent(world, part)


def _add_agent(world: Element, part: _Part) -> None:
    """Add the base of an agent on a free joint, its rotors, and the bodies of its arms."""
    origin, _ = _base(part)
    base = SubElement(world, "body", name=part.name, pos=_text(origin), quat=_quaternion(part.state.R))
    SubElement(base, "freejoint", name=part.name)
    SubElement(base, "site", name=part.name)
    agent = part.agent
    half = _add_box(base, agent.mass[0], agent.com[0], agent.inertia[0])
    for x, y in ROTORS:
        at, size = half * [x, y, 1] + agent.com[0], [0.6 * min(half[:2]), 0.003]
        SubElement(base, "geom", type="cylinder", pos=_text(at), size=_text(size), rgba="0.2 0.4 0.7 0.5")
    _fill(base, part, 0)


def _fill(body: Element, part: _Part, i: int) -> None:
    """Add inertia, arms and tips of body i, then its child bodies."""
    agent, tree = part.agent, part.agent.tree
    carried = [k for k, parent in enumerate(tree.parents) if parent == i]
    tips = [b for b, tip in enumerate(tree.tip_bodies) if tip == i]
    _add_inertia(body, agent.mass[i], agent.com[i], agent.inertia[i])
    for end in (*(agent.joint_position[k] for k in carried), *(agent.tip_position[b] for b in tips)):
        if np.linalg.norm(end) > MIN_ARM_LENGTH:
            SubElement(body, "geom", type="capsule", size="0.008", fromto=_text([0, 0, 0, *end]))
    for b in tips:
        SubElement(body, "site", name=part.contacts[b], pos=_text(agent.tip_position[b]))
    for k in carried:
        at, quaternion = _text(agent.joint_position[k]), _quaternion(agent.joint_rotation[k])
        child = SubElement(body, "body", name=part.joints[k], pos=at, quat=quaternion)
        kind = "slide" if tree.prismatic[k] else "hinge"
        SubElement(child, "joint", name=part.joints[k], type=kind, axis=_text(agent.joint_axis[k]))
        _fill(child, part, k + 1)


def _depth_first(tree: KinematicTree) -> list[int]:
    """Return the joints in the order of MuJoCo, a depth-first traversal of the tree."""

    def below(body: int) -> Iterator[int]:
        for k, parent in enumerate(tree.parents):
            if parent == body:
                yield k
                yield from below(k + 1)

    return list(below(0))


def _add_inertia(body: Element, mass: Scalar, com: Numbers, J: Numbers) -> None:
    """Add mass, center of mass and inertia to a body."""
    full = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
    SubElement(body, "inertial", pos=_text(com), mass=_text(mass), fullinertia=_text(full))


def _add_box(body: Element, mass: Scalar, com: Numbers, inertia: Numbers) -> np.ndarray:
    """Add a box with the inertia of a body; return half of its extent along the body axes [m]."""
    half, axes = inertia_box(mass, inertia)
    SubElement(body, "geom", type="box", pos=_text(com), quat=_quaternion(axes), size=_text(half))
    return np.abs(axes @ half)


def inertia_box(mass: Scalar, inertia: Numbers) -> tuple[np.ndarray, np.ndarray]:
    """Compute the homogeneous box with a given mass and inertia, for display.

    Half the edge along axis a is `sqrt(3 (J_b + J_c - J_a) / (2 m))`, and at least 1 mm.

    Args:
        mass: Mass m [kg].
        inertia: Inertia about the center of mass, body frame [kg m^2].

    Returns:
        Half the edges [m], and the axes of the box by column, body frame.
    """
    J, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.linalg.det(axes)
    return np.sqrt(np.maximum(1.5 * (J.sum() - 2 * J) / mass, 1e-6)), axes


# Actuators and coordinates --------------------------------------------------------------------------------------------


def _add_actuators(actuator: Element, parts: tuple[_Part, ...]) -> None:
    """Add the motors of thrust, torque and joints."""
    for part in parts:
        thrust = SubElement(actuator, "motor", name=f"{part.name} thrust", site=part.name, gear="0 0 1 0 0 0")
        thrust.attrib |= {"ctrllimited": "true", "ctrlrange": _text([0, part.agent.thrust_max])}
        for axis, gear in zip("xyz", np.eye(6, dtype=int)[3:], strict=True):
            turn = " ".join(map(str, gear))
            SubElement(actuator, "motor", name=f"{part.name} torque {axis}", site=part.name, gear=turn)
        for joint in part.joints:
            SubElement(actuator, "motor", name=joint, joint=joint)


def _coordinates(state: State, parts: tuple[_Part, ...]) -> tuple[list[float], list[float]]:
    """Return `qpos` and `qvel` of MuJoCo; free bodies have world velocities and body rates."""
    q = jax.tree.map(np.asarray, state.payload)
    qpos, qvel = [*q.p, *_wxyz(q.R)], [*q.v, *q.omega]
    for part in parts:
        order = _depth_first(part.agent.tree)
        origin, velocity = _base(part)
        qpos += [*origin, *_wxyz(part.state.R), *part.state.r[order]]
        qvel += [*velocity, *part.state.omega, *part.state.r_dot[order]]
    return qpos, qvel


def _base(part: _Part) -> tuple[np.ndarray, np.ndarray]:
    """Compute position [m] and velocity [m/s] of the base origin, world frame: `x - R s`, `v + R B xi`."""
    origin, velocity = _origin(part.agent, part.state)
    return np.asarray(origin), np.asarray(velocity)


@jax.jit
def _origin(agent: AerialManipulator, q: AgentState) -> tuple[jax.Array, jax.Array]:
    """Compute position and velocity of the base origin, see `_base`."""
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, q.r))
    return q.x - q.R @ p.com_from_base, q.v + q.R @ (p.J_base @ jnp.concatenate([q.omega, q.r_dot]))


def _wxyz(R: Numbers) -> np.ndarray:
    """Convert a rotation matrix to a quaternion, scalar first."""
    return Rotation.from_matrix(np.asarray(R)).as_quat(scalar_first=True)


def _quaternion(R: Numbers) -> str:
    """Format the quaternion of a rotation matrix."""
    return _text(_wxyz(R))


def _text(numbers: object) -> str:
    """Format numbers with all digits."""
    return " ".join(repr(float(x)) for x in np.atleast_1d(np.asarray(numbers, dtype=float)))
