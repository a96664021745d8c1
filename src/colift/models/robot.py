"""Kinematic tree of rigid bodies that an agent is made from.

A robot is the result of reading a file (`colift.models.urdf`, `colift.models.mjcf_import`): links that are connected by
fixed or frozen joints form one body. Joint k moves body k + 1; body 0 is the base, along whose third axis thrust acts.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence

import jax.numpy as jnp
import numpy as np

from colift.models.parameters import AerialManipulator, KinematicTree

Vector = Sequence[float] | np.ndarray
ZERO = (0.0, 0.0, 0.0)


@dataclasses.dataclass(frozen=True)
class Body:
    """Rigid body: a link and the links connected to it by fixed joints, in the frame of the first link."""

    mass: float  # kg
    com: np.ndarray  # m, center of mass
    inertia: np.ndarray  # kg m^2, about the center of mass


@dataclasses.dataclass(frozen=True)
class JointLimits:
    """Limits of a joint; None where the file states none. The model does not enforce them."""

    position: tuple[float, float] | None = None  # rad or m, smallest and largest
    speed: float | None = None  # rad/s or m/s
    effort: float | None = None  # N m or N

    @property
    def leave_no_range(self) -> bool:
        """Return whether the smallest position is the largest one."""
        return self.position is not None and self.position[0] == self.position[1]


UNLIMITED_JOINT = JointLimits()


@dataclasses.dataclass(frozen=True)
class Joint:
    """Movable joint; its frame at position zero is the frame of the body that it moves."""

    name: str  # name in the file
    parent: int  # index of the parent body
    prismatic: bool  # whether the joint translates
    position: np.ndarray  # m, joint origin in the parent frame
    rotation: np.ndarray  # joint frame at position zero to parent frame
    axis: np.ndarray  # unit vector, joint frame
    limits: JointLimits = UNLIMITED_JOINT  # limits stated in the file


@dataclasses.dataclass(frozen=True)
class Placement:
    """Pose of a link in the frame of its body: `x_body = rotation x_link + position`."""

    body: int  # index of the body
    rotation: np.ndarray  # link frame to body frame
    position: np.ndarray  # m, link origin in the body frame


@dataclasses.dataclass(frozen=True)
class Robot:
    """Kinematics and inertias of a file; joint k moves body k + 1, body 0 is the base.

    Attributes:
        file: File name, for messages.
        bodies: Rigid bodies.
        joints: Movable joints.
        links: Pose of each link, by its name.
        changes: One sentence per body whose inertia was changed.
    """

    file: str
    bodies: tuple[Body, ...]
    joints: tuple[Joint, ...]
    links: Mapping[str, Placement]
    changes: tuple[str, ...] = ()

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
