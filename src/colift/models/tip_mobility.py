"""Directions in which no joint of an agent moves its tips relative to its center of mass.

Let the tips of an agent be at rest. A direction across the thrust is *bound* if no motion of the joints moves the
center of mass in it. The center of mass must then follow the tips in this direction, and moves in it only if the agent
rotates. For one arm these are the directions across the thrust that are orthogonal to all columns of the tip Jacobian:
the axis of a planar arm, and both directions of a tip that is fixed to the base. The functions run on the host.

See Also:
    colift.models.grasp: grasp Jacobian `[I, d rho / d r]`, whose null space contains these motions.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from colift.models import aerial_manipulator
from colift.models.parameters import AerialManipulator

MIN_TIP_MOTION = 0.01
"""Smallest motion of the center of mass per joint motion in a direction that is not bound [m/rad, or m/m].

The controller weights 1 cm of the center of mass like 1 rad of a joint, so that less mobile joints are hardly used.
"""


@dataclasses.dataclass(frozen=True)
class TipMobility:
    """Motion of one agent with its tips at rest, base frame."""

    mass: float  # kg
    inertia: np.ndarray  # (3, 3) kg m^2, about the center of mass, joints moving as far as the tips require
    bound: np.ndarray  # (k, 3) orthonormal bound directions across the thrust, k = 0, 1 or 2
    com_motion: np.ndarray  # (3, 3) m/rad, motion of the center of mass per rotation of the agent about each axis

    def lever(self, direction: np.ndarray) -> float:
        """Compute the height of the center of mass above the tips for the rotation along a bound direction.

        Joints that follow the rotation reduce it. It is negative if the center of mass is below the tips.

        Args:
            direction: Unit vector across the thrust, base frame.

        Returns:
            Motion of the center of mass along the direction per rotation about `e_3 x direction` [m].
        """
        return float(direction @ self.com_motion @ rotation_axis(direction))

    def rotational_inertia(self, direction: np.ndarray) -> float:
        """Compute the inertia of the rotation that moves the center of mass along a direction [kg m^2].

        Args:
            direction: Unit vector across the thrust, base frame.

        Returns:
            Inertia about `e_3 x direction` through the center of mass.
        """
        axis = rotation_axis(direction)
        return float(axis @ self.inertia @ axis)

    def bound_share(self, direction: np.ndarray) -> float:
        """Compute the squared share of a unit vector that lies along the bound directions, from 0 to 1."""
        return float(((self.bound @ direction) ** 2).sum())


def rotation_axis(direction: np.ndarray) -> np.ndarray:
    """Return the axis `e_3 x direction` about which a rotation moves points above the tips along the direction."""
    return np.cross(aerial_manipulator.E3, direction)


def tip_mobility(agent: AerialManipulator, r: np.ndarray, min_motion: float = MIN_TIP_MOTION) -> TipMobility:
    """Compute the bound directions of an agent, and its motion with tips at rest.

    The grasp Jacobian `J = [I, B_r]` of the motions `(x, r_dot)` has the null space of joint motions with tips at rest.
    Its part across the thrust has a singular value below `min_motion` in each bound direction. With tips at rest,
    `J y = -B_omega omega`; of its solutions the one with the least motion across the thrust is used.

    Args:
        agent: Parameters of one agent.
        r: Joint positions [rad, m].
        min_motion: Tolerance, see `MIN_TIP_MOTION`.

    Returns:
        The mobility at these joint positions.
    """
    p = aerial_manipulator.centroidal_model(agent, aerial_manipulator.forward_kinematics(agent, r))
    B, n, joints = np.asarray(p.J_tip), agent.tree.arms, agent.tree.joints
    J = np.hstack([np.tile(np.eye(3), (n, 1)), B[:, :, 3:].reshape(3 * n, joints)])
    weights = np.concatenate([np.full(2, min_motion), [1 / min_motion], np.ones(joints)])  # roots of inverse weights
    y = weights[:, None] * np.linalg.pinv(J * weights) @ -B[:, :, :3].reshape(3 * n, 3)
    spin = np.vstack([np.eye(3), y[3:]])
    return TipMobility(
        mass=float(p.mass),
        inertia=spin.T @ np.asarray(p.M_bar) @ spin,
        bound=_bound_directions(J, min_motion),
        com_motion=y[:3],
    )


def _bound_directions(J: np.ndarray, min_motion: float) -> np.ndarray:
    """Return the directions across the thrust in which no joint motion with tips at rest moves the center of mass."""
    _, singular, Vt = np.linalg.svd(J)
    null = Vt[int((singular > 1e-9 * singular[0]).sum()) :].T  # motions with tips at rest, by column
    # motion of the center of mass per unit of joint motion; z is free, because the thrust changes in size at once
    joints = np.linalg.pinv(null[3:], rcond=1e-9) if null.size else np.zeros((0, J.shape[1] - 3))
    motion = null[:2] @ joints
    if not motion.size:
        return np.eye(3)[:2]
    U, values, _ = np.linalg.svd(motion)
    moved = int((values > min_motion).sum())
    if moved == 0:
        return np.eye(3)[:2]
    return np.hstack([U[:, moved:].T, np.zeros((2 - moved, 1))])
