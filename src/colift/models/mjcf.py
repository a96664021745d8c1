"""A team in a state as an MJCF document, the XML that MuJoCo reads; MuJoCo is not needed to write it.

Payload and bases are free bodies, joints hinges and slides; a contact is a `connect` constraint between a site of the
payload and one of the tip's body. Nothing else touches: geoms are for the eye. MuJoCo has no rigid constraint. Its
contact forces obey `(A + S) lam = a_ref - a_0`: `A = J M^-1 J^T`, `a_0` how the ends of the contacts part without them,
`a_ref = -2 r_dot / (d T) - r / (d T)^2` the pull back from a gap r, and `S = (1 - d) / d` of about the diagonal of A is
the softness. T and d are the first numbers of `solref` and `solimp`; T to 0 and d to 1 is rigid (docs/decisions/0025).
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
IMPEDANCE = 0.9999  # d: the largest that MuJoCo takes
MIN_ARM_LENGTH = 1e-3  # m, arm that is shown
ROTORS = ((1, 1), (1, -1), (-1, 1), (-1, -1))  # corners of a base that carry one, for the eye


Numbers = np.ndarray | jax.Array
Scalar = float | jax.Array


class ContactSoftness(NamedTuple):
    """How far a contact is from rigid."""

    time_constant: float  # s, T; MuJoCo raises it to two timesteps where it is less
    impedance: float = IMPEDANCE  # d


def stiffest_contact(timestep: float) -> ContactSoftness:
    """The least softness that MuJoCo has at a timestep, s."""
    return ContactSoftness(time_constant=2 * timestep)


RIGID = stiffest_contact(TIMESTEP)


class _Part(NamedTuple):
    """One agent with what it is called."""

    name: str
    agent: AerialManipulator
    state: AgentState
    joints: tuple[str, ...]
    contacts: tuple[str, ...]


def joint_names(team: Team, names: Sequence[str] = ()) -> tuple[str, ...]:
    """One name a joint, `<agent>/joint <k>`, in team order."""
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
    softness: ContactSoftness = RIGID,
) -> str:
    """The team as MJCF, its state the keyframe `start`; names in team order, by default those of `model` and `grasp`.

    Actuators: `<agent> thrust` (N, along the base's third axis), `<agent> torque x` to `z` (N m, base frame), and one
    a joint. Quantities are SI, angles in radians. Raises ValueError unless there are as many names as there are things.
    """
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
    """Every agent, its joints and contacts named."""
    name = iter(agent_names(team, names))
    of_joints = iter(_named("joints", joints, joint_names(team, names)))
    of_contacts = iter(_named("contacts", contacts, grasp.contact_names(team, names)))
    for group, state in zip(team.agent_groups, team_state.agents, strict=True):
        for j in range(len(state.r)):
            agent, q = jax.tree.map(lambda x, j=j: np.asarray(x)[j], (group, state))
            moving = tuple(itertools.islice(of_joints, agent.tree.joints))
            yield _Part(next(name), agent, q, moving, tuple(itertools.islice(of_contacts, agent.tree.arms)))


def _named(what: str, given: Sequence[str], default: tuple[str, ...]) -> Sequence[str]:
    if given and len(given) != len(default):
        raise ValueError(f"{what}: {len(given)} given for {len(default)}: {list(given)}")
    return given or default


# Bodies ---------------------------------------------------------------------------------------------------------------


def _add_bodies(world: Element, team: Team, state: State, parts: tuple[_Part, ...]) -> None:
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
    """A base on a free joint, with its rotors, and what it carries."""
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
    """Inertia, arms and tips of body i, then the bodies that hang on it."""
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
        at, turned = _text(agent.joint_position[k]), _quaternion(agent.joint_rotation[k])
        child = SubElement(body, "body", name=part.joints[k], pos=at, quat=turned)
        kind = "slide" if tree.prismatic[k] else "hinge"
        SubElement(child, "joint", name=part.joints[k], type=kind, axis=_text(agent.joint_axis[k]))
        _fill(child, part, k + 1)


def _depth_first(tree: KinematicTree) -> list[int]:
    """Joints in the order in which MuJoCo counts them: with each, all that hang on it before its next sibling."""

    def below(body: int) -> Iterator[int]:
        for k, parent in enumerate(tree.parents):
            if parent == body:
                yield k
                yield from below(k + 1)

    return list(below(0))


def _add_inertia(body: Element, mass: Scalar, com: Numbers, J: Numbers) -> None:
    full = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
    SubElement(body, "inertial", pos=_text(com), mass=_text(mass), fullinertia=_text(full))


def _add_box(body: Element, mass: Scalar, com: Numbers, inertia: Numbers) -> np.ndarray:
    """A box with the body's inertia; half of what it spans, m."""
    half, axes = inertia_box(mass, inertia)
    SubElement(body, "geom", type="box", pos=_text(com), quat=_quaternion(axes), size=_text(half))
    return np.abs(axes @ half)


def inertia_box(mass: Scalar, inertia: Numbers) -> tuple[np.ndarray, np.ndarray]:
    """The box with a body's mass, kg, and inertia, kg m^2: half its edges, m, and its axes by column, body's frame.

    `a^2 = 3 (J_b + J_c - J_a) / 2 m`; no edge is shorter than 2 mm.
    """
    J, axes = np.linalg.eigh(inertia)
    axes[:, 0] *= np.linalg.det(axes)
    return np.sqrt(np.maximum(1.5 * (J.sum() - 2 * J) / mass, 1e-6)), axes


# The rest -------------------------------------------------------------------------------------------------------------


def _add_actuators(actuator: Element, parts: tuple[_Part, ...]) -> None:
    for part in parts:
        thrust = SubElement(actuator, "motor", name=f"{part.name} thrust", site=part.name, gear="0 0 1 0 0 0")
        thrust.attrib |= {"ctrllimited": "true", "ctrlrange": _text([0, part.agent.thrust_max])}
        for axis, gear in zip("xyz", np.eye(6, dtype=int)[3:], strict=True):
            turn = " ".join(map(str, gear))
            SubElement(actuator, "motor", name=f"{part.name} torque {axis}", site=part.name, gear=turn)
        for joint in part.joints:
            SubElement(actuator, "motor", name=joint, joint=joint)


def _coordinates(state: State, parts: tuple[_Part, ...]) -> tuple[list[float], list[float]]:
    """`qpos` and `qvel` of MuJoCo: of a free body position, quaternion, velocity in the world, rate in the body."""
    q = jax.tree.map(np.asarray, state.payload)
    qpos, qvel = [*q.p, *_wxyz(q.R)], [*q.v, *q.omega]
    for part in parts:
        order = _depth_first(part.agent.tree)
        origin, velocity = _base(part)
        qpos += [*origin, *_wxyz(part.state.R), *part.state.r[order]]
        qvel += [*velocity, *part.state.omega, *part.state.r_dot[order]]
    return qpos, qvel


def _base(part: _Part) -> tuple[np.ndarray, np.ndarray]:
    """Position, m, and velocity, m/s, of the base's origin: `x - R s`, `v + R B xi`."""
    origin, velocity = _origin(part.agent, part.state)
    return np.asarray(origin), np.asarray(velocity)


@jax.jit
def _origin(agent: AerialManipulator, q: AgentState) -> tuple[jax.Array, jax.Array]:
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, q.r))
    return q.x - q.R @ p.com_from_base, q.v + q.R @ (p.J_base @ jnp.concatenate([q.omega, q.r_dot]))


def _wxyz(R: Numbers) -> np.ndarray:
    return Rotation.from_matrix(np.asarray(R)).as_quat(scalar_first=True)


def _quaternion(R: Numbers) -> str:
    return _text(_wxyz(R))


def _text(numbers: object) -> str:
    """Numbers with all their digits."""
    return " ".join(repr(float(x)) for x in np.atleast_1d(np.asarray(numbers, dtype=float)))
