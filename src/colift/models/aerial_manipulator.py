"""Kinematics and dynamics of one aerial manipulator: mass matrix, momenta, bias forces, contact Jacobians.

Quantities are expressed in the base frame, relative to the base origin or to the center of mass `s(r)`. They do not
depend on the attitude R, so the coupling terms of Eq. M0_partition are functions of the joint positions r only
(docs/errata.md, row 3). Functions take one agent; `jax.vmap` maps them over a group.

See Also:
    docs/equations.md: the equations of motion.
"""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from colift.math import so3
from colift.math.linalg import matmul, matvec, transpose
from colift.math.pytree import pytree
from colift.models.parameters import AerialManipulator, KinematicTree
from colift.models.state import AgentState

E3 = np.array([0.0, 0.0, 1.0])


@pytree
class ForwardKinematics:
    """Poses of bodies, joints and tips and their Jacobians, base frame, relative to the base origin.

    The points are the centers of mass of the bodies, the origins of the joints, and the tips, in this order.

    Attributes:
        rotation: Rotation of each body frame to the base frame.
        joint_axis: Unit vectors.
        points: Positions of the points [m].
        J_point: Derivatives of the points with respect to the joint positions.
        J_omega: Angular velocity of each body relative to the base, per joint velocity.
    """

    rotation: Float[Array, "bodies 3 3"]
    joint_axis: Float[Array, "n_r 3"]
    points: Float[Array, "points 3"]
    J_point: Float[Array, "points n_r 3"]
    J_omega: Float[Array, "bodies n_r 3"]


@jax.jit
def forward_kinematics(agent: AerialManipulator, r: Float[Array, "n_r"]) -> ForwardKinematics:
    """Compute forward kinematics and point Jacobians.

    A point x that joint k moves has the derivative `a_k x (x - o_k)`, or `a_k` if the joint is prismatic.

    Args:
        agent: Parameters of the agent.
        r: Joint positions [rad, m].

    Returns:
        Poses and Jacobians.
    """
    tree, bodies = agent.tree, agent.tree.joints + 1
    slides = np.array(tree.prismatic, dtype=float)
    turn = matmul(agent.joint_rotation, so3.from_axis_angle(agent.joint_axis, r * (1 - slides)))
    shift = agent.joint_position + matvec(agent.joint_rotation, agent.joint_axis * (r * slides)[:, None])
    joint = jnp.concatenate([turn, shift[:, :, None]], axis=2)
    frames = [jnp.eye(3, 4)]  # [rotation, origin] of each body
    for k, parent in enumerate(tree.parents):
        up = frames[parent]
        frames.append(matmul(up[:, :3], joint[k]) + up[:, 3:] * np.eye(1, 4, 3))
    frame = jnp.stack(frames)
    rotation, origin = frame[:, :, :3], frame[:, :, 3]
    carrier = np.array([*range(bodies), *tree.tip_bodies])
    placed = origin[carrier] + matvec(rotation[carrier], jnp.concatenate([agent.com, agent.tip_position]))
    point = jnp.concatenate([placed[:bodies], origin[1:], placed[bodies:]])
    axis = matvec(rotation[1:], agent.joint_axis)  # the rotation of a joint does not change its axis
    rotates, translates = _joint_effects(tree)
    lever = point[:, None] - origin[None, 1:]
    return ForwardKinematics(
        rotation=rotation,
        joint_axis=axis,
        points=point,
        J_point=so3.cross(axis[None], lever) * rotates + axis[None] * translates,
        J_omega=axis[None] * rotates[:bodies],
    )


def _joint_effects(tree: KinematicTree) -> tuple[np.ndarray, np.ndarray]:
    """Return masks over points and joints: whether the joint rotates the point, and whether it translates it."""
    bodies = [*range(tree.joints + 1), *range(1, tree.joints + 1), *tree.tip_bodies]
    moved = tree.ancestors[bodies].astype(float)[:, :, None]
    slides = np.array(tree.prismatic, dtype=float)[None, :, None]
    return moved * (1 - slides), moved * slides


@pytree
class CentroidalModel:
    """Dynamics of the agent in the coordinates (x, xi), `xi = (omega, r_dot)`, of the paper (Eq. nom_kin_coup).

    A point at `rho` from the center of mass has the velocity `R^T x_dot + B xi` in the base frame, with the Jacobian
    `B = [-hat(rho), d rho / d r]`. A force F at the point, base frame, acts on the momenta (mu, nu) with `B^T F`.

    Attributes:
        mass: Total mass m [kg].
        M_bar: Reduced mass matrix of xi.
        J_base: Jacobian B of the base origin, `rho = -s(r)`.
        J_com: Jacobians B of the centers of mass of the bodies.
        J_angular: Angular velocities of the bodies, base frame, per xi.
        inertia: Inertias of the bodies, base frame [kg m^2].
        tip_from_com: Tips relative to the center of mass [m].
        J_tip: Jacobians B of the tips, `R^T` times the contact Jacobian.
        com_from_base: Center of mass relative to the base origin, s(r) [m].
    """

    mass: Float[Array, ""]
    M_bar: Float[Array, "xi xi"]
    J_base: Float[Array, "3 xi"]
    J_com: Float[Array, "bodies 3 xi"]
    J_angular: Float[Array, "bodies 3 xi"]
    inertia: Float[Array, "bodies 3 3"]
    tip_from_com: Float[Array, "arms 3"]
    J_tip: Float[Array, "arms 3 xi"]
    com_from_base: Float[Array, "3"]


@jax.jit
def centroidal_model(agent: AerialManipulator, g: ForwardKinematics) -> CentroidalModel:
    """Compute the reduced mass matrix `M_bar = sum_i m_i B_i^T B_i + W_i^T I_i W_i` and the Jacobians.

    `B_i` are the Jacobians of the centers of mass of the bodies and `W_i` those of their angular velocities. They are
    relative to the center of mass of the agent, which eliminates the translation (Eq. vbar_def). The result equals the
    Schur complement `M_rr - M_rv M_vv^-1 M_vr` of Eq. M0_partition.

    Args:
        agent: Parameters of the agent.
        g: Forward kinematics at the joint positions.

    Returns:
        The model at the joint positions.
    """
    bodies = agent.tree.joints + 1
    m = agent.mass
    mass = m.sum()
    s = (m[:, None] * g.points[:bodies]).sum(0) / mass
    ds = (m[:, None, None] * g.J_point[:bodies]).sum(0) / mass
    rho = g.points - s[None]
    B = jnp.concatenate([-so3.hat(rho), transpose(g.J_point - ds[None])], axis=2)
    spin = jnp.concatenate([so3.identity((bodies,)), transpose(g.J_omega)], axis=2)
    inertia = matmul(matmul(g.rotation, agent.inertia), transpose(g.rotation))
    com = B[:bodies]
    turning = matmul(inertia, spin)
    terms = (m[:, None, None] * com)[..., None, :] * com[..., None] + spin[..., None] * turning[..., None, :]
    M_bar = terms.sum((0, 1))
    return CentroidalModel(
        mass=mass,
        M_bar=M_bar,
        J_base=jnp.concatenate([so3.hat(s), -ds.T], axis=1),
        J_com=com,
        J_angular=spin,
        inertia=inertia,
        tip_from_com=rho[bodies + agent.tree.joints :],
        J_tip=B[bodies + agent.tree.joints :],
        com_from_base=s,
    )


@jax.jit
def bias_forces(
    agent: AerialManipulator,
    g: ForwardKinematics,
    q: CentroidalModel,
    omega: Float[Array, "3"],
    r_dot: Float[Array, "n_r"],
) -> tuple[Float[Array, "xi"], Float[Array, "arms 3"]]:
    """Compute the velocity-dependent terms of the equations of motion by Kane's method.

    `M_bar xi_dot + h = Q` with `h = sum_i B_i^T m_i a_i + W_i^T (I_i alpha_i + w_i x I_i w_i)`, where `a_i` and
    `alpha_i` are the accelerations of body i at `xi_dot = 0`.

    Args:
        agent: Parameters of the agent.
        g: Forward kinematics at the joint positions.
        q: Model at the joint positions.
        omega: Angular velocity of the base, base frame [rad/s].
        r_dot: Joint velocities [rad/s, m/s].

    Returns:
        The bias force h on (mu, nu) [N m, N], and the accelerations of the tips relative to the center of mass at
        `xi_dot = 0`, base frame [m/s^2].
    """
    tree = agent.tree
    bodies = tree.joints + 1
    rotates, translates = _joint_effects(tree)
    rates = r_dot[None, :, None]
    w, axis_dot = _angular_velocities(tree, g, omega, rates)
    point_dot = so3.cross(omega[None], g.points) + (g.J_point * rates).sum(1)
    joint, joint_dot = g.points[bodies : bodies + tree.joints], point_dot[bodies : bodies + tree.joints]
    lever, lever_dot = g.points[:, None] - joint[None], point_dot[:, None] - joint_dot[None]
    J_dot = (
        rotates * (so3.cross(axis_dot[None], lever) + so3.cross(g.joint_axis[None], lever_dot))
        + translates * axis_dot[None]
    )
    a = so3.cross(omega[None], point_dot) + (J_dot * rates).sum(1)
    alpha = (rotates[:bodies] * axis_dot[None] * rates).sum(1)
    moment = matvec(q.inertia, alpha) + so3.cross(w, matvec(q.inertia, w))
    m = agent.mass[:, None]
    h = (q.J_com * (m * a[:bodies])[:, :, None]).sum((0, 1)) + (q.J_angular * moment[:, :, None]).sum((0, 1))
    a_com = (m * a[:bodies]).sum(0) / q.mass
    return h, a[bodies + tree.joints :] - a_com[None]


def _angular_velocities(
    tree: KinematicTree, g: ForwardKinematics, omega: Float[Array, "3"], rates: Float[Array, "1 n_r 1"]
) -> tuple[Float[Array, "bodies 3"], Float[Array, "n_r 3"]]:
    """Return angular velocities of the bodies [rad/s] and rates of the joint axes relative to the world [1/s]."""
    w = omega[None] + (g.J_omega * rates).sum(1)
    return w, so3.cross(w[np.array(tree.parents, dtype=int)], g.joint_axis)


def angular_motion_of_tips(
    agent: AerialManipulator, g: ForwardKinematics, omega: Float[Array, "3"], r_dot: Float[Array, "n_r"]
) -> tuple[Float[Array, "arms 3"], Float[Array, "arms 3"]]:
    """Compute the angular velocities of the tip bodies, and their angular accelerations at `xi_dot = 0`.

    Args:
        agent: Parameters of the agent.
        g: Forward kinematics at the joint positions.
        omega: Angular velocity of the base, base frame [rad/s].
        r_dot: Joint velocities [rad/s, m/s].

    Returns:
        Angular velocities [rad/s] and angular accelerations [rad/s^2], base frame.
    """
    tree, rates = agent.tree, r_dot[None, :, None]
    w, axis_dot = _angular_velocities(tree, g, omega, rates)
    rotates, _ = _joint_effects(tree)
    alpha = (rotates[: tree.joints + 1] * axis_dot[None] * rates).sum(1)
    tips = np.array(tree.tip_bodies)
    return w[tips], alpha[tips]


def momenta(agent: AerialManipulator, r: Float[Array, "n_r"], xi: Float[Array, "xi"]) -> Float[Array, "xi"]:
    """Compute the momenta `(mu, nu) = M_bar(r) xi` (Eq. nom_kin_coup).

    Args:
        agent: Parameters of the agent.
        r: Joint positions [rad, m].
        xi: `(omega, r_dot)`, base frame [rad/s, m/s].

    Returns:
        Angular momentum and joint momenta [kg m^2/s, kg m/s].
    """
    return matvec(centroidal_model(agent, forward_kinematics(agent, r)).M_bar, xi)


@jax.jit
def momentum_drift(agent: AerialManipulator, r: Float[Array, "n_r"], xi: Float[Array, "xi"]) -> Float[Array, "xi"]:
    """Compute the rates of the momenta without forces, `(mu x omega, 1/2 xi^T dM_bar/dr xi)` (Eq. nom_momentum).

    Args:
        agent: Parameters of the agent.
        r: Joint positions [rad, m].
        xi: `(omega, r_dot)`, base frame [rad/s, m/s].

    Returns:
        The rates [N m, N].
    """

    def twice_energy(r: Float[Array, "n_r"]) -> Float[Array, ""]:
        return (xi * momenta(agent, r, xi)).sum()

    return jnp.concatenate([so3.cross(momenta(agent, r, xi)[:3], xi[:3]), jax.grad(twice_energy)(r) / 2])


def tip_positions(agent: AerialManipulator, state: AgentState) -> Float[Array, "arms 3"]:
    """Compute the contact points `p_b = x + R rho_b(r)` (Eq. dae_constraints).

    Args:
        agent: Parameters of the agent.
        state: State of the agent.

    Returns:
        Positions of the tips, world frame [m].
    """
    rho = centroidal_model(agent, forward_kinematics(agent, state.r)).tip_from_com
    return state.x[None] + matvec(state.R[None], rho)


def center_of_mass(agent: AerialManipulator, r: Float[Array, "n_r"]) -> Float[Array, "3"]:
    """Compute the center of mass `s(r)` relative to the base origin.

    Args:
        agent: Parameters of the agent.
        r: Joint positions [rad, m].

    Returns:
        Position, base frame [m].
    """
    g = forward_kinematics(agent, r)
    return (agent.mass[:, None] * g.points[: agent.tree.joints + 1]).sum(0) / agent.mass.sum()
